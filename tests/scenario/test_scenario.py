import dataclasses
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.scenario.scenario_texts import GOOD, parse, refused
from uavcover.errors import ScenarioError
from uavcover.model.area import Area, RasterTerrain, SineCosineTerrain
from uavcover.model.limits import FlightLimits, Home
from uavcover.model.scenario import Origin, PlannerSettings, Requirements, Scenario
from uavcover.model.sensor import DiscSensor, NadirCamera, SphereSensor
from uavcover.model.vehicle import Fleet, Vehicle
from uavcover.scenario.scenario_file import bundled_scenarios, dump_scenario, load_scenario, terrain_source

deterministic = settings(derandomize=True, deadline=None, max_examples=60)


def test_the_bundled_scenarios_load_and_come_back_from_their_text():
    assert bundled_scenarios() == (
        "jacksboro",
        "paper-R2",
        "paper-planar",
        "paper-r1",
        "ridge-25km2",
        "ridge-obstacles",
    )
    for name in bundled_scenarios():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert parse(dump_scenario(scenario)) == scenario
    assert terrain_source(load_scenario("jacksboro").terrain).files[0].is_file()


def test_a_good_scenario_as_it_was_understood():
    scenario = parse(GOOD)
    assert isinstance(scenario.sensor, NadirCamera)
    assert (scenario.planner.seed, scenario.vehicle.max_climb_m_s) == (7, Vehicle().max_climb_m_s)
    assert scenario.area.cell_size_m == 5.0
    assert isinstance(scenario.area.cell_size_m, float)
    # Stands alone: the path of the elevation file no longer depends on a folder.
    assert scenario.terrain.file == "/somewhere/dem.tif"
    assert terrain_source(scenario.terrain).files[0] == Path("/somewhere/dem.tif")
    assert scenario.planning_cell_size_m == 10.0
    text = dump_scenario(scenario)
    assert parse(text, Path("/elsewhere")) == scenario
    # Every default is written out.
    for key in ("max_climb_angle_deg = 30.0", "max_incidence_deg = 75.0", 'algorithm = "memetic"', "max_gap_s = 2.0"):
        assert key in text


positive = st.floats(1e-6, 1e6)
fraction = st.floats(0.0, 1.0)
words = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
square = ((0.0, 0.0), (9.5, 0.0), (9.5, 7.25), (0.0, 7.25))
hole = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.5))
sensing = {"sensing": st.sampled_from(["at-waypoints", "along-path"]), "sample_spacing_m": positive}
sight_kinds = st.sampled_from(["ray", "midpoint"])
scenarios = st.builds(
    Scenario,
    name=words,
    description=words,
    select=words,
    area=st.builds(
        Area,
        cell_size_m=st.floats(1e-6, 0.5),
        polygon_east_north_m=st.just(square),
        holes_east_north_m=st.sampled_from([(), (hole,)]),
    ),
    terrain=st.builds(SineCosineTerrain, kind=st.just("sine-cosine"), scale_m=positive),
    sensor=st.one_of(
        st.builds(SphereSensor, kind=st.just("sphere"), range_m=st.floats(60, 1e9), line_of_sight=sight_kinds, **sensing),
        st.builds(DiscSensor, kind=st.just("disc"), radius_m=st.floats(0.5, 1e9), **sensing),
        st.builds(
            NadirCamera, kind=st.just("nadir-camera"), range_m=st.floats(60, 1e9), fov_deg=st.floats(1e-3, 179.9),
            max_incidence_deg=st.floats(1e-3, 90.0), line_of_sight=sight_kinds, **sensing,
        ),
    ),
    limits=st.builds(
        FlightLimits, min_height_agl_m=st.floats(0.0, 50.0), max_height_agl_m=st.floats(120.0, 1e5),
        height_margin_m=st.floats(0, 30), min_alt_amsl_m=st.one_of(st.none(), st.floats(-100, 0)),
        max_alt_amsl_m=st.one_of(st.none(), st.floats(1, 9000)), max_climb_angle_deg=st.floats(0.1, 89.0),
        fence_east_north_m=st.sampled_from([None, square]), applies_to=st.sampled_from(["legs", "waypoints"]),
    ),
    vehicle=st.builds(
        Vehicle, cruise_speed_m_s=st.floats(0.1, 100.0), endurance_s=st.one_of(st.none(), positive),
        autopilot=st.sampled_from(["ardupilot", "px4"]),
    ),
    origin=st.one_of(
        st.none(),
        st.builds(Origin, lat_deg=st.floats(-90, 90), lon_deg=st.floats(-180, 180), alt_amsl_m=st.floats(-400, 9000)),
    ),
    home=st.one_of(st.none(), st.builds(Home, east_m=st.floats(-10, 10), north_m=st.floats(-10, 10))),
    fleet=st.builds(Fleet, vehicles=st.integers(1, 50), separation_m=positive, timing_error_fraction=st.floats(0.0, 0.5)),
    planner=st.builds(PlannerSettings, seed=st.integers(0, 2**40), cell_size_m=st.one_of(st.none(), positive)),
    requirements=st.builds(Requirements, min_coverage_of_coverable=fraction, max_deviation_m=st.one_of(st.none(), positive)),
)  # fmt: skip


