"""A proved lower bound on the length of a path that sees a share of the ground.

A curve of length L has at most the area 2 r L + pi r^2 within r of it. Every cell has a largest distance on the map from which
any allowed place sees it. Of the cells for which that is at most r the path must see all but what may stay unseen, so it comes
within r, and half a cell's diagonal, of their area. The best r is taken. Nothing of it depends on a lattice of places, so no
route whatever inside the height band beats it; it is far below the shortest path, because a path also has to turn.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.coverage.sensors import whatever_heading
from uavcover.kernels.reach import farthest_looks, highest_in_squares
from uavcover.kernels.sight import CONE, horizontal_reach
from uavcover.kernels.surface import GRID

FloatArray = NDArray[np.float64]

_MOST_SQUARES_ACROSS = 4_000


def least_path_length_m(coverage: CoverageMap, share: float) -> float:
    """No path that sees a share of what can be covered is shorter, metres; 0 where that is all that can be said.

    Args:
        coverage: on the cells by which routes are judged.
        share: of what can be covered, 0..1.
    """
    grid, coverable = coverage.grid, coverage.coverable
    side = grid.cells.size_m
    reach = np.sort(farthest_looks_m(coverage)[coverable])
    half_diagonal = side * math.sqrt(0.5)
    # The ground of a cell is at least as large as the cell on the map.
    unseen_m2 = (1.0 - share) * float(grid.weight_m2[coverable].sum())
    radius = reach + half_diagonal
    area_m2 = side**2 * np.arange(1, len(reach) + 1) - unseen_m2
    lengths = (area_m2 - math.pi * radius**2) / (2.0 * radius)
    return max(0.0, float(lengths.max(initial=0.0)))


def farthest_looks_m(coverage: CoverageMap) -> FloatArray:
    """(cells,) no place inside the height band further away on the map sees a cell, metres."""
    sight = whatever_heading(coverage.sight)
    reach = horizontal_reach(sight)
    if sight.kind != CONE:
        return np.full(coverage.grid.count, reach)
    tops, east0, north0, side = _tops(coverage, reach)
    return farthest_looks(coverage.grid.cells.centre_m, tops, east0, north0, side, sight.tan_half_fov, reach)


def _tops(coverage: CoverageMap, reach_m: float) -> tuple[FloatArray, float, float, float]:
    """Highest allowed up over squares around the area, with their south-west corner and side."""
    surface, limits = coverage.site.ground.surface, coverage.site.scenario.limits
    highest_agl_m = limits.max_height_agl_m - limits.height_margin_m
    west, south, east, north = coverage.site.area.bounds
    east0, north0 = west - reach_m, south - reach_m
    across = max(east - west, north - south) + 2.0 * reach_m
    if surface.kind == GRID:
        side = max(0.5 * surface.step_m, across / _MOST_SQUARES_ACROSS)
        count = math.ceil(across / side)
        # Plumb lines lean: above its ground a place of the band may stand a little aside of it, and so a little higher.
        lean_m = surface.grid.lean * highest_agl_m
        return highest_in_squares(surface, east0, north0, side, count, lean_m) + highest_agl_m, east0, north0, side
    side = max(0.25 * coverage.grid.cells.size_m, across / _MOST_SQUARES_ACROSS)
    steps = side * np.arange(math.ceil(across / side) + 1)
    grid_e, grid_n = np.meshgrid(east0 + steps, north0 + steps)
    nodes = coverage.site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()])).reshape(grid_e.shape)
    corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]])
    highest = corners.max(axis=0) + surface.steepest * side * math.sqrt(0.5)
    return np.ascontiguousarray(highest + highest_agl_m), east0, north0, side
