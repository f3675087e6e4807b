"""What is handed over: parts of routes that see as much as is said, the unbeaten ones, within the time, and not too many."""

from collections.abc import Callable

import numpy as np
import pytest

from tests.planner.sites import EXACT, flat, hills, make_site
from tests.planner.test_planner import frozen
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route, RouteMember, RouteMetrics
from uavcover.model.sensor import FrameCamera, Sensor, SphereSensor
from uavcover.planner.baselines.adaptive_swaths import BENT, STRAIGHT, TIGHT, TIGHT_INSETS, can_be_adapted, simple_lines
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.front import MOST_MEMBERS, Candidate, Finish, gains_of, parts_of, thinned
from uavcover.planner.search.optimizer_search import Effort
from uavcover.planner.selection_rule import parse_rule, select
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

FRAME = FrameCamera(kind="frame-camera", sensing="along-path", fov_across_deg=60.0, fov_along_deg=40.0, range_m=300.0)
BALL = SphereSensor(kind="sphere", range_m=110.0)


def lines(site: Site, count: int = 3) -> Route:
    return fly_layout(site, regular_layout(angle_rad=0.3, lines=count, height_agl_m=80.0, inset=0.2, tolerance_m=2.0))


@pytest.mark.parametrize("sensor", [None, FRAME, BALL], ids=["along-path", "turning", "at-waypoints"])
def test_a_part_sees_at_least_what_is_said_of_it_and_no_shorter_stretch_is_known_to(sensor: Sensor | None) -> None:
    # Without a home waypoints are passed exactly.
    home = None if sensor is BALL else (-100.0, 50.0)
    site = make_site(hills, vehicle=EXACT, home=home, **({} if sensor is None else {"sensor": sensor}))
    coverage = CoverageMap(site, cell_size_m=10.0)
    route = lines(site)
    gains = gains_of(coverage, route)
    assert gains.observed[-1] == pytest.approx(coverage.fraction(coverage.observed(route.waypoints_m)))
    assert (np.diff(gains.observed) >= 0.0).all()
    # Leg by leg: up to each waypoint.
    for k in range(2, len(route) + 1):
        observed = coverage.fraction(coverage.observed(route.waypoints_m[:k]))
        assert gains.observed[k - 1] <= observed + 1e-12
        if sensor is not FRAME:  # it looks ahead from the last place only where there is a next leg
            assert gains.observed[k - 1] == pytest.approx(observed)
    fractions = (0.25, 0.5, 0.75)
    parts = parts_of(gains, fractions=fractions)
    assert len(parts) == 3
    points = route.waypoints_m.tolist()
    for fraction, part in zip(fractions, parts, strict=True):
        at = points.index(part.route.waypoints_m[0].tolist())
        assert part.route.waypoints_m.tolist() == points[at : at + len(part.route)]
        assert part.observed >= fraction * gains.observed[-1] - 1e-9
        assert coverage.fraction(coverage.observed(part.route.waypoints_m)) >= part.observed - 1e-12
        shortest = min(
            gains.along_m[j] - gains.along_m[i]
            for i in range(len(points))
            for j in range(i + 1, len(points))
            if gains.observed[j] - gains.observed[i] >= fraction * gains.observed[-1] - 1e-9
        )
        assert part.route.length_m == pytest.approx(shortest)


def test_a_leg_has_no_parts_and_the_whole_is_none() -> None:
    coverage = CoverageMap(make_site(), cell_size_m=10.0)
    leg = Route(np.array([[50.0, 100.0, 80.0], [250.0, 100.0, 80.0]]))
    assert parts_of(gains_of(coverage, leg)) == []
    bent = Route(np.array([[50.0, 100.0, 80.0], [150.0, 110.0, 80.0], [250.0, 100.0, 80.0]]))
    assert {len(part.route) for part in parts_of(gains_of(coverage, bent))} == {2}


def make_finish(site: Site, others: list[Candidate], *, budget_s: float | None, now: Callable[[], float]) -> Finish:
    coarse, fine = CoverageMap(site, cell_size_m=20.0), CoverageMap(site, cell_size_m=10.0)
    simple = [(lines(site, 5), "simple-lines")]
    effort = Effort(100, budget_s, now)
    return Finish(
        coarse, fine, baselines_of(site, 1), others, simple, evaluating_s=0.25, effort=effort, started=0.0, executor=None
    )  # fmt: skip


def baselines_of(site: Site, count: int) -> list[Candidate]:
    return [Candidate((lines(site, 3 + k), f"lines-{k}"), np.array([-0.9, 6.0, 900.0]), 0.0) for k in range(count)]


