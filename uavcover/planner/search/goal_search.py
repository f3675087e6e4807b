"""Local search for the shortest route with a given coverage, and for routes with few waypoints.

For few waypoints, the penalty per waypoint rises step by step, at the cost of a longer path.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from uavcover.kernels.annealing import Weights
from uavcover.model.route import Route
from uavcover.planner.search.local_search import CHAINS, Chain, SearchStart, Work, best_starts, starts_of_chains
from uavcover.planner.search.repair import penalty_between, repaired_end, repaired_start
from uavcover.planner.search.route_problem import RouteJudge, state_of, with_safety

LADDER = (0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.0)
"""Goals besides the required coverage, so that there is a choice."""

_ROUNDS, _SUREST = 3, 3
"""Rounds of a search on the finest cells, and beginnings that are judged for it besides the ends of the search before."""

_ROUNDING = 1e-9


def search_goals(
    work: Work,  # the problem and the remaining budget
    starts: Sequence[SearchStart],  # one at least
    *,
    required: float | None,  # required coverage of the visible ground, if any
    capacity: int,  # most waypoints
    until: float,  # fraction of all the work, 0..1, after which this search ends
    judge: RouteJudge,  # judges what is found; goals on the planner's cells are corrected by it
) -> list[SearchStart]:
    """Find the shortest routes for the goals of the ladder, mainly for the required coverage.

    Returns:
        The initial solutions, and the ends of the stages.
    """
    begin, tuned = work.pace.fraction, work.tuning.goal
    goals: Sequence[float] = [goal for goal in LADDER if required is None or abs(goal - required) > 0.002]
    known = list(starts)
    if required is not None:
        end = begin + tuned.main_fraction * (until - begin)
        finest = required > tuned.nearly_all and work.finest is not None and not work.problem.free_order
        middle = begin + (tuned.coarse_fraction if finest else 1.0) * (end - begin)
        # What the search's cells lack of nearly all they cannot show: their price would only drive the route into detours.
        stages = (1.0,) if finest and work.problem.numbers.trigger_m == 0.0 else tuned.main_stages
        later = end + tuned.repair_fraction * (until - begin)
        before = work.pace.fraction, work.proposals
        found = search_goal(
            work, known, required, capacity, (begin, middle), stages, judge,
            most_short=tuned.most_short_at_first, later=0.0 if finest else later,
        )  # fmt: skip
        if finest and not _can_afford_finest(work, before, end):
            finest = False
            found += search_goal(
                work, [*known, *found], required, capacity, (work.pace.fraction, end), tuned.main_stages, judge,
                most_short=tuned.most_short_at_first, later=later,
            )  # fmt: skip
        if finest:
            surest = _surest(work, starts, required)
            found += _on_finest_cells(work, [*found, *surest], required, capacity, (middle, end), judge)
        repair = tuned.repair_fraction_far if finest else tuned.repair_fraction
        with_repair = min(work.pace.fraction, end) + repair * (until - begin)
        closed = repaired_end(work, found, required, judge, until=with_repair)
        from_start = closed is None
        if closed is None:
            with_repair += (tuned.repair_fraction_far - repair) * (until - begin)
            closed = repaired_start(work, starts, found, required, judge, until=with_repair, at_last=until)
        known += found
        if closed is not None:
            judge.found(closed.route)
        if closed is not None and len(closed.route) <= capacity:
            again, end = search_from_closed(
                work, closed, found[-1], required, capacity, (end, until), tuned.repair_fraction * (until - begin), judge,
                finest=finest, from_start=from_start,
            )  # fmt: skip
            known += again
        elif end - work.pace.fraction > _ROUNDING:
            known += search_goal(work, known, required, capacity, (work.pace.fraction, end), tuned.main_stages, judge)
    else:
        end = begin
    ladder = until - end
    goals = _thinned(goals, _most_goals(work, ladder))
    each = ladder / len(goals)
    # From the highest: what reaches more is a good beginning for what may observe less.
    for number, goal in enumerate(reversed(goals)):
        at = until - ladder + number * each
        known += search_goal(work, known, goal, capacity, (at, at + each), tuned.stages, judge)
    return known


def _can_afford_finest(work: Work, before: tuple[float, int], end: float) -> bool:
    """Whether the finest cells leave time for enough proposals, at the speed of the search so far.

    Args:
        work: the problem and the remaining budget.
        before: fraction of all the work, and proposals, before the search on the coarser cells.
        end: fraction of all the work at which the search on the finest cells ends.
    """
    (fraction, proposals), now = before, work.pace.fraction
    each = (now - fraction) / max(work.proposals - proposals, 1)
    return end - now >= work.tuning.goal.fewest_on_finest * work.finest_time_factor * each


def search_from_closed(
    work: Work, closed: SearchStart, short: SearchStart, goal: float, capacity: int, fraction: tuple[float, float],
    each: float, judge: RouteJudge, *, finest: bool, from_start: bool,
) -> tuple[list[SearchStart], float]:  # fmt: skip
    """Search from a route with closed gaps, and again if that ends short of the goal.

    Args:
        work: the problem and the remaining budget.
        closed: a route with closed gaps.
        short: the end that it was made from, or that it replaced.
        goal: fraction of the visible ground.
        capacity: largest number of waypoints.
        fraction: of all the work: the end of the previous search, and the end of the last of these.
        each: share of all the work for each of them, even if closing the gaps took longer.
        judge: evaluates routes, and closes their gaps.
        finest: whether to search the finest cells.
        from_start: whether the closed route was an initial solution.

    Returns:
        The ends of the stages, and the share of all the work at which the last one ends.
    """
    tuned, (end, until), out = work.tuning.goal, fraction, list[SearchStart]()
    end += each
    stages = tuned.main_stages if from_start else tuned.stages
    for _ in range(tuned.closed_again):
        end = min(until, max(end, work.pace.fraction + each))
        fraction = min(work.pace.fraction, end), end
        if finest:
            again = _on_finest_cells(work, [closed], goal, capacity, fraction, judge)
        else:
            # With the previous penalty, the search would open the gaps again; above ``nearly_all``, the penalty is high
            # anyway.
            penalty = None
            if from_start or goal <= tuned.nearly_all:
                penalty = min(tuned.most_penalty, tuned.costly_ground * penalty_between(work.problem, short, closed))
            again = search_goal(
                work, [closed], goal, capacity, fraction, stages, judge, closed=True, coverage_penalty=penalty
            )
        out += again
        # Cells of the search may observe all where those that judge lack a few.
        last = repaired_end(
            work, again, goal, judge, until=end + each, least_short=tuned.most_closed_after if from_start else 0
        )
        if last is None:
            break
        judge.found(last.route)
        if len(last.route) > capacity:
            break
        out.append(last)
        short, closed, stages = again[-1], last, tuned.stages
    return out, end


def _on_finest_cells(
    work: Work,
    found: Sequence[SearchStart],
    goal: float,
    capacity: int,
    fraction: tuple[float, float],
    judge: RouteJudge,
) -> list[SearchStart]:
    """Search for nearly all ground on the finest cells, from the best end and from the surest initial solution.

    The evaluation after each round makes observations count more or less surely. Each round is cooler, and missing coverage costs
    more while the search misses the goal.
    """
    coarse, tuned, out = work.problem, work.tuning.goal, list[SearchStart]()
    penalty, judged_ones, fresh = tuned.finest_penalty, list[tuple[SearchStart, float]](), list(found)

    def cheapest(penalty: float) -> tuple[SearchStart, float]:
        return min(
            judged_ones, key=lambda one: tuned.start_cost(coarse.cost(one[0].route), one[1], goal, penalty=penalty)
        )

    for number, (begin, end) in enumerate(itertools.pairwise(np.linspace(*fraction, _ROUNDS + 1).tolist())):
        judged_ones += [(each, judge.coverage(each.route, goal)) for each in fresh]
        if not judged_ones or work.stopped or work.finest is None or work.pace.fraction >= end:
            break
        if number > 0 and cheapest(penalty)[1] < goal:
            penalty *= tuned.finest_penalty_step
        (best, judged), (surest, _) = cheapest(penalty), cheapest(tuned.sure_penalty)
        work.problem = work.finest(best.route, judged)
        fresh = search_goal(
            work,
            [best] if surest is best else [best, surest],
            goal,
            capacity,
            (begin, end),
            tuned.stages,
            judge,
            closed=True,
            penalty_factor=penalty,
            heat_factor=tuned.closed_heat * tuned.finest_cooler**number,
        )
        out += fresh
    work.problem = coarse
    return out


def _surest(work: Work, starts: Sequence[SearchStart], goal: float) -> list[SearchStart]:
    """The initial solutions that are cheapest with a very high penalty for missing coverage."""
    tuned = work.tuning.goal

    def merit(each: SearchStart) -> float:
        return tuned.start_cost(work.problem.cost(each.route), each.observed, goal, penalty=tuned.sure_penalty)

    return sorted(starts, key=merit)[:_SUREST]


def search_goal(
    work: Work,  # the problem and the remaining budget
    starts: Sequence[SearchStart],  # one at least
    goal: float,  # fraction of the visible ground
    capacity: int,  # most waypoints
    fraction: tuple[float, float],  # of all the work, 0..1, where this search begins and ends
    stages: Sequence[float],  # fractions of this search's work after which the goal is corrected, the last is 1
    judge: RouteJudge,  # judges what is found
    *,
    # in radii of the sensor; beginnings are ranked by it too. By default almost nothing.
    waypoint_price: float | None = None,
    # the beginning is a route whose gaps were closed, because a search ended short of the goal: it is to get shorter, and
    # where nearly everything is to be observed, not to open them again
    closed: bool = False,
    # factor of the price of coverage where the beginning is closed and nearly everything is to be observed
    penalty_factor: float | None = None,
    heat_factor: float | None = None,  # factor of the temperature there
    coverage_penalty: float
    | None = None,  # of all coverage, in lengths of the route, where it is higher than by default
    most_short: float = 1.0,  # the first stage may miss the goal by this share; by more, and the search ends there
    # fraction of all the work until which further, short stages may follow while they get nearer to the goal
    later: float = 0.0,
) -> list[SearchStart]:
    """Search for one goal in stages.

    Each stage corrects the goal. After the first one, both chains continue from the better route.

    Returns:
        The ends of the stages, as initial solutions for other goals.
    """
    begin, end = fraction
    tuned, free_order = work.tuning.goal, work.tuning.free_order
    aim = with_safety(goal)
    penalty_of_goal = tuned.nearly_all_penalty if goal > tuned.nearly_all else tuned.coverage_penalty
    penalty_of_goal = max(penalty_of_goal, 0.0 if coverage_penalty is None else coverage_penalty)
    waypoint_m = (tuned.waypoint_price if waypoint_price is None else waypoint_price) * work.problem.reach_m
    ranked_by_m = 0.0 if waypoint_price is None else waypoint_m
    ranked = starts_of_chains(work.problem, best_starts(work.problem, starts, goal, ranked_by_m, tuned), goal, tuned)
    if work.stopped or work.pace.fraction >= end:
        return []
    before = work.pace.fraction
    # With a free order, one chain rebuilds. It is far better for single targets; the other is better if heights matter.
    rebuilt = [free_order.rebuilt if k == 0 else 0.0 for k in range(CHAINS)]
    chains = [
        _chain(work, ranked[k % len(ranked)].route, aim, capacity, waypoint_m, penalty_of_goal, rebuilt[k])
        for k in range(CHAINS)
    ]
    for chain in chains:
        if closed and goal > tuned.nearly_all and not work.problem.free_order:
            chain.hottest *= heat_factor or tuned.closed_heat
            chain.weights = chain.weights._replace(
                coverage=chain.weights.coverage * (penalty_factor or tuned.closed_costlier)
            )
        aim = _corrected(goal, chain.observed, judge.coverage(chain.route, goal))
        chain.weights = chain.weights._replace(goal=aim)
    # Two routes were judged; a correction judges one.
    work.correction = 0.5 * (work.pace.fraction - before)
    heated = chains if work.problem.free_order else [chains[0]] * CHAINS
    coldest, heats = chains[0].coldest, [chain.hottest for chain in heated]
    if work.problem.free_order:
        for chain in chains:
            chain.hottest = free_order.quenched * coldest
        work.run(chains, until=begin + free_order.quench * (end - begin))
        for chain in chains:
            judge.found(chain.route)
    penalty = max(chain.weights.coverage for chain in chains)
    out: list[SearchStart] = []
    reached, warm = closed, 0.0
    short, short_before = math.inf, math.inf
    longest = (later - begin) / max(end - begin, 1e-9)
    while True:
        least = tuned.stage_per_correction * work.correction / max(end - begin, 1e-9)
        if warm < stages[-1]:
            stage, steps = _next_stage(stages, warm, least)
        elif 0.0 < short <= tuned.further_left * short_before and 0.0 < least <= longest - warm:
            stage, steps = warm + least, 1
        else:
            break
        for k, (chain, hottest) in enumerate(zip(chains, heats, strict=True)):
            # The second of two chains from the same route is cooler, because heat leads away from a good route.
            cooler = tuned.second_chain**k if out else 1.0
            chain.hottest = max(coldest, cooler * hottest * (coldest / hottest) ** warm)
            chain.coldest = max(coldest, cooler * hottest * (coldest / hottest) ** stage)
        more = work.run(chains, until=begin + stage * (end - begin))
        best = min(chains, key=lambda chain: chain.energy)
        before = work.pace.fraction
        judged = judge.coverage(best.route, goal)
        # The first correction prepares all cells; later ones are cheaper.
        work.correction = work.pace.fraction - before
        out.append(SearchStart(best.route, best.observed))
        if goal - judged > most_short and len(out) == 1 and not work.problem.free_order:
            judge.found(best.route)
            break
        short, short_before = goal - judged, short
        if judged >= goal or not more or stage >= stages[-1]:
            reached = reached or judged >= goal
            if judged >= goal or not reached:
                judge.found(best.route)
        if not more or work.stopped:
            break
        aim = _corrected(goal, best.observed, judged)
        if warm == 0.0:
            chains = [
                _chain(work, best.route, aim, capacity, waypoint_m, penalty_of_goal, fraction) for fraction in rebuilt
            ]
        # Where coverage costs more than its price, the price rises until the goal is worth reaching.
        penalty *= tuned.penalty_rise(goal - judged) ** steps
        for chain in chains:
            chain.weights = chain.weights._replace(coverage=penalty, goal=aim)
        warm = stage
    return out


def _most_goals(work: Work, fraction: float) -> int:
    """Number of goals that fit a fraction of all work. Evaluating their routes should be the smallest part of it."""
    return int(fraction / max(work.tuning.goal.goal_per_correction * work.correction, 1e-9))


def _thinned(goals: Sequence[float], most: int) -> Sequence[float]:
    """At least one and at most ``most`` of the goals, evenly spaced from the lowest to the highest."""
    if len(goals) <= most:
        return goals
    return [goals[k] for k in np.unique(np.linspace(0, len(goals) - 1, max(most, 1)).round().astype(int))]


def _next_stage(stages: Sequence[float], begun: float, least: float) -> tuple[float, int]:
    """The next stage that takes at least ``least`` and leaves as much; otherwise the last one, 1.

    Also return the number of stages that it ends.
    """
    later = [stage for stage in stages if stage > begun]
    for steps, stage in enumerate(later, 1):
        if stage - begun >= least and stages[-1] - stage >= least:
            return stage, steps
    return later[-1], len(later)


def _corrected(goal: float, observed: float, judged: float) -> float:
    """The goal on the search's cells, corrected by the difference from the evaluated coverage of a route."""
    return min(1.0, max(0.0, observed + with_safety(goal) - judged))


