"""Height of the ground, and how far a straight segment stays above it.

A surface is a :class:`Surface`, plain numbers and one array. Two kinds:

- ``GRID``: heights at the nodes of a regular grid, bilinear between them. NaN nodes are no-data, and so is every place
  that touches one.
- ``SINE_COSINE``: z = s sin(y / s) cos(x / s), evaluated exactly (the paper's Eq. 26).

Along a straight segment a bilinear cell is a parabola, so the smallest and largest height of the segment above a grid are
computed exactly, cell by cell, in closed form. Above the analytic surface the segment is cut into pieces of 0.05 s whose
parabola through three points is used. Along a level line sin(y) cos(x) = (sin(y + x) + sin(y - x)) / 2 has a third
derivative of at most sqrt(2) / s^2, so the parabola errs by at most sqrt(2) 0.05^3 s / (72 sqrt(3)) = 1.5e-6 s.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.obstacles import NO_OBSTACLES, Obstacles

GRID = 0
SINE_COSINE = 1

_ANALYTIC_PIECE = 0.05


class Surface(NamedTuple):
    """A height surface in the local frame, and what stands on it.

    Attributes:
        kind: GRID or SINE_COSINE.
        east0_m: east of the first column of nodes (GRID).
        north0_m: north of the first row of nodes (GRID).
        step_m: spacing of the nodes (GRID), or the scale s (SINE_COSINE).
        up_m: (rows, columns) float64 heights of the nodes, rows going north; (1, 1) and unused for SINE_COSINE.
        steepest: no two places of the surface have a steeper slope between them (tangent). Infinite when it is not known,
            as with no-data.
        obstacles: prisms on the surface. Heights above the surface are heights above ground, not above them.
    """

    kind: int
    east0_m: float
    north0_m: float
    step_m: float
    up_m: NDArray[np.float64]
    steepest: float
    obstacles: Obstacles = NO_OBSTACLES


@kernel
def height(surface: Surface, east: float, north: float) -> float:
    """Height of the surface, metres; NaN outside the grid and where a node of the cell has no data."""
    if surface.kind == SINE_COSINE:
        s = surface.step_m
        return s * math.sin(north / s) * math.cos(east / s)
    rows, columns = surface.up_m.shape
    u = (east - surface.east0_m) / surface.step_m
    v = (north - surface.north0_m) / surface.step_m
    if not (u >= 0.0 and v >= 0.0 and u <= columns - 1 and v <= rows - 1):
        return math.nan
    i = min(int(v), rows - 2)
    j = min(int(u), columns - 2)
    v -= i
    u -= j
    z = surface.up_m
    south = z[i, j] + u * (z[i, j + 1] - z[i, j])
    north_edge = z[i + 1, j] + u * (z[i + 1, j + 1] - z[i + 1, j])
    return float(south + v * (north_edge - south))


@kernel
def has_node_cell(surface: Surface, east: float, north: float) -> bool:
    """Whether a place lies between nodes of the grid (with data or without); everywhere on the analytic surface."""
    if surface.kind == SINE_COSINE:
        return math.isfinite(east) and math.isfinite(north)
    rows, columns = surface.up_m.shape
    u = (east - surface.east0_m) / surface.step_m
    v = (north - surface.north0_m) / surface.step_m
    return bool(u >= 0.0 and v >= 0.0 and u <= columns - 1 and v <= rows - 1)


@kernel
def gradient(surface: Surface, east: float, north: float) -> tuple[float, float]:
    """Slope of the surface towards east and towards north (dimensionless); NaN where there is no data."""
    if surface.kind == SINE_COSINE:
        s = surface.step_m
        return -math.sin(north / s) * math.sin(east / s), math.cos(north / s) * math.cos(east / s)
    rows, columns = surface.up_m.shape
    u = (east - surface.east0_m) / surface.step_m
    v = (north - surface.north0_m) / surface.step_m
    if not (u >= 0.0 and v >= 0.0 and u <= columns - 1 and v <= rows - 1):
        return math.nan, math.nan
    i = min(int(v), rows - 2)
    j = min(int(u), columns - 2)
    v -= i
    u -= j
    z = surface.up_m
    to_east = (1.0 - v) * (z[i, j + 1] - z[i, j]) + v * (z[i + 1, j + 1] - z[i + 1, j])
    to_north = (1.0 - u) * (z[i + 1, j] - z[i, j]) + u * (z[i + 1, j + 1] - z[i, j + 1])
    return to_east / surface.step_m, to_north / surface.step_m


@kernel
def steepest_slope(nodes: NDArray[np.float64], step: float) -> float:
    """Bound on the slope between any two places of a bilinear grid, tangent; infinite when a node has no data.

    Inside a cell the slope towards east lies between those of its south and north edge, and likewise towards north; the
    larger of both edges in each direction gives a bound for the cell, and a path is no steeper than the cells it crosses.
    """
    rows, columns = nodes.shape
    steepest2 = 0.0
    for i in range(rows - 1):
        for j in range(columns - 1):
            east = max(abs(nodes[i, j + 1] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i + 1, j]))
            north = max(abs(nodes[i + 1, j] - nodes[i, j]), abs(nodes[i + 1, j + 1] - nodes[i, j + 1]))
            slope2 = east * east + north * north
            if math.isnan(slope2):
                return math.inf
            steepest2 = max(steepest2, slope2)
    return math.sqrt(steepest2) / step


@kernel
def heights(surface: Surface, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights at (n,) places, metres; NaN where there is no data."""
    out = np.empty(east.size)
    for i in range(east.size):
        out[i] = height(surface, east[i], north[i])
    return out


