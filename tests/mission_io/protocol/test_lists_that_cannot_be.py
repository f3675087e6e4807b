"""Lists that a vehicle cannot take: parts, broken fences, too long, empty; from both sides."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import common

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import items_of
from mission_io.errors import FormatError, MisuseError, TransferError
from mission_io.model.items import (
    Command,
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    MissionItem,
    MissionType,
)
from mission_io.wire.messages import MissionCount
from tests.mission_io.protocol.scripts import items
from tests.mission_io.protocol.two_sides import (
    BOTH,
    fence_answer,
    held,
    polygon_items,
    untested,
    vehicle,
    vehicle_script,
)
from tests.mission_io.vehicle import VehiclePeer, connected

FAULTS = (
    "write_partial", "bad_fences", "storage_exceeded", "empty_mission",
)  # fmt: skip


def test_each_fault_is_tested_from_both_sides() -> None:
    assert untested(FAULTS, globals()) == []


def partial_list(start: int, end: int) -> bytes:
    sender = common.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(common.MAVLink_mission_write_partial_list_message(1, 1, start, end).pack(sender))


@pytest.mark.parametrize(("start", "end"), [(0, 2), (-1, 5), (3, 1), (0, 32767)])
def test_vehicle_write_partial(start: int, end: int) -> None:
    """PX4 knows no parts, whatever their bounds: nothing is answered and nothing changes. ArduPilot: test_lists.py."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(MissionType.MISSION, items(5))
    peer.receive_datagram(partial_list(start, end), 0.0)
    assert [(r.message.start_index, r.message.end_index) for r in peer.heard] == [(start, end)]
    assert peer.server.messages_to_send(0.0) == []
    assert held(peer) == items(5)


def test_client_write_partial() -> None:
    """An upload never sends it: a list is replaced as a whole (``upload_part`` does)."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(MissionType.MISSION, items(9))
    connected(peer).upload(MissionType.MISSION, (*items(8), replace(items(9)[8], alt_m=1.0)))
    counts = [r.message.count for r in peer.heard if isinstance(r.message, MissionCount)]
    assert counts == [9]


RETURN = MissionItem(Command.NAV_FENCE_RETURN_POINT, Frame.AMSL, lat_deg=46.0, lon_deg=7.0)


@pytest.mark.parametrize(
    ("fence", "answer"),
    [
        (polygon_items(count=3, vertices=3), "ack ACCEPTED"),
        (polygon_items(count=0, vertices=3), "ack ERROR"),
        (polygon_items(count=5, vertices=3), "ack ERROR"),
        (polygon_items(count=2, vertices=2), "ack ERROR"),
        ([RETURN, RETURN], "ack ERROR"),
        ([replace(RETURN, lat_deg=100.0)], "ack INVALID_PARAM5_X"),
    ],
    ids=["good", "no vertices", "vertices missing", "two vertices", "two returns", "latitude 100"],
)
def test_vehicle_bad_fences(fence: list[MissionItem], answer: str) -> None:
    server = vehicle(ARDUPILOT)
    assert fence_answer(server, fence) == answer
    assert bool(server.items(MissionType.FENCE)) == (answer == "ack ACCEPTED")


def test_vehicle_bad_fences_in_a_frame_it_does_not_take() -> None:
    assert fence_answer(vehicle(PX4), [replace(RETURN, frame=Frame.ABOVE_TERRAIN)]) == "ack UNSUPPORTED_FRAME"


@pytest.mark.parametrize(
    "fence",
    [
        Fence((FencePolygon((LatLon(46.0, 7.0), LatLon(47.0, 8.0))),)),
        Fence((FencePolygon((LatLon(46.0, 7.0), LatLon(100.0, 8.0), LatLon(46.5, 7.5))),)),
        Fence((), (FenceCircle(LatLon(46.0, 7.0), 0.0, inclusion=False),)),
        Fence((), (), FramedPoint(math.nan, 7.0, 0.0, Frame.AMSL)),
    ],
    ids=["two vertices", "latitude 100", "no radius", "NaN"],
)
def test_client_bad_fences(fence: Fence) -> None:
    """Known before anything is sent."""
    peer = VehiclePeer(ARDUPILOT)
    with pytest.raises((MisuseError, FormatError)):
        connected(peer).upload_and_verify(fence)
    assert not [r for r in peer.heard if isinstance(r.message, MissionCount)]


@BOTH
def test_client_storage_exceeded(autopilot: Autopilot) -> None:
    peer = VehiclePeer(autopilot, capacity=3)
    peer.server.set_items(MissionType.MISSION, items(2))
    with pytest.raises(
        TransferError, match="NO_SPACE after 0 of 4 items; the vehicle's list is now unchanged"
    ) as caught:
        connected(peer).upload(MissionType.MISSION, items(4))
    assert caught.value.vehicle_holds == "unchanged"
    assert held(peer)[1:] == items(2)[1:]


def test_vehicle_storage_exceeded() -> None:
    server = vehicle(capacity=3, held=2)
    assert vehicle_script("count 4", server) == ["ack NO_SPACE"]
    assert len(server.items(MissionType.MISSION)) == 2


@BOTH
def test_client_empty_mission(autopilot: Autopilot) -> None:
    peer = VehiclePeer(autopilot)
    peer.server.set_items(MissionType.MISSION, items(5))
    client = connected(peer)
    client.upload(MissionType.MISSION, ())
    assert (held(peer), client.download(MissionType.MISSION)) == ((), ())


def test_vehicle_empty_mission() -> None:
    server = vehicle(held=3)
    assert vehicle_script("count 0", server) == ["ack ACCEPTED"]
    assert vehicle_script("list", server) == ["count 0"]


def test_a_fence_is_made_of_the_items_that_are_tested_here() -> None:
    corners = tuple(LatLon(46.0 + i * i, 7.0 + i) for i in range(3))
    assert [item.command for item in items_of(Fence((FencePolygon(corners),)), PX4)] == [
        item.command for item in polygon_items(count=3, vertices=3)
    ]
