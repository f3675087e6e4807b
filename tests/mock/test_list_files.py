"""Lists that come to the mock vehicle as files, as ArduPilot takes them."""

from dataclasses import replace
from random import Random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.autopilots.mission_lists import MissionList, items_of
from mission_io.client.client import Client
from mission_io.client.files import FileUploads
from mission_io.errors import MisuseError, TransferError, TransferSilentError
from mission_io.formats.wpl import dat_path, write_mission_dat
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import (
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    land,
    takeoff,
    waypoint,
)
from mission_io.protocol.ftp import FtpMessage, FtpOperation
from mission_io.wire.telemetry_messages import FileTransfer
from tests.flight.scene import HOME, mock_vehicle
from tests.mission_io.vehicle import VehiclePeer
from tests.mission_io.vehicle import connected as vehicle_client
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle

BAD = MissionItem(16, Frame.AMSL, (float("nan"), 0.0, 0.0, 0.0), 36.0, -84.0, 50.0)


def mission(count: int) -> Mission:
    path = [
        waypoint(HOME.lat_deg + 1e-5 * k, HOME.lon_deg, 30.0 + k % 7, frame=Frame.ABOVE_HOME) for k in range(count - 2)
    ]
    first = takeoff(HOME.lat_deg, HOME.lon_deg, 30.0, frame=Frame.ABOVE_HOME)
    return Mission(HOME, (first, *path, land(HOME.lat_deg, HOME.lon_deg, 0.0, frame=Frame.ABOVE_HOME)))


def fence() -> Fence:
    at, to = HOME.lat_deg, HOME.lon_deg
    ring = (LatLon(at, to), LatLon(at + 0.01, to), LatLon(at, to + 0.01))
    return Fence(
        polygons=(FencePolygon(ring, inclusion=True),), circles=(FenceCircle(LatLon(at, to), 50.0, inclusion=False),)
    )


def connected(vehicle: MockVehicle, *, loss: float = 0.0, seed: int = 1) -> Client:
    client = Client(
        SimulatedLink(InMemoryPeer(vehicle), rng=Random(seed), conditions=Conditions(delay_s=0.01, loss=loss))
    )
    client.wait_for_vehicle(60.0)
    return client


@pytest.mark.parametrize("count", [3, 60])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_mission_as_a_file_is_held_as_item_by_item(count: int, loss: float) -> None:
    sent = mission(count)
    vehicle, other = mock_vehicle(ARDUPILOT), mock_vehicle(ARDUPILOT)
    client = connected(vehicle, loss=loss, seed=count)
    result = FileUploads(client).upload_list(sent)
    assert result.passed
    assert connected(other).upload_and_verify(sent).passed
    assert vehicle.missions.items(MissionType.MISSION) == other.missions.items(MissionType.MISSION)
    assert client.services == []


@pytest.mark.parametrize(
    "content", [fence(), RallyPoints((FramedPoint(HOME.lat_deg, HOME.lon_deg, 40.0, Frame.ABOVE_HOME),))]
)
def test_fence_and_rally_points_too(content: MissionList) -> None:
    assert FileUploads(connected(mock_vehicle(ARDUPILOT))).upload_list(content).passed


def test_a_shorter_mission_leaves_nothing_of_the_longer_one() -> None:
    client = connected(mock_vehicle(ARDUPILOT))
    for count in (20, 4):
        assert FileUploads(client).upload_list(mission(count)).passed
    assert len(client.download(MissionType.MISSION)) == 5


def test_a_refused_item_ends_the_mission_and_only_reading_back_shows_it() -> None:
    vehicle = mock_vehicle(ARDUPILOT)
    client = connected(vehicle)
    sent = mission(9)
    assert client.upload_and_verify(sent).passed
    items = items_of(sent, ARDUPILOT)
    spoiled = (*items[:4], BAD, *items[5:])
    path = dat_path(MissionType.MISSION)
    with pytest.raises(
        TransferError, match="arrived with a different CRC"
    ):  # a file like any other: it cannot be equal
        FileUploads(client).upload(path, write_mission_dat(spoiled, MissionType.MISSION))
    assert len(vehicle.missions.items(MissionType.MISSION)) == 4


def test_a_fence_with_a_refused_item_is_left_as_it_was() -> None:
    vehicle = mock_vehicle(ARDUPILOT)
    client = connected(vehicle)
    assert client.upload_and_verify(fence()).passed
    held = vehicle.missions.items(MissionType.FENCE)
    items = list(items_of(fence(), ARDUPILOT))
    items[1] = replace(items[1], lat_deg=95.0)
    with pytest.raises(TransferError):
        FileUploads(client).upload(dat_path(MissionType.FENCE), write_mission_dat(items, MissionType.FENCE))
    assert vehicle.missions.items(MissionType.FENCE) == held


def test_what_no_vehicle_should_hold_is_not_sent() -> None:
    client = connected(mock_vehicle(ARDUPILOT))
    with pytest.raises(MisuseError, match="the mission was not sent"):
        FileUploads(client).upload_list(Mission(HOME, (BAD,)))
    with pytest.raises(MisuseError, match="PX4 does not provide its lists as files"):
        FileUploads(connected(mock_vehicle(PX4))).upload_list(mission(3))


def test_an_armed_vehicle_is_sent_nothing() -> None:
    peer = VehiclePeer(ARDUPILOT)
    peer.base_mode = 128
    with pytest.raises(MisuseError, match="is armed"):
        FileUploads(vehicle_client(peer)).upload_list(mission(3))
    assert not any(isinstance(received.message, FileTransfer) for received in peer.heard)


def test_a_vehicle_that_is_restarted_gets_all_of_it_again() -> None:
    vehicle = mock_vehicle(ARDUPILOT)
    client = connected(vehicle)
    writes = 0

    def heard(message: object, now: float) -> None:
        nonlocal writes
        del now
        received = getattr(message, "message", None)
        if isinstance(received, FileTransfer):
            answer = FtpMessage.answer(received.payload)
            writes += answer is not None and answer.answers == FtpOperation.WRITE_FILE
            if writes == 10:
                writes += 1
                vehicle.files.restart()

    client._listener = heard
    assert FileUploads(client).upload_list(mission(120)).passed
    assert writes > 10


def test_a_vehicle_without_ftp_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = mock_vehicle(ARDUPILOT)
    monkeypatch.setattr(vehicle.files, "answer", lambda _: [])
    with pytest.raises(TransferSilentError, match="no answer for 5 s"):
        FileUploads(connected(vehicle), silent_s=5.0).upload_list(mission(3))
