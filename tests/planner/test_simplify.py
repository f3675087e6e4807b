"""Routes lose the waypoints that they can do without, and nothing else."""

import dataclasses
import itertools

import numpy as np
import pytest

from tests.planner.sites import EXACT, Ups, flat, hills, make_site, ridge
from tests.planner.test_memetic import SPHERE, make_plan
from uavcover.errors import ScenarioError
from uavcover.kernels.path_cost import LENGTH, route_cost
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import judge_member
from uavcover.missions.path_cost import path_cost_of, waypoint_price_of
from uavcover.model.route import Route
from uavcover.model.sensor import FrameCamera, SphereSensor
from uavcover.planner.final_changes import simplified
from uavcover.planner.search.route_problem import SAFETY, route_problem, state_of
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_maps, planning_map

LIMITS = {"height_margin_m": 5.0}
PHOTOS = FrameCamera(
    kind="frame-camera", fov_across_deg=70.0, fov_along_deg=55.0, range_m=200.0, forward_overlap=0.6, side_overlap=0.3
)


def lines(site: Site, *, tolerance_m: float = 0.05, every_m: float | None = None) -> Route:
    """Three lines at 80 m, with a waypoint wherever the ground leaves a chord by the tolerance; or every so many metres."""
    corners = np.array([[10.0, 30.0], [290.0, 30.0], [290.0, 100.0], [10.0, 100.0], [10.0, 170.0], [290.0, 170.0]])
    if every_m is not None:
        legs = itertools.pairwise(corners)
        steps = [np.linspace(a, b, int(np.hypot(*(b - a)) / every_m) + 1)[:-1] for a, b in legs]
        corners = np.vstack([*steps, corners[-1:]])
    return Route(lay_over_terrain(site, corners, np.full(len(corners), 80.0), tolerance_m=tolerance_m))


def test_a_line_over_flat_ground_keeps_its_ends_alone() -> None:
    site = make_site(flat, limits=LIMITS, home=None)
    route = lines(site, every_m=5.0)
    assert len(route) > 150
    simpler = simplified(judging_maps(site), route, required=None)
    assert simpler is not None
    assert len(simpler) <= 6
    assert simpler.length_m <= route.length_m


def test_where_there_is_no_time_one_sweep_is_made() -> None:
    """Of a route that keeps coverage beyond what is asked for, which takes many sweeps to give up."""
    site = make_site(hills, limits=LIMITS)
    route, maps, required = lines(site, every_m=5.0), judging_maps(site), []

    def is_over() -> bool:
        required.append(True)
        return True

    hurried = simplified(maps, route, required=0.5, is_over=is_over)
    patient = simplified(maps, route, required=0.5)
    assert len(required) == 1
    assert hurried is not None
    assert patient is not None
    assert len(patient) < len(hurried) < len(route)


@pytest.mark.parametrize("ups", [hills, ridge(150.0, 60.0)], ids=["hills", "ridge"])
@pytest.mark.parametrize("sensor", [None, PHOTOS, dataclasses.replace(SPHERE, sensing="at-waypoints")])
@pytest.mark.parametrize("required", [None, 0.5, 0.9, 1.0])
def test_coverage_limits_and_cost_are_kept(ups: Ups, sensor: object, required: float | None) -> None:
    # Without a home waypoints are passed exactly, where a sensor looks from them.
    home = None if isinstance(sensor, SphereSensor) else (-100.0, 50.0)
    site = make_site(ups, limits=LIMITS, vehicle=EXACT, home=home, **({} if sensor is None else {"sensor": sensor}))
    route, maps = lines(site, every_m=20.0), judging_maps(site)
    before = judge_member(maps[0], route, "before", margin_m=5.0)
    assert before.violation == 0.0
    simpler = simplified(maps, route, required=required)
    assert simpler is not None, "on any ground a waypoint every 20 m is more than enough"
    after = judge_member(maps[0], simpler, "after", margin_m=5.0)
    assert after.violation == 0.0
    assert after.metrics.cost < before.metrics.cost
    assert after.metrics.waypoint_count < before.metrics.waypoint_count
    had, has = before.metrics.coverage_of_coverable, after.metrics.coverage_of_coverable
    assert has >= (had if required is None or had < required else min(had, required + SAFETY)) - 1e-9
    for finer in maps[1:]:
        old, new = (finer.fraction_of_coverable(finer.observed(each.waypoints_m)) for each in (route, simpler))
        assert new >= min(old - SAFETY, 1.0 if required is None else required) - 1e-9
    again = simplified(maps, simpler, required=required)
    assert again is None or len(again) > 0.8 * len(simpler), "little is left to take out"


