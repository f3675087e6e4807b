"""Incremental route state: the number of segments that observe each cell, updated segment by segment.

A segment is a leg when the sensor looks along the path, and a single waypoint otherwise. To exchange waypoints, the cells of
the segments that end at them are compared with those of the new segments; only where they differ is a count looked up,
and none is written before the change is kept.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import kernel
from uavcover.kernels.leg_visibility import list_cells
from uavcover.kernels.nadir_visibility import (
    NOT_SO,
    compare,
    list_cone_runs,
    make_changes,
    runs_of,
    weigh_changes,
    weigh_often,
)
from uavcover.kernels.photo_visibility import list_photo_runs
from uavcover.kernels.search_problem import (
    ALONG_PATH,
    AT_WAYPOINTS,
    SearchProblem,
    allowed_leg,
    allowed_position,
    distance,
    position,
)

WIDEST = 8
"""Largest number of waypoints that one change inserts; a route state has this number of spare sets of squares, plus one."""

MOST_SETS = 2 * (WIDEST + 1)
"""Largest number of segments that one change removes and inserts."""


class RouteState(NamedTuple):
    """Incremental state of a route, with the counts of its observations; kernels write to its arrays.

    Owner: the thread that is annealing it. A state belongs to one chain; one thread at a time changes it, without a lock, and
    another may read it only between two batches. No array is shared with another state or with the caller.

    Attributes:
        route: (capacity, 3) waypoints in flying order, then unused rows.
        size: (1,) number of waypoints.
        slot: (capacity + WIDEST + 1,) number of the set of segment k; behind the segments the free sets.
        runs: (capacity + WIDEST + 1, stride) squares that each segment observes, as of :mod:`uavcover.kernels.nadir_visibility`.
        sizes: (capacity + WIDEST + 1,) length of each set.
        counts: (rows * columns,) number of segments that observe each square.
        observed: (1,) weight of the cells that are observed, 0..1.
        fresh: (WIDEST, 3) waypoints that a change puts in.
        changes: (m, 3) what a change does to the counts.
        changed: (1,) number of its rows.
        sets: (MOST_SETS, 3) working memory.
        squares: (n,) working memory.
        row: (columns,) working memory.
        stretch: (capacity + WIDEST, 3) working memory.
    """

    route: NDArray[np.float64]
    size: NDArray[np.int64]
    slot: NDArray[np.int64]
    runs: NDArray[np.int32]
    sizes: NDArray[np.int64]
    counts: NDArray[np.uint16]
    observed: NDArray[np.float64]
    fresh: NDArray[np.float64]
    changes: NDArray[np.int32]
    changed: NDArray[np.int64]
    sets: NDArray[np.int64]
    squares: NDArray[np.int32]
    row: NDArray[np.uint8]
    stretch: NDArray[np.float64]

    @classmethod
    def empty(cls, *, capacity: int, stride: int, squares: int, cells: int, columns: int) -> "RouteState":
        """A state without waypoints, in fresh arrays of its own.

        Args:
            capacity: most waypoints.
            stride: most numbers in the runs of a segment.
            squares: of the lattice.
            cells: on it.
            columns: of the lattice.
        """
        sets = capacity + WIDEST + 1
        return cls(
            route=np.zeros((capacity, 3)),
            size=np.zeros(1, dtype=np.int64),
            slot=np.arange(sets, dtype=np.int64),
            runs=np.zeros((sets, stride), dtype=np.int32),
            sizes=np.zeros(sets, dtype=np.int64),
            counts=np.zeros(squares, dtype=np.uint16),
            observed=np.zeros(1),
            fresh=np.zeros((WIDEST, 3)),
            changes=np.zeros((MOST_SETS * stride, 3), dtype=np.int32),
            changed=np.zeros(1, dtype=np.int64),
            sets=np.zeros((MOST_SETS, 3), dtype=np.int64),
            squares=np.zeros(cells, dtype=np.int32),
            row=np.zeros(columns, dtype=np.uint8),
            stretch=np.zeros((capacity + WIDEST, 3)),
        )


@kernel
def segment_count(problem: SearchProblem, waypoints: int) -> int:
    """Number of segments of a route with this number of waypoints; a single waypoint is a segment."""
    return max(1, waypoints - 1) if problem.sensing == ALONG_PATH else waypoints


@kernel
def recount(problem: SearchProblem, state: RouteState) -> bool:
    """Recompute all lists and counts; False if a segment has more runs than there is room for."""
    n = state.size[0]
    for square in range(state.counts.size):
        state.counts[square] = 0
    state.observed[0] = 0.0
    for k in range(segment_count(problem, n)):
        other = min(k + 1, n - 1) if problem.sensing == ALONG_PATH else k
        if not list_visible(problem, state, k, position(state.route, k), position(state.route, other)):
            return False
        state.observed[0] += compare_segments(problem, state, k, k, k, k + 1)
        make_changes(state.changes, state.changed[0], state.counts)
    return True


@kernel
def list_visible(
    problem: SearchProblem, state: RouteState, k: int, p: tuple[float, float, float], q: tuple[float, float, float]
) -> bool:
    """Write the cells observed from p-q into the set of slot k; False if it has too many runs."""
    number = state.slot[k]
    found = list_cone_runs(
        problem.surface,
        problem.sight,
        problem.cells,
        problem.cone_cells,
        p,
        q,
        problem.spacing_m,
        state.row,
        state.runs[number],
    )
    if found == NOT_SO:
        found = list_photo_runs(
            problem.surface,
            problem.sight,
            problem.cells,
            problem.photo_cells,
            p,
            q,
            problem.spacing_m,
            problem.trigger_m,
            state.row,
            state.runs[number],
        )
    if found == NOT_SO:
        cells = list_cells(
            problem.surface, problem.sight, problem.cells, p, q, problem.spacing_m, problem.trigger_m, state.squares
        )
        for i in range(cells):
            state.squares[i] = problem.square[state.squares[i]]
        found = runs_of(state.squares, cells, state.runs[number])
    state.sizes[number] = max(found, 0)
    return found >= 0


@kernel
def compare_segments(problem: SearchProblem, state: RouteState, begin: int, end: int, first: int, last: int) -> float:
    """Change of the observed weight when segments begin..end - 1 are replaced by the sets of slots first..last - 1.

    What changes is left in state.changes; the counts stay as they are.
    """
    for k in range(begin, end):
        state.sets[k - begin, 0] = state.slot[k]
    for k in range(first, last):
        state.sets[end - begin + k - first, 0] = state.slot[k]
    state.changed[0] = compare(state.runs, state.sizes, state.sets, end - begin, last - first, state.changes)
    return weigh(problem, state)


@kernel
def weigh(problem: SearchProblem, state: RouteState) -> float:
    """Change of the weight that counts as observed, if the changes were made."""
    if problem.needed == 1:
        return weigh_changes(state.changes, state.changed[0], state.counts, problem.weight)
    return weigh_often(state.changes, state.changed[0], state.counts, problem.weight, problem.needed)


@kernel
def observed_alone(problem: SearchProblem, state: RouteState, k: int) -> float:
    """Weight of the cells that would no longer count without segment k."""
    return -compare_segments(problem, state, k, k + 1, 0, 0)


@kernel
def exchange_length(state: RouteState, first: int, last: int, fresh: int) -> float:
    """Change of length when waypoints first..last - 1 are replaced by the first ``fresh`` of state.fresh."""
    n = state.size[0]
    change = 0.0
    for k in range(max(first, 1), min(last + 1, n)):
        change -= distance(position(state.route, k - 1), position(state.route, k))
    for k in range(-1, fresh):
        if not (k < 0 and first == 0) and not (k == fresh - 1 and last == n):
            change += distance(_around(state, first, last, fresh, k), _around(state, first, last, fresh, k + 1))
    return change


@kernel
def _around(state: RouteState, first: int, last: int, fresh: int, k: int) -> tuple[float, float, float]:
    """Waypoint k of the new stretch: -1 is the one before it, ``fresh`` the one behind."""
    if k < 0:
        return position(state.route, first - 1)
    return position(state.fresh, k) if k < fresh else position(state.route, last)


@kernel
def exchange_allowed(problem: SearchProblem, state: RouteState, first: int, last: int, fresh: int) -> bool:
    """Whether the new waypoints and their legs keep the limits."""
    n = state.size[0]
    for k in range(fresh):
        if not allowed_position(problem, position(state.fresh, k)):
            return False
    if problem.apart_m > 0.0 and not keep_apart(problem, state, first, last, fresh):
        return False
    for k in range(-1, fresh):
        if (k < 0 and first == 0) or (k == fresh - 1 and last == n):
            continue
        if not allowed_leg(problem, _around(state, first, last, fresh, k), _around(state, first, last, fresh, k + 1)):
            return False
    return True


@kernel
def keep_apart(problem: SearchProblem, state: RouteState, first: int, last: int, fresh: int) -> bool:
    """Whether the new waypoints are far enough from each other and from all that stay."""
    for k in range(fresh):
        p = position(state.fresh, k)
        for other in range(k):
            if distance(p, position(state.fresh, other)) < problem.apart_m:
                return False
        for other in range(state.size[0]):
            if not first <= other < last and distance(p, position(state.route, other)) < problem.apart_m:
                return False
    return True


@kernel
def old_segments(problem: SearchProblem, state: RouteState, first: int, last: int) -> tuple[int, int]:
    """The segments begin..end - 1 that change when waypoints first..last - 1 do."""
    if problem.sensing == AT_WAYPOINTS:
        return first, last
    if state.size[0] == 1:
        return 0, 1
    return max(first - 1, 0), min(last, state.size[0] - 1)


@kernel
def try_exchange(problem: SearchProblem, state: RouteState, first: int, last: int, fresh: int) -> tuple[float, int]:
    """Compare an exchange without applying it; see :func:`keep_exchange`.

    Returns:
        change of the weight that is observed, and how many segments are new; -1 when one has more runs than there is room for.
    """
    n = state.size[0]
    segments = segment_count(problem, n)
    new = 0
    if problem.sensing == AT_WAYPOINTS:
        while new < fresh:
            if not list_visible(problem, state, segments + new, position(state.fresh, new), position(state.fresh, new)):
                return 0.0, -1
            new += 1
    elif n - (last - first) + fresh == 1:
        alone = position(state.fresh, 0) if fresh == 1 else position(state.route, last if first == 0 else 0)
        if not list_visible(problem, state, segments, alone, alone):
            return 0.0, -1
        new = 1
    else:
        for k in range(-1, fresh):
            if (k < 0 and first == 0) or (k == fresh - 1 and last == n):
                continue
            p, q = _around(state, first, last, fresh, k), _around(state, first, last, fresh, k + 1)
            if not list_visible(problem, state, segments + new, p, q):
                return 0.0, -1
            new += 1
    begin, end = old_segments(problem, state, first, last)
    return compare_segments(problem, state, begin, end, segments, segments + new), new


@kernel
def keep_exchange(
    problem: SearchProblem, state: RouteState, first: int, last: int, fresh: int, new: int, change: float
) -> None:
    """Apply the exchange that :func:`try_exchange` compared."""
    n = state.size[0]
    segments = segment_count(problem, n)
    begin, end = old_segments(problem, state, first, last)
    make_changes(state.changes, state.changed[0], state.counts)
    # The new sets move in front of those that follow; the old ones become free.
    for k in range(new):
        _rotate_right(state.slot, end + k, segments + k)
    for k in range(end - begin):
        _rotate_left(state.slot, begin, segments + new - 1 - k)
    moved = fresh - (last - first)
    if moved > 0:
        for k in range(n - 1, last - 1, -1):
            _copy_row(state.route, k, state.route, k + moved)
    elif moved < 0:
        for k in range(last, n):
            _copy_row(state.route, k, state.route, k + moved)
    for k in range(fresh):
        _copy_row(state.fresh, k, state.route, first + k)
    state.size[0] = n + moved
    state.observed[0] += change


@kernel
def _copy_row(source: NDArray[np.float64], i: int, target: NDArray[np.float64], j: int) -> None:
    for axis in range(3):
        target[j, axis] = source[i, axis]


@kernel
def _rotate_right(numbers: NDArray[np.int64], first: int, last: int) -> None:
    """Take ``last`` out and put it in at ``first``."""
    taken = numbers[last]
    for k in range(last, first, -1):
        numbers[k] = numbers[k - 1]
    numbers[first] = taken


@kernel
def _rotate_left(numbers: NDArray[np.int64], first: int, last: int) -> None:
    """Take ``first`` out and put it in at ``last``."""
    taken = numbers[first]
    for k in range(first, last):
        numbers[k] = numbers[k + 1]
    numbers[last] = taken


@kernel
def reverse_order(numbers: NDArray[np.int64], first: int, last: int) -> None:
    """Reverse numbers first..last in place."""
    while first < last:
        numbers[first], numbers[last] = numbers[last], numbers[first]
        first, last = first + 1, last - 1


@kernel
def reverse_rows(route: NDArray[np.float64], first: int, last: int) -> None:
    """Reverse rows first..last of an (n, 3) array in place."""
    while first < last:
        for axis in range(3):
            route[first, axis], route[last, axis] = route[last, axis], route[first, axis]
        first, last = first + 1, last - 1


@kernel
def transfer(state: RouteState, at: int, to: int) -> None:
    """Move waypoint ``at`` with its set to number ``to``; for sensing at waypoints in a free order."""
    e, n, u = position(state.route, at)
    step = 1 if to > at else -1
    k = at
    while k != to:
        _copy_row(state.route, k + step, state.route, k)
        k += step
    state.route[to, 0], state.route[to, 1], state.route[to, 2] = e, n, u
    if to > at:
        _rotate_left(state.slot, at, to)
    else:
        _rotate_right(state.slot, to, at)
