"""Elevation data in several files, in a zip, in feet: the same ground as one file in metres, or one line that says why not."""

import gzip
import math
import zipfile
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from tests.scenario.scenario_texts import survey_text
from tests.terrain.dem_files import write_dem
from uavcover.errors import NoTileNearError, TerrainError
from uavcover.scenario.scenario_file import parse_scenario
from uavcover.terrain import terrain_source
from uavcover.terrain.elevation_file import read_ground, read_height_amsl_m, read_heights_amsl_m
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.terrain_source import FILES, TerrainSource, find_tiles

LAT, LON = 46.55, 8.03
FRAME = LocalFrame(LAT, LON, 500.0)
BOUNDS_M = (-400.0, -400.0, 400.0, 400.0)
AROUND = (8.025, 46.547, 8.035, 46.553)


def dem(path, lat_deg=LAT, lon_deg=LON, epsg=32632, *, pixel_m=10.0, size_m=1400.0):
    rng = np.random.default_rng(5)
    return write_dem(path, rng, lat_deg=lat_deg, lon_deg=lon_deg, epsg=epsg, pixel_m=pixel_m, size_m=size_m)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dem")
    return dem(folder / "whole.tif")


def cut(whole, folder, *, parts=3, overlap=1, names="tile-{}-{}.tif", skip=(), **changes):
    """The file as parts x parts tiles that overlap by some pixels."""
    folder.mkdir(exist_ok=True)
    with rasterio.open(whole) as file:
        values, profile = file.read(1), file.profile
    side = math.ceil(len(values) / parts)
    for i in range(parts):
        for j in range(parts):
            if (i, j) in skip:
                continue
            row, column = max(0, i * side - overlap), max(0, j * side - overlap)
            tile = values[row : (i + 1) * side, column : (j + 1) * side]
            own = {
                **profile, "height": tile.shape[0], "width": tile.shape[1],
                "transform": profile["transform"] @ Affine.translation(column, row), **changes,
            }  # fmt: skip
            with rasterio.open(folder / names.format(i, j), "w", **own) as out:
                out.write(tile.astype(own["dtype"]), 1)
    return folder


def ground_of(source):
    return read_ground(source, "EGM96", frame=FRAME, bounds_m=BOUNDS_M, grid_step_m=None)


def same_ground(one, other):
    positions = np.random.default_rng(1).uniform(-390.0, 390.0, (4000, 2))
    return np.allclose(one.heights_m(positions), other.heights_m(positions), atol=1e-6, rtol=0.0)


@pytest.mark.parametrize("overlap", [0, 1, 7])
@pytest.mark.parametrize("parts", [2, 5])
def test_tiles_are_the_ground_of_the_whole_file(whole, tmp_path, parts, overlap):
    folder = cut(whole, tmp_path / "tiles", parts=parts, overlap=overlap)
    tiles = find_tiles(["tiles"], folder=tmp_path, around=None)
    assert len(tiles) == parts**2
    assert same_ground(ground_of(TerrainSource(tiles)), ground_of(whole))
    # By a pattern, by a list, and with only the tiles that are near.
    assert find_tiles(["tiles/tile-*.tif"], folder=tmp_path, around=None) == tiles
    assert find_tiles([str(tile) for tile in tiles], folder=tmp_path, around=None) == tiles
    assert find_tiles([f"{folder}/*"], folder=tmp_path, around=AROUND)


def test_far_tiles_are_left_out_and_do_not_matter(whole, tmp_path):
    cut(whole, tmp_path / "tiles", parts=2)
    far = dem(tmp_path / "tiles" / "far.tif", 40.0, 8.0, pixel_m=50.0)
    near = find_tiles(["tiles"], folder=tmp_path, around=AROUND)
    assert far.resolve() not in near
    assert len(near) == 4
    with pytest.raises(
        NoTileNearError, match=r"none of 5 tiles is near the area \(latitude 10\.000 to 10\.100, longitude"
    ):
        find_tiles(["tiles"], folder=tmp_path, around=(100.0, 10.0, 100.1, 10.1))


def test_a_missing_tile_is_no_data_and_never_a_height(whole, tmp_path):
    cut(whole, tmp_path / "tiles", parts=3, overlap=0, skip={(1, 1)}, dtype="int16", nodata=None)
    tiles = find_tiles(["tiles"], folder=tmp_path, around=None)
    ground = ground_of(TerrainSource(tiles))
    assert np.isnan(ground.heights_m([[0.0, 0.0]])).all()
    assert np.isfinite(ground.heights_m([[-390.0, -390.0]])).all()


