"""Elevation files, read by rasterio in any format and any CRS. Pixels are used as they are, without resampling."""

import dataclasses
import hashlib
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.errors
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from rasterio.windows import Window

from uavcover.errors import NoElevationError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.grid import GridFrame, positions_on_grid
from uavcover.terrain.frames import (
    DATUMS,
    ELLIPSOID,
    PIXELS,
    Bounds,
    LocalFrame,
    Undulation,
    finish_frame,
    fit_frame,
    node_ups_m,
    refuse_feet_by_guess,
    unit_of_heights_m,
)
from uavcover.terrain.ground import Ground, fill_gaps, grid_ground, ground_of_nodes
from uavcover.terrain.terrain_source import FILES, TerrainSource, as_source, unreadable

_log = logging.getLogger(__name__)

LOWEST_PLAUSIBLE_M, HIGHEST_PLAUSIBLE_M = -500.0, 9000.0


@dataclasses.dataclass(frozen=True, eq=False)
class _Raster:
    """An open, checked file.

    ``full_turn`` is 360 degrees in the unit of its longitudes, 0 if it has none; ``unit_m`` the unit of its heights in metres,
    ``band`` their band; ``undulation`` brings heights above the ellipsoid to sea level, None where they are above it.
    """

    path: TerrainSource
    dataset: Any
    to_source: Transformer
    vertical_datum: str
    full_turn: float
    unit_m: float
    band: int
    undulation: Undulation | None

    def pixels_at(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """(n, 2) column and row, integers at pixel centres, of geodetic positions less than half the Earth apart."""
        x, y = self.to_source.transform(lon_deg, lat_deg)
        # Where a place is outside of what the file's system can express PROJ gives inf, which is no number to reckon with.
        x, y = (np.where(np.isfinite(axis), axis, np.nan) for axis in (np.atleast_1d(x), np.atleast_1d(y)))
        if self.full_turn > 0.0 and x.size:
            # Longitudes are unwrapped from the first position, which is inside the file if possible.
            x = x[0] + np.mod(x - x[0] + 0.5 * self.full_turn, self.full_turn) - 0.5 * self.full_turn
            x += self.full_turn * np.round((float(np.mean(_corners(self.dataset)[0])) - x[0]) / self.full_turn)
        inverse = ~self.dataset.transform
        column = inverse.a * x + inverse.b * y + inverse.c - 0.5
        return np.column_stack([column, inverse.d * x + inverse.e * y + inverse.f - 0.5])

    def positions_of(self, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Latitudes (n,) and longitudes (n,) of (n, 2) columns and rows: the inverse of :meth:`pixels_at`."""
        transform, (column, row) = self.dataset.transform, pixels.T + 0.5
        x = transform.a * column + transform.b * row + transform.c
        y = transform.d * column + transform.e * row + transform.f
        lon, lat = self.to_source.transform(x, y, direction="INVERSE")
        return np.asarray(lat, float), np.asarray(lon, float)

    def sample_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """Heights (n,) at geodetic positions, bilinear between pixel centres; NaN where a pixel has no data."""
        column, row = self.pixels_at(lat_deg, lon_deg).T
        inside = (column >= 0.0) & (row >= 0.0) & (column <= self.dataset.width - 1) & (row <= self.dataset.height - 1)
        out = np.full(column.shape, np.nan)
        if not inside.any():
            return out
        column, row = column[inside], row[inside]
        first_column, first_row = int(column.min()), int(row.min())
        window = Window(
            first_column, first_row,
            min(self.dataset.width, int(column.max()) + 2) - first_column,
            min(self.dataset.height, int(row.max()) + 2) - first_row,
        )  # fmt: skip
        pixels = self.with_water(self.read(window))
        column, row = column - first_column, row - first_row
        j = np.minimum(column.astype(int), max(pixels.shape[1] - 2, 0))
        i = np.minimum(row.astype(int), max(pixels.shape[0] - 2, 0))
        u, v = column - j, row - i
        j1, i1 = np.minimum(j + 1, pixels.shape[1] - 1), np.minimum(i + 1, pixels.shape[0] - 1)
        upper = pixels[i, j] + u * (pixels[i, j1] - pixels[i, j])
        lower = pixels[i1, j] + u * (pixels[i1, j1] - pixels[i1, j])
        out[inside] = upper + v * (lower - upper)
        return out

    def sample_scattered_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """As :meth:`sample_m`, for positions with many pixels between them: never more than ``FILES.most_pixels`` at once."""
        spans = np.ptp(self.pixels_at(lat_deg, lon_deg), axis=0) + 2.0
        half = len(lat_deg) // 2
        if half == 0 or float(np.prod(spans)) <= FILES.most_pixels:
            return self.sample_m(lat_deg, lon_deg)
        parts = [self.sample_scattered_m(lat_deg[part], lon_deg[part]) for part in (slice(half), slice(half, None))]
        return np.concatenate(parts)

    def with_water(self, heights_m: FloatArray) -> FloatArray:
        """Heights (rows, columns) with open water without data, if there is any."""
        water_m = self.path.water_height_m
        return heights_m if water_m is None else np.where(np.isnan(heights_m), water_m, heights_m)

    def read(self, window: Window) -> FloatArray:
        """(rows, columns) heights above sea level, NaN without data; read by strips to save memory."""
        columns, rows = int(window.width), int(window.height)
        step = max(1, FILES.most_pixels // max(columns, 1))
        if rows <= step:
            return self._read_strip(window)
        heights = np.empty((rows, columns))
        for first in range(0, rows, step):
            strip = Window(window.col_off, window.row_off + first, columns, min(step, rows - first))
            heights[first : first + step] = self._read_strip(strip)
        return heights

    def _read_strip(self, window: Window) -> FloatArray:
        with _readable(self.path):
            masked = self.dataset.read(self.band, window=window, masked=True)
        scaled = masked.astype(float) * self.dataset.scales[self.band - 1] + self.dataset.offsets[self.band - 1]
        pixels = np.asarray(scaled.filled(np.nan), dtype=float) * self.unit_m
        pixels[~np.isfinite(pixels)] = np.nan
        if self.undulation is not None:
            rows, columns = np.indices(pixels.shape).reshape(2, -1) + np.array([[window.row_off], [window.col_off]])
            lat_deg, lon_deg = self.positions_of(np.column_stack([columns, rows]).astype(float))
            pixels -= self.undulation.heights_m(lat_deg, lon_deg).reshape(pixels.shape)
        wrong = (pixels < LOWEST_PLAUSIBLE_M) | (pixels > HIGHEST_PLAUSIBLE_M)
        if wrong.any():
            row, column = np.argwhere(wrong)[0] + (window.row_off, window.col_off)
            raise TerrainError(
                f"{self.path}: the height in row {row}, column {column} is {pixels[wrong][0]:g} m; if this value "
                "marks missing data, declare it as the no-data value of the file (gdal_edit.py -a_nodata); "
                'if the heights are in feet or centimetres, set terrain.height_unit (--height-unit) to "ft" or "cm"'
            )
        return pixels


@contextmanager
def _readable(path: TerrainSource) -> Iterator[None]:
    try:
        yield
    except (rasterio.errors.RasterioError, OSError) as error:
        # rasterio reports only that reading failed; its cause has GDAL's reason, such as a missing tile of a VRT.
        said = error.__cause__ if "previous exception" in str(error) and error.__cause__ is not None else error
        reason = str(said).strip().splitlines()[0] if str(said).strip() else type(said).__name__
        raise TerrainError(unreadable(path, path.files[0], reason)) from error


@contextmanager
def open_raster(source: Path | TerrainSource, vertical_datum: str) -> Iterator[_Raster]:
    """Open a file or tiles and check their metadata. Raises TerrainError: they cannot be used."""
    path = as_source(source)
    if vertical_datum not in DATUMS:
        known = f"use {', '.join(DATUMS)}, or convert the file (gdalwarp with -t_srs EPSG:4326+5773)"
        raise TerrainError(f"terrain.vertical_datum: unknown datum {vertical_datum!r}; {known}")
    undulation = Undulation() if vertical_datum == ELLIPSOID else None
    with _readable(path), path.opened() as dataset:
        if dataset.crs is None:
            raise TerrainError(
                f"{path}: the file does not state its coordinate system; specify it with terrain.crs (--dem-crs), "
                "such as EPSG:32632"
            )
        try:
            crs = CRS.from_wkt(dataset.crs.to_wkt())
            horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
            # No ballpark transformations: an inexact datum would silently be off by up to hundreds of metres.
            to_source = Transformer.from_crs(4326, horizontal, always_xy=True, allow_ballpark=False)
        except ProjError as error:
            reason = str(error).strip().splitlines()[0]
            raise TerrainError(
                f"{path}: positions cannot be converted to the file's coordinate reference system ({reason}); assign "
                "a known system, or convert the file (gdalwarp -t_srs EPSG:4326)"
            ) from error
        band = path.band_of(dataset)
        stated, given = dataset.units[band - 1], path.height_unit
        if horizontal.is_projected and not (stated or given or crs.is_compound):
            refuse_feet_by_guess(path, horizontal)
        unit_m = unit_of_heights_m(path, crs, vertical_datum, stated or given)
        if stated and given and abs(unit_of_heights_m(path, crs, vertical_datum, given) / unit_m - 1.0) > 1e-9:
            raise TerrainError(f"{path}: the file states that its heights are in {stated}; remove terrain.height_unit")
        _check_pixel_size(path, horizontal, dataset)
        turn = 2.0 * math.pi / horizontal.axis_info[0].unit_conversion_factor if horizontal.is_geographic else 0.0
        if dataset.count >= 3 and set(dataset.dtypes[:3]) == {"uint8"}:
            raise TerrainError(
                f"{path}: the file is an image ({dataset.count} bands of 8 bits), not elevation data; use a file with heights"
            )
        yield _Raster(path, dataset, to_source, vertical_datum, turn, unit_m, band, undulation)


def _check_pixel_size(path: TerrainSource, crs: CRS, dataset: Any) -> None:
    # A south-up file has a negative height.
    width, height = (abs(side) for side in dataset.res)
    top = float(np.abs(_corners(dataset)[1]).max())
    if crs.is_projected and min(width, height) * crs.axis_info[0].unit_conversion_factor < 0.01:
        raise TerrainError(
            f"{path}: the file has pixels of {width:g} x {height:g} in a projected system ({crs.name}), which seem "
            "to be in degrees instead of metres; assign the correct coordinate reference system (gdal_edit.py "
            "-a_srs EPSG:4326)"
        )
    if crs.is_geographic and (top > 90.5 or width > 10.0):
        raise TerrainError(
            f"{path}: the file reaches latitude {top:g} with pixels of {width:g} degrees, which seem to be in metres "
            "instead of degrees; assign the correct coordinate reference system (gdal_edit.py -a_srs)"
        )


def read_height_amsl_m(path: Path | TerrainSource, vertical_datum: str, *, lat_deg: float, lon_deg: float) -> float:
    """Read the height above sea level of one position from an elevation file, bilinear between its pixels.

    Raises:
        NoElevationError: the file has no data there.
        TerrainError: the file cannot be used.
    """
    with open_raster(path, vertical_datum) as raster:
        height = float(raster.sample_m(np.array([lat_deg]), np.array([lon_deg]))[0])
        if not np.isfinite(height):
            extent = _extent(raster)
            raise NoElevationError(
                f"{path}: there is no elevation data at {lat_deg}, {lon_deg} ({extent})", extent=extent
            )
        return height


def read_heights_amsl_m(
    path: Path | TerrainSource, vertical_datum: str, lat_deg: FloatArray, lon_deg: FloatArray
) -> FloatArray:
    """Heights above sea level (n,) of geodetic positions (n,) within half the Earth; NaN without data.

    Raises:
        TerrainError: the file cannot be used.
    """
    with open_raster(path, vertical_datum) as raster:
        return raster.sample_scattered_m(lat_deg, lon_deg)


def read_ground(
    path: Path | TerrainSource,  # a file that rasterio reads, or several
    vertical_datum: str,  # EGM96 or EGM2008; anything else is refused
    *,
    frame: LocalFrame,  # the local frame
    bounds_m: Bounds,  # west, south, east, north of the ground; beyond the file there is no data
    grid_step_m: float | None,  # spacing of a square grid; None: the file's own pixels
) -> Ground:
    """Read elevation data as a ground in the local frame.

    Its nodes are the pixels of the file, so it is the file's own bilinear surface; the remaining difference is measured and
    kept with it. With ``grid_step_m`` the nodes lie on a square grid instead, each with the file's height there.

    Raises:
        TerrainError: the file cannot be used, has too many pixels there, or cannot be represented in the local frame within
            ``FILES.max_error_m``.
    """
    with open_raster(path, vertical_datum) as raster:
        if grid_step_m is None:
            ground = _ground_of_pixels(raster, frame, bounds_m)
        else:
            ground = _resampled_ground(raster, frame, bounds_m, grid_step_m)
        error_m = measure_error_m(ground, raster, frame, bounds_m)
    if grid_step_m is None and error_m > FILES.max_error_m:
        raise TerrainError(
            f"{path}: in the local frame, the heights are wrong by up to {error_m:.2f} m, but the limit is "
            f"{FILES.max_error_m:g} m; use a smaller area, or convert the file to a projection for this location "
            "(gdalwarp -t_srs, with the UTM zone)"
        )
    return dataclasses.replace(ground, error_m=error_m)


def _ground_of_pixels(raster: _Raster, frame: LocalFrame, bounds_m: Bounds) -> Ground:
    """The pixels inside the bounds, as nodes."""
    try:
        rough = fit_frame(raster.pixels_at, frame, bounds_m, level_up_m=0.0)
    except TerrainError as error:
        raise TerrainError(f"{raster.path}: {error} ({_extent(raster)})") from error
    first, last = _pixels_needed(raster, frame, rough, bounds_m)
    columns, rows = (last - first).tolist()
    if columns * rows > FILES.max_nodes:
        raise TerrainError(
            f"{raster.path}: {columns} x {rows} pixels under the scenario's area exceed the limit of "
            f"{FILES.max_nodes:,}; use a smaller area, or coarser data (gdalwarp -tr)"
        )
    if min(columns, rows) >= 2:
        up = raster.read(Window(first[0], first[1], columns, rows))
        sha256 = _sha256(raster, up)
        up = _filled(raster, up, frame, first)
        up = node_ups_m(lambda pixels: raster.positions_of(pixels + first), frame, up)
    else:
        first, up = np.zeros(2, dtype=np.int64), np.full((2, 2), np.nan)
        sha256 = _sha256(raster, up)
    grid, known = rough, np.isfinite(up)
    if known.any():
        level_up_m = 0.5 * float(np.nanmin(up) + np.nanmax(up))
        grid = fit_frame(lambda lat, lon: raster.pixels_at(lat, lon) - first, frame, bounds_m, level_up_m=level_up_m)
        grid = finish_frame(grid, up)
    return ground_of_nodes(
        up, grid, step_m=1.0 / max(grid.per_column, grid.per_row) if known.any() else math.inf,
        source=f"{raster.path.name} ({_extent(raster)})", vertical_datum=raster.vertical_datum,
        sha256=sha256,
        cut_error_m=2.0 * PIXELS.straight_within_m,
    )  # fmt: skip


def _filled(raster: _Raster, heights_m: FloatArray, frame: LocalFrame, first: NDArray[np.int64]) -> FloatArray:
    """Heights with gaps closed as the scenario requires; report it."""
    heights_m = raster.with_water(heights_m)
    up_to_m = raster.path.fill_no_data_m
    if up_to_m == 0.0 or not np.isnan(heights_m).any():
        return heights_m
    middle = first + 0.5 * np.array(heights_m.shape[::-1])
    lat, lon = raster.positions_of(middle + np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)]))
    positions = frame.enu_from_geodetic(lat, lon, frame.alt_amsl_m)
    height_m, width_m = np.linalg.norm(positions[1:] - positions[0], axis=1).tolist()
    gaps = fill_gaps(heights_m, pixel_m=(height_m, width_m), up_to_m=up_to_m)
    if gaps.count:
        _log.warning(
            "%s: %d gaps without data are interpolated, the largest %.0f m long",
            raster.path,
            gaps.count,
            gaps.largest_m,
        )
    return gaps.heights_m


def _pixels_needed(
    raster: _Raster, frame: LocalFrame, grid: GridFrame, bounds_m: Bounds
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First column and row, and one past the last, of the file's part inside the bounds at any height."""
    west, south, east, north = bounds_m
    ups = np.array([LOWEST_PLAUSIBLE_M, HIGHEST_PLAUSIBLE_M]) - frame.alt_amsl_m
    rim = np.linspace(0.0, 1.0, 33)
    positions = np.array([
        (west + s * (east - west), south + t * (north - south), up)
        for up in ups for s in rim for t in rim if s in (0.0, 1.0) or t in (0.0, 1.0)
    ])  # fmt: skip
    pixels = positions_on_grid(grid, positions)
    size = np.array([raster.dataset.width, raster.dataset.height])
    first = np.clip(np.floor(pixels.min(axis=0)) - 1, 0, size)
    last = np.clip(np.ceil(pixels.max(axis=0)) + 2, 0, size)
    return first.astype(np.int64), np.maximum(first, last).astype(np.int64)


def _resampled_ground(raster: _Raster, frame: LocalFrame, bounds_m: Bounds, step: float) -> Ground:
    """A square grid: each node gets the file's height at the position with the node's east and north."""
    west, south, east, north = bounds_m
    wide, high = (east - west) / step + 3.0, (north - south) / step + 3.0
    if wide * high > FILES.max_nodes:
        raise TerrainError(
            f"terrain.grid_step_m: {wide:.0f} x {high:.0f} nodes of {step:g} m exceed the limit of "
            f"{FILES.max_nodes:,}; set a larger step (in metres) or a smaller area"
        )
    columns = np.arange(np.floor(west / step) - 1, np.ceil(east / step) + 2)
    rows = np.arange(np.floor(south / step) - 1, np.ceil(north / step) + 2)
    e, n = np.meshgrid(columns * step, rows * step)
    up = np.zeros(e.size)
    # East and north of a position depend slightly on its height, by height difference times distance over the Earth's
    # radius. Each iteration reduces the remainder by about distance / radius.
    for _ in range(3):
        known = np.where(np.isfinite(up), up, 0.0)
        lat, lon, _alt = frame.geodetic_from_enu(np.column_stack([e.ravel(), n.ravel(), known]))
        up = frame.enu_from_geodetic(lat, lon, raster.sample_m(lat, lon))[:, 2]
    return grid_ground(
        np.where(np.isfinite(up), up, np.nan).reshape(e.shape),
        east0_m=float(columns[0] * step), north0_m=float(rows[0] * step), step_m=step,
        source=f"{raster.path.name} ({_extent(raster)})", vertical_datum=raster.vertical_datum, sha256=_sha256(raster, up),
    )  # fmt: skip


def _sha256(raster: _Raster, heights_m: FloatArray) -> str:
    """Hash of the heights that were read for a site, and of the files that they were read from.

    Files name others that GDAL does not list, such as the tiles of a virtual raster in a virtual raster; the heights reveal them.
    They are rounded to 0.1 mm, for PROJ's geoid differs by less from machine to machine.
    """
    found = hashlib.sha256(f"{raster.path.sha256()} {heights_m.shape}".encode())
    for row in heights_m:
        found.update(np.where(np.isfinite(row), np.round(row, 4) + 0.0, np.nan).tobytes())
    return found.hexdigest()


def measure_error_m(ground: Ground, raster: _Raster, frame: LocalFrame, bounds_m: Bounds) -> float:
    """Measure the largest difference between a ground and the bilinear surface of its file.

    Positions of the file, on the ground and above it, are transformed to the local frame by pyproj, and their height above
    ground is evaluated there: seeded random positions in random blocks of pixels, half of them next to node lines, where
    the surface bends.
    """
    rng = np.random.default_rng(20_261_114)
    west, south, east, north = bounds_m
    worst = 0.0
    for _ in range(FILES.checked_blocks):
        centre = [[rng.uniform(west, east), rng.uniform(south, north), 0.0]]
        lat, lon, _alt = frame.geodetic_from_enu(centre)
        middle = raster.pixels_at(lat, lon)
        if not np.isfinite(middle).all():
            continue
        pixels = middle + rng.uniform(-0.5, 0.5, (FILES.positions_of_block, 2)) * FILES.pixels_of_block
        beside = rng.random(FILES.positions_of_block) < 0.5
        pixels[beside] = np.round(pixels[beside]) + rng.normal(0.0, 0.01, (int(beside.sum()), 2))
        lat, lon = raster.positions_of(pixels)
        alt = raster.sample_m(lat, lon)
        agl = rng.choice([0.0, FILES.above_m], FILES.positions_of_block)
        positions = frame.enu_from_geodetic(lat, lon, alt + agl)
        e, n = positions[:, 0], positions[:, 1]
        inside = np.isfinite(alt) & (e >= west) & (e <= east) & (n >= south) & (n <= north)
        difference = np.abs(ground.heights_agl_m(positions[inside]) - agl[inside])
        worst = max(worst, float(np.max(difference, initial=0.0, where=np.isfinite(difference))))
    return worst


def _corners(dataset: Any) -> tuple[FloatArray, FloatArray]:
    """The four outer corners (4,), (4,) of a file in its own coordinates, even if rotated or south-up."""
    transform = dataset.transform
    columns = np.array([0.0, dataset.width, 0.0, dataset.width])
    rows = np.array([0.0, 0.0, dataset.height, dataset.height])
    return (
        transform.a * columns + transform.b * rows + transform.c,
        transform.d * columns + transform.e * rows + transform.f,
    )


def _extent(raster: _Raster) -> str:
    lon, lat = raster.to_source.transform(*_corners(raster.dataset), direction="INVERSE")
    return f"the data extends from {min(lat):.4f}, {min(lon):.4f} to {max(lat):.4f}, {max(lon):.4f}"
