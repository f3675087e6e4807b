"""Obstacles as prisms: they block the line of sight and require clearance.

A prism has a footprint of straight edges (holes are edges like others), a flat top, and reaches down into the ground. Along a
straight line the part that is lower than a top is one interval, and where the line is over a footprint follows from its
crossings with the edges: rays and legs are judged in closed form, at their full length. A grid of tiles names the prisms near
a place, so that a line examines only those it passes.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.jit import allocating_kernel, kernel

_ROUNDING = 1e-9
"""In parameters 0..1 of a line, and in metres of a distance."""


_MARGIN_M = 0.01
_MOST_TILES = 250_000


class ObstaclePrisms(NamedTuple):
    """Prisms in the local frame.

    Attributes:
        edges_m: (m, 4) edges of the footprints: east and north of both ends.
        first_edge: (k + 1,) int64; edges first_edge[i] .. first_edge[i + 1] - 1 are those of prism i.
        top_m: (k,) up coordinate of the tops.
        west_m: east of the western end of the tiles.
        south_m: north of their southern end.
        tile_m: side of a tile.
        tile_top_m: (rows, columns) highest top of the prisms of a tile, -inf without one.
        tile_first: (rows * columns + 1,) int64; which entries of ``tile_prisms`` belong to a tile.
        tile_prisms: prisms whose footprint, grown by ``grown_m``, may reach into the tile.
        grown_m: largest distance at which prisms are examined.
    """

    edges_m: NDArray[np.float64]
    first_edge: NDArray[np.int64]
    top_m: NDArray[np.float64]
    west_m: float
    south_m: float
    tile_m: float
    tile_top_m: NDArray[np.float64]
    tile_first: NDArray[np.int64]
    tile_prisms: NDArray[np.int64]
    grown_m: float


def make_obstacles(
    edges_m: NDArray[np.float64], first_edge: NDArray[np.int64], top_m: NDArray[np.float64], *, grown_m: float
) -> ObstaclePrisms:
    """Prisms with their index of tiles.

    Args:
        edges_m: (m, 4) edges of the footprints.
        first_edge: (k + 1,) where the edges of each prism begin.
        top_m: (k,) up coordinates.
        grown_m: largest clearance that will be asked for.
    """
    count = top_m.size
    corners = np.asarray(edges_m, float).reshape(-1, 2, 2)
    low = np.array([corners[a:b].min(axis=(0, 1)) for a, b in itertools.pairwise(first_edge)])
    high = np.array([corners[a:b].max(axis=(0, 1)) for a, b in itertools.pairwise(first_edge)])
    low, high = low.reshape(count, 2) - grown_m - _MARGIN_M, high.reshape(count, 2) + grown_m + _MARGIN_M
    west, south = low.min(axis=0, initial=0.0 if count == 0 else math.inf)
    east, north = high.max(axis=0, initial=0.0 if count == 0 else -math.inf)
    usual = float(np.mean(high - low)) if count else 1.0
    tile = max(usual, math.sqrt((east - west) * (north - south) / _MOST_TILES), _MARGIN_M)
    rows, columns = (1, 1) if count == 0 else (1 + int((north - south) / tile), 1 + int((east - west) / tile))
    top = np.full((rows, columns), -np.inf)
    members: list[list[int]] = [[] for _ in range(rows * columns)]
    for number in range(count):
        j0, i0 = ((low[number] - (west, south)) / tile).astype(int)
        j1, i1 = ((high[number] - (west, south)) / tile).astype(int)
        top[i0 : i1 + 1, j0 : j1 + 1] = np.maximum(top[i0 : i1 + 1, j0 : j1 + 1], top_m[number])
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                members[i * columns + j].append(number)
    first = np.concatenate([[0], np.cumsum([len(tile_members) for tile_members in members])])
    made = ObstaclePrisms(
        edges_m=np.array(edges_m, dtype=np.float64, order="C").reshape(-1, 4),
        first_edge=np.array(first_edge, dtype=np.int64),
        top_m=np.array(top_m, dtype=np.float64),
        west_m=float(west),
        south_m=float(south),
        tile_m=float(tile),
        tile_top_m=top,
        tile_first=np.array(first, dtype=np.int64),
        tile_prisms=np.array([number for tile_members in members for number in tile_members], dtype=np.int64),
        grown_m=float(grown_m),
    )
    for array in (made.edges_m, made.first_edge, made.top_m, made.tile_top_m, made.tile_first, made.tile_prisms):
        array.flags.writeable = False
    return made


NO_OBSTACLES = make_obstacles(np.empty((0, 4)), np.zeros(1, dtype=np.int64), np.empty(0), grown_m=0.0)


@kernel
def keeps_clear(
    obstacles: ObstaclePrisms,
    p: Point,
    q: Point,
    beside: float,
    above: float,
) -> bool:
    """Whether the line p-q, wherever it is lower than ``above`` over a top, keeps ``beside`` away from that footprint.

    With both 0: whether it enters no prism. Lines that are not finite are not clear.

    Args:
        obstacles: the prisms.
        p: one end: east, north, up, metres.
        q: the other end.
        beside: clearance on the map, metres, at most ``obstacles.grown_m``.
        above: clearance over a top, metres.
    """
    if obstacles.top_m.size == 0:
        return True
    (pe, pn, pu), (qe, qn, qu) = p, q
    if not math.isfinite(pe + pn + pu + qe + qn + qu):
        return False
    rows, columns = obstacles.tile_top_m.shape
    tile = obstacles.tile_m
    x0, y0 = (pe - obstacles.west_m) / tile, (pn - obstacles.south_m) / tile
    x1, y1 = (qe - obstacles.west_m) / tile, (qn - obstacles.south_m) / tile
    first_row, last_row = max(0, math.floor(min(y0, y1))), min(rows - 1, math.floor(max(y0, y1)))
    for i in range(first_row, last_row + 1):
        # The part of the line in this row of tiles.
        begin, end = 0.0, 1.0
        if y1 != y0:
            t0, t1 = (i - y0) / (y1 - y0), (i + 1 - y0) / (y1 - y0)
            begin, end = max(0.0, min(t0, t1)), min(1.0, max(t0, t1))
        xa, xb = x0 + begin * (x1 - x0), x0 + end * (x1 - x0)
        lowest = min(pu + begin * (qu - pu), pu + end * (qu - pu))
        first = max(0, math.floor(min(xa, xb) - _ROUNDING))
        last = min(columns - 1, math.floor(max(xa, xb) + _ROUNDING))
        for j in range(first, last + 1):
            if lowest >= obstacles.tile_top_m[i, j] + above:
                continue
            cell = i * columns + j
            for entry in range(obstacles.tile_first[cell], obstacles.tile_first[cell + 1]):
                prism = obstacles.tile_prisms[entry]
                if not clear_of(obstacles, prism, p, q, beside, above):
                    return False
    return True


@kernel
def lower_part(pu: float, qu: float, limit: float) -> tuple[float, float]:
    """Interval in 0..1 where a line from height ``pu`` to ``qu`` is below ``limit``; empty if reversed."""
    if pu >= limit and qu >= limit:
        return 1.0, 0.0
    begin, end = 0.0, 1.0
    if pu >= limit:
        begin = (pu - limit) / (pu - qu)
    elif qu >= limit:
        end = (limit - pu) / (qu - pu)
    return begin, end


@kernel
def clear_of(
    obstacles: ObstaclePrisms,
    prism: int,
    p: Point,
    q: Point,
    beside: float,
    above: float,
) -> bool:
    """:func:`keeps_clear` for one prism."""
    (pe, pn, pu), (qe, qn, qu) = p, q
    begin, end = lower_part(pu, qu, obstacles.top_m[prism] + above)
    if begin > end:
        return True
    if over_footprint(obstacles, prism, pe, pn, qe, qn, begin, end):
        return False
    if beside > 0.0:
        return distance_m(obstacles, prism, pe, pn, qe, qn, begin, end)[0] >= beside - _ROUNDING
    return True


@kernel
def over_footprint(
    obstacles: ObstaclePrisms, prism: int, pe: float, pn: float, qe: float, qn: float, begin: float, end: float
) -> bool:
    """Whether the part begin..end of the line p-q on the map is over a footprint; touching it may count or not."""
    de, dn = qe - pe, qn - pn
    length2 = de * de + dn * dn
    if length2 == 0.0:
        return over_prism(obstacles, prism, pe, pn)
    inside = False
    for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
        ae, an = obstacles.edges_m[edge, 0] - pe, obstacles.edges_m[edge, 1] - pn
        be, bn = obstacles.edges_m[edge, 2] - pe, obstacles.edges_m[edge, 3] - pn
        side_a, side_b = de * an - dn * ae, de * bn - dn * be
        # A corner on the line belongs to one side: of the edges that meet there, an odd number crosses, or none.
        if (side_a > 0.0) == (side_b > 0.0):
            continue
        fraction = side_a / (side_a - side_b)
        t = ((ae + fraction * (be - ae)) * de + (an + fraction * (bn - an)) * dn) / length2
        if t > begin + _ROUNDING:
            if t < end - _ROUNDING:
                return True
            inside = not inside
    return inside and end > begin + _ROUNDING


@kernel
def over_prism(obstacles: ObstaclePrisms, prism: int, east: float, north: float) -> bool:
    """Whether a place on the map lies in a footprint (even-odd rule)."""
    inside = False
    for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
        ae, an = obstacles.edges_m[edge, 0], obstacles.edges_m[edge, 1]
        be, bn = obstacles.edges_m[edge, 2], obstacles.edges_m[edge, 3]
        if (an > north) != (bn > north) and east < ae + (north - an) / (bn - an) * (be - ae):
            inside = not inside
    return inside


@kernel
def distance_m(
    obstacles: ObstaclePrisms, prism: int, pe: float, pn: float, qe: float, qn: float, begin: float, end: float
) -> tuple[float, float]:
    """Distance on the map from the part begin..end of the line p-q to the edges of a footprint, and its parameter.

    The two do not cross, so the distance is that of an end of one to the other.
    """
    de, dn = qe - pe, qn - pn
    length2 = de * de + dn * dn
    best2, best_at = math.inf, begin
    for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
        ae, an = obstacles.edges_m[edge, 0], obstacles.edges_m[edge, 1]
        be, bn = obstacles.edges_m[edge, 2], obstacles.edges_m[edge, 3]
        # Each edge begins where another one ends: its first corner is enough.
        t = begin
        if length2 > 0.0:
            t = min(end, max(begin, ((ae - pe) * de + (an - pn) * dn) / length2))
        d2 = (pe + t * de - ae) ** 2 + (pn + t * dn - an) ** 2
        if d2 < best2:
            best2, best_at = d2, t
        for at in (begin, end):
            d2 = _distance2_to_edge(pe + at * de, pn + at * dn, ae, an, be, bn)
            if d2 < best2:
                best2, best_at = d2, at
    return math.sqrt(best2), best_at


@kernel
def _distance2_to_edge(e: float, n: float, ae: float, an: float, be: float, bn: float) -> float:
    """Square of the distance of a place from an edge."""
    de, dn = be - ae, bn - an
    length2 = de * de + dn * dn
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, ((e - ae) * de + (n - an) * dn) / length2))
    return (e - ae - s * de) ** 2 + (n - an - s * dn) ** 2


@allocating_kernel
def roofs_m(obstacles: ObstaclePrisms, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) up coordinate of the highest top over each of (n,) positions; -inf where no prism stands."""
    rows, columns = obstacles.tile_top_m.shape
    out = np.full(east.size, -math.inf)
    if obstacles.top_m.size == 0:
        return out
    for k in range(east.size):
        i = math.floor((north[k] - obstacles.south_m) / obstacles.tile_m)
        j = math.floor((east[k] - obstacles.west_m) / obstacles.tile_m)
        if 0 <= i < rows and 0 <= j < columns:
            for entry in range(obstacles.tile_first[i * columns + j], obstacles.tile_first[i * columns + j + 1]):
                prism = obstacles.tile_prisms[entry]
                if obstacles.top_m[prism] > out[k] and over_prism(obstacles, prism, east[k], north[k]):
                    out[k] = obstacles.top_m[prism]
    return out


