"""The ground as a mesh with a relief map on it. Arrays only."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.site import Site
from uavcover.terrain.ground import Ground
from uavcover.terrain.relief_grid import relief_grid

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

MAX_NODES_PER_SIDE = 180
"""Of the mesh: more would not be seen, and would fill the file."""

TEXTURE_PIXELS = 512
"""Along the longer side of the picture that lies on the mesh."""


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """A triangle mesh of the ground.

    Attributes:
        vertices_m: (n, 3) ENU metres.
        triangles: (m, 3) uint32 numbers of vertices, counter-clockwise seen from above.
        texture_places: (n, 2) where each vertex lies in the texture: 0..1 from its left and from its top.
        texture: (rows, columns, 3) uint8 RGB, north on top.
    """

    vertices_m: FloatArray
    triangles: NDArray[np.uint32]
    texture_places: FloatArray
    texture: ByteArray


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
    texture = relief_grid(ground, bounds_m, nodes=TEXTURE_PIXELS).rgb[::-1]
    # The texture's outer pixels have their middles on the rim of the rectangle.
    rows, columns = texture.shape[:2]
    across = (0.5 + (grid_e - west) / (east - west) * (columns - 1)) / columns
    down = (0.5 + (north - grid_n) / (north - south) * (rows - 1)) / rows
    vertices = np.column_stack([places, np.where(known, up, 0.0)])
    return ReliefMesh(vertices, triangles, np.column_stack([across.ravel(), down.ravel()]), texture)
