"""A user's map behind the report's map.

A GeoTIFF or MBTiles file is cut to the frame and warped.

Nothing is fetched: the file is read by its own format's reader alone, so that no file can point anywhere else.
"""

import html
import io
import math
import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import rasterio
import rasterio.errors
from PIL import Image
from pyproj import Transformer
from pyproj.exceptions import ProjError
from rasterio.enums import ColorInterp, Resampling
from rasterio.windows import Window
from scipy.ndimage import map_coordinates

from mission_io.data_tables import data_table
from uavcover.errors import InputError
from uavcover.kernels.arrays import ByteArray, FloatArray
from uavcover.report.map_data import data_uri
from uavcover.scenario.site import Site
from uavcover.terrain.frames import Bounds

_TILE_PIXELS = (64, 2048)
_SQLITE = b"SQLite format 3\0"
_MERCATOR_HALF_M = 20037508.342789244


@dataclass(frozen=True, slots=True, kw_only=True)
class _Background:
    pixels: int
    quality: int
    nodes: int
    most_tiles: int


BACKGROUND = data_table(_Background, "uavcover/data/report.toml", "background")


@dataclass(frozen=True, slots=True)
class Background:
    """A picture for the map."""

    image: str  # data URI; covers the requested bounds, transparent where the file has nothing
    attribution: str  # what the file says of its makers, as text; empty where it says nothing
    name: str  # of the file


@dataclass(frozen=True, slots=True, eq=False)
class _Image:
    """Pixels of a file, and where positions of the file are in them."""

    rgba: ByteArray  # (rows, columns, 4) bytes
    attribution: str  # as in Background
    column: FloatArray  # (n, n) of the lattice's nodes, in pixels from the left side
    row: FloatArray  # (n, n) in pixels from the top


def read_background(path: Path, site: Site, bounds_m: Bounds) -> Background:
    """Cut a map file to a rectangle of the local frame.

    Args:
        path: a GeoTIFF with 8 bits a band (grey, colours or a palette) in any coordinate system, or MBTiles with pictures.
        site: has the frame.
        bounds_m: west, south, east, north.

    Raises:
        InputError: the file cannot be used, and why.
    """
    if site.frame is None:
        raise InputError("--background: the scenario has no position on Earth; omit this option")
    if not path.is_file():
        raise InputError(f"--background: {path}: no such file; use a GeoTIFF or MBTiles file")
    west, south, east, north = bounds_m
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, BACKGROUND.nodes), np.linspace(north, south, BACKGROUND.nodes))
    middle_up = float(np.nan_to_num(site.ground.heights_m(np.array([[(west + east) / 2.0, (south + north) / 2.0]]))[0]))
    positions = np.column_stack([grid_e.ravel(), grid_n.ravel(), np.full(grid_e.size, middle_up)])
    lat, lon, _ = (values.reshape(grid_e.shape) for values in site.frame.geodetic_from_enu(positions))
    longer = max(east - west, north - south)
    size = (
        max(1, round(BACKGROUND.pixels * (east - west) / longer)),
        max(1, round(BACKGROUND.pixels * (north - south) / longer)),
    )
    try:
        with path.open("rb") as file:
            is_sqlite = file.read(len(_SQLITE)) == _SQLITE
        image = (_of_mbtiles if is_sqlite else _of_geotiff)(path, lat, lon, size)
    except (rasterio.errors.RasterioError, ProjError, sqlite3.Error, OSError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"--background: {path}: cannot read the file as GeoTIFF or MBTiles ({reason}); export the map again in "
            "one of these formats"
        ) from error
    warped = _warped(image, size)
    if not warped[..., 3].any():
        raise InputError(
            f"--background: {path}: the file does not cover the map around latitude {lat.mean():.5f}, longitude "
            f"{lon.mean():.5f}; use a file of this location"
        )
    return Background(data_uri(warped, "WEBP", quality=BACKGROUND.quality), image.attribution, path.name)


