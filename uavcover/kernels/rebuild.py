"""Remove some neighbouring waypoints and insert others, if waypoints observe and their order is free.

Ruin and recreate (Schrimpf et al. 2000): cells that only the removed waypoints observed are observed again, one by one, from the
cheapest position. Then nearby waypoints are pulled straight: each moves to the best position between its neighbours from which it
still observes its own cells, and one without own cells is removed. Candidate positions come from discs around the cells with the
sensor's radius on level ground; the actual observations are counted before a waypoint moves.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, inlined_kernel, kernel
from uavcover.kernels.route_state import RouteState, exchange_allowed, keep_exchange, try_exchange
from uavcover.kernels.route_state_cost import exchange_cost
from uavcover.kernels.search_problem import SearchProblem, position
from uavcover.kernels.sight import CONE, FRUSTUM, SPHERE, Sight, horizontal_reach
from uavcover.kernels.surface import height_above, up_above

_MOST_REMOVED = 10
_AROUND = 0.6
"""Radii beyond the removed waypoints within which others are pulled straight."""

_MOST_CHANGES = 400
_PASSES = 3
_BLINK = 0.02
"""Fraction of the legs that an insertion overlooks, so that it is not always the same."""

_INSIDE = 1.0 - 1e-9
_LEAST_GAIN = 1e-3
"""Fraction of the radius; smaller moves are not worth their time."""

_SAMPLES = 12
_BISECTIONS = 30


@kernel
def radius_at(sight: Sight, above: float) -> float:
    """Radius on the map of the level ground that a sensor observes from a height, metres."""
    if sight.kind == SPHERE:
        return math.sqrt(max(0.0, sight.reach_m * sight.reach_m - above * above))
    if sight.kind == CONE:
        return min(horizontal_reach(sight), max(0.0, above) * sight.tan_half_fov)
    if sight.kind == FRUSTUM:
        return max(0.0, above) * min(sight.tan_half_fov, sight.tan_half_along)
    return sight.reach_m


@kernel
def _length_via(a: tuple[float, float], b: tuple[float, float], e: float, n: float) -> float:
    return math.hypot(a[0] - e, a[1] - n) + math.hypot(b[0] - e, b[1] - n)


@kernel
def _nearest_on_line(a: tuple[float, float], b: tuple[float, float], e: float, n: float) -> tuple[float, float]:
    """The place of the straight line a-b that is nearest to a place."""
    de, dn = b[0] - a[0], b[1] - a[1]
    length2 = de * de + dn * dn
    fraction = 0.0 if length2 == 0.0 else min(1.0, max(0.0, ((e - a[0]) * de + (n - a[1]) * dn) / length2))
    return a[0] + fraction * de, a[1] + fraction * dn


@kernel
def best_between(
    a: tuple[float, float], b: tuple[float, float], begin: tuple[float, float], discs: NDArray[np.float64], count: int
) -> tuple[float, float]:
    """The place in all of some discs from which the way to a and b together is shortest.

    As for linear programs of two unknowns: disc after disc, and where one does not hold the best place so far, the new one is on
    its edge, in the part that all discs before it hold.

    Args:
        a: east and north.
        b: the same.
        begin: place to stay near to where several are as good.
        discs: (m, 3) east, north, radius; they have a place in common.
        count: of them.
    """
    e, n = _nearest_on_line(a, b, begin[0], begin[1])
    for i in range(count):
        ce, cn, radius = discs[i, 0], discs[i, 1], discs[i, 2]
        if (e - ce) ** 2 + (n - cn) ** 2 <= radius * radius:
            continue
        # The angles that the discs before it leave of its edge, counted from that towards the first of them that cuts it.
        middle, low, high = math.atan2(begin[1] - cn, begin[0] - ce), -math.pi, math.pi
        for j in range(i):
            de, dn = discs[j, 0] - ce, discs[j, 1] - cn
            apart = math.sqrt(de * de + dn * dn)
            if apart == 0.0:
                continue
            cosine = (apart * apart + radius * radius - discs[j, 2] ** 2) / (2.0 * apart * radius)
            if cosine <= -1.0:
                continue
            towards, half = math.atan2(dn, de), math.acos(min(1.0, cosine))
            if high - low == 2.0 * math.pi:
                middle = towards
            by = (towards - middle + 3.0 * math.pi) % (2.0 * math.pi) - math.pi
            low, high = max(low, by - half), min(high, by + half)
        if low > high:
            low = high = 0.5 * (low + high)
        angle = _best_angle(a, b, discs[i], middle + low, middle + high)
        e, n = ce + radius * math.cos(angle), cn + radius * math.sin(angle)
    return e, n


@kernel
def _best_angle(
    a: tuple[float, float], b: tuple[float, float], disc: NDArray[np.float64], low: float, high: float
) -> float:
    """The angle between two on the edge of a disc from which the way to a and b is shortest."""
    ce, cn, radius = disc[0], disc[1], disc[2]
    step = (high - low) / _SAMPLES
    best, best_at = math.inf, low
    for k in range(_SAMPLES + 1):
        angle = low + k * step
        long = _length_via(a, b, ce + radius * math.cos(angle), cn + radius * math.sin(angle))
        if long < best:
            best, best_at = long, angle
    first, last = max(low, best_at - step), min(high, best_at + step)
    # The way grows towards both ends: its slope decides.
    for _ in range(_BISECTIONS):
        angle = 0.5 * (first + last)
        cosine, sine = math.cos(angle), math.sin(angle)
        e, n = ce + radius * cosine, cn + radius * sine
        to_a, to_b = math.hypot(e - a[0], n - a[1]) + 1e-300, math.hypot(e - b[0], n - b[1]) + 1e-300
        slope = ((e - a[0]) / to_a + (e - b[0]) / to_b) * -sine + ((n - a[1]) / to_a + (n - b[1]) / to_b) * cosine
        if slope > 0.0:
            last = angle
        else:
            first = angle
    angle = 0.5 * (first + last)
    if _length_via(a, b, ce + radius * math.cos(angle), cn + radius * math.sin(angle)) < best:
        return angle
    return best_at


@kernel
def _neighbours(
    problem: SearchProblem, state: RouteState, before: int, behind: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Positions of two waypoints on the map; beyond the ends of the route, home, or the other of the two."""
    a = b = (problem.path_cost.climb_out_top[0], problem.path_cost.climb_out_top[1])
    n = state.size[0]
    if before >= 0:
        a = (state.route[before, 0], state.route[before, 1])
    if behind < n:
        b = (state.route[behind, 0], state.route[behind, 1])
    if problem.path_cost.mission != 1:
        a, b = (b if before < 0 else a), (a if behind >= n else b)
    return a, b


