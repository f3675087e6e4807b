"""Simplification of a route: takes out the waypoints that it can do without, and merges two into one.

A waypoint may go when the limits hold without it, the cost does not rise and enough is seen. The annealing proposes the same
changes at random; here every waypoint gets its turn, however many there are.
"""

from uavcover.kernels.jit import kernel
from uavcover.kernels.route_state import RouteState, exchange_allowed, keep_exchange, try_exchange
from uavcover.kernels.route_state_cost import exchange_cost
from uavcover.kernels.search_problem import SearchProblem, place


def take_out(problem: SearchProblem, state: RouteState, fewest: int, least_seen: float, most_lost: float) -> int:
    """Try once to take out every waypoint, from the last to the first.

    Args:
        problem: what is looked at.
        state: counted; is changed.
        fewest: waypoints that stay at least.
        least_seen: weight, 0..1, that the route sees afterwards at least.
        most_lost: weight, 0..1, that one change may lose at most.

    Returns:
        how many waypoints are gone.
    """
    return _with_fewer(problem, state, 1, fewest, least_seen, most_lost)


def merge(problem: SearchProblem, state: RouteState, fewest: int, least_seen: float, most_lost: float) -> int:
    """Try once to replace every two neighbours by the place between them; as :func:`take_out`."""
    return _with_fewer(problem, state, 2, fewest, least_seen, most_lost)


@kernel
def _with_fewer(
    problem: SearchProblem, state: RouteState, count: int, fewest: int, least_seen: float, most_lost: float
) -> int:
    """Replace every ``count`` neighbours, 1 or 2, by one fewer where it is worth it; how many waypoints are gone."""
    before, fresh = state.size[0], count - 1
    for first in range(before - count, -1, -1):
        last = first + count
        if state.size[0] <= fewest or last > state.size[0]:
            continue
        if fresh > 0:
            pe, pn, pu = place(state.route, first)
            qe, qn, qu = place(state.route, first + 1)
            state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = 0.5 * (pe + qe), 0.5 * (pn + qn), 0.5 * (pu + qu)
        if exchange_cost(problem, state, first, last, fresh) > 0.0 or not exchange_allowed(
            problem, state, first, last, fresh
        ):
            continue
        gained, new = try_exchange(problem, state, first, last, fresh)
        if new >= 0 and gained >= -most_lost and state.seen[0] + gained >= least_seen:
            keep_exchange(problem, state, first, last, fresh, new, gained)
    return int(before - state.size[0])
