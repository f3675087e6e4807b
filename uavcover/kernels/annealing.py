"""Simulated annealing of a route by single moves with incremental evaluation.

The energy is ``path * cost of the path + waypoint * waypoints + coverage * max(0, goal - observed)``. One proposal draws one
change of one kind; changes that exceed a limit are never made. Kinds: move a waypoint, change its height, shift a stretch,
insert, remove, reverse a stretch (for two waypoints a swap: 2-opt). If the order is free: transfer a waypoint to another
position in the order (Or-opt) or to an unobserved cell, and rebuild the route around a waypoint
(:mod:`uavcover.kernels.rebuild`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.nadir_visibility import compare, make_changes
from uavcover.kernels.rebuild import rebuild
from uavcover.kernels.route_state import (
    WIDEST,
    RouteState,
    exchange_allowed,
    keep_apart,
    keep_exchange,
    list_visible,
    reverse_order,
    reverse_rows,
    segment_count,
    transfer,
    try_exchange,
    weigh,
)
from uavcover.kernels.route_state_cost import exchange_cost, reversal_cost, transfer_cost
from uavcover.kernels.search_problem import ALONG_PATH, SearchProblem, allowed_leg, allowed_position, distance, position
from uavcover.kernels.sight import FRUSTUM, Sight
from uavcover.kernels.surface import height_above, up_above

_TRIES_FOR_A_GAP = 24
_PROPOSALS_PER_REBUILDING = 100
"""Approximately its cost in time."""

_STRAIGHT_DOWN = 1e-9
"""Cosine of a camera's pitch below which a leg observes the same cells in both directions."""


class Weights(NamedTuple):
    """Weights of the terms of the energy.

    Attributes:
        path: of the cost of the path, in metres or in the unit of the objective.
        waypoint: of each waypoint.
        coverage: of the missing fraction of the goal.
        goal: fraction of the counted cells, 0..1, above which more coverage has no value.
    """

    path: float
    waypoint: float
    coverage: float
    goal: float


class Moves(NamedTuple):
    """Fractions of the proposals by kind; they add up to less than 1, and what is left removes waypoints.

    Attributes:
        turn: reverse a stretch of the order.
        transfer_to_gap: where the order is free, move a waypoint to a cell that no waypoint observes; else an exchange, as all
            below.
        transfer: the same, to another position in the order.
        move_and_height: of the exchanges: move a waypoint on the map, and change its height.
        move: move it on the map only.
        height: change its height only.
        shift: shift a stretch on the map.
        shift_height: up or down.
        insert: a waypoint.
        smallest_step: fraction of the widest move that the smallest is.
    """

    turn: float
    transfer_to_gap: float
    transfer: float
    move_and_height: float
    move: float
    height: float
    shift: float
    shift_height: float
    insert: float
    smallest_step: float


class Schedule(NamedTuple):
    """Annealing schedule of one stretch.

    Attributes:
        proposals: how many.
        hottest: temperature at its beginning, in units of energy.
        coldest: at its end; it falls geometrically.
        largest_step_m: standard deviation of the widest moves; others go down to ``moves.smallest_step`` of it.
        fewest: waypoints are not removed below this.
        most: nor inserted above this.
        moves: how often each kind is proposed.
        rebuilt: where the order is free, fraction of the proposals that rebuild the route around a waypoint.
        rebuilt_heat: multiple of their temperature, because a rebuilt route is already near a local minimum.
    """

    proposals: int
    hottest: float
    coldest: float
    largest_step_m: float
    fewest: int
    most: int
    moves: Moves
    rebuilt: float = 0.0
    rebuilt_heat: float = 1.0


