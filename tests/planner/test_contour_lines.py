"""Contour-aligned lines: the field they are drawn from, how little they climb, and that there are always some."""

import numpy as np
import pytest

from tests.planner.sites import flat, hills, make_site
from uavcover.errors import ScenarioError
from uavcover.model.scenario import PlannerSettings
from uavcover.model.sensor import SphereSensor
from uavcover.planner.baselines.boustrophedon import boustrophedons, fly_layout, plain_boustrophedon
from uavcover.planner.baselines.contour_lines import (
    NAME,
    TUNED,
    contour_lines,
    fly_contours,
    layouts_to_try,
    nearest_potential,
    plain_layout,
)
from uavcover.planner.baselines.initial_routes import constructed_routes, initial_names
from uavcover.planner.planner import Effort, plan_routes
from uavcover.sensing.site_maps import planning_map

SQUARE = ((0.0, 0.0), (600.0, 0.0), (600.0, 600.0), (0.0, 600.0))


def bowl(east, north):
    """A quarter of a valley's head: contours are arcs around the south-west corner."""
    return 0.4 * np.hypot(east + 150.0, north + 150.0)


def climbed_m(points_m):
    return float(np.abs(np.diff(points_m[:, 2])).sum())


def slow_potential(across_e, across_n, step_m):
    """Unknown by unknown: a row for each pair of neighbours, solved as dense least squares."""
    rows, columns = across_e.shape
    equations, wanted = [], []
    for r in range(rows):
        for c in range(columns):
            for r2, c2, field in ((r, c + 1, across_e), (r + 1, c, across_n)):
                if r2 < rows and c2 < columns:
                    equation = np.zeros(rows * columns)
                    equation[r2 * columns + c2], equation[r * columns + c] = 1.0, -1.0
                    equations.append(equation)
                    wanted.append(step_m * 0.5 * (field[r, c] + field[r2, c2]))
    found = np.linalg.lstsq(np.array(equations), np.array(wanted), rcond=None)[0]
    return (found - found.mean()).reshape(rows, columns)


@pytest.mark.parametrize("shape", [(5, 7), (2, 3), (6, 2)])
def test_the_potential_is_that_of_dense_least_squares(shape):
    rng = np.random.default_rng(4)
    across_e, across_n = rng.normal(size=(2, *shape))
    kept = across_e.copy()
    found = nearest_potential(across_e, across_n, 3.0)
    np.testing.assert_allclose(found, slow_potential(across_e, across_n, 3.0), atol=1e-9)
    np.testing.assert_array_equal(across_e, kept)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 100.0])
def test_lines_over_a_slope_run_level(turn_deg):
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    site = make_site(lambda east, north: 0.4 * (c * east + s * north), ring=SQUARE)
    points = fly_contours(site, plain_layout(site)).waypoints_m
    legs = np.diff(points, axis=0)
    away = np.abs(legs[:, :2] @ [c, s])  # up the slope
    level = away < 0.02 * np.hypot(*legs[:, :2].T)
    assert np.hypot(*legs[level, :2].T).sum() > 0.7 * np.hypot(*legs[:, :2].T).sum()
    assert np.abs(legs[level, 2]).max() < 2.0
    # Up or down the slope once, from the first line to the last.
    assert climbed_m(points) < 1.1 * np.ptp(points[:, 2]) + 20.0


def test_lines_follow_contours_that_bend():
    site = make_site(bowl, ring=SQUARE)
    bent = min((fly_contours(site, layout) for batch in layouts_to_try(site) for layout in batch[:1]),
               key=lambda route: climbed_m(route.waypoints_m))  # fmt: skip
    straight = [
        fly_layout(site, plain_boustrophedon(site, angle_rad=angle))
        for angle in np.linspace(0.0, np.pi, 12, endpoint=False)
    ]
    assert climbed_m(bent.waypoints_m) < 0.6 * min(climbed_m(route.waypoints_m) for route in straight)


def test_over_flat_ground_they_are_straight_lines_along_the_long_side():
    site = make_site(flat, ring=((0.0, 0.0), (600.0, 0.0), (600.0, 300.0), (0.0, 300.0)))
    points = fly_contours(site, plain_layout(site)).waypoints_m
    plain = fly_layout(site, plain_boustrophedon(site)).waypoints_m
    assert len(points) == len(plain)
    assert sorted(points[:, 1].round(1).tolist()) == pytest.approx(sorted(plain[:, 1].round(1).tolist()), abs=2.0)


