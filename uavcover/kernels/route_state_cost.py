"""How much more a route under change costs: metres by its legs alone, or seconds with wind, climbs and turns.

Length has its own short way: the search for the shortest route asks it tens of thousands of times a second.
"""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import kernel
from uavcover.kernels.route_state import Draft, Task, distance, exchange_length, place
from uavcover.kernels.way_cost import LENGTH, WayCost, route_cost


@kernel
def is_length(way: WayCost) -> bool:
    """Whether nothing counts but the length."""
    return way.unit == LENGTH and way.deviation_price == 0.0


@kernel
def exchange_cost(task: Task, draft: Draft, first: int, last: int, fresh: int) -> float:
    """When waypoints first..last - 1 give way to the first ``fresh`` of draft.fresh."""
    if is_length(task.way):
        return exchange_length(draft, first, last, fresh)
    # Turns change up to one waypoint farther away than legs do.
    begin, end = max(first - 2, 0), min(last + 2, draft.size[0])
    new = np.empty((end - begin + fresh - (last - first), 3))
    for k in range(new.shape[0]):
        number = begin + k
        if number < first:
            new[k, 0], new[k, 1], new[k, 2] = place(draft.route, number)
        elif number < first + fresh:
            new[k, 0], new[k, 1], new[k, 2] = place(draft.fresh, number - first)
        else:
            new[k, 0], new[k, 1], new[k, 2] = place(draft.route, number - fresh + last - first)
    return route_cost(task.surface, task.way, new) - _stretch_cost(task, draft, begin, end)


@kernel
def reversal_cost(task: Task, draft: Draft, i: int, j: int) -> float:
    """When waypoints i..j are flown in the opposite order; with wind or turns O(j - i)."""
    n = draft.size[0]
    if is_length(task.way):
        p, q = place(draft.route, i), place(draft.route, j)
        longer = 0.0
        if i > 0:
            before = place(draft.route, i - 1)
            longer += distance(before, q) - distance(before, p)
        if j < n - 1:
            behind = place(draft.route, j + 1)
            longer += distance(p, behind) - distance(q, behind)
        return longer
    begin, end = max(i - 2, 0), min(j + 3, n)
    new = np.empty((end - begin, 3))
    for k in range(begin, end):
        new[k - begin, 0], new[k - begin, 1], new[k - begin, 2] = place(draft.route, i + j - k if i <= k <= j else k)
    return route_cost(task.surface, task.way, new) - _stretch_cost(task, draft, begin, end)


@kernel
def transfer_cost(task: Task, draft: Draft, at: int, to: int) -> float:
    """When waypoint ``at`` is taken out and draft.fresh[0] put in before waypoint ``to``; numbers count the route as it is."""
    n = draft.size[0]
    p = place(draft.fresh, 0)
    if is_length(task.way):
        longer = _shortcut_length(draft, at)
        before = to - 1 if to - 1 != at else to - 2
        if before >= 0:
            longer += distance(place(draft.route, before), p)
        if to < n:
            longer += distance(p, place(draft.route, to))
            if before >= 0:
                longer -= distance(place(draft.route, before), place(draft.route, to))
        return longer
    new = np.empty((n, 3))
    row = 0
    for k in range(n + 1):
        if k == to:
            new[row, 0], new[row, 1], new[row, 2] = p
            row += 1
        if k < n and k != at:
            new[row, 0], new[row, 1], new[row, 2] = place(draft.route, k)
            row += 1
    return route_cost(task.surface, task.way, new) - _stretch_cost(task, draft, 0, n)


@kernel
def _shortcut_length(draft: Draft, at: int) -> float:
    """Change of length when a waypoint is left out."""
    n = draft.size[0]
    p = place(draft.route, at)
    change = 0.0
    if at > 0:
        change -= distance(place(draft.route, at - 1), p)
    if at < n - 1:
        change -= distance(p, place(draft.route, at + 1))
        if at > 0:
            change += distance(place(draft.route, at - 1), place(draft.route, at + 1))
    return change


@kernel
def _stretch_cost(task: Task, draft: Draft, begin: int, end: int) -> float:
    """Of waypoints begin..end - 1 as they are."""
    stretch = np.empty((end - begin, 3))
    for k in range(begin, end):
        stretch[k - begin, 0], stretch[k - begin, 1], stretch[k - begin, 2] = place(draft.route, k)
    return route_cost(task.surface, task.way, stretch)


@kernel
def draft_cost(task: Task, route: NDArray[np.float64]) -> float:
    """Of an (n, 3) route, whole."""
    return route_cost(task.surface, task.way, route)
