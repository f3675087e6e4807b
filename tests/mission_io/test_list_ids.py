"""Whether the lists of a vehicle have changed, by their ids, or where there are none by their numbers of items."""

import pytest

from mission_io import MissionType, VehicleSilentError
from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.client.lists import ListIds, list_changed, read_list_ids
from mission_io.model.items import Command
from mission_io.protocol.server import id_of_items
from mission_io.wire import messages as m
from tests.mission_io.test_client import FENCE, MISSION
from tests.mission_io.vehicle import VehiclePeer, connected


class TellsIds(VehiclePeer):
    """Answers for MISSION_CURRENT with the ids of its lists, or with 0 on ArduPilot."""

    def on_message(self, received: m.Received, *_: object) -> None:
        if isinstance(received.message, m.CommandLong) and received.message.command == Command.REQUEST_MESSAGE:
            has_ids = self.autopilot.has_list_ids
            ids = [id_of_items(self.server.items(kind)) if has_ids else 0 for kind in MissionType]
            self.outbox.append(m.MissionCurrent(0, None, 0, *ids))


def test_px4_s_ids_tell_every_change() -> None:
    peer = TellsIds(PX4)
    client = connected(peer)
    assert read_list_ids(client) == ListIds(None, None, None)
    assert list_changed(client, MissionType.MISSION) is None
    client.upload_and_verify(MISSION)
    client.upload_and_verify(FENCE)
    ids = read_list_ids(client)
    assert ids.mission not in (None, ids.fence)
    assert ids.rally is None
    assert [list_changed(client, kind) for kind in MissionType] == [False, False, None]
    heard = len(peer.heard)
    items = list(peer.server.items(MissionType.MISSION))
    items[1], items[2] = items[2], items[1]  # as many as before
    peer.server.set_items(MissionType.MISSION, items)
    assert [list_changed(client, kind) for kind in MissionType] == [True, False, None]
    assert not any(isinstance(r.message, m.MissionRequestList) for r in peer.heard[heard:])
    peer.server.set_items(MissionType.FENCE, ())
    assert list_changed(client, MissionType.FENCE) is True
    client.download(MissionType.MISSION)
    assert list_changed(client, MissionType.MISSION) is False


@pytest.mark.parametrize("autopilot", [ARDUPILOT], ids=lambda autopilot: autopilot.name)
def test_without_ids_only_another_number_of_items_tells(autopilot: Autopilot) -> None:
    peer = TellsIds(autopilot)
    client = connected(peer)
    client.upload_and_verify(MISSION)
    assert list_changed(client, MissionType.MISSION) is None
    peer.server.set_items(MissionType.MISSION, peer.server.items(MissionType.MISSION)[:3])
    assert list_changed(client, MissionType.MISSION) is True
    assert list_changed(client, MissionType.MISSION) is True
    client.download(MissionType.RALLY)
    assert list_changed(client, MissionType.RALLY) is False
    requests = [r for r in peer.heard if isinstance(r.message, m.MissionRequestInt)]
    assert len(requests) < 2 * len(MISSION.items) + 6


def test_a_vehicle_that_does_not_answer_is_silent() -> None:
    with pytest.raises(VehicleSilentError, match="MissionCurrent"):
        read_list_ids(connected(VehiclePeer()), timeout_s=2.0)
