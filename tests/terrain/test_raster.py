import math
import re
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pyproj
import pytest
import rasterio
import rasterio.shutil
from rasterio.crs import CRS
from rasterio.transform import Affine
from rasterio.warp import Resampling, reproject, transform

from uavcover.errors import NoElevationError, TerrainError
from uavcover.terrain import elevation_file, frames
from uavcover.terrain.elevation_file import read_ground, read_height_amsl_m, read_heights_amsl_m
from uavcover.terrain.frames import PIXELS, LocalFrame
from uavcover.terrain.ground import grid_ground
from uavcover.terrain.terrain_source import FILES

LAT, LON = 47.2, 11.4  # asymmetric, and in UTM zone 32
FRAME = LocalFrame(LAT, LON, 600.0)


def from_origin(west, north, width, height):
    return Affine(width, 0, west, 0, -height, north)


def write(path, values, crs="EPSG:4326", transform=None, nodata=None, dtype=None, scale=None, offset=None, unit=None):
    values = np.asarray(values)
    if transform is None:
        rows, columns = values.shape
        transform = from_origin(LON - 0.001 * columns / 2, LAT + 0.001 * rows / 2, 0.001, 0.001)
    with rasterio.open(
        path, "w", driver="GTiff", width=values.shape[1], height=values.shape[0], count=1, crs=crs,
        transform=transform, nodata=nodata, dtype=dtype or values.dtype,
    ) as file:  # fmt: skip
        file.write(values.astype(dtype or values.dtype), 1)
        if scale is not None:
            file.scales, file.offsets = (scale,), (offset,)
        if unit is not None:
            file.units = (unit,)
    return path


def bumps(shape=(30, 40)):
    return np.random.default_rng(3).uniform(400.0, 900.0, shape).astype(np.float32)


def gdal_bilinear(path, lat, lon):
    """GDAL's own bilinear resampling: a warp to one pixel, centred on the place."""
    out = []
    with rasterio.open(path) as dataset:
        horizontal = CRS.from_epsg(4326) if dataset.crs.is_geographic else dataset.crs
        xs, ys = transform("EPSG:4326", horizontal, lon.tolist(), lat.tolist())
        side = 0.01 * math.sqrt(abs(dataset.transform.determinant))
        source = dataset.read(1).astype(np.float64)
        for x, y in zip(xs, ys, strict=True):
            one = np.zeros((1, 1))
            reproject(
                source, one, src_transform=dataset.transform, src_crs=horizontal, dst_crs=horizontal,
                dst_transform=from_origin(x - side / 2, y + side / 2, side, side), resampling=Resampling.bilinear,
                tolerance=0, XSCALE=1, YSCALE=1,
            )  # fmt: skip
            out.append(one[0, 0])
    return np.array(out)


