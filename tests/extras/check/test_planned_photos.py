"""Camera items by their meaning: when a picture is taken, and where the camera looks."""

import dataclasses
import math

import pytest

from mission_io.model.items import Command, Frame, MissionItem
from tests.extras.check.worlds import COPTER, HOME_M, command, home, lat_lon, mission, up, waypoint, world
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.planned_photos import PlannedPhotos, Series, planned_photos

PX4 = dataclasses.replace(COPTER, autopilot="px4")
EAST, NORTH_EAST = waypoint(100.0, 0.0, 50.0), waypoint(100.0, 100.0, 50.0)


def photos(*items: MissionItem, aircraft=COPTER, **more) -> PlannedPhotos:
    whole, position = mission(up(), *items, home()), world()
    return planned_photos(whole, flown_path(whole, position, aircraft), position, aircraft, **more)


def positions(found: PlannedPhotos) -> list[tuple[float, float]]:
    return [(round(float(e)), round(float(n))) for e, n, _ in found.positions_m]


def by_distance(metres: float, at_once: float = 1.0) -> MissionItem:
    return command(Command.DO_SET_CAM_TRIGG_DIST, metres, 0.0, at_once)


def gimbal(pitch_deg: float, yaw_deg: float = math.nan, flags: float = 0.0) -> MissionItem:
    return MissionItem(Command.DO_GIMBAL_MANAGER_PITCHYAW, Frame.COMMAND, (pitch_deg, yaw_deg, 0.0, 0.0), flags)


def test_by_distance_it_runs_on_round_corners() -> None:
    found = photos(by_distance(40.0), EAST, NORTH_EAST, by_distance(0.0), waypoint(0.0, 100.0, 50.0))
    # The straight line from (80, 0) is 40 m long at (100, 34.6).
    assert positions(found) == [(0, 0), (40, 0), (80, 0), (100, 35), (100, 75)]
    assert found.yaw_deg == pytest.approx([90.0, 90.0, 90.0, 0.0, 0.0], abs=0.01)
    assert found.items.tolist() == [3, 3, 3, 4, 4]
    later = photos(by_distance(40.0, 0.0), EAST, by_distance(0.0))
    assert positions(later) == [(40, 0), (80, 0)]


def test_by_time_as_often_as_it_says() -> None:
    start, stop = command(Command.IMAGE_START_CAPTURE, 0.0, 2.0, 0.0), command(Command.IMAGE_STOP_CAPTURE)
    assert positions(photos(start, EAST, stop, NORTH_EAST)) == [(20 * k, 0) for k in range(6)]
    assert photos(start, EAST, stop).least_gap_s == pytest.approx(2.0)
    three = command(Command.IMAGE_START_CAPTURE, 0.0, 2.0, 3.0)
    assert positions(photos(three, EAST, NORTH_EAST)) == [(0, 0), (20, 0), (40, 0)]
    cycle = command(214, 2500.0)
    assert positions(photos(cycle, EAST, command(214, 0.0))) == [(25 * k, 0) for k in range(5)]


def test_single_pictures() -> None:
    shutter = MissionItem(Command.DO_DIGICAM_CONTROL, Frame.COMMAND, lat_deg=1.0)
    found = photos(EAST, shutter, NORTH_EAST, command(Command.IMAGE_START_CAPTURE, 0.0, 0.0, 1.0))
    assert positions(found) == [(100, 0), (100, 100)]
    assert found.yaw_deg == pytest.approx([90.0, 0.0], abs=0.01)
    assert len(photos(EAST, MissionItem(Command.DO_DIGICAM_CONTROL, Frame.COMMAND)).items) == 0


def test_where_the_camera_looks() -> None:
    found = photos(gimbal(-60.0), by_distance(60.0), EAST, gimbal(-45.0, 10.0), NORTH_EAST, by_distance(0.0))
    assert found.pitch_deg.tolist() == [-60.0, -60.0, -45.0]
    assert found.yaw_deg == pytest.approx([90.0, 90.0, 10.0], abs=0.01)
    held = photos(gimbal(-60.0, 200.0, 16.0), by_distance(60.0), EAST, by_distance(0.0))
    assert held.yaw_deg == pytest.approx([200.0, 200.0], abs=0.01)
    mount = MissionItem(Command.DO_MOUNT_CONTROL, Frame.COMMAND, (-30.0, 0.0, 0.0, 0.0), alt_m=2.0)
    assert photos(mount, by_distance(60.0), EAST, by_distance(0.0)).pitch_deg.tolist() == [-30.0, -30.0]
    assert photos(by_distance(60.0), EAST, by_distance(0.0), pitch_deg=-80.0).pitch_deg.tolist() == [-80.0, -80.0]


def test_a_region_of_interest() -> None:
    roi = MissionItem(Command.DO_SET_ROI_LOCATION, Frame.ABOVE_HOME, (0.0,) * 4, *lat_lon(100.0, 100.0), 0.0)
    found = photos(roi, EAST, command(Command.IMAGE_START_CAPTURE, 0.0, 0.0, 1.0), NORTH_EAST)
    assert found.yaw_deg == pytest.approx([0.0], abs=0.01)
    assert found.pitch_deg == pytest.approx([-math.degrees(math.atan2(50.0, 100.0))], abs=0.05)
    above_sea = dataclasses.replace(roi, frame=Frame.AMSL, alt_m=HOME_M)
    assert photos(above_sea, EAST, command(2000, 0.0, 0.0, 1.0)).pitch_deg == pytest.approx(found.pitch_deg, abs=0.01)
    none = photos(roi, command(Command.DO_SET_ROI_NONE), EAST, command(2000, 0.0, 0.0, 1.0))
    assert none.pitch_deg.tolist() == [-90.0]


def test_the_nose() -> None:
    turned = photos(command(Command.CONDITION_YAW, 45.0), by_distance(60.0), EAST, NORTH_EAST, by_distance(0.0))
    assert turned.yaw_deg == pytest.approx([45.0, 45.0, 0.0], abs=0.01), "the next leg only"
    own = dataclasses.replace(EAST, params=(0.0, 0.0, 0.0, 30.0))
    assert photos(by_distance(60.0), own, by_distance(0.0), aircraft=PX4).yaw_deg == pytest.approx(
        [30.0, 30.0], abs=0.01
    )
    assert photos(by_distance(60.0), own, by_distance(0.0)).yaw_deg == pytest.approx([90.0, 90.0], abs=0.01), (
        "ArduPilot has no heading there"
    )


def test_jumps_take_their_pictures_again() -> None:
    again = command(Command.DO_JUMP, 2.0, 1.0)
    found = photos(by_distance(60.0), EAST, by_distance(0.0), waypoint(0.0, 0.0, 50.0), again)
    assert positions(found) == [(0, 0), (60, 0), (0, 0), (60, 0)]


def test_a_camera_behind_a_condition_is_named() -> None:
    waits = command(Command.CONDITION_DELAY, 20.0)
    assert photos(waits, command(183), by_distance(60.0), EAST, by_distance(0.0)).conditional == (4,)


def test_pictures_of_the_camera_itself() -> None:
    found = photos(EAST, NORTH_EAST, always=Series(distance_m=60.0))
    assert positions(found) == [(0, 0), (60, 0), (100, 45)]
    assert len(photos(EAST).items) == 0
    assert photos(command(2500), EAST).notes
    assert photos(command(2003, 1.0), EAST).notes
