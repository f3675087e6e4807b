"""The memetic planner: limits kept, the set non-dominated, equal plans for equal seeds, and better than its parts."""

import dataclasses
import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.planner.sites import hills, make_site, with_scenario
from tests.planner.test_planner import Clock, frozen, same, values
from uavcover.kernels.sight import CONE, DISC, Sight
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Plan, Route
from uavcover.model.sensor import DiscSensor, SphereSensor
from uavcover.model.vehicle import Wind
from uavcover.planner.budget import FRACTIONS
from uavcover.planner.planner import Effort, SearchProgress, plan_routes
from uavcover.planner.search.goal_search import LADDER, _next_stage, _thinned
from uavcover.planner.search.local_search import (
    CHAINS,
    PaceByClock,
    PaceByNumber,
    SearchStart,
    best_starts,
    promising_starts,
)
from uavcover.planner.search.route_problem import OneAfterTheOther, narrowed, route_problem, state_of
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map

LIMITS = {"height_margin_m": 5.0}
SPHERE = SphereSensor(kind="sphere", range_m=110.0)
FREE = {"encoding": "waypoints", "max_waypoints": 12}


def make_plan(
    site: Site, *, algorithm: str = "memetic", rule: str = "coverage>=0.9", seed: int = 1, evaluations: int = 300,
    budget_s: float | None = None, now: Callable[[], float] = frozen, **options: Any,
) -> Plan:  # fmt: skip
    settings = dataclasses.replace(site.scenario.planner, seed=seed, algorithm=algorithm)
    return plan_routes(site, settings=settings, select_rule=rule, effort=Effort(evaluations, budget_s, now), **options)


SITES = {
    "along-path": make_site(hills, limits=LIMITS),
    "at-waypoints": make_site(hills, sensor=SPHERE, limits=LIMITS, planner=FREE),
    "free-order": make_site(hills, sensor=SPHERE, limits={**LIMITS, "applies_to": "waypoints"}, planner=FREE),
}


@functools.cache
def plan_of(name: str) -> Plan:
    """With the rule and the seed that most tests ask for: planned once."""
    return make_plan(SITES[name])


@pytest.mark.thinned
@pytest.mark.parametrize("name", SITES)
@pytest.mark.parametrize("rule", ["coverage>=0.9", "max-coverage"])
def test_every_member_keeps_the_limits_and_none_beats_another(name: str, rule: str) -> None:
    site, plan = SITES[name], plan_of(name) if rule == "coverage>=0.9" else make_plan(SITES[name], rule=rule)
    assert plan.rule_met
    assert plan.evaluations == 300
    assert "memetic" in {member.origin for member in plan.members}
    assert len(plan.members) > 3
    for a in plan.members:
        assert measure_violations(site, a.route.waypoints_m, margin_m=5.0).total == 0.0
        assert site is not SITES["free-order"] or a.metrics.waypoint_count <= 12
        assert not any(
            values(b) != values(a) and all(x <= y for x, y in zip(values(b), values(a), strict=True))
            for b in plan.members
        )


@pytest.mark.no_cover  # the lines of the plan before, several times
@pytest.mark.parametrize("name", SITES)
def test_equal_seed_and_evaluations_give_an_equal_plan_on_any_number_of_threads(name: str) -> None:
    site, alone = SITES[name], plan_of(name)
    for threads in (1, 2):
        with ThreadPoolExecutor(threads) as executor:
            assert same(alone, make_plan(site, executor=executor))
    assert not same(alone, make_plan(site, seed=2))


def test_adaptive_swaths_and_the_local_search_are_quicker_flown_than_what_the_optimizer_finds() -> None:
    site = SITES["along-path"]
    alone, improved = (make_plan(site, algorithm=name, evaluations=800) for name in ("imodbo", "memetic"))
    assert improved.chosen.metrics.cost < 0.97 * alone.chosen.metrics.cost
    assert improved.chosen.origin in {"memetic", "balanced-lines"}


