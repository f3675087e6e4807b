"""[fleet] and several [[vehicle]]."""

import dataclasses
import re
from pathlib import Path

import pytest

from tests.scenario.scenario_texts import GOOD, parse, refused
from uavcover.model.area import Outline
from uavcover.model.limits import Home
from uavcover.model.vehicle import Fleet, Vehicle
from uavcover.scenario.scenario_file import dump_scenario


def test_equal_vehicle_tables_are_a_fleet():
    table = "[vehicle]\ncruise_speed_m_s = 10.0\n"
    assert GOOD.count(table) == 1
    three = GOOD.replace(table, 3 * table.replace("[vehicle]", "[[vehicle]]"))
    scenario = parse(three)
    assert scenario == dataclasses.replace(parse(GOOD), fleet=Fleet(vehicles=3))
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario
    with_settings = parse(three + "\n[fleet]\nseparation_m = 40.0\nvehicles = 3\n")
    assert with_settings.fleet == Fleet(vehicles=3, separation_m=40.0)


def test_vehicles_that_differ_are_listed_with_their_homes():
    tables = "[[vehicle]]\nendurance_s = 900\n[[vehicle]]\nhome = { lat_deg = 36.474, lon_deg = -84.216 }\n"
    scenario = parse(GOOD.replace("[vehicle]\ncruise_speed_m_s = 10.0\n", tables))
    home, other = parse(GOOD).home, Home(lat_deg=36.474, lon_deg=-84.216)
    assert scenario.vehicles == (Vehicle(endurance_s=900.0, home=home), Vehicle(home=other))
    assert (scenario.vehicle, scenario.home, scenario.fleet.vehicles) == (Vehicle(endurance_s=900.0), home, 2)
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario
    # Without [home] the first one's is that of the frame.
    first, second = "lat_deg = 36.476, lon_deg = -84.215", "lat_deg = 36.474, lon_deg = -84.216"
    own = f"[[vehicle]]\nhome = {{ {first} }}\n[[vehicle]]\nhome = {{ {second} }}\n"
    text = re.sub(r"\[home\]\n(?:\w+ = .*\n)+", "", GOOD).replace("[vehicle]\ncruise_speed_m_s = 10.0\n", own)
    assert parse(text).home == Home(lat_deg=36.476, lon_deg=-84.215)
    with pytest.raises(ValueError, match=r"there are 2 different \[\[vehicle\]\] tables"):
        dataclasses.replace(scenario, fleet=Fleet(vehicles=3))


def test_launch_points_are_places_of_one_vehicle_that_flies_one_flight_at_a_time():
    point = "\n[[launch_point]]\nlat_deg = 36.474\nlon_deg = -84.216\n"
    scenario = parse(GOOD + point)
    home, other = parse(GOOD).home, Home(lat_deg=36.474, lon_deg=-84.216)
    assert [vehicle.home for vehicle in scenario.vehicles] == [home, other]
    assert scenario.fleet == Fleet(vehicles=2, one_at_a_time=True)
    assert scenario.has_launch_points
    assert (scenario.home, scenario.vehicle) == (home, parse(GOOD).vehicle)
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario
    # Its one link is that of every place.
    table = "[vehicle]\ncruise_speed_m_s = 10.0\n"
    linked = parse(GOOD.replace(table, table + 'link = "udpin://127.0.0.1:14550"\n') + point)
    assert {vehicle.link for vehicle in linked.vehicles} == {"udpin://127.0.0.1:14550"}
    # Vehicles that differ may also fly one at a time; they are several.
    two = GOOD.replace(table, "[[vehicle]]\n[[vehicle]]\nendurance_s = 900\n[fleet]\none_at_a_time = true\n")
    assert not parse(two).has_launch_points


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("[[launch_point]]\nlat_deg = 'x'\nlon_deg = 3\n", "launch_point.0.lat_deg: must be a finite number"),
        (
            "[[launch_point]]\nlat_deg = 95.0\nlon_deg = 3\n",
            "launch_point.0.lat_deg: must be between -90 and 90, not 95.0",
        ),
        ("[[launch_point]]\nlat = 3.0\nlon_deg = 3.0\n", "launch_point.0.lat: unknown key (did you mean lat_deg?)"),
        ("[[launch_point]]\nlat_deg = 36.4\n", "launch_point.0: specify lat_deg and lon_deg"),
        ("[[launch_point]]\neast_m = 1.0\nnorth_m = 2.0\n", "launch_point.0: specify lat_deg and lon_deg"),
        (
            "[launch_point]\nlat_deg = 36.4\n",
            "launch_point: write one [[launch_point]] table with lat_deg and lon_deg for",
        ),
        (
            2 * "[[launch_point]]\nlat_deg = 36.474\nlon_deg = -84.216\n",
            "launch_point.1: duplicates an earlier position",
        ),
        (
            "[[launch_point]]\nlat_deg = 36.474\nlon_deg = -84.216\n[fleet]\nvehicles = 2\n",
            "launch_point: launch points are supported for only one [vehicle]; define a home for each",
        ),
        (
            "[[launch_point]]\nlat_deg = 36.474\nlon_deg = -84.216\n[fleet]\none_at_a_time = false\n",
            "fleet.one_at_a_time: remove this key, because one vehicle with launch points always flies one sortie at a time",
        ),
        (
            "[fleet]\none_at_a_time = true\n",
            "fleet.one_at_a_time: this key applies to different vehicles, or to one vehicle with launch",
        ),
    ],
)
def test_mistakes_in_launch_points(tables, words):
    assert words in refused(text=GOOD + "\n" + tables)


