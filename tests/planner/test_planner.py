import dataclasses
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site, ridge, tower
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.leg_checks import find_problems, measure_violations
from uavcover.missions.objectives import judge
from uavcover.model.limits import Obstacles
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.sensor import SphereSensor
from uavcover.planner.baselines.boustrophedon import Baseline
from uavcover.planner.parallel_lines import any_reaches, first_lines, one_line_more
from uavcover.planner.planner import Effort, SearchProgress, _takes_too_long, plan_routes
from uavcover.planner.search.optimizer_search import WaypointEncoding, rounds_of
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap


def frozen() -> float:
    return 0.0


def make_plan(
    site: Site, *, rule: str = "coverage>=0.9", seed: int = 1, evaluations: int = 60, budget_s: float | None = None,
    now: Callable[[], float] = frozen, **options: Any,
) -> Plan:  # fmt: skip
    settings = dataclasses.replace(site.scenario.planner, seed=seed)
    return plan_routes(site, settings=settings, select_rule=rule, effort=Effort(evaluations, budget_s, now), **options)


def same(a: Plan, b: Plan) -> bool:
    figures = [[(m.metrics, m.origin, m.violation) for m in (*p.members, *p.baselines)] for p in (a, b)]
    routes = [[m.route.waypoints_m.tolist() for m in p.members] for p in (a, b)]
    return figures[0] == figures[1] and routes[0] == routes[1] and a.evaluations == b.evaluations


def values(member: RouteMember) -> tuple[float, int, float]:
    m = member.metrics
    return -m.coverage_of_coverable, m.waypoint_count, m.cost


def no_worse(a: RouteMember, b: RouteMember) -> bool:
    return all(x <= y for x, y in zip(values(a), values(b), strict=True))


def test_the_same_seed_gives_the_same_plan_with_any_number_of_threads() -> None:
    site = make_site(hills)
    alone = make_plan(site)
    assert same(alone, make_plan(site))
    for threads in (1, 2):
        with ThreadPoolExecutor(threads) as executor:
            assert same(alone, make_plan(site, executor=executor))
    assert alone.evaluations == 60
    assert not same(alone, make_plan(site, seed=2))


SMALL = ((0.0, 0.0), (150.0, 0.0), (150.0, 120.0), (0.0, 120.0))
FAR = tuple((east + 320.0, north + 260.0) for east, north in SMALL)


@pytest.mark.parametrize(
    "planner", [{"algorithm": "memetic"}, {"algorithm": "imodbo", "encoding": "waypoints", "max_waypoints": 30}]
)
def test_parts_are_covered_in_one_flight_and_the_legs_between_them_keep_the_limits(planner: dict[str, Any]) -> None:
    between = ridge(240.0, 60.0)
    site = make_site(between, ring=SMALL, more_parts=(FAR,), planner=planner)
    plan = make_plan(site, rule="max-coverage", evaluations=40)
    route = plan.chosen.route.waypoints_m
    assert plan.chosen.metrics.coverage_of_coverable > (0.97 if planner["algorithm"] == "memetic" else 0.4)
    limits = site.scenario.limits
    assert not find_problems(site, route, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m)
    if planner["algorithm"] == "memetic":
        # By hand: the camera sees as far beside its path as 35 degrees reach down to the flat ground there.
        for part in (SMALL, FAR):
            path = shapely.LineString(route[:, :2])
            corners = shapely.points(np.array(part))
            assert shapely.distance(corners, path).max() < 120.0 * math.tan(math.radians(35.0))


