"""Local search for the shortest route that reaches a coverage, and for routes of few waypoints.

For few waypoints, the price of a waypoint rises step by step, at the cost of a longer path.
"""

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.annealing import Prices
from uavcover.model.route import Route
from uavcover.planning.search.local_search import CHAINS, Chain, Work
from uavcover.planning.search.route_problem import RouteProblem, state_of
from uavcover.planning.search.tuning import TUNED, GoalTuning

LADDER = (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.0)
"""Goals that are searched for besides the one that is asked for, so that there is something to choose from."""

SAFETY = 0.0003
"""Share of the coverage by which a route is to reach more than its goal on the finest cells: other cells see less."""

_ROUNDING = 1e-9


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
        coverage: share of what can be covered that a route sees, on the cells it is judged on; exact where it may reach the goal,
            which it is given.
        found: told every route worth judging.
        closed: a route and what else has to be flown to reach a goal on those cells; none where that is too much to find out.
            It is told how to ask whether there is no time left for it.
    """

    coverage: Callable[[Route, float], float]
    found: Callable[[Route], None]
    closed: Callable[[Route, float, Callable[[], bool]], Route | None] = lambda _route, _goal, _is_over: None


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
    begin, tuned = work.pace.fraction, work.tuning.goal
    goals: Sequence[float] = [goal for goal in LADDER if asked is None or abs(goal - asked) > 0.002]
    main = 0.0 if asked is None else tuned.main_share
    known = list(starts)
    if asked is not None:
        end = begin + main * (until - begin)
        found = search_goal(
            work, known, asked, capacity, (begin, end), tuned.main_stages, judge, most_short=tuned.most_short_at_first
        )
        price, with_closing = None, min(work.pace.fraction, end) + tuned.closing_share * (until - begin)
        closed = _closed(work, found, asked, judge, until=with_closing)
        if closed is None:
            with_closing += (tuned.closing_share_far - tuned.closing_share) * (until - begin)
            closed = _closed_beginning(work, starts, found, asked, judge, until=with_closing)
            price = None if closed is None else tuned.dear_ground * _price_between(work.problem, found[-1], closed)
        known += found
        if closed is not None:
            judge.found(closed.route)
        if closed is not None and len(closed.route) <= capacity:
            main += tuned.closing_share
            after, end = min(work.pace.fraction, end), begin + main * (until - begin)
            stages = tuned.stages if price is None else tuned.main_stages
            again = search_goal(
                work, [closed], asked, capacity, (after, end), stages, judge, closed=True, coverage_price=price
            )
            known += again
            # Cells of the search may see all where those that judge lack a few.
            last = _closed(
                work, again, asked, judge, until=end + tuned.closing_share * (until - begin),
                least_short=0 if price is None else tuned.most_closed_after,
            )  # fmt: skip
            if last is not None:
                judge.found(last.route)
            if last is not None and len(last.route) <= capacity:
                known.append(last)
        elif end - work.pace.fraction > _ROUNDING:
            known += search_goal(work, known, asked, capacity, (work.pace.fraction, end), tuned.main_stages, judge)
    ladder = (1.0 - main) * (until - begin)
    goals = _thinned(goals, _most_goals(work, ladder))
    each = ladder / len(goals)
    # From the highest: what reaches more is a good beginning for what may see less.
    for number, goal in enumerate(reversed(goals)):
        at = until - ladder + number * each
        known += search_goal(work, known, goal, capacity, (at, at + each), tuned.stages, judge)
    return known


def _closed(
    work: Work,
    found: Sequence[SearchStart],
    goal: float,
    judge: RouteJudge,
    *,
    until: float,
    least_short: int = 0,
) -> SearchStart | None:
    """What a search ended with and its gaps closed, where it ends short of its goal and some of the work is left for it.

    Where nearly everything is to be seen, gaps are dear: then the ends of all its stages are tried, and the cheapest counts. The
    ``least_short`` ends that lack least are tried in any case.
    """

    def is_over() -> bool:
        return work.pace.fraction >= until

    if not found or work.stopped or is_over():
        return None
    tuned = work.tuning.goal
    ends: list[SearchStart] = []
    ends_of_stages = list(reversed(found if goal > tuned.nearly_all else found[-1:]))
    near = sorted(found, key=lambda each: -judge.coverage(each.route, goal))[:least_short] if least_short else []
    for each in dict.fromkeys([*near, *ends_of_stages]):
        if is_over():
            break
        short = goal - judge.coverage(each.route, goal)
        if short <= 0.0:
            return None
        closed = judge.closed(each.route, goal + SAFETY, is_over) if short <= tuned.most_short else None
        if closed is not None:
            ends.append(SearchStart(closed, each.seen + short))
    return min(ends, key=lambda end: work.problem.cost(end.route), default=None)


def _closed_beginning(
    work: Work,
    starts: Sequence[SearchStart],
    found: Sequence[SearchStart],
    goal: float,
    judge: RouteJudge,
    *,
    until: float,
) -> SearchStart | None:
    """A beginning that sees enough, or the cheapest of those that see most, their gaps closed.

    None where a search did not end far from its goal.

    On ground whose last part is dear, such as the walls of a canyon, a search from a short beginning loses what it sees there,
    and long lines are the better beginning.
    """

    def is_over() -> bool:
        return work.pace.fraction >= until

    if not found or work.stopped or is_over() or work.problem.free_order:
        return None
    tuned, before = work.tuning.goal, judge.coverage(found[-1].route, goal)
    if goal - before <= tuned.most_short:
        return None
    different = {each.route.length_m: each for each in starts}.values()
    most = sorted(different, key=lambda each: -each.seen)[: tuned.most_beginnings]
    # Those that may see enough by themselves come first, the cheapest of them before the others.
    cheapest = sorted((each for each in different if each.seen >= goal), key=lambda each: work.problem.cost(each.route))
    judged: list[tuple[float, SearchStart]] = []
    for each in dict.fromkeys([*cheapest[: tuned.most_beginnings], *most]):
        if is_over():
            return None
        judged.append((judge.coverage(each.route, goal), each))
        if judged[-1][0] >= goal:
            return each
    judged = [one for one in judged if one[0] >= goal - tuned.most_short_beginning] or [(before, found[-1])]
    ends: list[SearchStart] = []
    for tried, (seen, each) in enumerate(sorted(judged, key=lambda item: -item[0])):
        if is_over() or (ends and tried >= tuned.most_closed):
            break
        route = judge.closed(each.route, goal + SAFETY, is_over)
        if route is not None:
            ends.append(SearchStart(route, min(1.0, each.seen + max(0.0, goal - seen))))
    return min(ends, key=lambda end: work.problem.cost(end.route), default=None)


def _price_between(problem: RouteProblem, less: SearchStart, more: SearchStart) -> float:
    """What all coverage costs at the rate between two routes, in lengths of the one that sees more."""
    cost = problem.cost(more.route)
    return max(0.0, cost - problem.cost(less.route)) / (max(cost, 1e-12) * max(more.seen - less.seen, 1e-3))


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
    closed: bool = False,
    coverage_price: float | None = None,
    most_short: float = 1.0,
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
        closed: the beginning is a route whose gaps were closed, because a search ended short of the goal: it is to get shorter,
            and where nearly everything is to be seen, not to open them again.
        coverage_price: of all coverage, in lengths of the route, where it is dearer than by default.
        most_short: by so much the first stage may miss the goal; by more, and the search ends there.

    Returns:
        What the stages ended with: beginnings for other goals.
    """
    begin, end = share
    tuned, free_order = work.tuning.goal, work.tuning.free_order
    aim = min(1.0, goal + SAFETY)
    dear = tuned.nearly_all_price if goal > tuned.nearly_all else tuned.coverage_price
    dear = max(dear, 0.0 if coverage_price is None else coverage_price)
    waypoint_m = (tuned.waypoint_price if waypoint_price is None else waypoint_price) * work.problem.reach_m
    ranked_by_m = 0.0 if waypoint_price is None else waypoint_m
    ranked = best_starts(work.problem, starts, goal, ranked_by_m, tuned)
    if work.stopped or work.pace.fraction >= end:
        return []
    before = work.pace.fraction
    chains = [_chain(work, ranked[k % len(ranked)].route, aim, capacity, waypoint_m, dear) for k in range(CHAINS)]
    for chain in chains:
        if closed and goal > tuned.nearly_all and not work.problem.free_order:
            chain.hottest *= tuned.closed_heat
            chain.prices = chain.prices._replace(coverage=tuned.closed_dearer * chain.prices.coverage)
        aim = _corrected(goal, chain.seen, judge.coverage(chain.route, goal))
        chain.prices = chain.prices._replace(goal=aim)
    # Two routes were judged; a correction judges one.
    work.correction = 0.5 * (work.pace.fraction - before)
    least = tuned.stage_per_correction * work.correction / max(end - begin, 1e-9)
    hottest, coldest = chains[0].hottest, chains[0].coldest
    if work.problem.free_order:
        for chain in chains:
            chain.hottest = free_order.quenched * coldest
        work.run(chains, until=begin + free_order.quench * (end - begin))
        for chain in chains:
            judge.found(chain.route)
    price = max(chain.prices.coverage for chain in chains)
    out: list[SearchStart] = []
    reached, warm = closed, 0.0
    for stage, steps in _long_stages(stages, least):
        for k, chain in enumerate(chains):
            # The second of two chains from the same beginning is cooler: from a good one heat only leads away.
            cooler = tuned.second_chain**k if out else 1.0
            chain.hottest = max(coldest, cooler * hottest * (coldest / hottest) ** warm)
            chain.coldest = max(coldest, cooler * hottest * (coldest / hottest) ** stage)
        more = work.run(chains, until=begin + stage * (end - begin))
        best = min(chains, key=lambda chain: chain.energy)
        before = work.pace.fraction
        judged = judge.coverage(best.route, goal)
        # The first time all cells were made ready for judging: later corrections are cheaper.
        work.correction = work.pace.fraction - before
        out.append(SearchStart(best.route, best.seen))
        if goal - judged > most_short and len(out) == 1 and not work.problem.free_order:
            judge.found(best.route)
            break
        if judged >= goal or not more or stage == stages[-1]:
            reached = reached or judged >= goal
            if judged >= goal or not reached:
                judge.found(best.route)
        if not more or work.stopped:
            break
        aim = _corrected(goal, best.seen, judged)
        if warm == 0.0:
            chains = [_chain(work, best.route, aim, capacity, waypoint_m, dear) for _ in chains]
        # Where coverage is dearer than its price, the price rises until the goal is worth reaching.
        price *= 1.0 if judged >= goal else tuned.dearer**steps
        for chain in chains:
            chain.prices = chain.prices._replace(coverage=price, goal=aim)
        warm = stage
    return out