CORNERS = {
    "a metre": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
    "a thin strip": ((0.0, 0.0), (400.0, 0.0), (400.0, 12.0), (0.0, 12.0)),
    "an L": ((0.0, 0.0), (300.0, 0.0), (300.0, 80.0), (80.0, 80.0), (80.0, 300.0), (0.0, 300.0)),
}


@pytest.mark.parametrize("ring", CORNERS.values(), ids=CORNERS.keys())
def test_there_are_lines_in_every_area(ring):
    site = make_site(hills, ring=ring, cell_m=1.0 if ring[1][0] < 5.0 else 10.0)
    for batch in layouts_to_try(site):
        for layout in batch[-2:]:
            points = fly_contours(site, layout).waypoints_m
            assert len(points) >= 2
            assert np.isfinite(points).all()


def test_holes_parts_and_ground_without_data():
    def patchy(east, north):
        return np.where(np.hypot(east - 150.0, north - 100.0) < 60.0, np.nan, hills(east, north))

    far = ((500.0, 0.0), (600.0, 0.0), (600.0, 150.0), (500.0, 150.0))
    hole = ((100.0, 50.0), (160.0, 50.0), (160.0, 120.0), (100.0, 120.0))
    for site in (
        make_site(patchy),
        make_site(hills, holes=(hole,), more_parts=(far,)),
        make_site(lambda east, north: (east + north) * np.nan),
    ):
        points = fly_contours(site, plain_layout(site)).waypoints_m
        assert len(points) >= 2
        assert np.isfinite(points).all()


@pytest.mark.parametrize("applies_to", ["legs", "waypoints"])
def test_a_sensor_that_looks_from_the_waypoints_has_them_along_the_lines(applies_to):
    sensor = SphereSensor(kind="sphere", range_m=90.0, sensing="at-waypoints")
    site = make_site(hills, sensor=sensor, limits={"applies_to": applies_to})
    found = contour_lines(planning_map(site), should_stop=lambda: True)
    assert [each.name for each in found] == [NAME]
    assert found[0].violation == 0.0
    assert -found[0].objectives[0] > 0.9


def test_they_are_baselines_by_request_and_a_start_of_the_search():
    site = make_site(bowl, ring=SQUARE, cell_m=20.0, planner={"initial": ("contour-lines",)})
    coverage = planning_map(site)
    batches = iter([False, False, True])
    found = constructed_routes(
        coverage, site.scenario.planner, required=0.95, executor=None,
        left_s=lambda: 0.0 if next(batches, True) else 1.0,
    )  # fmt: skip
    assert [each.name for each in found][:1] == ["boustrophedon"]
    assert {each.name for each in found} >= {"boustrophedon-tuned", NAME}
    assert NAME not in {each.name for each in boustrophedons(coverage, should_stop=lambda: True)}


def test_where_energy_is_minimised_a_local_search_begins_with_them():
    frugal = {"algorithm": "memetic", "objective": "energy"}
    sites = [
        make_site(planner=planner) for planner in ({"algorithm": "memetic"}, frugal, {**frugal, "algorithm": "imodbo"})
    ]
    names = [initial_names(planning_map(site), site.scenario.planner) for site in sites]
    assert [NAME in each for each in names] == [False, True, False]


def test_the_best_of_their_scan_is_a_plan():
    site = make_site(bowl, ring=SQUARE, cell_m=20.0, planner={"algorithm": "contour-lines"})
    plan = plan_routes(
        site, settings=site.scenario.planner, select_rule="coverage>=0.95", effort=Effort(100, None, lambda: 0.0)
    )
    assert (plan.algorithm, plan.chosen.origin, plan.rule_met) == ("contour-lines", NAME, True)
    assert plan.chosen.violation == 0.0
    with pytest.raises((ScenarioError, ValueError), match='omit it with algorithm = "contour-lines"'):
        PlannerSettings(algorithm="contour-lines", encoding="waypoints")
    assert TUNED not in {member.origin for member in plan.members}
