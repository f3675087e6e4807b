"""Simplification of a route: takes out the waypoints that it can do without, and merges two into one.

A waypoint may go when the limits hold without it, the cost does not rise and enough is seen. The annealing proposes the same
changes at random; here every waypoint gets its turn, however many there are.
"""

from uavcover.kernels.jit import kernel
from uavcover.kernels.route_state import RouteState, exchange_allowed, keep_exchange, try_exchange
from uavcover.kernels.route_state_cost import exchange_cost
from uavcover.kernels.search_problem import SearchProblem, place


@kernel
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
    before = state.size[0]
    for k in range(before - 1, -1, -1):
        if state.size[0] > fewest:
            _exchange(problem, state, k, k + 1, least_seen, most_lost)
    return int(before - state.size[0])


@kernel
def merge(problem: SearchProblem, state: RouteState, fewest: int, least_seen: float, most_lost: float) -> int:
    """Try once to replace every two neighbours by the place between them; as :func:`take_out`."""
    before = state.size[0]
    for k in range(before - 2, -1, -1):
        if state.size[0] > fewest and k + 1 < state.size[0]:
            pe, pn, pu = place(state.route, k)
            qe, qn, qu = place(state.route, k + 1)
            state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = 0.5 * (pe + qe), 0.5 * (pn + qn), 0.5 * (pu + qu)
            _exchange(problem, state, k, k + 2, least_seen, most_lost)
    return int(before - state.size[0])


@kernel
def _exchange(
    problem: SearchProblem, state: RouteState, first: int, last: int, least_seen: float, most_lost: float
) -> bool:
    """Replace waypoints first..last - 1 by one fewer of state.fresh; whether it was worth it.

    Their number is computed, because numba compiles a version of all that it calls for each number that it reads.
    """
    fresh = last - first - 1
    if exchange_cost(problem, state, first, last, fresh) > 0.0 or not exchange_allowed(
        problem, state, first, last, fresh
    ):
        return False
    gained, new = try_exchange(problem, state, first, last, fresh)
    if new < 0 or gained < -most_lost or state.seen[0] + gained < least_seen:
        return False
    keep_exchange(problem, state, first, last, fresh, new, gained)
    return True