@kernel
def top_within_m(obstacles: ObstaclePrisms, east: float, north: float, radius: float) -> float:
    """Up coordinate of the highest top of the prisms within ``radius`` of a place on the map; -inf without one."""
    if obstacles.top_m.size == 0 or not math.isfinite(east + north):
        return -math.inf
    rows, columns = obstacles.tile_top_m.shape
    tile, around = obstacles.tile_m, max(0.0, radius - obstacles.grown_m)
    top = -math.inf
    for i in range(
        max(0, math.floor((north - around - obstacles.south_m) / tile)),
        min(rows - 1, math.floor((north + around - obstacles.south_m) / tile)) + 1,
    ):
        for j in range(
            max(0, math.floor((east - around - obstacles.west_m) / tile)),
            min(columns - 1, math.floor((east + around - obstacles.west_m) / tile)) + 1,
        ):
            if obstacles.tile_top_m[i, j] <= top:
                continue
            cell = i * columns + j
            for entry in range(obstacles.tile_first[cell], obstacles.tile_first[cell + 1]):
                prism = obstacles.tile_prisms[entry]
                if obstacles.top_m[prism] > top and (
                    over_prism(obstacles, prism, east, north)
                    or distance_m(obstacles, prism, east, north, east, north, 0.0, 0.0)[0] <= radius
                ):
                    top = obstacles.top_m[prism]
    return top