def test_along_a_path_there_are_parts_and_routes_of_few_waypoints_to_choose_from() -> None:
    site = make_site(hills, ring=((0.0, 0.0), (500.0, 0.0), (500.0, 400.0), (0.0, 400.0)), limits=LIMITS)
    plan = make_plan(site, evaluations=600)
    parts = [member for member in plan.members if member.is_part]
    assert len(parts) > 4
    assert min(member.metrics.coverage_of_coverable for member in parts) < 0.45
    assert not plan.chosen.is_part
    enough = [m for m in plan.members if m.metrics.coverage_of_coverable >= 0.9]
    assert min(m.metrics.waypoint_count for m in enough) < plan.chosen.metrics.waypoint_count
    # In any order each number of waypoints is searched for itself.
    assert not any(member.is_part for member in plan_of("free-order").members)


def test_discs_on_a_row_are_placed_as_well_as_can_be() -> None:
    # Two rows of 20 cells with centres 10 m beside the middle line: a disc of 60 m reaches sqrt(60^2 - 10^2) = 59 m along
    # it, so it sees at most 2 x 6 centres, and 4 discs are needed for all.
    site = make_site(
        ring=((0.0, 0.0), (400.0, 0.0), (400.0, 40.0), (0.0, 40.0)), cell_m=20.0,
        sensor=DiscSensor(kind="disc", radius_m=60.0), limits={"applies_to": "waypoints"},
        planner={"encoding": "waypoints", "max_waypoints": 8, "cell_size_m": 20.0},
    )  # fmt: skip
    plan = make_plan(site, rule="max-coverage", evaluations=400)
    full = [member for member in plan.members if member.metrics.coverage_fraction == 1.0]
    assert min(member.metrics.waypoint_count for member in full) == 4
    for count, cells in ((1, 12), (2, 24), (3, 36)):
        most = max(m.metrics.coverage_fraction for m in plan.members if m.metrics.waypoint_count <= count)
        assert most == pytest.approx(cells / 40)


@pytest.mark.no_cover
def test_the_papers_scenario_with_sixteen_waypoints() -> None:
    site = load_site("paper-R2")
    settings = dataclasses.replace(site.scenario.planner, algorithm="local-search", max_waypoints=16)
    plan = plan_routes(site, settings=settings, select_rule="max-coverage", effort=Effort(1500, None, frozen))
    # IMODBO sees 86 % with 22 waypoints after 25,000 evaluations (docs/results/coverage.md); 16 can see everything.
    assert plan.chosen.metrics.coverage_of_coverable > 0.97
    assert plan.chosen.metrics.waypoint_count <= 16
    points = plan.chosen.route.waypoints_m
    assert (points[:, 2] >= np.sin(points[:, 1]) * np.cos(points[:, 0]) - 1e-6).all()
    assert (np.abs(points[:, 2]) <= 1.0 + 1e-6).all()


# Stopping


def test_the_cost_that_is_reported_never_rises() -> None:
    """The local search began with metres where the objective is time."""
    observed: list[SearchProgress] = []
    site = make_site(hills, limits=LIMITS, planner={"objective": "flight-time"})
    make_plan(site, rule="coverage>=0.99", on_progress=observed.append)
    costs = [p.least_cost for p in observed if p.least_cost is not None]
    assert len(costs) > 2
    assert costs == sorted(costs, reverse=True)


@pytest.mark.parametrize("site", [SITES["along-path"], SITES["free-order"]], ids=["along-path", "free-order"])
def test_stopped_in_the_local_search_the_best_so_far_is_returned(site: Site) -> None:
    observed: list[SearchProgress] = []
    plan = make_plan(site, should_stop=lambda: len(observed) >= 60, on_progress=observed.append)
    assert plan.interrupted
    assert 20 < plan.evaluations < 300
    assert "memetic" in {member.origin for member in plan.members}
    counts = [p.evaluations for p in observed]
    assert counts == sorted(counts)
    assert all(p.total == 300 for p in observed[-5:])
    assert observed[-1].best_coverage > 0.8


def test_the_time_budget_ends_the_local_search() -> None:
    tick_s, observed = 0.25, list[SearchProgress]()
    plan = make_plan(
        SITES["along-path"], evaluations=10**9, budget_s=30.0, now=Clock(tick_s), on_progress=observed.append
    )
    assert not plan.interrupted
    # Waypoints are given up until so much later; the clock is asked once to see that, and once for the plan.
    assert plan.wall_s <= 30.0 * FRACTIONS.simplified_until + 2.0 * tick_s
    assert "memetic" in {member.origin for member in plan.members}
    assert all(p.evaluations <= p.total < 10**9 for p in observed)


