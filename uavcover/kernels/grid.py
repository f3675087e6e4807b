"""Elevation grids: from a place in the local frame to a column and a row, and heights between the nodes.

The nodes are the pixels of the elevation file; nothing is resampled. A raster in degrees or in a projection lies turned,
stretched and slightly bent in the local frame, so column and row are polynomials of the third degree in east and north: within
10 km of latitude 60 they are exact to a hundredth of a millimetre, where the second degree errs by 6 mm.

Height above ground is measured along the plumb line, as an elevation file means it: the height above sea level of a place minus
that of the file at its latitude and longitude. Away from the origin a plumb line leans against the up axis by the distance over
the Earth's radius: 0.3 m on 500 m at 4 km. Each place is therefore first moved along its plumb line to one level.

Heights between nodes are bilinear, in columns and rows: that part knows nothing of metres. A node without data is NaN, and so
is every place in a cell that touches one.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel

_ABOVE_M = 1e-6
"""A line that is higher than all nodes of a cell by this is above it despite rounding."""

TERMS = 10
"""Of a polynomial of the third degree: 1, x, y, x^2, x y, y^2, x^3, x^2 y, x y^2, y^3."""


class GridFrame(NamedTuple):
    """Columns and rows of a grid in the local frame, whole numbers at the nodes.

    Attributes:
        east0_m: x = (east - east0_m) / scale_m, with the east at which the plumb line meets the level.
        north0_m: y = (north - north0_m) / scale_m, the same.
        scale_m: unit of x and y.
        terms: (2, TERMS) float64 coefficients of the column's and of the row's polynomial.
        level_up_m: up coordinate of the level.
        lean_per_m: tangent by which plumb lines lean, for each metre from the origin of the local frame: 1 / Earth's radius;
            0 for a grid whose columns and rows do not depend on the height.
        lean: no plumb line over the grid leans more (tangent).
        per_column: columns to a metre, at most.
        per_row: rows to a metre, at most.
        skew: cosine of the angle between the directions in which columns and rows count, at most; 0: at right angles.
        piece_m: a straight line of at most this length is taken as straight on the grid.
        leeway: the ground under the straight line between two places is on the grid inside the box around both, grown by this
            number of nodes.
    """

    east0_m: float
    north0_m: float
    scale_m: float
    terms: NDArray[np.float64]
    level_up_m: float
    lean_per_m: float
    lean: float
    per_column: float
    per_row: float
    skew: float
    piece_m: float
    leeway: float


def square_frame(*, east0_m: float, north0_m: float, step_m: float) -> GridFrame:
    """The frame of a square grid along east and north, column 0 at ``east0_m`` and row 0 at ``north0_m``."""
    terms = np.zeros((2, TERMS))
    terms[0, 1] = terms[1, 2] = 1.0
    terms.flags.writeable = False
    per_step = 1.0 / step_m
    return GridFrame(east0_m, north0_m, step_m, terms, 0.0, 0.0, 0.0, per_step, per_step, 0.0, math.inf, 0.0)


@kernel
def on_grid(frame: GridFrame, east: float, north: float, up: float) -> tuple[float, float]:
    """Column and row of a place; NaN when it is not finite."""
    if not math.isfinite(east + north + up):
        return math.nan, math.nan
    along = 1.0 - (up - frame.level_up_m) * frame.lean_per_m
    x = (east * along - frame.east0_m) / frame.scale_m
    y = (north * along - frame.north0_m) / frame.scale_m
    c = frame.terms
    column = (
        (c[0, 0] + x * (c[0, 1] + x * (c[0, 3] + x * c[0, 6])))
        + y * ((c[0, 2] + x * (c[0, 4] + x * c[0, 7])) + y * ((c[0, 5] + x * c[0, 8]) + y * c[0, 9]))
    )  # fmt: skip
    row = (
        (c[1, 0] + x * (c[1, 1] + x * (c[1, 3] + x * c[1, 6])))
        + y * ((c[1, 2] + x * (c[1, 4] + x * c[1, 7])) + y * ((c[1, 5] + x * c[1, 8]) + y * c[1, 9]))
    )  # fmt: skip
    return column, row


@allocating_kernel
def positions_on_grid(frame: GridFrame, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) columns and rows of (n, 3) positions."""
    out = np.empty((positions.shape[0], 2))
    for i in range(positions.shape[0]):
        out[i, 0], out[i, 1] = on_grid(frame, positions[i, 0], positions[i, 1], positions[i, 2])
    return out


