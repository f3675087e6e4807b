"""Mission transfers that go wrong, by name: lost, doubled, early and foreign messages, from the client's and the vehicle's side.

All on a clock that stands still between events.
"""

import random
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.errors import TransferCancelledError, TransferError, TransferSilentError
from mission_io.links.simulated import Conditions
from mission_io.model.enums import MissionResult
from mission_io.model.items import Frame, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.protocol.tables import UploadState
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import Address, MissionAck, MissionCount, MissionItemInt, Received, message_from_item
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play
from tests.mission_io.protocol.two_sides import (
    BOTH,
    client_script,
    fence_answer,
    first_of,
    held,
    losing,
    polygon_items,
    untested,
    upload,
    vehicle,
    vehicle_script,
)
from tests.mission_io.vehicle import VehiclePeer, connected

FAULTS = (
    "loss_both_ways", "count_never_answered", "only_the_first_count_lost", "stall_after_an_item", "duplicate_request",
    "request_out_of_range", "error_on_count", "error_on_an_item", "error_at_the_end", "ack_too_early",
    "last_ack_lost", "ack_of_another_type", "ack_for_another_station", "legacy_request",
    "cancel_in_the_middle_of_10000", "busy_then_free", "item_from_a_wrong_system", "interleaved_uploads",
    "out_of_sequence_item",
)  # fmt: skip


CLIENT = (
    ("count_never_answered", "wait 16", "SILENT", None),
    ("only_the_first_count_lost", "wait 0.1", "ANNOUNCED", "count 5"),
    ("only_the_first_count_lost", "wait 0.1, req 0", "SERVING", "item 0"),
    ("duplicate_request", "req 0, wait 0.01, req 0", "SERVING", "item 0, item 1"),
    ("request_out_of_range", "req 0, req 5", "SERVING", ""),
    ("request_out_of_range", "req 65535", "ANNOUNCED", ""),
    ("error_on_count", "ack UNSUPPORTED", "REFUSED", None),
    ("error_on_count", "ack ERROR", "BACKING_OFF", None),
    ("error_at_the_end", "req 4, ack INVALID", "REFUSED", None),
    ("error_at_the_end", "req 4, ack ERROR, wait 1", "UNCONFIRMED", None),  # read back to find out
    ("ack_too_early", "ack ACCEPTED", "ANNOUNCED", None),
    ("ack_too_early", "req 0, ack ACCEPTED", "ACKED_EARLY", None),
    ("ack_too_early", "req 0, ack ACCEPTED, req 1", "SERVING", None),
    ("ack_too_early", "req 0, ack ACCEPTED, wait 1", "ACCEPTED_EARLY", None),
    ("ack_of_another_type", "req 4, ack ACCEPTED /rally", "CONFIRMING", None),
    ("legacy_request", "oldreq 0", "SERVING", "item 0, item 1"),  # MISSION_ITEM_INT all the same
    ("item_from_a_wrong_system", "req 0 @2", "ANNOUNCED", ""),
)
"""Of each fault what the vehicle does, the state that the upload ends in, and what the last step made the client send."""

VEHICLE_SAYS = (
    ("only_the_first_count_lost", PX4, 0, "wait 1, count 2", "req 0"),
    ("only_the_first_count_lost", PX4, 0, "count 2, count 2", "req 0"),  # or its answer was lost
    ("error_on_an_item", PX4, 0, "count 2, item 0, item 1 bad", "ack UNSUPPORTED_FRAME"),
    ("ack_too_early", PX4, 3, "list, ack ACCEPTED, req 0", ""),  # PX4's download is over then
    ("ack_too_early", ARDUPILOT, 3, "list, ack ACCEPTED, req 0", "item 0"),
    ("last_ack_lost", PX4, 0, "count 2, item 0, item 1, item 1", "ack ACCEPTED"),
    ("last_ack_lost", ARDUPILOT, 0, "count 2, item 0, item 1, item 1", "ack ERROR"),
    ("last_ack_lost", PX4, 1, "list, req 0, wait 5.4, count 1", "req 0"),  # and of a download
    ("ack_of_another_type", PX4, 3, "count 2, item 0, ack OPERATION_CANCELLED /rally, item 1", "ack ACCEPTED"),
    ("ack_for_another_station", PX4, 0, "count 2, item 0, ack OPERATION_CANCELLED @9, item 1", "ack ACCEPTED"),
    ("legacy_request", PX4, 3, "list, oldreq 0", "olditem 0"),
    ("item_from_a_wrong_system", PX4, 0, "count 2, item 0 @9, wait 0.1", ""),
    ("item_from_a_wrong_system", PX4, 0, "count 2, item 0 @9, item 0", "req 1"),
    ("out_of_sequence_item", PX4, 0, "count 5, item 0, item 3", ""),  # PX4 drops it
    ("out_of_sequence_item", ARDUPILOT, 0, "count 5, item 0, item 3", "ack INVALID_SEQUENCE"),
    ("out_of_sequence_item", PX4, 0, "count 2, item 1, item 0, item 1", "ack ACCEPTED"),
)
"""Of each fault the autopilot, how many items it holds, what the station does, and the vehicle's answer to the last step."""