@deterministic
@given(scenarios)
def test_every_scenario_comes_back_from_its_text(scenario):
    assert parse(dump_scenario(scenario)) == scenario


def test_a_geographic_area_may_have_an_origin_of_its_own():
    scenario = dataclasses.replace(parse(GOOD), origin=Origin(lat_deg=36.475, lon_deg=-84.215, alt_amsl_m=300.0))
    assert parse(dump_scenario(scenario), Path("/elsewhere")) == scenario


def test_three_mistakes_are_named_in_one_line():
    message = refused(
        ("cruise_speed_m_s = 10.0", 'cruise_speed_m_s = "12 km/h"'),
        ("max_height_agl_m", "max_heigth_agl_m"),
        ("[-84.21, 36.48], [-84.22, 36.48]]", "[-84.22, 36.48], [-84.21, 36.48]]"),
    )
    assert "vehicle.cruise_speed_m_s: must be a finite number, not '12 km/h'" in message
    assert "limits.max_heigth_agl_m: unknown key (did you mean max_height_agl_m?)" in message
    assert "area.polygon_lon_lat_deg: Self-intersection" in message


# What is changed, and the whole message or how it begins.
MISTAKES = {
    "text for a number": ("range_m = 200.0", 'range_m = "200"', "sensor.range_m: must be a finite number, not '200'"),
    "true for a number": ("range_m = 200.0", "range_m = true", "sensor.range_m: must be a finite number, not True"),
    "not finite": ("range_m = 200.0", "range_m = nan", "sensor.range_m: must be a finite number"),
    "infinite": ("= 120.0", "= inf", "limits.max_height_agl_m: must be a finite number"),
    "too large": ("= 120.0", "= 1e300", "limits.max_height_agl_m: must be between -1e20 and 1e20, not 1e+300"),
    "too large in a list": ("[[-84.22, 36.47],", "[[-84.22, -1e30],", "area.polygon_lon_lat_deg.0.1: must be between -1e20"),
    "a date": ("range_m = 200.0", "range_m = 2020-01-01", "sensor.range_m: must be a finite number, not '2020-01-01'"),
    "half a seed": ("seed = 7", "seed = 7.5", "planner.seed: must be a whole number, not 7.5"),
    "a number for text": ('name = "test"', "name = 5", "name: must be text in quotes, not 5"),
    "not one of": (
        "seed = 7",
        'algorithm = "nsga9"',
        "planner.algorithm: must be 'memetic', 'local-search', 'imodbo', 'modbo', 'nsga2', 'moead', 'lines' or 'contour-lines'",
    ),
    "datum": ('"EGM96"', '"NN"', "terrain.vertical_datum: must be 'EGM96', 'EGM2008' or 'WGS84-ellipsoid', not 'NN'"),
    "kind": (
        '"nadir-camera"',
        '"nadir"',
        "sensor.kind: must be 'sphere' or 'disc' or 'nadir-camera' or 'frame-camera', not 'nadir'",
    ),
    "no kind": ('kind = "raster"', "", "terrain.kind: the key is missing; set it to 'raster' or 'sine-cosine'"),
    "kind of a number": ('kind = "raster"', "kind = 3", "terrain.kind: must be 'raster' or 'sine-cosine', not 3"),
    "missing": ("fov_deg = 70.0", "", "sensor.fov_deg: the key is missing"),
    "unknown at the top": ('select = "knee"', 'selct = "knee"', "selct: unknown key (did you mean select?)"),
    "in the wrong section": ("seed = 7", "fov_deg = 7", "planner.fov_deg: unknown key (it belongs in [sensor])"),
    "of the wrong kind": ("fov_deg = 70.0", "fov_deg = 7\nradius_m = 3", "sensor.radius_m: unknown key (it is of another kind"),
    "after a section": ("seed = 7", 'select = "knee"', "planner.select: unknown key (write it above the first"),
    "unlike anything": ("seed = 7", "zzz = 1", "planner.zzz: unknown key (known: algorithm, line_heading_deg, encoding"),
    "rule of a section": ("= 120.0", "= 20.0", "limits.max_height_agl_m: the band 40.0..20.0 m is too narrow for"),
    "rule of a kind": ("fov_deg = 70.0", "fov_deg = 190.0", "sensor.fov_deg: must be between 0 and 180 degrees, not 190.0"),
    "rule across": ("range_m = 200.0", "range_m = 30.0", "sensor.range_m: 30.0 m does not reach the ground from limits."),
    "cells": ("cell_size_m = 5", "cell_size_m = 500", "area.cell_size_m: cells of 500.0 m are larger than"),
    "negative": ("min_height_agl_m = 40.0", "min_height_agl_m = -1", "limits.min_height_agl_m: must not be negative"),
    "no speed": ("cruise_speed_m_s = 10.0", "cruise_speed_m_s = 0", "vehicle.cruise_speed_m_s: must be greater than 0, not 0.0"),
    "take-off above the ceiling": (
        "= 120.0", "= 120.0\nmax_transit_height_agl_m = 25.0",
        "vehicle.takeoff_height_m: must be at most limits.max_transit_height_agl_m = 25.0 m less height_margin_m = 0.0 m, not 30",
    ),
    "half a home": ("lat_deg = 36.471\n", "", "home: specify lat_deg and lon_deg, or east_m and north_m"),
    "two areas": ("cell_size_m = 5", 'cell_size_m = 5\ngeojson = "a"', "area: specify exactly one of"),
    "out of range": ("[[-84.22, 36.47],", "[[36.47, -94.22],", "area.polygon_lon_lat_deg: (36.47, -94.22) is not a long"),
    "hole out of range": ("[[[-84.218, 36.472]", "[[[-84.218, 99.0]", "area.holes_lon_lat_deg: (-84.218, 99.0) is not"),
    "hole outside": ("[-84.216, 36.474]]]", "[-84.216, 36.5]]]", "area.holes_lon_lat_deg.0: the hole reaches outside"),
    "three numbers": ("[[-84.22, 36.47],", "[[-84.22, 36.47, 9.0],", "area.polygon_lon_lat_deg.0: each corner must be a pair"),
    "one number": ("[[-84.22, 36.47],", "[[-84.22],", "area.polygon_lon_lat_deg.0.1: a number is missing; write each"),
    "no list": ("holes_lon_lat_deg = [", "holes_lon_lat_deg = 5 #", "area.holes_lon_lat_deg: must be a list, not 5"),
    "line": ("[-84.21, 36.48], [-84.22, 36.48]]", "[-84.22, 36.47]]", "area.polygon_lon_lat_deg: a ring needs at least 3"),
    "fence": ("= 120.0", "= 120.0\nfence_lon_lat_deg = [[1.0, 2.0]]", "limits.fence_lon_lat_deg: a ring needs at least 3"),
    "fence crossing": (
        "= 120.0", "= 120.0\nfence_east_north_m = [[0, 0], [1, 1], [1, 0], [0, 1]]", "limits.fence_east_north_m: Self-inter",
    ),
    "fence swapped": ("= 120.0", "= 120.0\nfence_lon_lat_deg = [[1, 92], [1, 2], [2, 2]]", "limits.fence_lon_lat_deg: (1.0"),
    "syntax": ("[home]", "[home", "the file is not valid TOML: "),
    "no table": ('name = "test"', 'name = "test"\norigin = 3', "origin: must be a table, not 3"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "begins"), MISTAKES.values(), ids=MISTAKES.keys())
