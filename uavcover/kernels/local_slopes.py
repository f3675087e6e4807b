"""How steep the ground is at most between two places: what lets most rays pass without being traced.

:attr:`uavcover.kernels.surface.Surface.steepest` bounds the whole ground, and is infinite as soon as one node has no data. Here
each block of the grid has its own bound, and a ray asks only those between its ends.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.surface import GRID, Surface

BLOCK_CELLS = 4


class LocalSlopes(NamedTuple):
    """Bounds on the slope in square blocks of the grid.

    Attributes:
        steepest: (rows, columns) tangents; infinite where a node of the block has no data. (1, 1) for an analytic surface.
        block_m: side of a block; infinite for an analytic surface, which is one block.
    """

    steepest: NDArray[np.float64]
    block_m: float


def local_slopes(surface: Surface) -> LocalSlopes:
    """The bounds of a surface; see :func:`uavcover.kernels.surface.steepest_slope` for that of one cell."""
    if surface.kind != GRID:
        return LocalSlopes(np.array([[surface.steepest]]), math.inf)
    east = np.abs(np.diff(surface.up_m, axis=1))
    north = np.abs(np.diff(surface.up_m, axis=0))
    cells = np.hypot(np.maximum(east[:-1], east[1:]), np.maximum(north[:, :-1], north[:, 1:])) / surface.step_m
    cells[np.isnan(cells)] = math.inf
    rows, columns = (-(-size // BLOCK_CELLS) for size in cells.shape)
    padded = np.zeros((rows * BLOCK_CELLS, columns * BLOCK_CELLS))
    padded[: cells.shape[0], : cells.shape[1]] = cells
    blocks = padded.reshape(rows, BLOCK_CELLS, columns, BLOCK_CELLS).max(axis=(1, 3))
    return LocalSlopes(np.ascontiguousarray(blocks), BLOCK_CELLS * surface.step_m)


@kernel
def steepest_between(surface: Surface, slopes: LocalSlopes, ae: float, an: float, be: float, bn: float) -> float:
    """No straight way over ground between two places is anywhere steeper than this; infinite outside the grid."""
    if surface.kind != GRID:
        return float(slopes.steepest[0, 0])
    if not math.isfinite(ae + an + be + bn):
        return math.inf
    rows, columns = slopes.steepest.shape
    west, east = min(ae, be) - surface.east0_m, max(ae, be) - surface.east0_m
    south, north = min(an, bn) - surface.north0_m, max(an, bn) - surface.north0_m
    nodes_north, nodes_east = surface.up_m.shape
    inside = west >= 0.0 and east <= (nodes_east - 1) * surface.step_m
    if not (inside and south >= 0.0 and north <= (nodes_north - 1) * surface.step_m):
        return math.inf
    steepest = 0.0
    for i in range(int(south / slopes.block_m), min(int(north / slopes.block_m), rows - 1) + 1):
        for j in range(int(west / slopes.block_m), min(int(east / slopes.block_m), columns - 1) + 1):
            steepest = max(steepest, slopes.steepest[i, j])
    return steepest
