"""Cells that no planner has seen: by them, routes of different planners are compared."""

import dataclasses
from functools import cached_property
from typing import cast

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.sight import MIDPOINT, RAY
from uavcover.site import Site

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_SAME_PLACE = 1e-6


class HoldOut:
    """Coverage on cells of half the area's cell size, the whole lattice shifted by half of such a cell.

    A cell whose centre is also the centre of a cell of the area or of the planner does not count: a route may have been
    made to see just that place. Lines of sight are exact rays, whatever the scenario plans with.

    Attributes:
        coverage: the map on these cells.
        held_out: (cells,) whether a cell counts.
    """

    def __init__(self, site: Site) -> None:
        west, south, east, north = site.area.bounds
        scenario = site.scenario
        cell_m = 0.5 * scenario.area.cell_size_m
        inner = shapely.intersection(site.area, shapely.box(west + 0.5 * cell_m, south + 0.5 * cell_m, east, north))
        area = cast("shapely.Polygon | shapely.MultiPolygon", inner)
        self.coverage = CoverageMap(dataclasses.replace(site, area=area), cell_size_m=cell_m)
        if self.coverage.sight.line_of_sight == MIDPOINT:
            self.coverage.sight = self.coverage.sight._replace(line_of_sight=RAY)
        centres = self.coverage.grid.cells.centre_m[:, :2] - (west, south)
        sizes = (scenario.area.cell_size_m, scenario.planning_cell_size_m)
        self.held_out: BoolArray = ~np.logical_or.reduce([_is_centre(centres, size) for size in sizes])

    def coverage_fraction(self, route_m: FloatArray) -> float:
        """Share of the area that an (n, 3) ENU route sees, 0..1, weighted by the ground's surface."""
        return self._share(self.coverage.seen(route_m), self.held_out)

    def coverage_of_coverable(self, route_m: FloatArray) -> float:
        """Share of what can be seen at all from inside the limits that an (n, 3) ENU route sees, 0..1."""
        return self._share(self.coverage.seen(route_m), self._coverable)

    @cached_property
    def _coverable(self) -> BoolArray:
        return self.held_out & self.coverage.coverable

    def _share(self, seen: BoolArray, among: BoolArray) -> float:
        weight_m2 = self.coverage.grid.weight_m2
        whole = float(weight_m2[among].sum())
        return float(weight_m2[among & seen].sum()) / whole if whole > 0.0 else 0.0


def _is_centre(places_m: FloatArray, cell_m: float) -> BoolArray:
    """(n,) whether (n, 2) places, counted from the lattice's corner, are centres of its cells."""
    at = places_m / cell_m - 0.5
    return np.asarray((np.abs(at - np.round(at)) < _SAME_PLACE).all(axis=1))
