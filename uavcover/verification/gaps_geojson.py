"""``gaps.geojson``: the regions that were not seen, for maps."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import InputError
from uavcover.frames import LocalFrame
from uavcover.verification.gaps import GapRegion


def gaps_geojson(coverage: CoverageMap, regions: Sequence[GapRegion]) -> dict[str, Any]:
    """A FeatureCollection (RFC 7946) with one MultiPolygon for each region, the largest first.

    Raises:
        InputError: the scenario has no place on Earth.
    """
    frame = coverage.site.frame
    if frame is None:
        raise InputError(f"scenario {coverage.site.scenario.name}: has no place on Earth, so its gaps have no GeoJSON")
    row_of, column_of = _places_in_lattice(coverage)
    features = []
    for number, region in enumerate(regions):
        gap = region.gap
        outline = _outline(coverage, row_of[region.cells], column_of[region.cells])
        features.append(
            {
                "type": "Feature",
                "id": number,
                "geometry": _geometry(coverage, frame, outline),
                "properties": {
                    "reason": gap.reason,
                    "coverable": gap.coverable,
                    "cells": gap.cells,
                    "area_m2": gap.area_m2,
                },
            }
        )
    return {"type": "FeatureCollection", "features": features}


def _places_in_lattice(coverage: CoverageMap) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of each cell."""
    lattice = coverage.grid.cells.lattice
    rows, columns = np.nonzero(lattice >= 0)
    row_of, column_of = np.empty(coverage.grid.count, dtype=np.int64), np.empty(coverage.grid.count, dtype=np.int64)
    numbers = lattice[rows, columns]
    row_of[numbers], column_of[numbers] = rows, columns
    return row_of, column_of


def _outline(coverage: CoverageMap, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> shapely.MultiPolygon:
    """Cells as one shape in the local frame: runs of cells in a row as rectangles, united."""
    order = np.lexsort((columns, rows))
    rows, columns = rows[order], columns[order]
    starts = np.flatnonzero(np.append(True, (np.diff(rows) != 0) | (np.diff(columns) != 1)))
    ends = np.append(starts[1:], len(rows)) - 1
    cells = coverage.grid.cells
    west = cells.east0_m + (columns[starts] - 0.5) * cells.size_m
    east = cells.east0_m + (columns[ends] + 0.5) * cells.size_m
    south = cells.north0_m + (rows[starts] - 0.5) * cells.size_m
    united = shapely.union_all(shapely.box(west, south, east, south + cells.size_m))
    return shapely.MultiPolygon(list(shapely.get_parts(united)))


def _geometry(coverage: CoverageMap, frame: LocalFrame, outline: shapely.MultiPolygon) -> dict[str, Any]:
    """The shape in longitudes and latitudes, outer rings counter-clockwise; corners lie on the ground."""
    ground = coverage.site.ground
    level = float(np.mean(coverage.grid.cells.centre_m[:, 2]))

    def to_lon_lat(places_m: NDArray[np.float64]) -> NDArray[np.float64]:
        heights = ground.heights_m(places_m)
        # A corner may stand just outside the elevation data; a few metres of height move it by micrometres.
        heights = np.where(np.isfinite(heights), heights, level)
        lat, lon, _ = frame.geodetic_from_enu(np.column_stack([places_m, heights]))
        return np.column_stack([lon, lat])

    shape = shapely.orient_polygons(shapely.transform(outline, to_lon_lat))
    document: dict[str, Any] = shapely.geometry.mapping(shape)
    return document
