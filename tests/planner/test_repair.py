"""Gaps of a search's routes are closed: of routes, of what a search ended with, of beginnings, and in whole plans."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.planner.sites import EXACT, Ups, flat, hills, make_site
from tests.planner.test_memetic import make_plan
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.model.sensor import FrameCamera
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.search import goal_search
from uavcover.planner.search.local_search import SearchStart
from uavcover.planner.search.repair import repaired_end, repaired_start, with_gaps_closed
from uavcover.planner.search.route_problem import RouteJudge
from uavcover.planner.search.tuning import TUNED
from uavcover.sensing.site_maps import judging_map


@pytest.mark.parametrize("ups", [flat, hills], ids=["flat", "hills"])
def test_gaps_of_a_route_are_closed_behind_it(ups: Ups) -> None:
    """A search that ends short of its goal goes on from its route with the gaps closed, which keeps every limit."""
    site = make_site(ups, cell_m=5.0)
    judging = judging_map(site)
    whole = fly_layout(site, plain_boustrophedon(site)).waypoints_m
    for goal in (0.9, 0.97):
        cut = Route(whole[: 2 * len(whole) // 3])
        before = judging.fraction_of_coverable(judging.observed(cut.waypoints_m))
        assert before < goal
        closed = with_gaps_closed(judging, cut, goal, TUNED.goal.closed, lambda: False, most_trials=1000)
        assert closed is not None
        np.testing.assert_array_equal(closed.waypoints_m[: len(cut)], cut.waypoints_m)
        assert judging.fraction_of_coverable(judging.observed(closed.waypoints_m)) >= goal
        assert measure_violations(site, closed.waypoints_m, margin_m=0.0).total == 0.0
    assert with_gaps_closed(judging, Route(whole), 0.5, TUNED.goal.closed, lambda: False, most_trials=1000) is None
    assert with_gaps_closed(judging, cut, 1.5, TUNED.goal.closed, lambda: False, most_trials=1000) is None


def test_trials_to_make_a_closing_shorter_are_counted() -> None:
    site = make_site(hills, cell_m=5.0)
    judging = judging_map(site)
    whole = fly_layout(site, plain_boustrophedon(site)).waypoints_m
    cut = Route(whole[: len(whole) // 2])
    required = {20: 0, 1000: 0}
    for trials in required:

        def is_over(trials: int = trials) -> bool:
            required[trials] += 1
            return False

        closed = with_gaps_closed(judging, cut, 0.95, TUNED.goal.closed, is_over, most_trials=trials)
        assert closed is not None
        assert judging.fraction_of_coverable(judging.observed(closed.waypoints_m)) >= 0.95
    assert 20 <= required[20] <= 30 < required[1000]


def canyon(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    away = np.abs(north - 150.0 - 40.0 * np.sin(east / 60.0))
    return np.where(away < 35.0, 0.0, 85.0) + 0.02 * east


def test_a_canyon_is_seen_as_far_as_is_asked_for() -> None:
    """Its walls are dear: a search from short lines ended at 91 %, and links from routes to gaps were too steep."""
    survey = FrameCamera(
        kind="frame-camera", fov_across_deg=73.0, fov_along_deg=53.0, range_m=250.0, mount="stabilised",
        forward_overlap=0.75, side_overlap=0.6,
    )  # fmt: skip
    ring = ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 300.0))
    band = {"min_height_agl_m": 40.0, "max_height_agl_m": 150.0, "height_margin_m": 5.0}
    plan = make_plan(
        make_site(canyon, ring=ring, cell_m=5.0, sensor=survey, limits=band), rule="coverage>=0.98", evaluations=60
    )
    assert plan.rule_met
    assert plan.chosen.violation == 0.0


def test_gaps_are_closed_while_there_is_time_for_it_and_not_afterwards() -> None:
    pace = SimpleNamespace(fraction=0.7)
    problem = SimpleNamespace(cost=lambda route: route.length_m)
    work: Any = SimpleNamespace(stopped=False, pace=pace, tuning=TUNED, problem=problem)
    route = Route(np.array([[0.0, 0.0, 80.0], [100.0, 0.0, 80.0]]))
    reported = []

    def closed(whole: Route, goal: float, is_over: Callable[[], bool]) -> Route:
        reported.append((goal, is_over()))
        pace.fraction = 0.86
        reported.append((goal, is_over()))
        return whole

    judge = RouteJudge(lambda _, __: 0.97, lambda _: None, closed)
    found = [SearchStart(route, 0.97)]
    assert repaired_end(work, found, 0.98, judge, until=0.85) is not None
    assert reported == [(0.98, False), (0.98, True)]
    assert repaired_end(work, found, 0.98, judge, until=0.85) is None
    assert len(reported) == 2


@pytest.mark.parametrize(
    ("judging", "repair", "closes", "judged", "closed"),
    [
        (0.0, 0.1, True, 5, 2),
        (0.0, 0.2, True, 5, 1),
        (0.0, 0.25, False, 5, 2),
        (0.0, 0.1, False, 5, 4),
        (0.1, 0.0, False, 5, 0),
    ],
    ids=["time for two", "over after one", "none closes", "none of all closes", "over while beginnings are judged"],
)
def test_beginnings_are_closed_while_there_is_time_for_it(
    judging: float, repair: float, closes: bool, judged: int, closed: int
) -> None:
    """By a clock that each judgement and each closing moves on, from 0.5 to 0.7; to 0.9 while none is closed."""
    pace = SimpleNamespace(fraction=0.5)
    problem = SimpleNamespace(cost=lambda route: route.length_m, free_order=False)
    work: Any = SimpleNamespace(stopped=False, pace=pace, tuning=TUNED, problem=problem)
    starts = [
        SearchStart(Route(np.array([[0.0, 0.0, 80.0], [100.0 + k, 0.0, 80.0]])), 0.95 - 0.01 * k) for k in range(4)
    ]
    calls = list[str]()

    def judge_coverage(route: Route, _goal: float) -> float:
        calls.append("judged")
        pace.fraction += judging
        return 0.9 + 0.001 * len(route)

    def close(route: Route, _goal: float, _is_over: Callable[[], bool]) -> Route | None:
        calls.append("closed")
        pace.fraction += repair
        return route if closes else None

    judge = RouteJudge(judge_coverage, lambda _: None, close)
    found = repaired_start(work, starts, starts[-1:], 0.98, judge, until=0.7, at_last=0.9)
    assert (found is not None) == closes
    assert (calls.count("judged"), calls.count("closed")) == (judged, closed)


def test_the_cheapest_beginning_that_sees_enough_needs_no_closing() -> None:
    """Of lines of 100, 200 and 300 m, of which the first sees enough on the planner's cells only."""
    work: Any = SimpleNamespace(
        stopped=False, pace=SimpleNamespace(fraction=0.5), tuning=TUNED,
        problem=SimpleNamespace(cost=lambda route: route.length_m, free_order=False),
    )  # fmt: skip
    judged = {100.0: 0.97, 200.0: 0.985, 300.0: 0.999}
    starts = [SearchStart(Route(np.array([[0.0, 0.0, 80.0], [m, 0.0, 80.0]])), 0.981) for m in (300.0, 100.0, 200.0)]
    ended = SearchStart(Route(np.array([[0.0, 0.0, 80.0], [50.0, 0.0, 80.0]])), 0.9)
    judge = RouteJudge(lambda route, _: judged.get(route.length_m, 0.8), lambda _: None)
    assert repaired_start(work, starts, [ended], 0.98, judge, until=0.7, at_last=0.9) is starts[2]


