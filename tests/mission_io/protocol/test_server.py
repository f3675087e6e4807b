import math
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import items_of, refusal_of
from mission_io.errors import MisuseError
from mission_io.model.enums import MissionResult
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    GeoPoint,
    LatLon,
    MissionItem,
    MissionType,
    change_speed,
    waypoint,
)
from mission_io.protocol.server import MissionServer
from mission_io.wire.messages import Heartbeat, MissionCount, MissionItemFloat, Received, message_from_item
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play, text


def server(autopilot: Autopilot, held: int = 0) -> MissionServer:
    made = MissionServer(autopilot, local=VEHICLE)
    made.set_items(MissionType.MISSION, items(held))
    return made


def test_a_failed_upload_leaves_ardupilot_with_a_mixture_and_px4_with_the_old_list() -> None:
    old = tuple(replace(item, alt_m=999.0) for item in items(5))
    for autopilot, left in ((ARDUPILOT, [100.0, 999.0, 999.0]), (PX4, [999.0] * 5)):
        vehicle = server(autopilot)
        vehicle.set_items(MissionType.MISSION, old)
        play(vehicle, "count 3, item 0, wait 9", sender=GROUND, to=VEHICLE)
        assert [item.alt_m for item in vehicle.items(MissionType.MISSION)] == left
        assert [event.reason for event in vehicle.events()] == (["upload failed"] if autopilot is ARDUPILOT else [])


def test_events_say_what_the_vehicle_holds_now() -> None:
    vehicle = server(PX4)
    play(vehicle, "count 2, item 0, item 1, clear /all", sender=GROUND, to=VEHICLE)
    uploaded, *cleared = vehicle.events()
    assert (uploaded.reason, uploaded.mission_type, len(uploaded.items)) == ("uploaded", MissionType.MISSION, 2)
    assert [(event.reason, event.mission_type) for event in cleared] == [("cleared", t) for t in MissionType]
    assert vehicle.events() == []


def test_ardupilot_overwrites_item_0_with_its_own_home() -> None:
    vehicle = server(ARDUPILOT, held=3)
    vehicle.home = GeoPoint(46.9, -7.1, 512.0)
    first, *rest = vehicle.items(MissionType.MISSION)
    assert (first.lat_deg, first.lon_deg, first.alt_m, first.frame) == (46.9, -7.1, 512.0, Frame.AMSL)
    assert rest == list(items(3)[1:])


def test_ardupilot_has_no_space_just_after_boot() -> None:
    vehicle = MissionServer(ARDUPILOT, local=VEHICLE, booted_at=10.0)
    assert play(vehicle, "count 2", sender=GROUND, to=VEHICLE, now=11.0) == ["ack NO_SPACE"]
    assert play(vehicle, "count 2", sender=GROUND, to=VEHICLE, now=12.1) == ["oldreq 0"]


def test_a_list_beyond_its_capacity_cannot_be_put_in() -> None:
    with pytest.raises(MisuseError, match="the list has 3 items, but this vehicle stores at most 2"):
        MissionServer(PX4, local=VEHICLE, capacity=2).set_items(MissionType.RALLY, items(3))


def test_messages_for_others_and_of_other_kinds_pass_by() -> None:
    vehicle = server(PX4)
    vehicle.receive(Received(Heartbeat(8, 6), 255, 190), 0.0)
    assert play(vehicle, "count 2", sender=GROUND, to=VEHICLE._replace(system_id=7)) == []


@pytest.mark.parametrize("size", [2, 4])
def test_a_fence_polygon_with_missing_vertices_is_an_error(size: int) -> None:
    vehicle = server(ARDUPILOT)
    polygon = FencePolygon(tuple(LatLon(46.0 + i, 7.0) for i in range(3)))
    fence = [replace(item, params=(float(size), 0.0, 0.0, 0.0)) for item in items_of_fence(polygon)]
    vehicle.receive(received(MissionType.FENCE, count=len(fence)), 0.0)
    for seq, item in enumerate(fence):
        vehicle.receive(received(MissionType.FENCE, item=item, seq=seq), 0.0)
    assert text(vehicle.messages_to_send(0.0)[-1]) == "ack ERROR"
    assert vehicle.items(MissionType.FENCE) == ()


def items_of_fence(polygon: FencePolygon) -> tuple[MissionItem, ...]:
    return items_of(Fence((polygon,)), ARDUPILOT)


def received(mission_type: MissionType, *, item: MissionItem | None = None, seq: int = 0, count: int = 0) -> Received:
    if item is None:
        return Received(MissionCount(1, 1, count, mission_type), 255, 190)
    message = message_from_item(item, seq, mission_type=mission_type, target_system=1, target_component=1)
    return Received(message, 255, 190)


GOOD = waypoint(46.0, -7.0, 50.0, frame=Frame.ABOVE_HOME)


@pytest.mark.parametrize(
    ("item", "ardupilot", "px4"),
    [
        (GOOD, None, None),
        (replace(GOOD, lat_deg=91.0), MissionResult.INVALID_PARAM5_X, None),
        (replace(GOOD, lon_deg=-181.0), MissionResult.INVALID_PARAM6_Y, None),
        (replace(GOOD, alt_m=math.nan), MissionResult.INVALID_PARAM7, None),
        (replace(GOOD, params=(math.nan, 0.0, 0.0, 0.0)), MissionResult.INVALID_PARAM1, None),
        (replace(GOOD, params=(0.0, 0.0, 0.0, math.nan)), None, None),
        (replace(GOOD, frame=Frame.ABOVE_TERRAIN), None, MissionResult.UNSUPPORTED_FRAME),
        (change_speed(5.0), None, None),
        (replace(change_speed(5.0), frame=Frame.ABOVE_HOME), None, MissionResult.UNSUPPORTED),
        (MissionItem(Command.NAV_DELAY, Frame.COMMAND, (math.nan, 0.0, 0.0, 0.0)), MissionResult.INVALID_PARAM1, None),
    ],
)
def test_what_each_autopilot_takes(
    item: MissionItem, ardupilot: MissionResult | None, px4: MissionResult | None
) -> None:
    message = message_from_item(item, 0, mission_type=MissionType.MISSION, target_system=1, target_component=1)
    assert (refusal_of(message, ARDUPILOT), refusal_of(message, PX4)) == (ardupilot, px4)


def test_the_deprecated_item_is_taken_too() -> None:
    vehicle = server(PX4)
    play(vehicle, "count 1", sender=GROUND, to=VEHICLE)
    item = MissionItemFloat(1, 1, 0, 3, 16, (0.0, 0.0, 0.0, 0.0), 46.5, -7.25, 20.0)
    vehicle.receive(Received(item, 255, 190), 0.0)
    assert vehicle.items(MissionType.MISSION)[0].lat_deg == 46.5
