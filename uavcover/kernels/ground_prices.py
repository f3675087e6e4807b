"""How much newly seen ground a move is worth at most, when every cell has a price; docs/explanation/bounds.md has the proof.

Places are the nodes of a square lattice, each square cut into two triangles along the diagonal from south-west to north-east.
A cell's credit is a number for each node, 0 to 1, and linear in each triangle. It is 1 in every triangle from which the cell
may be seen, so a path that sees the cell has gained all of its credit. In a triangle shares have constant gradients; what a
move in a direction gains per metre is the sum of price times the gradient's part along it, where that is positive. For all
directions together these sums are the support function of a convex polygon (a sum of segments), so its values in 32
directions bound those between them, and no move of any direction at any place is left out.

Around a cell its credit falls as the share of the cell's own square that a straight edge has not yet passed: sums over a
lattice of cells are then free of the beat between the edge and the rows of cells.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.coverage import Cells
from uavcover.kernels.jit import kernel

HEADINGS = 32
_QUARTER = HEADINGS // 4
_STEP_COS, _STEP_SIN = math.cos(2.0 * math.pi / HEADINGS), math.sin(2.0 * math.pi / HEADINGS)
BEYOND, AT_THE_EDGE, WITHIN = 0, 1, 2
_COS = np.cos(2.0 * math.pi / HEADINGS * np.arange(HEADINGS))
_SIN = np.sin(2.0 * math.pi / HEADINGS * np.arange(HEADINGS))
_TANGENTS = np.tan(2.0 * math.pi / HEADINGS * np.arange(HEADINGS // 8 + 1))
_WIDEST = math.sqrt(2.0)
"""Diagonal of a square of side 1."""


class Places(NamedTuple):
    """Where a path may be, and how far it sees from there.

    Attributes:
        tops: (rows, columns) up that no allowed place in the squares around each node exceeds, -inf where none is allowed.
        allowed: (rows - 1, columns - 1) whether a place in each square may be allowed.
        east0: of the first node.
        north0: likewise.
        step: between nodes, metres.
        tangent: a cell is seen from no further on the map than this times the height above it.
        reach: nor from further than this, metres.
    """

    tops: NDArray[np.float64]
    allowed: NDArray[np.bool_]
    east0: float
    north0: float
    step: float
    tangent: float
    reach: float


@kernel
def credit(places: Places, row: int, column: int, ce: float, cn: float, cu: float, side: float) -> float:
    """Credit of a cell at a node: 1 when a place in the squares around the node may see it, falling to 0 further away."""
    top = places.tops[row, column]
    if not top > -math.inf:
        return 0.0
    de = abs(ce - places.east0 - column * places.step)
    dn = abs(cn - places.north0 - row * places.step)
    near_e, near_n = max(0.0, de - places.step), max(0.0, dn - places.step)
    beyond = math.sqrt(near_e * near_e + near_n * near_n) - min(places.reach, places.tangent * (top - cu))
    if beyond <= 0.0:
        return 1.0
    if beyond >= _WIDEST * side:
        return 0.0
    distance = math.sqrt(de * de + dn * dn)
    if distance == 0.0:
        return 0.0
    # The square as a straight edge passes it: first its corner, then its whole width, then the corner across.
    long, short = side * max(de, dn) / distance, side * min(de, dn) / distance
    if beyond >= long + short:
        return 0.0
    if beyond < short:
        return float(1.0 - beyond * beyond / (2.0 * long * short))
    if beyond < long:
        return float(1.0 - (beyond - 0.5 * short) / long)
    rest = long + short - beyond
    return float(rest * rest / (2.0 * long * short))


@kernel
def direction_bin(e: float, n: float) -> int:
    """Which of the sectors between neighbouring headings a vector points into; the first begins in the east."""
    steep, flat = abs(n), abs(e)
    low, high = min(steep, flat), max(steep, flat)
    octant = 0
    for k in range(1, HEADINGS // 8):
        if low >= _TANGENTS[k] * high:
            octant = k
    quadrant = octant if flat >= steep else _QUARTER - 1 - octant
    if e >= 0.0:
        return quadrant if n >= 0.0 else HEADINGS - 1 - quadrant
    return 2 * _QUARTER - 1 - quadrant if n >= 0.0 else 2 * _QUARTER + quadrant


@kernel
def largest_rate(sums: NDArray[np.float64]) -> tuple[float, int]:
    """What is gained per metre in any direction at most, and near which heading.

    Args:
        sums: (HEADINGS, 2) sums of price times gradient, by the sector that the gradient points into.
    """
    # Exact along the headings, because no sector lies on both sides of the normal to one of them.
    east = sums[:_QUARTER, 0].sum() + sums[-_QUARTER:, 0].sum()
    north = sums[:_QUARTER, 1].sum() + sums[-_QUARTER:, 1].sum()
    before = east
    best, at = 0.0, 0
    for k in range(1, HEADINGS + 1):
        out, into = (k - 1 - _QUARTER) % HEADINGS, (k - 1 + _QUARTER) % HEADINGS
        east += sums[into, 0] - sums[out, 0]
        north += sums[into, 1] - sums[out, 1]
        after = east * _COS[k % HEADINGS] + north * _SIN[k % HEADINGS]
        # Where the tangents of both headings meet the polygon's outline can be; it is nowhere further out between them.
        beside = (after - before * _STEP_COS) / _STEP_SIN
        other = (before - after * _STEP_COS) / _STEP_SIN
        value = before if beside < 0.0 else after if other < 0.0 else math.sqrt(before * before + beside * beside)
        if value > best:
            best, at = value, (k - 1) % HEADINGS
        before = after
    return best, at


@kernel
def _cells_near(
    cells: Cells, west: float, south: float, east: float, north: float, far: float
) -> tuple[int, int, int, int]:
    """First row, last row, first column and last column of the cells within ``far`` of a box."""
    far += cells.scatter_m
    first_row = max(0, math.floor((south - far - cells.north0_m) / cells.size_m))
    last_row = min(cells.lattice.shape[0] - 1, math.ceil((north + far - cells.north0_m) / cells.size_m))
    first_column = max(0, math.floor((west - far - cells.east0_m) / cells.size_m))
    last_column = min(cells.lattice.shape[1] - 1, math.ceil((east + far - cells.east0_m) / cells.size_m))
    return first_row, last_row, first_column, last_column


@kernel
def _tile(places: Places, across: int, i0: int, j0: int) -> tuple[int, int, float, float, bool]:
    """Rows and columns of squares in a tile, its lowest and highest top, and whether any of its squares is allowed."""
    rows = min(across, places.tops.shape[0] - 1 - i0)
    columns = min(across, places.tops.shape[1] - 1 - j0)
    low, high, any_allowed = math.inf, -math.inf, False
    for i in range(i0, i0 + rows + 1):
        for j in range(j0, j0 + columns + 1):
            low, high = min(low, places.tops[i, j]), max(high, places.tops[i, j])
            any_allowed = any_allowed or (i < i0 + rows and j < j0 + columns and places.allowed[i, j])
    return rows, columns, low, high, any_allowed


@kernel
def _standing(
    places: Places,
    box: tuple[float, float, float, float],
    low: float,
    high: float,
    ce: float,
    cn: float,
    cu: float,
    side: float,
) -> int:
    """Whether a cell's credit is 0 at all nodes of a box, 1 at all of them, or neither for certain."""
    west, south, east, north = box
    near_e, near_n = max(0.0, west - ce, ce - east), max(0.0, south - cn, cn - north)
    farthest_look = min(places.reach, places.tangent * (high - cu))
    if math.sqrt(near_e * near_e + near_n * near_n) - _WIDEST * (places.step + side) >= farthest_look:
        return BEYOND
    far_e, far_n = max(abs(west - ce), abs(east - ce)), max(abs(south - cn), abs(north - cn))
    if low > -math.inf and math.sqrt(far_e * far_e + far_n * far_n) <= min(places.reach, places.tangent * (low - cu)):
        return WITHIN
    return AT_THE_EDGE


