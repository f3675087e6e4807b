"""``uavcover new``: from foreign files to a scenario that plans, and every bad input as one line."""

import itertools
import tomllib

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import Affine

from tests.scenario.areas import written
from tests.scenario.dem_files import write_dem
from uavcover.run.plan import PlanRequest, plan_into
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site

SIZE_M = 400.0
# Latitude, longitude, system and pixels of the elevation model, ground at 0 in metres above sea level.
PLACES = {
    "Alps, UTM, 2,500 m": (46.55, 8.03, 32632, 10.0, 1900.0),
    "Alps, the Swiss grid": (46.55, 8.03, 2056, 10.0, 1000.0),
    "Tennessee, one arc second": (36.48, -84.22, 4326, 30.0, 0.0),
    "southern hemisphere, UTM": (-33.45, -70.62, 32719, 5.0, 0.0),
    "across 180 degrees": (-16.80, 180.0, 32760, 10.0, -300.0),
    "77 degrees south": (-77.52, 166.60, 3031, 10.0, -300.0),
    "78 degrees north, degrees": (78.22, 15.60, 4326, 30.0, -400.0),
}


def square_parts(place, hole=True):
    """A square of SIZE_M with a hole, in longitude and latitude."""
    lat, lon = PLACES[place][:2]
    half = 0.5 * SIZE_M / 111_195.0
    across = half / np.cos(np.radians(lat))
    inner = [(lon + 0.3 * x * across, lat + 0.3 * y * half) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    outer = [(lon + x * across, lat + y * half) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    wrapped = [[(x - 360.0 if x > 180.0 else x, y) for x, y in ring] for ring in (outer, inner)]
    return [shapely.Polygon(wrapped[0], [wrapped[1]] if hole else [])]


def dem_at(folder, place, *, steepest=0.35):
    lat, lon, epsg, pixel_m, level_m = PLACES[place]
    lon = 179.95 if lon == 180.0 and epsg == 4326 else lon
    path = write_dem(
        folder / "dem.tif", np.random.default_rng(3), lat_deg=lat, lon_deg=lon, epsg=epsg, pixel_m=pixel_m, size_m=1600.0,
        steepest=steepest,
    )  # fmt: skip
    with rasterio.open(path, "r+") as file:
        file.write(file.read(1) + np.float32(level_m), 1)
    return path


def options(dem, *, camera="dji-m3e", gsd="3cm"):
    return ("--dem", dem, "--camera", camera, "--gsd", gsd)


@pytest.fixture(scope="module")
def tennessee(tmp_path_factory):
    """A folder with an elevation model and areas around 36.48 N, 84.22 W."""
    folder = tmp_path_factory.mktemp("tennessee")
    dem_at(folder, "Tennessee, one arc second")
    parts = square_parts("Tennessee, one arc second")
    written.kml(folder / "area.kml", parts)
    written.geojson(folder / "area.geojson", parts)
    return folder


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("form", ["kml", "geojson"])
@pytest.mark.thinned(strength=1)
def test_a_foreign_place_is_one_command(cli, tmp_path, place, form):
    dem = dem_at(tmp_path, place)
    area = getattr(written, form)(tmp_path / f"area.{form}", square_parts(place))
    ended = cli("new", area, *options(dem), "--battery", "25min", "-o", tmp_path / "survey.toml", "--json")
    assert ended.code == 0, ended.err
    site = load_site(tmp_path / "survey.toml")
    document = ended.document
    assert document["area_m2"] == pytest.approx(SIZE_M**2 * (1.0 - 0.09), rel=0.02)
    assert site.area.area == pytest.approx(document["seen_area_m2"])
    assert document["pictures"] > 50
    assert 60.0 < document["flight_time_s"] < 3600.0
    assert document["batteries"] >= 1
    assert site.home_m is not None
    # The take-off place is at the edge of the area that was drawn, on the lowest level ground.
    drawn = site.area.buffer(-document["margin_m"], join_style="mitre").exterior
    assert drawn.distance(shapely.Point(site.home_m[:2])) < 3.0
    assert abs(site.ground.gradients(site.home_m[None, :2])).max() < 0.36


def test_every_key_has_its_reason_and_the_file_is_whole(cli, tennessee, tmp_path):
    path = tmp_path / "survey.toml"
    assert cli("new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path).code == 0
    text = path.read_text(encoding="utf-8")
    for line in text.splitlines():
        if " = " in line and not line.startswith("#"):
            assert " # " in line, line
    keys = tomllib.loads(text)
    assert keys["select"] == "coverage>=0.98"
    assert keys["requirements"]["min_coverage_of_coverable"] == 0.98
    assert keys["sensor"]["forward_overlap"] == 0.75
    assert keys["sensor"]["side_overlap"] == 0.7
    assert keys["sensor"]["max_ground_sample_m"] == 0.03
    assert load_scenario(path).area.parts


def test_what_was_derived_is_told(cli, tennessee, tmp_path):
    ended = cli(
        "new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "--battery", "25min", "-o", tmp_path / "a.toml"
    )
    for words in (
        "height band",
        "picture distance",
        "line distance",
        "pictures",
        "batter",
        "home",
        "Next: uavcover plan",
    ):
        assert words in ended.out, ended.out
    assert "does not say what its heights refer to" in ended.err


def test_a_file_that_is_there_is_never_replaced_unasked(cli, tennessee, tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("mine", encoding="utf-8")
    arguments = ("new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path)
    assert cli(*arguments).code == 2
    assert path.read_text(encoding="utf-8") == "mine"
    assert cli(*arguments, "--force").code == 0
    assert load_scenario(path).name == "field-1"


def test_boxes_circles_and_text(cli, tennessee, tmp_path):
    areas = {
        "circle": "36.48,-84.22,180m", "box": "-84.222,36.479,-84.218,36.481",
        "wkt": "POLYGON ((-84.222 36.479, -84.218 36.479, -84.218 36.481, -84.222 36.479))",
    }  # fmt: skip
    for name, area in areas.items():
        path = tmp_path / f"{name}.toml"
        ended = cli(
            "new", area, *options(tennessee / "dem.tif"), "--margin", "0", "-o", path, "--vertical-datum", "egm2008"
        )
        assert ended.code == 0, ended.err
        scenario = load_scenario(path)
        assert scenario.area.margin_m == 0.0
        assert scenario.terrain.vertical_datum == "EGM2008"


def test_options_of_the_vehicle_reach_the_scenario(cli, tennessee, tmp_path):
    path = tmp_path / "a.toml"
    ended = cli(
        "new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path, "--vehicle", "PX4",
        "--home", "36.4795,-84.2205", "--max-height", "80m", "--mount", "fixed", "--overlap", "80/60", "--speed", "4m/s",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    scenario = load_scenario(path)
    assert (scenario.vehicle.autopilot, scenario.vehicle.cruise_speed_m_s) == ("px4", 4.0)
    assert (scenario.home.lat_deg, scenario.home.lon_deg) == (36.4795, -84.2205)
    assert scenario.limits.max_height_agl_m == 80.0
    assert scenario.sensor.mount == "fixed"
    assert (scenario.sensor.forward_overlap, scenario.sensor.side_overlap) == (0.8, 0.6)


def test_lists(cli):
    ended = cli("new", "--camera", "list")
    assert ended.code == 0
    assert "sony-a7r4-35mm" in ended.out
    assert "unknown" in ended.out
    assert "dji-m350-rtk" in cli("new", "--vehicle", "list", "--json").document["vehicles"]


def with_lake(folder, place, *, half_m):
    """The elevation model with a square without data in the middle."""
    path = dem_at(folder, place, steepest=0.2)
    with rasterio.open(path, "r+") as file:
        values = file.read(1)
        middle, half = len(values) // 2, round(half_m / PLACES[place][3])
        values[middle - half : middle + half, middle - half : middle + half] = -9999.0
        file.nodata = -9999.0
        file.write(values, 1)
    return path


LAKE_PLACE = "southern hemisphere, UTM"


def test_a_lake_in_a_hole_does_not_matter(cli, tmp_path):
    dem = with_lake(tmp_path, LAKE_PLACE, half_m=50.0)
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_PLACE))
    ended = cli("new", area, *options(dem), "-o", tmp_path / "s.toml")
    assert ended.code == 0, ended.err
    assert "gaps in holes of the area" in ended.err
    site = load_site(tmp_path / "s.toml")
    assert 100.0 <= site.scenario.terrain.fill_no_data_m <= 150.0
    assert np.isfinite(site.ground.heights_m(site.area.centroid.coords[0])).all()


def test_a_lake_in_the_area_is_asked_about(cli, tmp_path):
    dem = with_lake(tmp_path, LAKE_PLACE, half_m=50.0)
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_PLACE, hole=False))
    ended = cli("new", area, *options(dem), "-o", tmp_path / "s.toml")
    assert ended.code == 2
    assert "inside the area; --fill-lakes 130m interpolates the gap; or cut it out of the area" in ended.error
    assert cli("new", area, *options(dem), "-o", tmp_path / "s.toml", "--fill-lakes", "130m").code == 0
    assert load_scenario(tmp_path / "s.toml").terrain.fill_no_data_m == 130.0


def test_tiles_bands_and_feet_reach_the_scenario(cli, tmp_path):
    dem = dem_at(tmp_path, LAKE_PLACE, steepest=0.2)
    with rasterio.open(dem) as file:
        values, profile = file.read(1), file.profile
    (tmp_path / "tiles").mkdir()
    half = len(values) // 2
    for name, rows in (("north", slice(0, half + 1)), ("south", slice(half, None))):
        part = values[rows].astype(np.float64) / 0.3048
        own = {
            **profile, "count": 2, "dtype": "float64", "height": len(part),
            "transform": profile["transform"] @ Affine.translation(0, rows.start),
        }  # fmt: skip
        with rasterio.open(tmp_path / "tiles" / f"{name}.tif", "w", **own) as out:
            out.write(np.zeros_like(part), 1)
            out.write(part, 2)
            out.set_band_description(2, "Elevation")
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_PLACE))
    ways = (
        ("--dem", tmp_path / "tiles"),
        ("--dem", tmp_path / "tiles" / "north.tif", "--dem", tmp_path / "tiles" / "south.tif"),
    )
    for number, dems in enumerate(ways):
        path = tmp_path / f"{number}.toml"
        ended = cli(
            "new",
            area,
            *dems,
            "--camera",
            "m3e",
            "--gsd",
            "3cm",
            "--band",
            "elevation",
            "--height-unit",
            "FT",
            "-o",
            path,
        )
        assert ended.code == 0, ended.err
        assert cli("new", area, *options(dem), "-o", tmp_path / "whole.toml", "--force").code == 0
        tiles, whole = load_site(path), load_site(tmp_path / "whole.toml")
        places = np.random.default_rng(1).uniform(-250.0, 250.0, (500, 2))
        assert np.allclose(tiles.ground.heights_m(places), whole.ground.heights_m(places), atol=1e-3)
    ended = cli("new", area, *ways[0], "--camera", "m3e", "--gsd", "3cm", "--band", "dtm", "-o", tmp_path / "b.toml")
    assert "has no band 'dtm'; terrain.band is one of: 1, 2 Elevation" in ended.error


