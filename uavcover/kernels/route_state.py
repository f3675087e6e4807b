"""A route under change: how many of its spans see each cell, kept up to date span by span.

A waypoint is exchanged for another by comparing the cells of the spans that end at it with those of the new spans; only where
they differ a count is looked at, and none is written before the change is kept. Spans are legs when the sensor looks along
the path, and single waypoints otherwise.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.coverage import Cells
from uavcover.kernels.jit import kernel
from uavcover.kernels.leg_visibility import list_cells
from uavcover.kernels.nadir_visibility import (
    NOT_SO,
    ConeCells,
    compare,
    list_cone_runs,
    make_changes,
    runs_of,
    weigh_changes,
    weigh_often,
)
from uavcover.kernels.obstacles import keeps_clear
from uavcover.kernels.sight import Sight
from uavcover.kernels.surface import Surface, height_above, height_range_between
from uavcover.kernels.way_cost import SHORTEST, WayCost

WIDEST = 8
"""Most waypoints that one change puts in; a draft has this many sets of squares more than waypoints, and one."""

MOST_SETS = 2 * (WIDEST + 1)
"""So many spans one change takes away and puts in at most."""

AT_WAYPOINTS = 0
ALONG_PATH = 1

_HEIGHT_TOLERANCE_M = 1e-7


class Room(NamedTuple):
    """Where a route may be.

    Attributes:
        lowest_agl_m: above ground, margins taken off.
        highest_agl_m: above ground.
        lowest_up_m: local up coordinate; -inf for none.
        highest_up_m: inf for none.
        max_slope: tangent of the steepest leg.
        legs: 1 when heights, slopes and fence hold for every leg at its full length, 0 for the waypoints alone.
        fence_m: (k, 2) corners of the fence, east and north.
        beside_m: clearance beside the obstacles on the surface.
        above_m: clearance above their tops.
    """

    lowest_agl_m: float
    highest_agl_m: float
    lowest_up_m: float
    highest_up_m: float
    max_slope: float
    legs: int
    fence_m: NDArray[np.float64]
    beside_m: float = 0.0
    above_m: float = 0.0


class Task(NamedTuple):
    """What is looked at, with what, and from where it is allowed.

    Attributes:
        surface: the ground.
        sight: the sensor.
        cells: of the area.
        cone_cells: the cells for the quick way of a camera that looks straight down.
        square: (n,) place of each cell on the lattice, row * columns + column.
        weight: (rows * columns,) share of the cell in each square, of a sum of 1; 0 where none counts.
        spacing_m: largest distance between looks along the path.
        sensing: AT_WAYPOINTS or ALONG_PATH.
        room: the limits.
        way: what the way costs.
        looks: a cell counts when so many spans see it; more than 1 goes with AT_WAYPOINTS.
        apart_m: smallest distance between any two waypoints, so that each is a look of its own; 0: any.
    """

    surface: Surface
    sight: Sight
    cells: Cells
    cone_cells: ConeCells
    square: NDArray[np.int32]
    weight: NDArray[np.float64]
    spacing_m: float
    sensing: int
    room: Room
    way: WayCost = SHORTEST
    looks: int = 1
    apart_m: float = 0.0


class Draft(NamedTuple):
    """A route under change; its arrays are working memory that the kernels write.

    Attributes:
        route: (capacity, 3) waypoints in flying order, then nothing.
        size: (1,) how many waypoints.
        slot: (capacity + WIDEST + 1,) which set belongs to span k; behind the spans the free sets.
        runs: (capacity + WIDEST + 1, stride) squares that each span sees, as of :mod:`uavcover.kernels.nadir_visibility`.
        sizes: (capacity + WIDEST + 1,) how many numbers of each.
        counts: (rows * columns,) by how many spans each square is seen.
        seen: (1,) weight of the cells that are seen, 0..1.
        fresh: (WIDEST, 3) waypoints that a change puts in.
        changes: (m, 3) what a change does to the counts.
        changed: (1,) how many rows of it.
        sets: (MOST_SETS, 3) working memory.
        squares: (n,) working memory.
        row: (columns,) working memory.
    """

    route: NDArray[np.float64]
    size: NDArray[np.int64]
    slot: NDArray[np.int64]
    runs: NDArray[np.int32]
    sizes: NDArray[np.int64]
    counts: NDArray[np.uint16]
    seen: NDArray[np.float64]
    fresh: NDArray[np.float64]
    changes: NDArray[np.int32]
    changed: NDArray[np.int64]
    sets: NDArray[np.int64]
    squares: NDArray[np.int32]
    row: NDArray[np.uint8]


def empty_draft(*, capacity: int, stride: int, squares: int, cells: int, columns: int) -> Draft:
    """A draft without a waypoint.

    Args:
        capacity: most waypoints.
        stride: most numbers of a span's runs.
        squares: of the lattice.
        cells: on it.
        columns: of the lattice.
    """
    sets = capacity + WIDEST + 1
    return Draft(
        route=np.zeros((capacity, 3)),
        size=np.zeros(1, dtype=np.int64),
        slot=np.arange(sets, dtype=np.int64),
        runs=np.zeros((sets, stride), dtype=np.int32),
        sizes=np.zeros(sets, dtype=np.int64),
        counts=np.zeros(squares, dtype=np.uint16),
        seen=np.zeros(1),
        fresh=np.zeros((WIDEST, 3)),
        changes=np.zeros((MOST_SETS * stride, 3), dtype=np.int32),
        changed=np.zeros(1, dtype=np.int64),
        sets=np.zeros((MOST_SETS, 3), dtype=np.int64),
        squares=np.zeros(cells, dtype=np.int32),
        row=np.zeros(columns, dtype=np.uint8),
    )


@kernel
def place(array: NDArray[np.float64], row: int) -> tuple[float, float, float]:
    """Row of an (n, 3) array as three numbers."""
    return array[row, 0], array[row, 1], array[row, 2]


@kernel
def distance(p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """Between two places, metres."""
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@kernel
def span_count(task: Task, waypoints: int) -> int:
    """How many spans a route of so many waypoints has; one waypoint alone is a span."""
    return max(1, waypoints - 1) if task.sensing == ALONG_PATH else waypoints


@kernel
def recount(task: Task, draft: Draft) -> bool:
    """List and count everything anew; False when a span has more runs than there is room for."""
    n = draft.size[0]
    for square in range(draft.counts.size):
        draft.counts[square] = 0
    draft.seen[0] = 0.0
    for k in range(span_count(task, n)):
        other = min(k + 1, n - 1) if task.sensing == ALONG_PATH else k
        if not list_span(task, draft, k, place(draft.route, k), place(draft.route, other)):
            return False
        draft.seen[0] += compare_spans(task, draft, k, k, k, k + 1)
        make_changes(draft.changes, draft.changed[0], draft.counts)
    return True


@kernel
def list_span(task: Task, draft: Draft, k: int, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Write what is seen from p-q into the set of slot k; False when it has more runs than there is room for."""
    number = draft.slot[k]
    found = list_cone_runs(
        task.surface, task.sight, task.cells, task.cone_cells, p, q, task.spacing_m, draft.row, draft.runs[number]
    )
    if found == NOT_SO:
        cells = list_cells(task.surface, task.sight, task.cells, p, q, task.spacing_m, draft.squares)
        for i in range(cells):
            draft.squares[i] = task.square[draft.squares[i]]
        found = runs_of(draft.squares, cells, draft.runs[number])
    draft.sizes[number] = max(found, 0)
    return found >= 0