@pytest.mark.parametrize(("least_short", "tried"), [(0, [100.0]), (1, [90.0, 100.0]), (2, [90.0, 80.0, 100.0])])
def test_the_ends_that_are_the_least_short_are_closed_beside_the_last(least_short: int, tried: list[float]) -> None:
    judged, required = {80.0: 0.965, 90.0: 0.975, 100.0: 0.96}, []

    def closed(route: Route, _goal: float, _is_over: Callable[[], bool]) -> Route:
        required.append(route.length_m)
        return Route(10.0 * route.waypoints_m)

    work: Any = SimpleNamespace(
        stopped=False, pace=SimpleNamespace(fraction=0.5), tuning=TUNED,
        problem=SimpleNamespace(cost=lambda route: route.length_m),
    )  # fmt: skip
    found = [SearchStart(Route(np.array([[0.0, 0.0, 80.0], [m, 0.0, 80.0]])), 0.97) for m in (80.0, 90.0, 100.0)]
    judge = RouteJudge(lambda route, _: judged[route.length_m], lambda _: None, closed)
    assert repaired_end(work, found, 0.98, judge, until=0.9, least_short=least_short) is not None
    assert required == tried


@pytest.mark.parametrize(("goal", "tried", "best_m"), [(0.98, [100.0], 300.0), (0.999, [80.0, 90.0, 100.0], 150.0)])
def test_where_nearly_all_is_to_be_seen_the_end_of_every_stage_is_closed(
    goal: float, tried: list[float], best_m: float
) -> None:
    """Ends of 80, 90 and 100 m, which need 230, 60 and 200 m more."""

    def line(length_m: float) -> Route:
        return Route(np.array([[0.0, 0.0, 80.0], [length_m, 0.0, 80.0]]))

    more_m, required = {80.0: 230.0, 90.0: 60.0, 100.0: 200.0}, []

    def closed(route: Route, _goal: float, _is_over: Callable[[], bool]) -> Route:
        required.append(route.length_m)
        return line(route.length_m + more_m[route.length_m])

    problem = SimpleNamespace(cost=lambda route: route.length_m)
    work: Any = SimpleNamespace(stopped=False, pace=SimpleNamespace(fraction=0.5), tuning=TUNED, problem=problem)
    found = [SearchStart(line(length_m), goal - 0.01) for length_m in (80.0, 90.0, 100.0)]
    judge = RouteJudge(lambda _, goal: goal - 0.01, lambda _: None, closed)
    end = repaired_end(work, found, goal, judge, until=0.9)
    assert end is not None
    assert required == tried
    assert end.route.length_m == best_m