def _warped(image: _Image, size: tuple[int, int]) -> ByteArray:
    """The pixels of a picture at the middles of (columns, rows) pixels of the rectangle."""
    columns, rows = size
    grid = np.meshgrid(
        (np.arange(rows) + 0.5) / rows * (BACKGROUND.nodes - 1),
        (np.arange(columns) + 0.5) / columns * (BACKGROUND.nodes - 1),
        indexing="ij",
    )
    at = [map_coordinates(nodes, grid, order=1) - 0.5 for nodes in (image.row, image.column)]
    height, width = image.rgba.shape[:2]
    inside = (at[0] >= -0.5) & (at[0] <= height - 0.5) & (at[1] >= -0.5) & (at[1] <= width - 0.5)
    out = np.zeros((rows, columns, 4), dtype=np.uint8)
    # Of what is transparent no colour is mixed in.
    order: Literal[0, 1] = 1 if image.rgba[..., 3].all() else 0
    for band in range(4):
        values = map_coordinates(image.rgba[..., band].astype(np.float32), at, order=order, mode="nearest")
        out[..., band] = np.where(inside, np.rint(values), 0.0).astype(np.uint8)
    return out


def _of_geotiff(path: Path, lat: FloatArray, lon: FloatArray, size: tuple[int, int]) -> _Image:
    # No other driver: a VRT, for one, may name files on the network.
    with rasterio.open(path.resolve(), driver="GTiff") as dataset:
        if dataset.crs is None:
            raise InputError(f"--background: {path}: the file has no coordinate system; save it with a system")
        if any(kind != "uint8" for kind in dataset.dtypes):
            raise InputError(
                f"--background: {path}: the file's bands are {', '.join(sorted(set(dataset.dtypes)))}, not 8 bits; "
                "convert the file with: gdal_translate -ot Byte -scale IN OUT"
            )
        to_file = Transformer.from_crs(4326, dataset.crs.to_wkt(), always_xy=True)
        column, row = _finite(_pixels(dataset, to_file, lat, lon))
        left, top = max(0, math.floor(column.min()) - 2), max(0, math.floor(row.min()) - 2)
        right, bottom = min(dataset.width, math.ceil(column.max()) + 2), min(dataset.height, math.ceil(row.max()) + 2)
        if right <= left or bottom <= top:
            return _Image(np.zeros((1, 1, 4), np.uint8), "", np.zeros_like(column), np.zeros_like(row))
        # No finer than the picture in the page.
        finer = max(1.0, min((right - left) / size[0], (bottom - top) / size[1]))
        shape = max(1, round((bottom - top) / finer)), max(1, round((right - left) / finer))
        rgba = _rgba(dataset, Window(left, top, right - left, bottom - top), shape)
        tags = {name.upper(): value for name, value in dataset.tags().items()}
        attribution = next((tags[k] for k in ("ATTRIBUTION", "TIFFTAG_COPYRIGHT", "COPYRIGHT") if tags.get(k)), "")
    scale_x, scale_y = shape[1] / (right - left), shape[0] / (bottom - top)
    return _Image(rgba, _text(attribution), (column - left) * scale_x, (row - top) * scale_y)


def _rgba(dataset: rasterio.DatasetReader, window: Window, shape: tuple[int, int]) -> ByteArray:
    """Bands of a window as red, green, blue and how much is there."""
    palette = dataset.count >= 1 and dataset.colorinterp[0] == ColorInterp.palette
    resampling = Resampling.nearest if palette else Resampling.average
    read = {"window": window, "out_shape": shape}
    opaque = dataset.dataset_mask(**read)
    if palette:
        table = np.zeros((256, 4), dtype=np.uint8)
        for index, color in dataset.colormap(1).items():
            table[index] = color
        rgba = table[dataset.read(1, **read, resampling=resampling)]
        return np.dstack([rgba[..., :3], np.minimum(rgba[..., 3], opaque)])
    bands = [1, 2, 3] if dataset.count >= 3 else [1, 1, 1]
    colors = [dataset.read(band, **read, resampling=resampling) for band in bands]
    return np.dstack([*colors, opaque]).astype(np.uint8)


def _of_mbtiles(path: Path, lat: FloatArray, lon: FloatArray, size: tuple[int, int]) -> _Image:
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
        facts = {str(name): str(value) for name, value in database.execute("SELECT name, value FROM metadata")}
        if facts.get("format", "png").lower() in {"pbf", "mvt"}:
            raise InputError(f"--background: {path}: vector tiles are not supported; use raster MBTiles (PNG, JPEG)")
        zooms = [int(z) for (z,) in database.execute("SELECT DISTINCT zoom_level FROM tiles ORDER BY zoom_level")]
        if not zooms:
            raise InputError(f"--background: {path}: the file contains no tiles")
        x, y = _mercator_fractions(lat, lon)
        zoom = _zoom(x, y, zooms, size)
        tiles = 2**zoom
        first = math.floor(x.min() * tiles), math.floor(y.min() * tiles)
        last = math.floor(x.max() * tiles), math.floor(y.max() * tiles)
        rgba, pixels = _mosaic(database, path, zoom, first, last)
    return _Image(
        rgba, _text(facts.get("attribution", "")), (x * tiles - first[0]) * pixels, (y * tiles - first[1]) * pixels
    )