def _chain(
    work: Work, route: Route, goal: float, capacity: int, waypoint_m: float, coverage_penalty: float, rebuilt: float
) -> Chain:
    tuned, free_order = work.tuning.goal, work.tuning.free_order
    metres = work.problem.metres_per_cost(route)
    metre_cost = max(metres * work.problem.cost(route), work.problem.reach_m)
    free = work.problem.free_order
    cells = np.count_nonzero(work.problem.numbers.weight)
    fewest = 1 if work.problem.free_order else 2
    heat = tuned.heat_of_length(metre_cost / work.problem.reach_m) if work.problem.is_of_length else tuned.hottest
    state = state_of(work.problem, route, capacity=capacity)
    return Chain(
        problem=work.problem,
        state=state,
        weights=Weights(
            metres,
            waypoint_m,
            max(free_order.tour_coverage_penalty * work.problem.reach_m, metre_cost if goal >= 1.0 else 0.0) * cells
            if free
            else coverage_penalty * (metre_cost + tuned.costly_waypoints * waypoint_m * len(route)),
            goal,
        ),
        hottest=(free_order.hottest_tour(rebuilt) if free else heat) * work.problem.reach_m
        + tuned.hottest_of_waypoint * waypoint_m,
        coldest=tuned.coldest * work.problem.reach_m,
        step_m=tuned.largest_step * work.problem.reach_m,
        fewest=fewest,
        most=max(capacity, fewest),
        rebuilt=rebuilt if free else 0.0,
    )


def search_waypoints(
    work: Work,  # the problem and the remaining budget
    starts: Sequence[SearchStart],  # one at least; long ones of few waypoints are good for the higher prices
    *,
    goal: float,  # fraction of the visible ground
    capacity: int,  # most waypoints
    until: float,  # fraction of all the work, 0..1, after which this search ends
    judge: RouteJudge,  # judges what is found
) -> list[SearchStart]:
    """Find routes that reach a goal with fewer and fewer waypoints."""
    begin, tuned = work.pace.fraction, work.tuning.goal
    prices = _thinned(tuned.waypoint_prices, _most_goals(work, until - begin))
    each = (until - begin) / len(prices)
    known = list(starts)
    for number, price in enumerate(prices):
        fraction = (begin + number * each, begin + (number + 1) * each)
        known += search_goal(
            work, known, goal, capacity, fraction, tuned.waypoint_stages, judge, waypoint_price=price
        )  # fmt: skip
    return known
