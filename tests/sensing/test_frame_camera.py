"""A rectangular picture: on flat ground, turned with the map, as a bound, and in what a scenario may say of it."""

import dataclasses
import math

import numpy as np
import pytest
import shapely
import shapely.affinity

from tests.planner.sites import EXACT, flat, hills, make_site
from tests.sensing.test_coverage import grid_site
from tests.verification.flights import fly_along
from uavcover.errors import ScenarioError
from uavcover.kernels.coverage import observed_from_points
from uavcover.model.sensor import FrameCamera, NadirCamera
from uavcover.scenario.scenario_file import dump_scenario, parse_scenario
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.sensors import any_heading
from uavcover.verification.observations import observations_of, photos_of
from uavcover.verification.verify import flown_coverage

pytestmark = pytest.mark.usefixtures("attitudes_count")

FRAME = FrameCamera(kind="frame-camera", fov_across_deg=80.0, fov_along_deg=40.0, range_m=200.0)
AHEAD = dataclasses.replace(FRAME, pitch_deg=-55.0)


def observed_along(sensor, route, *, ups=flat):
    coverage = CoverageMap(make_site(ups, sensor=sensor, cell_m=5.0, vehicle=EXACT), cell_size_m=5.0)
    return coverage.grid.cells.centre_m[coverage.observed(np.array(route))]


def test_a_leg_over_flat_ground_shows_a_strip():
    observed = observed_along(FRAME, [[100.0, 100.0, 80.0], [200.0, 100.0, 80.0]])
    # Half the width is 80 tan 40 = 67 m, half the length 80 tan 20 = 29 m; centres of cells are 5 m apart.
    assert (observed[:, 1].min(), observed[:, 1].max()) == (37.5, 162.5)
    assert (observed[:, 0].min(), observed[:, 0].max()) == (72.5, 227.5)
    turned = observed_along(FRAME, [[150.0, 60.0, 80.0], [150.0, 140.0, 80.0]])
    assert (turned[:, 0].min(), turned[:, 0].max()) == (87.5, 212.5)


def test_a_tilted_camera_looks_ahead_of_the_vehicle():
    observed = observed_along(AHEAD, [[50.0, 100.0, 50.0], [51.0, 100.0, 50.0]])
    near, far = (50.0 + 50.0 * math.tan(math.radians(35.0 + side)) for side in (-20.0, 20.0))
    assert observed[:, 0].min() == pytest.approx(near, abs=5.0)
    assert observed[:, 0].max() == pytest.approx(far, abs=5.0)
    photo = AHEAD.flat_photo(50.0)
    assert (50.0 + photo.near_m, 50.0 + photo.far_m) == pytest.approx((near, far))
    assert np.ptp(observed[:, 1]) == pytest.approx(2.0 * photo.half_width_m, abs=15.0)
    back = observed_along(AHEAD, [[250.0, 100.0, 50.0], [249.0, 100.0, 50.0]])
    assert back[:, 0].max() == pytest.approx(300.0 - near, abs=5.0)


def test_an_overlap_to_the_side_narrows_what_counts():
    half = dataclasses.replace(FRAME, side_overlap=0.5)
    assert half.half_width_m(80.0) == pytest.approx(0.5 * FRAME.half_width_m(80.0))
    observed = observed_along(half, [[100.0, 100.0, 80.0], [200.0, 100.0, 80.0]])
    assert np.ptp(observed[:, 1]) == pytest.approx(67.1, abs=5.0)
    assert np.ptp(observed[:, 0]) == 155.0


@pytest.mark.parametrize("sensor", [FRAME, AHEAD], ids=["nadir", "ahead"])
def test_a_quarter_turn_changes_nothing(sensor):
    sensor = dataclasses.replace(sensor, range_m=60.0, sample_spacing_m=3.0, pixels_across=200, max_ground_sample_m=0.4)
    nodes = np.random.default_rng(4).uniform(0, 12, (17, 17))
    route = np.random.default_rng(5).uniform([0, 0, 20], [40, 40, 40], (5, 3))
    plain = CoverageMap(grid_site(nodes, sensor=sensor), cell_size_m=2.5)
    turned = CoverageMap(grid_site(np.rot90(nodes), sensor=sensor), cell_size_m=2.5)
    turned_route = np.column_stack([route[:, 1], 40.0 - route[:, 0], route[:, 2]])
    a, b = plain.fraction(plain.observed(route)), turned.fraction(turned.observed(turned_route))
    assert 0.1 < a < 0.95
    assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.parametrize("spacing_m", [1.0, 20.0, 40.0, 55.0])
