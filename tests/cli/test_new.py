"""``uavcover new``: from foreign files to a scenario that plans, and every bad input as one line."""

import itertools
import json
import tomllib

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import Affine

from mission_io.model.items import Command
from tests.cli import bad_inputs
from tests.cli.bad_inputs import POSITIONS, SIZE_M, dem_at, options, square_parts
from tests.scenario.areas import written
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.photos import FLOWN_OVERLAP_FRACTION, count_photos, photo_statistics, planned_poses
from uavcover.sensing.site_maps import judging_map


@pytest.fixture(scope="module")
def tennessee(tmp_path_factory):
    """A folder with an elevation model and areas around 36.48 N, 84.22 W."""
    folder = tmp_path_factory.mktemp("tennessee")
    bad_inputs.prepare(folder)
    return folder


@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("form", ["kml", "geojson"])
@pytest.mark.thinned(strength=1)
def test_a_foreign_place_is_one_command(cli, tmp_path, position, form):
    dem = dem_at(tmp_path, position)
    area = getattr(written, form)(tmp_path / f"area.{form}", square_parts(position))
    ended = cli("new", area, *options(dem), "--battery", "25min", "-o", tmp_path / "survey.toml", "--json", code=0)
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
    cli("new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path, code=0)
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
        "photo distance",
        "line distance",
        "photos",
        "batter",
        "home",
        "Next: uavcover plan",
    ):
        assert words in ended.out, ended.out
    assert "does not state its vertical datum" in ended.err


def test_a_file_that_is_there_is_never_replaced_unasked(cli, tennessee, tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("mine", encoding="utf-8")
    arguments = ("new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path)
    cli(*arguments, code=2)
    assert path.read_text(encoding="utf-8") == "mine"
    cli(*arguments, "--force", code=0)
    assert load_scenario(path).name == "field-1"


def test_boxes_circles_and_text(cli, tennessee, tmp_path):
    areas = {
        "circle": "36.48,-84.22,180m", "box": "-84.222,36.479,-84.218,36.481",
        "wkt": "POLYGON ((-84.222 36.479, -84.218 36.479, -84.218 36.481, -84.222 36.479))",
    }  # fmt: skip
    for name, area in areas.items():
        path = tmp_path / f"{name}.toml"
        cli(
            "new",
            area,
            *options(tennessee / "dem.tif"),
            "--margin",
            "0",
            "-o",
            path,
            "--vertical-datum",
            "egm2008",
            code=0,
        )
        scenario = load_scenario(path)
        assert scenario.area.margin_m == 0.0
        assert scenario.terrain.vertical_datum == "EGM2008"


def test_options_of_the_vehicle_reach_the_scenario(cli, tennessee, tmp_path):
    path = tmp_path / "a.toml"
    cli(
        "new", tennessee / "area.kml", *options(tennessee / "dem.tif"), "-o", path, "--vehicle", "PX4",
        "--home", "36.4795,-84.2205", "--max-height", "80m", "--mount", "fixed", "--overlap", "80/60", "--speed", "4m/s",
     code=0)  # fmt: skip
    scenario = load_scenario(path)
    assert (scenario.vehicle.autopilot, scenario.vehicle.cruise_speed_m_s) == ("px4", 4.0)
    assert (scenario.home.lat_deg, scenario.home.lon_deg) == (36.4795, -84.2205)
    assert scenario.limits.max_height_agl_m == 80.0
    assert scenario.sensor.mount == "fixed"
    assert (scenario.sensor.forward_overlap, scenario.sensor.side_overlap) == (0.8, 0.6)


def test_lists(cli):
    ended = cli("new", "--camera", "list", code=0)
    assert "sony-a7r4-35mm" in ended.out
    assert "unknown" in ended.out
    assert "dji-m350-rtk" in cli("new", "--vehicle", "list", "--json").document["vehicles"]


def with_lake(folder, position, *, half_m):
    """The elevation model with a square without data in the middle."""
    path = dem_at(folder, position, steepest=0.2)
    with rasterio.open(path, "r+") as file:
        values = file.read(1)
        middle, half = len(values) // 2, round(half_m / POSITIONS[position][3])
        values[middle - half : middle + half, middle - half : middle + half] = -9999.0
        file.nodata = -9999.0
        file.write(values, 1)
    return path


LAKE_POSITION = "southern hemisphere, UTM"


def test_a_lake_in_a_hole_does_not_matter(cli, tmp_path):
    dem = with_lake(tmp_path, LAKE_POSITION, half_m=50.0)
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_POSITION))
    ended = cli("new", area, *options(dem), "-o", tmp_path / "s.toml", code=0)
    assert "gaps of up to 130 m in holes of the area" in ended.err
    site = load_site(tmp_path / "s.toml")
    assert 100.0 <= site.scenario.terrain.fill_no_data_m <= 150.0
    assert np.isfinite(site.ground.heights_m(site.area.centroid.coords[0])).all()


