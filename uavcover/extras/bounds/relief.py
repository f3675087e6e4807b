"""Ground and the highest places above it on a square lattice: what single places observe of it, and from how far it is observed.

Heights are linear in the triangles of the lattice's squares, which are cut from south-west to north-east. From a place, ground at
a distance r in a direction u is observed where r <= min(reach, tangent * (top there - ground there)). Along each direction that
is one interval from 0 on, because ground falls by less than 1 / tangent a metre.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel

LEAST_GROWTH = 0.05
"""The distance observed along a direction exceeds the cone at least at this rate: ground is made no steeper."""
EXACT_M = 1e-5
"""Of a distance observed."""
_RINGS = 12


class Relief(NamedTuple):
    """Ground around an area, the highest allowed positions above it, and how far a sensor observes from there.

    Attributes:
        ground_m: (rows + 1, columns + 1) up of the nodes: the ground is nowhere below what lies between them.
        top_m: of the same shape: no allowed position is above what lies between them.
        allowed: (rows, columns) whether a place in each square may be allowed.
        side: of the squares, metres.
        tangent: of the half angle of view; 0 where height does not matter.
        reach: nothing further away on the map is observed.
    """

    ground_m: NDArray[np.float64]
    top_m: NDArray[np.float64]
    allowed: NDArray[np.bool_]
    side: float
    tangent: float
    reach: float


@kernel
def height(relief: Relief, up: NDArray[np.float64], e: float, n: float) -> tuple[float, float, float]:
    """Height between nodes and its slopes, at metres east and north of the first node."""
    j, i = int(e / relief.side), int(n / relief.side)
    along, across = e / relief.side - j, n / relief.side - i
    sw, ne = up[i, j], up[i + 1, j + 1]
    if along >= across:
        de, dn = up[i, j + 1] - sw, ne - up[i, j + 1]
    else:
        de, dn = ne - up[i + 1, j], up[i + 1, j] - sw
    return sw + along * de + across * dn, de / relief.side, dn / relief.side


@kernel
def farthest_observed(relief: Relief, e: float, n: float, top: float, ue: float, un: float, guess: float) -> float:
    """Distance to which ground is observed along a direction from a place, metres; to 0.01 mm, and at most ``reach``."""
    if relief.tangent == 0.0:
        return relief.reach
    low, high = 0.0, relief.reach
    r = min(max(guess, low), high)
    for _ in range(60):
        up, ge, gn = height(relief, relief.ground_m, e + r * ue, n + r * un)
        beyond = r - relief.tangent * (top - up)
        if beyond > 0.0:
            high = r
        else:
            low = r
        if abs(beyond) < EXACT_M * LEAST_GROWTH or high - low < EXACT_M:
            break
        r -= beyond / (1.0 + relief.tangent * (ge * ue + gn * un))
        if r >= relief.reach == high and low < high:
            up, ge, gn = height(relief, relief.ground_m, e + high * ue, n + high * un)
            if high <= relief.tangent * (top - up):
                return high
        if not low < r < high:
            r = 0.5 * (low + high)
    return r


@kernel
def _worth_in_view(
    relief: Relief, per_m2: NDArray[np.float64], south: float, west: float, north: float, east: float, top: float
) -> float:
    """Most worth in view from any one place of a rectangle, not above ``top``; sides in squares from the first node."""
    rows, columns = per_m2.shape
    side, around = relief.side, int(relief.reach / relief.side) + 2
    worth = 0.0
    for i in range(max(0, int(south) - around), min(rows, int(north) + around + 1)):
        dn = max(0.0, max(south - i - 1, i - north)) * side
        for j in range(max(0, int(west) - around), min(columns, int(east) + around + 1)):
            if not per_m2[i, j] > 0.0:
                continue
            de = max(0.0, max(west - j - 1, j - east)) * side
            farthest = relief.reach
            if relief.tangent > 0.0:
                g = relief.ground_m
                lowest = min(min(g[i, j], g[i, j + 1]), min(g[i + 1, j], g[i + 1, j + 1]))
                farthest = min(farthest, relief.tangent * (top - lowest))
            if farthest >= 0.0 and de * de + dn * dn <= farthest * farthest:
                worth += per_m2[i, j]
    return worth * side * side


@allocating_kernel
def looks_from_tiles(
    relief: Relief, per_m2: NDArray[np.float64], tile: int, wanted: NDArray[np.bool_], looks: NDArray[np.float64]
) -> None:
    """Write what is in view at most from any one place of each tile of squares; for a tile of 0 from the middle of each square.

    Args:
        relief: heights.
        per_m2: (rows, columns) mean price in each square.
        tile: squares along the side of a tile, or 0.
        wanted: (tile rows, tile columns) the tiles to be looked at; squares for a tile of 0.
        looks: of the same shape, is written; 0 elsewhere.
    """
    rows, columns = relief.allowed.shape
    each = max(tile, 1)
    for a in range(wanted.shape[0]):
        for b in range(wanted.shape[1]):
            looks[a, b] = 0.0
            i0, j0 = a * each, b * each
            i1, j1 = min(i0 + each, rows), min(j0 + each, columns)
            if not wanted[a, b] or not relief.allowed[i0:i1, j0:j1].any():
                continue
            if tile > 0:
                top = relief.top_m[i0 : i1 + 1, j0 : j1 + 1].max()
                looks[a, b] = _worth_in_view(relief, per_m2, float(i0), float(j0), float(i1), float(j1), top)
            else:
                top, _, _ = height(relief, relief.top_m, (j0 + 0.5) * relief.side, (i0 + 0.5) * relief.side)
                looks[a, b] = _worth_in_view(relief, per_m2, i0 + 0.5, j0 + 0.5, i0 + 0.5, j0 + 0.5, top)


@allocating_kernel
def rates_by_node(
    relief: Relief, priced: NDArray[np.bool_], where: NDArray[np.int64], directions: NDArray[np.float64],
    headings: NDArray[np.float64], corner: tuple[float, float], block: float, across: int, room: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:  # fmt: skip
    """Gain of a metre of path along each heading for each price of a node of blocks, at the middles of squares.

    Args:
        relief: heights.
        priced: (rows, columns) whether the ground of each square has a price.
        where: (p, 2) row and column of squares.
        directions: (bins, 2) as in :func:`rates_in_squares`.
        headings: (m, 2), of that function too.
        corner: of the first block, metres east and north of the relief's.
        block: side of the blocks, metres.
        across: nodes in a row of blocks.
        room: for how many pairs of a place and a price.

    Returns:
        In compressed rows, one a place: their beginnings (p + 1,), -1 first with too little room; the prices (k,); and (k, m + 1)
        the rates, and last the square metres that are observed from there.
    """
    bins, count = len(directions), len(headings)
    wide = 2.0 * math.pi / bins
    starts, columns, data = np.zeros(len(where) + 1, np.int64), np.empty(room, np.int32), np.zeros((room, count + 1))
    observed_at, slot = np.full(across * across, -1), np.zeros(across * across, np.int64)
    gains = np.empty(count + 1)
    filled = 0
    for p in range(len(where)):
        e, n = (where[p, 1] + 0.5) * relief.side, (where[p, 0] + 0.5) * relief.side
        # Just beside the diagonal, on both sides of it.
        top, e0, n0 = height(relief, relief.top_m, e + 0.1 * relief.side, n)
        top, e1, n1 = height(relief, relief.top_m, e, n + 0.1 * relief.side)
        top, _, _ = height(relief, relief.top_m, e, n)
        r = 0.5 * relief.reach
        for k in range(bins):
            ue, un = directions[k, 0], directions[k, 1]
            r = farthest_observed(relief, e, n, top, ue, un, r)
            growth, lift = 1.0, 0.0
            if relief.tangent > 0.0 and r < relief.reach:
                _, ge, gn = height(relief, relief.ground_m, e + r * ue, n + r * un)
                growth, lift = 1.0 + relief.tangent * (ge * ue + gn * un), 0.5 * relief.tangent
            for ring in range(_RINGS + 1):
                at = r * min(1.0, (ring + 0.5) / _RINGS)
                pe, pn = e + at * ue, n + at * un
                if not priced[int(pn / relief.side), int(pe / relief.side)]:
                    continue
                gains[:] = 0.0
                if ring < _RINGS:
                    gains[count] = at * (r / _RINGS) * wide
                else:
                    for m in range(count):
                        he, hn = headings[m, 0], headings[m, 1]
                        toward = he * (ue + lift * (e0 + e1)) + hn * (un + lift * (n0 + n1))
                        gains[m] = 0.5 * r / growth * wide * abs(toward)
                along, up = (pe - corner[0]) / block, (pn - corner[1]) / block
                j, i = int(along), int(up)
                along, up = along - j, up - i
                for c in range(4):
                    node = (i + c // 2) * across + j + c % 2
                    if observed_at[node] != p:
                        if filled == room:
                            starts[0] = -1
                            return starts, columns, data
                        observed_at[node], slot[node] = p, filled
                        columns[filled] = node
                        filled += 1
                    part = (up if c // 2 else 1.0 - up) * (along if c % 2 else 1.0 - along)
                    for m in range(count + 1):
                        data[slot[node], m] += part * gains[m]
        starts[p + 1] = filled
    return starts, columns[:filled], data[:filled]


_SQUARES_OF_BLOCK = 8


@allocating_kernel
def farthest_looks(
    centres: NDArray[np.float64],
    tops: NDArray[np.float64],
    east0: float,
    north0: float,
    side: float,
    tan_half_fov: float,
    reach: float,
) -> NDArray[np.float64]:
    """(n,) no allowed position further away than this, on the map, observes a cell through a cone; 0 where none does.

    The map is cut into squares. From a place at distance d a camera that looks straight down observes a cell when d <=
    tan_half_fov times its height above the cell, which is at most that of the square's top. Nothing else is asked (range,
    incidence, line of sight), so the true distance may be smaller, never larger.

    Args:
        centres: (n, 3) of the cells.
        tops: (rows, columns) highest allowed up coordinate anywhere over each square; NaN: no place is allowed there.
        east0: of the south-west corner of the first square.
        north0: of the same corner.
        side: of the squares.
        tan_half_fov: of the cone.
        reach: no place further away on the map observes anything.
    """
    rows, columns = tops.shape
    out = np.zeros(centres.shape[0])
    # Blocks of squares first: most of them are too low, or nearer than what is found already.
    block = _SQUARES_OF_BLOCK * side
    highest = _highest_of_blocks(tops)
    offsets, farthest = _squares_around(int(reach / block) + 2, block)
    top = np.nanmax(tops) if np.isfinite(tops).any() else -math.inf
    for k in range(centres.shape[0]):
        e, n, u = centres[k, 0] - east0, centres[k, 1] - north0, centres[k, 2]
        row, column = math.floor(n / block), math.floor(e / block)
        # What is further away than the highest place could observe is passed over; from there inwards, until the rest is nearer.
        most = min(reach, tan_half_fov * (top - u)) + 3.0 * block
        for at in range(np.searchsorted(-farthest, -most), len(farthest)):
            if farthest[at] <= out[k]:
                break
            for quadrant in range(4):
                i = row + (offsets[at, 0] if quadrant % 2 else -offsets[at, 0])
                j = column + (offsets[at, 1] if quadrant // 2 else -offsets[at, 1])
                if i < 0 or j < 0 or i >= highest.shape[0] or j >= highest.shape[1]:
                    continue
                if _farthest_in_square(e, n, u, i, j, block, highest[i, j], tan_half_fov, reach) <= out[k]:
                    continue
                for r in range(i * _SQUARES_OF_BLOCK, min((i + 1) * _SQUARES_OF_BLOCK, rows)):
                    for c in range(j * _SQUARES_OF_BLOCK, min((j + 1) * _SQUARES_OF_BLOCK, columns)):
                        look = _farthest_in_square(e, n, u, r, c, side, tops[r, c], tan_half_fov, reach)
                        out[k] = max(out[k], look)
    return out


@allocating_kernel
def _highest_of_blocks(tops: NDArray[np.float64]) -> NDArray[np.float64]:
    """Highest of (rows, columns) numbers in blocks of _SQUARES_OF_BLOCK rows and columns; NaN without one."""
    rows, columns = tops.shape
    out = np.full((math.ceil(rows / _SQUARES_OF_BLOCK), math.ceil(columns / _SQUARES_OF_BLOCK)), math.nan)
    for i in range(rows):
        for j in range(columns):
            r, c = i // _SQUARES_OF_BLOCK, j // _SQUARES_OF_BLOCK
            if math.isnan(out[r, c]) or tops[i, j] > out[r, c]:
                out[r, c] = tops[i, j]
    return out


@kernel
def _farthest_in_square(
    e: float, n: float, u: float, i: int, j: int, side: float, top: float, tan_half_fov: float, reach: float
) -> float:
    """Largest distance at which a place in a square observes a cell through a cone; 0 where none does, or its top is NaN."""
    if math.isnan(top):
        return 0.0
    radius = min(reach, tan_half_fov * (top - u))
    de_near, dn_near = max(0.0, j * side - e, e - (j + 1) * side), max(0.0, i * side - n, n - (i + 1) * side)
    if math.hypot(de_near, dn_near) > radius:
        return 0.0
    de_far, dn_far = max(abs(e - j * side), abs(e - (j + 1) * side)), max(abs(n - i * side), abs(n - (i + 1) * side))
    return min(radius, math.hypot(de_far, dn_far))


@allocating_kernel
def _squares_around(count: int, side: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Squares of a lattice up to a number of rows and columns away from one, those first that may reach furthest away.

    Returns:
        (m, 2) rows and columns away, of one quadrant, and (m,) no place of the square is further away from any place of the one.
    """
    size = count + 1
    far = np.empty(size * size)
    for i in range(size):
        for j in range(size):
            far[i * size + j] = side * math.hypot(i + 1.0, j + 1.0)
    order = np.argsort(-far)
    offsets = np.empty((size * size, 2), dtype=np.int64)
    for at in range(size * size):
        offsets[at, 0], offsets[at, 1] = order[at] // size, order[at] % size
    return offsets, far[order]