def test_no_data_of_tiles_stays_no_data(whole, tmp_path):
    folder = cut(whole, tmp_path / "tiles", parts=2, nodata=-9999.0)
    with rasterio.open(folder / "tile-0-0.tif", "r+") as file:
        file.write(np.full((file.height, file.width), -9999.0, dtype=np.float32), 1)
    tiles = TerrainSource(find_tiles(["tiles"], folder=tmp_path, around=None))
    heights = read_heights_amsl_m(
        tiles, "EGM96", np.array([LAT + 0.003, LAT - 0.003]), np.array([LON - 0.004, LON + 0.004])
    )
    assert np.isnan(heights[0])
    assert np.isfinite(heights[1])


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("parts", [1, 2])
def test_no_data_may_be_said_by_a_mask(whole, tmp_path, inside, parts):
    folder = cut(whole, tmp_path / "tiles", parts=parts, crs=None, nodata=None)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=inside), rasterio.open(folder / "tile-0-0.tif", "r+") as file:
        known = np.full((file.height, file.width), 255, dtype=np.uint8)
        known[: file.height // parts] = 0
        file.write(np.where(known, file.read(1), 0.0).astype(np.float32), 1)
        file.write_mask(known)
    tiles = TerrainSource(find_tiles(["tiles"], folder=tmp_path, around=None), crs="EPSG:32632")
    lat = np.array([LAT + 0.005, LAT - 0.005])
    heights = read_heights_amsl_m(tiles, "EGM96", lat, np.full(2, LON - 0.004))
    assert np.isnan(heights[0])
    assert np.isfinite(heights[1]) == (parts == 2)


@pytest.mark.parametrize(
    ("unit", "metres"), [("ft", 0.3048), ("feet", 0.3048), ("US survey foot", 1200 / 3937), ("m", 1.0)]
)
def test_heights_in_feet_by_their_unit(whole, tmp_path, unit, metres):
    with rasterio.open(whole) as file:
        values, profile = file.read(1), file.profile
    path = tmp_path / "feet.tif"
    with rasterio.open(path, "w", **{**profile, "dtype": "float64"}) as out:
        out.write(values.astype(float) / metres, 1)
        out.units = (unit,)
    assert same_ground(ground_of(path), ground_of(whole))


def test_heights_in_a_system_of_feet_are_asked_about(tmp_path):
    """EPSG:2274 is Tennessee in US survey feet; a file that does not name the unit of its heights is a question."""
    path = dem(tmp_path / "dem.tif", 36.48, -84.22, 2274, size_m=900.0)
    position = {"lat_deg": 36.48, "lon_deg": -84.22}
    with pytest.raises(
        TerrainError, match=r"is in feet, but the file does not state the unit of its heights; set terrain\.height_unit"
    ):
        read_height_amsl_m(path, "EGM96", **position)
    metres, feet = (
        read_height_amsl_m(TerrainSource((path,), height_unit=unit), "EGM96", **position) for unit in ("m", "us-ft")
    )
    assert feet == pytest.approx(metres * 1200.0 / 3937.0)
    with rasterio.open(path, "r+") as file:
        file.units = ("m",)
    assert read_height_amsl_m(path, "EGM96", **position) == pytest.approx(metres)
    with pytest.raises(TerrainError, match=r"the file states that its heights are in m; remove terrain\.height_unit"):
        read_height_amsl_m(TerrainSource((path,), height_unit="ft"), "EGM96", **position)


@pytest.mark.parametrize("packed", ["zip", "gz"])
def test_srtm_tiles_packed_side_by_side(tmp_path, packed):
    """3 arc-second tiles as they come: big-endian, named by their corner, one row and column shared, no unit, packed."""
    lats = {"N46E008": 46, "N45E008": 45}
    folder = tmp_path / "srtm"
    folder.mkdir()
    for name, south in lats.items():
        rows = south + 1.0 - np.arange(1201) / 1200.0
        columns = 8.0 + np.arange(1201) / 1200.0
        heights = np.round(1000.0 + 300.0 * np.sin(40.0 * rows)[:, None] + 200.0 * np.cos(50.0 * columns)[None, :])
        data = heights.astype(">i2").tobytes()
        if packed == "gz":
            (folder / f"{name}.hgt.gz").write_bytes(gzip.compress(data))
            continue
        with zipfile.ZipFile(folder / f"{name}.hgt.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(f"{name}.hgt", data)
    tiles = TerrainSource(find_tiles([f"srtm/*.hgt.{packed}"], folder=tmp_path, around=(8.4, 45.99, 8.6, 46.01)))
    assert len(tiles.files) == 2
    # Across the seam at 46 degrees north, at pixels of both files and between them.
    lat = 46.0 + np.arange(-3, 4) / 1200.0
    lon = np.full(7, 8.5)
    truth = np.round(1000.0 + 300.0 * np.sin(40.0 * lat) + 200.0 * np.cos(50.0 * 8.5))
    assert read_heights_amsl_m(tiles, "EGM96", lat, lon) == pytest.approx(truth, abs=1.0)
    assert np.isfinite(read_heights_amsl_m(tiles, "EGM96", lat + 0.0004, lon)).all()
    # One tile is enough where the other is far.
    assert len(find_tiles(["srtm"], folder=tmp_path, around=(8.4, 46.5, 8.6, 46.6))) == 1


def test_the_hash_tells_every_tile(whole, tmp_path):
    folder = cut(whole, tmp_path / "tiles", parts=2)
    tiles = TerrainSource(find_tiles(["tiles"], folder=tmp_path, around=None))
    before = tiles.sha256()
    with rasterio.open(folder / "tile-1-1.tif", "r+") as file:
        file.write(file.read(1) + np.float32(1.0), 1)
    assert tiles.sha256() != before
    assert TerrainSource((whole,)).sha256() == TerrainSource((whole,)).sha256()


AREA = "polygon_lon_lat_deg = [[8.028, 46.548], [8.032, 46.548], [8.032, 46.552], [8.028, 46.552]]"


@pytest.mark.parametrize(
    "file", ['"tiles"', '"tiles/*.tif"', '["tiles/tile-0-0.tif", "tiles/tile-0-1.tif", "tiles/tile-1-0.tif"]']
)
def test_a_scenario_names_tiles_and_keeps_which(whole, tmp_path, file):
    cut(whole, tmp_path / "tiles", parts=2)
    scenario = parse_scenario(survey_text(AREA, file, (46.55, 8.03)), source="a", folder=tmp_path)
    assert isinstance(scenario.terrain.file, tuple)
    assert all(name.endswith(".tif") for name in scenario.terrain.file)


def other_crs(folder):
    dem(folder / "z.tif", epsg=2056, size_m=900.0)


def other_grid(folder):
    with rasterio.open(folder / "tile-0-0.tif") as file:
        values, profile = file.read(1), file.profile
    profile["transform"] @= Affine.translation(0.4, 0.0)
    with rasterio.open(folder / "z.tif", "w", **profile) as out:
        out.write(values, 1)


def other_unit(folder):
    with rasterio.open(folder / "tile-0-0.tif", "r+") as file:
        file.units = ("ft",)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (other_crs, "the coordinate system differs from"),
        (other_grid, "the pixel grid differs from that of"),
        (other_unit, "the unit differs from"),
        (lambda folder: (folder / "tile-0-0.tif").write_bytes(b"no raster"), "the file cannot be read as elevation data"),
        (lambda folder: (folder / "tile-0-0.tif").write_bytes(b""), "the file is empty"),
    ],
)  # fmt: skip
def test_tiles_that_do_not_belong_together(whole, tmp_path, spoil, words):
    folder = cut(whole, tmp_path / "tiles", parts=2)
    spoil(folder)
    with pytest.raises(TerrainError, match=words) as caught:
        ground_of(TerrainSource(find_tiles(["tiles"], folder=tmp_path, around=AROUND)))
    assert "\n" not in str(caught.value)