@allocating_kernel
def growth_on_grid(frame: GridFrame, east: float, north: float, up: float) -> NDArray[np.float64]:
    """(2, 3) derivatives of column and row at a place, per metre east, north and up."""
    along = 1.0 - (up - frame.level_up_m) * frame.lean_per_m
    x = (east * along - frame.east0_m) / frame.scale_m
    y = (north * along - frame.north0_m) / frame.scale_m
    out = np.empty((2, 3))
    for k in range(2):
        c = frame.terms[k]
        to_x = c[1] + x * (2.0 * c[3] + x * 3.0 * c[6]) + y * (c[4] + 2.0 * x * c[7] + y * c[8])
        to_y = c[2] + y * (2.0 * c[5] + y * 3.0 * c[9]) + x * (c[4] + 2.0 * y * c[8] + x * c[7])
        out[k, 0] = to_x * along / frame.scale_m
        out[k, 1] = to_y * along / frame.scale_m
        out[k, 2] = -(to_x * east + to_y * north) * frame.lean_per_m / frame.scale_m
    return out


@kernel
def slope_of_cell(frame: GridFrame, across: float, along: float) -> float:
    """Bound on the slope (tangent) of ground that rises by ``across`` a column and ``along`` a row; inf if unknown."""
    x, y = across * frame.per_column, along * frame.per_row
    slope = math.sqrt(x * x + y * y + 2.0 * x * y * frame.skew)
    # What leans with the plumb lines is observed steeper from the up axis.
    left = 1.0 - slope * frame.lean
    return slope / left if left > 0.0 else math.inf


@kernel
def among_nodes(z: NDArray[np.float64], column: float, row: float) -> bool:
    """Whether a place lies between the nodes ``z`` (rows, columns); False when it is not finite."""
    return bool(column >= 0.0 and row >= 0.0 and column <= z.shape[1] - 1 and row <= z.shape[0] - 1)


@kernel
def on_nodes(z: NDArray[np.float64], column: float, row: float) -> float:
    """Bilinear height, NaN outside."""
    if not among_nodes(z, column, row):
        return math.nan
    return in_cell(z, min(int(row), z.shape[0] - 2), min(int(column), z.shape[1] - 2), column, row)


@kernel
def _next_crossing(position: float, direction: float, index: int) -> float:
    """Parameter at which a coordinate that starts at ``position`` (in grid steps) passes node line ``index``."""
    if direction == 0.0:
        return math.inf
    return (index - position) / direction


@kernel
def range_on_nodes(
    z: NDArray[np.float64], u0: float, v0: float, pu: float, u1: float, v1: float, qu: float, stop_below: float
) -> tuple[float, float, float, float]:
    """Smallest and largest height of a line above the nodes, each with its parameter 0..1; NaN outside the data.

    Args:
        z: (rows, columns) heights of the nodes.
        u0: column of the start.
        v0: row of the start.
        pu: height of the start; linear from there to the end.
        u1: column of the end.
        v1: row of the end.
        qu: height of the end.
        stop_below: stop as soon as a height below this is found.
    """
    rows, columns = z.shape
    if not (among_nodes(z, u0, v0) and among_nodes(z, u1, v1)):
        return math.nan, math.nan, math.nan, math.nan
    du = u1 - u0
    dv = v1 - v0
    # The next node line to cross in each direction.
    step_u = 1 if du > 0.0 else -1
    step_v = 1 if dv > 0.0 else -1
    line_u = math.floor(u0) + 1 if du > 0.0 else math.ceil(u0) - 1
    line_v = math.floor(v0) + 1 if dv > 0.0 else math.ceil(v0) - 1
    lowest = math.inf
    lowest_at = 0.0
    highest = -math.inf
    highest_at = 0.0
    t = 0.0
    while t < 1.0:
        end = min(1.0, _next_crossing(u0, du, line_u), _next_crossing(v0, dv, line_v))
        if end > t:
            # The cell is that of the middle of the piece: safe from rounding at its ends.
            middle = 0.5 * (t + end)
            j = min(max(math.floor(u0 + middle * du), 0), columns - 2)
            i = min(max(math.floor(v0 + middle * dv), 0), rows - 2)
            a = pu + t * (qu - pu) - in_cell(z, i, j, u0 + t * du, v0 + t * dv)
            m = pu + middle * (qu - pu) - in_cell(z, i, j, u0 + middle * du, v0 + middle * dv)
            b = pu + end * (qu - pu) - in_cell(z, i, j, u0 + end * du, v0 + end * dv)
            low, low_at, high, high_at = parabola_range(a, m, b)
            if math.isnan(low):
                return math.nan, math.nan, math.nan, math.nan
            if low < lowest:
                lowest = low
                lowest_at = t + low_at * (end - t)
                if lowest < stop_below:
                    return lowest, lowest_at, highest, highest_at
            if high > highest:
                highest = high
                highest_at = t + high_at * (end - t)
        if end >= 1.0:
            break
        t = max(t, end)
        while _next_crossing(u0, du, line_u) <= t:
            line_u += step_u
        while _next_crossing(v0, dv, line_v) <= t:
            line_v += step_v
    return lowest, lowest_at, highest, highest_at