def _most_goals(work: Work, share: float) -> int:
    """How many goals there is time for in a share of all the work: each judges routes, and that should be the least of it."""
    return int(share / max(work.tuning.goal.goal_per_correction * work.correction, 1e-9))


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


def starts_worth_looking_at(
    problem: RouteProblem,
    routes: Sequence[Route],
    goal: float,
    share_seen: Callable[[Route], float],
    tuned: GoalTuning = TUNED.goal,
) -> list[SearchStart]:
    """Routes as beginnings for a goal, without those that are too dear for :func:`best_starts` whatever they see.

    Finding out what a route sees takes long on many cells. Missing coverage only adds to its cost: routes are looked at from the
    cheapest on, until the next one costs more than the best come to, as many as there are chains.

    Args:
        problem: what is looked at.
        routes: of any coverage.
        goal: share of what can be covered.
        share_seen: share of what can be covered that a route sees.
        tuned: has the price of what is missing.

    Returns:
        Beginnings in the order of the routes; the best CHAINS of all are among them.
    """
    costs = [problem.cost(route) for route in routes]
    looked: dict[int, SearchStart] = {}
    merits: list[float] = []
    for k in sorted(range(len(routes)), key=costs.__getitem__):
        if not problem.free_order and len(merits) >= CHAINS and costs[k] > merits[CHAINS - 1]:
            break
        looked[k] = SearchStart(routes[k], share_seen(routes[k]))
        bisect.insort(merits, _merit(problem, looked[k], goal, 0.0, tuned)[1])
    return [looked[k] for k in sorted(looked)]