def test_parts_and_other_routes_are_judged_when_nothing_is_known_to_beat_them() -> None:
    site = make_site(flat)
    better, beaten = Route(np.zeros((2, 3))), Route(np.ones((2, 3)))
    others = [
        Candidate((better, "imodbo"), np.array([-0.99, 2.0, 300.0]), 0.0),
        Candidate((beaten, "imodbo"), np.array([-0.9, 40.0, 9000.0]), 0.0),
        Candidate((beaten, "imodbo"), np.array([-1.0, 1.0, 1.0]), 3.0),  # breaks a limit
    ]
    finish = make_finish(site, others, budget_s=None, now=frozen)
    judged = finish.judged_baselines(baselines_of(site, 1))
    found = (lines(site, 4), "memetic")
    reported = finish.worth_judging([found])
    assert reported[0] is found
    assert (better, "imodbo") in reported
    assert all(route is not beaten for route, _ in reported)
    assert all(name != "simple-lines" for _, name in reported), "five lines see no more than three"
    parts = [(route, name) for route, name in reported if name.startswith("part of ")]
    # Three lines see all: parts of four are longer.
    assert {name for _, name in parts} == {"part of lines-0"}
    assert all(len(route) >= 2 for route, _ in parts)
    assert [member.origin for member in judged] == ["lines-0"]


def test_time_is_set_aside_for_judging_and_less_is_judged_when_there_is_little() -> None:
    site = make_site(flat)
    effort = make_finish(site, [], budget_s=2000.0, now=frozen).search_effort(late_s=10.0)
    assert effort.budget_s is not None
    # 25 routes looked at, 0.25 s each, and judged on four times as many cells, 1 s each; 80 parts of half the length.
    assert 2000.0 - effort.budget_s == pytest.approx(10.0 + 25 * 1.25 + 80 * 0.5)
    small = make_finish(site, [], budget_s=100.0, now=frozen).search_effort()
    assert small.budget_s == pytest.approx(94.0)
    many = [Candidate((lines(site), "imodbo"), np.array([-0.001 * k, 2.0, 0.1 * k]), 0.0) for k in range(200)]
    for now_s, judged in ((0.0, 80), (970.0, 60), (1100.0, 5)):
        at = [0.0, 1.0, now_s]  # a baseline is judged in 1 s
        finish = make_finish(site, many, budget_s=1000.0, now=lambda at=at: at.pop(0) if len(at) > 1 else at[0])
        finish.judged_baselines(baselines_of(site, 1))
        assert len(finish.worth_judging([])) == judged
    assert make_finish(site, many, budget_s=None, now=frozen).search_effort().budget_s is None


@pytest.mark.parametrize(("budget_s", "judged"), [(None, 10), (200.0, 6), (1.0, 2), (1e6, 10)])
def test_as_many_baselines_are_judged_as_a_budget_has_room_for(budget_s: float | None, judged: int) -> None:
    site = make_site(flat)
    ticks = iter(range(10**6))  # each look at the clock takes 1 s, and between two of them two routes are judged
    finish = make_finish(site, [], budget_s=budget_s, now=lambda: float(next(ticks)))
    found = finish.judged_baselines(baselines_of(site, 10))
    assert [member.origin for member in found] == [f"lines-{number}" for number in range(judged)]


WIDE = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))


@pytest.mark.parametrize("sensor", [None, FRAME], ids=["balanced", "straight"])
def test_simple_lines_need_ever_fewer_waypoints_and_keep_the_limits(sensor: Sensor | None) -> None:
    site = make_site(hills, ring=WIDE) if sensor is None else make_site(hills, ring=WIDE, sensor=sensor)
    routes = simple_lines(site, 0.0)
    assert all(measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0 for route in routes)
    assert min(map(len, routes)) < len(routes[0])
    bends = can_be_adapted(site)
    assert len(routes) <= 3 * (len(BENT) * bends + len(STRAIGHT)) + 2 * len(TIGHT) * len(TIGHT_INSETS) * bends
    coverage = CoverageMap(site, cell_size_m=10.0)
    assert max(coverage.fraction(coverage.observed(route.waypoints_m)) for route in routes) > 0.97


def a_member(coverage: float, length_m: float) -> RouteMember:
    metrics = RouteMetrics(coverage, coverage, 5, length_m, 1.0, 1.0, 1.0, length_m)
    return RouteMember(Route(np.zeros((1, 3))), metrics, 0.0, "test")


def test_a_large_set_is_thinned_to_the_chosen_and_the_least_crowded() -> None:
    fractions = np.concatenate([np.linspace(0.1, 0.5, 20), np.linspace(0.9, 0.901, 300)])
    pareto = [a_member(fraction, 1000.0 * fraction) for fraction in fractions.tolist()]
    for text in ("coverage>=0.9004", "max-coverage", "knee"):
        rule = parse_rule(text)
        left = thinned(pareto, rule)
        assert len(left) <= MOST_MEMBERS
        assert left[select(left, rule).index] is pareto[select(pareto, rule).index]
        assert set(map(id, [*pareto[:20], pareto[-1]])) <= set(map(id, left))
        coverage = [member.metrics.coverage_of_coverable for member in left]
        assert coverage == sorted(coverage)
    assert len(thinned(pareto, parse_rule("index:3"))) == MOST_MEMBERS - 1
    assert thinned(pareto[:5], parse_rule("knee")) == pareto[:5]