UTM = CRS.from_epsg(32632)
(_X,), (_Y,) = transform("EPSG:4326", UTM, [LON], [LAT])
LAYOUTS = {
    "geographic": {},
    "projected": {"crs": "EPSG:32632", "transform": from_origin(_X - 1000, _Y + 750, 50, 50)},
    "not square": {"crs": "EPSG:32632", "transform": from_origin(_X - 800, _Y + 750, 40, 50)},
    "rotated": {
        "crs": "EPSG:32632",
        "transform": Affine(47.0, -17.0, _X - 500, -17.0, -47.0, _Y + 1000),
    },
    "south-up": {"crs": "EPSG:32632", "transform": Affine(50, 0, _X - 1000, 0, 50, _Y - 750)},
    "another datum": {"crs": "EPSG:25832", "transform": from_origin(_X - 1000, _Y + 750, 50, 50)},
    "sea level named": {"crs": "EPSG:4326+5773"},
    "metres named": {"unit": "metre"},
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_heights_equal_those_of_gdal_at_every_place(tmp_path, layout):
    path = write(tmp_path / "dem.tif", bumps(), **layout)
    rng = np.random.default_rng(1)
    lat, lon = LAT + rng.uniform(-0.002, 0.002, 12), LON + rng.uniform(-0.004, 0.004, 12)
    ours = [read_height_amsl_m(path, "EGM96", lat_deg=a, lon_deg=o) for a, o in zip(lat, lon, strict=True)]
    # GDAL computes its weights in single precision.
    np.testing.assert_allclose(ours, gdal_bilinear(path, lat, lon), atol=0.05)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_pixel_centres_have_the_value_of_their_pixel(tmp_path, layout):
    values = bumps()
    path = write(tmp_path / "dem.tif", values, **layout)
    with rasterio.open(path) as dataset:
        for row, column in ((12, 17), (14, 21), (16, 16)):
            x, y = dataset.xy(row, column)
            lon, lat = transform(dataset.crs, "EPSG:4326", [x], [y])
            height = read_height_amsl_m(path, "EGM96", lat_deg=lat[0], lon_deg=lon[0])
            assert height == pytest.approx(values[row, column], abs=1e-3)


def test_scale_and_offset_are_applied(tmp_path):
    path = write(tmp_path / "dem.tif", np.full((9, 9), 5000), dtype="int16", scale=0.1, offset=100.0)
    assert read_height_amsl_m(path, "EGM96", lat_deg=LAT, lon_deg=LON) == pytest.approx(600.0)


BOUNDS = (-600.0, -400.0, 700.0, 500.0)
_LARGEST_BYTES_A_NODE = 20


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_a_square_grid_has_the_heights_of_the_source(tmp_path, layout):
    path = write(tmp_path / "dem.tif", bumps(), **layout)
    ground = read_ground(path, "EGM96", frame=FRAME, bounds_m=BOUNDS, grid_step_m=40.0)
    surface = ground.surface
    rows, columns = surface.up_m.shape
    east0_m, north0_m = surface.grid.east0_m, surface.grid.north0_m
    assert (east0_m, north0_m, surface.step_m) == (-640.0, -440.0, 40.0)
    assert east0_m + (columns - 1) * 40.0 >= 700.0
    assert north0_m + (rows - 1) * 40.0 >= 500.0
    # The rotated file leaves one corner of the grid free.
    assert np.isfinite(surface.up_m).mean() > 0.98
    for i, j in ((0, 0), (3, 7), (0, columns - 1), (rows // 2, columns // 2)):
        enu = [[east0_m + 40.0 * j, north0_m + 40.0 * i, surface.up_m[i, j]]]
        lat, lon, alt = (float(a[0]) for a in FRAME.geodetic_from_enu(enu))
        # In the air above one place on Earth, at the height that the source has there.
        assert alt == pytest.approx(read_height_amsl_m(path, "EGM96", lat_deg=lat, lon_deg=lon), abs=1e-6)
    assert ground.vertical_datum == "EGM96"
    assert len(ground.sha256) == 64
    assert "dem.tif (the data extends from 47.1" in ground.source
    assert not surface.up_m.flags.writeable


def test_the_step_is_the_smaller_side_of_a_pixel_unless_given(tmp_path):
    path = write(tmp_path / "dem.tif", bumps(), crs="EPSG:32632", transform=from_origin(_X - 1000, _Y + 450, 50, 30))
    step = read_ground(path, "EGM96", frame=FRAME, bounds_m=BOUNDS, grid_step_m=None).surface.step_m
    assert step == pytest.approx(30.0, rel=2e-3)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_the_nodes_are_the_pixels_of_the_file(tmp_path, layout):
    values = bumps()
    path = write(tmp_path / "dem.tif", values, **layout)
    ground = read_ground(path, "EGM96", frame=FRAME, bounds_m=BOUNDS, grid_step_m=None)
    assert ground.error_m < 0.01
    with rasterio.open(path) as dataset:
        for row, column in ((12, 17), (14, 21), (16, 16)):
            x, y = dataset.xy(row, column)
            lon, lat = transform(dataset.crs, "EPSG:4326", [x], [y])
            (position,) = FRAME.enu_from_geodetic(lat[0], lon[0], float(values[row, column]))
            assert ground.heights_m(position[:2])[0] == pytest.approx(position[2], abs=0.01)


@pytest.mark.parametrize(
    ("dtype", "nodata"), [("int16", -32768), ("uint16", 65535), ("float32", math.nan), ("float32", 0)]
)
def test_no_data_is_a_gap_never_a_height(tmp_path, dtype, nodata):
    values = bumps()
    values[14, 20] = nodata
    path = write(tmp_path / "dem.tif", values, dtype=dtype, nodata=nodata)
    ground = read_ground(path, "EGM96", frame=FRAME, bounds_m=BOUNDS, grid_step_m=20.0)
    up = ground.surface.up_m
    assert 0.0 < np.isnan(up).mean() < 0.2
    # Nothing is mixed with the mark: all that is left is in the range of the heights.
    assert np.nanmin(up) > 400.0 - 600.0 - 1.0
    assert np.nanmax(up) < 900.0 - 600.0 + 1.0
    with rasterio.open(path) as dataset:
        lon, lat = dataset.xy(14, 20)
    with pytest.raises(NoElevationError, match=rf"no elevation data at {lat}.*data extends from") as caught:
        read_height_amsl_m(path, "EGM96", lat_deg=lat, lon_deg=lon)
    assert caught.value.extent.startswith("the data extends from")
    assert str(caught.value).endswith(f"({caught.value.extent})")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_gaps_too(tmp_path, bad):
    values = bumps()
    values[15, 20] = bad
    path = write(tmp_path / "dem.tif", values)
    up = read_ground(path, "EGM96", frame=FRAME, bounds_m=BOUNDS, grid_step_m=20.0).surface.up_m
    assert np.isnan(up).any()
    assert not np.isinf(up).any()


def test_beyond_the_data_there_are_gaps(tmp_path):
    path = write(tmp_path / "dem.tif", bumps())
    for step in (None, 50.0):
        ground = read_ground(path, "EGM96", frame=FRAME, bounds_m=(-5000, -100, 100, 100), grid_step_m=step)
        assert np.isnan(ground.heights_m([-4900.0, 0.0])).all()
        assert np.isfinite(ground.heights_m([0.0, 0.0])).all()
        far = read_ground(path, "EGM96", frame=LocalFrame(10.0, 20.0, 0.0), bounds_m=BOUNDS, grid_step_m=step)
        assert np.isnan(far.heights_m([0.0, 0.0])).all()


def read(path, datum="EGM96", step=40.0):
    read_ground(path, datum, frame=FRAME, bounds_m=BOUNDS, grid_step_m=step)


def one_line(caught, path, *words):
    message = str(caught.value)
    assert "\n" not in message
    assert path is None or str(path) in message
    for word in words:
        assert re.search(word, message), message


WRONG = {
    "no crs": ({"crs": None}, ["does not state its coordinate system; specify it with terrain\\.crs"]),
    "degrees instead of metres": ({"crs": "EPSG:32632"}, ["pixels of 0.001 x 0.001", "degrees instead of metres; assign"]),
    "metres instead of degrees": (
        {"transform": from_origin(_X, _Y, 30, 30)}, ["reaches latitude 5.2", "metres instead of degrees; assign"],
    ),
    "another sea level": (
        {"crs": "EPSG:4326+5703"}, ["terrain.vertical_datum: the scenario says EGM96, but the file says NAVD88", "correct"],
    ),
    "ellipsoid": ({"crs": "EPSG:4979"}, ["terrain.vertical_datum: the scenario says EGM96", "ellipsoid", "convert"]),
    "fathoms": ({"unit": "fathom"}, ["heights are in 'fathom'; convert them to metres"]),
    "undeclared no-data": ({"values": -32768}, ["row 15, column 20 is -32768 m", "no-data value"]),
    "no mountain": ({"values": 12000}, ["row 15, column 20 is 12000 m"]),
    "local system": (
        {"crs": CRS.from_wkt('LOCAL_CS["site grid",UNIT["metre",1]]')}, ["cannot be converted", "assign a known system"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "words"), WRONG.values(), ids=WRONG.keys())
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_files_that_must_not_be_used(tmp_path, change, words):
    values = bumps()
    change = dict(change)
    if "values" in change:
        values[15, 20] = change.pop("values")
    path = write(tmp_path / "dem.tif", values, **change)
    with pytest.raises(TerrainError) as caught:
        read(path)
    one_line(caught, path, *words)


def test_a_sea_level_in_feet_is_read_in_metres(tmp_path):
    # A virtual file keeps what a GeoTIFF written here would turn into metres.
    feet = (
        'COMPD_CS["in feet",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
        'UNIT["degree",0.0174532925199433]],VERT_CS["EGM96 height (ft)",VERT_DATUM["EGM96 geoid",2005],UNIT["foot",0.3048],'
        'AXIS["Up",UP]]]'
    )
    write(tmp_path / "dem.tif", bumps())
    path = tmp_path / "dem.vrt"
    path.write_text(
        f'<VRTDataset rasterXSize="40" rasterYSize="30"><SRS>{feet.replace(chr(34), "&quot;")}</SRS>'
        "<GeoTransform>11.38, 0.001, 0, 47.215, 0, -0.001</GeoTransform>"
        '<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">dem.tif'
        "</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    position = {"lat_deg": LAT, "lon_deg": LON}
    metres = read_height_amsl_m(tmp_path / "dem.tif", "EGM96", **position)
    assert read_height_amsl_m(path, "EGM96", **position) == pytest.approx(0.3048 * metres)


def test_the_sea_level_of_the_scenario_is_that_of_the_file(tmp_path):
    path = write(tmp_path / "dem.tif", bumps(), crs="EPSG:4326+3855")
    read(path, "EGM2008")
    with pytest.raises(TerrainError) as caught:
        read(path, "EGM96")
    one_line(caught, path, "says EGM96, but the file says EGM2008")


def test_an_unheard_of_datum(tmp_path):
    path = write(tmp_path / "dem.tif", bumps())
    with pytest.raises(TerrainError) as caught:
        read(path, "unheard of")
    one_line(caught, None, "^terrain.vertical_datum", "unheard of", "convert the file")


def _geoid(lat_deg, lon_deg):
    """A made-up sea level: bilinear in latitude and longitude, as PROJ is between the nodes of a grid."""
    return 48.0 + 2.0 * (lat_deg - LAT) - 3.0 * (lon_deg - LON)


@pytest.fixture
def geoid_grid(tmp_path):
    """PROJ with a grid for EGM96 in a folder of its own, in NOAA's format GTX under the grid's former name."""
    south, west, step, count = LAT - 1.0, LON - 1.0, 0.25, 9
    lat, lon = south + step * np.arange(count), west + step * np.arange(count)
    nodes = _geoid(lat[:, None], lon[None, :])
    header = struct.pack(">4d2i", south, west, step, step, count, count)
    (tmp_path / "egm96_15.gtx").write_bytes(header + nodes.astype(">f4").tobytes())
    before = pyproj.datadir.get_data_dir()
    pyproj.datadir.append_data_dir(str(tmp_path))
    yield tmp_path
    pyproj.datadir.set_data_dir(before)


@pytest.mark.usefixtures("geoid_grid")
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:4979"])
def test_heights_above_the_ellipsoid_are_brought_to_sea_level(tmp_path, crs):
    path = write(tmp_path / "dem.tif", bumps(), crs=crs)
    plain = write(tmp_path / "plain.tif", bumps())
    rng = np.random.default_rng(4)
    lat, lon = LAT + rng.uniform(-0.004, 0.004, 200), LON + rng.uniform(-0.004, 0.004, 200)
    above_sea = read_heights_amsl_m(path, "WGS84-ellipsoid", lat, lon)
    raw = read_heights_amsl_m(plain, "EGM96", lat, lon)
    assert np.abs(above_sea - (raw - _geoid(lat, lon))).max() < 2e-3
    assert np.ptp(raw - above_sea) > 0.005


@pytest.mark.usefixtures("geoid_grid")
@pytest.mark.parametrize("datum", ["EGM96", "WGS84-ellipsoid"])
def test_a_large_file_is_read_by_strips_to_the_same_ground(tmp_path, monkeypatch, datum):
    values = bumps()
    values[3, 5] = math.nan
    path = write(tmp_path / "dem.tif", values)

    def nodes() -> np.ndarray:
        return read_ground(path, datum, frame=FRAME, bounds_m=BOUNDS, grid_step_m=None).surface.up_m

    whole = nodes()
    monkeypatch.setattr(elevation_file, "FILES", replace(FILES, most_pixels=100))
    monkeypatch.setattr(frames, "PIXELS", replace(PIXELS, strip_nodes=70))
    assert np.allclose(nodes(), whole, rtol=0.0, atol=1e-9, equal_nan=True)
    assert whole.shape[0] > 10


def test_a_wrong_height_in_a_later_strip_is_told_with_its_row(tmp_path, monkeypatch):
    values = bumps()
    values[21, 20] = 12_000.0
    monkeypatch.setattr(elevation_file, "FILES", replace(FILES, most_pixels=100))
    with pytest.raises(TerrainError, match="the height in row 21, column 20 is 12000 m"):
        read_ground(
            write(tmp_path / "dem.tif", values), "EGM96", frame=FRAME, bounds_m=(-9e3, -9e3, 9e3, 9e3), grid_step_m=None
        )


@pytest.mark.usefixtures("geoid_grid")
@pytest.mark.parametrize("datum", ["EGM96", "WGS84-ellipsoid"])
def test_reading_takes_little_more_memory_than_the_ground(tmp_path, monkeypatch, datum):
    # 2.4e5 pixels of 3 m; half a degree around them is in the small geoid grid of the tests.
    path = write(tmp_path / "dem.tif", bumps((400, 600)), transform=from_origin(LON - 0.009, LAT + 0.006, 3e-5, 3e-5))
    monkeypatch.setattr(elevation_file, "FILES", replace(FILES, most_pixels=6_000))
    monkeypatch.setattr(frames, "PIXELS", replace(PIXELS, strip_nodes=6_000))
    monkeypatch.setattr(elevation_file, "measure_error_m", lambda *_: 0.0)

    def read_it():
        return read_ground(path, datum, frame=FRAME, bounds_m=BOUNDS, grid_step_m=None).surface.up_m

    nodes = read_it().size
    tracemalloc.start()
    try:
        read_it()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert nodes > 100_000
    assert peak < _LARGEST_BYTES_A_NODE * nodes


def test_without_the_grid_the_error_names_it(tmp_path):
    path = write(tmp_path / "dem.tif", bumps())
    with pytest.raises(TerrainError) as caught:
        read(path, "WGS84-ellipsoid")
    one_line(caught, None, "^terrain.vertical_datum", "us_nga_egm96_15.tif", "projsync", "convert the file")


@pytest.mark.usefixtures("geoid_grid")
def test_a_grid_that_does_not_reach_the_data(tmp_path):
    path = write(tmp_path / "dem.tif", bumps(), transform=from_origin(LON + 4.98, LAT + 0.015, 0.001, 0.001))
    with pytest.raises(TerrainError, match="no geoid grid covers the elevation data"):
        read_heights_amsl_m(path, "WGS84-ellipsoid", np.array([LAT]), np.array([LON + 5.0]))


@pytest.mark.usefixtures("geoid_grid")
def test_a_sea_level_that_the_file_names_is_no_ellipsoid(tmp_path):
    path = write(tmp_path / "dem.tif", bumps(), crs="EPSG:4326+5773")
    with pytest.raises(TerrainError, match="the scenario says WGS84-ellipsoid, but the file says EGM96"):
        read(path, "WGS84-ellipsoid")


def test_missing_empty_and_broken_files(tmp_path):
    missing, empty, broken, cut = (tmp_path / name for name in ("missing.tif", "empty.tif", "broken.tif", "cut.tif"))
    empty.touch()
    broken.write_bytes(b"II*\0 not a picture of anything")
    values = np.random.default_rng(0).uniform(0, 1000, (300, 300)).astype(np.float32)
    whole = write(tmp_path / "whole.tif", values, transform=from_origin(LON - 0.15, LAT + 0.15, 0.001, 0.001))
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 3])
    gone, lacking = write(tmp_path / "gone.tif", values), tmp_path / "tiles.vrt"
    rasterio.shutil.copy(gone, lacking, driver="VRT")
    gone.unlink()
    for path, words in (
        (missing, "no such file .terrain.file is relative"),
        (tmp_path, "no such file"),
        (empty, "the file is empty"),
        (broken, "the file cannot be read as elevation data"),
        (cut, "the file cannot be read as elevation data"),
        (lacking, "the file cannot be read as elevation data .*gone.tif: No such file or directory"),
    ):
        with pytest.raises(TerrainError) as caught:
            read(path)
        one_line(caught, path, words)


@pytest.mark.parametrize("step", [0.01, 1e-12])
def test_a_step_in_degrees_or_too_fine_is_refused_before_memory_is_asked_for(tmp_path, step):
    path = write(tmp_path / "dem.tif", bumps())
    with pytest.raises(TerrainError) as caught:
        read(path, step=step)
    one_line(caught, None, "^terrain.grid_step_m", "set a larger step")


def test_a_grid_has_at_least_one_cell():
    with pytest.raises(TerrainError, match="at least 2 x 2 nodes"):
        grid_ground(np.zeros((1, 5)), east0_m=0, north0_m=0, step_m=1, source="x", vertical_datum="EGM96")


def test_a_grid_owns_its_heights():
    nodes = np.zeros((3, 3))
    ground = grid_ground(nodes, east0_m=0, north0_m=0, step_m=1, source="x", vertical_datum="EGM96")
    nodes[1, 1] = 7.0
    assert ground.heights_m([1.0, 1.0])[0] == 0.0
    assert ground.gradients([[0.5, 0.5]]).tolist() == [[0.0, 0.0]]
    assert ground.leg_height_ranges_m([[0, 0, 1], [2, 2, 3]]).tolist() == [[1.0, 0.0, 3.0, 1.0]]


def test_limits_of_plausible_heights_hold_the_lowest_and_the_highest_land():
    assert elevation_file.LOWEST_PLAUSIBLE_M < -430.0
    assert elevation_file.HIGHEST_PLAUSIBLE_M > 8849.0
