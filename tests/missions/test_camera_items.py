"""Gimbal and pictures in missions, for both autopilots and through both file formats."""

import dataclasses

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.autopilots.mission_lists import command_read_back, stored_item
from mission_io.formats import plan, wpl
from mission_io.model.actions import PointGimbal, PointMount, StartPictures, TakePicture, TriggerEvery, action_of
from mission_io.model.items import Command
from tests.planner.sites import CAMERA, make_site
from uavcover.errors import InfeasibleError
from uavcover.flight.orders import FlightPlan
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.route import Route
from uavcover.model.sensor import DiscSensor, FrameCamera, SphereSensor
from uavcover.sensing.sensors import trigger_distance_m

ROUTE = Route(np.array([[0.0, 20.0, 80.0], [150.0, 20.0, 80.0], [150.0, 120.0, 70.0]]))
FRAME = FrameCamera(
    kind="frame-camera", fov_across_deg=70.0, fov_along_deg=50.0, range_m=200.0, pitch_deg=-60.0, mount="stabilised",
    heading_deg=90.0, forward_overlap=0.75,
)  # fmt: skip


def compiled(sensor, autopilot):
    return compile_mission(make_site(sensor=sensor), ROUTE, autopilot=autopilot)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_pictures_begin_at_the_first_planned_waypoint_and_end_after_the_last(autopilot):
    result = compiled(FRAME, autopilot)
    items, first = result.mission.items, result.first_waypoint_item
    planned = items[first : first + result.waypoint_count]
    assert [item.command for item in planned] == [Command.NAV_WAYPOINT] * 3
    distance_m = trigger_distance_m(make_site(sensor=FRAME).scenario)
    # The vehicle stands at the first planned waypoint when the command in front of it is carried out.
    assert items[first - 2] == planned[0]
    assert action_of(items[first - 1]) == TriggerEvery(distance_m, at_once=True)
    assert action_of(items[first + 3]) == TriggerEvery(0.0)
    assert [item.command for item in items].count(Command.DO_SET_CAM_TRIGG_DIST) == 2
    assert items[-1].command == Command.NAV_LAND


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize(
    "sensor",
    [
        SphereSensor(kind="sphere", range_m=120.0),
        DiscSensor(kind="disc", radius_m=50.0),
        dataclasses.replace(FRAME, sensing="at-waypoints", forward_overlap=None),
    ],
    ids=lambda sensor: sensor.kind,
)
def test_a_picture_is_taken_at_every_waypoint_that_the_sensor_looks_from(sensor, autopilot):
    result = compiled(sensor, autopilot)
    items, first = result.mission.items, result.first_waypoint_item
    assert (result.waypoint_count, result.items_per_waypoint) == (3, 2)
    for number in range(3):
        planned, photo = items[first + 2 * number : first + 2 * number + 2]
        assert planned.command == Command.NAV_WAYPOINT
        px4 = StartPictures(count=1, first_number=number + 1)
        assert action_of(photo) == (px4 if autopilot == "px4" else TakePicture())
    # Nowhere else: the way there, the way home and the landing follow without one.
    photos = {Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE, Command.DO_SET_CAM_TRIGG_DIST}
    assert sum(item.command in photos for item in items) == 3
    assert items[first + 6].command == Command.NAV_WAYPOINT
    plan = FlightPlan(
        mission=result.mission, first_waypoint_item=first, waypoint_count=3, items_per_waypoint=2, home=result.mission.home,
        frame=make_site(sensor=sensor).frame,
    )  # fmt: skip
    np.testing.assert_allclose(plan.waypoints_m(), ROUTE.waypoints_m, atol=0.02)
    own = PX4 if autopilot == "px4" else ARDUPILOT
    seqs = range(len(items) + own.home_in_item_0)
    numbers = [plan.waypoint_of(seq, own) for seq in seqs]
    at = first + own.home_in_item_0
    assert numbers == [-1] * at + [0, 0, 1, 1, 2, 2] + [-1] * (len(numbers) - at - 6)
    assert [plan.is_past_waypoints(seq, own) for seq in seqs] == [seq >= at + 6 for seq in seqs]


@pytest.mark.parametrize(("name", "autopilot"), [("ardupilot", ARDUPILOT), ("px4", PX4)])
def test_pictures_at_waypoints_survive_storage_and_files(name, autopilot):
    result = compiled(SphereSensor(kind="sphere", range_m=120.0), name)
    for item in result.mission.items:
        if not item.has_position:
            back = command_read_back(stored_item(item, autopilot))
            assert (back.command, back.params, back.lat_deg) == (item.command, item.params, item.lat_deg)
    file = plan.PlanFile(result.mission, result.fence, result.rally, mav_autopilot=int(autopilot.mav_autopilot))
    for again in (plan.read(plan.write(file)).mission, wpl.read(wpl.write_mission(result.mission)).mission()):
        shots = [action_of(i) for i in again.items if not i.has_position]
        assert shots == [action_of(i) for i in result.mission.items if not i.has_position]