@kernel
def anneal(
    problem: SearchProblem, weights: Weights, schedule: Schedule, state: RouteState, rng: np.random.Generator
) -> int:
    """Anneal ``state`` in place; returns the number of accepted proposals.

    The route state must be counted (:func:`uavcover.kernels.route_state.recount`).
    """
    kept = 0
    cooling = math.log(schedule.coldest / schedule.hottest) / max(1, schedule.proposals - 1)
    free_order = problem.sensing != ALONG_PATH and problem.limits.legs == 0
    moves = schedule.moves
    to_gap = moves.turn + moves.transfer_to_gap
    number = -1
    while number + 1 < schedule.proposals:
        number += 1
        temperature = schedule.hottest * math.exp(cooling * number)
        # Permitted rise of the energy: the Metropolis rule, solved for it.
        allowance = -temperature * math.log(1.0 - rng.random())
        draw = rng.random()
        if free_order and schedule.rebuilt > 0.0 and rng.random() < schedule.rebuilt:
            number += _PROPOSALS_PER_REBUILDING - 1
            if rebuild(problem, weights, state, schedule.rebuilt_heat * allowance, schedule.fewest, schedule.most, rng):
                kept += 1
            continue
        step = schedule.largest_step_m * math.exp(math.log(moves.smallest_step) * rng.random())
        if draw < moves.turn:
            done = _turn_round(problem, weights, state, allowance, rng)
        elif free_order and draw < to_gap + moves.transfer:
            done = _transfer(problem, weights, state, allowance, step if draw < to_gap else 0.0, rng)
        else:
            done = _exchange(problem, weights, schedule, state, allowance, step, rng)
        if done:
            kept += 1
    return kept


@kernel
def energy_of_coverage(weights: Weights, observed: float) -> float:
    """Energy of the coverage missing to the goal."""
    return weights.coverage * max(0.0, weights.goal - observed)


@kernel
def _exchange(
    problem: SearchProblem,
    weights: Weights,
    schedule: Schedule,
    state: RouteState,
    allowance: float,
    step: float,
    rng: np.random.Generator,
) -> bool:
    """Propose a move, lift, shift, insertion or removal; whether it was accepted."""
    n = state.size[0]
    moves = schedule.moves
    moved = moves.move_and_height + moves.move
    lifted = moved + moves.height
    shifted = lifted + moves.shift + moves.shift_height
    kind = rng.random()
    first = int(rng.random() * n)
    last, fresh = first + 1, 1
    de, dn = step * rng.standard_normal(), step * rng.standard_normal()
    du = 0.5 * step * rng.standard_normal()
    if kind < moved:
        _put(problem, state, first, first, de, dn, du if kind < moves.move_and_height else 0.0)
    elif kind < lifted:
        _put(problem, state, first, first, 0.0, 0.0, du)
    elif kind < shifted:  # shift a stretch sideways, up or down
        fresh = min(n - first, 1 + int(rng.random() * WIDEST))
        last = first + fresh
        if kind < lifted + moves.shift:
            du = 0.0
        else:
            de, dn = 0.0, 0.0
        for k in range(fresh):
            _put(problem, state, first, first + k, de, dn, du)
    elif kind < shifted + moves.insert:
        if n >= schedule.most:
            return False
        if not _insertion(problem, state, first, de, dn, rng):
            return False
        last = first = first + 1 if problem.sensing == ALONG_PATH or problem.limits.legs == 1 else _best_gap(state, -1)
    else:  # remove one, seldom more
        fresh = 0
        last = min(n, first + 1 + int(3.0 * rng.random() ** 3))
        if n - (last - first) < schedule.fewest:
            return False
    return _settle(problem, weights, state, allowance, first, last, fresh)


@kernel
def _settle(
    problem: SearchProblem, weights: Weights, state: RouteState, allowance: float, first: int, last: int, fresh: int
) -> bool:
    """Replace waypoints first..last - 1 by the first ``fresh`` of state.fresh; whether the change was accepted."""
    if not exchange_allowed(problem, state, first, last, fresh):
        return False
    more = fresh - (last - first)
    change = weights.path * exchange_cost(problem, state, first, last, fresh) + weights.waypoint * more
    before = energy_of_coverage(weights, state.observed[0])
    if change - before > allowance:
        return False  # even if the goal were reached
    gained, new = try_exchange(problem, state, first, last, fresh)
    if new < 0:
        return False
    if change + energy_of_coverage(weights, state.observed[0] + gained) - before > allowance:
        return False
    keep_exchange(problem, state, first, last, fresh, new, gained)
    return True


