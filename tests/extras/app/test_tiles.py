"""Height tiles against rasterio and against the ground itself; backgrounds; contours."""

import io
import math
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image

from uavcover.errors import InputError
from uavcover.extras.app import tiles
from uavcover.extras.app.scene import Scenes
from uavcover.terrain.terrain_source import TerrainSource

DEM = Path(tiles.__file__).parents[2] / "data" / "jacksboro.tif"


def decoded(png: bytes) -> np.ndarray:
    """Heights of a tile, by MapLibre's formula of the Terrarium encoding."""
    r, g, b = np.moveaxis(np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=float), -1, 0)
    return r * 256.0 + g + b / 256.0 - 32768.0


def tile_of(lon: float, lat: float, zoom: int) -> tuple[int, int, int]:
    x = (lon + 180.0) / 360.0 * 2**zoom
    y = (1.0 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2.0 * 2**zoom
    return zoom, int(x), int(y)


@pytest.mark.parametrize("height", [-430.5, 0.0, 0.25, 1234.56789, 8848.86, -11034.0])
def test_the_encoding_keeps_a_256th_of_a_metre(height: float) -> None:
    out = io.BytesIO()
    Image.fromarray(tiles.terrarium(np.full((2, 2), height))).save(out, "PNG")
    assert np.abs(decoded(out.getvalue()) - height).max() <= 0.5 / 256.0 + 1e-9


@pytest.mark.parametrize("zoom", [11, 13, 14])
def test_heights_are_those_of_the_file(zoom: int) -> None:
    tile = tile_of(-84.209, 36.4738, zoom)
    heights = decoded(tiles.height_tile(TerrainSource((DEM,)), *tile))
    positions = tiles.lon_lat_of_pixels(*tile)
    with rasterio.open(DEM) as dataset:
        west, south, east, north = dataset.bounds
        inside = (
            (positions[:, 0] > west + 0.002)
            & (positions[:, 0] < east - 0.002)
            & (positions[:, 1] > south + 0.002)
            & (positions[:, 1] < north - 0.002)
        )
        band = dataset.read(1).astype(float)
        column, row = ~dataset.transform @ (positions[inside, 0], positions[inside, 1])
    assert inside.sum() > 100
    # The bilinear twin: between the centres of pixels.
    c, r = np.asarray(column) - 0.5, np.asarray(row) - 0.5
    c0, r0 = np.floor(c).astype(int), np.floor(r).astype(int)
    u, v = c - c0, r - r0
    expected = (band[r0, c0] * (1 - u) + band[r0, c0 + 1] * u) * (1 - v) + (
        band[r0 + 1, c0] * (1 - u) + band[r0 + 1, c0 + 1] * u
    ) * v
    error = np.abs(heights.ravel()[inside] - expected)
    if zoom >= 13:  # a coarser tile averages pixels
        assert np.quantile(error, 0.99) < 0.75
    assert np.median(error) < 5.0


def test_a_scenario_without_a_file_has_tiles_of_its_ground() -> None:
    scene = Scenes().of(Path(tiles.__file__).parents[2] / "scenarios" / "paper-r1.toml")
    assert scene.terrain is None
    west, south, east, north = scene.site.area.bounds
    lon, lat = scene.lon_lat(np.array([[(west + east) / 2.0, (south + north) / 2.0, 0.0]]))[0]
    tile = tile_of(lon, lat, 17)
    positions = scene.east_north(tiles.lon_lat_of_pixels(*tile))
    expected = scene.site.ground.heights_m(positions)
    known = np.isfinite(expected)
    assert known.any()
    assert np.abs(decoded(tiles.height_tile(scene, *tile)).ravel()[known] - expected[known]).max() < 0.01


def test_places_and_local_positions_go_there_and_back() -> None:
    for name in ("jacksboro", "paper-R2"):
        scene = Scenes().of(Path(tiles.__file__).parents[2] / "scenarios" / f"{name}.toml")
        corner = np.array(scene.site.area.bounds).reshape(2, 2)
        assert np.abs(scene.east_north(scene.lon_lat(corner)) - corner).max() < 0.2
        site = scene.site
        route_m = np.column_stack([corner, site.ground.heights_m(corner) + 80.0])
        assert np.abs(scene.enu(scene.waypoints(route_m)) - route_m).max() < 0.02


@pytest.mark.parametrize("tile", [(-1, 0, 0), (23, 0, 0), (3, 8, 0), (3, 0, 8), (0, 1, 0)])
def test_a_tile_that_is_none_is_refused(tile: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="the map has no tile"):
        tiles.height_tile(TerrainSource((DEM,)), *tile)


def test_the_finest_zoom_is_about_that_of_the_file() -> None:
    # SRTM: 1 arc second, 31 m north to south; a pixel of zoom 12 has 38 m at the equator, of zoom 13 19 m.
    assert tiles.finest_zoom(TerrainSource((DEM,))) in (11, 12, 13)


@pytest.mark.parametrize("kind", ["rgb", "grey", "float"])
def test_a_background_keeps_its_colours_and_is_clear_outside(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "photo.tif"
    count, dtype = {"rgb": (3, "uint8"), "grey": (1, "uint8"), "float": (1, "float32")}[kind]
    with rasterio.open(
        path, "w", driver="GTiff", width=64, height=64, count=count, dtype=dtype, crs="EPSG:4326",
        transform=rasterio.Affine(0.001, 0.0, 10.0, 0.0, -0.001, 50.0), nodata=None if kind == "rgb" else 0,
    ) as dataset:  # fmt: skip
        dataset.write(np.stack([np.full((64, 64), 40 * (n + 1), dtype=dtype) for n in range(count)]))
    data, media = tiles.background_tile(path, *tile_of(10.03, 49.97, 12)) or (b"", "")
    assert media == "image/png"
    rgba = np.asarray(Image.open(io.BytesIO(data)))
    assert rgba.shape == (256, 256, 4)
    assert 0 < (rgba[..., 3] > 0).sum() < 256 * 256
    inside = rgba[rgba[..., 3] == 255]
    if kind == "rgb":
        assert (np.median(inside[:, :3], axis=0) == (40, 80, 120)).all()
    assert tiles.background_tile(path, *tile_of(-60.0, 10.0, 12)) is None


def test_mbtiles_count_their_rows_from_the_south(tmp_path: Path) -> None:
    path = tmp_path / "map.mbtiles"
    with sqlite3.connect(path) as connection:
        connection.execute("create table tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)")
        connection.execute("insert into tiles values (3, 2, 6, ?)", (b"\x89PNG rest",))
        connection.execute("insert into tiles values (3, 3, 6, ?)", (b"<svg onload=alert(1)>",))
    connection.close()
    assert tiles.background_tile(path, 3, 2, 1) == (b"\x89PNG rest", "image/png")
    assert tiles.background_tile(path, 3, 2, 2) is None
    assert tiles.background_tile(path, 3, 3, 1) is None, "what is not an image is not served as one"


@pytest.mark.parametrize("name", ["broken.tif", "broken.mbtiles"])
def test_a_broken_background_is_one_line(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"no raster")
    with pytest.raises(InputError, match=name):
        tiles.background_tile(tmp_path / name, 3, 2, 1)


def test_contours_are_at_round_heights_and_lie_on_the_ground() -> None:
    scene = Scenes().of(Path(tiles.__file__).parents[2] / "scenarios" / "jacksboro.toml")
    lines = tiles.contours(scene)
    assert 8 <= len({line["height"] for line in lines}) <= 30
    for line in lines[::7]:
        positions = scene.east_north(np.array(line["line"]))
        heights = scene.site.ground.heights_m(positions) + scene.site.alt_amsl_offset_m
        assert np.nanquantile(np.abs(heights - line["height"]), 0.95) < 3.0
