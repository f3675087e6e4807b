"""Rise of the ground around a cell, by sectors: decides rays without tracing.

A ray that is steeper than everything that rises above the cell in its sector is clear of the ground. The rise is bounded by the
gradients of the adjacent grid cells and, further out, by the highest ground in squares of the map, which grow with their distance
so that each has a similar angular size. A ray that is flatter than the lowest ground of a whole ring of its sector ends in that
ground. Bounds only save work: other rays are traced.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import highest_around
from uavcover.kernels.grid import growth_on_grid, on_grid, slope_of_cell
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.sight import highest_in_squares
from uavcover.kernels.surface import GRID, Surface

SECTORS = 16
CLEAR_FROM, HIDDEN_BELOW, HIDDEN_BEYOND_M = 0, 1, 2
"""Rows of :func:`rises`."""

_FILLED_M = 1e9
"""Rise of ground without data: no ray is known to be clear of it."""

_MOST_SQUARES = 4_000_000
_MOST_BANDS = 16
"""Rings around a cell whose ground may hide what is behind it, half a pixel wide each."""
_DEEP_M = 1e-3
"""A hidden ray is at least this far below the ground at one position."""

_SECTOR_RAD = 2.0 * math.pi / SECTORS
_HALF = math.tan(_SECTOR_RAD)
_ROUNDING = 1e-12
_PIECES = 4
"""Parts of a cell of the grid beside a place, in columns and in rows, whose ground is looked at one by one."""

_BENT = 1e-3
"""Fraction of a slope by which it may be steeper: over three cells a grid in geographic coordinates is not quite straight."""


@kernel
def sector_of(east: float, north: float) -> int:
    """Number of the sector of the map that a direction lies in, 16 to a turn, counter-clockwise from east."""
    if north >= 0.0:
        if east > 0.0:
            if north < east:
                return 0 if north < _HALF * east else 1
            return 2 if east > _HALF * north else 3
        if north > -east:
            return 4 if -east < _HALF * north else 5
        return 6 if north > -_HALF * east else 7
    if east < 0.0:
        if north > east:
            return 8 if north > _HALF * east else 9
        return 10 if east < _HALF * north else 11
    if -north > east:
        return 12 if east < -_HALF * north else 13
    return 14 if -north > _HALF * east else 15


def rises(
    surface: Surface, centre: NDArray[np.float64], *, reach_m: float, flattest: float = 0.0, closely: bool = False
) -> NDArray[np.float32]:
    """(n, 3, 16) what decides rays from each cell in each sector; (0, 3, 16) where it would not pay.

    CLEAR_FROM: tangent that nothing within reach exceeds. HIDDEN_BELOW: tangent below which every ray meets the ground on its way
    to a place that is HIDDEN_BEYOND_M or more away on the map.

    Args:
        surface: the ground; on an analytic one rays are cheap.
        centre: (n, 3) of the cells, on the ground or above it.
        reach_m: on the map; rays to places further away do not matter.
        flattest: tangent of the flattest ray that is requested, 0 at least: the least of CLEAR_FROM. Ground that rises less
            hides nothing, and is left out.
        closely: find close bounds, and the rays that are hidden. Otherwise bounds are found sooner and less close, and no ray is
            hidden by them.
    """
    nothing = np.empty((0, 3, SECTORS), dtype=np.float32)
    if surface.kind != GRID or len(centre) == 0:
        return nothing
    grid = surface.grid
    pixel_m = 1.0 / max(grid.per_column, grid.per_row)
    side_m = (0.25 if closely else 0.5) * pixel_m
    (west, south, low), (east, north, high) = centre.min(axis=0), centre.max(axis=0)
    wide_m = max(east - west, north - south) + 2.0 * reach_m + 2.0 * side_m
    levels = max(1, math.ceil(math.log2(max(2.0, reach_m / pixel_m))))
    count = math.ceil(wide_m / side_m / 2**levels) * 2**levels
    if count * count > _MOST_SQUARES:
        return nothing
    # Gaps in the data rise to infinity. Ground outside the data does not rise, and no ray from there is clear.
    filled = surface._replace(up_m=np.where(np.isnan(surface.up_m), _FILLED_M, surface.up_m))
    east0, north0 = west - reach_m - side_m, south - reach_m - side_m
    beside = grid.lean * (high - low + reach_m)
    tops = np.nan_to_num(highest_in_squares(filled, east0, north0, side_m, count, beside), nan=-math.inf)
    near_m = (1.0 - 2.0 * grid.leeway) * pixel_m
    clear = _slopes_around(surface, centre, _PIECES if closely else 1, flattest)
    lows, low_side_m, begin_m = tops, 2.0 * side_m, near_m
    if closely:
        lows = _lowest(surface, tops.shape[0], east0, north0, side_m, beside)
    while begin_m < reach_m:
        end_m = min(2.0 * begin_m, reach_m)
        window = 2 * math.ceil(end_m / side_m) + 3
        around = highest_around(tops, window, window)
        _raise(clear, centre, tops, around, east0, north0, side_m, begin_m, end_m)
        if begin_m > 3.0 * side_m:
            rows = tops.shape[0] // 2
            tops = tops.reshape(rows, 2, rows, 2).max(axis=(1, 3))
            side_m *= 2.0
        begin_m = end_m
    bands = min(_MOST_BANDS, int((reach_m - low_side_m) / low_side_m)) if closely else 0
    below, beyond_m = _walls(centre, clear, lows, east0, north0, low_side_m, bands, flattest)
    out = np.empty((len(centre), 3, SECTORS), dtype=np.float32)
    # Rounded to the undecided side.
    out[:, CLEAR_FROM] = np.nextafter(clear.astype(np.float32), np.float32(math.inf))
    out[:, HIDDEN_BELOW] = np.nextafter(below.astype(np.float32), np.float32(-math.inf))
    out[:, HIDDEN_BEYOND_M] = np.nextafter(beyond_m.astype(np.float32), np.float32(math.inf))
    return out


def _lowest(
    surface: Surface, count: int, east0: float, north0: float, side_m: float, beside_m: float
) -> NDArray[np.float64]:
    """(count / 2, count / 2) lower bound of the ground of squares of twice the side; -inf without data."""
    turned = surface._replace(up_m=np.where(np.isnan(surface.up_m), _FILLED_M, -surface.up_m))
    lows = -highest_in_squares(turned, east0, north0, 2.0 * side_m, count // 2, beside_m)
    return np.where(np.isnan(lows) | (lows <= -_FILLED_M), -math.inf, lows)


@allocating_kernel
def _walls(
    centre: NDArray[np.float64], clear: NDArray[np.float64], lows: NDArray[np.float64], east0: float, north0: float,
    side: float, bands: int, flattest: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
    """(n, 16) tangents below which rays are hidden, and (n, 16) their distance; -inf without one.

    Every ray of a sector that crosses a ring meets ground there that is as high as the lowest of all squares that touch both.
    Below the tangent to that at the outer side of the ring, it is below the ground there.
    """
    below, beyond = np.full((centre.shape[0], SECTORS), -math.inf), np.zeros((centre.shape[0], SECTORS))
    lowest = np.empty((SECTORS, max(bands, 1)))
    rows, columns = lows.shape
    half = 0.5 * side
    wider = half * (1.0 + 1e-9)
    for k in range(centre.shape[0]):
        if bands < 1 or clear[k].max() <= flattest:
            continue
        e, n, u = centre[k, 0] - east0, centre[k, 1] - north0, centre[k, 2]
        lowest[:] = math.inf
        around = bands * side
        for i in range(max(0, int((n - around) / side)), min(rows - 1, int((n + around) / side)) + 1):
            dn = (i + 0.5) * side - n
            for j in range(max(0, int((e - around) / side)), min(columns - 1, int((e + around) / side)) + 1):
                de = (j + 0.5) * side - e
                near = math.hypot(max(0.0, abs(de) - half), max(0.0, abs(dn) - half))
                first_band = int(near * (1.0 - 1e-9) / side)
                if first_band >= bands:
                    continue
                last_band = min(bands - 1, int(math.hypot(abs(de) + half, abs(dn) + half) * (1.0 + 1e-9) / side))
                number, right, left = sector_of(de, dn), 0, 0
                if near <= 0.0:
                    right, left = -(SECTORS // 2), SECTORS // 2 - 1
                else:
                    for corner in range(4):
                        beside = wider if corner % 2 == 1 else -wider
                        other = sector_of(de + beside, dn + (wider if corner >= 2 else -wider)) - number
                        other = (other + SECTORS // 2) % SECTORS - SECTORS // 2
                        right, left = min(right, other), max(left, other)
                for beside_number in range(number + right, number + left + 1):
                    sector = beside_number % SECTORS
                    for band in range(first_band, last_band + 1):
                        lowest[sector, band] = min(lowest[sector, band], lows[i, j])
        for sector in range(SECTORS):
            for band in range(bands):
                end = (band + 1) * side * (1.0 + 1e-9)
                tangent = (lowest[sector, band] - u - _DEEP_M) / end
                if tangent > max(flattest, below[k, sector]):
                    below[k, sector], beyond[k, sector] = tangent, end
    return below, beyond


@allocating_kernel
def _slopes_around(surface: Surface, centre: NDArray[np.float64], pieces: int, flattest: float) -> NDArray[np.float64]:
    """(n, 16) slope of the rise of the 3 x 3 grid cells around each centre, by sector.

    A straight path over a bilinear cell is as steep as the gradient at one of its corners allows in that direction. Only cells
    that a
    path in the sector may enter count, and only as far as their highest ground at its distance allows. At least ``flattest``;
    infinite
    without data.
    """
    grid, nodes = surface.grid, surface.up_m
    rows, columns = nodes.shape
    out = np.full((centre.shape[0], SECTORS), math.inf)
    bearings = np.arange(SECTORS + 1) * _SECTOR_RAD
    ends = np.column_stack((np.cos(bearings), np.sin(bearings)))
    east, north = np.empty((3, 3, 4)), np.empty((3, 3, 4))
    slopes = np.empty((3, 3, SECTORS))
    for k in range(centre.shape[0]):
        u, v = on_grid(grid, centre[k, 0], centre[k, 1], centre[k, 2])
        i, j = math.floor(v), math.floor(u)
        if not (1 <= i <= rows - 3 and 1 <= j <= columns - 3):
            continue
        out[k] = flattest
        if _steepest_around(surface, i, j) <= flattest:
            continue
        growth = growth_on_grid(grid, centre[k, 0], centre[k, 1], centre[k, 2])
        for di in range(3):
            for dj in range(3):
                _gradients_of_cell(nodes, i + di - 1, j + dj - 1, growth, east[di, dj], north[di, dj])
        slopes[:] = 0.0
        for sector in range(SECTORS):
            (re, rn), (le, ln) = ends[sector], ends[sector + 1]
            first_j, last_j = _entered(growth[0, 0] * re + growth[0, 1] * rn, growth[0, 0] * le + growth[0, 1] * ln)
            first_i, last_i = _entered(growth[1, 0] * re + growth[1, 1] * rn, growth[1, 0] * le + growth[1, 1] * ln)
            if u - j <= grid.leeway:
                first_j = 0
            if j + 1 - u <= grid.leeway:
                last_j = 2
            if v - i <= grid.leeway:
                first_i = 0
            if i + 1 - v <= grid.leeway:
                last_i = 2
            for di in range(first_i, last_i + 1):
                for dj in range(first_j, last_j + 1):
                    for corner in range(4):
                        ge, gn = east[di, dj, corner], north[di, dj, corner]
                        slope = math.hypot(ge, gn)
                        if slope == math.inf:
                            # Without data it is infinite in all directions.
                            slopes[di, dj, sector] = math.inf
                            continue
                        rise = max(ge * re + gn * rn, ge * le + gn * ln)
                        if re * gn - rn * ge >= 0.0 and ge * ln - gn * le >= 0.0:
                            rise = slope
                        slopes[di, dj, sector] = max(slopes[di, dj, sector], rise + _BENT * slope)
        for di in range(3):
            for dj in range(3):
                _raise_in_cell(
                    surface, i + di - 1, j + dj - 1, u, v, centre[k, 2], growth, slopes[di, dj], pieces, out[k]
                )
    return out


@kernel
def _steepest_around(surface: Surface, i: int, j: int) -> float:
    """Bound on the slope of the ground in the 3 x 3 grid cells around a cell; inf without data."""
    nodes, across, along = surface.up_m, 0.0, 0.0
    for row in range(i - 1, i + 3):
        for column in range(j - 1, j + 3):
            if math.isnan(nodes[row, column]):
                return math.inf
            if column < j + 2:
                across = max(across, abs(nodes[row, column + 1] - nodes[row, column]))
            if row < i + 2:
                along = max(along, abs(nodes[row + 1, column] - nodes[row, column]))
    return slope_of_cell(surface.grid, across, along) * (1.0 + _BENT)


@kernel
def _raise_in_cell(
    surface: Surface, i: int, j: int, u: float, v: float, up: float, growth: NDArray[np.float64],
    slopes: NDArray[np.float64], pieces: int, rise: NDArray[np.float64],
) -> None:  # fmt: skip
    """Raise the tangents by the ground of one cell of the grid, in pieces.

    A straight path to a position of a piece is at most as steep as the highest ground of the piece at its nearest distance, and
    as the steepest ground below the path. Of all pieces on a path, the largest of the smaller of the two bounds holds: until a
    path reaches the first piece with a steeper slope than that, it has not risen more, and in that piece it ends below the other
    bound.

    Args:
        surface: a grid.
        i: row of the cell.
        j: its column.
        u: column of the observer.
        v: its row.
        up: its height.
        growth: of the grid there.
        slopes: (16,) of the cell's ground in each sector, 0 for sectors without any of it.
        pieces: of the cell, in columns and in rows.
        rise: (16,) is raised.
    """
    raises = False
    for sector in range(SECTORS):
        raises |= slopes[sector] > rise[sector]
    if not raises:
        return
    grid, nodes = surface.grid, surface.up_m
    left, right, far_left, far_right = (
        nodes[i, j] - up,
        nodes[i, j + 1] - up,
        nodes[i + 1, j] - up,
        nodes[i + 1, j + 1] - up,
    )
    if math.isnan(left + right + far_left + far_right):
        for sector in range(SECTORS):
            rise[sector] = max(rise[sector], slopes[sector])
        return
    straight = math.sqrt(max(0.0, 1.0 - grid.skew))
    per_area = 1.0 / (growth[0, 0] * growth[1, 1] - growth[0, 1] * growth[1, 0])
    for a in range(pieces):
        for b in range(pieces):
            near_x, far_x, near_y, far_y = b / pieces, (b + 1) / pieces, a / pieces, (a + 1) / pieces
            higher = -math.inf
            for x in (near_x, far_x):
                for y in (near_y, far_y):
                    higher = max(
                        higher, (left * (1.0 - x) + right * x) * (1.0 - y) + (far_left * (1.0 - x) + far_right * x) * y
                    )
            if higher <= 0.0:
                continue
            leeway = grid.leeway + grid.lean * higher * max(grid.per_column, grid.per_row)
            west, east, south, north = (
                j + near_x - u - leeway,
                j + far_x - u + leeway,
                i + near_y - v - leeway,
                i + far_y - v + leeway,
            )
            away = straight * math.hypot(
                max(0.0, west, -east) / grid.per_column, max(0.0, south, -north) / grid.per_row
            )
            if away <= 0.0:
                for sector in range(SECTORS):
                    rise[sector] = max(rise[sector], slopes[sector])
                return
            tangent = higher / away * (1.0 + _BENT)
            number, first, last = -1, 0, 0
            for x in (west, east):
                for y in (south, north):
                    other = sector_of(
                        (growth[1, 1] * x - growth[0, 1] * y) * per_area,
                        (growth[0, 0] * y - growth[1, 0] * x) * per_area,
                    )
                    if number < 0:
                        number = other
                    beside = (other - number + SECTORS // 2) % SECTORS - SECTORS // 2
                    first, last = min(first, beside), max(last, beside)
            for beside in range(number + first, number + last + 1):
                sector = beside % SECTORS
                rise[sector] = max(rise[sector], min(tangent, slopes[sector]))


@kernel
def _gradients_of_cell(
    nodes: NDArray[np.float64],
    i: int,
    j: int,
    growth: NDArray[np.float64],
    east: NDArray[np.float64],
    north: NDArray[np.float64],
) -> None:
    """Write the gradients (4,) at the corners of a cell between nodes; infinite where one of these has no data.

    ``growth`` is that of the grid there (:func:`uavcover.kernels.grid.growth_on_grid`).
    """
    south, far = nodes[i, j + 1] - nodes[i, j], nodes[i + 1, j + 1] - nodes[i + 1, j]
    west, right = nodes[i + 1, j] - nodes[i, j], nodes[i + 1, j + 1] - nodes[i, j + 1]
    if math.isnan(south + far):
        east[:] = math.inf
        north[:] = math.inf
        return
    for corner in range(4):
        across, along = far if corner >= 2 else south, right if corner % 2 == 1 else west
        left = 1.0 - (across * growth[0, 2] + along * growth[1, 2])
        east[corner] = (across * growth[0, 0] + along * growth[1, 0]) / left if left > 0.0 else math.inf
        north[corner] = (across * growth[0, 1] + along * growth[1, 1]) / left if left > 0.0 else math.inf


@kernel
def _entered(at_right: float, at_left: float) -> tuple[int, int]:
    """First and last of three columns that paths from the middle one enter, from their directions at the sector's ends."""
    return 0 if min(at_right, at_left) < 0.0 else 1, 2 if max(at_right, at_left) > 0.0 else 1


