"""How steeply the ground rises around a cell, by octants: which rays need no tracing.

A ray from a cell that leaves it more steeply than everything in its octant rises above the cell is clear of the ground. What
rises is bounded: around the cell by the gradients of the cells of the grid that touch its own, further out by the highest
ground in squares of the map, which grow with their distance so that each is seen under much the same angle. Bounds only save
work: a ray that is not clear by them is traced.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.grid import growth_on_grid, on_grid
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.sight import highest_in_squares
from uavcover.kernels.surface import GRID, Surface

OCTANTS = 8

_FILLED_M = 1e9
"""Stands for ground without data: nothing is known to be clear of it."""

_MOST_SQUARES = 4_000_000

_OCTANT_RAD = 0.25 * math.pi
_ROUNDING = 1e-12
_BENT = 1e-3
"""Share of a slope by which it may be steeper: over three cells a grid in geographic coordinates is not quite straight."""


@kernel
def octant_of(east: float, north: float) -> int:
    """Number of the octant of the map that a direction lies in, counter-clockwise from east."""
    if north >= 0.0:
        if east > 0.0:
            return 0 if north < east else 1
        return 2 if north > -east else 3
    if east < 0.0:
        return 4 if north > east else 5
    return 6 if -north > east else 7


def rises(surface: Surface, centre: NDArray[np.float64], *, reach_m: float) -> NDArray[np.float64]:
    """(n, 8) tangent that nothing within reach exceeds, seen from each cell in each octant; (0, 8) where it would not pay.

    Args:
        surface: the ground; on an analytic one rays are cheap.
        centre: (n, 3) of the cells, on the ground or above it.
        reach_m: on the map; rays to places further away are no matter.
    """
    nothing = np.empty((0, OCTANTS))
    if surface.kind != GRID or len(centre) == 0:
        return nothing
    grid = surface.grid
    pixel_m = 1.0 / max(grid.per_column, grid.per_row)
    side_m = 0.5 * pixel_m
    (west, south, low), (east, north, high) = centre.min(axis=0), centre.max(axis=0)
    wide_m = max(east - west, north - south) + 2.0 * reach_m + 2.0 * side_m
    levels = max(1, math.ceil(math.log2(max(2.0, reach_m / pixel_m))))
    count = math.ceil(wide_m / side_m / 2**levels) * 2**levels
    if count * count > _MOST_SQUARES:
        return nothing
    # Gaps in the data rise without end; what lies outside of the data rises to nothing, and no ray is clear from there.
    filled = surface._replace(up_m=np.where(np.isnan(surface.up_m), _FILLED_M, surface.up_m))
    east0, north0 = west - reach_m - side_m, south - reach_m - side_m
    beside = grid.lean * (high - low + reach_m)
    tops = np.nan_to_num(highest_in_squares(filled, east0, north0, side_m, count, beside), nan=-math.inf)
    near_m = (1.0 - 2.0 * grid.leeway) * pixel_m
    out = _slopes_around(surface, centre)
    begin_m = near_m
    while begin_m < reach_m:
        end_m = min(2.0 * begin_m, reach_m)
        _raise(out, centre, tops, east0, north0, side_m, begin_m, end_m)
        if begin_m > 3.0 * side_m:
            rows = tops.shape[0] // 2
            tops = tops.reshape(rows, 2, rows, 2).max(axis=(1, 3))
            side_m *= 2.0
        begin_m = end_m
    return out


@allocating_kernel
def _slopes_around(surface: Surface, centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 8) how steeply the ground rises in the 3 x 3 cells of the grid around each centre, in each octant, and 0 at least.

    A straight way over a bilinear cell is as steep as the gradient at one of its corners allows in that direction. Of the cells
    around, those count that a way in the octant may enter. Infinite without data.
    """
    grid, nodes = surface.grid, surface.up_m
    rows, columns = nodes.shape
    out = np.full((centre.shape[0], OCTANTS), math.inf)
    ways = np.arange(OCTANTS + 1) * _OCTANT_RAD
    ends = np.column_stack((np.cos(ways), np.sin(ways)))
    east, north = np.empty((3, 3, 4)), np.empty((3, 3, 4))
    for k in range(centre.shape[0]):
        u, v = on_grid(grid, centre[k, 0], centre[k, 1], centre[k, 2])
        i, j = math.floor(v), math.floor(u)
        if not (1 <= i <= rows - 3 and 1 <= j <= columns - 3):
            continue
        growth = growth_on_grid(grid, centre[k, 0], centre[k, 1], centre[k, 2])
        for di in range(3):
            for dj in range(3):
                _gradients_of_cell(nodes, i + di - 1, j + dj - 1, growth, east[di, dj], north[di, dj])
        for octant in range(OCTANTS):
            (re, rn), (le, ln) = ends[octant], ends[octant + 1]
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
            steepest = 0.0
            for di in range(first_i, last_i + 1):
                for dj in range(first_j, last_j + 1):
                    for corner in range(4):
                        ge, gn = east[di, dj, corner], north[di, dj, corner]
                        slope = math.hypot(ge, gn)
                        if slope == math.inf:
                            # Without data it is infinite in all directions.
                            steepest = math.inf
                            continue
                        rise = max(ge * re + gn * rn, ge * le + gn * ln)
                        if re * gn - rn * ge >= 0.0 and ge * ln - gn * le >= 0.0:
                            rise = slope
                        steepest = max(steepest, rise + _BENT * slope)
            out[k, octant] = steepest
    return out


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
    """First and last of three columns that ways from the middle one enter, if they go on so fast at both ends of an octant."""
    return 0 if min(at_right, at_left) < 0.0 else 1, 2 if max(at_right, at_left) > 0.0 else 1