@kernel
def compare_spans(task: Task, draft: Draft, begin: int, end: int, first: int, last: int) -> float:
    """Change of the weight that is seen when spans begin..end - 1 give way to the sets of slots first..last - 1.

    What changes is left in draft.changes; the counts stay as they are.
    """
    for k in range(begin, end):
        draft.sets[k - begin, 0] = draft.slot[k]
    for k in range(first, last):
        draft.sets[end - begin + k - first, 0] = draft.slot[k]
    draft.changed[0] = compare(draft.runs, draft.sizes, draft.sets, end - begin, last - first, draft.changes)
    return weigh(task, draft)


@kernel
def weigh(task: Task, draft: Draft) -> float:
    """Change of the weight that counts as seen, if the changes were made."""
    if task.looks == 1:
        return weigh_changes(draft.changes, draft.changed[0], draft.counts, task.weight)
    return weigh_often(draft.changes, draft.changed[0], draft.counts, task.weight, task.looks)


@kernel
def seen_alone(task: Task, draft: Draft, k: int) -> float:
    """Weight of the cells that would no longer count without span k."""
    return -compare_spans(task, draft, k, k + 1, 0, 0)


@kernel
def inside_fence(fence: NDArray[np.float64], east: float, north: float) -> bool:
    """Whether a place lies inside a ring of corners (even-odd rule)."""
    inside = False
    j = fence.shape[0] - 1
    for i in range(fence.shape[0]):
        if (fence[i, 1] > north) != (fence[j, 1] > north):
            at = fence[i, 0] + (north - fence[i, 1]) / (fence[j, 1] - fence[i, 1]) * (fence[j, 0] - fence[i, 0])
            if east < at:
                inside = not inside
        j = i
    return inside