@allocating_kernel
def _raise(
    rise: NDArray[np.float64], centre: NDArray[np.float64], tops: NDArray[np.float64], around: NDArray[np.float64],
    east0: float, north0: float, side: float, begin: float, end: float,
) -> None:  # fmt: skip
    """Raise the tangents, none below 0, by the squares that lie partly between two distances from each centre.

    ``around`` has, for each square, the highest of all squares within the farther distance.
    """
    half = 0.5 * side
    wider = half * (1.0 + 1e-9)
    rows, columns = tops.shape
    begin2, end2 = begin * begin * (1.0 - _ROUNDING), end * end * (1.0 + _ROUNDING)
    # For each sector, its tangent and the two adjacent ones.
    least_of_three = np.empty(SECTORS)
    for k in range(centre.shape[0]):
        e, n, u = centre[k, 0] - east0, centre[k, 1] - north0, centre[k, 2]
        least = rise[k].min()
        row, column = min(max(int(n / side), 0), rows - 1), min(max(int(e / side), 0), columns - 1)
        if not around[row, column] - u > least * begin:
            continue
        least = _least_of_three(rise[k], least_of_three)
        first_row, last_row = max(0, int((n - end) / side)), min(rows - 1, int((n + end) / side))
        first, last = max(0, int((e - end) / side)), min(columns - 1, int((e + end) / side))
        for i in range(first_row, last_row + 1):
            dn = (i + 0.5) * side - n
            away_n = max(0.0, abs(dn) - half)
            for j in range(first, last + 1):
                higher = tops[i, j] - u
                # No square is nearer than it begins to count: skip what cannot raise any sector first.
                if not higher > least * begin:
                    continue
                de = (j + 0.5) * side - e
                away_e = max(0.0, abs(de) - half)
                near2 = away_e * away_e + away_n * away_n
                number = sector_of(de, dn)
                # From further away than three times its side a square reaches into the sectors beside its middle's at most.
                most = least_of_three[number]
                if near2 >= 9.0 * side * side and higher * higher <= most * most * max(near2, begin2):
                    continue
                if near2 > end2 or (abs(de) + half) ** 2 + (abs(dn) + half) ** 2 < begin2:
                    continue
                tangent = higher / max(math.sqrt(near2), begin)
                if near2 <= 0.0:
                    for sector in range(SECTORS):
                        rise[k, sector] = max(rise[k, sector], tangent)
                    least = _least_of_three(rise[k], least_of_three)
                    continue
                # Its corners are less than half a turn apart.
                right, left = 0, 0
                for corner in range(4):
                    beside = wider if corner % 2 == 1 else -wider
                    other = sector_of(de + beside, dn + (wider if corner >= 2 else -wider)) - number
                    other = (other + SECTORS // 2) % SECTORS - SECTORS // 2
                    right, left = min(right, other), max(left, other)
                higher_anywhere = False
                for other in range(number + right, number + left + 1):
                    if tangent > rise[k, other % SECTORS]:
                        rise[k, other % SECTORS] = tangent
                        higher_anywhere = True
                if higher_anywhere:
                    least = _least_of_three(rise[k], least_of_three)


@kernel
def _least_of_three(rise: NDArray[np.float64], out: NDArray[np.float64]) -> float:
    """Write the least of each sector's tangent and the two beside it; returns the least of all."""
    least = math.inf
    for sector in range(SECTORS):
        out[sector] = min(rise[sector - 1], rise[sector], rise[(sector + 1) % SECTORS])
        least = min(least, rise[sector])
    return least
