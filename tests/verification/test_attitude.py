"""The camera looks where the vehicle's attitude points it."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.planner.sites import CAMERA
from tests.verification.flights import changed, fly_along, make_site, track_of
from uavcover.model.sensor import FrameCamera, NadirCamera, SphereSensor
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.verify import flown_coverage, verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

PATH = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]])


def with_attitude(track, roll=0.001, pitch=0.0, yaw=0.0):
    return changed(track, attitude_deg=np.tile([roll, pitch, yaw], (len(track), 1)))


def middle_north(coverage, seen):
    return float(coverage.grid.cells.centre_m[seen, 1].mean())


def test_axes_are_those_of_scipys_rotations():
    attitude = np.random.default_rng(3).uniform([-40.0, -30.0, 0.0], [40.0, 30.0, 360.0], (50, 3))
    turn = CAMERA.camera_turn(attitude)
    # Yaw, pitch, roll of the body (forward, right, down) against north-east-down; the camera looks down in the body.
    ned = Rotation.from_euler("ZYX", attitude[:, ::-1], degrees=True).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(turn.axes, ned[:, [1, 0, 2]] * [1.0, 1.0, -1.0], atol=1e-12)
    assert turn.known.all()


@pytest.mark.parametrize(
    ("attitude", "points"),
    [
        ((30.0, 0.0, 0.0), (-0.5, 0.0)),  # heading north, right side down: the camera looks west
        ((30.0, 0.0, 90.0), (0.0, 0.5)),  # heading east: north
        ((0.0, 30.0, 0.0), (0.0, 0.5)),  # nose up: ahead
        ((0.0, -30.0, 270.0), (0.5, 0.0)),  # nose down, heading west: behind, which is east
    ],
)
def test_which_way_it_looks(attitude, points):
    turn = CAMERA.camera_turn(np.array([attitude]))
    np.testing.assert_allclose(turn.axes[0], [*points, -math.cos(math.radians(30.0))], atol=1e-12)


def test_a_track_rolled_by_30_degrees_covers_other_cells():
    site = make_site(cell_m=5.0)
    coverage = CoverageMap(site, cell_size_m=5.0)
    level = with_attitude(fly_along(site, PATH), yaw=90.0)
    rolled = with_attitude(level, roll=30.0, yaw=90.0)
    straight, slanted = (flown_coverage(coverage, track, None).seen for track in (level, rolled))
    assert middle_north(coverage, straight) == pytest.approx(100.0, abs=1.0)
    # 80 m above ground the axis meets it 80 tan(30) = 46 m to the left of the track, which is north.
    assert middle_north(coverage, slanted) > 130.0
    assert (straight & ~slanted).sum() > 0.2 * straight.sum()
    assert verify_track(site, coverage, rolled, None).coverage_fraction != pytest.approx(
        verify_track(site, coverage, level, None).coverage_fraction, abs=0.01
    )


def test_a_gimbal_and_a_sphere_see_the_same_whatever_the_attitude():
    for sensor in (
        NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0, mount="stabilised"),
        SphereSensor(kind="sphere", range_m=110.0, sensing="along-path"),
    ):
        site = make_site(sensor=sensor)
        coverage = CoverageMap(site, cell_size_m=10.0)
        level = fly_along(site, PATH)
        rolled = with_attitude(level, roll=30.0)
        np.testing.assert_array_equal(
            flown_coverage(coverage, level, None).seen, flown_coverage(coverage, rolled, None).seen
        )
        assert verify_track(site, coverage, with_attitude(level, roll=math.nan), None).unknown_attitude_looks == 0


def test_what_an_unknown_attitude_saw_is_possibly_seen():
    site = make_site()
    coverage = CoverageMap(site, cell_size_m=10.0)
    level = fly_along(site, PATH)
    unknown = with_attitude(level, roll=math.nan, pitch=5.0)
    report, known = verify_track(site, coverage, unknown, None), verify_track(site, coverage, level, None)
    assert report.unknown_attitude_looks >= len(level) - 1
    assert known.unknown_attitude_looks == 0
    assert report.coverage_fraction == 0.0
    # Whichever way it leaned: more than what a level camera sees.
    assert report.possibly_covered_fraction > known.coverage_fraction > 0.3
    assert {gap.reason for gap in report.gaps if gap.area_m2 > 1000.0} == {"attitude-not-known"}


def test_between_two_samples_the_attitude_turns_the_short_way():
    site = make_site()
    points = np.array([[100.0, 100.0, 80.0], [120.0, 100.0, 80.0]])
    track = track_of(site, points, time_s=np.array([0.0, 2.0]), current_waypoint=np.array([1, 1]))
    track = changed(track, attitude_deg=np.array([[30.0, 0.0, 350.0], [30.0, 0.0, 10.0]]))
    coverage = CoverageMap(site, cell_size_m=10.0)
    seen = flown_coverage(coverage, track, None).seen
    # Heading north all the time: rolled right it looks west, never east.
    assert coverage.grid.cells.centre_m[seen, 0].max() < 150.0
    assert coverage.grid.cells.centre_m[seen, 0].min() < 20.0


def test_while_the_nose_turns_a_camera_is_looked_through_between_two_samples_too():
    """Ten places a second are 6 degrees apart: what a tilted camera showed between them did not count."""
    site = make_site(sensor=FrameCamera(
        kind="frame-camera", fov_across_deg=50.0, fov_along_deg=40.0, range_m=250.0, pitch_deg=-50.0, mount="stabilised"
    ))  # fmt: skip
    shares, yaw_deg = np.linspace(0.0, 1.0, 41), 50.0

    def seen(shares):
        points = np.column_stack([100.0 + 2.0 * shares, np.full(len(shares), 100.0), np.full(len(shares), 80.0)])
        track = track_of(site, points, time_s=4.0 * shares, current_waypoint=np.ones(len(shares), dtype=int))
        attitude = np.column_stack([0.0 * shares, 0.0 * shares, (yaw_deg + 80.0 * shares) % 360.0])
        coverage = CoverageMap(site, cell_size_m=2.0)
        return flown_coverage(coverage, changed(track, attitude_deg=attitude), None).seen

    every_two, few = seen(shares), seen(shares[::8])
    assert np.array_equal(every_two, few)
    assert every_two.sum() > 100
