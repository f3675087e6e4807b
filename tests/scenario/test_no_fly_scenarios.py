"""No-fly zones and fences of several polygons in scenario files: keys, defaults, round trips, errors."""

import dataclasses
import json

import pytest
import shapely

from tests.planner.sites import make_site
from uavcover.errors import ScenarioError
from uavcover.model.limits import NoFly
from uavcover.scenario.scenario_file import dump_scenario, load_scenario, parse_scenario
from uavcover.scenario.site import build_site, load_site

FLAT = """
name = "flat"
[area]
polygon_east_north_m = [[0, 0], [200, 0], [200, 200], [0, 200]]
cell_size_m = 10.0
[terrain]
kind = "sine-cosine"
[home]
east_m = -50.0
north_m = 0.0
[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 200.0
[limits]
min_height_agl_m = 40.0
max_height_agl_m = 120.0
"""


def parse(text, folder):
    return parse_scenario(text, source="mine.toml", folder=folder)


def test_zones_in_metres(tmp_path):
    scenario = parse(
        FLAT
        + "[[no_fly]]\nname = 'mast'\ncenter_east_north_m = [100, 100]\nradius_m = 20\nceiling_agl_m = 90\n"
        + "[[no_fly]]\npolygon_east_north_m = [[50, 0], [60, 0], [60, 20]]\nmargin_m = 0\n",
        tmp_path,
    )
    mast, other = scenario.no_fly
    assert (mast.name, mast.radius_m, mast.ceiling_agl_m, mast.margin_m) == ("mast", 20.0, 90.0, 10.0)
    assert parse(dump_scenario(scenario), tmp_path) == scenario
    site = build_site(scenario)
    assert [zone.name for zone in site.zones] == ["mast", "no_fly 1"]
    assert site.zones[0].circle == (100.0, 100.0, 20.0)
    assert other.margin_m == 0.0


def test_a_file_is_taken_into_the_scenario(tmp_path):
    base = dump_scenario(load_scenario("jacksboro"))
    home = load_scenario("jacksboro").home
    ring = [[home.lon_deg + a, home.lat_deg + b] for a, b in ((0.002, 0.0), (0.004, 0.0), (0.004, 0.002), (0.002, 0.0))]
    (tmp_path / "zones.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    text = (
        base.split("[area]")[0]
        + "[[no_fly]]\nfile = 'zones.geojson'\nfloor_agl_m = 30.0\n[area]"
        + base.split("[area]")[1]
    )
    scenario = parse(text, tmp_path)
    (zone,) = scenario.no_fly
    assert zone.file is None
    assert zone.floor_agl_m == 30.0
    (local,) = load_site(scenario).zones
    lat, lon, _ = load_site(scenario).frame.geodetic_from_enu([[*local.outline.exterior.coords[1], 0.0]])
    assert [float(lon[0]), float(lat[0])] in [pytest.approx(corner, abs=1e-9) for corner in ring]


@pytest.mark.parametrize(
    ("window", "times", "counts"),
    [
        (None, 'from_utc = "2026-06-01T06:00Z"', True),
        ('["2026-06-01T08:00Z", "2026-06-01T09:00Z"]', "", True),
        ('["2026-06-01T08:00Z", "2026-06-01T09:00Z"]', 'until_utc = "2026-06-01T07:59Z"', False),
        ('["2026-06-01T08:00Z", "2026-06-01T09:00Z"]', 'until_utc = "2026-06-01T10:30+02:00"', True),
        ('["2026-06-01T08:00Z", "2026-06-01T09:00Z"]', 'from_utc = "2026-06-01T09:01Z"', False),
        ('["2026-06-01T08:00Z", "2026-06-01T09:00Z"]', 'from_utc = "2026-06-01T08:30Z"', True),
    ],
)
def test_zones_that_are_not_in_force_do_not_count(tmp_path, window, times, counts):
    top = "" if window is None else f"flight_window_utc = {window}\n"
    zone = f"[[no_fly]]\ncenter_east_north_m = [100, 100]\nradius_m = 20\n{times}\n"
    site = build_site(parse(top + FLAT + zone, tmp_path))
    assert bool(site.zones) == counts


CIRCLE = "[[no_fly]]\ncenter_east_north_m = [100, 100]\nradius_m = 20\n"