L_SHAPE = ((0.0, 0.0), (300.0, 0.0), (300.0, 100.0), (100.0, 100.0), (100.0, 300.0), (0.0, 300.0))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    "site",
    [make_site(hills), make_site(flat, ring=L_SHAPE), make_site(hills, ring=L_SHAPE, limits={"height_margin_m": 8.0})],
    ids=["hills", "flat-l", "hilly-l"],
)
def test_the_choice_is_never_worse_than_a_baseline_and_the_set_is_non_dominated(site: Site, seed: int) -> None:
    required = 0.9
    plan = make_plan(site, seed=seed, rule=f"coverage>={required}")
    assert plan.rule_met
    assert plan.chosen in plan.members
    assert plan.chosen.metrics.coverage_of_coverable >= required
    reached = [b for b in plan.baselines if b.violation <= 0.0 and b.metrics.coverage_of_coverable >= required]
    assert reached
    assert plan.chosen.metrics.cost <= min(b.metrics.cost for b in reached)
    for a in plan.members:
        assert a.violation == 0.0
        assert not any(
            values(b) != values(a) and all(x <= y for x, y in zip(values(b), values(a), strict=True))
            for b in plan.members
        )
    assert len({values(m) for m in plan.members}) == len(plan.members)
    fractions = [m.metrics.coverage_of_coverable for m in plan.members]
    assert fractions == sorted(fractions)
    # Every baseline is in the set or beaten by a member.
    for b in plan.baselines:
        assert b.violation > 0 or any(
            all(x <= y for x, y in zip(values(m), values(b), strict=True)) for m in plan.members
        )


def test_members_are_judged_on_the_cells_of_the_area_and_keep_the_limits() -> None:
    site = make_site(hills, limits={"height_margin_m": 5.0})
    plan = make_plan(site)
    fine = CoverageMap(site, cell_size_m=10.0)
    for member in plan.members[::5]:
        assert member.metrics == judge(fine, member.route)
        assert measure_violations(site, member.route.waypoints_m, margin_m=5.0).total == 0.0
        assert member.metrics.min_height_agl_m >= 45.0 - 1e-6
        assert member.metrics.max_height_agl_m <= 115.0 + 1e-6
    assert plan.baselines[0].origin == "boustrophedon"


def test_a_coverage_out_of_reach_takes_the_best() -> None:
    observes_little = SphereSensor(kind="sphere", range_m=150.0)
    site = make_site(sensor=observes_little, planner={"encoding": "waypoints", "max_waypoints": 2})
    plan = make_plan(site, rule="coverage>=1", evaluations=40)
    assert not plan.rule_met
    assert plan.chosen.metrics.coverage_of_coverable == max(m.metrics.coverage_of_coverable for m in plan.members)
    assert plan.baselines == ()


def test_a_bad_rule_is_found_before_the_search() -> None:
    with pytest.raises(InputError, match="unknown rule"):
        make_plan(make_site(), rule="bestest", should_stop=lambda: pytest.fail("searched"))


# Stopping


@pytest.mark.parametrize("encoding", ["swaths", "waypoints"])
def test_stopped_before_the_first_round(encoding: str) -> None:
    plan = make_plan(make_site(planner={"encoding": encoding}), should_stop=lambda: True, rule="max-coverage")
    assert plan.interrupted
    # Without a baseline there would be nothing to give back, so one round of 20 is done.
    assert plan.evaluations == (0 if encoding == "swaths" else 20)
    assert plan.chosen.metrics.coverage_of_coverable > 0.5


def test_stopped_after_a_round_the_best_so_far_is_returned() -> None:
    observed: list[SearchProgress] = []
    site = make_site(hills)
    plan = make_plan(site, evaluations=200, should_stop=lambda: len(observed) >= 2, on_progress=observed.append)
    assert plan.interrupted
    assert plan.evaluations == 40
    assert [(p.evaluations, p.total) for p in observed] == [(20, 200), (40, 200)]
    assert observed[-1].best_coverage > 0.9
    assert observed[-1].least_cost is not None
    assert observed[-1].least_cost <= observed[0].least_cost  # type: ignore[operator]
    assert plan.rule_met


def test_an_uninterrupted_plan_says_so() -> None:
    assert not make_plan(make_site(), evaluations=20).interrupted


# The time budget


class Clock:
    """A clock that moves on whenever it is read."""

    def __init__(self, tick_s: float) -> None:
        self.tick_s, self.time_s = tick_s, 1000.0

    def __call__(self) -> float:
        self.time_s += self.tick_s
        return self.time_s