@kernel
def rates_in_tiles(
    places: Places,
    cells: Cells,
    price: NDArray[np.float64],
    across: int,
    stride: int,
    rates: NDArray[np.float64],
    worst: NDArray[np.int64],
) -> None:
    """Write what a metre of path gains at most anywhere in each tile of the places.

    Args:
        places: the lattice.
        cells: of the area.
        price: (n,) of each cell, metres, at least 0.
        across: squares along the side of a tile.
        stride: 1 for a proof; further on only every so many rows and columns of squares are looked at.
        rates: (tile rows, tile columns) is written.
        worst: (tile rows, tile columns, 4) is written: row and column of the square, triangle and heading of the largest.
    """
    sums = np.empty((across, across, 2, HEADINGS, 2))
    for tile_row in range(rates.shape[0]):
        for tile_column in range(rates.shape[1]):
            i0, j0 = tile_row * across, tile_column * across
            rates[tile_row, tile_column] = 0.0
            rows, columns, low, high, any_allowed = _tile(places, across, i0, j0)
            if not any_allowed:
                continue
            _sum_gradients(places, cells, price, (i0, j0, rows, columns), (low, high), stride, sums)
            for i in range(0, rows, stride):
                for j in range(0, columns, stride):
                    if not places.allowed[i0 + i, j0 + j]:
                        continue
                    for triangle in range(2):
                        rate, heading = largest_rate(sums[i, j, triangle])
                        if rate > rates[tile_row, tile_column]:
                            rates[tile_row, tile_column] = rate
                            place = worst[tile_row, tile_column]
                            place[0], place[1], place[2], place[3] = i0 + i, j0 + j, triangle, heading


