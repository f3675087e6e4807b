"""How steep the ground is at most between two places: what lets most rays pass without being traced.

:attr:`uavcover.kernels.surface.Surface.steepest` bounds the whole ground, and is infinite as soon as one node has no data. Here
each block of the grid has its own bound, and a ray asks only those between its ends.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.grid_frame import GridFrame, on_grid
from uavcover.kernels.nodes import steepest_in_cell
from uavcover.kernels.surface import GRID, Surface

BLOCK_CELLS = 4


class LocalSlopes(NamedTuple):
    """Bounds on the slope in square blocks of the grid.

    Attributes:
        steepest: (rows, columns) tangents; infinite where a node of the block has no data. (1, 1) for an analytic surface.
    """

    steepest: NDArray[np.float64]


def local_slopes(surface: Surface) -> LocalSlopes:
    """The bounds of a surface; see :func:`uavcover.kernels.nodes.steepest_in_cell` for that of one cell."""
    if surface.kind != GRID:
        return LocalSlopes(np.array([[surface.steepest]]))
    return LocalSlopes(_steepest_in_blocks(surface.up_m, surface.grid))


@kernel
def _steepest_in_blocks(nodes: NDArray[np.float64], frame: GridFrame) -> NDArray[np.float64]:
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    out = np.zeros(((rows - 1) // BLOCK_CELLS + 1, (columns - 1) // BLOCK_CELLS + 1))
    for i in range(rows):
        for j in range(columns):
            slope = steepest_in_cell(nodes, frame, i, j)
            if math.isnan(slope):
                slope = math.inf
            out[i // BLOCK_CELLS, j // BLOCK_CELLS] = max(out[i // BLOCK_CELLS, j // BLOCK_CELLS], slope)
    return out


@kernel
def steepest_between(surface: Surface, slopes: LocalSlopes, ae: float, an: float, be: float, bn: float) -> float:
    """No straight way over ground between two places is anywhere steeper than this; infinite outside the grid."""
    if surface.kind != GRID:
        return float(slopes.steepest[0, 0])
    if not math.isfinite(ae + an + be + bn):
        return math.inf
    grid = surface.grid
    a_column, a_row = on_grid(grid, ae, an, grid.level_up_m)
    b_column, b_row = on_grid(grid, be, bn, grid.level_up_m)
    west, east = min(a_column, b_column) - grid.leeway, max(a_column, b_column) + grid.leeway
    first, last = min(a_row, b_row) - grid.leeway, max(a_row, b_row) + grid.leeway
    if not (west >= 0.0 and first >= 0.0 and east <= surface.up_m.shape[1] - 1 and last <= surface.up_m.shape[0] - 1):
        return math.inf
    rows, columns = slopes.steepest.shape
    steepest = 0.0
    for i in range(int(first) // BLOCK_CELLS, min(int(last) // BLOCK_CELLS, rows - 1) + 1):
        for j in range(int(west) // BLOCK_CELLS, min(int(east) // BLOCK_CELLS, columns - 1) + 1):
            steepest = max(steepest, slopes.steepest[i, j])
    return steepest