def test_a_mistake_is_named_by_the_key_that_the_user_wrote(old, new, begins):
    message = refused((old, new))
    assert message.startswith(begins)
    assert ";" not in message.replace("is missing;", "").replace("; a ring", "")


def test_sections_that_are_no_tables():
    text = GOOD.split("[sensor]")[0].replace('name = "test"', 'name = "test"\nsensor = 5\nlimits = []')
    message = refused(text=text)
    assert (
        "sensor: must be a table with a kind ('sphere' or 'disc' or 'nadir-camera' or 'frame-camera'), not 5" in message
    )
    assert "limits: must be a table, not []" in message


def test_an_empty_file_names_every_section_it_needs():
    message = refused(text="")
    for key in ("name", "area", "terrain", "sensor", "limits"):
        assert f"{key}: the key is missing" in message


def test_holes_that_leave_nothing():
    ring = "[[-84.22, 36.47], [-84.21, 36.47], [-84.21, 36.48], [-84.22, 36.48]]"
    message = refused(("[[[-84.218, 36.472], [-84.216, 36.472], [-84.216, 36.474]]]", f"[{ring}]"))
    assert message == "area.polygon_lon_lat_deg: the holes cover the whole area; remove some of them"


def test_scenario_files(tmp_path, monkeypatch):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert load_scenario(path).terrain.file == str(tmp_path / "dem.tif")
    monkeypatch.chdir(tmp_path)
    # Regression: a run folder with the name of a bundled scenario hid it.
    (tmp_path / "jacksboro").mkdir()
    assert load_scenario("jacksboro").name == "jacksboro"
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe9"')
    for name in ("nowhere.toml", "latin.toml", "jacksbro"):
        with pytest.raises(ScenarioError, match="nor a bundled scenario"):
            load_scenario(name)


