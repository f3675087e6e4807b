"""The ground of a rectangle sampled on a grid, in the colours of a relief map. Arrays only."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.surface import GRID
from uavcover.terrain.ground import Ground
from uavcover.terrain.shading import relief_colors

FloatArray = NDArray[np.float64]

_SMOOTH_STEPS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ReliefGrid:
    """Ground on a grid; rows go north, columns east.

    Attributes:
        east_m: (rows, columns).
        north_m: (rows, columns).
        up_m: (rows, columns) heights, NaN where there is no data.
        rgb: (rows, columns, 3) uint8, black where there is no data.
    """

    east_m: FloatArray
    north_m: FloatArray
    up_m: FloatArray
    rgb: NDArray[np.uint8]


def relief_grid(ground: Ground, bounds_m: tuple[float, float, float, float], *, nodes: int) -> ReliefGrid:
    """Sample a rectangle from corner to corner.

    Args:
        ground: any surface.
        bounds_m: west, south, east, north.
        nodes: along the longer side.
    """
    west, south, east, north = bounds_m
    step = max(east - west, north - south) / (nodes - 1)
    columns = np.linspace(west, east, max(2, math.ceil((east - west) / step - 1e-9) + 1))
    rows = np.linspace(south, north, max(2, math.ceil((north - south) / step - 1e-9) + 1))
    grid_e, grid_n = np.meshgrid(columns, rows)
    places = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up = ground.heights_m(places)
    colors = relief_colors(up, _smooth_slopes(ground, places))
    return ReliefGrid(grid_e, grid_n, up.reshape(grid_e.shape), colors.reshape(*grid_e.shape, 3))


def _smooth_slopes(ground: Ground, places_m: FloatArray) -> FloatArray:
    """Slopes (n, 2) across a few steps of the grid: the ground's own jump from square to square, which looks like tiles."""
    if ground.surface.kind != GRID:
        return ground.gradients(places_m)
    reach = _SMOOTH_STEPS * ground.surface.step_m
    slopes = [
        (ground.heights_m(places_m + offset) - ground.heights_m(places_m - offset)) / (2.0 * reach)
        for offset in ((reach, 0.0), (0.0, reach))
    ]
    return np.column_stack(slopes)