def test_a_waypoint_that_clears_a_ridge_stays() -> None:
    site = make_site(ridge(150.0, 60.0), limits=LIMITS)
    simpler = simplified(judging_maps(site), lines(site), required=0.97)
    assert simpler is not None
    assert measure_violations(site, simpler.waypoints_m, margin_m=5.0).total == 0.0
    higher = simpler.waypoints_m[simpler.waypoints_m[:, 2] > 95.0]
    assert len(higher) >= 3, "one for each time that the route crosses the ridge"
    assert np.abs(higher[:, 0] - 150.0).max() < 60.0


def test_a_long_leg_has_room_and_needs_no_waypoint_between() -> None:
    """A camera of small reach over a large area: every leg of every route was halved until the longest one had room."""
    ring = ((0.0, 0.0), (900.0, 0.0), (900.0, 900.0), (0.0, 900.0))
    site = make_site(flat, ring=ring, sensor=dataclasses.replace(make_site().scenario.sensor, fov_deg=20.0))
    problem = route_problem(planning_map(site), margin_m=0.0, reach_m=14.0)
    route = Route([[20.0, 0.0, 80.0], [20.0, 900.0, 80.0], [60.0, 900.0, 80.0], [600.0, 0.0, 80.0]])
    assert state_of(problem, route, capacity=10).size[0] == 4
    cut = state_of(dataclasses.replace(problem, stride=40), route, capacity=10)
    kept = cut.route[: cut.size[0]].tolist()
    assert len(kept) > 4
    assert kept.index([60.0, 900.0, 80.0]) == kept.index([20.0, 900.0, 80.0]) + 1, "a short leg stays whole"


def test_the_price_is_part_of_the_cost_and_buys_fewer_waypoints() -> None:
    counts = []
    for price in (0.0, 2.0, 20.0):
        site = make_site(hills, limits=LIMITS, planner={"waypoint_price": price})
        metrics = make_plan(site, evaluations=200).chosen.metrics
        assert metrics.mission_time_s is not None
        assert metrics.cost == pytest.approx(metrics.mission_time_s + price * metrics.waypoint_count, rel=1e-9)
        counts.append(metrics.waypoint_count)
    assert counts[0] >= counts[1] >= counts[2]
    assert counts[2] < counts[0]


def test_the_price_by_default_is_a_share_of_what_the_sensor_sees() -> None:
    radius_m = 80.0 * np.tan(np.radians(35.0))
    timed, lengths = make_site(), make_site(planner={"objective": "length"})
    assert waypoint_price_of(lengths) == pytest.approx(0.01 * radius_m)
    assert waypoint_price_of(timed) == pytest.approx(0.01 * radius_m / 10.0), "seconds at cruise speed"
    assert waypoint_price_of(timed.minimising(waypoint_price=0.0)) == 0.0
    assert waypoint_price_of(load_site("paper-R2")) == 0.0, "every waypoint is a picture"
    path_cost = path_cost_of(lengths.minimising(waypoint_price=3.0))
    route = np.array([[0.0, 0.0, 80.0], [100.0, 0.0, 80.0], [100.0, 50.0, 80.0]])
    assert path_cost.unit == LENGTH
    assert route_cost(lengths.ground.surface, path_cost, route) == pytest.approx(150.0 + 9.0)
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ScenarioError, match="waypoint_price"):
            timed.minimising(waypoint_price=wrong)


@pytest.mark.parametrize("most", [6, 10, 14])
def test_no_route_has_more_waypoints_than_it_may(most: int) -> None:
    site = make_site(hills, limits=LIMITS, planner={"max_waypoints": most})
    plan = make_plan(site, rule="coverage>=0.8", evaluations=150)
    assert plan.rule_met
    assert max(member.metrics.waypoint_count for member in plan.members) <= most


def test_where_no_route_is_short_enough_the_rule_is_not_met() -> None:
    site = make_site(ridge(150.0, 60.0), limits=LIMITS, planner={"max_waypoints": 2})
    plan = make_plan(site, rule="coverage>=0.95", evaluations=60)
    assert not plan.rule_met