@pytest.mark.parametrize(
    ("violation", "budget_s", "too_long"),
    [(0.0, 100.0, True), (0.0, 1000.0, False), (0.0, None, False), (3.0, 100.0, False)],
)
def test_a_local_search_does_not_wait_for_a_round_that_takes_longer_than_its_share(violation, budget_s, too_long):
    lines = Baseline("lines", Route(np.zeros((2, 3))), None, np.zeros(3), violation)
    broken = dataclasses.replace(lines, violation=1.0)
    assert _takes_too_long(6.0, [broken, lines], Effort(1, budget_s, frozen), 0.05) == too_long
    assert not _takes_too_long(6.0, [], Effort(1, budget_s, frozen), 0.05)


@pytest.mark.parametrize(("objective", "kind"), [("length", "balanced-lines"), ("mission-time", "simple-lines")])
def test_where_there_is_no_time_the_best_beginnings_are_laid_out(objective: str, kind: str) -> None:
    site = make_site(hills, planner={"objective": objective})
    assert {made for _, made in first_lines(site, 0.0, None, lambda: True)} == {kind}
    assert {made for _, made in first_lines(site, 0.0, None, lambda: False)} == {"balanced-lines", "simple-lines"}


@pytest.mark.parametrize("objective", ["length", "flight-time"])
def test_where_the_first_lines_leave_gaps_there_is_one_line_more(objective: str) -> None:
    site = make_site(flat, cell_m=5.0, planner={"objective": objective})
    coarse = CoverageMap(site, cell_size_m=5.0)
    first = first_lines(site, 0.0, None, lambda: True)
    more = one_line_more(site, 0.0)
    fraction = [
        max(coarse.fraction_of_coverable(coarse.observed(r.waypoints_m)) for r, _ in lines) for lines in (first, more)
    ]
    assert fraction[0] < fraction[1]
    between = 0.5 * (fraction[0] + fraction[1])
    assert [any_reaches(coarse, lines, between) for lines in (first, more)] == [False, True]
    # Nothing is asked for, or there are no lines to add to.
    assert any_reaches(coarse, first, None)
    assert any_reaches(coarse, [], between)
    for route, _ in more:
        assert measure_violations(site, route.waypoints_m, margin_m=site.scenario.limits.height_margin_m).total == 0.0


def test_the_budget_is_honoured() -> None:
    # Read once a batch of baselines (6), twice while timing, once a round: 20 s are over after a dozen rounds.
    clock, observed = Clock(1.0), list[SearchProgress]()
    plan = make_plan(make_site(), evaluations=10**9, budget_s=20.0, now=clock, on_progress=observed.append)
    assert not plan.interrupted
    assert 2 * 20 <= plan.evaluations <= 20 * 20
    assert plan.wall_s <= 20.0 + 2.0
    assert all(p.evaluations <= p.total for p in observed)
    assert observed[-1].total < 10**9


def test_a_budget_that_is_over_at_once_still_gives_a_plan() -> None:
    plan = make_plan(make_site(), evaluations=60, budget_s=1e-9, now=Clock(1.0))
    assert plan.evaluations == 20
    assert not plan.interrupted
    assert [b.origin for b in plan.baselines] == ["boustrophedon"]


def test_rounds_under_a_budget_are_what_is_left_over_the_time_of_one_evaluation() -> None:
    site = make_site(sensor=SphereSensor(kind="sphere", range_m=150.0))
    coverage = CoverageMap(site, cell_size_m=50.0)
    encoding = WaypointEncoding(site, capacity=3, order="nearest-neighbour", reference_m=np.zeros(3))
    # The clock ticks 4 s between the two readings around 8 routes: 0.5 s each. It started at 0 and then reads 12.
    readings = iter([4.0, 8.0, 12.0])
    effort = Effort(1, 112.0, lambda: next(readings))
    found = rounds_of(effort, 0.0, encoding=encoding, coverage=coverage, population_size=20, executor=None)
    assert found == (112 - 12) / 0.5 / 20
    by_number = Effort(119, None, lambda: pytest.fail("asked the clock"))
    assert rounds_of(by_number, 0.0, encoding=encoding, coverage=coverage, population_size=20, executor=None) == 5


# No feasible plan