def test_launch_points_need_a_home():
    text = re.sub(r"\[home\]\n(?:\w+ = .*\n)+", "", GOOD) + "\n[[launch_point]]\nlat_deg = 36.474\nlon_deg = -84.216\n"
    assert "launch_point: launch points require a [home]" in refused(text=text)


def test_a_vehicles_own_part_is_an_outline_as_the_area_is(tmp_path):
    ring = "[[-84.22, 36.47], [-84.215, 36.47], [-84.215, 36.48], [-84.22, 36.48]]"
    closed = ring[:-1] + ", [-84.22, 36.47]]"
    (tmp_path / "part.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{closed}]}}')
    given = parse(
        GOOD.replace("[vehicle]\n", f"[[vehicle]]\n[vehicle.area]\npolygon_lon_lat_deg = {ring}\n[[vehicle]]\n")
    )
    outline = Outline(polygon_lon_lat_deg=((-84.22, 36.47), (-84.215, 36.47), (-84.215, 36.48), (-84.22, 36.48)))
    assert [vehicle.area for vehicle in given.vehicles] == [outline, None]
    assert given.vehicle.area is None
    assert parse(dump_scenario(given), Path("/elsewhere")) == given
    for key in ("geojson", "file"):
        tables = f'[[vehicle]]\narea = {{ {key} = "part.geojson" }}\n[[vehicle]]\n'
        read = parse(GOOD.replace("[vehicle]\n", tables), tmp_path).vehicles[0].area
        assert read is not None
        assert read.file is None  # what the scenario says later does not depend on the file
        assert set(read.polygon_lon_lat_deg or ()) == set(outline.polygon_lon_lat_deg or ())


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ("[[vehicle]]\n[[vehicle]]\ncruise_speed_m_s = -1.0\n", "vehicle.1.cruise_speed_m_s: must be greater"),
        (
            "[[vehicle]]\n[[vehicle]]\nsensor = 1\n",
            "vehicle.1.sensor: must be a table with a kind ('sphere' or 'disc' or",
        ),
        (
            "[vehicle]\nsensor = 1\n",
            "vehicle.sensor: a single vehicle takes its sensor from [sensor]; use [[vehicle]] only for several vehicles",
        ),
        (
            "[[vehicle]]\n[[vehicle]]\nsensor = { fov_deg = 3.0 }\n",
            "vehicle.1.sensor.kind: the key is missing; set it to 'sphere' or",
        ),
        ("[[vehicle]]\n[[vehicle]]\nsensor = { kind = 'lidar' }\n", "vehicle.1.sensor.kind: must be 'sphere' or"),
        (
            "[[vehicle]]\n[[vehicle]]\nsensor = { kind = 'nadir-camera', fov_deg = 190.0, range_m = 200.0 }\n",
            "vehicle.1.sensor.fov_deg: must be between 0 and 180 degrees, not 190.0",
        ),
        (
            "[[vehicle]]\n[[vehicle]]\nsensor = { kind = 'nadir-camera', fov_deg = 60.0, range_m = 200.0, fov = 3.0 }\n",
            "vehicle.1.sensor.fov: unknown key",
        ),
        (
            "[[vehicle]]\n[[vehicle]]\nsensor = { kind = 'nadir-camera', fov_deg = 60.0, range_m = 20.0 }\n",
            "vehicle.1.sensor.range_m: 20.0 m does not reach the ground from limits.min_height_agl_m",
        ),
        ("[[vehicle]]\n[[vehicle]]\nlinks = 'udp:127.0.0.1:1'\n", "vehicle.1.links: unknown key"),
        ("[[vehicle]]\nhome = { lat_deg = 36.4 }\n[[vehicle]]\n", "vehicle.0.home: specify lat_deg and lon_deg"),
        (
            "[[vehicle]]\n[[vehicle]]\nhome = { east_m = 1.0, north_m = 2.0 }\n",
            "vehicle.1.home: specify lat_deg and lon_deg",
        ),
        (
            2 * "[[vehicle]]\nhome = { lat_deg = 36.474, lon_deg = -84.216 }\n",
            "home: every [[vehicle]] has its own home; remove [home]",
        ),
        (
            "[vehicle]\nhome = { lat_deg = 36.474, lon_deg = -84.216 }\n",
            "vehicle.home: a single vehicle takes its home from [home]",
        ),
        (
            "[[vehicle]]\nhome = { lat_deg = 36.474, lon_deg = -84.216 }\n",
            "vehicle.0.home: a single vehicle takes its home from",
        ),
        (
            "[vehicle]\narea = { file = 'a.kml' }\n",
            "vehicle.area: a single vehicle covers the whole [area]; use [[vehicle]] only for",
        ),
        ("[[vehicle]]\narea = { file = 'a.kml' }\n", "vehicle.0.area: a single vehicle covers the whole [area]"),
        ("[[vehicle]]\narea = { file = 'a.kml' }\n[[vehicle]]\n", "vehicle.0.area.file: "),
        ("[[vehicle]]\narea = { geojson = 'a.json' }\n[[vehicle]]\n", "vehicle.0.area.geojson: "),
        ("[[vehicle]]\narea = {}\n[[vehicle]]\n", "vehicle.0.area: specify exactly one of polygon_lon_lat_deg"),
        ("[[vehicle]]\narea = 3\n[[vehicle]]\n", "vehicle.0.area: must be a table, not 3"),
        (
            "[[vehicle]]\narea = { cell_size_m = 3.0 }\n[[vehicle]]\n",
            "vehicle.0.area.cell_size_m: unknown key (it belongs in",
        ),
        (
            "[[vehicle]]\narea = { polygon_lon_lat_deg = [[1.0, 2.0], [1.0, 2.0], [3.0, 4.0]] }\n[[vehicle]]\n",
            "vehicle.0.area.polygon_lon_lat_deg: a ring needs at least 3 different corners, but this one has 2",
        ),
        (
            "[[vehicle]]\narea = { polygon_lon_lat_deg = [[nan, 2.0], [1.0, 2.0], [3.0, 4.0]] }\n[[vehicle]]\n",
            "vehicle.0.area.polygon_lon_lat_deg.0.0: must be a finite number",
        ),
        (
            "[[vehicle]]\narea = { polygon_lon_lat_deg = [[36.47, -184.2], [36.48, -184.2], [36.48, -184.21]] }\n[[vehicle]]\n",
            "vehicle.0.area: polygon_lon_lat_deg: (36.47, -184.2) is not a longitude and latitude",
        ),
        ("[[vehicles]]\n", "vehicles: unknown key; write one [[vehicle]] table for each vehicle"),
        (
            "[wind]\nspeed_m_s = 3.0\n[[vehicle]]\nmax_airspeed_m_s = 15.0\n[[vehicle]]\n",
            "wind.speed_m_s: 3.0 m/s requires a larger vehicle.1.max_airspeed_m_s than none",
        ),
        (
            "[[vehicle]]\n[[vehicle]]\n[fleet]\nvehicles = 3\n",
            "fleet.vehicles: the value is 3, but there are 2 [[vehicle]] tables; use only one of the two",
        ),
        ("[[vehicle]]\ncruise = 1.0\n[[vehicle]]\ncruise = 1.0\n", "vehicle.cruise: unknown key"),
        ("vehicle = 3\n", "vehicle: must be a table, not 3"),
        ("vehicle = []\n", "vehicle: must be a table, not []"),
        ("[[vehicle]]\n[[vehicle]]\n[[fleet]]\n", "fleet: must be a table"),
        ("[fleet]\nvehicles = 0\n", "fleet.vehicles: must be between 1 and 50, not 0"),
        ("[fleet]\nvehicles = 2.5\n", "fleet.vehicles: must be a whole number"),
        ("[fleet]\nseparation_m = 0.0\n", "fleet.separation_m: must be greater"),
        ("[fleet]\nseparation_m = nan\n", "fleet.separation_m: must be a finite number"),
        ("[fleet]\nturnaround_s = -1.0\n", "fleet.turnaround_s: must not be negative"),
        ("[fleet]\ntiming_error_fraction = 5.0\n", "fleet.timing_error_fraction: must be between 0 and 0.5, not 5.0"),
    ],
)
def test_mistakes_in_a_fleet(tables, words):
    if tables.startswith("vehicle ="):
        text = tables + GOOD.replace("[vehicle]\ncruise_speed_m_s = 10.0\n", "")
    else:
        text = GOOD.replace("[vehicle]\ncruise_speed_m_s = 10.0\n", tables)
    assert words in refused(text=text)
