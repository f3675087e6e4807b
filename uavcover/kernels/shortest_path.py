"""Shortest paths on the map past walls, over the corners that protrude into the free ground.

A* over the visibility graph. Edges are tested only when they leave the queue: of the lines between thousands of corners, a search
tests a few hundred. Only lines that touch the walls at both ends without entering them can be part of a shortest path (de Berg et
al., Computational Geometry, 3rd edition, section 15.2: tangents).
"""

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import ObstaclePrisms, keeps_clear

_STRAIGHT_M2 = 1e-7
"""A corner within rounding of a line is not on one side of it."""
_ROUNDABOUT, _AROUND_M = 1.2, 20.0
"""Search first for paths of at most this multiple of the straight line, plus this length; then for twice the length."""


@allocating_kernel
def are_clear(walls: ObstaclePrisms, lines: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) which of (n, 4) lines on the map, east and north of both ends, lead over no footprint. All tops are above 0."""
    out = np.empty(lines.shape[0], dtype=np.bool_)
    for k in range(lines.shape[0]):
        out[k] = _is_clear(walls, lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3])
    return out


@kernel
def _is_clear(walls: ObstaclePrisms, ae: float, an: float, be: float, bn: float) -> bool:
    """Whether the line from a to b on the map leads over no footprint."""
    return keeps_clear(walls, (ae, an, 0.0), (be, bn, 0.0), 0.0, 0.0)


@kernel
def _touches(corners: NDArray[np.float64], number: int, de: float, dn: float) -> bool:
    """Whether both sides of a corner are on one side of a line in direction d through it.

    A side along the line counts for both.

    Args:
        corners: (n, 6) east and north of each corner, of the one before it and of the one after it on its ring.
        number: of the corner.
        de: east.
        dn: north.
    """
    e, n = corners[number, 0], corners[number, 1]
    before = de * (corners[number, 3] - n) - dn * (corners[number, 2] - e)
    after = de * (corners[number, 5] - n) - dn * (corners[number, 4] - e)
    return bool(before * after >= 0.0 or min(abs(before), abs(after)) <= _STRAIGHT_M2 * (abs(de) + abs(dn)))


@allocating_kernel
def _shortest_over(
    walls: ObstaclePrisms, corners: NDArray[np.float64], a: tuple[float, float], b: tuple[float, float]
) -> tuple[NDArray[np.int64], float]:
    """:func:`shortest_path` over some corners, and its length; infinite without one."""
    n = corners.shape[0]
    to_goal = np.empty(n)
    ends_there = np.zeros(n, dtype=np.bool_)
    goal_visible = False
    for k in range(n):
        e, north = corners[k, 0], corners[k, 1]
        to_goal[k] = math.hypot(b[0] - e, b[1] - north)
        ends_there[k] = _touches(corners, k, b[0] - e, b[1] - north)
        goal_visible = goal_visible or (ends_there[k] and _is_clear(walls, e, north, b[0], b[1]))
    before = np.full(n + 1, -2)
    if not goal_visible:
        return before[:0], math.inf
    queue: list[tuple[float, float, int, int]] = [(math.hypot(b[0] - a[0], b[1] - a[1]), 0.0, n, -1)]
    for k in range(n):
        de, dn = corners[k, 0] - a[0], corners[k, 1] - a[1]
        if _touches(corners, k, de, dn):
            length = math.hypot(de, dn)
            queue.append((length + float(to_goal[k]), length, k, -1))
    heapq.heapify(queue)
    whole = math.inf
    while len(queue) > 0:
        _, length, k, by = heapq.heappop(queue)
        if before[k] != -2:
            continue
        from_e, from_n = (a[0], a[1]) if by < 0 else (corners[by, 0], corners[by, 1])
        to_e, to_n = (b[0], b[1]) if k == n else (corners[k, 0], corners[k, 1])
        if not _is_clear(walls, from_e, from_n, to_e, to_n):
            continue
        before[k] = by
        if k == n:
            whole = length
            break
        if ends_there[k]:
            whole_path = length + float(to_goal[k])
            heapq.heappush(queue, (whole_path, whole_path, n, k))
        for other in range(n):
            if before[other] != -2:
                continue
            de, dn = corners[other, 0] - to_e, corners[other, 1] - to_n
            if _touches(corners, k, de, dn) and _touches(corners, other, de, dn):
                further = length + math.hypot(de, dn)
                heapq.heappush(queue, (further + float(to_goal[other]), further, other, k))
    count, at = 0, int(before[n])
    while at >= 0:
        count, at = count + 1, int(before[at])
    path = np.empty(count, dtype=np.int64)
    at = int(before[n])
    while at >= 0:
        count -= 1
        path[count], at = at, int(before[at])
    return path, whole


@allocating_kernel
def shortest_path(
    walls: ObstaclePrisms, corners: NDArray[np.float64], a: tuple[float, float], b: tuple[float, float]
) -> NDArray[np.int64]:
    """Numbers of the corners on the shortest path from a to b; empty for a straight one, and without one.

    Args:
        walls: blocked ground, as footprints with tops above 0.
        corners: (n, 6) east and north of each corner that protrudes into the free ground, of the one before it and of the one
            after it on its ring.
        a: east and north of the first end.
        b: of the last one.
    """
    through = np.empty(corners.shape[0])
    for k in range(through.size):
        e, n = corners[k, 0], corners[k, 1]
        through[k] = math.hypot(e - a[0], n - a[1]) + math.hypot(b[0] - e, b[1] - n)
    most = _ROUNDABOUT * math.hypot(b[0] - a[0], b[1] - a[1]) + _AROUND_M
    while True:
        # A path that is not longer leads over none of the other corners.
        numbers = np.flatnonzero(through <= most)
        path, length = _shortest_over(walls, corners[numbers], a, b)
        if length <= most or numbers.size == through.size:
            return numbers[path]
        most *= 2.0
