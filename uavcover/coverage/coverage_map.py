"""Coverage of routes and tracks, and what can be covered at all."""

import math
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.coverage.cells import CellGrid, make_cells
from uavcover.coverage.sensors import reach_at_height_m, sight_of
from uavcover.kernels import coverage as kernels
from uavcover.kernels.coverage import Sight
from uavcover.site import Site
from uavcover.terrain.clearance import waypoint_breaches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_TRY_DIRECTIONS = 12
_TRY_RADII = (0.35, 0.7, 0.95)
_TRY_HEIGHTS = (0.5, 0.0, 1.0)


class CoverageMap:
    """Answers which cells of a site are seen, for one cell size.

    Attributes:
        site: the scenario on its ground.
        grid: its cells.
        sight: its sensor.
    """

    def __init__(self, site: Site, *, cell_size_m: float) -> None:
        self.site = site
        self.grid: CellGrid = make_cells(site, cell_size_m)
        self.sight: Sight = sight_of(site.scenario.sensor)

    def looks(self, route_m: FloatArray) -> FloatArray:
        """Places (k, 3) from which a sensor on an (n, 3) ENU route looks: its waypoints, or samples along its legs."""
        route = np.ascontiguousarray(route_m, dtype=float).reshape(-1, 3)
        if self.site.scenario.sensor.sensing == "at-waypoints":
            return route
        return kernels.sample_path(route, self.site.scenario.sensor.sample_spacing_m)

    def seen(self, route_m: FloatArray) -> BoolArray:
        """(cells,) whether each cell is seen from an (n, 3) ENU route, by the sensing rule of the scenario."""
        return self.seen_from(self.looks(route_m))

    def seen_from(self, points_m: FloatArray) -> BoolArray:
        """(cells,) whether each cell is seen from any of (k, 3) ENU points."""
        points = np.ascontiguousarray(points_m, dtype=float).reshape(-1, 3)
        return kernels.seen_from_points(self.site.ground.surface, self.sight, self.grid.cells, points)

    def first_seen(self, points_m: FloatArray) -> NDArray[np.int64]:
        """(cells,) number of the first of (k, 3) ENU points that sees each cell, -1 where none does."""
        points = np.ascontiguousarray(points_m, dtype=float).reshape(-1, 3)
        return kernels.first_seen(self.site.ground.surface, self.sight, self.grid.cells, points)

    def share(self, seen: BoolArray) -> float:
        """Share of the area, 0..1, weighted by the ground's surface."""
        return self.grid.share(seen)

    def share_of_coverable(self, seen: BoolArray) -> float:
        """Share of what can be seen at all from inside the limits, 0..1; 0 when nothing can."""
        coverable = float(self.grid.weight_m2[self.coverable].sum())
        return float(self.grid.weight_m2[seen & self.coverable].sum()) / coverable if coverable > 0.0 else 0.0

    @cached_property
    def coverable(self) -> BoolArray:
        """(cells,) whether a cell can be seen from some allowed place.

        Every cell is tried from right above it and from 36 places around it, each at three heights, all inside the fence,
        the height band and the sea-level limits and clear of obstacles. A cell that is found is coverable for certain; one
        that is not found might still be seen from a place that was not tried, so the set is a lower bound.
        """
        limits = self.site.scenario.limits
        middle_agl = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
        reach = max(
            reach_at_height_m(self.site.scenario.sensor, h)
            for h in (limits.min_height_agl_m, middle_agl, limits.max_height_agl_m)
        )
        offsets = [(0.0, 0.0)] + [
            (reach * r * math.cos(a), reach * r * math.sin(a))
            for r in _TRY_RADII
            for a in np.arange(_TRY_DIRECTIONS) * (2.0 * math.pi / _TRY_DIRECTIONS)
        ]
        cells = self.grid.cells
        found = np.zeros(self.grid.count, dtype=bool)
        for de, dn in offsets:
            for share in _TRY_HEIGHTS:
                todo = np.flatnonzero(~found)
                if todo.size == 0:
                    return found
                eyes = self._allowed_places(cells.centre_m[todo, :2] + (de, dn), share)
                found[todo] = sees_each(self, eyes, todo)
        return found

    def _allowed_places(self, east_north_m: FloatArray, share: float) -> FloatArray:
        """(k, 3) places at a share 0..1 of the allowed band above (k, 2) spots; NaN where nothing is allowed."""
        limits = self.site.scenario.limits
        ground = self.site.ground.heights_m(east_north_m)
        low = ground + limits.min_height_agl_m
        high = ground + limits.max_height_agl_m
        # Sea level seen from the local frame: up minus height above sea level, at the place itself.
        sea = ground - self.site.alts_amsl_m(np.column_stack([east_north_m, ground]))
        if limits.min_alt_amsl_m is not None:
            low = np.maximum(low, limits.min_alt_amsl_m + sea)
        if limits.max_alt_amsl_m is not None:
            high = np.minimum(high, limits.max_alt_amsl_m + sea)
        inside = shapely.intersects_xy(self.site.fence, east_north_m[:, 0], east_north_m[:, 1])
        up = np.where((low <= high) & inside, low + share * (high - low), np.nan)
        places = np.column_stack([east_north_m, up])
        too_near = waypoint_breaches(self.site.ground, places, self.site.scenario.obstacles)[:, 1] > 0.0
        places[too_near, 2] = np.nan
        return places


def sees_each(coverage: CoverageMap, eyes_m: FloatArray, cell_numbers: NDArray[np.int64]) -> BoolArray:
    """(k,) whether the sensor at each of (k, 3) places sees the cell of the same row; False where a place is NaN."""
    cells = coverage.grid.cells
    return kernels.sees_each(
        coverage.site.ground.surface, coverage.sight, np.ascontiguousarray(eyes_m),
        cells.centre_m[cell_numbers], cells.normal[cell_numbers],
    )  # fmt: skip