@pytest.mark.parametrize(
    ("cls", "values", "words"),
    [
        (Home, {"lat_deg": 91.0, "lon_deg": 0.0}, r"lat_deg: must be between -90 and 90, not 91\.0"),
        (Home, {"lat_deg": 1.0, "lon_deg": 0.0, "east_m": 1.0}, "specify lat_deg and lon_deg"),
        (
            Origin,
            {"lat_deg": 0.0, "lon_deg": -190.0, "alt_amsl_m": 0.0},
            r"lon_deg: must be between -180 and 180, not -190\.0",
        ),
        (RasterTerrain, {"kind": "raster", "file": "x", "vertical_datum": "EGM96", "grid_step_m": 0.0}, "grid_step_m"),
        (PlannerSettings, {"population_size": 5}, "population_size: must"),
        (PlannerSettings, {"evaluations": 10}, "evaluations: must"),
        (PlannerSettings, {"max_waypoints": 1}, "max_waypoints"),
        (PlannerSettings, {"seed": -1}, "seed"),
        (PlannerSettings, {"cell_size_m": math.nan}, "cell_size_m"),
        (
            Requirements,
            {"min_coverage_of_coverable": 95.0},
            "min_coverage_of_coverable: must be between 0 and 1",
        ),
        (Requirements, {"max_deviation_m": 0.0}, "max_deviation_m"),
        (Vehicle, {"cruise_speed_m_s": 300.0}, "too fast for a multirotor"),
        (Vehicle, {"cruise_speed_m_s": 1e-7}, "cruise_speed_m_s: 1e-07 m/s is too slow for a multirotor"),
        (Vehicle, {"max_climb_m_s": 1e-300}, "max_climb_m_s: 1e-300 m/s is too slow for a multirotor"),
        (Vehicle, {"endurance_s": -1.0}, "endurance_s"),
        (
            FlightLimits,
            {"min_height_agl_m": 1.0, "max_height_agl_m": 9.0, "max_climb_angle_deg": 90.0},
            "max_climb_angle",
        ),
        (
            FlightLimits,
            {"min_height_agl_m": 1, "max_height_agl_m": 9, "min_alt_amsl_m": 5, "max_alt_amsl_m": 5},
            "max_alt",
        ),
        (
            NadirCamera,
            {"kind": "nadir-camera", "fov_deg": 9, "range_m": 9, "max_incidence_deg": 91},
            "max_incidence_deg",
        ),
        (Area, {"cell_size_m": 1.0, "geojson": "x", "holes_lon_lat_deg": (hole,)}, "requires polygon_lon_lat_deg"),
        (Area, {"cell_size_m": 1.0, "geojson": "x", "holes_east_north_m": (hole,)}, "requires polygon_east_north_m"),
    ],
)
def test_rules_hold_for_scenarios_made_in_code_too(cls, values, words):
    with pytest.raises(ValueError, match=words):
        cls(**values)


def test_rules_across_the_sections():
    good = parse(GOOD)
    square_area = Area(cell_size_m=1.0, polygon_east_north_m=square)
    for changes, words in (
        ({"home": None}, "home: specify lat_deg and lon_deg"),
        ({"home": Home(east_m=1.0, north_m=2.0)}, "home: specify lat_deg and lon_deg"),
        (
            {"terrain": SineCosineTerrain(kind="sine-cosine")},
            "terrain.kind: an area in degrees requires raster terrain",
        ),
        ({"area": square_area}, "origin: raster terrain with an area in metres"),
        (
            {"area": square_area, "terrain": SineCosineTerrain(kind="sine-cosine")},
            "home: lat_deg and lon_deg require an origin; use east_m and north_m, or add an",
        ),
    ):
        with pytest.raises(ValueError, match=words):
            dataclasses.replace(good, **changes)
