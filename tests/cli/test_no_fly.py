"""No-fly zones from the command line: a survey beside an airport, its files, and what is told."""

import json
import tomllib

import numpy as np
import pytest
import shapely

from mission_io.formats import plan as plan_format
from tests.cli.bad_inputs import dem_at, options, square_parts
from tests.naive.zones import in_zone
from tests.scenario.areas import written
from uavcover.cli.new import SurveyOptions
from uavcover.cli.options import Output
from uavcover.cli.plan import _site as site_of_plan
from uavcover.model.route import RouteMetrics
from uavcover.planner.plan_messages import print_zones
from uavcover.scenario.scenario_file import dump_scenario, load_scenario, parse_scenario
from uavcover.scenario.site import load_site

POSITIONS = ["across 180 degrees"]


def zones_near(position, folder):
    """ED-269: a circle inside of the area, a square at its corner, and one 100 km away."""
    (outline,) = square_parts(position, hole=False)
    ring = np.asarray(outline.exterior.coords)
    lons = np.where(ring[:, 0] < 0.0, ring[:, 0] + 360.0, ring[:, 0]) if np.ptp(ring[:, 0]) > 180.0 else ring[:, 0]
    lon, lat = float(lons[:-1].mean()), float(ring[:-1, 1].mean())
    across = float(np.ptp(lons))

    def wrapped(value):
        return value - 360.0 if value > 180.0 else value

    def volume(shape, **heights):
        return {
            "uomDimensions": "M",
            "lowerLimit": 0,
            "lowerVerticalReference": "AGL",
            **heights,
            "horizontalProjection": shape,
        }

    def zone(name, shape, **heights):
        return {"identifier": name, "name": name, "restriction": "PROHIBITED", "geometry": [volume(shape, **heights)]}

    corner = [
        (lon + a * across, lat + b * float(np.ptp(ring[:, 1])))
        for a, b in ((0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6))
    ]
    far = {"type": "Circle", "center": [wrapped(lon), lat + 0.9], "radius": 500}
    document = {
        "features": [
            zone("helipad", {"type": "Circle", "center": [wrapped(lon + 0.2 * across), lat], "radius": 40}),
            zone("prison", {"type": "Polygon", "coordinates": [[[wrapped(x), y] for x, y in corner]]}, upperLimit=300,
                 upperVerticalReference="AGL"),
            zone("far away", far),
        ]
    }  # fmt: skip
    path = folder / "zones.json"
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("position", POSITIONS)
def test_a_survey_beside_no_fly_zones_is_one_command(cli, tmp_path, position):
    dem = dem_at(tmp_path, position)
    area = written.geojson(tmp_path / "area.geojson", square_parts(position))
    zones = zones_near(position, tmp_path)
    ended = cli(
        "plan",
        area,
        *options(dem, gsd="6cm"),
        "--no-fly",
        zones,
        "--evaluations",
        "50",
        "--select",
        "max-coverage",
        "-o",
        tmp_path / "run",
        code=0,
    )
    assert "2 zones of" in ended.out
    assert "no-fly zone 'helipad'" in ended.out
    site = load_site(tmp_path / "run" / "scenario.toml")
    assert [zone.name for zone in site.zones] == ["helipad", "prison"]
    document = plan_format.read((tmp_path / "run" / "mission.plan").read_text())
    assert [polygon.inclusion for polygon in document.fence.polygons] == [True, False]
    assert [(circle.inclusion, circle.radius_m) for circle in document.fence.circles] == [(False, 40.0)]
    # Every place of the mission as a file, far more densely than anybody flies it.
    items = [item for item in document.mission.items if item.command in (16, 21, 22)]
    lats, lons = np.array([(item.lat_deg, item.lon_deg) for item in items]).T
    positions = site.frame.enu_from_geodetic(lats, lons, site.frame.alt_amsl_m)[:, :2]
    line = shapely.LineString(positions).segmentize(0.5)
    for zone in site.zones:
        for at in shapely.get_coordinates(line):
            assert not in_zone(zone, at, height_agl_m=60.0, alt_amsl_m=60.0, margin_m=9.9)
    keys = tomllib.loads((tmp_path / "run" / "scenario.toml").read_text())
    assert [zone["name"] for zone in keys["no_fly"]] == ["helipad", "prison"]


def test_new_writes_the_file_with_its_reason_and_home_is_outside(cli, tmp_path):
    position = POSITIONS[0]
    dem = dem_at(tmp_path, position)
    area = written.geojson(tmp_path / "area.geojson", square_parts(position))
    cli("new", area, *options(dem), "-o", tmp_path / "plain.toml", code=0)
    home = load_site(tmp_path / "plain.toml").scenario.home
    # A zone over the place that would have been chosen.
    ring = [
        [home.lon_deg + a, home.lat_deg + b]
        for a, b in ((-5e-4, -5e-4), (5e-4, -5e-4), (5e-4, 5e-4), (-5e-4, 5e-4), (-5e-4, -5e-4))
    ]
    zones = tmp_path / "zones.geojson"
    zones.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    cli("new", area, *options(dem), "--no-fly", zones, "-o", tmp_path / "survey.toml", code=0)
    text = (tmp_path / "survey.toml").read_text()
    assert 'file = "zones.geojson"' in text
    for line in text.splitlines():
        if " = " in line and not line.startswith("#"):
            assert " # " in line, line
    site = load_site(tmp_path / "survey.toml")
    assert site.zones[0].outline.distance(shapely.Point(site.home_m[:2])) >= 10.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file; use one of"),
        ("hello", "not an OpenAir file"),
        ("AC R\nAN x\nAL high\n", "line 3, zone x: 'high' is not a height"),
    ],
)
def test_a_bad_file_is_one_line(cli, tmp_path, content, message):
    dem = dem_at(tmp_path, POSITIONS[0])
    area = written.geojson(tmp_path / "area.geojson", square_parts(POSITIONS[0]))
    if content is not None:
        (tmp_path / "zones.txt").write_text(content)
    ended = cli("new", area, *options(dem), "--no-fly", tmp_path / "zones.txt", "-o", tmp_path / "survey.toml", code=2)
    assert "--no-fly: " in ended.error
    assert message in ended.error


