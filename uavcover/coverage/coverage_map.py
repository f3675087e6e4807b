"""Coverage of routes and tracks, and what can be covered at all."""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.coverage.cells import CellGrid, make_cells
from uavcover.coverage.level_looks import LevelLooks
from uavcover.coverage.sensors import look_spacing_m, sight_of, turns_with_legs
from uavcover.coverage.trial_places import trial_places
from uavcover.kernels import coverage as kernels
from uavcover.kernels.sight import Sight
from uavcover.site import Site
from uavcover.terrain.clearance import waypoint_breaches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


class CoverageMap:
    """Answers which cells of a site are seen, for one cell size.

    Attributes:
        site: the scenario on its ground.
        grid: its cells.
        sight: its sensor.
    """

    def __init__(self, site: Site, *, cell_size_m: float, cut: Callable[[Site, float], CellGrid] = make_cells) -> None:
        self.site = site
        self.grid: CellGrid = cut(site, cell_size_m)
        self.sight: Sight = sight_of(site.scenario.sensor)

    def looks(self, route_m: FloatArray) -> LevelLooks:
        """From where a sensor on an (n, 3) ENU route looks: its waypoints, or samples along its legs.

        A camera that turns with the legs looks twice from a waypoint between two legs: along the one and along the other.
        """
        route = np.ascontiguousarray(route_m, dtype=float).reshape(-1, 3)
        if self.site.scenario.sensor.sensing == "at-waypoints":
            return LevelLooks.towards_north(route)
        spacing_m = look_spacing_m(self.site.scenario)
        if not turns_with_legs(self.sight):
            return LevelLooks.towards_north(kernels.sample_path(route, spacing_m))
        legs = [kernels.sample_path(np.ascontiguousarray(route[k : k + 2]), spacing_m) for k in range(len(route) - 1)]
        headings = [np.tile(leg[-1, :2] - leg[0, :2], (len(leg), 1)) for leg in legs]
        if not legs:
            return LevelLooks(route, np.zeros((len(route), 2)))
        return LevelLooks(np.vstack(legs), np.vstack(headings))

    def seen(self, route_m: FloatArray) -> BoolArray:
        """(cells,) whether each cell is seen from an (n, 3) ENU route, by the sensing rule of the scenario."""
        return self.seen_by(self.looks(route_m))

    def seen_by(self, looks: LevelLooks) -> BoolArray:
        """(cells,) whether each cell is seen by any of the looks, or by as many as the scenario wants."""
        return self.first_seen(looks) >= 0

    def first_seen(self, looks: LevelLooks) -> NDArray[np.int64]:
        """(cells,) number of the look with which each cell is seen as often as the scenario wants, -1 where it never is."""
        surface, wanted = self.site.ground.surface, self.site.scenario.requirements
        if wanted.look_distance_m is not None:
            return kernels.seen_often(
                surface,
                self.sight,
                self.grid.cells,
                looks.places_m,
                looks.headings,
                wanted.looks,
                wanted.look_distance_m,
            )
        return kernels.first_seen(surface, self.sight, self.grid.cells, looks.places_m, looks.headings)

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

        Every cell is tried from several places around it (:func:`uavcover.coverage.trial_places.trial_places`), all inside the
        fence, the height band and the sea-level limits and clear of obstacles. A cell that is found is coverable for certain;
        one that is not found might still be seen from a place that was not tried, so the set is a lower bound.
        """
        wanted = self.site.scenario.requirements
        apart_m = wanted.look_distance_m or 0.0
        times = np.zeros(self.grid.count, dtype=np.int64)
        counted = np.full((self.grid.count, wanted.looks, 3), np.inf)
        for place in trial_places(self.site.scenario):
            todo = np.flatnonzero(times < wanted.looks)
            if todo.size == 0:
                break
            centres = self.grid.cells.centre_m[todo, :2]
            eyes = self._allowed_places(centres + np.array([place.east_m, place.north_m]), place.band_share)
            looks = LevelLooks(eyes, np.tile([place.heading_e, place.heading_n], (todo.size, 1)))
            if apart_m > 0.0:
                near = (np.linalg.norm(counted[todo] - eyes[:, None], axis=2) < apart_m).any(axis=1)
                eyes[near] = np.nan
            new = todo[sees_each(self, looks, todo, self.sight)]
            counted[new, times[new]] = eyes[np.isin(todo, new)]
            times[new] += 1
        return np.asarray(times == wanted.looks, dtype=bool)

    def _allowed_places(self, east_north_m: FloatArray, share: float) -> FloatArray:
        """(k, 3) places at a share 0..1 of the allowed band above (k, 2) spots; NaN where nothing is allowed."""
        limits = self.site.scenario.limits
        ground = self.site.ground.heights_m(east_north_m)
        low = self.site.ground.ups_m(east_north_m, limits.min_height_agl_m)
        high = self.site.ground.ups_m(east_north_m, limits.max_height_agl_m)
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


def sees_each(coverage: CoverageMap, looks: LevelLooks, cell_numbers: NDArray[np.int64], sight: Sight) -> BoolArray:
    """(k,) whether each of k looks of a sensor sees the cell of the same row; False where a place is NaN."""
    cells = coverage.grid.cells
    return kernels.sees_each(
        coverage.site.ground.surface, sight, np.ascontiguousarray(looks.places_m), looks.headings,
        cells.centre_m[cell_numbers], cells.normal[cell_numbers],
    )  # fmt: skip