@kernel
def _change(
    problem: SearchProblem,
    state: RouteState,
    undo: NDArray[np.float64],
    first: int,
    last: int,
    fresh: int,
    new: int,
    gained: float,
) -> None:
    """Keep an exchange of at most one waypoint for one that was tried, and record how to undo it."""
    done = int(undo[0, 0])
    undo[done + 1, 0], undo[done + 1, 1], undo[done + 1, 2] = first, last - first, fresh
    if last > first:
        undo[done + 1, 3], undo[done + 1, 4], undo[done + 1, 5] = position(state.route, first)
    undo[0, 0] = done + 1
    keep_exchange(problem, state, first, last, fresh, new, gained)


@inlined_kernel
def _undo(problem: SearchProblem, state: RouteState, undo: NDArray[np.float64], observed: float) -> None:
    """Undo all exchanges."""
    for k in range(int(undo[0, 0]), 0, -1):
        first, removed, fresh = int(undo[k, 0]), int(undo[k, 1]), int(undo[k, 2])
        state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = undo[k, 3], undo[k, 4], undo[k, 5]
        gained, new = try_exchange(problem, state, first, first + fresh, removed)
        keep_exchange(problem, state, first, first + fresh, removed, new, gained)
    state.observed[0] = observed


@inlined_kernel
def _remove_near(
    problem: SearchProblem,
    state: RouteState,
    undo: NDArray[np.float64],
    seed: int,
    number: int,
    lost: NDArray[np.int32],
) -> tuple[float, int, float]:
    """Remove the waypoints nearest to one: change of cost, number of cells written to ``lost``, and their distance."""
    apart2 = np.empty(state.size[0])
    e, n, _ = position(state.route, seed)
    for k in range(apart2.size):
        apart2[k] = (state.route[k, 0] - e) ** 2 + (state.route[k, 1] - n) ** 2
    chosen = np.empty(number, dtype=np.int64)
    farthest = 0.0
    for i in range(number):
        nearest = int(np.argmin(apart2))
        chosen[i], farthest = nearest, math.sqrt(apart2[nearest])
        apart2[nearest] = math.inf
    chosen.sort()
    cost, count = 0.0, 0
    for i in range(number - 1, -1, -1):
        first = int(chosen[i])
        cost += exchange_cost(problem, state, first, first + 1, 0)
        gained, new = try_exchange(problem, state, first, first + 1, 0)
        _change(problem, state, undo, first, first + 1, 0, new, gained)
        for row in range(state.changed[0]):
            for square in range(state.changes[row, 0], state.changes[row, 1]):
                if state.counts[square] == problem.needed - 1 and problem.weight[square] > 0.0:
                    lost[count] = square
                    count += 1
    return cost, count, farthest


