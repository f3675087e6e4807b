"""One test for each row of what a simulated PX4 v1.17.0 was seen doing, on the mock vehicle."""

import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest

from mission_io.autopilots.autopilot import PX4, Mode
from mission_io.client.client import Client
from mission_io.errors import MissionIoError
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.enums import CommandResult, MissionResult
from mission_io.model.items import Command, Frame, MissionItem, MissionType
from mission_io.wire import messages as m
from tests.flight.scene import HOME, mission
from tests.mock.bench import Bench, go
from uavcover.mock.behaviour import OBSERVED
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle

RECORDED = OBSERVED[PX4.mav_autopilot]
PUNCTUAL = replace(RECORDED, stale_read_back=0.0)


def switched_on(seconds: float = 4.0, **options) -> Bench:
    options.setdefault("behaviour", PUNCTUAL)
    bench = Bench(PX4, **options)
    bench.run(seconds)
    return bench


def position(lat_deg: float = 36.5, alt_m: float = 30.0) -> MissionItem:
    return MissionItem(Command.NAV_WAYPOINT, Frame.ABOVE_HOME, (0.0,) * 4, lat_deg, -84.2, alt_m)


# "Item 0 is an ordinary item. Asks with MISSION_REQUEST_INT. Frames 0, 5 -> 5; 3, 6 -> 6; 10 and 11 refused. A command
# without a location needs frame 2."


def test_item_0_is_an_ordinary_item():
    bench = switched_on()
    bench.upload([position(36.4), position(36.5)])
    assert [item.lat_deg for item in bench.download()] == [36.4, 36.5]


def test_it_asks_with_request_int():
    assert type(switched_on().count(2)) is m.MissionRequestInt


@pytest.mark.parametrize(("sent", "back"), [(0, 5), (5, 5), (3, 6), (6, 6)])
def test_frames_come_back_changed(sent, back):
    bench = switched_on()
    bench.count(1)
    assert bench.send_raw_item(0, frame=sent).result == MissionResult.ACCEPTED
    assert bench.raw_item(0).frame == back


@pytest.mark.parametrize("frame", [10, 11])
def test_terrain_frames_are_refused(frame):
    bench = switched_on()
    bench.count(1)
    assert bench.send_raw_item(0, frame=frame).result == MissionResult.UNSUPPORTED_FRAME


@pytest.mark.parametrize(("frame", "result"), [(2, MissionResult.ACCEPTED), (6, MissionResult.UNSUPPORTED)])
def test_a_command_without_a_location_needs_frame_2(frame, result):
    bench = switched_on()
    bench.count(1)
    assert bench.send_raw_item(0, frame=frame, command=178).result == result


# "ACCEPTED is not validation: latitude 91, NaN altitude and a leg of 20 km were all accepted."


@pytest.mark.parametrize("item", [position(lat_deg=91.0), position(alt_m=math.nan), position(lat_deg=36.5 + 0.18)])
def test_accepted_is_not_validation(item):
    bench = switched_on()
    bench.upload([position(), item])


# "Reading back at once after the ACK returned the previous mission about once in 60 times: on a mismatch wait 100 ms and
# read once more."


def test_reading_back_at_once_returns_the_previous_mission_once_in_60_times():
    bench = switched_on(behaviour=RECORDED, rng=np.random.default_rng(2))
    stale, latitude = 0, 36.0
    for _ in range(600):
        latitude = round(latitude + 1e-4, 7)
        bench.upload([position(latitude)])
        if bench.download()[0].lat_deg != latitude:
            stale += 1
            bench.acknowledge()
            bench.run(0.2)
            assert bench.download()[0].lat_deg == latitude
        bench.acknowledge()
    assert stale == pytest.approx(10, abs=6)


# "A failed upload leaves the old mission whole. An upload that falls silent is dropped after 5 s (simulated) without any
# ACK. An unfinished download blocks uploads for 5.3 s."


def test_a_failed_upload_leaves_the_old_mission_whole():
    bench = switched_on()
    bench.upload([position(36.1), position(36.2), position(36.3)])
    bench.count(2)
    bench.send_item(0, position(36.9))
    assert bench.send_raw_item(1, frame=10).result == MissionResult.UNSUPPORTED_FRAME
    assert [item.lat_deg for item in bench.download()] == [36.1, 36.2, 36.3]


