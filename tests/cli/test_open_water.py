"""Open water without data, and tiles that meet at 180 degrees, from files to grounds."""

import json
import math

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from tests.terrain.dem_files import fractal_m
from uavcover.errors import InputError, ScenarioError
from uavcover.new.quantities import water_height_m
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.terrain.elevation_file import read_ground, read_heights_amsl_m
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.suspect_heights import suspect_positions
from uavcover.terrain.terrain_source import TerrainSource

SIZE, STEP_DEG, LAT_DEG = 300, 1e-4, 46.03
CAMERA = ("--camera", "dji-mavic-3e", "--gsd", "3cm")


def tile(path, heights, *, west, north=LAT_DEG, nodata=-9999.0):
    with rasterio.open(
        path, "w", driver="GTiff", width=heights.shape[1], height=heights.shape[0], count=1, crs="EPSG:4326",
        dtype="float32", nodata=nodata, transform=Affine(STEP_DEG, 0.0, west, 0.0, -STEP_DEG, north),
    ) as file:  # fmt: skip
        file.write(np.where(np.isnan(heights), nodata, heights).astype(np.float32), 1)
    return path


def coast(seed):
    """Land that rises to the east out of the sea, which has no data: its first 140 to 160 columns."""
    rows, columns = np.mgrid[0:SIZE, 0:SIZE]
    rough = fractal_m(np.random.default_rng(seed), SIZE, SIZE, pixel_m=10.0, steepest=0.3) - 600.0
    land = 0.8 * (columns - 150.0 - 10.0 * np.sin(rows / 15.0))
    return np.where(land > 0.0, np.maximum(land + 0.2 * np.abs(rough), 0.3), np.nan)


def area(path, west, east, south=46.005, north=46.02):
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


@pytest.mark.parametrize("west", [8.005, 7.99], ids=["no data in the file", "beyond the file"])
def test_open_water_has_the_height_that_is_given(cli, tmp_path, west):
    dem = tile(tmp_path / "dem.tif", coast(1), west=8.0)
    file = area(tmp_path / "area.geojson", west, 8.025)
    new = ("new", file, "--dem", dem, *CAMERA, "-o", tmp_path / "s.toml", "--force")
    ended = cli(*new, code=2)
    assert "reaches beyond" in ended.err
    assert "if the missing part is open water, set its height above sea level with --water-height 0m" in ended.err
    assert "is treated as open water at 0 m above sea level" in cli(*new, "--water-height", "0m", code=0).err
    scenario = load_scenario(tmp_path / "s.toml")
    assert scenario.terrain.water_height_m == 0.0
    site = load_site(tmp_path / "s.toml")
    positions = site.frame.enu_from_geodetic(np.array([46.01, 46.01]), np.array([west + 1e-4, 8.020]), 0.0)[:, :2]
    water_m, land_m = site.ground.heights_m(positions) + site.alt_amsl_offset_m
    assert water_m == pytest.approx(0.0, abs=0.6)  # but for the curvature of the Earth
    assert land_m > 30.0
    # Nobody takes off from the sea.
    home = scenario.home
    assert math.isfinite(read_heights_amsl_m(dem, "EGM96", np.array([home.lat_deg]), np.array([home.lon_deg]))[0])


def test_missing_land_is_no_open_water(cli, tmp_path):
    heights = 400.0 + np.nan_to_num(coast(2))
    heights[100:180, 120:220] = np.nan
    dem = tile(tmp_path / "dem.tif", heights, west=8.0)
    ended = cli(
        "new", area(tmp_path / "a.geojson", 8.008, 8.025), "--dem", dem, *CAMERA, "-o", tmp_path / "s.toml",
        "--water-height", "0m",
     code=2)  # fmt: skip
    assert "exactly 0 m whose rim is at 4" in ended.err