def test_each_fault_is_tested_from_both_sides() -> None:
    in_tables = {f"test_client_{row[0]}" for row in CLIENT} | {f"test_vehicle_{row[0]}" for row in VEHICLE_SAYS}
    assert untested(FAULTS, {*globals(), *in_tables}) == []


@pytest.mark.parametrize(("fault", "steps", "state", "sends"), CLIENT)
def test_client(fault: str, steps: str, state: str, sends: str | None) -> None:
    ended, sent = client_script(steps)
    assert ended.name == state, fault
    assert sends is None or ", ".join(sent) == sends, fault


@pytest.mark.parametrize(("fault", "autopilot", "count", "steps", "answer"), VEHICLE_SAYS)
def test_vehicle(fault: str, autopilot: Autopilot, count: int, steps: str, answer: str) -> None:
    assert ", ".join(vehicle_script(steps, vehicle(autopilot, held=count))) == answer, fault


# Random loss both ways.


@BOTH
@pytest.mark.parametrize("loss", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.no_cover
def test_client_loss_both_ways(autopilot: Autopilot, loss: float) -> None:
    for seed in range(5):
        peer = VehiclePeer(autopilot)
        client = connected(peer, seed=seed, conditions=Conditions(loss=loss))
        client.upload(MissionType.MISSION, items(30))
        assert held(peer) == client.download(MissionType.MISSION)
        assert len(held(peer)) == 30


@BOTH
def test_vehicle_loss_both_ways(autopilot: Autopilot) -> None:
    """A client that only answers: the vehicle asks again by itself until the list is there."""
    server, rng, now = vehicle(autopilot), random.Random(1), 0.0
    server.receive(Received(MissionCount(1, 1, 5), 255, 190), now)
    for _ in range(400):
        for message in server.messages_to_send(now):
            if isinstance(message, MissionAck):
                assert message.result == MissionResult.ACCEPTED
                assert len(server.items(MissionType.MISSION)) == 5
                return
            if rng.random() > 0.5:
                item = items(5)[message.seq]  # type: ignore[union-attr]
                answer = message_from_item(item, message.seq, mission_type=MissionType.MISSION, target_system=1,
                                           target_component=1)  # type: ignore[union-attr]  # fmt: skip
                server.receive(Received(answer, 255, 190), now)
        now = max(now, server.next_timer() or now)
    pytest.fail("the vehicle stopped asking")


# The count.


def test_vehicle_count_never_answered() -> None:
    """The vehicle asks for the first item, and nobody answers: it ends the upload and is free again."""
    server = vehicle(ARDUPILOT, held=3)
    assert vehicle_script("count 2, wait 9", server) == ["oldreq 0"] * 7 + ["ack OPERATION_CANCELLED"]
    assert server.next_timer() is None


# Requests.


@BOTH
@pytest.mark.parametrize("item", [0, 3, 28, 29])
def test_client_stall_after_an_item(autopilot: Autopilot, item: int) -> None:
    class Stops(VehiclePeer):
        def on_message(self, received: Received, *_: object) -> None:
            self.silent |= isinstance(received.message, MissionItemInt) and received.message.seq == item

    client = connected(Stops(autopilot))
    began = client.clock.now()
    with pytest.raises(TransferSilentError, match="stopped answering") as caught:
        client.upload(MissionType.MISSION, items(30))
    assert caught.value.vehicle_holds in ({"mixed", "unknown"} if autopilot is ARDUPILOT else {"unchanged", "unknown"})
    assert client.clock.now() - began < 40.0


@BOTH
def test_vehicle_stall_after_an_item(autopilot: Autopilot) -> None:
    server = vehicle(autopilot, held=3)
    sent = vehicle_script("count 3, item 0, wait 9", server)
    ask = "oldreq 1" if autopilot is ARDUPILOT else "req 1"
    assert sent[:1] == [ask]
    assert (sent[-1] == "ack OPERATION_CANCELLED") == (autopilot is ARDUPILOT), "PX4 says nothing"
    assert server.next_timer() is None


@BOTH
def test_vehicle_duplicate_request(autopilot: Autopilot) -> None:
    assert vehicle_script("list, req 0, req 0", vehicle(autopilot, held=3)) == ["item 0"]


@BOTH
def test_vehicle_request_out_of_range(autopilot: Autopilot) -> None:
    assert vehicle_script("list, req 3", vehicle(autopilot, held=3)) == ["ack ERROR"]


# Errors and acknowledgements.


def test_vehicle_error_on_count() -> None:
    assert vehicle_script("count 2 /unknown", vehicle()) == ["ack UNSUPPORTED"]
    assert vehicle_script("count 2", MissionServer(ARDUPILOT, local=VEHICLE, booted_at=-1.0)) == ["ack NO_SPACE"]


@BOTH
def test_client_error_on_an_item(autopilot: Autopilot) -> None:
    bad = replace(items(1)[0], frame=Frame.ABOVE_TERRAIN) if autopilot is PX4 else replace(items(1)[0], lat_deg=91.0)
    peer = VehiclePeer(autopilot)
    peer.server.set_items(MissionType.MISSION, items(3))
    client = connected(peer)
    with pytest.raises(
        TransferError, match=r"refused with (UNSUPPORTED_FRAME|INVALID_PARAM5_X) after 4 of 9"
    ) as caught:
        client.upload(MissionType.MISSION, (*items(4), bad, *items(4)))
    assert caught.value.vehicle_holds == ("mixed" if autopilot is ARDUPILOT else "unchanged")
    assert caught.value.held_items == held(peer)


def test_vehicle_error_at_the_end() -> None:
    """A polygon that lacks its last vertex can only be refused when the list is complete."""
    server = vehicle()
    assert fence_answer(server, polygon_items(count=4, vertices=3)) == "ack ERROR"
    assert server.items(MissionType.FENCE) == ()


@BOTH
def test_client_last_ack_lost(autopilot: Autopilot) -> None:
    peer = losing(VehiclePeer(autopilot), lambda m: isinstance(m, MissionAck) and m.result == MissionResult.ACCEPTED)
    connected(peer).upload(MissionType.MISSION, items(9))
    assert len(held(peer)) == 9


def test_client_ack_for_another_station() -> None:
    machine = upload()
    play(machine, "req 4", sender=VEHICLE, to=GROUND)
    play(machine, "ack ACCEPTED", sender=VEHICLE, to=Address(254, 190))
    assert machine.state is UploadState.CONFIRMING


# Cancelling, other stations, other lists.


@pytest.mark.no_cover
def test_client_cancel_in_the_middle_of_10000() -> None:
    peer = VehiclePeer(PX4)
    client = connected(peer)
    with pytest.raises(TransferCancelledError, match="of 10000 items") as caught:
        client.upload(MissionType.MISSION, items(10_000), stop=lambda: len(peer.heard) > 5_000)
    assert (caught.value.vehicle_holds, caught.value.held_items) == ("unchanged", ())
    assert len([r for r in peer.heard if isinstance(r.message, MissionItemInt)]) < 5_010
    client.upload(MissionType.MISSION, items(3))
    assert len(held(peer)) == 3


def test_vehicle_cancel_in_the_middle_of_10000() -> None:
    steps = ", ".join(["count 10000", *(f"item {i}" for i in range(300)), "ack OPERATION_CANCELLED"])
    server = vehicle(held=3)
    assert vehicle_script(steps, server) == []
    assert server.items(MissionType.MISSION) == items(3)
    assert server.next_timer() is None


@BOTH
def test_client_busy_then_free(autopilot: Autopilot) -> None:
    peer = VehiclePeer(autopilot)
    client = connected(peer)
    peer.server.receive(Received(MissionCount(1, 1, 5), 254, 190), client.clock.now())
    client.upload(MissionType.MISSION, items(9))
    assert autopilot.give_up_s - 1.0 < client.clock.now() < autopilot.give_up_s + 3.0
    assert len(held(peer)) == 9


@BOTH
def test_vehicle_busy_then_free(autopilot: Autopilot) -> None:
    busy = "ack DENIED" if autopilot is ARDUPILOT else "ack ERROR"
    server = vehicle(autopilot)
    assert vehicle_script("count 2, count 2 @9", server) == [busy]
    assert len(play(server, "wait 9, count 2 @9", sender=GROUND, to=VEHICLE, now=0.1)) == 1
    assert server.next_timer() is not None


def test_client_interleaved_uploads() -> None:
    """Two conversations of one client: each hears its own list only."""
    mission = upload()
    rally = Upload(items(5), mission_type=MissionType.RALLY, local=GROUND, vehicle=VEHICLE, now=0.0)
    for machine in (mission, rally):
        machine.messages_to_send(0.0)
    for step, state in (("req 0", UploadState.SERVING), ("req 4 /rally", UploadState.SERVING)):
        for machine in (mission, rally):
            play(machine, step, sender=VEHICLE, to=GROUND)
        assert mission.state is state
    assert rally.state is UploadState.CONFIRMING


@BOTH
def test_vehicle_interleaved_uploads(autopilot: Autopilot) -> None:
    busy = "ack DENIED" if autopilot is ARDUPILOT else "ack ERROR"
    assert vehicle_script("count 2, count 2 /rally", vehicle(autopilot)) == [busy]
    assert vehicle_script("count 2, item 0 /rally", vehicle(autopilot)) == [busy]


def test_client_out_of_sequence_item() -> None:
    """Of a download: dropped, and requested again."""
    peer = losing(VehiclePeer(PX4), first_of(MissionItemInt))
    peer.server.set_items(MissionType.MISSION, items(9))
    assert connected(peer).download(MissionType.MISSION) == items(9)
