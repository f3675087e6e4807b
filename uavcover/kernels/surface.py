"""Height of the ground, and the clearance of straight segments above it.

A surface is a :class:`Surface`, plain numbers and one array. Two kinds:

- ``GRID``: heights at the nodes of a grid, bilinear between them. NaN nodes are no-data, and so is every place that touches
  one. :mod:`uavcover.kernels.grid` says where the nodes are.
- ``SINE_COSINE``: z = s sin(y / s) cos(x / s), evaluated exactly (the paper's Eq. 26).

Heights above ground are measured along the plumb line. Along a straight segment a bilinear cell is a parabola, so the smallest
and largest height of the segment above a grid are computed exactly, cell by cell, in closed form; where the grid is bent, on
pieces that are short enough to be straight on it. Above the analytic surface the segment is cut into pieces of 0.05 s whose
parabola through three points is used. Along a level line sin(y) cos(x) = (sin(y + x) + sin(y - x)) / 2 has a third
derivative of at most sqrt(2) / s^2, so the parabola errs by at most sqrt(2) 0.05^3 s / (72 sqrt(3)) = 1.5e-6 s.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import Point
from uavcover.kernels.grid import (
    GridFrame,
    among_nodes,
    growth_on_grid,
    on_grid,
    on_nodes,
    parabola_range,
    range_on_nodes,
    stays_above_nodes,
)
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import NO_OBSTACLES, ObstaclePrisms

GRID = 0
SINE_COSINE = 1

_ANALYTIC_PIECE = 0.05
_SETTLED_M = 1e-8
_MOST_ROUNDS = 60


class Surface(NamedTuple):
    """A height surface in the local frame, and what stands on it.

    Attributes:
        kind: GRID or SINE_COSINE.
        step_m: smallest spacing of the nodes (GRID), or the scale s (SINE_COSINE).
        up_m: (rows, columns) float64 heights of the nodes; (1, 1) and unused for SINE_COSINE.
        steepest: no two places of the surface have a steeper slope between them (tangent). Infinite when it is not known,
            as with no-data.
        grid: where the nodes are; unused for SINE_COSINE.
        obstacles: prisms on the surface. Heights above the surface are heights above ground, not above them.
    """

    kind: int
    step_m: float
    up_m: NDArray[np.float64]
    steepest: float
    grid: GridFrame
    obstacles: ObstaclePrisms = NO_OBSTACLES


@kernel
def height(surface: Surface, east: float, north: float) -> float:
    """Up coordinate of the surface, metres; NaN outside the grid and where a node of the cell has no data."""
    return up_above(surface, east, north, 0.0)


@kernel
def up_above(surface: Surface, east: float, north: float, agl: float) -> float:
    """Up coordinate of the place ``agl`` metres above the surface; NaN without data.

    On a grid whose plumb lines lean, column and row depend a little on the answer. Each round makes the rest smaller by slope
    times lean, which is below 1/1000 over a few kilometres; where it does not settle the surface is no function of east and
    north, and is not known.
    """
    if surface.kind == SINE_COSINE:
        s = surface.step_m
        return s * math.sin(north / s) * math.cos(east / s) + agl
    level_up = surface.grid.level_up_m
    column, row = on_grid(surface.grid, east, north, level_up)
    up = on_nodes(surface.up_m, column, row) + agl
    if surface.grid.lean_per_m == 0.0 or not abs(up - level_up) > _SETTLED_M:
        return up
    column_there, row_there = on_grid(surface.grid, east, north, up)
    # A plumb line is straight on the grid: what is left to find is centimetres away.
    columns_per_m, rows_per_m = (column_there - column) / (up - level_up), (row_there - row) / (up - level_up)
    from_up = up
    for _ in range(_MOST_ROUNDS):
        before = up
        climb = before - from_up
        up = on_nodes(surface.up_m, column_there + climb * columns_per_m, row_there + climb * rows_per_m) + agl
        # Also when it is NaN.
        if not abs(up - before) > _SETTLED_M:
            return up
    return math.nan


@kernel
def height_above(surface: Surface, east: float, north: float, up: float) -> float:
    """Height of a place above the surface, metres; NaN without data."""
    if surface.kind == SINE_COSINE:
        return up - up_above(surface, east, north, 0.0)
    column, row = on_grid(surface.grid, east, north, up)
    return up - on_nodes(surface.up_m, column, row)


@kernel
def has_node_cell(surface: Surface, east: float, north: float, up: float) -> bool:
    """Whether a place lies over cells of the grid (with data or without); everywhere on the analytic surface."""
    if surface.kind == SINE_COSINE:
        return math.isfinite(east) and math.isfinite(north)
    column, row = on_grid(surface.grid, east, north, up)
    return among_nodes(surface.up_m, column, row)


@allocating_kernel
def gradient(surface: Surface, east: float, north: float) -> tuple[float, float]:
    """Slope of the surface towards east and towards north (dimensionless); NaN without data."""
    if surface.kind == SINE_COSINE:
        s = surface.step_m
        return -math.sin(north / s) * math.sin(east / s), math.cos(north / s) * math.cos(east / s)
    up = height(surface, east, north)
    if math.isnan(up):
        return math.nan, math.nan
    rows, columns = surface.up_m.shape
    u, v = on_grid(surface.grid, east, north, up)
    i = min(int(v), rows - 2)
    j = min(int(u), columns - 2)
    v -= i
    u -= j
    z = surface.up_m
    across = (1.0 - v) * (z[i, j + 1] - z[i, j]) + v * (z[i + 1, j + 1] - z[i + 1, j])
    along = (1.0 - u) * (z[i + 1, j] - z[i, j]) + u * (z[i + 1, j + 1] - z[i, j + 1])
    growth = growth_on_grid(surface.grid, east, north, up)
    # up = nodes(column(east, north, up), row(east, north, up)), differentiated.
    left = 1.0 - (across * growth[0, 2] + along * growth[1, 2])
    return (across * growth[0, 0] + along * growth[1, 0]) / left, (across * growth[0, 1] + along * growth[1, 1]) / left


@allocating_kernel
def heights(surface: Surface, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights at (n,) positions, metres; NaN without data."""
    out = np.empty(east.size)
    for i in range(east.size):
        out[i] = height(surface, east[i], north[i])
    return out