@pytest.mark.parametrize(("judged", "tried", "best_m"), [(80.0, [], None), (100.0, [90.0], 95.0)])
def test_where_nearly_all_is_to_be_seen_an_end_that_sees_it_is_the_most_that_closing_may_cost(
    judged: float, tried: list[float], best_m: float | None
) -> None:
    """One end sees enough: the others are closed only where they cost less, and count only then."""

    def line(length_m: float) -> Route:
        return Route(np.array([[0.0, 0.0, 80.0], [length_m, 0.0, 80.0]]))

    required: list[float] = []

    def closed(route: Route, _goal: float, _is_over: Callable[[], bool]) -> Route:
        required.append(route.length_m)
        return line(route.length_m + 5.0)

    problem = SimpleNamespace(cost=lambda route: route.length_m)
    work: Any = SimpleNamespace(stopped=False, pace=SimpleNamespace(fraction=0.5), tuning=TUNED, problem=problem)
    lengths = (80.0, 90.0, 100.0) if judged == 80.0 else (90.0, 100.0)
    found = [SearchStart(line(length_m), 0.99) for length_m in lengths]
    judge = RouteJudge(lambda route, goal: goal - (0.0 if route.length_m == judged else 0.01), lambda _: None, closed)
    end = repaired_end(work, found, 0.999, judge, until=0.9)
    assert required == tried
    assert (None if end is None else end.route.length_m) == best_m