@allocating_kernel
def boxes_m(obstacles: ObstaclePrisms) -> NDArray[np.float64]:
    """(k, 4) west, east, south and north of the footprints."""
    out = np.empty((obstacles.top_m.size, 4))
    for prism in range(out.shape[0]):
        west, east, south, north = math.inf, -math.inf, math.inf, -math.inf
        for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
            west, east = min(west, obstacles.edges_m[edge, 0]), max(east, obstacles.edges_m[edge, 0])
            south, north = min(south, obstacles.edges_m[edge, 1]), max(north, obstacles.edges_m[edge, 1])
        out[prism, 0], out[prism, 1], out[prism, 2], out[prism, 3] = west, east, south, north
    return out


@allocating_kernel
def horizons(
    obstacles: ObstaclePrisms,
    lattice: NDArray[np.int32],
    centre: NDArray[np.float64],
    east0: float,
    north0: float,
    size: float,
    reach: float,
) -> NDArray[np.float64]:
    """(n,) tangent of the steepest slope from each cell to the top of a prism within ``reach``; 0 without one.

    A ray that leaves the cell at least as steeply passes over all of them.

    Args:
        obstacles: the prisms.
        lattice: (rows, columns) numbers of the cells, -1 without one.
        centre: (n, 3) of the cells.
        east0: east of column 0.
        north0: north of row 0.
        size: side of a cell.
        reach: metres on the map; prisms farther away do not matter.
    """
    out = np.zeros(centre.shape[0])
    rows, columns = lattice.shape
    boxes = boxes_m(obstacles)
    for prism in range(obstacles.top_m.size):
        top = obstacles.top_m[prism]
        west, east, south, north = boxes[prism, 0], boxes[prism, 1], boxes[prism, 2], boxes[prism, 3]
        first_row = max(0, math.ceil((south - reach - north0) / size))
        last_row = min(rows - 1, math.floor((north + reach - north0) / size))
        first_column = max(0, math.ceil((west - reach - east0) / size))
        last_column = min(columns - 1, math.floor((east + reach - east0) / size))
        for i in range(first_row, last_row + 1):
            for j in range(first_column, last_column + 1):
                cell = lattice[i, j]
                if cell < 0 or centre[cell, 2] >= top:
                    continue
                e, n = centre[cell, 0], centre[cell, 1]
                distance = distance_m(obstacles, prism, e, n, e, n, 0.0, 0.0)[0]
                if distance > reach:
                    continue
                slope = (top - centre[cell, 2]) / distance if distance > 0.0 else math.inf
                out[cell] = max(out[cell], slope)
    return out