@pytest.mark.parametrize("turn_deg", [0.0, 20.0, 45.0, 65.0, 90.0, 200.0])
def test_photos_with_a_fixed_heading_overlap_in_a_strip(turn_deg, spacing_m):
    sensor = dataclasses.replace(FRAME, mount="stabilised", heading_deg=300.0, trigger_distance_m=spacing_m)
    photo = shapely.box(-80.0 * math.tan(math.radians(40.0)), -80.0 * math.tan(math.radians(20.0)), *(
        80.0 * math.tan(math.radians(half)) for half in (40.0, 20.0)
    ))  # fmt: skip
    # Along a line to the north the photo is turned back by as much as the line is turned from it.
    photo = shapely.affinity.rotate(photo, turn_deg, origin=(0.0, 0.0))
    photos = [shapely.affinity.translate(photo, 0.0, spacing_m * k) for k in range(-400, 400)]
    observed = shapely.union_all([each for each in photos if abs(each.centroid.y) < 400.0])
    widths = np.arange(0.0, 100.0, 0.5)
    sides = shapely.linestrings([[(side, -spacing_m), (side, spacing_m)] for side in widths])
    strip_m = float(np.max(widths[shapely.covers(observed.buffer(1e-6), sides)], initial=0.0))
    assert sensor.strip_half_width_m(80.0, 300.0 + turn_deg) == pytest.approx(strip_m, abs=0.6)


def test_a_strip_is_as_wide_as_a_photo_where_that_turns_with_the_lines():
    for sensor in (FRAME, AHEAD, NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0)):
        assert sensor.strip_half_width_m(80.0, 77.0) == sensor.half_width_m(80.0) > 0.0


def test_a_fixed_heading_does_not_turn_with_the_legs():
    sensor = dataclasses.replace(FRAME, mount="stabilised", heading_deg=0.0)
    legs = [observed_along(sensor, [[150.0, 100.0, 80.0], end]) for end in ([151.0, 100.0, 80.0], [150.0, 101.0, 80.0])]
    for observed in legs:
        assert np.ptp(observed[:, 0]) > 1.9 * np.ptp(observed[:, 1])
    at_waypoints = dataclasses.replace(sensor, sensing="at-waypoints")
    observed = observed_along(at_waypoints, [[150.0, 100.0, 80.0]])
    assert np.ptp(observed[:, 0]) > 1.9 * np.ptp(observed[:, 1]) > 0.0


def test_what_can_be_covered_and_what_is_too_coarse_everywhere():
    for sensor in (FRAME, AHEAD):
        coverage = CoverageMap(make_site(hills, sensor=sensor, cell_m=20.0), cell_size_m=20.0)
        assert coverage.coverable.mean() > 0.99
    for sensor in (AHEAD, NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0)):
        # From the lowest height, 40 m, a pixel of these sees 0.05 m and more.
        fine = dataclasses.replace(sensor, pixels_across=1000, max_ground_sample_m=0.04)
        assert not CoverageMap(make_site(sensor=fine, cell_m=20.0), cell_size_m=20.0).coverable.any()


def test_whatever_the_heading_no_more_is_seen_than_by_the_bound():
    for sensor in (FRAME, AHEAD, dataclasses.replace(FRAME, pitch_deg=-20.0)):
        coverage = CoverageMap(make_site(hills, sensor=sensor, cell_m=10.0), cell_size_m=10.0)
        position = np.array([[140.0, 90.0, 85.0]])
        most = observed_from_points(
            coverage.site.ground.surface,
            any_heading(coverage.sight),
            coverage.grid.cells,
            position,
            np.zeros((1, 2)),
        )
        for yaw in (0.0, 33.0, 145.0, 290.0):
            observed = coverage.observed_by(LevelObservations.by_yaw(position, np.array([yaw])))
            assert observed.any()
            assert not (observed & ~most).any()


@pytest.mark.parametrize("mount", ["fixed", "stabilised"])
def test_a_level_flight_sees_what_was_planned(mount):
    sensor = dataclasses.replace(AHEAD, mount=mount, sample_spacing_m=2.0)
    site = make_site(hills, sensor=sensor, cell_m=5.0, vehicle=EXACT)
    coverage = CoverageMap(site, cell_size_m=5.0)
    path = np.array([[0.0, 60.0, 80.0], [250.0, 140.0, 80.0]])
    level = fly_along(site, path)
    yaw = math.degrees(math.atan2(250.0, 80.0))
    level = dataclasses.replace(level, attitude_deg=np.tile([1e-6, 0.0, yaw], (len(level), 1)))
    planned, flown = coverage.observed(path), flown_coverage(coverage, level, None).observed
    assert (planned ^ flown).sum() < 0.02 * planned.sum()
    nose_up = dataclasses.replace(level, attitude_deg=np.tile([0.0, 15.0, yaw], (len(level), 1)))
    lifted = flown_coverage(coverage, nose_up, None).observed
    assert bool((lifted ^ flown).sum() > 0.1 * flown.sum()) == (mount == "fixed")
    # Where the log has no attitude nothing is surely seen, and possibly what a camera sees that leans with the vehicle.
    unknown = dataclasses.replace(level, attitude_deg=np.full((len(level), 3), math.nan))
    guessed = flown_coverage(coverage, unknown, None)
    assert not guessed.observed.any()
    assert not (flown & ~guessed.possible_cells).any()