@pytest.mark.parametrize("vehicle", [EXACT, None])
def test_nearly_all_of_a_field_takes_less_than_the_best_lines(vehicle: Any) -> None:
    """Of a field like a U, with corners flown exactly and as a vehicle cuts them: lines side by side end 4 % later or more."""
    ring = ((0, 0), (500, 0), (500, 440), (340, 440), (340, 160), (160, 160), (160, 440), (0, 440))
    others = {} if vehicle is None else {"vehicle": vehicle}
    site = make_site(
        flat, ring=tuple((float(e), float(n)) for e, n in ring), cell_m=5.0, planner={"objective": "flight-time"},
        limits={"min_height_agl_m": 59.0, "max_height_agl_m": 61.0, "height_margin_m": 0.9}, **others,
    )  # fmt: skip
    plan = make_plan(site, rule="coverage>=0.999", evaluations=600, seed=3)
    lines = [each.metrics.cost for each in plan.baselines if each.metrics.coverage_of_coverable >= 0.999]
    assert plan.rule_met
    assert plan.chosen.metrics.cost < 0.96 * min(lines)


def test_a_short_beginning_is_no_bargain_for_the_ground_that_it_misses() -> None:
    """23 s for 13 % of the ground are more than 195 s for 98 %."""
    assert TUNED.goal.start_cost(195.0, 0.98, 0.999) < TUNED.goal.start_cost(23.0, 0.13, 0.999)
    assert TUNED.goal.start_cost(23.0, 0.0, 0.999) == math.inf
    assert TUNED.goal.start_cost(195.0, 1.0, 0.999) == 195.0


@pytest.mark.parametrize(
    ("repair", "ends_short", "fractions", "end"),
    [
        (0.0, 0, [(0.6, 0.7)], 0.7),
        (0.0, 1, [(0.6, 0.7), (0.7, 0.8)], 0.8),
        (0.15, 1, [(0.75, 0.85), (0.85, 0.85)], 0.85),
        (0.0, 9, [(0.6, 0.7), (0.7, 0.8), (0.8, 0.85)], 0.85),
    ],
    ids=["reaches its goal", "ends short once", "closing takes long", "ends short every time"],
)
def test_a_search_goes_on_from_closed_gaps_however_long_closing_took(
    monkeypatch: pytest.MonkeyPatch, repair: float, ends_short: int, fractions: list[tuple[float, float]], end: float
) -> None:
    """Closed gaps that nothing made shorter took 1,000 s over a canyon where 740 s are enough."""
    pace = SimpleNamespace(fraction=0.6 + repair)
    problem = SimpleNamespace(cost=lambda route: route.length_m, free_order=False)
    work: Any = SimpleNamespace(stopped=False, pace=pace, tuning=TUNED, problem=problem)
    long, shorter = (Route(np.array([[0.0, 0.0, 80.0], [m, 0.0, 80.0]])) for m in (1000.0, 700.0))
    searched, left = list[tuple[float, float]](), iter(range(ends_short))

    def search(_work: Any, starts: list[SearchStart], *args: Any, **_: Any) -> list[SearchStart]:
        assert starts[0].route is long
        searched.append(args[2])
        pace.fraction = max(pace.fraction, args[2][1])
        return [SearchStart(shorter, 0.97)]

    def close(*_: Any, **__: Any) -> SearchStart | None:
        if next(left, None) is None:
            return None
        pace.fraction += repair
        return SearchStart(long, 0.98)

    monkeypatch.setattr(goal_search, "search_goal", search)
    monkeypatch.setattr(goal_search, "repaired_end", close)
    kept = list[Route]()
    judge = RouteJudge(lambda _, __: 0.97, kept.append)
    out, ended = goal_search.search_from_closed(
        work, SearchStart(long, 0.98), SearchStart(shorter, 0.96), 0.98, 100, (0.6, 0.85), 0.1, judge,
        finest=False, from_start=False,
    )  # fmt: skip
    assert searched == [pytest.approx(fraction) for fraction in fractions]
    assert ended == pytest.approx(end)
    assert len(kept) == min(ends_short, 3)
    assert len(out) == len(searched) + len(kept)
