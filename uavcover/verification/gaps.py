"""Coverage gaps: cells not seen, grouped into connected regions with reasons, and written to ``gaps.geojson``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import rasterio
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from rasterio.io import MemoryFile

from uavcover.errors import InputError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import NOT_IN_RANGE, OBSERVED, OCCLUDED, TOO_COARSE, TOO_OBLIQUE
from uavcover.model.verdict import Gap, GapReason
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.flown_coverage import FlownCoverage

# Rasters of the local frame as GeoTIFF, by rasterio.


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """One layer."""

    name: str  # description of the band
    unit: str  # of its values, or what they stand for
    values: FloatArray  # (rows, columns), rows going north, NaN without one


def cells_geotiff(coverage: CoverageMap, frame: LocalFrame, layers: Sequence[tuple[str, str, NDArray[Any]]]) -> bytes:
    """A GeoTIFF of the results for each cell of a map.

    Args:
        coverage: the cells.
        frame: of its site.
        layers: name, unit and (cells,) values of each band.
    """
    cells = coverage.grid.cells
    inside = cells.lattice >= 0

    def on_lattice(values: NDArray[Any]) -> FloatArray:
        out = np.full(cells.lattice.shape, np.nan)
        out[inside] = values[cells.lattice[inside]]
        return out

    return geotiff(
        frame,
        [Band(name, unit, on_lattice(values)) for name, unit, values in layers],
        east0_m=cells.east0_m,
        north0_m=cells.north0_m,
        up_m=float(cells.centre_m[:, 2].mean()),
        step_m=cells.size_m,
    )


def geotiff(
    frame: LocalFrame, bands: Sequence[Band], *, east0_m: float, north0_m: float, up_m: float, step_m: float
) -> bytes:
    """A GeoTIFF (float32, NaN is no data) of square cells in the local frame, north up.

    It is in the azimuthal equidistant projection about the frame's origin. That map lies on the ellipsoid and the frame does
    not: its axes are fitted through three corners of the raster at the height of the ground, which leaves millimetres to
    centimetres over ten kilometres.

    Args:
        frame: the local frame.
        bands: of equal shape, at least one.
        east0_m: east of the centre of column 0.
        north0_m: north of the centre of row 0.
        up_m: height of the ground in the frame, for the fit.
        step_m: side of a cell.
    """
    rows, columns = bands[0].values.shape
    crs = CRS.from_proj4(f"+proj=aeqd +lat_0={frame.lat_deg!r} +lon_0={frame.lon_deg!r} +datum=WGS84 +units=m")
    west, south = east0_m - 0.5 * step_m, north0_m - 0.5 * step_m
    east, north = west + columns * step_m, south + rows * step_m
    lat, lon, _ = frame.geodetic_from_enu(np.array([[west, north, up_m], [east, north, up_m], [west, south, up_m]]))
    x, y = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(lon, lat)
    transform = rasterio.Affine(
        (x[1] - x[0]) / columns, (x[2] - x[0]) / rows, x[0], (y[1] - y[0]) / columns, (y[2] - y[0]) / rows, y[0]
    )
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff", width=columns, height=rows, count=len(bands), dtype="float32", nodata=math.nan,
            crs=rasterio.crs.CRS.from_wkt(crs.to_wkt("WKT1_GDAL")), transform=transform, compress="deflate", predictor=3,
        ) as raster:  # fmt: skip
            for number, band in enumerate(bands, start=1):
                raster.write(band.values[::-1].astype(np.float32), number)
                raster.set_band_description(number, band.name)
                raster.update_tags(number, unit=band.unit)
        return bytes(memory.read())


REASONS: tuple[GapReason, ...] = get_args(GapReason)
"""In the order of their numbers in ``coverage.tif``."""
_OUTCOMES: dict[int, GapReason] = {
    NOT_IN_RANGE: "never-in-range",
    TOO_OBLIQUE: "too-oblique",
    OCCLUDED: "occluded",
    TOO_COARSE: "too-coarse",
    OBSERVED: "too-few-looks",
}


@dataclass(frozen=True, slots=True, eq=False)
class GapRegion:
    """A gap and its cells."""

    gap: Gap  # its description in the report
    cells: NDArray[np.int64]  # (k,) numbers of its cells


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
    missing = ~flown.observed
    for outcome, reason in _OUTCOMES.items():
        codes[missing & (flown.outcome == outcome)] = 1 + REASONS.index(reason)
    codes[missing & flown.possible_by_attitude] = 1 + REASONS.index("attitude-not-known")
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
            f"scenario {coverage.site.scenario.name} has no position on Earth, so the gaps cannot be written as "
            "GeoJSON; add an [origin]"
        )
    features = []
    for number, region in enumerate(regions):
        geometry = _geometry(coverage, frame, cells_outline(coverage, region.cells))
        properties = {name: getattr(region.gap, name) for name in ("reason", "coverable", "cells", "area_m2")}
        features.append({"type": "Feature", "id": number, "geometry": geometry, "properties": properties})
    return {"type": "FeatureCollection", "features": features}


def _positions_in_lattice(coverage: CoverageMap) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of each cell."""
    lattice = coverage.grid.cells.lattice
    rows, columns = np.nonzero(lattice >= 0)
    row_of, column_of = np.empty(coverage.grid.count, dtype=np.int64), np.empty(coverage.grid.count, dtype=np.int64)
    numbers = lattice[rows, columns]
    row_of[numbers], column_of[numbers] = rows, columns
    return row_of, column_of


def cells_outline(coverage: CoverageMap, chosen: NDArray[np.int64]) -> shapely.MultiPolygon:
    """Union of cells as one shape in the local frame, built from one rectangle per run of cells in a row."""
    row_of, column_of = _positions_in_lattice(coverage)
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
    found: shapely.MultiPolygon = shapely.transform(outline, lambda positions: corner + cells.size_m * positions)
    return found


def _geometry(coverage: CoverageMap, frame: LocalFrame, outline: shapely.MultiPolygon) -> dict[str, Any]:
    """The shape in longitude and latitude, outer rings counter-clockwise, corners on the ground."""
    ground = coverage.site.ground
    level = float(np.mean(coverage.grid.cells.centre_m[:, 2]))

    def to_lon_lat(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
        heights = ground.heights_m(positions_m)
        # a corner may lie just outside the elevation data; a few metres of height shift it by micrometres.
        heights = np.where(np.isfinite(heights), heights, level)
        lat, lon, _ = frame.geodetic_from_enu(np.column_stack([positions_m, heights]))
        return np.column_stack([lon, lat])

    shape = shapely.orient_polygons(shapely.transform(outline, to_lon_lat))
    document: dict[str, Any] = shapely.geometry.mapping(shape)
    return document
