"""Raster tiles of the user's own files: heights, and a background map."""

import io
import math
import sqlite3
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import contourpy
import numpy as np
import rasterio
from PIL import Image
from rasterio.enums import Resampling
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds

from uavcover.errors import InputError
from uavcover.extras.app.scene import Scene
from uavcover.kernels.arrays import FloatArray
from uavcover.terrain.terrain_source import TerrainSource

TILE = 256
MAX_ZOOM, _LEAST_ZOOM = 17, 8
_HALF_M = math.pi * 6378137.0
"""Half the width of the Web Mercator plane (EPSG:3857), metres."""
_WEB_MERCATOR = "EPSG:3857"
_GDAL = threading.Lock()
"""A dataset is used by one thread at a time."""
_MOST_SOURCE_PIXELS = 1 << 26
"""A tile that would be made of more pixels of its file stays empty, so that the other tiles do not wait; zoom in."""
_MOST_TILE_BYTES, _MBTILES_S, _STEPS = 4 << 20, 2.0, 10_000
"""Limits of an MBTiles file, which may be anything: size and time of a tile; how often the time is looked at."""
_CONTOUR_NODES = 300
_CONTOURS = 14
"""About this many contour lines between the lowest and the highest ground."""


def tile_bounds_m(zoom: int, column: int, row: int) -> tuple[float, float, float, float]:
    """West, south, east, north of a tile in metres of Web Mercator. Raises InputError: no such tile."""
    if not (0 <= zoom <= 22 and 0 <= column < 2**zoom and 0 <= row < 2**zoom):
        raise InputError(f"the map has no tile {zoom}/{column}/{row}")
    size = 2.0 * _HALF_M / 2**zoom
    west, north = column * size - _HALF_M, _HALF_M - row * size
    return west, north - size, west + size, north


def lon_lat_of_pixels(zoom: int, column: int, row: int) -> FloatArray:
    """(TILE * TILE, 2) longitude and latitude of the centres of a tile's pixels, rows from the north."""
    west, _, east, north = tile_bounds_m(zoom, column, row)
    step = (east - west) / TILE
    x = west + step * (np.arange(TILE) + 0.5)
    y = north - step * (np.arange(TILE) + 0.5)
    grid_x, grid_y = np.meshgrid(x, y)
    lat = np.degrees(2.0 * np.arctan(np.exp(grid_y / 6378137.0)) - math.pi / 2.0)
    return np.column_stack([np.degrees(grid_x / 6378137.0).ravel(), lat.ravel()])


def height_tile(source: TerrainSource | Scene, zoom: int, column: int, row: int) -> bytes:
    """A PNG of heights in the Terrarium encoding, height = 256 R + G + B / 256 - 32768 m.

    Where there is no data, the lowest height of the tile stands, so that no cliff is drawn around it.
    """
    tile = (zoom, column, row)
    heights = _ground_heights(source, *tile) if isinstance(source, Scene) else _warped(source, *tile)
    known = np.isfinite(heights)
    heights = np.where(known, heights, float(heights[known].min()) if known.any() else 0.0)
    return _png(terrarium(heights))


def finest_zoom(source: TerrainSource | Scene) -> int:
    """The zoom at which a pixel of a tile is about one of the elevation data; finer tiles would show facets, not ground."""
    if isinstance(source, Scene):
        return MAX_ZOOM
    with _GDAL, source.opened() as dataset, WarpedVRT(dataset, crs=_WEB_MERCATOR) as warped:
        pixel_m = abs(warped.transform.a)
    return int(np.clip(round(math.log2(2.0 * _HALF_M / (TILE * pixel_m))), _LEAST_ZOOM, MAX_ZOOM))


def terrarium(heights_m: FloatArray) -> Any:
    """(h, w, 3) bytes of (h, w) heights, to 1/256 m."""
    number = np.round((heights_m + 32768.0) * 256.0).astype(np.int64)
    return np.stack([number >> 16 & 255, number >> 8 & 255, number & 255], axis=-1).astype(np.uint8)


def _ground_heights(scene: Scene, zoom: int, column: int, row: int) -> FloatArray:
    positions = scene.east_north(lon_lat_of_pixels(zoom, column, row))
    return np.asarray(scene.site.ground.heights_m(positions).reshape(TILE, TILE) + scene.site.alt_amsl_offset_m)


def _warped(source: TerrainSource, zoom: int, column: int, row: int) -> FloatArray:
    with _GDAL, source.opened() as dataset:
        band = source.band_of(dataset)
        if _is_too_fine(dataset, zoom, column, row):
            return np.full((TILE, TILE), np.nan)
        data = _read(dataset, [band], zoom, column, row, dtype="float32")
        scale, offset = dataset.scales[band - 1], dataset.offsets[band - 1]
    values = np.where(np.ma.getmaskarray(data[0]), np.nan, data[0].data.astype(float))
    return np.asarray(values * scale + offset)