def test_a_budget_that_is_over_before_the_local_search_begins_leaves_lines_and_parts() -> None:
    plan = make_plan(SITES["along-path"], evaluations=10**9, budget_s=3.0, now=Clock(1.0))
    origins = {member.origin for member in plan.members}
    assert "memetic" not in origins
    assert any(member.is_part for member in plan.members)
    assert plan.rule_met


def test_a_pace_by_number_gives_exactly_what_there_is() -> None:
    pace, given = PaceByNumber(2_345_678), 0
    while batch := pace.next_batch():
        given += CHAINS * batch
        pace.done(CHAINS * batch)
        assert pace.fraction == pytest.approx(given / 2_345_678)
    assert given == 2_345_678
    assert PaceByNumber(0).fraction == 1.0


def test_a_pace_by_the_clock_adapts_its_batches() -> None:
    clock = [0.0]
    pace = PaceByClock(lambda: clock[0], 10.0, batch_s=0.1)
    first = pace.next_batch()
    clock[0] = 0.001
    pace.done(CHAINS * first)
    clock[0] = 2.0  # what is done between two batches counts as time, not as a batch
    larger = pace.next_batch()
    assert larger == 4 * first, "1 ms was far below 0.1 s, but not all at once"
    clock[0] = 5.0
    assert pace.fraction == pytest.approx(0.5)
    pace.done(CHAINS * larger)
    assert pace.next_batch() == int(0.1 / (3.0 / larger))
    clock[0] = 10.5
    pace.done(CHAINS * 3)
    assert (pace.fraction, pace.next_batch()) == (1.0, 0)


def test_stages_and_goals_are_fewer_where_judging_takes_long() -> None:
    stages = (0.35, 0.55, 0.7, 0.8, 0.88, 0.94, 0.97, 1.0)

    def all_of(least: float) -> list[tuple[float, int]]:
        kept = [_next_stage(stages, 0.0, least)]
        while kept[-1][0] < 1.0:
            kept.append(_next_stage(stages, kept[-1][0], least))
        return kept

    assert all_of(0.0) == [(stage, 1) for stage in stages], "counted by proposals: as they are"
    for least in (0.01, 0.1, 0.2, 0.5, 3.0):
        kept = all_of(least)
        lengths = np.diff([0.0, *(stage for stage, _ in kept)])
        assert len(kept) == 1 or lengths.min() >= least - 1e-12
        assert kept[-1][0] == 1.0
        assert sum(steps for _, steps in kept) == len(stages), "prices rise as with all of them"
    assert _thinned(LADDER, 99) == LADDER
    assert _thinned(LADDER, 7) == LADDER
    assert _thinned(LADDER, 3) == [0.8, 0.98, 1.0]
    assert _thinned(LADDER, 0) == [0.8]


# What the kernels are given


def test_a_narrowed_sensor_sees_that_much_less_far() -> None:
    assert narrowed(Sight(CONE, 200.0, 0.7, 0.2, 1), margin_m=7.0, reach_m=70.0) == Sight(
        CONE, 200.0, 0.7 * 0.9, 0.2, 1
    )
    assert narrowed(Sight(DISC, 50.0, 0.0, -1.0, 0), margin_m=5.0, reach_m=50.0).reach_m == 45.0


def test_only_coverable_cells_count_and_a_route_state_sees_what_the_map_says() -> None:
    site = SITES["along-path"]
    coverage = CoverageMap(site, cell_size_m=20.0)
    problem = route_problem(coverage, margin_m=0.0, reach_m=70.0)
    assert problem.numbers.weight.sum() == pytest.approx(1.0)
    assert (problem.numbers.weight > 0.0).tolist() == coverage.coverable.tolist()
    corners = np.array([[0.0, 60.0], [300.0, 60.0], [300.0, 140.0]])
    route = Route(np.column_stack([corners, site.ground.heights_m(corners) + 80.0]))
    state = state_of(problem, route, capacity=10)
    assert state.observed[0] == pytest.approx(
        coverage.fraction_of_coverable(coverage.observed(route.waypoints_m)), rel=1e-12
    )
    assert ((state.counts > 0) == coverage.observed(route.waypoints_m)).all()
    # A leg that sees more runs than there is room for is cut; what is seen changes only by where the samples fall.
    short = state_of(dataclasses.replace(problem, stride=18), route, capacity=10)
    assert short.size[0] > 3
    assert short.observed[0] == pytest.approx(state.observed[0], abs=0.02)


