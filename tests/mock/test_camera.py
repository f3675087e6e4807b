"""Pictures of the mock vehicle: where its mission wants them, told in the autopilot's own message."""

import itertools
import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.actions import StartPictures, TakePicture, TriggerEvery, item_of
from mission_io.wire import messages as m
from tests.mock.bench import Bench, go

CORNERS_M = [(0.0, 20.0, 20.0), (0.0, 130.0, 20.0), (37.0, 130.0, 20.0), (37.0, 15.0, 20.0)]
BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=["ardupilot", "px4"])


def report_of(autopilot):
    return m.CameraFeedback if autopilot is ARDUPILOT else m.CameraImageCaptured


def positions_m(bench: Bench) -> np.ndarray:
    frame = bench.vehicle.body.frame
    found = bench.heard(report_of(bench.vehicle.autopilot))
    return np.array([frame.enu_from_geodetic(p.lat_deg, p.lon_deg, p.alt_amsl_m)[0] for p in found]).reshape(-1, 3)


def flown(autopilot, *items) -> Bench:
    bench = Bench(autopilot)
    bench.run(50.0)
    bench.take_off(*items)
    bench.run(90.0)
    return bench


@BOTH
@pytest.mark.parametrize("distance_m", [6.5, 20.0, 55.0])
def test_pictures_by_distance_run_on_round_corners_until_they_are_stopped(autopilot, distance_m):
    first, *others = (go(*position) for position in CORNERS_M)
    start, stop = item_of(TriggerEvery(distance_m, at_once=True)), item_of(TriggerEvery(0.0))
    bench = flown(autopilot, first, start, *others, stop, go(-40.0, 15.0, 20.0))
    taken = positions_m(bench)
    steps = np.hypot(*np.diff(taken[:, :2], axis=0).T)
    # The straight line over ground from the last one, checked every 20 ms of a flight at up to 10 m/s.
    assert (steps >= distance_m - 0.02).all()
    assert (steps <= distance_m + 0.3).all()
    assert math.dist(taken[0, :2], CORNERS_M[0][:2]) < 5.0
    path_m = sum(math.dist(a, b) for a, b in itertools.pairwise(CORNERS_M))
    assert 1 + (path_m - 30.0 - 3 * distance_m) / distance_m <= len(taken) <= 1 + path_m / distance_m
    assert taken[:, 0].min() > -6.0  # none on the way behind the last waypoint


@BOTH
def test_a_picture_at_each_waypoint_and_nowhere_else(autopilot):
    shot = item_of(TakePicture() if autopilot is ARDUPILOT else StartPictures(count=1))
    pairs = [item for position in CORNERS_M for item in (go(*position), shot)]
    bench = flown(autopilot, *pairs, go(-40.0, 15.0, 20.0))
    taken = positions_m(bench)
    assert len(taken) == len(CORNERS_M)
    np.testing.assert_allclose(taken, CORNERS_M, atol=6.0)
    numbers = [report.number for report in bench.heard(report_of(autopilot))]
    assert numbers == ([1, 2, 3, 4] if autopilot is ARDUPILOT else [0, 1, 2, 3])
    assert not bench.heard(report_of(PX4 if autopilot is ARDUPILOT else ARDUPILOT))


@BOTH
def test_how_the_vehicle_is_turned_is_told(autopilot):
    shot = item_of(TakePicture() if autopilot is ARDUPILOT else StartPictures(count=1))
    bench = flown(autopilot, go(0.0, 90.0, 20.0), shot, go(0.0, 180.0, 20.0))
    [report] = bench.heard(report_of(autopilot))
    if autopilot is ARDUPILOT:
        assert abs(math.remainder(report.yaw_deg, 360.0)) < 3.0
        assert (abs(report.roll_deg), abs(report.pitch_deg)) < (5.0, 40.0)
    else:
        w, x, y, z = report.quaternion
        assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
        assert abs(math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))) < 3.0
    assert report.alt_above_home_m == pytest.approx(20.0, abs=2.0)


@BOTH
def test_other_camera_commands_take_no_picture(autopilot):
    zoom = item_of(TakePicture(photos=0, zoom=2.0))
    series = item_of(StartPictures(interval_s=2.0))
    assert not len(positions_m(flown(autopilot, go(0.0, 60.0, 20.0), zoom, series, go(0.0, 120.0, 20.0))))
