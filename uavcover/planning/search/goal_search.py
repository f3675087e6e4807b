"""Local search for the shortest route that reaches a coverage, and for routes of few waypoints.

For few waypoints, the price of a waypoint rises step by step, at the cost of a longer path.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.annealing import Prices
from uavcover.model.route import Route
from uavcover.planning.search.local_search import CHAINS, Chain, Work
from uavcover.planning.search.route_problem import RouteProblem, state_of

LADDER = (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.0)
"""Goals that are searched for besides the one that is asked for, so that there is something to choose from."""

SAFETY = 0.0003
"""Share of the coverage by which a route is to reach more than its goal on the finest cells: other cells see less."""

_MAIN_STAGES = (0.35, 0.55, 0.7, 0.8, 0.88, 0.94, 0.97, 1.0)
"""Shares of the work for the goal that is asked for after which it is corrected; after the first both chains take the better."""
_STAGES = (0.5, 0.85, 1.0)
_MAIN_SHARE = 0.7
_CLOSING_SHARE = 0.15
_MOST_SHORT = 0.03
"""A search that ends this little short of the goal goes on for so much of the work from its route with the gaps closed: beside
zones and obstacles no small move sees the last of the ground."""
_COVERAGE_PRICE = 2.0
_COVERAGE_PRICE_FREE = 1.5
"""Of all coverage, in lengths of the route; where the order is free: of a cell of average weight, in radii of the sensor.
Along a path a share more costs one to two such shares of the length; at a price far above that no single change may lose a
cell, and nothing can be traded."""
_DEARER = 1.6
_STAGE_PER_CORRECTION = 2.0
_GOAL_PER_CORRECTION = 12.0
"""So many times as long as a correction, which judges a route and prepares the chains, a stage and a goal of the ladder take at
least under a time budget: most of the time is search."""
_START_PRICE = 3.0
"""Missing coverage is cheaper in a beginning: fewer lines are hard to come by, gaps between lines are closed."""
_WAYPOINT_PRICE = 0.002
"""Share of the sensor's radius: a waypoint more holds a leg nearer to the height that sees widest, or makes a tour shorter."""
_DEAR_WAYPOINTS = 3.0
"""Lengths that the price of a route's waypoints counts as where they are dear: else coverage would be given for one less."""
_LARGEST_STEP = 0.4
_HOTTEST = 0.05
_HOTTEST_FREE = 0.2
"""Where the order is free."""
_HOTTEST_OF_WAYPOINT = 0.01
"""And this share of the price of a waypoint, wherever it has one."""
_COLDEST = 5e-4
"""Temperatures as shares of the sensor's radius: a bend costs the same on a short route and on a long one."""
_QUENCH = 0.2
"""Share of the work for a tour that is spent cold, on what there is: a search that is stopped early has that."""
_QUENCHED = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class SearchStart:
    """A feasible route to start from.

    Attributes:
        route: its waypoints.
        seen: share of what can be covered that it sees on the planner's cells.
    """

    route: Route
    seen: float


@dataclass(frozen=True, slots=True, eq=False)
class RouteJudge:
    """Who judges the routes of a search.

    Attributes:
        coverage: share of what can be covered that a route sees, on the cells it is judged on.
        found: told every route worth judging.
        closed: a route and what else has to be flown to reach a goal on those cells; none where that is too much to find out.
    """

    coverage: Callable[[Route], float]
    found: Callable[[Route], None]
    closed: Callable[[Route, float], Route | None] = lambda _route, _goal: None


def search_goals(
    work: Work,
    starts: Sequence[SearchStart],
    *,
    asked: float | None,
    capacity: int,
    until: float,
    judge: RouteJudge,
) -> list[SearchStart]:
    """Find the shortest routes for the goals of the ladder, mainly for the required one.

    Args:
        work: what is looked at, and how much may be done.
        starts: one at least.
        asked: share of what can be covered that the selection rule asks for, if it does.
        capacity: most waypoints.
        until: share of all the work, 0..1, after which this search ends.
        judge: judges what is found; goals on the planner's cells are corrected by it.

    Returns:
        The beginnings, and what the stages ended with.
    """
    begin = work.pace.fraction
    goals: Sequence[float] = [goal for goal in LADDER if asked is None or abs(goal - asked) > 0.002]
    main = 0.0 if asked is None else _MAIN_SHARE
    known = list(starts)
    if asked is not None:
        end = begin + main * (until - begin)
        found = search_goal(work, known, asked, capacity, (begin, end), _MAIN_STAGES, judge)
        known += found
        closed = _closed(work, found, asked, judge)
        if closed is not None and len(closed.route) <= capacity:
            judge.found(closed.route)
            main += _CLOSING_SHARE
            end, after = begin + main * (until - begin), end
            known += search_goal(work, [closed], asked, capacity, (after, end), _STAGES, judge)
    ladder = (1.0 - main) * (until - begin)
    goals = _thinned(goals, int(ladder / max(_GOAL_PER_CORRECTION * work.correction, 1e-9)))
    each = ladder / len(goals)
    # From the highest: what reaches more is a good beginning for what may see less.
    for number, goal in enumerate(reversed(goals)):
        at = until - ladder + number * each
        known += search_goal(work, known, goal, capacity, (at, at + each), _STAGES, judge)
    return known