def test_flight_time_as_the_objective_flies_faster_in_a_strong_wind() -> None:
    vehicle = {"cruise_speed_m_s": 10.0, "max_airspeed_m_s": 12.0, "acceleration_m_s2": 1.0}
    plans = {}
    for objective in ("length", "flight-time"):
        site = make_site(
            hills, cell_m=20.0, vehicle=vehicle,
            planner={"objective": objective, "waypoint_price": 0.0},
        )  # fmt: skip
        site = with_scenario(site, wind=Wind(speed_m_s=9.0, from_deg=270.0))
        plans[objective] = make_plan(site, seed=4, evaluations=1500).chosen.metrics
    assert plans["length"].cost == pytest.approx(plans["length"].path_length_m, rel=1e-12)
    assert plans["flight-time"].cost == pytest.approx(plans["flight-time"].flight_time_s, rel=1e-12)
    assert plans["flight-time"].flight_time_s < plans["length"].flight_time_s


def test_fewer_waypoints_than_see_all_still_see_most_also_in_little_time() -> None:
    site = load_site("paper-planar")
    settings = dataclasses.replace(site.scenario.planner, algorithm="local-search", evaluations=200)
    plan = plan_routes(site, settings=settings, select_rule="max-coverage", effort=Effort(200, None, frozen))
    most = {m.metrics.waypoint_count: m.metrics.coverage_of_coverable for m in plan.members}
    full = min(n for n, observed in most.items() if observed >= 1.0 - 1e-9)
    # Without the waypoint that sees least by itself, a route loses no more than its share of the cells.
    for fewer in range(1, 6):
        reached = max(observed for n, observed in most.items() if n <= full - fewer)
        assert reached >= 1.0 - fewer / (full - fewer)


def test_finer_cells_are_asked_only_about_what_reaches_the_goal_on_the_first() -> None:
    required = list[str]()

    def cells(name: str, observed: dict[int, float]) -> Any:
        def fraction(points_m: np.ndarray) -> float:
            required.append(name)
            return observed[len(points_m)]

        return SimpleNamespace(observed=lambda points_m: points_m, fraction_of_coverable=fraction)

    def route(count: int) -> Route:
        return Route(np.zeros((count, 3)))

    judge = OneAfterTheOther([cells("own", {2: 0.97, 3: 0.985, 4: 0.979}), cells("finer", {3: 0.983})])
    assert judge(route(2), 0.98) == 0.97
    assert judge(route(3), 0.98) == 0.983
    assert required == ["own", "own", "finer"]
    # What the finer cells saw less of the last one is taken off, so that the search does not stop short of the goal on them.
    assert judge(route(4), 0.98) == pytest.approx(0.977)
    assert required == ["own", "own", "finer", "own"]


@pytest.mark.parametrize("seed", range(8))
def test_beginnings_that_are_too_dear_whatever_they_see_are_not_looked_at(seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = route_problem(judging_map(SITES["along-path"]), margin_m=0.0, reach_m=50.0)
    routes = [Route(np.array([[0.0, 0.0, 60.0], [length, 0.0, 60.0]])) for length in rng.uniform(500.0, 2000.0, 30)]
    fraction = {id(route): float(np.clip(route.length_m / 1500.0 + rng.normal(0.0, 0.1), 0.0, 1.0)) for route in routes}
    evaluated = promising_starts(problem, routes, 0.9, lambda route: fraction[id(route)])
    best = best_starts(problem, [SearchStart(route, fraction[id(route)]) for route in routes], 0.9)
    assert all(a.route is b.route for a, b in zip(best_starts(problem, evaluated, 0.9)[:CHAINS], best, strict=False))
    assert CHAINS <= len(evaluated) < len(routes)
    # Where the order is free, what reaches the goal comes first, whatever it costs.
    free = route_problem(judging_map(SITES["free-order"]), margin_m=0.0, reach_m=50.0)
    assert free.free_order
    assert len(promising_starts(free, routes, 0.9, lambda _: 0.5)) == len(routes)