@kernel
def stays_above_nodes(
    z: NDArray[np.float64], u0: float, v0: float, pu: float, u1: float, v1: float, qu: float, limit: float
) -> bool:
    """Whether a line is nowhere lower than ``limit`` above the nodes; False outside the data.

    Faster than :func:`range_on_nodes`: cells whose nodes are all lower than the line need no further test.
    """
    rows, columns = z.shape
    if not (among_nodes(z, u0, v0) and among_nodes(z, u1, v1)):
        return False
    du, dv, climb = u1 - u0, v1 - v0, qu - pu
    j = min(max(math.floor(u0) if du >= 0.0 else math.ceil(u0) - 1, 0), columns - 2)
    i = min(max(math.floor(v0) if dv >= 0.0 else math.ceil(v0) - 1, 0), rows - 2)
    step_u, step_v = 1 if du > 0.0 else -1, 1 if dv > 0.0 else -1
    # Where the line crosses the next line of nodes in each direction, 0..1, and how far apart they are.
    next_u = _next_crossing(u0, du, j + 1 if du > 0.0 else j)
    next_v = _next_crossing(v0, dv, i + 1 if dv > 0.0 else i)
    apart_u = 1.0 / abs(du) if du != 0.0 else math.inf
    apart_v = 1.0 / abs(dv) if dv != 0.0 else math.inf
    beside = max(limit, 0.0) + _ABOVE_M
    t = 0.0
    while True:
        end = min(1.0, next_u, next_v)
        low = pu + (t if climb >= 0.0 else end) * climb - beside
        # Asked for rather than against: a comparison with NaN is False.
        if not (low >= z[i, j] and low >= z[i, j + 1] and low >= z[i + 1, j] and low >= z[i + 1, j + 1]):
            middle = 0.5 * (t + end)
            a = pu + t * climb - in_cell(z, i, j, u0 + t * du, v0 + t * dv)
            m = pu + middle * climb - in_cell(z, i, j, u0 + middle * du, v0 + middle * dv)
            b = pu + end * climb - in_cell(z, i, j, u0 + end * du, v0 + end * dv)
            if not parabola_range(a, m, b)[0] >= limit:
                return False
        if end >= 1.0:
            return True
        if next_u <= next_v:
            j, next_u = min(max(j + step_u, 0), columns - 2), next_u + apart_u
        else:
            i, next_v = min(max(i + step_v, 0), rows - 2), next_v + apart_v
        t = end


@kernel
def in_cell(z: NDArray[np.float64], i: int, j: int, u: float, v: float) -> float:
    """Bilinear height in cell (i, j), also just outside of it."""
    v -= i
    u -= j
    south = z[i, j] + u * (z[i, j + 1] - z[i, j])
    north = z[i + 1, j] + u * (z[i + 1, j + 1] - z[i + 1, j])
    return float(south + v * (north - south))


@kernel
def parabola_range(a: float, m: float, b: float) -> tuple[float, float, float, float]:
    """Smallest and largest value, and where in 0..1, of the parabola through (0, a), (1/2, m), (1, b)."""
    if math.isnan(a + m + b):
        return math.nan, math.nan, math.nan, math.nan
    low, low_at, high, high_at = a, 0.0, a, 0.0
    if b < low:
        low, low_at = b, 1.0
    if b > high:
        high, high_at = b, 1.0
    curvature = 2.0 * (a - 2.0 * m + b)
    slope = 4.0 * m - 3.0 * a - b
    if curvature != 0.0:
        t = -slope / (2.0 * curvature)
        if 0.0 < t < 1.0:
            value = a + t * (slope + t * curvature)
            if value < low:
                low, low_at = value, t
            if value > high:
                high, high_at = value, t
    return low, low_at, high, high_at


@kernel
def steepest_slope(nodes: NDArray[np.float64], frame: GridFrame) -> float:
    """Bound on the slope between any two places of a bilinear grid, tangent; infinite when a node has no data.

    Inside a cell, the slope along the columns lies between those of its two edges, and the same holds for rows. The larger of
    both edges in each direction bounds the cell, and a path is at most as steep as its cells.
    """
    steepest = 0.0
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            slope = steepest_in_cell(nodes, frame, i, j)
            if math.isnan(slope):
                return math.inf
            steepest = max(steepest, slope)
    return steepest


@kernel
def steepest_in_cell(nodes: NDArray[np.float64], frame: GridFrame, i: int, j: int) -> float:
    """Bound on the slope (tangent) in the cell from node (i, j); NaN if it lacks data."""
    across = max(abs(nodes[i, j + 1] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i + 1, j]))
    along = max(abs(nodes[i + 1, j] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i, j + 1]))
    if math.isnan(nodes[i, j] + nodes[i, j + 1] + nodes[i + 1, j] + nodes[i + 1, j + 1]):
        return math.nan
    return slope_of_cell(frame, across, along)


@kernel
def steepest_of_finite(nodes: NDArray[np.float64], frame: GridFrame) -> float:
    """:func:`steepest_slope` of the cells that have data and a known slope; 0 without one."""
    steepest = 0.0
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            slope = steepest_in_cell(nodes, frame, i, j)
            if math.isfinite(slope):
                steepest = max(steepest, slope)
    return steepest