def _read(dataset: Any, bands: list[int], zoom: int, column: int, row: int, *, dtype: str | None = None) -> Any:
    west, _, east, north = tile_bounds_m(zoom, column, row)
    step = (east - west) / TILE
    has_no_data = any("nodata" in flag.name for flag in dataset.mask_flag_enums[0])
    with WarpedVRT(
        dataset, crs=_WEB_MERCATOR, transform=rasterio.Affine(step, 0.0, west, 0.0, -step, north), width=TILE, height=TILE,
        resampling=Resampling.bilinear, dtype=dtype, add_alpha=not has_no_data and dataset.count >= 3,
    ) as warped:  # fmt: skip
        return warped.read(bands, masked=True)


def _is_too_fine(dataset: Any, zoom: int, column: int, row: int) -> bool:
    """Whether a tile takes seconds, because it covers too many pixels of a file or of its coarsest overview."""
    try:
        bounds = transform_bounds(_WEB_MERCATOR, dataset.crs, *tile_bounds_m(zoom, column, row))
    except (rasterio.errors.RasterioError, ValueError):
        return True
    (west, south, east, north), own = bounds, dataset.bounds
    inside = max(0.0, min(east, own.right) - max(west, own.left)) * max(
        0.0, min(north, own.top) - max(south, own.bottom)
    )
    fraction = inside / max(abs((own.right - own.left) * (own.top - own.bottom)), 1e-300)
    coarser = max([1, *dataset.overviews(1)])
    return bool(fraction * dataset.width * dataset.height / coarser**2 > _MOST_SOURCE_PIXELS)


def background_tile(path: Path, zoom: int, column: int, row: int) -> tuple[bytes, str] | None:
    """A tile of a GeoTIFF or MBTiles file with its media type; None without content."""
    tile_bounds_m(zoom, column, row)
    if path.suffix.lower() == ".mbtiles":
        return _mbtiles(path, zoom, column, row)
    try:
        with _GDAL, rasterio.open(path) as dataset:
            bands = [1, 2, 3] if dataset.count >= 3 else [1]
            if _is_too_fine(dataset, zoom, column, row):
                return None
            data = _read(dataset, bands, zoom, column, row)
    except rasterio.errors.RasterioError as error:
        raise InputError(f"{path.name}: cannot show this raster ({error}); use a GeoTIFF or MBTiles") from error
    known = ~np.ma.getmaskarray(data).any(axis=0)
    if not known.any():
        return None
    colors = data.data if len(bands) == 3 else np.repeat(data.data, 3, axis=0)
    if colors.dtype != np.uint8:
        low, high = float(colors[:, known].min()), float(colors[:, known].max())
        colors = np.clip((colors - low) * (255.0 / max(high - low, 1e-9)), 0, 255)
    rgba = np.dstack([*colors.astype(np.uint8), np.where(known, 255, 0).astype(np.uint8)])
    return _png(rgba), "image/png"


def _mbtiles(path: Path, zoom: int, column: int, row: int) -> tuple[bytes, str] | None:
    """Rows of MBTiles count from the south."""
    try:
        connection = sqlite3.connect(f"file:{path.as_posix()}?mode=ro", uri=True)
        try:
            end_s = time.monotonic() + _MBTILES_S
            connection.set_progress_handler(lambda: time.monotonic() > end_s, _STEPS)
            found = connection.execute(
                "select tile_data from tiles where zoom_level = ? and tile_column = ? and tile_row = ? "
                "and typeof(tile_data) = 'blob' and length(tile_data) <= ?",
                (zoom, column, 2**zoom - 1 - row, _MOST_TILE_BYTES),
            ).fetchone()
        finally:
            connection.close()
    except sqlite3.Error as error:
        raise InputError(f"{path.name}: cannot read this file as MBTiles ({error})") from error
    if found is None:
        return None
    data = bytes(found[0])
    kinds = ((b"\x89PNG", "image/png"), (b"\xff\xd8", "image/jpeg"), (b"RIFF", "image/webp"))
    return next(((data, kind) for begin, kind in kinds if data.startswith(begin)), None)


def contours(scene: Scene) -> list[dict[str, Any]]:
    """Contour lines of the ground around the area at round heights above sea level, in longitude and latitude."""
    west, south, east, north = scene.site.fence.bounds
    x, y = np.linspace(west, east, _CONTOUR_NODES), np.linspace(south, north, _CONTOUR_NODES)
    grid = np.column_stack([each.ravel() for each in np.meshgrid(x, y)])
    up = scene.site.ground.heights_m(grid).reshape(_CONTOUR_NODES, _CONTOUR_NODES) + scene.site.alt_amsl_offset_m
    known = up[np.isfinite(up)]
    if known.size == 0 or known.max() - known.min() < 1e-6:
        return []
    step = _round_step((known.max() - known.min()) / _CONTOURS)
    lines = contourpy.contour_generator(x, y, np.ma.masked_invalid(up), name="serial")
    found = []
    for number in range(math.ceil(known.min() / step), math.floor(known.max() / step) + 1):
        for line in lines.lines(number * step):
            shape: Callable[[Any], Any] = scene.lon_lat
            found.append(
                {"height": round(number * step, 6), "major": number % 5 == 0, "line": shape(np.asarray(line)).tolist()}
            )
    return found


def _round_step(least: float) -> float:
    """1, 2, 2.5 or 5 times a power of ten, at least so large."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= least)


def _png(pixels: Any) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG", compress_level=1)
    return out.getvalue()