def test_a_gimbal_is_pointed_in_each_autopilots_terms():
    ardupilot, px4 = compiled(FRAME, "ardupilot"), compiled(FRAME, "px4")
    gimbal = [action_of(item) for item in ardupilot.mission.items if isinstance(action_of(item), PointGimbal)]
    assert gimbal == [PointGimbal(-60.0, 90.0, 0.0, 0.0, flags=16)]
    mount = [action_of(item) for item in px4.mission.items if isinstance(action_of(item), PointMount)]
    assert mount == [PointMount(-60.0)]
    # PX4 keeps the heading by its waypoints; ArduPilot does not store this value there.
    for result, keeps in ((ardupilot, False), (px4, True)):
        at = result.first_waypoint_item
        assert {item.params[3] == 90.0 for item in result.mission.items[at : at + 3]} == {keeps}
    follows = dataclasses.replace(FRAME, heading_deg=None)
    gimbal = [a for a in map(action_of, compiled(follows, "ardupilot").mission.items) if isinstance(a, PointGimbal)]
    assert gimbal == [PointGimbal(-60.0, 0.0, 0.0, 0.0, flags=0)]


@pytest.mark.parametrize(("name", "autopilot"), [("ardupilot", ARDUPILOT), ("px4", PX4)])
def test_the_commands_survive_storage_and_files(name, autopilot):
    mission = compiled(FRAME, name).mission
    for item in mission.items:
        if not item.has_position:
            assert dataclasses.replace(
                command_read_back(stored_item(item, autopilot)), frame=item.frame, autocontinue=True
            ) == dataclasses.replace(item, params=tuple(map(float, np.float32(item.params))))
    result = compiled(FRAME, name)
    file = plan.PlanFile(mission, result.fence, result.rally, mav_autopilot=int(autopilot.mav_autopilot))
    for again in (plan.read(plan.write(file)).mission, wpl.read(wpl.write_mission(mission)).mission()):
        assert [item.command for item in again.items] == [item.command for item in mission.items]
        for mine, back in zip(mission.items, again.items, strict=True):
            if mine.command != Command.NAV_WAYPOINT or name == "px4":
                np.testing.assert_allclose(np.nan_to_num(back.params), np.nan_to_num(mine.params), rtol=1e-6)


def test_a_fixed_or_round_camera_without_such_wishes_has_no_commands():
    commands = {item.command for item in compiled(CAMERA, "ardupilot").mission.items}
    assert commands == {Command.NAV_TAKEOFF, Command.DO_CHANGE_SPEED, Command.NAV_WAYPOINT, Command.NAV_LAND}
    down = dataclasses.replace(CAMERA, mount="stabilised")
    assert PointGimbal(-90.0, 0.0, 0.0, 0.0) in [action_of(item) for item in compiled(down, "ardupilot").mission.items]


def test_an_angle_that_ardupilot_would_change_is_refused():
    half = dataclasses.replace(FRAME, pitch_deg=-60.5)
    with pytest.raises(
        InfeasibleError, match=r"^sensor.pitch_deg: ArduPilot stores .* whole degrees and would change -60.5"
    ):
        compiled(half, "ardupilot")
    assert compiled(half, "px4").waypoint_count == 3


def test_the_way_between_pictures_follows_from_the_overlap_at_the_lowest_height():
    level = dataclasses.replace(FRAME, pitch_deg=-90.0)
    scenario = make_site(sensor=level).scenario
    length_m = 2.0 * 40.0 * np.tan(np.radians(25.0))
    assert trigger_distance_m(scenario) == pytest.approx(0.25 * length_m)
    tilted = make_site(sensor=dataclasses.replace(FRAME, forward_overlap=0.0)).scenario
    ends = 40.0 * np.tan(np.radians([30.0 - 25.0, 30.0 + 25.0]))
    assert trigger_distance_m(tilted) == pytest.approx(ends[1] - ends[0])
    said = dataclasses.replace(FRAME, forward_overlap=None, trigger_distance_m=12.5)
    assert trigger_distance_m(make_site(sensor=said).scenario) == 12.5
    neither = dataclasses.replace(FRAME, forward_overlap=None)
    assert trigger_distance_m(make_site(sensor=neither).scenario) is None