def test_an_upload_that_falls_silent_is_dropped_after_5_s_without_a_word():
    bench = switched_on(speed=10.0)
    bench.upload([position(36.1)])
    bench.count(2)
    bench.send_item(0, position(36.9))
    bench.said.clear()
    bench.run(4.9)
    assert bench.heard(m.MissionRequestInt)
    bench.run(0.2)
    bench.said.clear()
    bench.run(5.0)
    assert not bench.heard(m.MissionRequestInt)
    assert not bench.heard(m.MissionAck)
    assert [item.lat_deg for item in bench.download()] == [36.1]


def test_an_unfinished_download_blocks_uploads_for_5_3_s():
    bench = switched_on()
    bench.upload([position(36.1), position(36.2)])
    bench.send(m.MissionRequestList(1, 1))
    bench.run(5.2)
    assert bench.count(1) == m.MissionAck(255, 190, MissionResult.ERROR)
    bench.run(0.2)
    assert isinstance(bench.count(1), m.MissionRequestInt)


# "MISSION_ITEM_REACHED repeats and skips numbers: follow MISSION_CURRENT and the position as well. Ready to arm after about
# 3.4 s of simulated time."


def test_reached_items_repeat_and_skip():
    bench = switched_on()
    near = [go(0, 30 + 0.5 * n, 20, acceptance_radius_m=5.0) for n in range(4)]
    bench.take_off(*near, go(0, 90, 20))
    bench.run(40.0)
    reached = [message.seq for message in bench.heard(m.MissionItemReached)]
    assert len(reached) > len(set(reached))
    assert len(set(reached)) < 6
    assert reached == sorted(reached)
    assert {message.seq for message in bench.heard(m.MissionCurrent)} >= {4, 5}


def test_ready_to_arm_after_3_4_s():
    bench = switched_on(3.2)
    bench.upload([position()], MissionType.MISSION)
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.TEMPORARILY_REJECTED
    bench.run(0.3)
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
    assert "Ready for takeoff!" in [text.text for text in bench.heard(m.StatusText)]


# "At 50 times real time uploads failed: simulate at 10-20 times."


@pytest.mark.parametrize(("speed", "arrives"), [(10.0, True), (50.0, False)])
def test_at_50_times_real_time_its_time_outs_are_shorter_than_a_round_trip(speed, arrives):
    vehicle = MockVehicle(PX4, HOME, MockConfig(speed=speed, behaviour=PUNCTUAL))
    link = SimulatedLink(InMemoryPeer(vehicle, speed=speed), rng=Random(1), conditions=Conditions(delay_s=0.06))
    with Client(link) as client:
        client.wait_for_vehicle()
        if arrives:
            assert client.upload_and_verify(mission()).passed
        else:
            with pytest.raises(MissionIoError):
                client.upload_and_verify(mission())


# mission_base.cpp, checkClimbRequired: "Climb to %.1f meters above home"


def test_it_climbs_where_it_is_to_the_next_items_height_when_it_enters_its_mission_again():
    bench = switched_on()
    bench.take_off(go(0, 150, 20), go(0, 300, 60), go(0, 320, 60))
    while bench.vehicle.current_seq < 2:
        bench.run(0.5)
    bench.run(6.0)
    bench.set_mode(Mode.HOLD)
    bench.run(8.0)
    _, north_m, up_m = bench.vehicle.body.point.position_m
    assert 20.0 < up_m < 50.0
    bench.said.clear()
    bench.set_mode(Mode.MISSION)
    bench.run(0.1)
    texts = [message.text for message in bench.heard(m.StatusText)]
    assert "Climb to 60.0 meters above home" in texts
    while bench.vehicle.body.point.position_m[2] < 58.5:
        bench.run(0.2)
        assert abs(bench.vehicle.body.point.position_m[1] - north_m) < 2.0
    bench.set_mode(Mode.HOLD)
    bench.run(5.0)
    bench.said.clear()
    bench.set_mode(Mode.MISSION)
    bench.run(1.0)
    texts = [message.text for message in bench.heard(m.StatusText)]
    assert not any(text.startswith("Climb") for text in texts), "it is there already"
    bench.run(60.0)
    assert bench.vehicle.current_seq > 2