def test_a_lake_in_the_area_is_asked_about(cli, tmp_path):
    dem = with_lake(tmp_path, LAKE_POSITION, half_m=50.0)
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_POSITION, hole=False))
    ended = cli("new", area, *options(dem), "-o", tmp_path / "s.toml", code=2)
    assert (
        "interpolate the gap with --fill-lakes 130m, treat it as the sea with --water-height 0m, exclude it from the area"
        in ended.error
    )
    cli("new", area, *options(dem), "-o", tmp_path / "s.toml", "--fill-lakes", "130m", code=0)
    assert load_scenario(tmp_path / "s.toml").terrain.fill_no_data_m == 130.0


def test_tiles_bands_and_feet_reach_the_scenario(cli, tmp_path):
    dem = dem_at(tmp_path, LAKE_POSITION, steepest=0.2)
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
    area = written.kml(tmp_path / "a.kml", square_parts(LAKE_POSITION))
    paths = (
        ("--dem", tmp_path / "tiles"),
        ("--dem", tmp_path / "tiles" / "north.tif", "--dem", tmp_path / "tiles" / "south.tif"),
    )
    for number, dems in enumerate(paths):
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
            code=0,
        )
        cli("new", area, *options(dem), "-o", tmp_path / "whole.toml", "--force", code=0)
        tiles, whole = load_site(path), load_site(tmp_path / "whole.toml")
        positions = np.random.default_rng(1).uniform(-250.0, 250.0, (500, 2))
        assert np.allclose(tiles.ground.heights_m(positions), whole.ground.heights_m(positions), atol=1e-3)
    ended = cli("new", area, *paths[0], "--camera", "m3e", "--gsd", "3cm", "--band", "dtm", "-o", tmp_path / "b.toml")
    assert "has no band 'dtm'; set terrain.band to one of: 1, 2 Elevation" in ended.error


