"""Turns that wait for the next picture by distance."""

from pathlib import Path

import numpy as np
import pytest

from tests.terrain_kinds import write_scenario
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner.search.improve import with_turns_further_out
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.flown_line import positions_passed_m
from uavcover.sensing.site_maps import judging_map

UP_M = 80.0
THERE_AND_BACK = np.array([[100.0, 100.0, UP_M], [300.0, 100.0, UP_M], [300.0, 250.0, UP_M], [100.0, 250.0, UP_M]])
"""With a picture every 40 m, made below to turn before one is due."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return load_site(str(write_scenario(tmp_path_factory.mktemp("flat"), "flat", "sparse")))


def turning_at(east_m: float) -> Route:
    points = THERE_AND_BACK.copy()
    points[1:3, 0] = east_m
    return Route(points)


def waiting(site: Site, route: Route, *, goal: float = 1.0, penalty: float = 10.0, late: bool = False) -> Route:
    return with_turns_further_out(
        [judging_map(site)],
        route,
        goal,
        cost=lambda other: other.length_m,
        penalty=penalty,
        reach_m=500.0,
        is_over=lambda: late,
    )


def observed(site: Site, route: Route) -> float:
    judging = judging_map(site)
    return judging.fraction_of_coverable(judging.observed(route.waypoints_m))


@pytest.mark.parametrize("east_m", [285.0, 295.0])
def test_a_turn_waits_for_a_picture_that_shows_more_than_its_way_costs(site: Site, east_m: float) -> None:
    route = turning_at(east_m)
    found = waiting(site, route)
    gained, longer = observed(site, found) - observed(site, route), found.length_m / route.length_m - 1.0
    assert gained > 0.005
    assert gained * 10.0 > longer
    moved = found.waypoints_m - route.waypoints_m
    assert 0.0 < np.abs(moved[:, :2]).max() < 0.75 * 40.0 + 8.0
    heights = (site.ground.heights_agl_m(each.waypoints_m) for each in (route, found))
    np.testing.assert_allclose(*heights, atol=1e-6)
    margin_m = site.scenario.limits.height_margin_m
    before, after = (measure_violations(site, each.waypoints_m, margin_m=margin_m).total for each in (route, found))
    assert after <= before


def test_nothing_waits_where_it_is_not_worth_it_not_needed_or_too_late(site: Site) -> None:
    route = turning_at(285.0)
    assert waiting(site, route, penalty=0.0) is route
    assert waiting(site, route, goal=0.5 * observed(site, route)) is route
    assert waiting(site, route, late=True) is route


def test_what_shows_beyond_the_goal_is_worth_nothing(site: Site) -> None:
    route = turning_at(285.0)
    goal = observed(site, route) + 1e-5
    assert waiting(site, route, goal=goal) is route


def test_a_line_that_goes_straight_on_does_not_wait(site: Site) -> None:
    points = np.insert(THERE_AND_BACK, 1, [[225.0, 100.0, UP_M]], axis=0)
    found = waiting(site, Route(points))
    np.testing.assert_array_equal(found.waypoints_m[:2], points[:2])


def test_a_corner_that_is_passed_on_the_inside_lies_further_out_where_that_shows_more(tmp_path: Path) -> None:
    """The first waypoint is reached at an acute angle, and passed at a distance of metres."""
    site = load_site(str(write_scenario(tmp_path, "flat", "nadir")))
    route = Route(THERE_AND_BACK)
    assert waiting(site, route, penalty=0.0) is route
    found = waiting(site, route, penalty=1e3)
    passed_m = np.linalg.norm(route.waypoints_m - positions_passed_m(site, route.waypoints_m), axis=1)
    moved_m = np.linalg.norm((found.waypoints_m - route.waypoints_m)[:, :2], axis=1)
    assert moved_m.max() > 1.0
    assert (moved_m[passed_m < 0.9] == 0.0).all()
    assert observed(site, found) > observed(site, route)


def test_a_corner_far_from_all_missing_ground_stays(site: Site) -> None:
    route = turning_at(285.0)
    found = with_turns_further_out(
        [judging_map(site)],
        route,
        1.0,
        cost=lambda other: other.length_m,
        penalty=1e6,
        reach_m=0.0,
        is_over=lambda: False,
    )
    assert found is route
