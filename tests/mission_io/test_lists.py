"""Writing over some items of a mission that the vehicle holds, and whether its lists have changed."""

from collections.abc import Iterable

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.client.client import Client
from mission_io.client.lists import ListIds, list_changed, read_list_ids, upload_part
from mission_io.errors import MisuseError, TransferError, TransferSilentError, VehicleSilentError
from mission_io.links.simulated import Conditions
from mission_io.model.enums import MissionResult
from mission_io.model.items import Command, Frame, Mission, MissionItem, MissionType, waypoint
from mission_io.protocol.server import id_of_items
from mission_io.protocol.upload import Upload
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, message_from_item
from tests.mission_io.formats.samples import FENCE, MISSION
from tests.mission_io.vehicle import VehiclePeer, connected


def changed(count: int) -> list[MissionItem]:
    return [waypoint(46.6 + 1e-4 * k, -7.35, 75.0 + k, frame=Frame.ABOVE_HOME) for k in range(count)]


def holding(peer: VehiclePeer, conditions: Conditions | None = None, seed: int = 0) -> Client:
    client = connected(peer, conditions=conditions, seed=seed)
    assert client.upload_and_verify(MISSION).passed
    peer.heard.clear()
    return client


@pytest.mark.parametrize(("first", "count"), [(1, 1), (3, 2), (1, 8), (8, 1)])
def test_only_the_part_is_sent_and_the_rest_stays(first: int, count: int) -> None:
    peer = VehiclePeer(ARDUPILOT)
    client = holding(peer)
    steps: list[tuple[int, int]] = []
    result = upload_part(client, first, changed(count), progress=lambda done, total: steps.append((done, total)))
    assert result.passed, result.differences
    sent = [r.message for r in peer.heard]
    assert [it for it in sent if isinstance(it, m.MissionCount)] == []
    (opening,) = {it for it in sent if isinstance(it, m.MissionWritePartialList)}
    assert (opening.start_index, opening.end_index) == (first, first + count - 1)
    assert {it.seq for it in sent if isinstance(it, m.MissionItemInt)} == set(range(first, first + count))
    held = client.download_list(MissionType.MISSION)
    assert isinstance(held, Mission)
    assert [item.alt_m for item in held.items[first - 1 : first - 1 + count]] == [75.0 + k for k in range(count)]
    others = [*range(first - 1), *range(first - 1 + count, 8)]
    assert [held.items[k].command for k in others] == [MISSION.items[k].command for k in others]
    assert steps[-1] == (count, count)


@pytest.mark.parametrize("seed", range(6))
def test_a_part_survives_loss_and_duplicates(seed: int) -> None:
    peer = VehiclePeer(ARDUPILOT)
    client = holding(peer, Conditions(loss=0.3, duplication=0.2), seed)
    assert upload_part(client, 2, changed(5)).passed
    assert len(peer.server.items(MissionType.MISSION)) == 9


def test_an_autopilot_that_takes_no_parts_is_not_asked() -> None:
    peer = VehiclePeer(PX4)
    client = holding(peer)
    with pytest.raises(MisuseError, match="PX4 does not accept a part of a mission"):
        upload_part(client, 1, changed(1))
    assert peer.heard == []


@pytest.mark.parametrize(("first", "count"), [(0, 1), (9, 1), (7, 3), (1, 0), (-1, 1)])
def test_what_is_not_there_is_not_written_over(first: int, count: int) -> None:
    peer = VehiclePeer(ARDUPILOT)
    client = holding(peer)
    with pytest.raises(MisuseError, match="mission of 8"):
        upload_part(client, first, changed(count))
    assert not [r for r in peer.heard if isinstance(r.message, m.MissionWritePartialList)]


def test_a_vehicle_that_refuses_or_is_silent_is_an_error() -> None:
    class Refuses(VehiclePeer):
        answer = True

        def instead(self, message: m.Message, *_: object) -> Iterable[m.Message] | None:
            if not isinstance(message, m.MissionWritePartialList):
                return None
            return [m.MissionAck(255, 190, MissionResult.ERROR)] if self.answer else []

    peer = Refuses(ARDUPILOT)
    client = connected(peer)
    client.upload_and_verify(MISSION)
    with pytest.raises(TransferError, match="upload of items 3 to 4 of the mission"):
        upload_part(client, 3, changed(2))
    peer.answer = False
    with pytest.raises(TransferSilentError, match="upload of items 3 to 4 of the mission"):
        upload_part(client, 3, changed(2))
    assert len(peer.server.items(MissionType.MISSION)) == 9


@pytest.mark.parametrize(
    ("first", "last", "answer"), [(2, 1, 1), (-1, 2, 1), (3, 10, 1), (10, 10, 1), (9, 9, None), (0, 3, None)]
)
def test_a_vehicle_takes_parts_that_lie_in_its_list_or_go_on_after_it(
    first: int, last: int, answer: int | None
) -> None:
    peer = VehiclePeer(ARDUPILOT)
    holding(peer)
    peer.server.receive(m.Received(m.MissionWritePartialList(1, 1, first, last), 255, 190), 10.0)
    said = peer.server.messages_to_send(10.0)
    if answer is None:
        assert [getattr(it, "seq", None) for it in said] == [first]
    else:
        assert [it.result for it in said if isinstance(it, m.MissionAck)] == [MissionResult.ERROR]
    deaf = VehiclePeer(PX4)
    holding(deaf)
    deaf.server.receive(m.Received(m.MissionWritePartialList(1, 1, 1, 1), 255, 190), 10.0)
    assert deaf.server.messages_to_send(10.0) == []