def test_zones_go_with_an_area(cli, tmp_path):
    assert "--no-fly" in cli("plan", "jacksboro", "--no-fly", "zones.json", "-o", tmp_path / "run", code=2).error


def test_a_scenario_takes_more_zones_from_a_file(tmp_path):
    scenario = load_scenario("jacksboro")
    home = scenario.home
    ring = [[home.lon_deg + a, home.lat_deg + b] for a, b in ((1e-3, 1e-3), (3e-3, 1e-3), (3e-3, 3e-3), (1e-3, 1e-3))]
    zones = tmp_path / "zones.geojson"
    zones.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    site = site_of_plan("jacksboro", SurveyOptions(no_fly=[str(zones)]), Output().console(), autopilot=None)
    assert [zone.entry.margin_m for zone in site.zones] == [10.0]
    assert site.zones[0].outline.area == pytest.approx(
        0.5 * 2e-3**2 * 111_100.0**2 * np.cos(np.radians(home.lat_deg)), rel=0.01
    )
    # What the run folder keeps is the same again, without the file.
    zones.unlink()
    again = parse_scenario(dump_scenario(site.scenario), source="again", folder=tmp_path)
    assert again == site.scenario
    assert len(again.no_fly) == len(scenario.no_fly) + 1


def test_the_time_of_flight_decides_which_zones_count(tmp_path, capsys):
    home = load_scenario("jacksboro").home
    ring = [[home.lon_deg + a, home.lat_deg + b] for a, b in ((1e-3, 1e-3), (3e-3, 1e-3), (3e-3, 3e-3), (1e-3, 1e-3))]
    shape = {"type": "Polygon", "coordinates": [ring]}
    zones = tmp_path / "zones.geojson"
    zones.write_text(
        json.dumps({"type": "Feature", "properties": {"name": "fair", "active": "SAT,SUN"}, "geometry": shape})
    )

    def site(at):
        return site_of_plan("jacksboro", SurveyOptions(no_fly=[str(zones)], at=at), Output().console(), autopilot=None)

    for at, counts in ((None, True), ("2026-06-06T09:00Z", True), ("2026-06-05T09:00Z/3h", False)):
        found = site(at)
        assert [zone.name for zone in found.zones] == (["fair"] if counts else [])
        assert [zone.name for zone in found.other_zones] == ([] if counts else ["fair"])
        print_zones(Output().console(), found, RouteMetrics(1.0, 1.0, 4, 100.0, 10.0, 50.0, 60.0, 10.0))
        out = capsys.readouterr().out
        assert ("have schedules, but are treated as always active; set" in out) == (at is None)
        assert ("were ignored: 'fair'; fly only during this time" in out) == (not counts)
        # What the run folder keeps, the judge reads again.
        again = parse_scenario(dump_scenario(found.scenario), source="again", folder=tmp_path)
        assert again == found.scenario


def test_new_writes_the_time_of_flight(cli, tmp_path):
    position = POSITIONS[0]
    dem = dem_at(tmp_path, position)
    area = written.geojson(tmp_path / "area.geojson", square_parts(position))
    cli("new", area, *options(dem), "--at", "2026-07-01T09:00+02:00/90min", "-o", tmp_path / "survey.toml", code=0)
    assert load_scenario(tmp_path / "survey.toml").flight_window_utc == ("2026-07-01T07:00:00Z", "2026-07-01T08:30:00Z")


@pytest.mark.parametrize(
    "at",
    ["noon", "2026-07-01", "2026-07-01T09:00", "2026-07-01T09:00Z/", "2026-07-01T09:00Z/2", "2026-07-01T09:00Z/-2h",
     "2026-07-01T09:00Z/2026-07-01T08:00Z", "0001-01-01T00:00Z", "9999-12-31T23:59Z", "2026-07-01T09:00Z/99999999h", "/", "",
     "1e9", "2026-07-01T09:00Z/2026-07-01T10:00Z/2026-07-01T11:00Z"],
)  # fmt: skip
def test_a_time_of_flight_that_is_none_is_one_line(cli, tmp_path, at):
    assert cli("plan", "jacksboro", "--at", at, "-o", tmp_path / "run", code=2).error.startswith("error: --at: ")
    assert not (tmp_path / "run").exists()


def test_what_no_scenario_takes_is_one_line(cli, tmp_path):
    for arguments, message in (
        (("jacksboro", "--no-fly", tmp_path / "no.json"), "error: --no-fly: "),
        (
            ("paper-planar", "--no-fly", tmp_path / "no.json"),
            "error: --no-fly: scenario paper-planar has no position on Earth",
        ),
        (
            ("jacksboro", "--gsd", "3cm", "--no-fly", "x"),
            "error: jacksboro: this is a scenario; use --gsd with an area",
        ),
    ):
        assert cli("plan", *arguments, "-o", tmp_path / "run", code=2).error.startswith(message)
        assert not (tmp_path / "run").exists()