def test_pictures_by_distance_are_the_looks_of_a_flight():
    sensor = dataclasses.replace(FRAME, trigger_distance_m=25.0)
    site = make_site(sensor=sensor)
    track = fly_along(site, np.array([[0.0, 50.0, 80.0], [110.0, 50.0, 80.0], [110.0, 150.0, 80.0]]))
    route, joined = np.ones(len(track), dtype=bool), np.ones(len(track) - 1, dtype=bool)
    photos = photos_of(site, track, track.enu_m, route, joined, None, source="predicted")
    positions = observations_of(site, track, track.enu_m, route, joined, photos).positions_m
    steps = np.hypot(*np.diff(positions[:, :2], axis=0).T)
    np.testing.assert_allclose(steps, 25.0, atol=1e-6)
    np.testing.assert_allclose(positions[:5, 0], [0.0, 25.0, 50.0, 75.0, 100.0], atol=1e-6)
    # Round the corner the straight line to the last picture counts.
    np.testing.assert_allclose(positions[5, :2], [110.0, 50.0 + math.sqrt(25.0**2 - 10.0**2)], atol=1e-6)


def test_how_a_camera_is_turned():
    right_angles = AHEAD.camera_turn(np.array([[0.0, 0.0, 90.0], [20.0, -10.0, 200.0]]))
    s, c = math.sin(math.radians(35.0)), math.cos(math.radians(35.0))
    np.testing.assert_allclose(right_angles.axes[0], [s, 0.0, -c], atol=1e-12)
    np.testing.assert_allclose(right_angles.tops[0], [c, 0.0, s], atol=1e-12)
    np.testing.assert_allclose((right_angles.axes * right_angles.tops).sum(axis=1), 0.0, atol=1e-12)
    gimbal = dataclasses.replace(AHEAD, mount="stabilised", heading_deg=180.0)
    turn = gimbal.camera_turn(np.array([[20.0, -10.0, 200.0]]))
    np.testing.assert_allclose(turn.axes[0], [0.0, -s, -c], atol=1e-12)
    unknown = dataclasses.replace(AHEAD, mount="stabilised").camera_turn(np.full((1, 3), math.nan), np.array([270.0]))
    np.testing.assert_allclose(unknown.axes[0], [-s, 0.0, -c], atol=1e-12)
    assert ((~turn.known).sum(), (~unknown.known).sum()) == (0, 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pitch_deg": -120.0}, "pitch_deg: must be between -90 (straight down) and 0 (horizontal), not -120.0"),
        ({"fov_along_deg": 180.0}, "fov_along_deg: must be between 0 and 180 degrees, not 180.0"),
        ({"heading_deg": 20.0}, 'heading_deg: this key requires mount = "stabilised"'),
        ({"heading_deg": 360.0, "mount": "stabilised"}, "heading_deg: must be at least 0 and below 360"),
        ({"sensing": "at-waypoints"}, 'heading_deg: this key is required with sensing = "at-waypoints"'),
        ({"forward_overlap": 1.0}, "forward_overlap: must be at least 0 and below 1"),
        ({"side_overlap": -0.1}, "side_overlap: must be at least 0 and below 1"),
        ({"forward_overlap": 0.5, "trigger_distance_m": 9.0}, "trigger_distance_m: use either this key or forward_overlap"),
        ({"trigger_distance_m": 0.0}, "trigger_distance_m: must be greater than 0"),
        ({"max_ground_sample_m": 0.1}, "max_ground_sample_m: this key requires pixels_across"),
        ({"max_ground_sample_m": 0.0, "pixels_across": 9}, "max_ground_sample_m: must be greater than 0"),
        (
            {"trigger_distance_m": 9.0, "sensing": "at-waypoints", "mount": "stabilised", "heading_deg": 0.0},
            'trigger_distance_m: distance triggering requires sensing = "along-path"',
        ),
    ],
)  # fmt: skip
def test_values_that_make_no_sense(changes, message, tmp_path):
    scenario = make_site(sensor=FRAME).scenario
    text = dump_scenario(scenario)
    assert parse_scenario(text, source="t", folder=tmp_path) == scenario
    for key, value in changes.items():
        text = "\n".join(line for line in text.splitlines() if not line.startswith(f"{key} = "))
        text = text.replace("[sensor]", f"[sensor]\n{key} = {value!r}".replace("'", '"'))
    with pytest.raises(ScenarioError) as error:
        parse_scenario(text, source="t", folder=tmp_path)
    assert str(error.value).startswith(f"t: sensor.{message}")


def test_an_overlap_of_a_picture_that_shows_no_ground_is_refused():
    blind = dataclasses.replace(FRAME, forward_overlap=0.5, pixels_across=1000, max_ground_sample_m=0.01)
    with pytest.raises(
        ScenarioError,
        match=r"^sensor.forward_overlap: at limits.min_height_agl_m = 40 m, a photo shows no level ground",
    ):
        CoverageMap(make_site(sensor=blind), cell_size_m=10.0).observations(np.zeros((2, 3)))