def test_a_part_that_breaks_off_leaves_what_came_written() -> None:
    peer = VehiclePeer(ARDUPILOT)
    holding(peer)
    before = peer.server.items(MissionType.MISSION)
    peer.server.receive(m.Received(m.MissionWritePartialList(1, 1, 3, 5), 255, 190), 10.0)
    other = waypoint(46.9, -7.9, 99.0, frame=Frame.ABOVE_HOME)
    item = message_from_item(other, 3, mission_type=MissionType.MISSION, target_system=1, target_component=1)
    peer.server.receive(m.Received(item, 255, 190), 10.1)
    for _ in range(3):
        peer.server.messages_to_send(100.0)
    after = peer.server.items(MissionType.MISSION)
    assert [k for k in range(9) if before[k] != after[k]] == [3]


@pytest.mark.parametrize("first", [-1, 2**15])
def test_numbers_that_the_message_does_not_carry_are_refused(first: int) -> None:
    with pytest.raises(
        MisuseError,
        match="a part must have at least one item and end at item 32767 or before, but this one has 1 items",
    ):
        Upload(
            changed(1),
            mission_type=MissionType.MISSION,
            local=Address(255, 190),
            vehicle=Address(1, 1),
            now=0.0,
            first=first,
        )


def wired(item: MissionItem, seq: int, mission_type: MissionType = MissionType.MISSION) -> m.MissionItemInt:
    return message_from_item(item, seq, mission_type=mission_type, target_system=1, target_component=1)


def reported(peer: VehiclePeer, *messages: m.Message | tuple[int, m.Message]) -> list[str]:
    """What the vehicle answers to each, from station 255 or the one that is named."""
    said = []
    for k, one in enumerate(messages):
        station, message = one if isinstance(one, tuple) else (255, one)
        peer.server.receive(m.Received(message, station, 190), 10.0 + 0.1 * k)
        answers = peer.server.messages_to_send(10.0 + 0.1 * k)
        said.append(" ".join(f"ack{it.result}" if isinstance(it, m.MissionAck) else f"req{it.seq}" for it in answers))  # type: ignore[union-attr]
    return said


PART = m.MissionWritePartialList(1, 1, 3, 5)
NEW = waypoint(46.9, -7.9, 99.0, frame=Frame.ABOVE_HOME)
JUMPS_TO = {to: MissionItem(Command.DO_JUMP, Frame.COMMAND, (float(to), 1.0, 0.0, 0.0)) for to in (0, 8, 9, 50)}


@pytest.mark.parametrize(
    ("messages", "answers", "written"),
    [
        # As ArduCopter 4.7.0-dev, simulated, answered the same messages.
        ((PART, PART, *(wired(NEW, k) for k in (3, 4, 5))), "req3 ack14 req4 req5 ack0", [3, 4, 5]),
        ((PART, wired(NEW, 3), PART, wired(NEW, 4), wired(NEW, 5)), "req3 req4 ack14 req5 ack0", [3, 4, 5]),
        ((PART, (254, m.MissionWritePartialList(1, 1, 6, 6)), wired(NEW, 3)), "req3 ack14 req4", [3]),
        ((m.MissionCount(1, 1, 2), m.MissionWritePartialList(1, 1, 1, 1), wired(NEW, 0)), "req0 ack14 req1", None),
        (
            (PART, wired(NEW, 3), m.MissionCount(1, 1, 2), wired(NEW, 0), wired(NEW, 1)),
            "req3 req4 req0 req1 ack0",
            None,
        ),
        ((PART, wired(JUMPS_TO[0], 3)), "req3 ack1", []),
        ((PART, wired(JUMPS_TO[50], 3)), "req3 ack1", []),
        ((PART, wired(JUMPS_TO[9], 3)), "req3 ack1", []),
        ((PART, wired(JUMPS_TO[8], 3)), "req3 req4", [3]),
        ((PART, m.MissionClearAll(1, 1), wired(NEW, 3)), "req3 ack0 ack1", None),
        ((PART, (254, m.MissionClearAll(1, 1)), wired(NEW, 3)), "req3 ack14 ack1 req4", [3]),
    ],
)
def test_parts_are_answered_as_arducopter_answers_them(
    messages: tuple[m.Message, ...], answers: str, written: list[int] | None
) -> None:
    peer = VehiclePeer(ARDUPILOT)
    holding(peer)
    before = peer.server.items(MissionType.MISSION)
    assert " ".join(reported(peer, *messages)) == answers
    after = peer.server.items(MissionType.MISSION)
    if written is None:
        assert len(after) != len(before)
    else:
        assert len(after) == len(before)
        assert [k for k in range(9) if before[k] != after[k]] == written


def test_a_fence_does_not_grow_by_a_part() -> None:
    peer = VehiclePeer(ARDUPILOT)
    fence = [MissionItem(Command.NAV_FENCE_CIRCLE_EXCLUSION, Frame.AMSL, (20.0, 0.0, 0.0, 0.0), 46.5, -7.3, 0.0)]
    peer.server.set_items(MissionType.FENCE, fence)
    said = reported(
        peer, m.MissionWritePartialList(1, 1, 1, 1, MissionType.FENCE), wired(fence[0], 1, MissionType.FENCE)
    )
    assert said == ["req1", "ack13"]
    assert peer.server.items(MissionType.FENCE) == tuple(fence)


def test_a_whole_list_with_a_jump_that_leads_nowhere_is_refused() -> None:
    peer = VehiclePeer(ARDUPILOT)
    assert reported(peer, m.MissionCount(1, 1, 2), wired(NEW, 0), wired(JUMPS_TO[8], 1)) == ["req0", "req1", "ack1"]


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
