"""Heights at the nodes of a grid, bilinear between them, in columns and rows: nothing here knows of metres.

A node without data is NaN, and so is every place of a cell that touches one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.grid_frame import GridFrame, slope_of_cell


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
    """Smallest height of a line above the nodes, where along it (0..1), the largest, where; NaN where it leaves the data.

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

    Inside a cell the slope along the columns lies between those of its two edges, and likewise along the rows; the larger of
    both edges in each direction gives a bound for the cell, and a path is no steeper than the cells it crosses.
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
    """Bound on the slope in the cell between nodes (i, j) and (i + 1, j + 1), tangent; NaN when one of them has no data."""
    across = max(abs(nodes[i, j + 1] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i + 1, j]))
    along = max(abs(nodes[i + 1, j] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i, j + 1]))
    if math.isnan(nodes[i, j] + nodes[i, j + 1] + nodes[i + 1, j] + nodes[i + 1, j + 1]):
        return math.nan
    return slope_of_cell(frame, across, along)


@kernel
def steepest_of_finite(nodes: NDArray[np.float64], frame: GridFrame) -> float:
    """:func:`steepest_slope` of the cells that have data and a known slope; 0 when there is none."""
    steepest = 0.0
    for i in range(nodes.shape[0] - 1):
        for j in range(nodes.shape[1] - 1):
            slope = steepest_in_cell(nodes, frame, i, j)
            if math.isfinite(slope):
                steepest = max(steepest, slope)
    return steepest
