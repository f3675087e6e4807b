"""Shaded relief of a rectangle of ground, sampled on a grid and coloured. Arrays only."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import ByteArray, FloatArray
from uavcover.kernels.surface import GRID
from uavcover.terrain.ground import Ground
from uavcover.terrain.tuning import RELIEF

# Low to high, muted, so that paths and cells stand out: sage, straw, clay, stone.
_RAMP = np.array([[96, 116, 92], [150, 146, 108], [140, 116, 92], [186, 182, 178]], dtype=float)


def hillshade(gradients: FloatArray) -> FloatArray:
    """Brightness (n,) of ground with slopes (n, 2) under light from the north-west; 1 is level ground, 0 without data."""
    azimuth, elevation = math.radians(RELIEF.light_azimuth_deg), math.radians(RELIEF.light_elevation_deg)
    light = (
        math.sin(azimuth) * math.cos(elevation),
        math.cos(azimuth) * math.cos(elevation),
        math.sin(elevation),
    )
    facing = -gradients[:, 0] * light[0] - gradients[:, 1] * light[1] + light[2]
    facing = np.maximum(facing / np.sqrt(1.0 + (gradients**2).sum(axis=1)), 0.0) / light[2]
    return np.asarray(np.nan_to_num(RELIEF.ambient + (1.0 - RELIEF.ambient) * facing))


def shaded(rgb: tuple[int, int, int], brightness: FloatArray) -> ByteArray:
    """One colour (n, 3) uint8 under (n,) brightnesses."""
    return np.asarray(np.clip(np.outer(brightness, rgb), 0.0, 255.0), dtype=np.uint8)


def relief_colors(up_m: FloatArray, gradients: FloatArray) -> ByteArray:
    """Colours (n, 3) uint8 of ground with heights (n,) and slopes (n, 2): by height, under hillshade; black without data."""
    colors = _height_colors(up_m) * hillshade(gradients)[:, None]
    return np.asarray(np.clip(colors, 0.0, 255.0), dtype=np.uint8)


def _height_colors(up_m: FloatArray) -> FloatArray:
    known = up_m[np.isfinite(up_m)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    share = np.nan_to_num((up_m - low) / (high - low)) if high > low else np.zeros(up_m.size)
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.column_stack([np.interp(share, stops, _RAMP[:, channel]) for channel in range(3)])


@dataclass(frozen=True, slots=True, eq=False)
class ReliefGrid:
    """Ground on a grid; rows run north, columns east."""

    east_m: FloatArray  # (rows, columns)
    north_m: FloatArray  # (rows, columns)
    up_m: FloatArray  # (rows, columns) heights, NaN where there is no data
    rgb: NDArray[np.uint8]  # (rows, columns, 3) uint8, black where there is no data


def relief_grid(ground: Ground, bounds_m: tuple[float, float, float, float], *, nodes: int) -> ReliefGrid:
    """Sample a rectangle from corner to corner.

    Args:
        ground: any surface.
        bounds_m: west, south, east, north.
        nodes: number of nodes along the longer side.
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
    """Slopes (n, 2) across a few steps of the grid. The ground's own slopes jump from square to square and look like tiles."""
    if ground.surface.kind != GRID:
        return ground.gradients(places_m)
    reach = RELIEF.smooth_steps * ground.surface.step_m
    slopes = [
        (ground.heights_m(places_m + offset) - ground.heights_m(places_m - offset)) / (2.0 * reach)
        for offset in ((reach, 0.0), (0.0, reach))
    ]
    return np.column_stack(slopes)