@inlined_kernel
def _see_again(
    problem: SearchProblem,
    state: RouteState,
    undo: NDArray[np.float64],
    cell: int,
    above: float,
    rng: np.random.Generator,
) -> float:
    """Insert the cheapest waypoint that observes a cell; the change of cost, 0 without one."""
    ce, cn = problem.cells.centre_m[cell, 0], problem.cells.centre_m[cell, 1]
    radius = radius_at(problem.sight, above) * _INSIDE
    size = state.size[0]
    best, at, be, bn = math.inf, -1, 0.0, 0.0
    for k in range(size + 1):
        a, b = _neighbours(problem, state, k - 1, k)
        long = math.hypot(a[0] - b[0], a[1] - b[1])
        if 2.0 * (math.hypot(a[0] - ce, a[1] - cn) - radius - long) >= best:
            continue
        e, n = _nearest_on_line(a, b, ce, cn)
        apart = math.hypot(e - ce, n - cn)
        if apart > radius:
            e, n = ce + (e - ce) * radius / apart, cn + (n - cn) * radius / apart
        longer = _length_via(a, b, e, n) - long
        if longer < best and rng.random() >= _BLINK:
            best, at, be, bn = longer, k, e, n
    if at < 0:
        return 0.0
    for nearer in (1.0, 0.7, 0.0):
        e, n = ce + nearer * (be - ce), cn + nearer * (bn - cn)
        state.fresh[0, 0], state.fresh[0, 1] = e, n
        state.fresh[0, 2] = up_above(problem.surface, e, n, above)
        if exchange_allowed(problem, state, at, at, 1):
            cost = exchange_cost(problem, state, at, at, 1)
            gained, new = try_exchange(problem, state, at, at, 1)
            if new >= 0 and gained > 0.0:
                _change(problem, state, undo, at, at, 1, new, gained)
                return cost
    return 0.0


