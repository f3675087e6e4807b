"""The skyline of obstacles around a cell: the rays that they surely hide or surely do not hide.

The directions of the map are divided into 64 bins. In each bin, a ray that is steep enough passes over every obstacle. If one
edge of a footprint spans the bin, every ray that is flat enough and ends behind the edge is hidden. Bounds only save work: other
rays are tested against each obstacle on their path.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import ObstaclePrisms, boxes_m, distance_m, over_prism

BINS = 64
_PER_OCTANT = 8

UNDECIDED = 0
CLEAR = 1
HIDDEN = 2

_WIDER = 1e-9
"""Of a bin, on each side, so that rounding puts no ray into a bin that does not know it."""
_CERTAINLY = 1e-3
"""Fraction of a bound by which a ray has to be flatter, or longer: more than the tolerances of obstacles.keeps_clear."""
_NEAREST_M = 0.01
"""Edges nearer than this do not count as surely hiding a ray."""

_MOST_ROWS = 40_000
"""768 bytes each."""


class Skylines(NamedTuple):
    """Skylines of cells.

    Attributes:
        row: (n,) int32 row of each cell in ``bounds``, -1 where the cell has none; (0,) where no cell has one.
        bounds: (m, 64, 3) float32, for each bin: the tangent from which on a ray is clear, the one below which it is hidden
            (-inf: none is), and how far away on the map its other end has to be for that, metres.
    """

    row: NDArray[np.int32]
    bounds: NDArray[np.float32]


def _read_only(row: NDArray[np.int32], bounds: NDArray[np.float32]) -> Skylines:
    """Make arrays read-only, because kernels are compiled separately for writable and read-only arrays."""
    row.flags.writeable = bounds.flags.writeable = False
    return Skylines(row, bounds)


NO_SKYLINES = _read_only(np.empty(0, dtype=np.int32), np.empty((0, BINS, 3), dtype=np.float32))


def skylines(
    obstacles: ObstaclePrisms,
    centre: NDArray[np.float64],
    horizon: NDArray[np.float64],
    *,
    reach_m: float,
    flattest: float,
) -> Skylines:
    """Skylines of the cells that obstacles may hide; of none where there are too many of these.

    Args:
        obstacles: the prisms.
        centre: (n, 3) of the cells, none of them below a top inside its footprint.
        horizon: (n,) of :func:`uavcover.kernels.obstacles.horizons`, with the same reach.
        reach_m: on the map; rays to places further away do not matter.
        flattest: tangent; flatter rays need not be decided.
    """
    wanted = np.flatnonzero(horizon > flattest)
    if not 0 < len(wanted) <= _MOST_ROWS:
        return NO_SKYLINES
    row = np.full(len(centre), -1, dtype=np.int32)
    row[wanted] = np.arange(len(wanted), dtype=np.int32)
    return _read_only(row, _bounds(obstacles, np.ascontiguousarray(centre[wanted]), reach_m, flattest))


@kernel
def bin_of(east: float, north: float) -> int:
    """Number of the bin of a direction, counter-clockwise from east; any bin for no direction."""
    a, b = abs(east), abs(north)
    steep = b > a
    larger, smaller = (b, a) if steep else (a, b)
    k = min(_PER_OCTANT - 1, int(_PER_OCTANT * smaller / larger)) if larger > 0.0 else 0
    if steep:
        k = 2 * _PER_OCTANT - 1 - k
    # In the quadrant to the north-east; the others are its mirror images.
    if east < 0.0:
        k = 4 * _PER_OCTANT - 1 - k
    return BINS - 1 - k if north < 0.0 else k


@kernel
def skyline_row(skylines: Skylines, cell: int) -> int:
    """Row of a cell in ``bounds``, -1 where it has none."""
    return int(skylines.row[cell]) if skylines.row.size > 0 else -1


@kernel
def beyond_skyline(bounds: NDArray[np.float32], row: int, east: float, north: float, up: float) -> int:
    """Result of a row of ``bounds`` for the ray from its cell to a position: CLEAR, HIDDEN or UNDECIDED."""
    number = bin_of(east, north)
    over_ground = math.sqrt(east * east + north * north)
    if up >= bounds[row, number, 0] * over_ground:
        return CLEAR
    if up < bounds[row, number, 1] * over_ground and over_ground > bounds[row, number, 2]:
        return HIDDEN
    return UNDECIDED


@allocating_kernel
def _bounds(
    obstacles: ObstaclePrisms, centre: NDArray[np.float64], reach: float, flattest: float
) -> NDArray[np.float32]:
    """(n, 64, 3) of :class:`Skylines`."""
    out = np.empty((centre.shape[0], BINS, 3), dtype=np.float32)
    boxes = boxes_m(obstacles)
    for k in range(centre.shape[0]):
        e, n, u = centre[k, 0], centre[k, 1], centre[k, 2]
        for number in range(BINS):
            out[k, number, 0], out[k, number, 1], out[k, number, 2] = flattest * (1.0 + _CERTAINLY), -math.inf, 0.0
        for prism in range(obstacles.top_m.size):
            higher = obstacles.top_m[prism] - u
            away_e = max(0.0, boxes[prism, 0] - e, e - boxes[prism, 1])
            away_n = max(0.0, boxes[prism, 2] - n, n - boxes[prism, 3])
            if not higher > flattest * math.hypot(away_e, away_n):
                continue
            distance = distance_m(obstacles, prism, e, n, e, n, 0.0, 0.0)[0]
            if distance > reach or not higher > flattest * distance:
                continue
            if distance < _NEAREST_M or over_prism(obstacles, prism, e, n):
                for number in range(BINS):
                    out[k, number, 0], out[k, number, 1] = math.inf, -math.inf
                break
            for edge in range(obstacles.first_edge[prism], obstacles.first_edge[prism + 1]):
                ae, an = obstacles.edges_m[edge, 0] - e, obstacles.edges_m[edge, 1] - n
                be, bn = obstacles.edges_m[edge, 2] - e, obstacles.edges_m[edge, 3] - n
                _add_edge(out, k, (ae, an), (be, bn), higher)
    return out


@kernel
def _add_edge(
    bounds: NDArray[np.float32], row: int, a: tuple[float, float], b: tuple[float, float], higher: float
) -> None:
    """Add the wall a-b of an obstacle, given relative to a cell, to the skyline of the cell."""
    if a[0] * b[1] - a[1] * b[0] < 0.0:
        a, b = b, a
    # From a counter-clockwise to b, and a bin more on each side against rounding.
    first = bin_of(a[0], a[1]) - 1
    count = (bin_of(b[0], b[1]) - first + 1) % BINS + 1
    for k in range(count):
        number = (first + k) % BINS
        (re, rn), (le, ln) = _side(number), _side(number + 1)
        # How far left of the bin's right side the ends are, and how far right of its left side: in the bin both are positive.
        right_a, right_b = re * a[1] - rn * a[0], re * b[1] - rn * b[0]
        left_a, left_b = a[0] * ln - a[1] * le, b[0] * ln - b[1] * le
        wider = _WIDER * (abs(a[0]) + abs(a[1]) + abs(b[0]) + abs(b[1]))
        begin, end = _above(right_a + wider, right_b + wider, 0.0, 1.0)
        begin, end = _above(left_a + wider, left_b + wider, begin, end)
        if begin > end:
            continue
        nearest, farthest = _distances(a, b, begin, end)
        tangent = higher / nearest * (1.0 + _CERTAINLY) if nearest > 0.0 else math.inf
        bounds[row, number, 0] = max(bounds[row, number, 0], tangent)
        spans = right_a < -wider and left_b < -wider and nearest >= _NEAREST_M
        hides = higher / farthest * (1.0 - _CERTAINLY)
        if spans and hides > bounds[row, number, 1]:
            bounds[row, number, 1], bounds[row, number, 2] = hides, farthest * (1.0 + _CERTAINLY)


@kernel
def _side(number: int) -> tuple[float, float]:
    """A direction on the right side of a bin, which is the left side of the one before."""
    octant, k = number // _PER_OCTANT % 8, number % _PER_OCTANT
    ratio = k / _PER_OCTANT if octant % 2 == 0 else 1.0 - k / _PER_OCTANT
    e, n = (1.0, ratio) if octant in (0, 3, 4, 7) else (ratio, 1.0)
    return -e if 2 <= octant < 6 else e, -n if octant >= 4 else n


@kernel
def _above(at_0: float, at_1: float, begin: float, end: float) -> tuple[float, float]:
    """The part of begin..end where what changes evenly from ``at_0`` to ``at_1`` is not negative; empty when reversed."""
    if at_0 >= 0.0 and at_1 >= 0.0:
        return begin, end
    if at_0 < 0.0 and at_1 < 0.0:
        return 1.0, 0.0
    t = at_0 / (at_0 - at_1)
    return (max(begin, t), end) if at_0 < 0.0 else (begin, min(end, t))


@kernel
def _distances(a: tuple[float, float], b: tuple[float, float], begin: float, end: float) -> tuple[float, float]:
    """The smallest and largest distance of the part begin..end of a-b."""
    de, dn = b[0] - a[0], b[1] - a[1]
    length2 = de * de + dn * dn
    foot = -(a[0] * de + a[1] * dn) / length2 if length2 > 0.0 else begin
    nearest = min(end, max(begin, foot))
    at_begin = math.hypot(a[0] + begin * de, a[1] + begin * dn)
    at_end = math.hypot(a[0] + end * de, a[1] + end * dn)
    return math.hypot(a[0] + nearest * de, a[1] + nearest * dn), max(at_begin, at_end)