@kernel
def _put(problem: SearchProblem, state: RouteState, first: int, waypoint: int, de: float, dn: float, du: float) -> None:
    """Write a waypoint, moved on the map at the same height above ground plus ``du``, into fresh[waypoint - first]."""
    k = waypoint - first
    e, n, u = position(state.route, waypoint)
    if de != 0.0 or dn != 0.0:
        u = up_above(problem.surface, e + de, n + dn, height_above(problem.surface, e, n, u))
    state.fresh[k, 0], state.fresh[k, 1], state.fresh[k, 2] = e + de, n + dn, u + du


@kernel
def _insertion(
    problem: SearchProblem, state: RouteState, at: int, de: float, dn: float, rng: np.random.Generator
) -> bool:
    """Write a waypoint to insert into fresh[0]: near an unseen cell where the order is free, otherwise beside a leg."""
    if problem.sensing != ALONG_PATH and problem.limits.legs == 0 and _near_a_gap(problem, state, de, dn, rng):
        return True
    if at + 1 >= state.size[0]:
        return False
    t = rng.random()
    pe, pn, pu = position(state.route, at)
    qe, qn, qu = position(state.route, at + 1)
    e, n, u = pe + t * (qe - pe), pn + t * (qn - pn), pu + t * (qu - pu)
    u = up_above(problem.surface, e + de, n + dn, height_above(problem.surface, e, n, u))
    state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = e + de, n + dn, u
    return True


@kernel
def _near_a_gap(problem: SearchProblem, state: RouteState, de: float, dn: float, rng: np.random.Generator) -> bool:
    """Write a place near an insufficiently observed cell into fresh[0], at any allowed height; False if none was found."""
    for _ in range(_TRIES_FOR_A_GAP):
        cell = int(rng.random() * problem.square.size)
        square = problem.square[cell]
        if state.counts[square] < problem.needed and problem.weight[square] > 0.0:
            e, n = problem.cells.centre_m[cell, 0] + de, problem.cells.centre_m[cell, 1] + dn
            low = max(up_above(problem.surface, e, n, problem.limits.lowest_agl_m), problem.limits.lowest_up_m)
            high = min(up_above(problem.surface, e, n, problem.limits.highest_agl_m), problem.limits.highest_up_m)
            state.fresh[0, 0], state.fresh[0, 1] = e, n
            state.fresh[0, 2] = low + rng.random() * (high - low)
            return True
    return False


@kernel
def _best_gap(state: RouteState, without: int) -> int:
    """Cheapest position to insert fresh[0] into the route without one of its waypoints: the number of the next waypoint.

    Numbers count the route as it is; ``without`` -1 leaves none out. The end of the route is its size.
    """
    n = state.size[0]
    p = position(state.fresh, 0)
    best, best_at = math.inf, 0
    before = -1
    for k in range(n + 1):
        if k == without:
            continue
        longer = 0.0
        if before >= 0:
            longer += distance(position(state.route, before), p)
        if k < n:
            longer += distance(p, position(state.route, k))
            if before >= 0:
                longer -= distance(position(state.route, before), position(state.route, k))
        if longer < best:
            best, best_at = longer, k
        before = k
    return best_at


@kernel
def _transfer(
    problem: SearchProblem, weights: Weights, state: RouteState, allowance: float, step: float, rng: np.random.Generator
) -> bool:
    """Move a waypoint to its cheapest position in the order; with a step, to an unseen cell. Whether it was accepted."""
    n = state.size[0]
    if n < 3:
        return False
    at = int(rng.random() * n)
    after = at + 1
    if step > 0.0:
        if not _near_a_gap(problem, state, step * rng.standard_normal(), step * rng.standard_normal(), rng):
            return False
        if not allowed_position(problem, position(state.fresh, 0)):
            return False
        if problem.apart_m > 0.0 and not keep_apart(problem, state, at, after, 1):
            return False
    else:
        state.fresh[0, 0], state.fresh[0, 1], state.fresh[0, 2] = position(state.route, at)
    to = _best_gap(state, at)
    change = weights.path * transfer_cost(problem, state, at, to)
    if step > 0.0:
        fraction = energy_of_coverage(weights, state.observed[0])
        gained, new = try_exchange(problem, state, at, after, 1)
        if new < 0:
            return False
        if change + energy_of_coverage(weights, state.observed[0] + gained) - fraction > allowance:
            return False
        keep_exchange(problem, state, at, after, 1, new, gained)
    elif to in (at, at + 1) or change > allowance:
        return False
    transfer(state, at, to - 1 if to > at else to)
    return True


