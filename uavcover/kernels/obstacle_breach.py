"""Largest breach of the clearance from obstacles by a line, and its position: the figures of a refusal."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import (
    ObstaclePrisms,
    clear_of,
    distance_m,
    keeps_clear,
    lower_part,
    over_footprint,
    over_prism,
)


@allocating_kernel
def worst_breach(
    obstacles: ObstaclePrisms,
    p: Point,
    q: Point,
    beside: float,
    above: float,
) -> tuple[int, float, float]:
    """Largest missing clearance along the line p-q.

    For a prism, it is the smaller of two distances: sideways where the line is too low, and upwards where it is too near. A line
    that is too low over the footprint can only be raised.

    Returns:
        number of the prism, -1 if the line is clear of all; missing metres; its parameter 0..1.
    """
    (pe, pn, pu), (qe, qn, qu) = p, q
    worst, lacking, position = -1, 0.0, 0.0
    for prism in _near_line(obstacles, pe, pn, qe, qn):
        if clear_of(obstacles, prism, p, q, beside, above):
            continue
        higher, at = _lacking_height(obstacles, prism, p, q, beside, above)
        begin, end = lower_part(pu, qu, obstacles.top_m[prism] + above)
        if not over_footprint(obstacles, prism, pe, pn, qe, qn, begin, end):
            distance, nearest_at = distance_m(obstacles, prism, pe, pn, qe, qn, begin, end)
            if beside - distance < higher:
                higher, at = beside - distance, nearest_at
        if higher > lacking:
            worst, lacking, position = prism, higher, at
    return worst, lacking, position


@allocating_kernel
def _near_line(obstacles: ObstaclePrisms, pe: float, pn: float, qe: float, qn: float) -> NDArray[np.int64]:
    """Numbers of the prisms in the tiles along a finite line on the map, ascending: all within ``obstacles.grown_m`` of it."""
    rows, columns = obstacles.tile_top_m.shape
    tile = obstacles.tile_m
    x0, y0 = (pe - obstacles.west_m) / tile, (pn - obstacles.south_m) / tile
    x1, y1 = (qe - obstacles.west_m) / tile, (qn - obstacles.south_m) / tile
    near = np.zeros(obstacles.top_m.size, dtype=np.bool_)
    first_row = max(0, math.floor(min(y0, y1)))
    for i in range(first_row, min(rows - 1, math.floor(max(y0, y1))) + 1):
        # The part of the line in this row of tiles.
        begin, end = 0.0, 1.0
        if y1 != y0:
            t0, t1 = (i - y0) / (y1 - y0), (i + 1 - y0) / (y1 - y0)
            begin, end = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
        xa, xb = x0 + begin * (x1 - x0), x0 + end * (x1 - x0)
        first = max(0, math.floor(min(xa, xb)))
        for j in range(first, min(columns - 1, math.floor(max(xa, xb))) + 1):
            cell = i * columns + j
            for entry in range(obstacles.tile_first[cell], obstacles.tile_first[cell + 1]):
                near[obstacles.tile_prisms[entry]] = True
    return np.flatnonzero(near)


@kernel
def _lacking_height(
    obstacles: ObstaclePrisms,
    prism: int,
    p: Point,
    q: Point,
    beside: float,
    above: float,
) -> tuple[float, float]:
    """Missing height of the line p-q within ``beside`` of a footprint, and where along it, 0..1.

    Along the line height changes evenly, so it is lowest at an end of the part that is that near: at an end of the line, or
    where it enters or leaves the surroundings of an edge.
    """
    (pe, pn, pu), (qe, qn, qu) = p, q
    lowest, at = math.inf, 0.0
    for t in (0.0, 1.0):
        e, n = pe + t * (qe - pe), pn + t * (qn - pn)
        if pu + t * (qu - pu) < lowest and over_prism(obstacles, prism, e, n):
            lowest, at = pu + t * (qu - pu), t
    for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
        begin, end = _near_edge(
            (pe, pn), (qe - pe, qn - pn), (obstacles.edges_m[edge, 0], obstacles.edges_m[edge, 1]),
            (obstacles.edges_m[edge, 2], obstacles.edges_m[edge, 3]), beside,
        )  # fmt: skip
        if begin <= end:
            for t in (begin, end):
                up = pu + t * (qu - pu)
                if up < lowest or (up == lowest and t < at):
                    lowest, at = up, t
    return obstacles.top_m[prism] + above - lowest, at


@kernel
def _near_edge(
    p: tuple[float, float],
    d: tuple[float, float],
    a: tuple[float, float],
    b: tuple[float, float],
    radius: float,
) -> tuple[float, float]:
    """Interval in 0..1 where the line from p by d is within ``radius`` of the edge a-b; empty if reversed.

    The surroundings of an edge are convex: two discs and the strip between them.
    """
    (pe, pn), (de, dn), (ae, an), (be, bn) = p, d, a, b
    begin, end = 1.0, 0.0
    for ce, cn in ((ae, an), (be, bn)):
        low, high = _in_disc(pe - ce, pn - cn, de, dn, radius)
        if low <= high:
            begin, end = min(begin, low), max(end, high)
    length = math.hypot(be - ae, bn - an)
    if length > 0.0:
        ue, un = (be - ae) / length, (bn - an) / length
        low, high = _between((pe - ae) * ue + (pn - an) * un, de * ue + dn * un, 0.0, length)
        low2, high2 = _between((pn - an) * ue - (pe - ae) * un, dn * ue - de * un, -radius, radius)
        low, high = max(low, low2), min(high, high2)
        if low <= high:
            begin, end = min(begin, low), max(end, high)
    return begin, end


@kernel
def _in_disc(e: float, n: float, de: float, dn: float, radius: float) -> tuple[float, float]:
    """Where in 0..1 a place that moves from (e, n) by (de, dn) is within ``radius`` of the origin."""
    a, b, c = de * de + dn * dn, e * de + n * dn, e * e + n * n - radius * radius
    if a == 0.0:
        return (0.0, 1.0) if c <= 0.0 else (1.0, 0.0)
    root2 = b * b - a * c
    if root2 < 0.0:
        return 1.0, 0.0
    root = math.sqrt(root2)
    return max(0.0, (-b - root) / a), min(1.0, (-b + root) / a)


@kernel
def _between(value: float, change: float, low: float, high: float) -> tuple[float, float]:
    """Where in 0..1 a number that goes from ``value`` by ``change`` is between ``low`` and ``high``."""
    if change == 0.0:
        return (0.0, 1.0) if low <= value <= high else (1.0, 0.0)
    t0, t1 = (low - value) / change, (high - value) / change
    return max(0.0, min(t0, t1)), min(1.0, max(t0, t1))


@allocating_kernel
def breaches(
    obstacles: ObstaclePrisms,
    begins: NDArray[np.float64],
    ends: NDArray[np.float64],
    beside: float,
    above: float,
) -> NDArray[np.float64]:
    """(n, 3) :func:`worst_breach` of the lines between (n, 3) positions; -1, 0, 0 if clear or not finite."""
    out = np.zeros((begins.shape[0], 3))
    for k in range(begins.shape[0]):
        p = (begins[k, 0], begins[k, 1], begins[k, 2])
        q = (ends[k, 0], ends[k, 1], ends[k, 2])
        out[k, 0] = -1.0
        if math.isfinite(p[0] + p[1] + p[2] + q[0] + q[1] + q[2]) and not keeps_clear(obstacles, p, q, beside, above):
            out[k, 0], out[k, 1], out[k, 2] = worst_breach(obstacles, p, q, beside, above)
    return out


@allocating_kernel
def tops_near_m(obstacles: ObstaclePrisms, lines: NDArray[np.float64], beside: float) -> NDArray[np.float64]:
    """(n,) highest top within ``beside`` of each of (n, 4) lines on the map; -inf without one."""
    out = np.full(lines.shape[0], -math.inf)
    for k in range(lines.shape[0]):
        if obstacles.top_m.size == 0 or not math.isfinite(lines[k].sum()):
            continue
        for prism in _near_line(obstacles, lines[k, 0], lines[k, 1], lines[k, 2], lines[k, 3]):
            # Lower than any top, every part of the line counts.
            if obstacles.top_m[prism] > out[k] and not clear_of(
                obstacles,
                prism,
                (lines[k, 0], lines[k, 1], -math.inf),
                (lines[k, 2], lines[k, 3], -math.inf),
                beside,
                0.0,
            ):
                out[k] = obstacles.top_m[prism]
    return out


@kernel
def _edge_distance_m(footprints: ObstaclePrisms, number: int, e: float, n: float) -> float:
    """Distance of a place from the edges of a footprint."""
    least = math.inf
    for edge in range(footprints.first_edge[number], footprints.first_edge[number + 1]):
        ae, an = footprints.edges_m[edge, 0], footprints.edges_m[edge, 1]
        de, dn = footprints.edges_m[edge, 2] - ae, footprints.edges_m[edge, 3] - an
        length2 = de * de + dn * dn
        t = min(1.0, max(0.0, ((e - ae) * de + (n - an) * dn) / length2)) if length2 > 0.0 else 0.0
        least = min(least, (ae + t * de - e) ** 2 + (an + t * dn - n) ** 2)
    return math.sqrt(least)


_COARSE = 8


@allocating_kernel
def edge_distances_m(
    footprints: ObstaclePrisms, numbers: NDArray[np.int64], positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(k, m) distances of (k, m, 2) positions along lines from the edges of one footprint each.

    Footprints are given by their number (k,). -1 if another position of the line is certainly farther away: the distance changes
    by at most the spacing of the positions, so most of them are known from every eighth.
    """
    count = positions.shape[1]
    out = np.full((positions.shape[0], count), -1.0)
    for k in range(positions.shape[0]):
        farthest = -1.0
        for j in range(0, count, _COARSE):
            out[k, j] = _edge_distance_m(footprints, numbers[k], positions[k, j, 0], positions[k, j, 1])
            farthest = max(farthest, out[k, j])
        for j in range(count):
            if out[k, j] >= 0.0:
                continue
            before = j - j % _COARSE
            most = math.inf
            for other in (before, before + _COARSE):
                if other < count:
                    apart = math.hypot(
                        positions[k, j, 0] - positions[k, other, 0], positions[k, j, 1] - positions[k, other, 1]
                    )
                    most = min(most, out[k, other] + apart)
            if most >= farthest:
                out[k, j] = _edge_distance_m(footprints, numbers[k], positions[k, j, 0], positions[k, j, 1])
                farthest = max(farthest, out[k, j])
    return out


