"""From how far away a cell can be seen at all, with anything that flies not higher above ground than allowed."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.grid_frame import on_grid
from uavcover.kernels.nodes import in_cell
from uavcover.kernels.surface import Surface


@kernel
def farthest_looks(
    centres: NDArray[np.float64],
    tops: NDArray[np.float64],
    east0: float,
    north0: float,
    side: float,
    tan_half_fov: float,
    reach: float,
) -> NDArray[np.float64]:
    """(n,) no allowed place further away than this, on the map, sees a cell through a cone; 0 where none does.

    The map is cut into squares. From a place at distance d a camera that looks straight down sees a cell when
    d <= tan_half_fov times its height above the cell, which is at most that of the square's top. Nothing else is asked
    (range, incidence, line of sight), so the true distance may be smaller, never larger.

    Args:
        centres: (n, 3) of the cells.
        tops: (rows, columns) highest allowed up coordinate anywhere over each square; NaN: no place is allowed there.
        east0: of the south-west corner of the first square.
        north0: likewise.
        side: of the squares.
        tan_half_fov: of the cone.
        reach: no place further away on the map sees anything.
    """
    rows, columns = tops.shape
    out = np.zeros(centres.shape[0])
    for k in range(centres.shape[0]):
        e, n, u = centres[k, 0] - east0, centres[k, 1] - north0, centres[k, 2]
        for i in range(max(0, int((n - reach) / side)), min(rows - 1, int((n + reach) / side)) + 1):
            dn_near = max(0.0, i * side - n, n - (i + 1) * side)
            dn_far = max(abs(n - i * side), abs(n - (i + 1) * side))
            for j in range(max(0, int((e - reach) / side)), min(columns - 1, int((e + reach) / side)) + 1):
                if math.isnan(tops[i, j]):
                    continue
                radius = min(reach, tan_half_fov * (tops[i, j] - u))
                if radius <= out[k]:
                    continue
                de_near = max(0.0, j * side - e, e - (j + 1) * side)
                if math.hypot(de_near, dn_near) > radius:
                    continue
                de_far = max(abs(e - j * side), abs(e - (j + 1) * side))
                out[k] = max(out[k], min(radius, math.hypot(de_far, dn_far)))
    return out


@kernel
def highest_in_squares(
    surface: Surface, east0: float, north0: float, side: float, count: int, beside: float
) -> NDArray[np.float64]:
    """(count, count) up coordinate that the ground of a grid nowhere exceeds in or beside squares of the map; rows go north.

    The box around a square on the grid is cut along its node lines: in each part the ground is bilinear, and highest at a
    corner. Cells without data are left out; NaN where nothing is left.

    Args:
        surface: a grid.
        east0: of the south-west corner of the first square.
        north0: likewise.
        side: of the squares.
        count: of rows and of columns.
        beside: metres around each square that belong to it.
    """
    grid, z = surface.grid, surface.up_m
    rows, columns = z.shape
    out = np.full((count, count), np.nan)
    for i in range(count):
        for j in range(count):
            first_u, last_u, first_v, last_v = math.inf, -math.inf, math.inf, -math.inf
            for corner in range(4):
                e = east0 + (j + corner % 2) * side
                n = north0 + (i + corner // 2) * side
                u, v = on_grid(grid, e, n, grid.level_up_m)
                first_u, last_u = min(first_u, u), max(last_u, u)
                first_v, last_v = min(first_v, v), max(last_v, v)
            first_u = max(0.0, first_u - grid.leeway - beside * grid.per_column)
            last_u = min(columns - 1.0, last_u + grid.leeway + beside * grid.per_column)
            first_v = max(0.0, first_v - grid.leeway - beside * grid.per_row)
            last_v = min(rows - 1.0, last_v + grid.leeway + beside * grid.per_row)
            if first_u > last_u or first_v > last_v:
                continue
            for cell_v in range(min(int(first_v), rows - 2), min(int(last_v), rows - 2) + 1):
                for cell_u in range(min(int(first_u), columns - 2), min(int(last_u), columns - 2) + 1):
                    west, east = max(first_u, float(cell_u)), min(last_u, cell_u + 1.0)
                    near, far = max(first_v, float(cell_v)), min(last_v, cell_v + 1.0)
                    up = max(
                        max(in_cell(z, cell_v, cell_u, west, near), in_cell(z, cell_v, cell_u, east, near)),
                        max(in_cell(z, cell_v, cell_u, west, far), in_cell(z, cell_v, cell_u, east, far)),
                    )
                    if not math.isnan(up) and not up <= out[i, j]:
                        out[i, j] = up
    return out