BAD = {
    "nothing": ((), "give an area, such as area.kml"),
    "no options": (("AREA",), "an area needs --dem dem.tif, --camera NAME, --gsd 2.5cm as well"),
    "no camera": (("AREA", "--dem", "DEM"), "an area needs --camera NAME, --gsd 2.5cm as well"),
    "no such area": (("nowhere.kml", "OPTIONS"), "no such file; an area is a file"),
    "not an area": (("DEM", "OPTIONS"), ".tif is not a format of areas"),
    "no such model": (
        ("AREA", "--dem", "no.tif", "--camera", "m3e", "--gsd", "3cm"),
        "no.tif: no such file; give the elevation data",
    ),
    "a model that is none": (
        ("AREA", "--dem", "AREA", "--camera", "m3e", "--gsd", "3cm"),
        "cannot be read as elevation data",
    ),
    "a picture": (
        ("AREA", "--dem", "PICTURE", "--camera", "m3e", "--gsd", "3cm"),
        "is a picture (3 bands of 8 bits), not heights",
    ),
    "camera": (("AREA", "--dem", "DEM", "--camera", "dji-m33e", "--gsd", "3cm"), "did you mean dji-m3e"),
    "gsd without unit": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "3"), "has no unit; write it as 2.5cm"),
    "gsd": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "fine"), "is not understood; write it as 2.5cm"),
    "gsd too fine": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "1mm"), "ask for 0.67 cm or more"),
    "overlap": (("AREA", "OPTIONS", "--overlap", "0.75/0.7"), "write it in percent, as 75/70"),
    "overlap of everything": (("AREA", "OPTIONS", "--overlap", "100/70"), "is outside 0 to 95 percent"),
    "too much overlap": (
        ("AREA", "--dem", "DEM", "--camera", "mini 3 pro", "--gsd", "1cm", "--overlap", "95/70"),
        "ask for less forward overlap, a coarser --gsd",
    ),
    "battery": (("AREA", "OPTIONS", "--battery", "25"), "has no unit; write it as 25min"),
    "negative battery": (("AREA", "OPTIONS", "--battery", "-5min"), "must be above 0"),
    "vehicle": (("AREA", "OPTIONS", "--vehicle", "dji"), "did you mean dji-m3e"),
    "home": (("AREA", "OPTIONS", "--home", "here"), "write it as LAT,LON in degrees"),
    "home swapped": (
        ("AREA", "OPTIONS", "--home", "-84.22,36.48"),
        "km are allowed; give a place beside it, latitude first",
    ),
    "home elsewhere": (("AREA", "OPTIONS", "--home", "36.9,-84.22"), "km are allowed"),
    "max height": (("AREA", "OPTIONS", "--max-height", "10m"), "leaves no height band"),
    "speed": (("AREA", "OPTIONS", "--speed", "fast"), "write it as 8m/s"),
    "speed beyond the vehicle": (
        ("AREA", "OPTIONS", "--vehicle", "px4", "--speed", "50km/h"),
        "is more than the 12 m/s of px4",
    ),
    "margin": (("AREA", "OPTIONS", "--margin", "some"), "write it as 40m"),
    "mount": (("AREA", "OPTIONS", "--mount", "loose"), "give stabilised (a gimbal) or fixed"),
    "datum": (("AREA", "OPTIONS", "--vertical-datum", "NN"), "give EGM96 (SRTM) or EGM2008 (Copernicus)"),
    "autopilot": (("AREA", "OPTIONS", "--autopilot", "dji"), "neither ardupilot nor px4"),
    "height unit": (("AREA", "OPTIONS", "--height-unit", "yard"), "give m, ft or us-ft"),
    "band": (("AREA", "OPTIONS", "--band", "7"), "has no band '7'; terrain.band is one of: 1"),
    "lakes": (("AREA", "OPTIONS", "--fill-lakes", "all"), "write it as 200m"),
    "no tiles": (("AREA", "--dem", "none/*.hgt", "--camera", "m3e", "--gsd", "3cm"), "none/*.hgt has no tile"),
    "feature": (("AREA", "OPTIONS", "--feature", "feild 1"), "did you mean 'field 1'?"),
    "layer": (("AREA", "OPTIONS", "--layer", "x"), "leave the option out"),
    "crs": (("AREA", "OPTIONS", "--crs", "EPSG:x"), "write it as EPSG:32632"),
    "elsewhere": (("46.5,8.0,200", "OPTIONS"), "off the elevation data"),
    "beyond the model": (("36.48,-84.22,5km", "OPTIONS"), "reaches beyond the elevation data"),
    "too large": (("36.48,-84.22,40km", "OPTIONS"), "km by"),
    "swapped": (("SWAPPED", "OPTIONS"), "its axes are swapped: use --swap-axes"),
    "no folder": (("AREA", "OPTIONS", "-o", "no/where/a.toml"), "there is no folder"),
    "no scenario": (("AREA", "OPTIONS", "-o", "a.kml"), "is not a .toml file"),
    "unknown option": (("AREA", "OPTIONS", "--gds", "3"), "No such option"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_one_line_with_a_remedy(cli, tennessee, tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    arguments, words = BAD[what]
    swapped = [shapely.transform(part, lambda p: p[:, ::-1]) for part in square_parts("Tennessee, one arc second")]
    if what == "swapped":
        # 36 degrees east of Greenwich and 84 degrees south is a place too: only the elevation model knows better.
        written.geojson(tmp_path / "swapped.geojson", swapped)
    if what == "a picture":
        picture = np.zeros((3, 8, 8), dtype=np.uint8)
        with rasterio.open(
            tmp_path / "photo.tif", "w", driver="GTiff", width=8, height=8, count=3, dtype="uint8", crs="EPSG:4326",
            transform=Affine(0.025, 0.0, -84.3, 0.0, -0.025, 36.6),
        ) as file:  # fmt: skip
            file.write(picture)
    names = {
        "AREA": (tennessee / "area.kml",), "DEM": (tennessee / "dem.tif",), "OPTIONS": options(tennessee / "dem.tif"),
        "SWAPPED": (tmp_path / "swapped.geojson",), "PICTURE": (tmp_path / "photo.tif",),
    }  # fmt: skip
    ended = cli("new", *(each for argument in arguments for each in names.get(argument, (argument,))))
    assert ended.code == 2, ended.err
    lines = [line for line in ended.err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1, ended.err
    assert words in lines[0]
    assert not list(tmp_path.glob("*.toml"))


ODD = (
    "", " ", "-", "0", "-1", "nan", "inf", "1e999", "1e-999cm", "\u0661cm", "2.5 cm", "75/70/", "//", "a/b", "36.48,-84.22",
    "36.48;-84.22", "90,180", "-90,-180", "list", "LIST", ".toml", "..", "/", "EPSG:0", "EPSG:4978", "EPSG:27700", "1",
    "999999999999", "m", "ft", "fixed", "px4", "EGM96", "x" * 5000, "\u0000", "%s{}", "--", "0m", "400ft", "1h", "3kn",
)  # fmt: skip
TAKING = (
    "--camera", "--gsd", "--overlap", "--battery", "--vehicle", "--home", "--max-height", "--speed", "--margin", "--mount",
    "--vertical-datum", "--height-unit", "--band", "--fill-lakes", "--layer", "--feature", "--crs", "--autopilot", "--dem",
)  # fmt: skip


@pytest.mark.parametrize("seed", range(80))
def test_no_odd_value_leaves_a_trace(cli, tennessee, tmp_path, monkeypatch, seed):
    """One to three options with odd values beside good ones: a scenario that loads, or one line."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(seed)
    arguments = {"--dem": tennessee / "dem.tif", "--camera": "m3e", "--gsd": "3cm"}
    for option in rng.choice(TAKING, size=int(rng.integers(1, 4)), replace=False):
        arguments[str(option)] = ODD[int(rng.integers(len(ODD)))]
    area = tennessee / "area.kml" if seed % 4 else ODD[int(rng.integers(len(ODD)))]
    ended = cli("new", area, *(each for pair in arguments.items() for each in pair), "-o", "s.toml")
    assert ended.code in (0, 2), (arguments, ended.err)
    assert "Traceback" not in ended.err
    lines = [line for line in ended.err.splitlines() if not line.lower().startswith("warning")]
    assert len(lines) == (ended.code == 2), ended.err
    if ended.code == 0 and "list" not in arguments.values():
        assert load_scenario(tmp_path / "s.toml")


def test_plan_takes_an_area_and_leaves_a_scenario_of_its_own(cli, tennessee, tmp_path):
    run = tmp_path / "run"
    ended = cli(
        "plan", tennessee / "area.kml", *options(tennessee / "dem.tif"), "--margin", "0", "--overlap", "60/50", "-o", run,
        "--evaluations", 50,
    )  # fmt: skip
    assert ended.code == 0, ended.err
    assert (run / "mission.waypoints").exists()
    again = load_scenario(run / "scenario.toml")
    assert again.sensor.side_overlap == 0.5
    assert cli("plan", "jacksboro", "--gsd", "3cm", "-o", tmp_path / "b").error == (
        "error: jacksboro: is a scenario; --gsd go with an area, such as area.kml"
    )
    assert "an area needs --dem dem.tif" in cli("plan", tennessee / "area.kml", "-o", tmp_path / "c").error


def pictures_per_place(site, route_m, every_m, places):
    """How many pictures show each place, counted without the project's own geometry: pin-hole cameras that look straight down."""
    sensor = site.scenario.sensor
    across, along = (np.tan(np.radians(0.5 * angle)) for angle in (sensor.fov_across_deg, sensor.fov_along_deg))
    ground = site.ground.heights_m(places)
    counts = np.zeros(len(places), dtype=int)
    to_go = 0.0
    for begin, end in itertools.pairwise(route_m):
        length = float(np.linalg.norm(end - begin))
        ahead = (end - begin)[:2] / max(float(np.linalg.norm((end - begin)[:2])), 1e-9)
        while to_go <= length:
            eye = begin + (end - begin) * (to_go / max(length, 1e-9))
            offset, depth = places - eye[:2], eye[2] - ground
            counts += (np.abs(offset @ ahead) <= along * depth) & (
                np.abs(offset @ [ahead[1], -ahead[0]]) <= across * depth
            )
            to_go += every_m
        to_go -= length
    return counts


@pytest.mark.parametrize(("overlap", "needed", "hole"), [("75/70", 4 * 3, True), ("60/50", 2 * 2, False)])
def test_the_overlap_that_was_asked_for_holds_up_to_the_edge(cli, tmp_path, overlap, needed, hole):
    """At least floor(1 / (1 - f)) pictures along the line times floor(1 / (1 - s)) lines on 99 % of what was drawn."""
    place = "southern hemisphere, UTM"
    dem, area = dem_at(tmp_path, place), written.kml(tmp_path / "a.kml", square_parts(place, hole=hole))
    assert cli("new", area, *options(dem), "--overlap", overlap, "-o", tmp_path / "s.toml").code == 0
    site = load_site(tmp_path / "s.toml")
    request = PlanRequest(
        scenario=site, folder=tmp_path / "run", command=["test"], force=False, evaluations=50, workers=1
    )  # fmt: skip
    outcome = plan_into(request, Unattended(), check_site=lambda _: None)
    (part,) = square_parts(place, hole=hole)
    drawn = shapely.transform(part, lambda p: site.frame.enu_from_geodetic(p[:, 1], p[:, 0], 0.0)[:, :2])
    west, south, east, north = drawn.bounds
    places = np.stack(np.meshgrid(np.arange(west, east, 9.0), np.arange(south, north, 9.0)), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(drawn, places[:, 0], places[:, 1])]
    sensor, limits = site.scenario.sensor, site.scenario.limits
    length_m = 2.0 * np.tan(np.radians(0.5 * sensor.fov_along_deg)) * limits.min_height_agl_m
    counts = pictures_per_place(
        site, outcome.plan.chosen.route.waypoints_m, (1.0 - sensor.forward_overlap) * length_m, places
    )
    assert float((counts >= needed).mean()) >= 0.99