@kernel
def _box_of(places: Places, tile: tuple[int, int, int, int]) -> tuple[float, float, float, float]:
    """West, south, east and north of the first so many rows and columns of squares from a node on."""
    i0, j0, rows, columns = tile
    west, south = places.east0 + j0 * places.step, places.north0 + i0 * places.step
    return west, south, west + columns * places.step, south + rows * places.step


@kernel
def _sum_gradients(
    places: Places,
    cells: Cells,
    price: NDArray[np.float64],
    tile: tuple[int, int, int, int],
    tops: tuple[float, float],
    stride: int,
    sums: NDArray[np.float64],
) -> None:
    """Write the sums of price times gradient in the triangles of a tile: (across, across, 2, HEADINGS, 2)."""
    i0, j0, rows, columns = tile
    box = _box_of(places, tile)
    shares = np.empty((rows + 1, columns + 1))
    sums[:] = 0.0
    far = places.reach + _WIDEST * (cells.size_m + places.step)
    first_row, last_row, first, last = _cells_near(cells, box[0], box[1], box[2], box[3], far)
    for r in range(first_row, last_row + 1):
        for s in range(first, last + 1):
            k = cells.lattice[r, s]
            if k < 0 or not price[k] > 0.0:
                continue
            ce, cn, cu = cells.centre_m[k, 0], cells.centre_m[k, 1], cells.centre_m[k, 2]
            if _standing(places, box, tops[0], tops[1], ce, cn, cu, cells.size_m) != AT_THE_EDGE:
                continue
            for i in range(rows + 1):
                for j in range(columns + 1):
                    shares[i, j] = credit(places, i0 + i, j0 + j, ce, cn, cu, cells.size_m)
            by = price[k] / places.step
            for i in range(0, rows, stride):
                for j in range(0, columns, stride):
                    sw, se, nw, ne = shares[i, j], shares[i, j + 1], shares[i + 1, j], shares[i + 1, j + 1]
                    _add(sums[i, j, 0], by * (se - sw), by * (ne - se))
                    _add(sums[i, j, 1], by * (ne - nw), by * (nw - sw))


@kernel
def _add(sums: NDArray[np.float64], e: float, n: float) -> None:
    if e != 0.0 or n != 0.0:
        sector = direction_bin(e, n)
        sums[sector, 0] += e
        sums[sector, 1] += n


@kernel
def largest_rates_of_cells(
    places: Places, cells: Cells, across: int, rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n,) the largest rate of all tiles in which each cell's credit may change."""
    out = np.zeros(cells.centre_m.shape[0])
    far = places.reach + _WIDEST * (cells.size_m + places.step)
    for tile_row in range(rates.shape[0]):
        for tile_column in range(rates.shape[1]):
            i0, j0 = tile_row * across, tile_column * across
            rows, columns, low, high, any_allowed = _tile(places, across, i0, j0)
            box = _box_of(places, (i0, j0, rows, columns))
            if not any_allowed:
                continue
            first_row, last_row, first, last = _cells_near(cells, box[0], box[1], box[2], box[3], far)
            for r in range(first_row, last_row + 1):
                for s in range(first, last + 1):
                    k = cells.lattice[r, s]
                    if k < 0 or out[k] >= rates[tile_row, tile_column]:
                        continue
                    centre = cells.centre_m[k]
                    if _standing(places, box, low, high, centre[0], centre[1], centre[2], cells.size_m) == AT_THE_EDGE:
                        out[k] = rates[tile_row, tile_column]
    return out