def _closed(work: Work, found: Sequence[SearchStart], goal: float, judge: RouteJudge) -> SearchStart | None:
    """What a search ended with and its gaps closed, where it ends short of its goal."""
    if not found or work.stopped:
        return None
    best = found[-1]
    short = goal - judge.coverage(best.route)
    closed = judge.closed(best.route, goal + SAFETY) if 0.0 < short <= _MOST_SHORT else None
    return None if closed is None else SearchStart(closed, best.seen + short)


def search_goal(
    work: Work,
    starts: Sequence[SearchStart],
    goal: float,
    capacity: int,
    share: tuple[float, float],
    stages: Sequence[float],
    judge: RouteJudge,
    *,
    waypoint_price: float | None = None,
) -> list[SearchStart]:
    """Search for one goal in stages; each corrects the goal, and after the first both chains continue from the better route.

    Args:
        work: what is looked at, and how much may be done.
        starts: one at least.
        goal: share of what can be covered.
        capacity: most waypoints.
        share: of all the work, 0..1, where this search begins and ends.
        stages: shares of this search's work after which the goal is corrected, the last is 1.
        judge: judges what is found.
        waypoint_price: in radii of the sensor; beginnings are ranked by it too. By default next to nothing.

    Returns:
        What the stages ended with: beginnings for other goals.
    """
    begin, end = share
    aim = min(1.0, goal + SAFETY)
    waypoint_m = (_WAYPOINT_PRICE if waypoint_price is None else waypoint_price) * work.problem.reach_m
    ranked_by_m = 0.0 if waypoint_price is None else waypoint_m
    ranked = best_starts(work.problem, starts, goal, ranked_by_m)
    if work.stopped or work.pace.fraction >= end:
        return []
    before = work.pace.fraction
    chains = [_chain(work, ranked[k % len(ranked)].route, aim, capacity, waypoint_m) for k in range(CHAINS)]
    for chain in chains:
        aim = _corrected(goal, chain.seen, judge.coverage(chain.route))
        chain.prices = chain.prices._replace(goal=aim)
    # Two routes were judged; a correction judges one.
    work.correction = 0.5 * (work.pace.fraction - before)
    least = _STAGE_PER_CORRECTION * work.correction / max(end - begin, 1e-9)
    hottest, coldest = chains[0].hottest, chains[0].coldest
    if work.problem.free_order:
        for chain in chains:
            chain.hottest = _QUENCHED * coldest
        work.run(chains, until=begin + _QUENCH * (end - begin))
        for chain in chains:
            judge.found(chain.route)
    price = max(chain.prices.coverage for chain in chains)
    out: list[SearchStart] = []
    reached = False
    warm = 0.0
    for stage, steps in _long_stages(stages, least):
        for k, chain in enumerate(chains):
            # The second of two chains from the same beginning is cooler: from a good one heat only leads away.
            cooler = 0.3**k if out else 1.0
            chain.hottest = max(coldest, cooler * hottest * (coldest / hottest) ** warm)
            chain.coldest = max(coldest, cooler * hottest * (coldest / hottest) ** stage)
        more = work.run(chains, until=begin + stage * (end - begin))
        best = min(chains, key=lambda chain: chain.energy)
        before = work.pace.fraction
        judged = judge.coverage(best.route)
        # The first time all cells were made ready for judging: later corrections are cheaper.
        work.correction = work.pace.fraction - before
        out.append(SearchStart(best.route, best.seen))
        if judged >= goal or not more or stage == stages[-1]:
            reached = reached or judged >= goal
            if judged >= goal or not reached:
                judge.found(best.route)
        if not more or work.stopped:
            break
        aim = _corrected(goal, best.seen, judged)
        if warm == 0.0:
            chains = [_chain(work, best.route, aim, capacity, waypoint_m) for _ in chains]
        # Where coverage is dearer than its price, the price rises until the goal is worth reaching.
        price *= 1.0 if judged >= goal else _DEARER**steps
        for chain in chains:
            chain.prices = chain.prices._replace(coverage=price, goal=aim)
        warm = stage
    return out


