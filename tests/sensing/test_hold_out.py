"""The cells by which planners are compared."""

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.extras.benchmarks.coverage.judging import HoldOut
from uavcover.model.sensor import SphereSensor
from uavcover.sensing.coverage_map import CoverageMap

LINE = np.array([[20.0, 100.0, 70.0], [280.0, 100.0, 75.0]])


def test_half_the_size_and_shifted_by_half_a_cell() -> None:
    hold_out = HoldOut(make_site(hills, cell_m=10.0))
    centres = hold_out.coverage.grid.cells.centre_m
    assert hold_out.coverage.grid.cells.size_m == 5.0
    assert centres[:, 0].min() == pytest.approx(5.0)
    assert np.unique(np.diff(np.unique(centres[:, 0]))) == pytest.approx(5.0)


def test_no_cell_counts_that_a_planner_may_have_looked_at() -> None:
    site = make_site(hills, cell_m=10.0, planner={"cell_size_m": 25.0})
    hold_out = HoldOut(site)
    counted = {
        tuple(position) for position in np.round(hold_out.coverage.grid.cells.centre_m[hold_out.held_out, :2], 6)
    }
    for size in (10.0, 25.0):
        known = CoverageMap(site, cell_size_m=size).grid.cells.centre_m[:, :2]
        assert not counted & {tuple(position) for position in np.round(known, 6)}
    assert 0.7 < hold_out.held_out.mean() < 0.8


def test_coverage_is_that_of_the_cells_that_count() -> None:
    hold_out = HoldOut(make_site(hills))
    observed = hold_out.coverage.observed(LINE)
    weight, counts = hold_out.coverage.grid.weight_m2, hold_out.held_out & hold_out.coverage.coverable
    by_hand = sum(w for w, s, c in zip(weight, observed, counts, strict=True) if s and c)
    by_hand /= sum(w for w, c in zip(weight, counts, strict=True) if c)
    assert hold_out.coverage_of_coverable(LINE) == pytest.approx(by_hand)
    assert by_hand > 0.1


def test_lines_of_sight_are_rays_whatever_the_scenario_says() -> None:
    def ball(line_of_sight: str) -> SphereSensor:
        return SphereSensor(kind="sphere", range_m=200.0, sensing="at-waypoints", line_of_sight=line_of_sight)

    def wall(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.where((east > 130.0) & (east < 150.0), 60.0, 0.0) + 0.0 * north

    eyes = np.array([[60.0, 100.0, 45.0]])
    fractions = [
        HoldOut(make_site(wall, sensor=ball(kind))).coverage_of_coverable(eyes) for kind in ("ray", "midpoint")
    ]
    assert fractions[0] == fractions[1] > 0.0
    limits = {"ray": CoverageMap(make_site(wall, sensor=ball("ray")), cell_size_m=5.0)}
    limits["midpoint"] = CoverageMap(make_site(wall, sensor=ball("midpoint")), cell_size_m=5.0)
    assert limits["midpoint"].observed(eyes).sum() > limits["ray"].observed(eyes).sum()