@kernel
def largest_first_look(places: Places, cells: Cells, price: NDArray[np.float64], across: int) -> float:
    """What all shares together are worth at most at any one place."""
    best = 0.0
    far = places.reach + _WIDEST * (cells.size_m + places.step)
    for i0 in range(0, places.tops.shape[0] - 1, across):
        for j0 in range(0, places.tops.shape[1] - 1, across):
            rows, columns, low, high, any_allowed = _tile(places, across, i0, j0)
            if not any_allowed:
                continue
            box = _box_of(places, (i0, j0, rows, columns))
            worth = 0.0
            first_row, last_row, first, last = _cells_near(cells, box[0], box[1], box[2], box[3], far)
            for r in range(first_row, last_row + 1):
                for s in range(first, last + 1):
                    k = cells.lattice[r, s]
                    if k < 0 or not price[k] > 0.0:
                        continue
                    ce, cn, cu = cells.centre_m[k, 0], cells.centre_m[k, 1], cells.centre_m[k, 2]
                    standing = _standing(places, box, low, high, ce, cn, cu, cells.size_m)
                    if standing == WITHIN:
                        worth += price[k]
                    elif standing == AT_THE_EDGE:
                        most = 0.0
                        for i in range(i0, i0 + rows + 1):
                            for j in range(j0, j0 + columns + 1):
                                most = max(most, credit(places, i, j, ce, cn, cu, cells.size_m))
                        worth += price[k] * most
            best = max(best, worth)
    return best


@kernel
def rates_by_node(
    places: Places,
    cells: Cells,
    weight: NDArray[np.float64],
    nodes: NDArray[np.int64],
    parts: NDArray[np.float64],
    where: NDArray[np.int64],
    room: int,
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """What a metre of path gains along each heading for each price, where a cell's price is interpolated among four.

    Args:
        places: the lattice.
        cells: of the area.
        weight: (n,) of each cell, at least 0.
        nodes: (n, 4) prices that count for each cell, all numbers below n.
        parts: (n, 4) how much each of them counts.
        where: (p, 3) row and column of a square, and which of its triangles.
        room: for how many pairs of a place and a price.

    Returns:
        In compressed rows, one a place: their beginnings (p + 1,), -1 first with too little room; the prices (m,); and
        (m, HEADINGS + 1) the rates, and last the weight that is credited at the square's first node.
    """
    starts = np.zeros(len(where) + 1, np.int64)
    columns = np.empty(room, np.int32)
    data = np.empty((room, HEADINGS + 1))
    seen_at, slot = np.full(nodes.max() + 1, -1), np.zeros(nodes.max() + 1, np.int64)
    gains = np.empty(HEADINGS + 1)
    far = places.reach + _WIDEST * (cells.size_m + places.step)
    filled = 0
    for p in range(len(where)):
        west, south, east, north = _box_of(places, (where[p, 0], where[p, 1], 1, 1))
        first_row, last_row, first, last = _cells_near(cells, west, south, east, north, far)
        for r in range(first_row, last_row + 1):
            for s in range(first, last + 1):
                k = cells.lattice[r, s]
                if k < 0 or not weight[k] > 0.0 or not _write_gains(places, cells, k, where[p], gains):
                    continue
                for c in range(4):
                    b = nodes[k, c]
                    if seen_at[b] != p:
                        if filled == room:
                            starts[0] = -1
                            return starts, columns, data
                        seen_at[b], slot[b] = p, filled
                        columns[filled] = b
                        data[filled] = 0.0
                        filled += 1
                    for m in range(HEADINGS + 1):
                        data[slot[b], m] += parts[k, c] * weight[k] * gains[m]
        starts[p + 1] = filled
    return starts, columns[:filled], data[:filled]


@kernel
def _write_gains(places: Places, cells: Cells, k: int, where: NDArray[np.int64], gains: NDArray[np.float64]) -> bool:
    """Write what a metre along each heading gains of a cell's credit, and its credit; False when all of it is 0."""
    i, j, triangle = where
    ce, cn, cu = cells.centre_m[k, 0], cells.centre_m[k, 1], cells.centre_m[k, 2]
    sw = credit(places, i, j, ce, cn, cu, cells.size_m)
    ne = credit(places, i + 1, j + 1, ce, cn, cu, cells.size_m)
    if triangle == 0:
        corner = credit(places, i, j + 1, ce, cn, cu, cells.size_m)
        ge, gn = corner - sw, ne - corner
    else:
        corner = credit(places, i + 1, j, ce, cn, cu, cells.size_m)
        ge, gn = ne - corner, corner - sw
    for m in range(HEADINGS):
        gains[m] = max(0.0, ge * _COS[m] + gn * _SIN[m]) / places.step
    gains[HEADINGS] = sw
    return bool(sw != 0.0 or ge != 0.0 or gn != 0.0)