def _thinned(goals: Sequence[float], most: int) -> Sequence[float]:
    """At most so many of the goals, one at least, evenly from the lowest to the highest."""
    if len(goals) <= most:
        return goals
    return [goals[k] for k in np.unique(np.linspace(0, len(goals) - 1, max(most, 1)).round().astype(int))]


def _long_stages(stages: Sequence[float], least: float) -> list[tuple[float, int]]:
    """The stages without those that are shorter than ``least``, a share of all of them; the last one, 1, stays.

    With each, how many of the stages end with it.
    """
    kept: list[tuple[float, int]] = []
    begun, steps = 0.0, 0
    for stage in stages:
        steps += 1
        if stage == stages[-1] or (stage - begun >= least and stages[-1] - stage >= least):
            kept.append((stage, steps))
            begun, steps = stage, 0
    return kept


def _corrected(goal: float, seen: float, judged: float) -> float:
    """The goal on the search's cells, corrected by how a route's coverage there differs from its judged coverage."""
    return min(1.0, max(0.0, seen + goal + SAFETY - judged))


def best_starts(
    problem: RouteProblem, starts: Sequence[SearchStart], goal: float, waypoint_m: float = 0.0
) -> list[SearchStart]:
    """The beginnings for a goal, the best first.

    Args:
        problem: what is looked at.
        starts: of any coverage.
        goal: share of what can be covered.
        waypoint_m: a price of waypoints beside that of the cost.
    """
    return sorted(starts, key=lambda start: _merit(problem, start, goal, waypoint_m))


def _merit(problem: RouteProblem, start: SearchStart, goal: float, waypoint_m: float) -> tuple[bool, float]:
    """Smallest for the best start; where the order is free, any route that reaches the goal ranks before those that do not."""
    missing = max(0.0, goal - start.seen)
    with_waypoints = 1.0 + waypoint_m * len(start.route) / max(start.route.length_m, problem.reach_m)
    return problem.free_order and missing > 0.0, problem.cost(start.route) * with_waypoints * (
        1.0 + _START_PRICE * missing
    )


def _chain(work: Work, route: Route, goal: float, capacity: int, waypoint_m: float) -> Chain:
    metres = work.problem.metres_per_cost(route)
    way_m = max(metres * work.problem.cost(route), work.problem.reach_m)
    free = work.problem.free_order
    cells = np.count_nonzero(work.problem.numbers.weight)
    fewest = 1 if work.problem.free_order else 2
    state = state_of(work.problem, route, capacity=capacity)
    return Chain(
        problem=work.problem,
        state=state,
        prices=Prices(
            metres,
            waypoint_m,
            _COVERAGE_PRICE_FREE * work.problem.reach_m * cells
            if free
            else _COVERAGE_PRICE * (way_m + _DEAR_WAYPOINTS * waypoint_m * len(route)),
            goal,
        ),
        hottest=(_HOTTEST_FREE if free else _HOTTEST) * work.problem.reach_m + _HOTTEST_OF_WAYPOINT * waypoint_m,
        coldest=_COLDEST * work.problem.reach_m,
        step_m=_LARGEST_STEP * work.problem.reach_m,
        fewest=fewest,
        most=max(capacity, fewest),
    )


PRICES = (0.3, 1.0, 3.0)
"""Of a waypoint, in radii of the sensor."""

_WAYPOINT_STAGES = (0.4, 0.8, 1.0)


def search_waypoints(
    work: Work,
    starts: Sequence[SearchStart],
    *,
    goal: float,
    capacity: int,
    until: float,
    judge: RouteJudge,
) -> list[SearchStart]:
    """Find routes that reach a goal with ever fewer waypoints.

    Args:
        work: what is looked at, and how much may be done.
        starts: one at least; long ones of few waypoints are good for the higher prices.
        goal: share of what can be covered.
        capacity: most waypoints.
        until: share of all the work, 0..1, after which this search ends.
        judge: judges what is found.
    """
    begin = work.pace.fraction
    each = (until - begin) / len(PRICES)
    known = list(starts)
    for number, price in enumerate(PRICES):
        share = (begin + number * each, begin + (number + 1) * each)
        known += search_goal(
            work, known, goal, capacity, share, _WAYPOINT_STAGES, judge, waypoint_price=price
        )  # fmt: skip
    return known