def test_a_real_coast_is_not_suspect(tmp_path):
    dem = tile(tmp_path / "dem.tif", coast(3), west=8.0)
    source = TerrainSource((dem,), water_height_m=0.0)
    assert suspect_positions(source, "EGM96", (7.99, 46.004, 8.026, 46.026)) == ()
    # Where the file ends on land, water is no answer: the end shows as a step.
    (end, *_) = suspect_positions(source, "EGM96", (8.02, 46.01, 8.035, 46.02))
    assert "a straight step of 1" in end.words


def test_heights_of_water_as_people_write_them():
    assert water_height_m(None) is None
    assert [water_height_m(text) for text in ("0m", "-430 m", "0.37km", "10ft")] == [
        0.0,
        -430.0,
        370.0,
        pytest.approx(3.048),
    ]
    for text in ("0", "sea", "", "-600m", "nan m"):
        with pytest.raises(InputError, match="--water-height"):
            water_height_m(text)


def test_water_and_interpolation_are_one_or_the_other(cli, tmp_path):
    dem = tile(tmp_path / "dem.tif", coast(1), west=8.0)
    ended = cli(
        "new", area(tmp_path / "a.geojson", 8.005, 8.025), "--dem", dem, *CAMERA, "--water-height", "0m",
        "--fill-lakes", "50m", "-o", tmp_path / "s.toml",
     code=2)  # fmt: skip
    assert "use either this option" in ended.err
    text = 'name="a"\n[area]\nfile="a.geojson"\ncell_size_m=5.0\n'
    text += '[terrain]\nkind="raster"\nfile="dem.tif"\nvertical_datum="EGM96"\n'
    text += "water_height_m=0.0\nfill_no_data_m=50.0\n"
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(ScenarioError, match="water_height_m: use either this key, which treats gaps as water"):
        load_scenario(tmp_path / "bad.toml")


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("east_in", [-180.0, 180.0])
def test_tiles_that_meet_at_180_degrees_are_side_by_side(tmp_path, first, east_in):
    whole = fractal_m(np.random.default_rng(5), SIZE, 2 * SIZE, pixel_m=10.0, steepest=0.5)
    tiles = (
        tile(tmp_path / "west.tif", whole[:, :SIZE], west=180.0 - SIZE * STEP_DEG),
        tile(tmp_path / "east.tif", whole[:, SIZE:], west=east_in),
    )
    source = TerrainSource(tiles if first == 0 else tiles[::-1])
    lon = 180.0 + STEP_DEG * (np.array([3, 250, 299, 300, 301, 550]) - SIZE + 0.5)
    lat = np.full(6, LAT_DEG - 100.5 * STEP_DEG)
    for shift in (0.0, -360.0):
        heights = read_heights_amsl_m(source, "EGM96", lat, lon + shift)
        assert heights == pytest.approx(whole[100, [3, 250, 299, 300, 301, 550]], abs=1e-3)
    frame = LocalFrame(46.02, 180.0, 600.0)
    ground = read_ground(source, "EGM96", frame=frame, bounds_m=(-500.0, -500.0, 500.0, 500.0), grid_step_m=None)
    assert np.isfinite(ground.heights_m([[-400.0, 0.0], [0.0, 0.0], [400.0, 0.0]])).all()


def test_an_area_across_180_degrees_on_two_tiles(cli, tmp_path):
    whole = fractal_m(np.random.default_rng(6), SIZE, 2 * SIZE, pixel_m=10.0, steepest=0.3)
    folder = tmp_path / "tiles"
    folder.mkdir()
    tile(folder / "N46E179.tif", whole[:, :SIZE], west=180.0 - SIZE * STEP_DEG)
    tile(folder / "N46W180.tif", whole[:, SIZE:], west=-180.0)
    cli("new", "46.012,179.9995,400", "--dem", folder, *CAMERA, "-o", tmp_path / "s.toml", code=0)
    site = load_site(tmp_path / "s.toml")
    assert np.isfinite(site.ground.heights_m(np.array(site.area.exterior.coords))).all()