def _mercator_fractions(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places on the world's square map, 0..1 from its west and from its north."""
    x, y = Transformer.from_crs(4326, 3857, always_xy=True).transform(lon, lat)
    x, y = _finite((x, y))
    # a rectangle across 180 degrees goes on beyond the eastern side.
    x = np.where(x < x.max() - _MERCATOR_HALF_M, x + 2.0 * _MERCATOR_HALF_M, x)
    return (x + _MERCATOR_HALF_M) / (2.0 * _MERCATOR_HALF_M), (_MERCATOR_HALF_M - y) / (2.0 * _MERCATOR_HALF_M)


def _zoom(x: FloatArray, y: FloatArray, zooms: list[int], size: tuple[int, int]) -> int:
    """The coarsest zoom whose tiles are as fine as the page's image, or the finest that is not too large."""
    across, down = float(np.ptp(x)), float(np.ptp(y))
    few = [z for z in zooms if (across * 2**z + 2.0) * (down * 2**z + 2.0) <= BACKGROUND.most_tiles]
    if not few:
        return zooms[0]
    fine = [z for z in few if across * 2**z * 256.0 >= size[0]]
    return fine[0] if fine else few[-1]


def _mosaic(
    database: sqlite3.Connection, path: Path, zoom: int, first: tuple[int, int], last: tuple[int, int]
) -> tuple[ByteArray, int]:
    """Tiles from the first to the last (column, row from the north) side by side, and the pixels along a tile."""
    columns, rows = last[0] - first[0] + 1, last[1] - first[1] + 1
    if columns * rows > BACKGROUND.most_tiles:
        raise InputError(f"--background: {path}: even its lowest zoom has too many tiles; use a file with lower levels")
    out, pixels = np.zeros((rows, columns, 4), dtype=np.uint8), 1
    for column in range(columns):
        for row in range(rows):
            # Rows of MBTiles are counted from the south.
            position = (zoom, (first[0] + column) % 2**zoom, 2**zoom - 1 - (first[1] + row))
            found = database.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?", position
            ).fetchone()
            if found is None:
                continue
            tile = _tile(found[0], path, position)
            if pixels == 1:
                pixels = tile.shape[0]
                out = np.zeros((rows * pixels, columns * pixels, 4), dtype=np.uint8)
            if tile.shape[0] != pixels:
                raise InputError(
                    f"--background: {path}: tile {position} has {tile.shape[0]} pixels, but others have {pixels}"
                )
            out[row * pixels : (row + 1) * pixels, column * pixels : (column + 1) * pixels] = tile
    return out, pixels


def _tile(data: object, path: Path, position: tuple[int, int, int]) -> ByteArray:
    where = f"--background: {path}: tile {position} (zoom, column, row)"
    if not isinstance(data, bytes):
        raise InputError(f"{where} is not an image; export the map again")
    try:
        with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as image:
            width, height = image.size
            if width != height or not _TILE_PIXELS[0] <= width <= _TILE_PIXELS[1]:
                raise InputError(
                    f"{where} is {width} x {height} pixels, not a square of {_TILE_PIXELS[0]} to {_TILE_PIXELS[1]}"
                )
            return np.asarray(image.convert("RGBA"), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{where} cannot be read as PNG, JPEG or WebP") from error


def _pixels(
    dataset: rasterio.DatasetReader, to_file: Transformer, lat: FloatArray, lon: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Columns and rows of places, in pixels from the upper left corner of a file."""
    inverse = ~dataset.transform
    x, y = to_file.transform(lon, lat)
    return inverse.a * x + inverse.b * y + inverse.c, inverse.d * x + inverse.e * y + inverse.f


def _finite(values: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    if not all(np.isfinite(part).all() for part in values):
        raise InputError("--background: the file's coordinate system does not cover the map's location")
    return values


def _text(words: str) -> str:
    """Attribution without its markup, in one line."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", words)).split())[:300]