@kernel
def _turn_round(
    problem: SearchProblem, weights: Weights, state: RouteState, allowance: float, rng: np.random.Generator
) -> bool:
    """Reverse a stretch of the route (2-opt; for two waypoints, a swap). Whether it was accepted."""
    n = state.size[0]
    i, j = int(rng.random() * n), int(rng.random() * n)
    if i > j:
        i, j = j, i
    if i == j or (i == 0 and j == n - 1):
        return False
    if problem.sensing == ALONG_PATH and _depends_on_direction(problem.sight):
        # Every leg of the stretch observes other cells in reverse, so exchange all; the stretch is short.
        count = min(j - i + 1, WIDEST)
        for k in range(count):
            state.fresh[k, 0], state.fresh[k, 1], state.fresh[k, 2] = position(state.route, i + count - 1 - k)
        return _settle(problem, weights, state, allowance, i, i + count, count)
    p, q = position(state.route, i), position(state.route, j)
    change = weights.path * reversal_cost(problem, state, i, j)
    fraction = energy_of_coverage(weights, state.observed[0])
    if change - fraction > allowance:
        return False
    if (i > 0 and not allowed_leg(problem, position(state.route, i - 1), q)) or (
        j < n - 1 and not allowed_leg(problem, p, position(state.route, j + 1))
    ):
        return False
    if problem.sensing == ALONG_PATH:
        return _turn_legs_round(problem, weights, state, i, j, allowance - change + fraction)
    if change > allowance:
        return False
    reverse_order(state.slot, i, j)
    reverse_rows(state.route, i, j)
    return True


@kernel
def _depends_on_direction(sight: Sight) -> bool:
    """Whether a leg observes other cells in the opposite direction: true for a tilted camera that turns with the legs."""
    return sight.kind == FRUSTUM and math.isnan(sight.heading_e) and sight.cos_pitch > _STRAIGHT_DOWN


@kernel
def _turn_legs_round(problem: SearchProblem, weights: Weights, state: RouteState, i: int, j: int, most: float) -> bool:
    """Reverse waypoints i..j where legs observe, if the coverage then missing costs no more than ``most``."""
    n = state.size[0]
    segments = segment_count(problem, n)
    p, q = position(state.route, i), position(state.route, j)
    new = 0
    if i > 0:
        if not list_visible(problem, state, segments, position(state.route, i - 1), q):
            return False
        new = 1
    if j < n - 1:
        if not list_visible(problem, state, segments + new, p, position(state.route, j + 1)):
            return False
        new += 1
    gained = _compare_ends(problem, state, i, j, segments, new)
    if energy_of_coverage(weights, state.observed[0] + gained) > most:
        return False
    make_changes(state.changes, state.changed[0], state.counts)
    if i > 0:
        state.slot[i - 1], state.slot[segments] = state.slot[segments], state.slot[i - 1]
    if j < n - 1:
        free = segments + new - 1
        state.slot[j], state.slot[free] = state.slot[free], state.slot[j]
    reverse_order(state.slot, i, j - 1)
    reverse_rows(state.route, i, j)
    state.observed[0] += gained
    return True


@kernel
def _compare_ends(problem: SearchProblem, state: RouteState, i: int, j: int, segments: int, new: int) -> float:
    """Change of the observed weight if the sets after the segments replace the legs before waypoint i and after j."""
    olds = 0
    if i > 0:
        state.sets[olds, 0] = state.slot[i - 1]
        olds += 1
    if j < state.size[0] - 1:
        state.sets[olds, 0] = state.slot[j]
        olds += 1
    for k in range(new):
        state.sets[olds + k, 0] = state.slot[segments + k]
    state.changed[0] = compare(state.runs, state.sizes, state.sets, olds, new, state.changes)
    return weigh(problem, state)


@allocating_kernel
def snapshot(state: RouteState) -> NDArray[np.float64]:
    """(n, 3) copy of the current waypoints."""
    out = np.empty((state.size[0], 3))
    for k in range(state.size[0]):
        for axis in range(3):
            out[k, axis] = state.route[k, axis]
    return out