@allocating_kernel
def parts_over(
    footprints: ObstaclePrisms, numbers: NDArray[np.int64], lines: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The parts of (k, 4) lines on the map over one footprint each, given by its number (k,).

    Returns:
        (m,) number of the line, ascending; (m, 2) parameters 0..1 where the part begins and ends. A line without length is over
        a footprint as a whole or not at all.
    """
    owners = np.empty(max(16, numbers.size), dtype=np.int64)
    fractions = np.empty((owners.size, 2))
    count = 0
    for k in range(numbers.size):
        pe, pn = lines[k, 0], lines[k, 1]
        de, dn = lines[k, 2] - pe, lines[k, 3] - pn
        first, last = footprints.first_edge[numbers[k]], footprints.first_edge[numbers[k] + 1]
        at = np.empty(last - first + 2)
        at[0], at[1] = 0.0, 1.0
        crossings = 2
        if de != 0.0 or dn != 0.0:
            for edge in range(first, last):
                ae, an = footprints.edges_m[edge, 0] - pe, footprints.edges_m[edge, 1] - pn
                be, bn = footprints.edges_m[edge, 2] - pe, footprints.edges_m[edge, 3] - pn
                side_a, side_b = de * an - dn * ae, de * bn - dn * be
                if (side_a > 0.0) == (side_b > 0.0):
                    continue
                fraction = side_a / (side_a - side_b)
                t = ((ae + fraction * (be - ae)) * de + (an + fraction * (bn - an)) * dn) / (de * de + dn * dn)
                if 0.0 < t < 1.0:
                    at[crossings] = t
                    crossings += 1
        at = np.sort(at[:crossings])
        joins = False
        for j in range(crossings - 1):
            if at[j + 1] <= at[j]:
                continue
            middle = 0.5 * (at[j] + at[j + 1])
            if not over_prism(footprints, numbers[k], pe + middle * de, pn + middle * dn):
                joins = False
                continue
            if joins:
                fractions[count - 1, 1] = at[j + 1]
                continue
            if count == owners.size:
                owners, fractions = np.concatenate((owners, owners)), np.concatenate((fractions, fractions))
            owners[count], fractions[count, 0], fractions[count, 1] = k, at[j], at[j + 1]
            count, joins = count + 1, True
    return owners[:count].copy(), fractions[:count].copy()
