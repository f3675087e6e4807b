"""The judge among obstacles: what they hide, what they are too near to, and what is sure beside them."""

import dataclasses

import numpy as np
import pytest

from tests.planner.sites import tower, with_scenario
from tests.verification.flights import changed, fly_along, joined_tracks, make_site
from tests.verification.test_cells import at, reasons_at, verdict_on
from uavcover.model.limits import Obstacles
from uavcover.model.scenario import Uncertainty
from uavcover.model.sensor import NadirCamera
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

WALL = Obstacles(prisms=(tower(140, 50, 150, 150, 60, name="wall"),), clearance_beside_m=10.0, clearance_above_m=5.0)
WIDE = NadirCamera(kind="nadir-camera", fov_deg=100.0, range_m=400.0, max_incidence_deg=90.0)


def test_a_gap_called_occluded_is_seen_when_the_obstacle_is_taken_away() -> None:
    path = np.array([[115.0, -100.0, 80.0], [115.0, 300.0, 80.0]])
    lower = Obstacles(prisms=(tower(140, 50, 150, 150, 40),))
    with_wall = verdict_on(make_site(sensor=WIDE, obstacles=lower), path)
    without = verdict_on(make_site(sensor=WIDE), path)
    # From 80 m up and 35 m beside it the ray over a wall of 40 m comes down at twice its distance.
    behind = at(with_wall, 165.0, 105.0)
    assert reasons_at(with_wall, 165.0, 105.0) == ("occluded", True)
    assert without.flown.observed[behind]
    assert {gap.reason for gap in with_wall.report.gaps} == {"occluded", "never-in-range"}
    assert {gap.reason for gap in without.report.gaps} == {"never-in-range"}
    # The roof is a cell like another: seen.
    assert with_wall.flown.observed[at(with_wall, 145.0, 105.0)]
    assert with_wall.report.violations == ()


def test_too_near_an_obstacle_with_time_place_and_amount() -> None:
    # Past the wall 6 m aside, 4 m nearer than allowed, at 10 m/s.
    verdict = verdict_on(make_site(obstacles=WALL), np.array([[134.0, 0.0, 50.0], [134.0, 200.0, 50.0]]))
    (violation,) = verdict.report.violations
    assert (violation.kind, violation.phase, violation.unit) == ("obstacle", "route", "m")
    assert violation.excess == pytest.approx(4.0, abs=1e-6)
    assert (violation.limit, violation.worst) == (0.0, pytest.approx(4.0, abs=1e-6))
    assert 50.0 - 1e-6 <= violation.north_m <= 150.0 + 1e-6
    # Within 10 m of the wall from 42 m to 158 m north, by samples of 2 m.
    assert violation.start_s == pytest.approx(104.2, abs=0.21)
    assert violation.end_s == pytest.approx(115.8, abs=0.21)
    assert not verdict.report.passed
    assert "obstacle" in verdict.report.reasons[0]
    # High enough it is none, and neither 10 m aside.
    for path in ([[134.0, 0.0, 65.0], [134.0, 200.0, 65.0]], [[130.0, 0.0, 50.0], [130.0, 200.0, 50.0]]):
        assert verdict_on(make_site(obstacles=WALL), np.array(path)).report.violations == ()


def test_on_the_ways_there_and_home_obstacles_are_judged_too() -> None:
    site = make_site(obstacles=WALL)
    # The same pass beside the wall, on the way to the first waypoint, on the way home, and between two samples.
    beside = np.array([[134.0, 0.0, 50.0], [134.0, 200.0, 50.0]])
    across = np.array([[138.0, 100.0, 50.0], [153.0, 100.0, 50.0]])
    for path, number, rate_hz in ((beside, 0, 5.0), (beside, -1, 5.0), (across, 0, 0.6)):
        track = fly_along(site, path, rate_hz=rate_hz)
        track = changed(track, current_waypoint=np.full(len(track), number, dtype=np.int64))
        planned = PlannedRoute(np.array([[0.0, 150.0, 80.0], [300.0, 150.0, 80.0]]), 0.5)
        if number < 0:
            # Behind the last waypoint: the route was flown before.
            route = fly_along(site, np.array([[0.0, 150.0, 80.0], [300.0, 150.0, 80.0]]))
            track = joined_tracks(site, route, track)
        found = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, planned).violations
        assert [(v.kind, v.phase) for v in found if v.kind == "obstacle"] == [("obstacle", "transit")]


def test_between_two_samples_nothing_is_overlooked() -> None:
    thin = Obstacles(prisms=(tower(149.9, 0, 150.1, 200, 60),), clearance_beside_m=0.5, clearance_above_m=5.0)
    # Samples every 2 m, at 149 m and 151 m: both clear.
    verdict = verdict_on(make_site(obstacles=thin), np.array([[1.0, 100.0, 50.0], [301.0, 100.0, 50.0]]))
    (violation,) = verdict.report.violations
    assert violation.kind == "obstacle"
    assert violation.excess == pytest.approx(15.0)
    assert violation.east_m == pytest.approx(149.4, abs=1e-6)


def test_beside_an_obstacle_errors_of_position_make_a_cell_less_sure() -> None:
    site = make_site(sensor=WIDE, obstacles=WALL, cell_m=5.0)
    unsure = with_scenario(site, uncertainty=Uncertainty(position_m=3.0))
    path = np.array([[115.0, -100.0, 80.0], [115.0, 300.0, 80.0]])
    exact, blurred = verdict_on(site, path, cell_m=5.0), verdict_on(unsure, path, cell_m=5.0)
    assert exact.flown.observed.tolist() == blurred.flown.observed.tolist()
    # At the foot of the wall, and where the ray passes its end: seen, not surely. Behind it: not seen, but possibly.
    foot, behind = at(exact, 137.5, 100.0), at(exact, 165.0, 105.0)
    assert exact.flown.certain_cells[foot]
    assert not blurred.flown.certain_cells[foot]
    assert blurred.flown.certain_cells[at(exact, 102.5, 100.0)]
    assert blurred.flown.possible_cells[behind]
    assert not exact.flown.possible_cells[behind]


def test_a_stabilised_camera_sees_the_same_roof_and_shadow() -> None:
    site = make_site(sensor=dataclasses.replace(WIDE, mount="stabilised"), obstacles=WALL)
    path = np.array([[115.0, -100.0, 80.0], [115.0, 300.0, 80.0]])
    assert reasons_at(verdict_on(site, path), 165.0, 105.0) == ("occluded", True)