@allocating_kernel
def ups_above(
    surface: Surface, east: NDArray[np.float64], north: NDArray[np.float64], agl: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Up coordinates of (n,) positions with heights above ground, metres; NaN without data."""
    out = np.empty(east.size)
    for i in range(east.size):
        out[i] = up_above(surface, east[i], north[i], agl[i])
    return out


@allocating_kernel
def heights_above(surface: Surface, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights above ground of (n, 3) positions, metres; NaN without data."""
    out = np.empty(positions.shape[0])
    for i in range(positions.shape[0]):
        out[i] = height_above(surface, positions[i, 0], positions[i, 1], positions[i, 2])
    return out


@allocating_kernel
def gradients(surface: Surface, east: NDArray[np.float64], north: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) slopes towards east and north at (n,) positions."""
    out = np.empty((east.size, 2))
    for i in range(east.size):
        out[i, 0], out[i, 1] = gradient(surface, east[i], north[i])
    return out


@kernel
def height_range_between(
    surface: Surface, pe: float, pn: float, pu: float, qe: float, qn: float, qu: float, stop_below: float
) -> tuple[float, float, float, float]:
    """Smallest and largest height of the segment p-q above the surface, and where.

    Args:
        surface: the ground.
        pe: start, east, metres.
        pn: north.
        pu: up.
        qe: end, east.
        qn: north.
        qu: up.
        stop_below: stop as soon as a height below this is found (-inf: go to the end); the answer is then not the
            smallest one, but it is below the limit.

    Returns:
        smallest height, the parameter 0..1 where, largest height, the parameter where. All NaN when the segment leaves
        the data, or an end of it is not finite.
    """
    if surface.kind == SINE_COSINE:
        return _height_range_analytic(surface, pe, pn, pu, qe, qn, qu, stop_below)
    if not math.isfinite(pe + pn + pu + qe + qn + qu):
        return math.nan, math.nan, math.nan, math.nan
    pieces = _straight_pieces(surface.grid, (pe, pn, pu), (qe, qn, qu))
    lowest = math.inf
    lowest_at = 0.0
    highest = -math.inf
    highest_at = 0.0
    up = pu
    column, row = on_grid(surface.grid, pe, pn, pu)
    for k in range(pieces):
        next_column, next_row, next_up = _end_of_piece(surface.grid, k, pieces, (pe, pn, pu), (qe, qn, qu))
        low, low_at, high, high_at = range_on_nodes(
            surface.up_m, column, row, up, next_column, next_row, next_up, stop_below
        )
        if math.isnan(low):
            return math.nan, math.nan, math.nan, math.nan
        if low < lowest:
            lowest, lowest_at = low, (k + low_at) / pieces
        if high > highest:
            highest, highest_at = high, (k + high_at) / pieces
        if lowest < stop_below:
            break
        column, row, up = next_column, next_row, next_up
    return lowest, lowest_at, highest, highest_at


@kernel
def _straight_pieces(grid: GridFrame, p: Point, q: Point) -> int:
    """In how many equal pieces a segment is straight on the grid."""
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    return max(1, math.ceil(math.sqrt(de * de + dn * dn + du * du) / grid.piece_m))


@kernel
def _end_of_piece(grid: GridFrame, k: int, pieces: int, p: Point, q: Point) -> tuple[float, float, float]:
    """Column, row and up coordinate at the end of piece k of a segment."""
    e, n, up = q
    if k < pieces - 1:
        t = (k + 1.0) / pieces
        e, n, up = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2])
    column, row = on_grid(grid, e, n, up)
    return column, row, up


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
        low, low_at, high, high_at = parabola_range(a, m, b)
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
    """Whether a segment is nowhere lower than ``limit`` above the surface; False without data.

    The answer of :func:`height_range_between`, found sooner. Above the analytic surface: from a place high above the ground no
    piece can reach the limit before the segment has come down at the steepest slope there is.
    """
    if not (math.isfinite(pe + pn + pu) and math.isfinite(qe + qn + qu)):
        return False
    if surface.kind != SINE_COSINE:
        return _stays_above_grid(surface, pe, pn, pu, qe, qn, qu, limit)
    horizontal = math.hypot(qe - pe, qn - pn)
    pieces = max(1, math.ceil(horizontal / (_ANALYTIC_PIECE * surface.step_m)))
    # How much of the height above ground one piece can take away at most.
    loss = (horizontal * surface.steepest - (qu - pu)) / pieces
    k = 0
    a = pu - height(surface, pe, pn)
    if a < limit:
        return False
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
        if parabola_range(a, m, b)[0] < limit:
            return False
        a = b
        k += 1
    return True


@kernel
def _stays_above_grid(
    surface: Surface, pe: float, pn: float, pu: float, qe: float, qn: float, qu: float, limit: float
) -> bool:
    """:func:`stays_above` for GRID, from the lower end on: what stands in the way of a place is mostly near it."""
    if pu > qu:
        pe, pn, pu, qe, qn, qu = qe, qn, qu, pe, pn, pu
    pieces = _straight_pieces(surface.grid, (pe, pn, pu), (qe, qn, qu))
    up = pu
    column, row = on_grid(surface.grid, pe, pn, pu)
    for k in range(pieces):
        next_column, next_row, next_up = _end_of_piece(surface.grid, k, pieces, (pe, pn, pu), (qe, qn, qu))
        if not stays_above_nodes(surface.up_m, column, row, up, next_column, next_row, next_up, limit):
            return False
        column, row, up = next_column, next_row, next_up
    return True


@allocating_kernel
def leg_height_ranges(surface: Surface, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n - 1, 4) smallest height above ground, its parameter, the largest, its parameter, of each leg of a route."""
    legs = route.shape[0] - 1
    out = np.empty((max(legs, 0), 4))
    for i in range(legs):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = height_range_between(
            surface,
            route[i, 0], route[i, 1], route[i, 2], route[i + 1, 0], route[i + 1, 1], route[i + 1, 2],
            -math.inf,
        )  # fmt: skip
    return out