def best_starts(
    problem: RouteProblem,
    starts: Sequence[SearchStart],
    goal: float,
    waypoint_m: float = 0.0,
    tuned: GoalTuning = TUNED.goal,
) -> list[SearchStart]:
    """The beginnings for a goal, the best first.

    Args:
        problem: what is looked at.
        starts: of any coverage.
        goal: share of what can be covered.
        waypoint_m: a price of waypoints beside that of the cost.
        tuned: has the price of what is missing.
    """
    return sorted(starts, key=lambda start: _merit(problem, start, goal, waypoint_m, tuned))


def _merit(
    problem: RouteProblem, start: SearchStart, goal: float, waypoint_m: float, tuned: GoalTuning
) -> tuple[bool, float]:
    """Smallest for the best start; where the order is free, any route that reaches the goal ranks before those that do not."""
    with_waypoints = 1.0 + waypoint_m * len(start.route) / max(start.route.length_m, problem.reach_m)
    cost = problem.cost(start.route) * with_waypoints
    return problem.free_order and start.seen < goal, tuned.start_cost(cost, goal - start.seen)


def _chain(work: Work, route: Route, goal: float, capacity: int, waypoint_m: float, coverage_price: float) -> Chain:
    tuned, free_order = work.tuning.goal, work.tuning.free_order
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
            free_order.tour_coverage_price * work.problem.reach_m * cells
            if free
            else coverage_price * (way_m + tuned.dear_waypoints * waypoint_m * len(route)),
            goal,
        ),
        hottest=(free_order.tour_hottest if free else tuned.hottest) * work.problem.reach_m
        + tuned.hottest_of_waypoint * waypoint_m,
        coldest=tuned.coldest * work.problem.reach_m,
        step_m=tuned.largest_step * work.problem.reach_m,
        fewest=fewest,
        most=max(capacity, fewest),
    )


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
    begin, tuned = work.pace.fraction, work.tuning.goal
    prices = _thinned(tuned.waypoint_prices, _most_goals(work, until - begin))
    each = (until - begin) / len(prices)
    known = list(starts)
    for number, price in enumerate(prices):
        share = (begin + number * each, begin + (number + 1) * each)
        known += search_goal(
            work, known, goal, capacity, share, tuned.waypoint_stages, judge, waypoint_price=price
        )  # fmt: skip
    return known
