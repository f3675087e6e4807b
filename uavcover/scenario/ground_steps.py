"""Find ground steps that no leg can pass: between two nodes they are higher than the height band is wide.

A leg beside a cliff that is low enough above its top is too high above its foot. Where such steps part the ground, a route
stays on one side.
"""

import math

import numpy as np
import shapely

from uavcover.kernels.arrays import BoolArray
from uavcover.kernels.surface import GRID, Surface
from uavcover.scenario.airspace.zones import Polygons
from uavcover.terrain.ground import Ground
from uavcover.terrain.pixel_frame import Bounds, nodes_between, places_of_nodes_m

_LEAST_SHARE = 0.005
"""Smallest share of a region: a smaller part behind steps, such as a ledge, is ignored."""

_TRIES = 12
"""Halvings of the range in which a width is looked for: 2 cm of 100 m."""


def parts_between_steps(ground: Ground, region: Polygons, *, width_m: float, slope: float) -> list[shapely.Polygon]:
    """The parts of a region between steps of the ground; none where steps divide nothing, or only ground below ``_LEAST_SHARE``.

    Args:
        ground: its nodes are looked at; other grounds have no steps.
        region: on the map.
        width_m: of the band of heights.
        slope: tangent of the steepest leg.
    """
    steps = _steps(ground.surface, region, width_m, slope)
    if steps is None:
        return []
    least_m2 = _LEAST_SHARE * region.area
    parts = [part for part in polygons_in(region.difference(steps)) if part.area >= least_m2]
    if len(parts) <= len(polygons_in(region)):
        return []
    # A step that can be flown around is no hole: legs are checked, and ways around many of them would take long.
    return [_without_small_holes(part, region, least_m2) for part in parts]


def least_width_m(
    ground: Ground, region: Polygons, parts: list[shapely.Polygon], *, width_m: float, slope: float
) -> float:
    """The width of the height band at which no step divides any two of the parts of a region any more.

    Args:
        ground: its nodes are looked at.
        region: on the map.
        parts: of :func:`parts_between_steps`.
        width_m: at which they are parted.
        slope: tangent of the steepest leg.
    """
    places = [part.representative_point() for part in parts]
    low, high = width_m, width_m + _highest_step_m(ground.surface, region.bounds)
    for _ in range(_TRIES):
        middle = 0.5 * (low + high)
        steps = _steps(ground.surface, region, middle, slope)
        left = [region] if steps is None else polygons_in(region.difference(steps))
        together = any(all(part.intersects(place) for place in places) for part in left)
        low, high = (low, middle) if together else (middle, high)
    return high


def polygons_in(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons of a shape, without its lines and points."""
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and not part.is_empty]


def _without_small_holes(part: shapely.Polygon, region: Polygons, least_m2: float) -> shapely.Polygon:
    holes = [ring for ring in part.interiors if shapely.Polygon(ring).area >= least_m2]
    filled = shapely.Polygon(part.exterior, holes).intersection(region)
    return max(polygons_in(filled), key=lambda each: each.area)


def _steps(surface: Surface, region: Polygons, width_m: float, slope: float) -> shapely.Geometry | None:
    """The ground beside steps inside the bounds of a region, with few corners; none where there is no step."""
    if surface.kind != GRID or region.is_empty:
        return None
    grid = surface.grid
    column_m, row_m = 1.0 / grid.per_column, 1.0 / grid.per_row
    if surface.steepest * max(column_m, row_m) <= width_m + slope * min(column_m, row_m):
        return None
    columns, rows = nodes_between(grid, surface.up_m, region.bounds)
    ups = surface.up_m[rows[0] : rows[1], columns[0] : columns[1]]
    across = np.abs(np.diff(ups, axis=1)) > width_m + slope * column_m
    along = np.abs(np.diff(ups, axis=0)) > width_m + slope * row_m
    # A step is that of all pixels that have it as a side.
    steep = across[:-1] | across[1:] | along[:, :-1] | along[:, 1:]
    if not steep.any():
        return None
    apart_m = 0.75 * max(column_m, row_m)
    found = shapely.union_all(_runs(surface, steep, columns[0], rows[0]))
    grown = found.buffer(apart_m, join_style="mitre")
    # in distances between nodes: outlines this much simpler than those of pixels
    return grown.simplify(0.7 * max(column_m, row_m))


def _runs(surface: Surface, steep: BoolArray, first_column: int, first_row: int) -> list[shapely.Geometry]:
    """A quadrangle for each run of marked pixels of a row."""
    padded = np.zeros((steep.shape[0], steep.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = steep
    turns = np.diff(padded, axis=1)
    rows, begins = np.nonzero(turns == 1)
    _, ends = np.nonzero(turns == -1)
    corners = np.stack([
        np.column_stack([begins, rows]), np.column_stack([ends, rows]),
        np.column_stack([ends, rows + 1]), np.column_stack([begins, rows + 1]),
    ], axis=1) + np.array([first_column, first_row], dtype=float)  # fmt: skip
    flat = corners.reshape(-1, 2)
    places = places_of_nodes_m(surface.grid, flat, np.full(len(flat), math.nan))
    return [shapely.Polygon(corners) for corners in places[:, :2].reshape(-1, 4, 2)]


def _highest_step_m(surface: Surface, bounds_m: Bounds) -> float:
    columns, rows = nodes_between(surface.grid, surface.up_m, bounds_m)
    ups = surface.up_m[rows[0] : rows[1], columns[0] : columns[1]]
    return float(max(np.nanmax(np.abs(np.diff(ups, axis=axis)), initial=0.0) for axis in (0, 1)))