def test_bad_folders_and_patterns(tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "none/*.tif"):
        with pytest.raises(TerrainError, match=r"contains no tiles \(\.tif, .*\); use files, a folder or a pattern"):
            find_tiles([name], folder=tmp_path, around=None)
    monkeypatch.setattr(terrain_source, "FILES", replace(FILES, max_tiles=1))
    for name in ("a.tif", "b.tif"):
        (tmp_path / "empty" / name).write_bytes(b"x")
    with pytest.raises(TerrainError, match="2 tiles exceed the limit of 1; use only"):
        find_tiles(["empty"], folder=tmp_path, around=None)


@pytest.mark.parametrize("tiles", [1, 4])
def test_a_coordinate_system_that_the_file_does_not_name(whole, tmp_path, tiles):
    """An ASCII grid without its .prj has none; the scenario says it, and it is the same ground."""
    if tiles == 1:
        with rasterio.open(whole) as file:
            values, profile = file.read(1), file.profile
        files = (tmp_path / "dem.tif",)
        with rasterio.open(files[0], "w", **{**profile, "crs": None}) as out:
            out.write(values, 1)
    else:
        files = tuple(sorted(cut(whole, tmp_path / "tiles", parts=2, crs=None).iterdir()))
    assert same_ground(ground_of(TerrainSource(files, crs="EPSG:32632")), ground_of(whole))
    with pytest.raises(
        TerrainError, match=r"does not state its coordinate system; specify it with terrain\.crs \(--dem-crs\)"
    ):
        ground_of(TerrainSource(files))
    with pytest.raises(TerrainError, match=r"terrain\.crs: unknown coordinate system 'EPSG:1'; .*--dem-crs"):
        ground_of(TerrainSource(files, crs="EPSG:1"))
    with pytest.raises(
        TerrainError, match=r"the file already states its coordinate system \(EPSG:32632\); remove terrain\.crs"
    ):
        ground_of(TerrainSource((whole,), crs="EPSG:32632"))


def test_heights_in_centimetres(whole, tmp_path):
    """Iowa's elevation model has whole centimetres and does not say so; taken as metres they are refused."""
    with rasterio.open(whole) as file:
        values, profile = file.read(1), file.profile
    path = tmp_path / "cm.tif"
    with rasterio.open(path, "w", **{**profile, "dtype": "uint32", "nodata": 0}) as out:
        out.write((values * 100.0).round().astype("uint32"), 1)
    with pytest.raises(TerrainError, match=r"feet or centimetres, set terrain\.height_unit \(--height-unit\)"):
        ground_of(path)
    positions = np.random.default_rng(1).uniform(-390.0, 390.0, (4000, 2))
    in_cm = ground_of(TerrainSource((path,), height_unit="cm")).heights_m(positions)
    difference = np.abs(in_cm - ground_of(whole).heights_m(positions))
    assert difference.max() <= 0.00501
