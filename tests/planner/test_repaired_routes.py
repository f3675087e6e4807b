"""Routes that keep the limits, made of the stretches of routes that break them: on ground too steep for straight lines."""

import dataclasses
import time

import numpy as np
import pytest

from tests.planner.sites import flat, make_site
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner import terrain_following
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.search.repair import with_gaps_closed
from uavcover.planner.search.route_problem import fraction_observed, route_problem
from uavcover.planner.terrain_following import repaired_routes
from uavcover.sensing.site_maps import planning_map

LIMITS = {"max_height_agl_m": 60.0, "max_climb_angle_deg": 15.0}


def slope(east, north):
    """Twice as steep as a leg may climb."""
    return 0.55 * (0.6 * east + 0.8 * north)


def rough(east, north):
    return 40.0 * np.sin(east / 55.0) * np.cos(north / 50.0) + 0.1 * east


def repaired(site, *routes_m):
    problem = route_problem(planning_map(site), margin_m=0.0, reach_m=0.0).numbers
    return [route.waypoints_m for route in repaired_routes(site, problem, [Route(each) for each in routes_m])]


def violations(site, points_m):
    return measure_violations(site, points_m, margin_m=site.scenario.limits.height_margin_m).total


def over(site, *positions, height_agl_m=50.0):
    positions_m = np.array(positions, dtype=float)
    return np.column_stack([positions_m, site.ground.ups_m(positions_m, height_agl_m)])


def along_contour(east_m, north_m):
    """Two places 60 m apart at one height."""
    return (east_m - 24.0, north_m + 18.0), (east_m + 24.0, north_m - 18.0)


def test_stretches_are_joined_by_zigzags():
    site = make_site(slope, limits=LIMITS)
    low, high = along_contour(60.0, 60.0), along_contour(200.0, 160.0)
    route_m = over(site, *low, *high)
    assert violations(site, route_m) > 0.0
    (found,) = repaired(site, route_m)
    assert violations(site, found) == 0.0
    for position in route_m:
        assert (found == position).all(axis=1).any()
    level_m, climbed_m = np.hypot(*(route_m[2] - route_m[1])[:2]), route_m[2, 2] - route_m[1, 2]
    # No way that climbs so much is shorter than this, and a lattice has few directions.
    least_m = climbed_m / np.tan(np.radians(15.0))
    between = found[1:-1]
    path_m = np.hypot(*np.diff(between, axis=0)[:, :2].T).sum()
    assert max(level_m, least_m) <= path_m < 1.4 * least_m


def test_a_route_that_keeps_the_limits_stays():
    site = make_site(slope, limits=LIMITS)
    route_m = over(site, *along_contour(100.0, 80.0))
    (found,) = repaired(site, route_m)
    np.testing.assert_array_equal(found, route_m)
    assert repaired(site, over(site, (0.0, 0.0), (60.0, 80.0))) == []


def test_only_what_can_be_joined_is_kept():
    """A cliff of 100 m parts two stretches; the longer one stays."""
    site = make_site(lambda east, north: np.where(east < 150.0, 0.0, 100.0) + 0.0 * north, limits=LIMITS)
    left, right = over(site, (10.0, 50.0), (120.0, 50.0)), over(site, (200.0, 50.0), (280.0, 50.0))
    (found,) = repaired(site, np.vstack([left, right]))
    np.testing.assert_array_equal(found, left)


@pytest.mark.parametrize("ups", [slope, rough], ids=["slope", "rough"])
def test_mended_lines_keep_the_limits_and_see_the_ground(ups):
    site = make_site(ups, limits=LIMITS)
    coverage = planning_map(site)
    lines = fly_layout(site, plain_boustrophedon(site))
    assert violations(site, lines.waypoints_m) > 0.0
    (found,) = repaired(site, lines.waypoints_m)
    assert violations(site, found) == 0.0
    assert fraction_observed(Route(found), coverage) > 0.5


@pytest.mark.parametrize("ups", [slope, rough], ids=["slope", "rough"])
def test_a_wide_fence_makes_no_detours(ups):
    fence = ((-5000.0, -5000.0), (5000.0, -5000.0), (5000.0, 5000.0), (-5000.0, 5000.0))
    near_m, wide_m = (
        Route(found).length_m
        for site in (make_site(ups, limits=LIMITS), make_site(ups, limits=LIMITS, fence=fence))
        for found in repaired(site, fly_layout(site, plain_boustrophedon(site)).waypoints_m)
    )
    assert wide_m < 1.1 * near_m


@pytest.mark.parametrize("seed", range(4))
def test_ways_that_lead_along_other_stretches_keep_the_limits(seed, monkeypatch):
    """Between steep waves, and on a wide lattice, some stretches are the only way to others."""
    monkeypatch.setattr(terrain_following, "_SPOTS", 120)
    rng = np.random.default_rng(seed)
    waves = rng.uniform(-1.0, 1.0, (12, 2)) / 40.0
    phases = rng.uniform(0.0, 2.0 * np.pi, 12)

    def waved(east, north):
        return sum(9.0 * np.sin(e * east + n * north + phase) for (e, n), phase in zip(waves, phases, strict=True))

    site = make_site(waved, limits={"max_height_agl_m": 54.0, "height_margin_m": 3.0, "max_climb_angle_deg": 8.0})
    for turn_rad in (0.0, 0.8, 1.6):
        route = fly_layout(site, dataclasses.replace(plain_boustrophedon(site), angle_rad=turn_rad))
        for found in repaired(site, route.waypoints_m):
            assert violations(site, found) == 0.0


def test_a_search_begins_with_them_where_no_line_keeps_the_limits():
    site = make_site(rough, limits=LIMITS, planner={"algorithm": "memetic", "seed": 1})
    plan = plan_routes(
        site, settings=dataclasses.replace(site.scenario.planner, evaluations=400), select_rule="coverage>=0.95",
        effort=Effort(400, None, time.monotonic),
    )  # fmt: skip
    assert all(baseline.violation > 0.0 for baseline in plan.baselines)
    assert violations(site, plan.chosen.route.waypoints_m) == 0.0
    assert plan.chosen.metrics.coverage_of_coverable >= 0.95


def test_flat_ground_needs_none():
    site = make_site(flat, limits=LIMITS)
    lines = fly_layout(site, plain_boustrophedon(site)).waypoints_m
    (found,) = repaired(site, lines)
    np.testing.assert_array_equal(found, lines)


def test_gaps_on_steep_ground_are_closed_over_the_lattice():
    """No straight legs to the gaps keep the limits."""
    site = make_site(rough, limits=LIMITS)
    coverage = planning_map(site)
    (found,) = repaired(site, fly_layout(site, plain_boustrophedon(site)).waypoints_m)
    short = Route(found[: len(found) // 3])
    goal = fraction_observed(short, coverage) + 0.2
    closed = with_gaps_closed(coverage, short, goal, (1.0, 1.5, 2.0), lambda: False, most_trials=20)
    assert closed is not None
    assert fraction_observed(closed, coverage) >= goal
    assert violations(site, closed.waypoints_m) == 0.0