def steep(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.maximum(0.0, 150.0 - 2.0 * np.abs(east - 150.0)) + 0.0 * north


def test_a_band_too_narrow_for_the_climb_limit() -> None:
    site = make_site(steep, limits={"max_height_agl_m": 50.0, "max_climb_angle_deg": 15.0, "height_margin_m": 1.0})
    with pytest.raises(InfeasibleError) as caught:
        make_plan(site, evaluations=20)
    text = str(caught.value)
    assert text.startswith("no route meets the scenario's limits; the best route violates one: leg to waypoint ")
    assert "too high" in text
    assert "m above ground against 49.0 m above ground at " in text
    assert "after limits.height_margin_m = 1 m" in text
    assert "allow a larger limits.max_climb_angle_deg" in text
    assert "\n" not in text


def test_a_fence_that_cuts_the_area() -> None:
    fence = ((-200.0, -50.0), (100.0, -50.0), (100.0, 250.0), (-200.0, 250.0))
    with pytest.raises(InfeasibleError, match=r"m outside the fence at \d+ m east.*use a larger fence"):
        make_plan(make_site(fence=fence), evaluations=20)


def test_no_data_beside_a_concave_area() -> None:
    def notch(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.where((east > 150) & (north > 150), np.nan, 0.0)

    site = make_site(notch, ring=L_SHAPE, home=None)
    plan = make_plan(site)
    lowest = site.scenario.limits.min_height_agl_m
    assert find_problems(site, plan.chosen.route.waypoints_m, lowest_agl_m=lowest, highest_agl_m=120.0) == []


def test_a_limit_for_the_waypoints_alone_is_reported_by_waypoint() -> None:
    limits = {"applies_to": "waypoints", "max_alt_amsl_m": 430.0}
    site = make_site(
        sensor=SphereSensor(kind="sphere", range_m=150.0),
        limits=limits,
        planner={"encoding": "waypoints", "max_waypoints": 3},
    )
    with pytest.raises(InfeasibleError, match=r"violates one: waypoint \d: (above sea-level|too low).*m"):
        make_plan(site, evaluations=20)


def test_interrupted_before_anything_feasible_says_so() -> None:
    fence = ((-200.0, -50.0), (100.0, -50.0), (100.0, 250.0), (-200.0, 250.0))
    with pytest.raises(InfeasibleError, match=r"^interrupted: so far no route meets the scenario's limits"):
        make_plan(make_site(fence=fence), should_stop=lambda: True)


# The paper's scenarios


@pytest.mark.parametrize("name", ["paper-R2", "paper-planar"])
@pytest.mark.parametrize("algorithm", ["imodbo", "modbo"])
def test_the_papers_scenarios_run_end_to_end(name: str, algorithm: str) -> None:
    site = load_site(name)
    settings = dataclasses.replace(site.scenario.planner, algorithm=algorithm)
    plan = plan_routes(site, settings=settings, select_rule=site.scenario.select, effort=Effort(150, None, frozen))
    assert plan.evaluations == 150
    assert plan.rule == "weighted:0.6,0.2,0.2"
    assert plan.chosen.metrics.waypoint_count <= 60
    for member in plan.members:
        points = member.route.waypoints_m
        ground = np.sin(points[:, 1]) * np.cos(points[:, 0])
        assert (points[:, 2] >= ground - 1e-6).all()  # never under the ground
        assert (np.abs(points[:, 2]) <= 1.0 + 1e-6).all()
        # The tour starts at the node nearest the origin (section 2.1).
        distance = np.linalg.norm(points, axis=1)
        assert distance[0] == distance.min()


def test_an_obstacle_that_leaves_no_room_is_named() -> None:
    site = make_site(
        sensor=SphereSensor(kind="sphere", range_m=150.0), limits={"applies_to": "waypoints"},
        obstacles=Obstacles(prisms=(tower(-50, -50, 350, 250, 200, name="hangar"),)),
        planner={"encoding": "waypoints", "max_waypoints": 3},
    )  # fmt: skip
    words = (
        r"one: waypoint \d: \d+\.\d m too close to obstacle 'hangar' at .*; allow smaller obstacles\.clearance_beside_m"
    )
    with pytest.raises(InfeasibleError, match=words):
        make_plan(site, evaluations=20)
