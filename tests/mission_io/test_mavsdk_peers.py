"""Both sides of the protocol against MAVSDK, over real UDP: its client with our vehicle, our client with its vehicle."""

import queue
from collections.abc import Iterator
from typing import Any

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.autopilots.mission_lists import items_of
from mission_io.client.client import Client
from mission_io.errors import TransferCancelledError
from mission_io.links.datagrams import UdpLink
from mission_io.model.items import (
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    MissionItem,
    MissionType,
    RallyPoints,
)
from mission_io.wire.messages import message_from_item
from tests.mission_io.protocol.scripts import items
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer

mavsdk = pytest.importorskip("mavsdk", reason="MAVSDK is not installed")
mission_raw = pytest.importorskip("mavsdk.plugins.mission_raw")
mission_raw_server = pytest.importorskip("mavsdk.plugins.mission_raw_server")
pytestmark = pytest.mark.timeout(120)

CORNERS = tuple(LatLon(46.0 + i * i, -7.0 + i) for i in range(4))
FENCE = Fence((FencePolygon(CORNERS),), (FenceCircle(LatLon(46.1, -7.2), 123.0, inclusion=False),))
RALLY = RallyPoints((FramedPoint(46.2, -7.3, 30.0), FramedPoint(46.3, -7.4, 40.0)))


def raw_items(sent: tuple[MissionItem, ...], mission_type: MissionType) -> list[Any]:
    raw = []
    for seq, item in enumerate(sent):
        m = message_from_item(item, seq, mission_type=mission_type, target_system=1, target_component=1)
        raw.append(
            mission_raw.MissionItem(
                seq, m.frame, m.command, m.current, m.autocontinue, *m.params, m.x, m.y, m.z, int(mission_type)
            )
        )
    return raw


def numbers(raw: Any) -> tuple[Any, ...]:
    return (raw.seq, raw.frame, raw.command, raw.param1, raw.param2, raw.x, raw.y, raw.z)


@pytest.fixture(params=[ARDUPILOT, PX4], ids=lambda a: a.name)
def our_vehicle(request: pytest.FixtureRequest) -> Iterator[tuple[VehiclePeer, Any]]:
    """Our vehicle, and MAVSDK's client that found it."""
    mavsdk.log_subscribe(lambda *_: True)
    link, peer = UdpLink.listening(), VehiclePeer(request.param)
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    ground = mavsdk.Mavsdk(configuration)
    with flying_on(link, peer):
        ground.add_any_connection(f"udpout://127.0.0.1:{link.local_port}")
        system = ground.first_autopilot(30.0)
        assert system is not None
        raw = mission_raw.MissionRaw(system)
        yield peer, raw
        raw.destroy()
        ground.destroy()


def test_its_client_uploads_to_our_vehicle_and_reads_back(our_vehicle: tuple[VehiclePeer, Any]) -> None:
    peer, raw = our_vehicle
    sent = raw_items(items(40), MissionType.MISSION)
    raw.upload_mission(sent)
    assert peer.server.items(MissionType.MISSION) == items(40)
    for item in sent:  # ArduPilot gives items back in the frames of floating-point coordinates
        item.frame = item.frame if peer.autopilot.returns_int_frames else int(Frame.from_mav_frame(item.frame))
    assert [numbers(item) for item in raw.download_mission()] == [numbers(item) for item in sent]
    raw.clear_mission()  # on ArduPilot it leaves an item for home
    assert len(peer.server.items(MissionType.MISSION)) == int(peer.autopilot.home_in_item_0)


def test_its_client_uploads_fence_and_rally_points(our_vehicle: tuple[VehiclePeer, Any]) -> None:
    peer, raw = our_vehicle
    fence, rally = items_of(FENCE, peer.autopilot), items_of(RALLY, peer.autopilot)
    raw.upload_geofence(raw_items(fence, MissionType.FENCE))
    raw.upload_rally_points(raw_items(rally, MissionType.RALLY))
    assert [(i.command, i.lat_deg, i.lon_deg) for i in peer.server.items(MissionType.FENCE)] == [
        (i.command, i.lat_deg, i.lon_deg) for i in fence
    ]
    assert len(peer.server.items(MissionType.RALLY)) == 2
    assert [item.command for item in raw.download_geofence()] == [item.command for item in fence]


class TheirVehicle:
    """MAVSDK's mission server, and the plans that it was given."""

    def __init__(self, port: int) -> None:
        mavsdk.log_subscribe(lambda *_: True)
        configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.AUTOPILOT)
        self._vehicle = mavsdk.Mavsdk(configuration)
        self._server = mission_raw_server.MissionRawServer(self._vehicle.server_component(0))
        self.plans: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._server.subscribe_incoming_mission(lambda result, plan, _: self.plans.put((result, plan)))
        self._vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")

    def close(self) -> None:
        self._server.destroy()
        self._vehicle.destroy()


@pytest.fixture
def their_vehicle() -> Iterator[tuple[TheirVehicle, Client]]:
    """MAVSDK's vehicle, and our client that found it."""
    link = UdpLink.listening()
    vehicle = TheirVehicle(link.local_port)
    with Client(link) as client:
        client.wait_for_vehicle(30.0)
        yield vehicle, client
        vehicle.close()


def test_our_client_uploads_to_its_vehicle_and_reads_back(their_vehicle: tuple[TheirVehicle, Client]) -> None:
    vehicle, client = their_vehicle
    client.upload(MissionType.MISSION, items(60))
    result, plan = vehicle.plans.get(timeout=60.0)
    while result == mission_raw_server.MissionRawServerResult.BUSY:  # a COUNT that came twice, on a slow machine
        result, plan = vehicle.plans.get(timeout=60.0)
    assert result == mission_raw_server.MissionRawServerResult.SUCCESS
    assert [numbers(item) for item in plan.mission_items] == [
        numbers(item) for item in raw_items(items(60), MissionType.MISSION)
    ]
    assert client.download(MissionType.MISSION) == items(60)
    client.upload(MissionType.MISSION, items(3))
    assert client.download(MissionType.MISSION) == items(3)
    client.clear(MissionType.MISSION)
    assert client.download(MissionType.MISSION) == ()


def test_our_client_cancels_an_upload_to_its_vehicle(their_vehicle: tuple[TheirVehicle, Client]) -> None:
    _, client = their_vehicle
    observed: list[int] = []
    with pytest.raises(TransferCancelledError):
        client.upload(
            MissionType.MISSION,
            items(200),
            progress=lambda done, _: observed.append(done),
            stop=lambda: observed[-1:] >= [20],
        )
    assert 20 <= observed[-1] < 200