@pytest.mark.parametrize(
    ("zone", "message"),
    [
        ("[[no_fly]]\n", "no_fly.0: specify exactly one of file, polygon_lon_lat_deg"),
        (CIRCLE + "file = 'a.kml'\n", "no_fly.0: specify exactly one of file"),
        ("[[no_fly]]\ncenter_east_north_m = [100, 100]\n", "no_fly.0.radius_m: this key requires center_lon_lat_deg"),
        (CIRCLE.replace("20", "-20"), "no_fly.0.radius_m: must be greater"),
        (CIRCLE + "radus_m = 3\n", "no_fly.0.radus_m: unknown key (did you mean radius_m?)"),
        (CIRCLE + "floor_agl_m = 80\nceiling_agl_m = 50\n", "no_fly.0.ceiling_agl_m: must be greater than floor_agl_m = 80.0"),
        (CIRCLE + "from_utc = '2026-06-01'\n", "no_fly.0.from_utc: '2026-06-01' is not a valid time"),
        (CIRCLE + "from_utc = '2026-06-02T00:00Z'\nuntil_utc = '2026-06-01T00:00Z'\n", "until_utc: must be later than"),
        (CIRCLE + "ignore = ['a']\n", "no_fly.0.ignore: this key requires file"),
        (CIRCLE + "margin_m = -1\n", "no_fly.0.margin_m: must not be negative"),
        ("[[no_fly]]\nname = 'bow'\npolygon_east_north_m = [[0, 0], [9, 9], [9, 0], [0, 9]]\n", "(bow): Self-intersection"),
        ("[[no_fly]]\npolygon_east_north_m = [[0, 0], [9, 9]]\n", "no_fly.0: a ring needs at least 3 different corners"),
        ("[[no_fly]]\npolygon_east_north_m = [[0, 0], [9, 9], [5, 5]]\n", "no_fly.0"),
        ("[[no_fly]]\npolygon_lon_lat_deg = [[8, 46], [8.1, 46], [8, 46.1]]\n", "longitudes and latitudes require an [origin]"),
        ("[[no_fly]]\npolygon_lon_lat_deg = [[8, 96], [8.1, 46], [8, 46.1]]\n", "is not a longitude and latitude"),
        ("[[no_fly]]\nfile = 'zones.geojson'\n", "no_fly: zones from a file require a position on Earth"),
    ],
)  # fmt: skip
def test_bad_zones_are_one_line(tmp_path, zone, message):
    with pytest.raises(ScenarioError) as error:
        parse(FLAT + zone, tmp_path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_names_its_key(tmp_path):
    text = dump_scenario(load_scenario("jacksboro")) + "\n[[no_fly]]\nfile = 'none.txt'\n"
    text = text.replace("no_fly = []\n", "")
    with pytest.raises(ScenarioError, match=r"no_fly.0.file: .*none.txt: no such file"):
        parse(text, tmp_path)


@pytest.mark.parametrize(
    ("window", "message"),
    [
        ('["2026-06-01T08:00Z", "2026-06-01T07:00Z"]', "flight_window_utc: the latest landing must be after"),
        ('["now", "later"]', "flight_window_utc: 'now' is not a valid time"),
    ],
)
def test_a_bad_window(tmp_path, window, message):
    with pytest.raises(ScenarioError, match=message):
        parse(f"flight_window_utc = {window}\n{FLAT}", tmp_path)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"polygon_east_north_m": ((-60.0, -10.0), (-40.0, -10.0), (-40.0, 10.0), (-60.0, 10.0))},
            "home: lies in no-fly zone 'x'",
        ),
        ({"center_east_north_m": (-45.0, 0.0), "radius_m": 6.0}, "home: lies in no-fly zone 'x'"),
        (
            {"center_east_north_m": (-35.0, 0.0), "radius_m": 6.0},
            "home: is 9.0 m from no-fly zone 'x', whose margin_m is 10 m",
        ),
        ({"center_east_north_m": (-45.0, 0.0), "radius_m": 6.0, "floor_agl_m": 0.0}, "home: lies in"),
        ({"center_east_north_m": (-45.0, 0.0), "radius_m": 6.0, "ceiling_agl_m": 10.0}, "home: lies in"),
        ({"center_east_north_m": (-45.0, 0.0), "radius_m": 6.0, "floor_agl_m": 60.0}, None),
        ({"center_east_north_m": (-30.0, 0.0), "radius_m": 6.0}, None),
    ],
)
def test_home_in_a_zone(tmp_path, keys, message):
    scenario = dataclasses.replace(parse(FLAT, tmp_path), no_fly=(NoFly(name="x", **keys),))
    if message is None:
        assert len(build_site(scenario).zones) == 1
        return
    with pytest.raises(ScenarioError, match=message):
        build_site(scenario)


L_OF_TWO = "[[[-100, -100], [400, -100], [400, 50], [-100, 50]], [[-100, 0], [50, 0], [50, 400], [-100, 400]]]"


def test_a_fence_of_several_polygons_is_their_union(tmp_path):
    text = FLAT.replace("[[0, 0], [200, 0], [200, 200], [0, 200]]", "[[0, 0], [40, 0], [40, 40], [0, 40]]")
    site = build_site(parse(f"{text}fence_polygons_east_north_m = {L_OF_TWO}\n", tmp_path))
    assert site.fence.area == pytest.approx(500 * 150 + 150 * 400 - 150 * 50)
    assert not site.fence.contains(shapely.Point(200, 200))


@pytest.mark.parametrize(
    ("fence", "message"),
    [
        ("fence_polygons_east_north_m = []", r"limits\.fence_polygons_east_north_m: the list is empty"),
        (
            "fence_polygons_east_north_m = [[[0, 0], [9, 9], [9, 0], [0, 9]]]",
            "limits.fence_polygons_east_north_m.0: Self-inter",
        ),
        (
            f"fence_polygons_east_north_m = {L_OF_TWO}\nfence_east_north_m = [[0, 0], [9, 0], [0, 9]]",
            "specify the fence only once",
        ),
    ],
)
def test_bad_fences_are_one_line(tmp_path, fence, message):
    with pytest.raises(ScenarioError, match=message):
        parse(FLAT + fence, tmp_path)


@pytest.mark.parametrize(
    "second", ["[[500, 0], [600, 0], [600, 100]]", "[[250, 250], [600, 250], [600, 600], [250, 600]]"]
)
def test_a_fence_in_pieces_is_refused(tmp_path, second):
    fence = f"fence_polygons_east_north_m = [[[-100, -100], [250, -100], [250, 250], [-100, 250]], {second}]"
    with pytest.raises(ScenarioError, match="the polygons form 2 separate parts, and no vehicle can fly between them"):
        build_site(parse(FLAT + fence, tmp_path))


def test_a_site_without_zones_has_none():
    assert make_site().zones == ()
