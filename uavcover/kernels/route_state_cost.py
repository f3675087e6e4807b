"""Changes of a route's cost, and the simplification of routes that uses them.

The cost is the length in metres, or time or energy with wind, climbs and turns, plus the penalty for waypoints. Length has its
own fast path, because the search for the shortest route computes it tens of thousands of times a second.

Simplification removes waypoints that a route does not need, and merges two into one. A waypoint can be removed if the limits hold
without it, the cost does not rise and the coverage suffices. The annealing proposes the same changes at random; here every
waypoint gets its turn.
"""

from uavcover.kernels.jit import kernel
from uavcover.kernels.path_cost import LENGTH, PathCost, route_cost, stretch_cost
from uavcover.kernels.route_state import RouteState, exchange_allowed, exchange_length, keep_exchange, try_exchange
from uavcover.kernels.search_problem import SearchProblem, distance, position


@kernel
def is_length(path_cost: PathCost) -> bool:
    """Whether the cost is the length, and a price for every waypoint."""
    return path_cost.unit == LENGTH and path_cost.deviation_price == 0.0


@kernel
def exchange_cost(problem: SearchProblem, state: RouteState, first: int, last: int, fresh: int) -> float:
    """Change of cost when waypoints first..last - 1 are replaced by the first ``fresh`` of state.fresh."""
    if is_length(problem.path_cost):
        more = fresh - (last - first)
        return exchange_length(state, first, last, fresh) + problem.path_cost.waypoint_price * more
    # Turns change up to one waypoint farther away than legs do.
    begin, end = max(first - 2, 0), min(last + 2, state.size[0])
    new = state.stretch[: end - begin + fresh - (last - first)]
    for k in range(new.shape[0]):
        number = begin + k
        if number < first:
            new[k, 0], new[k, 1], new[k, 2] = position(state.route, number)
        elif number < first + fresh:
            new[k, 0], new[k, 1], new[k, 2] = position(state.fresh, number - first)
        else:
            new[k, 0], new[k, 1], new[k, 2] = position(state.route, number - fresh + last - first)
    changed = stretch_cost(problem.surface, problem.path_cost, new, begin == 0, end == state.size[0])
    return changed - _stretch_cost(problem, state, begin, end)


@kernel
def reversal_cost(problem: SearchProblem, state: RouteState, i: int, j: int) -> float:
    """Change of cost when waypoints i..j are reversed; O(j - i) with wind or turns."""
    n = state.size[0]
    if is_length(problem.path_cost):
        p, q = position(state.route, i), position(state.route, j)
        longer = 0.0
        if i > 0:
            before = position(state.route, i - 1)
            longer += distance(before, q) - distance(before, p)
        if j < n - 1:
            behind = position(state.route, j + 1)
            longer += distance(p, behind) - distance(q, behind)
        return longer
    begin, end = max(i - 2, 0), min(j + 3, n)
    new = state.stretch[: end - begin]
    for k in range(begin, end):
        new[k - begin, 0], new[k - begin, 1], new[k - begin, 2] = position(state.route, i + j - k if i <= k <= j else k)
    changed = stretch_cost(problem.surface, problem.path_cost, new, begin == 0, end == n)
    return changed - _stretch_cost(problem, state, begin, end)


@kernel
def transfer_cost(problem: SearchProblem, state: RouteState, at: int, to: int) -> float:
    """Change of cost if waypoint ``at`` is removed and state.fresh[0] inserted before waypoint ``to``.

    Numbers count the route before the change.
    """
    n = state.size[0]
    p = position(state.fresh, 0)
    if is_length(problem.path_cost):
        longer = _shortcut_length(state, at)
        before = to - 1 if to - 1 != at else to - 2
        if before >= 0:
            longer += distance(position(state.route, before), p)
        if to < n:
            longer += distance(p, position(state.route, to))
            if before >= 0:
                longer -= distance(position(state.route, before), position(state.route, to))
        return longer
    new = state.stretch[:n]
    row = 0
    for k in range(n + 1):
        if k == to:
            new[row, 0], new[row, 1], new[row, 2] = p
            row += 1
        if k < n and k != at:
            new[row, 0], new[row, 1], new[row, 2] = position(state.route, k)
            row += 1
    return route_cost(problem.surface, problem.path_cost, new) - _stretch_cost(problem, state, 0, n)


@kernel
def _shortcut_length(state: RouteState, at: int) -> float:
    """Change of length when a waypoint is left out."""
    n = state.size[0]
    p = position(state.route, at)
    change = 0.0
    if at > 0:
        change -= distance(position(state.route, at - 1), p)
    if at < n - 1:
        change -= distance(p, position(state.route, at + 1))
        if at > 0:
            change += distance(position(state.route, at - 1), position(state.route, at + 1))
    return change


@kernel
def _stretch_cost(problem: SearchProblem, state: RouteState, begin: int, end: int) -> float:
    """Current cost of waypoints begin..end - 1."""
    return stretch_cost(problem.surface, problem.path_cost, state.route[begin:end], begin == 0, end == state.size[0])


def take_out(problem: SearchProblem, state: RouteState, fewest: int, least_coverage: float, most_lost: float) -> int:
    """Try once to remove every waypoint, from the last to the first.

    Args:
        problem: the problem.
        state: counted; modified in place.
        fewest: smallest number of waypoints that remain.
        least_coverage: smallest observed weight afterwards, 0..1.
        most_lost: largest weight, 0..1, that one change may lose.

    Returns:
        number of removed waypoints.
    """
    return _with_fewer(problem, state, 1, fewest, least_coverage, most_lost)


def merge(problem: SearchProblem, state: RouteState, fewest: int, least_coverage: float, most_lost: float) -> int:
    """Try once to replace every two neighbours by the place between them; as :func:`take_out`."""
    return _with_fewer(problem, state, 2, fewest, least_coverage, most_lost)


@kernel
def _with_fewer(
    problem: SearchProblem, state: RouteState, count: int, fewest: int, least_coverage: float, most_lost: float
) -> int:
    """Replace every ``count`` neighbours, 1 or 2, by one fewer where it is worth it; how many waypoints are gone."""
    before, fresh = state.size[0], count - 1
    for first in range(before - count, -1, -1):
        last = first + count
        if state.size[0] <= fewest or last > state.size[0]:
            continue
        if fresh > 0:
            pe, pn, pu = position(state.route, first)
            qe, qn, qu = position(state.route, first + 1)
            state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = 0.5 * (pe + qe), 0.5 * (pn + qn), 0.5 * (pu + qu)
        if exchange_cost(problem, state, first, last, fresh) > 0.0 or not exchange_allowed(
            problem, state, first, last, fresh
        ):
            continue
        gained, new = try_exchange(problem, state, first, last, fresh)
        if new >= 0 and gained >= -most_lost and state.observed[0] + gained >= least_coverage:
            keep_exchange(problem, state, first, last, fresh, new, gained)
    return int(before - state.size[0])