@allocating_kernel
def _raise(
    rise: NDArray[np.float64], centre: NDArray[np.float64], tops: NDArray[np.float64], east0: float, north0: float,
    side: float, begin: float, end: float,
) -> None:  # fmt: skip
    """Raise the tangents, none below 0, by the squares that lie, in part at least, between two distances from each centre."""
    half = 0.5 * side
    wider = half * (1.0 + 1e-9)
    rows, columns = tops.shape
    begin2, end2 = begin * begin * (1.0 - _ROUNDING), end * end * (1.0 + _ROUNDING)
    # Of each octant's tangent and those beside it.
    least_of_three = np.empty(OCTANTS)
    for k in range(centre.shape[0]):
        e, n, u = centre[k, 0] - east0, centre[k, 1] - north0, centre[k, 2]
        least = _least_of_three(rise[k], least_of_three)
        first_row, last_row = max(0, int((n - end) / side)), min(rows - 1, int((n + end) / side))
        first, last = max(0, int((e - end) / side)), min(columns - 1, int((e + end) / side))
        for i in range(first_row, last_row + 1):
            dn = (i + 0.5) * side - n
            away_n = max(0.0, abs(dn) - half)
            for j in range(first, last + 1):
                higher = tops[i, j] - u
                # No square is nearer than it begins to count: skip what cannot raise any octant first.
                if not higher > least * begin:
                    continue
                de = (j + 0.5) * side - e
                away_e = max(0.0, abs(de) - half)
                near2 = away_e * away_e + away_n * away_n
                number = octant_of(de, dn)
                # From further away than its side a square reaches into the octants beside its middle's at most.
                most = least_of_three[number]
                if near2 >= side * side and higher * higher <= most * most * max(near2, begin2):
                    continue
                if near2 > end2 or (abs(de) + half) ** 2 + (abs(dn) + half) ** 2 < begin2:
                    continue
                tangent = higher / max(math.sqrt(near2), begin)
                if near2 <= 0.0:
                    for octant in range(OCTANTS):
                        rise[k, octant] = max(rise[k, octant], tangent)
                    least = _least_of_three(rise[k], least_of_three)
                    continue
                # Its corners are less than half a turn apart.
                right, left = 0, 0
                for corner in range(4):
                    beside = wider if corner % 2 == 1 else -wider
                    other = octant_of(de + beside, dn + (wider if corner >= 2 else -wider)) - number
                    other = (other + OCTANTS // 2) % OCTANTS - OCTANTS // 2
                    right, left = min(right, other), max(left, other)
                higher_anywhere = False
                for other in range(number + right, number + left + 1):
                    if tangent > rise[k, other % OCTANTS]:
                        rise[k, other % OCTANTS] = tangent
                        higher_anywhere = True
                if higher_anywhere:
                    least = _least_of_three(rise[k], least_of_three)


@kernel
def _least_of_three(rise: NDArray[np.float64], out: NDArray[np.float64]) -> float:
    """Write the least of each octant's tangent and the two beside it; returns the least of all."""
    least = math.inf
    for octant in range(OCTANTS):
        out[octant] = min(rise[octant - 1], rise[octant], rise[(octant + 1) % OCTANTS])
        least = min(least, rise[octant])
    return least
