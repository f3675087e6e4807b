"""Readers that nobody here wrote read our files to the same items."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mavsdk
import pytest
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavwp

from mission_io.autopilots import ARDUPILOT, PX4, home_item
from mission_io.formats import plan, wpl
from mission_io.items import Frame, MissionItem
from mission_io.link import UdpLink
from mission_io.wire import float32
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, RALLY
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


def of_mavwp(item: Any) -> MissionItem:
    params = (item.param1, item.param2, item.param3, item.param4)
    frame = Frame.from_mav_frame(item.frame)
    return MissionItem(item.command, frame, params, item.x, item.y, item.z, bool(item.autocontinue))


def test_pymavlink_reads_our_waypoints(tmp_path: Path) -> None:
    path = tmp_path / "mission.waypoints"
    path.write_text(wpl.write_mission(MISSION), newline="")
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == 9
    assert [of_mavwp(loader.wp(number)) for number in range(9)] == [home_item(HOME), *MISSION.items]


@pytest.fixture(scope="module", params=[ARDUPILOT, PX4], ids=lambda a: a.name)
def importer(request: pytest.FixtureRequest) -> Iterator[MissionRaw]:
    """MAVSDK's importers; they go by the vehicle that is connected, so one of ours is."""
    mavsdk.log_subscribe(lambda *_: True)
    link = UdpLink.listening()
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    ground = mavsdk.Mavsdk(configuration)
    ground.add_any_connection(f"udpout://127.0.0.1:{link.local_port}")
    with flying_on(link, VehiclePeer(request.param)):
        system = ground.first_autopilot(10.0)
        assert system is not None
        raw = MissionRaw(system)
        raw.autopilot_of_test = request.param
        yield raw
        raw.destroy()
        ground.destroy()


def of_mavsdk(item: Any) -> MissionItem:
    frame = Frame.from_mav_frame(item.frame)
    scale = 1e7 if frame is not Frame.COMMAND else 1.0
    return MissionItem(
        item.command,
        frame,
        (item.param1, item.param2, item.param3, item.param4),
        item.x / scale,
        item.y / scale,
        item.z,
        bool(item.autocontinue),
    )


def as_32_bits(item: MissionItem) -> MissionItem:
    p1, p2, p3, p4 = (float32(value) for value in item.params)
    alt_m = float32(item.alt_m)
    return MissionItem(item.command, item.frame, (p1, p2, p3, p4), item.lat_deg, item.lon_deg, alt_m, item.autocontinue)


def test_mavsdk_reads_our_waypoints(importer: MissionRaw) -> None:
    read = importer.import_mission_planner_mission_from_string(wpl.write_mission(MISSION)).mission_items
    items = [of_mavsdk(item) for item in read]
    expected = [as_32_bits(item) for item in (home_item(HOME), *MISSION.items)]
    assert items[-len(expected) :] == expected
    # It inserts a home row of its own for ArduPilot, and keeps ours.
    assert len(items) - len(expected) == int(importer.autopilot_of_test.home_in_item_0)


def test_mavsdk_reads_our_plan(importer: MissionRaw) -> None:
    autopilot = importer.autopilot_of_test
    text = plan.write(plan.PlanFile(MISSION, FENCE, RALLY, mav_autopilot=autopilot.mav_autopilot))
    read = importer.import_qgroundcontrol_mission_from_string(text)
    items = [of_mavsdk(item) for item in read.mission_items]
    expected = [as_32_bits(item) for item in MISSION.items]
    assert items[-len(expected) :] == expected
    assert len(items) - len(expected) == int(autopilot.home_in_item_0)
    assert [round(point.x / 1e7, 7) for point in read.rally_items] == [33.2, 33.23]
    assert len(read.geofence_items) == 8