@kernel
def gradients(surface: Surface, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) slopes towards east and north at (n,) places."""
    out = np.empty((east.size, 2))
    for i in range(east.size):
        out[i, 0], out[i, 1] = gradient(surface, east[i], north[i])
    return out


@kernel
def _next_crossing(position: float, direction: float, index: int) -> float:
    """Parameter at which a coordinate that starts at ``position`` (in grid steps) passes node line ``index``."""
    if direction == 0.0:
        return math.inf
    return (index - position) / direction


@kernel
def height_range_above(
    surface: Surface, p: NDArray[np.float64], q: NDArray[np.float64], stop_below: float
) -> tuple[float, float, float, float]:
    """Smallest and largest height of the segment p-q above the surface, and where.

    Args:
        surface: the ground.
        p: (3,) start, metres.
        q: (3,) end, metres.
        stop_below: stop as soon as a height below this is found (-inf: go to the end); the answer is then not the
            smallest one, but it is below the limit.

    Returns:
        smallest height, the parameter 0..1 where, largest height, the parameter where. All NaN when the segment leaves
        the data, or an end of it is not finite.
    """
    return height_range_between(surface, p[0], p[1], p[2], q[0], q[1], q[2], stop_below)


@kernel
def height_range_between(
    surface: Surface, pe: float, pn: float, pu: float, qe: float, qn: float, qu: float, stop_below: float
) -> tuple[float, float, float, float]:
    """:func:`height_range_above` by coordinates: kernels call this one, so that it is compiled once for all arrays."""
    if surface.kind == SINE_COSINE:
        return _height_range_analytic(surface, pe, pn, pu, qe, qn, qu, stop_below)
    rows, columns = surface.up_m.shape
    u0 = (pe - surface.east0_m) / surface.step_m
    v0 = (pn - surface.north0_m) / surface.step_m
    u1 = (qe - surface.east0_m) / surface.step_m
    v1 = (qn - surface.north0_m) / surface.step_m
    if not (has_node_cell(surface, pe, pn) and has_node_cell(surface, qe, qn)):
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
            a = pu + t * (qu - pu) - _in_cell(surface.up_m, i, j, u0 + t * du, v0 + t * dv)
            m = pu + middle * (qu - pu) - _in_cell(surface.up_m, i, j, u0 + middle * du, v0 + middle * dv)
            b = pu + end * (qu - pu) - _in_cell(surface.up_m, i, j, u0 + end * du, v0 + end * dv)
            low, low_at, high, high_at = _parabola_range(a, m, b)
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
def _in_cell(z: NDArray[np.float64], i: int, j: int, u: float, v: float) -> float:
    """Bilinear height in cell (i, j), also just outside of it."""
    v -= i
    u -= j
    south = z[i, j] + u * (z[i, j + 1] - z[i, j])
    north = z[i + 1, j] + u * (z[i + 1, j + 1] - z[i + 1, j])
    return float(south + v * (north - south))


@kernel
def _parabola_range(a: float, m: float, b: float) -> tuple[float, float, float, float]:
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
def _height_range_analytic(
    surface: Surface, pe: float, pn: float, pu: float, qe: float, qn: float, qu: float, stop_below: float
) -> tuple[float, float, float, float]:
    """:func:`height_range_between` for SINE_COSINE."""
    if not (math.isfinite(pe + pn + pu) and math.isfinite(qe + qn + qu)):
        return math.nan, math.nan, math.nan, math.nan
    horizontal = math.hypot(qe - pe, qn - pn)
    pieces = max(1, math.ceil(horizontal / (_ANALYTIC_PIECE * surface.step_m)))
    lowest = math.inf
    lowest_at = 0.0
    highest = -math.inf
    highest_at = 0.0
    a = pu - height(surface, pe, pn)
    for k in range(pieces):
        middle = (k + 0.5) / pieces
        end = (k + 1.0) / pieces
        m = pu + middle * (qu - pu) - height(surface, pe + middle * (qe - pe), pn + middle * (qn - pn))
        b = pu + end * (qu - pu) - height(surface, pe + end * (qe - pe), pn + end * (qn - pn))
        low, low_at, high, high_at = _parabola_range(a, m, b)
        if low < lowest:
            lowest = low
            lowest_at = (k + low_at) / pieces
            if lowest < stop_below:
                return lowest, lowest_at, highest, highest_at
        if high > highest:
            highest = high
            highest_at = (k + high_at) / pieces
        a = b
    return lowest, lowest_at, highest, highest_at


@kernel
def stays_above(
    surface: Surface, pe: float, pn: float, pu: float, qe: float, qn: float, qu: float, limit: float
) -> bool:
    """Whether a segment is nowhere lower than ``limit`` above the surface; False where there is no data.

    The answer of :func:`height_range_between`, found sooner above the analytic surface: from a place high above the
    ground no piece can reach the limit before the segment has come down at the steepest slope there is.
    """
    if surface.kind != SINE_COSINE:
        return bool(height_range_between(surface, pe, pn, pu, qe, qn, qu, limit)[0] >= limit)
    if not (math.isfinite(pe + pn + pu) and math.isfinite(qe + qn + qu)):
        return False
    horizontal = math.hypot(qe - pe, qn - pn)
    pieces = max(1, math.ceil(horizontal / (_ANALYTIC_PIECE * surface.step_m)))
    # How much of the height above ground one piece can take away at most.
    loss = (horizontal * surface.steepest - (qu - pu)) / pieces
    k = 0
    a = pu - height(surface, pe, pn)
    while k < pieces:
        if a - limit >= loss * (pieces - k):
            return True
        safe = int((a - limit) / loss) if a > limit else 0
        if safe > 0:
            k += safe
            t = k / pieces
            a = pu + t * (qu - pu) - height(surface, pe + t * (qe - pe), pn + t * (qn - pn))
            continue
        middle, end = (k + 0.5) / pieces, (k + 1.0) / pieces
        m = pu + middle * (qu - pu) - height(surface, pe + middle * (qe - pe), pn + middle * (qn - pn))
        b = pu + end * (qu - pu) - height(surface, pe + end * (qe - pe), pn + end * (qn - pn))
        if _parabola_range(a, m, b)[0] < limit:
            return False
        a = b
        k += 1
    return True


@kernel
def leg_height_ranges(surface: Surface, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n - 1, 4) smallest height above ground, its parameter, largest, its parameter, of the legs of an (n, 3) route."""
    legs = route.shape[0] - 1
    out = np.empty((max(legs, 0), 4))
    for i in range(legs):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = height_range_between(
            surface,
            route[i, 0], route[i, 1], route[i, 2], route[i + 1, 0], route[i + 1, 1], route[i + 1, 2],
            -math.inf,
        )  # fmt: skip
    return out