@kernel
def allowed_place(task: Task, p: tuple[float, float, float]) -> bool:
    """Whether a waypoint may be there."""
    room = task.room
    agl = height_above(task.surface, p[0], p[1], p[2])
    # A comparison with NaN is False: no elevation data, no waypoint.
    if not (room.lowest_agl_m <= agl <= room.highest_agl_m and room.lowest_up_m <= p[2] <= room.highest_up_m):
        return False
    return inside_fence(room.fence_m, p[0], p[1]) and _clear_of_obstacles(task, p, p)


@kernel
def allowed_leg(task: Task, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether a leg between two allowed waypoints may be flown, at its full length."""
    room = task.room
    if room.legs == 0:
        return True
    if abs(q[2] - p[2]) > room.max_slope * math.hypot(q[0] - p[0], q[1] - p[1]):
        return False
    if _crosses(room.fence_m, p, q) or not _clear_of_obstacles(task, p, q):
        return False
    low, _, high, _ = height_range_between(
        task.surface, p[0], p[1], p[2], q[0], q[1], q[2], room.lowest_agl_m - _HEIGHT_TOLERANCE_M
    )
    return bool(low >= room.lowest_agl_m - _HEIGHT_TOLERANCE_M and high <= room.highest_agl_m + _HEIGHT_TOLERANCE_M)


@kernel
def _clear_of_obstacles(task: Task, p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q keeps its clearance from everything that stands on the surface."""
    room = task.room
    return keeps_clear(task.surface.obstacles, p[0], p[1], p[2], q[0], q[1], q[2], room.beside_m, room.above_m)


@kernel
def _crosses(fence: NDArray[np.float64], p: tuple[float, float, float], q: tuple[float, float, float]) -> bool:
    """Whether the straight line p-q crosses an edge of the ring."""
    j = fence.shape[0] - 1
    for i in range(fence.shape[0]):
        ae, an, be, bn = fence[j, 0], fence[j, 1], fence[i, 0], fence[i, 1]
        side_a = (q[0] - p[0]) * (an - p[1]) - (q[1] - p[1]) * (ae - p[0])
        side_b = (q[0] - p[0]) * (bn - p[1]) - (q[1] - p[1]) * (be - p[0])
        side_p = (be - ae) * (p[1] - an) - (bn - an) * (p[0] - ae)
        side_q = (be - ae) * (q[1] - an) - (bn - an) * (q[0] - ae)
        if side_a * side_b < 0.0 and side_p * side_q < 0.0:
            return True
        j = i
    return False


@kernel
def exchange_length(draft: Draft, first: int, last: int, fresh: int) -> float:
    """By how much the route gets longer when waypoints first..last - 1 give way to the first ``fresh`` of draft.fresh."""
    n = draft.size[0]
    change = 0.0
    for k in range(max(first, 1), min(last + 1, n)):
        change -= distance(place(draft.route, k - 1), place(draft.route, k))
    for k in range(-1, fresh):
        if not (k < 0 and first == 0) and not (k == fresh - 1 and last == n):
            change += distance(_around(draft, first, last, fresh, k), _around(draft, first, last, fresh, k + 1))
    return change


@kernel
def _around(draft: Draft, first: int, last: int, fresh: int, k: int) -> tuple[float, float, float]:
    """Waypoint k of the new stretch: -1 is the one before it, ``fresh`` the one behind."""
    if k < 0:
        return place(draft.route, first - 1)
    return place(draft.fresh, k) if k < fresh else place(draft.route, last)


@kernel
def exchange_allowed(task: Task, draft: Draft, first: int, last: int, fresh: int) -> bool:
    """Whether the new waypoints and their legs keep the limits."""
    n = draft.size[0]
    for k in range(fresh):
        if not allowed_place(task, place(draft.fresh, k)):
            return False
    if task.apart_m > 0.0 and not keep_apart(task, draft, first, last, fresh):
        return False
    for k in range(-1, fresh):
        if (k < 0 and first == 0) or (k == fresh - 1 and last == n):
            continue
        if not allowed_leg(task, _around(draft, first, last, fresh, k), _around(draft, first, last, fresh, k + 1)):
            return False
    return True


@kernel
def keep_apart(task: Task, draft: Draft, first: int, last: int, fresh: int) -> bool:
    """Whether the new waypoints are far enough from each other and from all that stay."""
    for k in range(fresh):
        p = place(draft.fresh, k)
        for other in range(k):
            if distance(p, place(draft.fresh, other)) < task.apart_m:
                return False
        for other in range(draft.size[0]):
            if not first <= other < last and distance(p, place(draft.route, other)) < task.apart_m:
                return False
    return True


@kernel
def old_spans(task: Task, draft: Draft, first: int, last: int) -> tuple[int, int]:
    """The spans begin..end - 1 that change when waypoints first..last - 1 do."""
    if task.sensing == AT_WAYPOINTS:
        return first, last
    if draft.size[0] == 1:
        return 0, 1
    return max(first - 1, 0), min(last, draft.size[0] - 1)


@kernel
def try_exchange(task: Task, draft: Draft, first: int, last: int, fresh: int) -> tuple[float, int]:
    """What the exchange would change; nothing is counted before :func:`keep_exchange`.

    Returns:
        change of the weight that is seen, and how many spans are new; -1 when one has more runs than there is room for.
    """
    n = draft.size[0]
    spans = span_count(task, n)
    new = 0
    if task.sensing == AT_WAYPOINTS:
        while new < fresh:
            if not list_span(task, draft, spans + new, place(draft.fresh, new), place(draft.fresh, new)):
                return 0.0, -1
            new += 1
    elif n - (last - first) + fresh == 1:
        alone = place(draft.fresh, 0) if fresh == 1 else place(draft.route, last if first == 0 else 0)
        if not list_span(task, draft, spans, alone, alone):
            return 0.0, -1
        new = 1
    else:
        for k in range(-1, fresh):
            if (k < 0 and first == 0) or (k == fresh - 1 and last == n):
                continue
            p, q = _around(draft, first, last, fresh, k), _around(draft, first, last, fresh, k + 1)
            if not list_span(task, draft, spans + new, p, q):
                return 0.0, -1
            new += 1
    begin, end = old_spans(task, draft, first, last)
    return compare_spans(task, draft, begin, end, spans, spans + new), new


@kernel
def keep_exchange(task: Task, draft: Draft, first: int, last: int, fresh: int, new: int, change: float) -> None:
    """Make the exchange that :func:`try_exchange` has compared."""
    n = draft.size[0]
    spans = span_count(task, n)
    begin, end = old_spans(task, draft, first, last)
    make_changes(draft.changes, draft.changed[0], draft.counts)
    # The new sets move in front of those that follow; the old ones become free.
    for k in range(new):
        _rotate_right(draft.slot, end + k, spans + k)
    for k in range(end - begin):
        _rotate_left(draft.slot, begin, spans + new - 1 - k)
    moved = fresh - (last - first)
    if moved > 0:
        for k in range(n - 1, last - 1, -1):
            _copy_row(draft.route, k, draft.route, k + moved)
    elif moved < 0:
        for k in range(last, n):
            _copy_row(draft.route, k, draft.route, k + moved)
    for k in range(fresh):
        _copy_row(draft.fresh, k, draft.route, first + k)
    draft.size[0] = n + moved
    draft.seen[0] += change


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
    """Turn numbers first..last round."""
    while first < last:
        numbers[first], numbers[last] = numbers[last], numbers[first]
        first, last = first + 1, last - 1


@kernel
def reverse_rows(route: NDArray[np.float64], first: int, last: int) -> None:
    """Turn rows first..last of an (n, 3) array round."""
    while first < last:
        for axis in range(3):
            route[first, axis], route[last, axis] = route[last, axis], route[first, axis]
        first, last = first + 1, last - 1


@kernel
def transfer(draft: Draft, at: int, to: int) -> None:
    """Take waypoint ``at`` with its set out and put it in as waypoint ``to``; for sensing at waypoints, where order is free."""
    e, n, u = place(draft.route, at)
    step = 1 if to > at else -1
    k = at
    while k != to:
        _copy_row(draft.route, k + step, draft.route, k)
        k += step
    draft.route[to, 0], draft.route[to, 1], draft.route[to, 2] = e, n, u
    if to > at:
        _rotate_left(draft.slot, at, to)
    else:
        _rotate_right(draft.slot, to, at)
