"""Viewpoints that are put into a route until it sees enough, for a sensor that looks from waypoints."""

import math

import numpy as np
import pytest

from tests.planner.sites import Ups, flat, hills, make_site
from uavcover.missions.leg_checks import climb_angles_deg, measure_violations
from uavcover.model.route import Route
from uavcover.model.sensor import SphereSensor
from uavcover.planner.search.repair import _detours_m, with_gaps_closed, with_viewpoints
from uavcover.planner.search.tuning import TUNED
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map

SPHERE = SphereSensor(kind="sphere", range_m=110.0, sensing="at-waypoints")


def some_route(site: Site) -> Route:
    """Along the south of the area."""
    east = np.linspace(40.0, 260.0, 4)
    positions = np.column_stack([east, np.full(4, 40.0)])
    return Route(np.column_stack([positions, site.ground.ups_m(positions, 70.0)]))


@pytest.mark.parametrize("ups", [flat, hills], ids=["flat", "hills"])
@pytest.mark.parametrize("vehicle", ["ardupilot", "px4"])
def test_the_rest_is_seen_from_viewpoints_in_the_route(ups: Ups, vehicle: str) -> None:
    site = make_site(ups, sensor=SPHERE, vehicle={"autopilot": vehicle}, limits={"height_margin_m": 3.0})
    fine, route = judging_map(site), some_route(site)
    before = fine.fraction_of_coverable(fine.observed(route.waypoints_m))
    assert before < 0.9
    for goal in (before + 0.01, 0.95):
        closed = with_viewpoints(fine, route, goal, lambda: False)
        assert closed is not None
        assert fine.fraction_of_coverable(fine.observed(closed.waypoints_m)) >= goal
        assert measure_violations(site, closed.waypoints_m, margin_m=3.0).total == 0.0
        kept = [point for point in closed.waypoints_m if (route.waypoints_m == point).all(axis=1).any()]
        np.testing.assert_array_equal(kept, route.waypoints_m)
    assert len(with_viewpoints(fine, route, before + 0.01, lambda: False) or []) == 5
    assert with_viewpoints(fine, route, before, lambda: False) is None
    assert with_viewpoints(fine, route, 1.5, lambda: False) is None
    assert with_viewpoints(fine, route, 0.95, lambda: True) is None


def test_gaps_are_closed_so_first_where_a_sensor_looks_from_waypoints() -> None:
    site = make_site(hills, sensor=SPHERE)
    fine, route = judging_map(site), some_route(site)
    closed = with_gaps_closed(fine, route, 0.95, TUNED.goal.closed, lambda: False, most_trials=1000)
    inserted = with_viewpoints(fine, route, 0.95, lambda: False)
    assert closed is not None
    assert inserted is not None
    np.testing.assert_array_equal(closed.waypoints_m, inserted.waypoints_m)


def test_detours_are_those_of_the_longer_ways() -> None:
    rng = np.random.default_rng(3)
    for home in ((-100.0, 50.0), None):
        site = make_site(home=home)
        points, positions = (
            rng.uniform(0.0, (300.0, 300.0, 90.0), (5, 3)),
            rng.uniform(0.0, (300.0, 300.0, 90.0), (7, 3)),
        )
        found = _detours_m(site, points, positions)
        ends = [] if site.home_m is None else [site.home_m]

        def length_m(route: np.ndarray, ends: list[np.ndarray] = ends) -> float:
            return float(np.linalg.norm(np.diff(np.array([*ends, *route, *ends]), axis=0), axis=1).sum())

        for k, position in enumerate(positions):
            for at in range(6):
                longer = length_m(np.insert(points, at, position, axis=0)) - length_m(points)
                beside = points[max(at - 1, 0) : at + 1]
                steep = any(abs(climb_angles_deg(np.array([position, point]))[0]) > 30.0 for point in beside)
                assert found[k, at] == (math.inf if steep else pytest.approx(longer, abs=1e-9))
