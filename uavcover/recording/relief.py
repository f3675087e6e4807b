"""The ground as a mesh with the colours of a relief map. Arrays only."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.site import Site
from uavcover.terrain.ground import Ground

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

MAX_NODES_PER_SIDE = 180
"""Of the mesh: more would not be seen, and would fill the file."""

_LIGHT_AZIMUTH_DEG = 315.0
_LIGHT_ELEVATION_DEG = 45.0
_AMBIENT = 0.2

# Low to high, muted, so that paths and cells stand out: sage, straw, clay, stone.
_RAMP = np.array([[96, 116, 92], [150, 146, 108], [140, 116, 92], [186, 182, 178]], dtype=float)


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """A triangle mesh of the ground.

    Attributes:
        vertices_m: (n, 3) ENU metres.
        triangles: (m, 3) uint32 numbers of vertices, counter-clockwise seen from above.
        colors: (n, 3) uint8 RGB.
    """

    vertices_m: FloatArray
    triangles: NDArray[np.uint32]
    colors: ByteArray


def scene_bounds_m(site: Site) -> tuple[float, float, float, float]:
    """West, south, east, north of what is shown: the fence."""
    west, south, east, north = site.fence.bounds
    return float(west), float(south), float(east), float(north)


def extent_m(bounds_m: tuple[float, float, float, float]) -> float:
    """Length of the longer side."""
    return max(bounds_m[2] - bounds_m[0], bounds_m[3] - bounds_m[1])


def relief_mesh(ground: Ground, bounds_m: tuple[float, float, float, float]) -> ReliefMesh:
    """Sample the ground over a rectangle; squares that touch a place without data are left out.

    Args:
        ground: any surface.
        bounds_m: west, south, east, north, metres.
    """
    west, south, east, north = bounds_m
    step_m = extent_m(bounds_m) / (MAX_NODES_PER_SIDE - 1)
    e = np.linspace(west, east, max(2, math.ceil((east - west) / step_m) + 1))
    n = np.linspace(south, north, max(2, math.ceil((north - south) / step_m) + 1))
    grid_e, grid_n = np.meshgrid(e, n)
    places = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up = ground.heights_m(places)
    number = np.arange(up.size, dtype=np.uint32).reshape(grid_e.shape)
    sw, se, nw, ne = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    triangles = np.concatenate([np.stack([sw, se, ne], -1).reshape(-1, 3), np.stack([sw, ne, nw], -1).reshape(-1, 3)])
    known = np.isfinite(up)
    triangles = triangles[known[triangles].all(axis=1)]
    colors = _height_colors(up) * hillshade(ground.gradients(places))[:, None]
    vertices = np.column_stack([places, np.where(known, up, 0.0)])
    return ReliefMesh(vertices, triangles, np.clip(colors, 0.0, 255.0).astype(np.uint8))


def hillshade(gradients: FloatArray) -> FloatArray:
    """Brightness (n,) of ground with slopes (n, 2) under light from the north-west; 1 is level ground, 0 without data."""
    azimuth, elevation = math.radians(_LIGHT_AZIMUTH_DEG), math.radians(_LIGHT_ELEVATION_DEG)
    light = (
        math.sin(azimuth) * math.cos(elevation),
        math.cos(azimuth) * math.cos(elevation),
        math.sin(elevation),
    )
    facing = -gradients[:, 0] * light[0] - gradients[:, 1] * light[1] + light[2]
    facing = np.maximum(facing / np.sqrt(1.0 + (gradients**2).sum(axis=1)), 0.0) / light[2]
    return np.asarray(np.nan_to_num(_AMBIENT + (1.0 - _AMBIENT) * facing))


def shaded(rgb: tuple[int, int, int], brightness: FloatArray) -> ByteArray:
    """One colour (n, 3) uint8 under (n,) brightnesses."""
    return np.asarray(np.clip(np.outer(brightness, rgb), 0.0, 255.0), dtype=np.uint8)


def _height_colors(up_m: FloatArray) -> FloatArray:
    known = up_m[np.isfinite(up_m)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    share = np.nan_to_num((up_m - low) / (high - low)) if high > low else np.zeros(up_m.size)
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.column_stack([np.interp(share, stops, _RAMP[:, channel]) for channel in range(3)])