@kernel
def pull(
    problem: SearchProblem,
    state: RouteState,
    undo: NDArray[np.float64],
    k: int,
    fewest: int,
    discs: NDArray[np.float64],
    least: float,
) -> tuple[float, bool]:
    """Move waypoint k to the best position from which it observes its own cells, or remove it without any.

    Returns:
        Change of cost, at most 0; whether the waypoint was removed.
    """
    e, n, u = position(state.route, k)
    runs, size = state.runs[state.slot[k]], state.sizes[state.slot[k]]
    columns, count = problem.cells.lattice.shape[1], 0
    for i in range(0, size, 2):
        for square in range(runs[i], runs[i + 1]):
            if state.counts[square] == problem.needed and problem.weight[square] > 0.0:
                cell = problem.cells.lattice[square // columns, square % columns]
                above = u - problem.cells.centre_m[cell, 2]
                discs[count, 0], discs[count, 1] = problem.cells.centre_m[cell, 0], problem.cells.centre_m[cell, 1]
                discs[count, 2] = radius_at(problem.sight, above) * _INSIDE
                count += 1
    if count == 0:
        cost = exchange_cost(problem, state, k, k + 1, 0)
        if state.size[0] <= fewest or cost > 0.0 or not exchange_allowed(problem, state, k, k + 1, 0):
            return 0.0, False
        gained, new = try_exchange(problem, state, k, k + 1, 0)
        _change(problem, state, undo, k, k + 1, 0, new, gained)
        return cost, True
    a, b = _neighbours(problem, state, k - 1, k + 1)
    be, bn = best_between(a, b, (e, n), discs, count)
    if _length_via(a, b, e, n) - _length_via(a, b, be, bn) <= least:
        return 0.0, False
    above = height_above(problem.surface, e, n, u)
    for fraction in (1.0, 0.5):
        te, tn = e + fraction * (be - e), n + fraction * (bn - n)
        state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = te, tn, up_above(problem.surface, te, tn, above)
        if not exchange_allowed(problem, state, k, k + 1, 1):
            continue
        cost = exchange_cost(problem, state, k, k + 1, 1)
        if cost >= 0.0:
            continue
        gained, new = try_exchange(problem, state, k, k + 1, 1)
        if new >= 0 and gained >= 0.0:
            _change(problem, state, undo, k, k + 1, 1, new, gained)
            return cost, False
    return 0.0, False


@allocating_kernel
def rebuild(
    problem: SearchProblem,
    weights: tuple[float, float, float, float],
    state: RouteState,
    allowance: float,
    fewest: int,
    most: int,
    rng: np.random.Generator,
) -> bool:
    """Propose to rebuild the route around one of its waypoints; whether it was accepted.

    Args:
        problem: senses at waypoints, in any order.
        weights: of the path, of a waypoint, and of the coverage that is missing to a goal, which comes last.
        state: is changed.
        allowance: by how much the energy may rise.
        fewest: waypoints are not removed below this.
        most: nor inserted above this.
        rng: draws what is removed.
    """
    size = state.size[0]
    number = min(size - fewest, 1 + int(rng.random() * _MOST_REMOVED))
    if number < 1:
        return False
    path, waypoint, coverage, goal = weights
    observed, seed = state.observed[0], int(rng.random() * size)
    e, n, u = position(state.route, seed)
    above = height_above(problem.surface, e, n, u)
    if rng.random() < 0.5:
        low, high = problem.limits.lowest_agl_m, problem.limits.highest_agl_m
        above = low + rng.random() * (high - low)
    radius = radius_at(problem.sight, above)
    lost = np.empty(problem.square.size, dtype=np.int32)
    undo = np.zeros((_MOST_CHANGES, 6))
    cost, count, farthest = _remove_near(problem, state, undo, seed, number, lost)
    columns = problem.cells.lattice.shape[1]
    enough = min(goal, observed)
    while count > 0 and state.observed[0] < enough and state.size[0] < most and undo[0, 0] < 0.5 * _MOST_CHANGES:
        i = int(rng.random() * count)
        square = lost[i]
        count -= 1
        lost[i] = lost[count]
        if state.counts[square] < problem.needed:
            cell = problem.cells.lattice[square // columns, square % columns]
            cost += _see_again(problem, state, undo, cell, above, rng)
    discs = np.empty((problem.square.size, 3))
    around2 = (farthest + _AROUND * radius) ** 2
    for _ in range(_PASSES):
        before, k = cost, 0
        while k < state.size[0] and undo[0, 0] < _MOST_CHANGES - 2:
            if (state.route[k, 0] - e) ** 2 + (state.route[k, 1] - n) ** 2 <= around2:
                change, gone = pull(problem, state, undo, k, fewest, discs, _LEAST_GAIN * radius)
                cost += change
                if gone:
                    continue
            k += 1
        if path * (before - cost) <= _LEAST_GAIN * radius:
            break
    change = path * cost + waypoint * (state.size[0] - size)
    change += coverage * (max(0.0, goal - state.observed[0]) - max(0.0, goal - observed))
    if change <= allowance:
        return True
    _undo(problem, state, undo, observed)
    return False
