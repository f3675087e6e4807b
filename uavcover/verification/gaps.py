"""Coverage gaps: cells not seen, grouped into connected regions with reasons, and written to ``gaps.geojson``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.errors import InputError
from uavcover.kernels.arrays import BoolArray
from uavcover.kernels.sight import NOT_IN_RANGE, OCCLUDED, SEEN, TOO_COARSE, TOO_OBLIQUE
from uavcover.model.verdict import Gap, GapReason
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.flown_coverage import FlownCoverage

REASONS: tuple[GapReason, ...] = get_args(GapReason)
"""In the order of their numbers in ``coverage.tif``."""
_OUTCOMES: dict[int, GapReason] = {
    NOT_IN_RANGE: "never-in-range",
    TOO_OBLIQUE: "too-oblique",
    OCCLUDED: "occluded",
    TOO_COARSE: "too-coarse",
    SEEN: "too-few-looks",
}


@dataclass(frozen=True, slots=True, eq=False)
class GapRegion:
    """A gap and its cells.

    Attributes:
        gap: its description in the report.
        cells: (k,) numbers of its cells.
    """

    gap: Gap
    cells: NDArray[np.int64]


def find_gaps(coverage: CoverageMap, flown: FlownCoverage) -> list[GapRegion]:
    """Find regions of cells unseen for the same reason, connected by side or corner, largest first."""
    codes = reason_codes(coverage, flown)
    regions = [
        region for code, reason in enumerate(REASONS, start=1) for region in _regions(coverage, codes == code, reason)
    ]
    return sorted(regions, key=lambda region: -region.gap.area_m2)


def reason_codes(coverage: CoverageMap, flown: FlownCoverage) -> NDArray[np.uint8]:
    """(cells,) 0 where a cell was seen, otherwise the number of its reason in REASONS, from 1."""
    codes = np.zeros(coverage.grid.count, dtype=np.uint8)
    missing = ~flown.seen
    for outcome, reason in _OUTCOMES.items():
        codes[missing & (flown.outcome == outcome)] = 1 + REASONS.index(reason)
    codes[missing & flown.possibly_by_attitude] = 1 + REASONS.index("attitude-not-known")
    # Assigned last: a cell that cannot be seen at all was also never in range, or always too oblique.
    codes[missing & ~coverage.coverable] = 1 + REASONS.index("out-of-limits")
    return codes


def _regions(coverage: CoverageMap, missing: BoolArray, reason: GapReason) -> list[GapRegion]:
    if not missing.any():
        return []
    # Importing scipy.ndimage takes most of a second; commands that judge nothing do not need it.
    from scipy import ndimage

    cells, weight = coverage.grid.cells, coverage.grid.weight_m2
    inside = cells.lattice >= 0
    lattice = np.zeros(cells.lattice.shape, dtype=bool)
    lattice[inside] = missing[cells.lattice[inside]]
    labels, count = ndimage.label(lattice, structure=np.ones((3, 3)))
    label_of_cell = np.zeros(coverage.grid.count, dtype=np.int64)
    label_of_cell[cells.lattice[inside]] = labels[inside]
    members = np.flatnonzero(label_of_cell)
    members = members[np.argsort(label_of_cell[members], kind="stable")]
    groups = np.split(members, np.flatnonzero(np.diff(label_of_cell[members])) + 1)
    middles = np.array([np.average(cells.centre_m[group], axis=0, weights=weight[group]) for group in groups])
    lat, lon = np.full(count, np.nan), np.full(count, np.nan)
    if coverage.site.frame is not None:
        lat, lon, _ = coverage.site.frame.geodetic_from_enu(middles)
    return [
        GapRegion(
            Gap(
                cells=len(group), area_m2=float(weight[group].sum()), lat_deg=float(lat[k]), lon_deg=float(lon[k]),
                east_m=float(middles[k, 0]), north_m=float(middles[k, 1]), reason=reason,
                coverable=reason != "out-of-limits",
            ),
            group,
        )
        for k, group in enumerate(groups)
    ]  # fmt: skip


def gaps_geojson(coverage: CoverageMap, regions: Sequence[GapRegion]) -> dict[str, Any]:
    """A FeatureCollection (RFC 7946) with one MultiPolygon for each region, the largest first.

    Raises:
        InputError: the scenario has no position on Earth.
    """
    frame = coverage.site.frame
    if frame is None:
        raise InputError(
            f"scenario {coverage.site.scenario.name} has no position on Earth, so its gaps cannot be written as GeoJSON"
        )
    features = []
    for number, region in enumerate(regions):
        gap = region.gap
        outline = cells_outline(coverage, region.cells)
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


def cells_outline(coverage: CoverageMap, chosen: NDArray[np.int64]) -> shapely.MultiPolygon:
    """Union of cells as one shape in the local frame, built from one rectangle per run of cells in a row."""
    row_of, column_of = _places_in_lattice(coverage)
    rows, columns = row_of[chosen], column_of[chosen]
    order = np.lexsort((columns, rows))
    rows, columns = rows[order], columns[order]
    starts = np.flatnonzero(np.append(True, (np.diff(rows) != 0) | (np.diff(columns) != 1)))
    ends = np.append(starts[1:], len(rows)) - 1
    # In whole rows and columns: metres are rounded, and rectangles that overlap by a rounding make an invalid outline.
    united = shapely.union_all(shapely.box(columns[starts], rows[starts], columns[ends] + 1, rows[starts] + 1))
    cells = coverage.grid.cells
    corner = np.array([cells.east0_m, cells.north0_m]) - 0.5 * cells.size_m
    outline = shapely.MultiPolygon(list(shapely.get_parts(united)))
    found: shapely.MultiPolygon = shapely.transform(outline, lambda places: corner + cells.size_m * places)
    return found


def _geometry(coverage: CoverageMap, frame: LocalFrame, outline: shapely.MultiPolygon) -> dict[str, Any]:
    """The shape in longitude and latitude, outer rings counter-clockwise, corners on the ground."""
    ground = coverage.site.ground
    level = float(np.mean(coverage.grid.cells.centre_m[:, 2]))

    def to_lon_lat(places_m: NDArray[np.float64]) -> NDArray[np.float64]:
        heights = ground.heights_m(places_m)
        # A corner may lie just outside the elevation data; a few metres of height shift it by micrometres.
        heights = np.where(np.isfinite(heights), heights, level)
        lat, lon, _ = frame.geodetic_from_enu(np.column_stack([places_m, heights]))
        return np.column_stack([lon, lat])

    shape = shapely.orient_polygons(shapely.transform(outline, to_lon_lat))
    document: dict[str, Any] = shapely.geometry.mapping(shape)
    return document