@pytest.mark.parametrize("what", bad_inputs.ALL)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_bad_input_is_one_line_with_a_remedy(cli, tennessee, tmp_path, monkeypatch, what):
    monkeypatch.chdir(tmp_path)
    arguments, words = bad_inputs.arguments_of(what, tennessee, tmp_path)
    ended = cli("new", *arguments, code=2)
    lines = [line for line in ended.err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1, ended.err
    assert words in lines[0]
    assert not list(tmp_path.glob("*.toml"))


@pytest.mark.parametrize(
    ("pattern", "flights"),
    [("crosshatch", ["along", "across"]), ("oblique", ["nadir", "north", "east", "south", "west"])],
)
def test_a_pattern_is_a_scenario_for_each_flight(cli, tennessee, tmp_path, pattern, flights):
    area, out = tennessee / "area.kml", tmp_path / "s.toml"
    ended = cli("new", area, *options(tennessee / "dem.tif"), "--pattern", pattern, "-o", out, "--json", code=0)
    paths = [tmp_path / f"s-{flight}.toml" for flight in flights]
    assert [flight["scenario"] for flight in ended.document["flights"]] == [str(path) for path in paths]
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    planners = [load_scenario(path).planner for path in paths]
    assert all(planner.algorithm == "lines" and planner.line_heading_deg is not None for planner in planners)
    again = cli("new", area, *options(tennessee / "dem.tif"), "--pattern", pattern, "-o", out)
    assert (again.code, "already exists" in again.err) == (2, True)
    planned = cli("plan", area, *options(tennessee / "dem.tif"), "--pattern", pattern, "-o", tmp_path / "run", code=2)
    assert (
        f"--pattern: {pattern} consists of {len(flights)} missions; create their scenarios with uavcover new"
        in planned.err
    )
    assert not (tmp_path / "run").exists()


def test_a_flight_of_an_oblique_set_says_where_to_look(cli, tennessee, tmp_path):
    out, run = tmp_path / "s.toml", tmp_path / "run"
    cli(
        "new",
        tennessee / "area.kml",
        *options(tennessee / "dem.tif", gsd="6cm"),
        "--pattern",
        "oblique",
        "--margin",
        "0",
        "-o",
        out,
        code=0,
    )
    cli("plan", tmp_path / "s-east.toml", "-o", run, "--json", code=0)
    document = json.loads((run / "plan.json").read_text())
    assert document["metrics"]["coverage_of_coverable"] >= 0.98
    rows = [line.split("\t") for line in (run / "mission.waypoints").read_text().splitlines()[1:]]
    (gimbal,) = (row for row in rows if int(row[3]) == Command.DO_GIMBAL_MANAGER_PITCHYAW)
    assert [float(value) for value in gimbal[4:6]] == [-45.0, 90.0]


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
    cli(
        "plan", tennessee / "area.kml", *options(tennessee / "dem.tif"), "--margin", "0", "--overlap", "60/50", "-o", run,
        "--evaluations", 50,
     code=0)  # fmt: skip
    assert (run / "mission.waypoints").exists()
    again = load_scenario(run / "scenario.toml")
    assert again.sensor.side_overlap == 0.5
    assert cli("plan", "jacksboro", "--gsd", "3cm", "-o", tmp_path / "b").error == (
        "error: jacksboro: this is a scenario; use --gsd with an area, such as area.kml"
    )
    assert "an area also requires --dem dem.tif" in cli("plan", tennessee / "area.kml", "-o", tmp_path / "c").error


def photos_per_position(site, route_m, every_m, positions):
    """How many pictures show each place, counted without the project's own geometry: pin-hole cameras that look straight down."""
    sensor = site.scenario.sensor
    across, along = (np.tan(np.radians(0.5 * angle)) for angle in (sensor.fov_across_deg, sensor.fov_along_deg))
    ground = site.ground.heights_m(positions)
    counts = np.zeros(len(positions), dtype=int)
    to_go = 0.0
    for begin, end in itertools.pairwise(route_m):
        length = float(np.linalg.norm(end - begin))
        ahead = (end - begin)[:2] / max(float(np.linalg.norm((end - begin)[:2])), 1e-9)
        while to_go <= length:
            eye = begin + (end - begin) * (to_go / max(length, 1e-9))
            offset, depth = positions - eye[:2], eye[2] - ground
            counts += (np.abs(offset @ ahead) <= along * depth) & (
                np.abs(offset @ [ahead[1], -ahead[0]]) <= across * depth
            )
            to_go += every_m
        to_go -= length
    return counts


@pytest.mark.parametrize(("overlap", "needed", "hole"), [("75/70", 4 * 3, True), ("60/50", 2 * 2, False)])
def test_the_overlap_that_was_asked_for_holds_up_to_the_edge(cli, tmp_path, overlap, needed, hole):
    """At least floor(1 / (1 - f)) pictures along the line times floor(1 / (1 - s)) lines on 99 % of what was drawn."""
    position = "southern hemisphere, UTM"
    dem, area = dem_at(tmp_path, position), written.kml(tmp_path / "a.kml", square_parts(position, hole=hole))
    cli("new", area, *options(dem), "--overlap", overlap, "-o", tmp_path / "s.toml", code=0)
    site = load_site(tmp_path / "s.toml")
    request = PlanRequest(
        scenario=site, folder=tmp_path / "run", command=["test"], force=False, evaluations=50, workers=1
    )  # fmt: skip
    outcome = plan_into(request, Unattended(), check_site=lambda _: None)
    (part,) = square_parts(position, hole=hole)
    drawn = shapely.transform(part, lambda p: site.frame.enu_from_geodetic(p[:, 1], p[:, 0], 0.0)[:, :2])
    west, south, east, north = drawn.bounds
    positions = np.stack(np.meshgrid(np.arange(west, east, 9.0), np.arange(south, north, 9.0)), axis=-1).reshape(-1, 2)
    positions = positions[shapely.contains_xy(drawn, positions[:, 0], positions[:, 1])]
    sensor, limits = site.scenario.sensor, site.scenario.limits
    length_m = 2.0 * np.tan(np.radians(0.5 * sensor.fov_along_deg)) * limits.min_height_agl_m
    counts = photos_per_position(
        site, outcome.plan.chosen.route.waypoints_m, (1.0 - sensor.forward_overlap) * length_m, positions
    )
    assert float((counts >= needed).mean()) >= 0.99
    # What the report says of the plan: the same rule, the same share.
    coverage, route_m = judging_map(site), outcome.plan.chosen.route.waypoints_m
    stated = photo_statistics(coverage, count_photos(coverage, planned_poses(coverage, [route_m])))
    assert stated.asked == needed
    assert stated.overlap_holds
    # What is asked for, and kept by the plan, is asked of the flight.
    assert site.scenario.requirements.min_overlap_fraction == FLOWN_OVERLAP_FRACTION
    assert outcome.exit_code == 0
    assert stated.overlap_fraction == pytest.approx(float((counts >= needed).mean()), abs=0.01)
