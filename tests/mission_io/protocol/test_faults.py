"""Every way in which a mission transfer goes wrong in practice, by name, from the client's side and from the vehicle's.

All on a clock that stands still between events. ``test_each_fault_is_tested_from_both_sides`` holds the list.
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from mission_io.areas import Fence, FenceCircle, FencePolygon, FramedPoint, LatLon
from mission_io.autopilots import ARDUPILOT, PX4, Autopilot, home_item
from mission_io.codec import Codec
from mission_io.content import items_of
from mission_io.enums import MissionResult
from mission_io.errors import FormatError, MisuseError, TransferCancelledError, TransferError, TransferSilentError
from mission_io.items import Command, Frame, GeoPoint, Mission, MissionItem, MissionType
from mission_io.messages import Heartbeat, MissionAck, MissionCount, MissionItemInt, MissionRequestInt, Received
from mission_io.protocol.exchange import Address
from mission_io.protocol.server import MissionServer
from mission_io.protocol.upload import Upload
from mission_io.protocol.upload_table import UploadState
from mission_io.simulated import Conditions
from mission_io.wire import message_from_item
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play, text
from tests.mission_io.vehicle import VehiclePeer, connected

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
FAULTS = (
    "loss_both_ways", "count_never_answered", "only_the_first_count_lost", "stall_after_an_item", "duplicate_request",
    "request_out_of_range", "error_on_count", "error_on_an_item", "error_at_the_end", "ack_too_early", "last_ack_lost",
    "ack_of_another_type", "ack_for_another_station", "legacy_request", "cancel_in_the_middle_of_10000",
    "busy_then_free", "item_from_a_wrong_system", "interleaved_uploads", "out_of_sequence_item", "write_partial",
    "bad_fences", "storage_exceeded", "empty_mission", "slow_but_progressing", "random_traffic_when_idle",
    "heartbeat_stops", "reboot_in_the_middle", "duplicated_reordered_corrupted", "garbage_bytes",
)  # fmt: skip


def test_each_fault_is_tested_from_both_sides() -> None:
    missing = [f"test_{side}_{fault}" for fault in FAULTS for side in ("client", "vehicle")]
    assert [name for name in missing if name not in globals()] == []


def upload(count: int = 5) -> Upload:
    return Upload(items(count), mission_type=MissionType.MISSION, local=GROUND, vehicle=VEHICLE, now=0.0)


def client_script(steps: str, count: int = 5) -> tuple[UploadState, list[str]]:
    machine = upload(count)
    sent = play(machine, steps, sender=VEHICLE, to=GROUND)
    return machine.state, sent


def vehicle(autopilot: Autopilot = PX4, *, capacity: int | None = None, held: int = 0) -> MissionServer:
    server = MissionServer(autopilot, local=VEHICLE, capacity=capacity)
    server.set_items(MissionType.MISSION, items(held))
    return server


def vehicle_script(steps: str, server: MissionServer) -> list[str]:
    return play(server, steps, sender=GROUND, to=VEHICLE)


def held(peer: VehiclePeer) -> tuple[MissionItem, ...]:
    return peer.server.items(MissionType.MISSION)


def losing(peer: VehiclePeer, lose: Callable[[Any], bool]) -> VehiclePeer:
    """The peer without some of what its server sends."""
    send = peer.server.messages_to_send
    peer.server.messages_to_send = lambda now: [m for m in send(now) if not lose(m)]  # type: ignore[method-assign]
    return peer


def first_of(kind: type, count: int = 1) -> Callable[[Any], bool]:
    """True for the first messages of a kind."""
    left = [count]

    def is_first(message: Any) -> bool:
        if isinstance(message, kind) and left[0]:
            left[0] -= 1
            return True
        return False

    return is_first


# Random loss both ways.


@BOTH
@pytest.mark.parametrize("loss", [0.05, 0.1, 0.2, 0.3])
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


def test_client_count_never_answered() -> None:
    state, sent = client_script("wait 16")
    assert state is UploadState.SILENT
    assert set(sent) == {"count 5"}


def test_vehicle_count_never_answered() -> None:
    """The vehicle asks for the first item, and nobody answers: it ends the upload and is free again."""
    server = vehicle(ARDUPILOT, held=3)
    assert vehicle_script("count 2, wait 9", server) == ["oldreq 0"] * 7 + ["ack OPERATION_CANCELLED"]
    assert server.next_timer() is None


def test_client_only_the_first_count_lost() -> None:
    assert client_script("wait 0.1") == (UploadState.ANNOUNCED, ["count 5"])
    assert client_script("wait 0.1, req 0") == (UploadState.SERVING, ["item 0"])


def test_vehicle_only_the_first_count_lost() -> None:
    assert vehicle_script("wait 1, count 2", vehicle()) == ["req 0"]
    assert vehicle_script("count 2, count 2", vehicle()) == ["req 0"], "or its answer was lost"


# Requests.


@BOTH
@pytest.mark.parametrize("item", [0, 3, 28, 29])
def test_client_stall_after_an_item(autopilot: Autopilot, item: int) -> None:
    class Stops(VehiclePeer):
        def on_message(self, received: Received, *_: object) -> None:
            self.silent |= isinstance(received.message, MissionItemInt) and received.message.seq == item

    client = connected(Stops(autopilot))
    began = client.clock.now()
    with pytest.raises(TransferSilentError, match="fell silent") as caught:
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


def test_client_duplicate_request() -> None:
    assert client_script("req 0, wait 0.01, req 0") == (UploadState.SERVING, ["item 0", "item 1"])


@BOTH
def test_vehicle_duplicate_request(autopilot: Autopilot) -> None:
    assert vehicle_script("list, req 0, req 0", vehicle(autopilot, held=3)) == ["item 0"]


def test_client_request_out_of_range() -> None:
    assert client_script("req 0, req 5") == (UploadState.SERVING, [])
    assert client_script("req 65535") == (UploadState.ANNOUNCED, [])


@BOTH
def test_vehicle_request_out_of_range(autopilot: Autopilot) -> None:
    assert vehicle_script("list, req 3", vehicle(autopilot, held=3)) == ["ack ERROR"]


# Errors and acknowledgements.


def test_client_error_on_count() -> None:
    assert client_script("ack UNSUPPORTED")[0] is UploadState.REFUSED
    assert client_script("ack ERROR")[0] is UploadState.BACKING_OFF


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


def test_vehicle_error_on_an_item() -> None:
    assert vehicle_script("count 2, item 0, item 1 bad", vehicle()) == ["ack UNSUPPORTED_FRAME"]


def test_client_error_at_the_end() -> None:
    assert client_script("req 4, ack INVALID")[0] is UploadState.REFUSED
    assert client_script("req 4, ack ERROR, wait 1")[0] is UploadState.UNCONFIRMED, "read back to find out"


def test_vehicle_error_at_the_end() -> None:
    """A polygon that lacks its last vertex can only be refused when the list is complete."""
    server = vehicle()
    assert fence_answer(server, polygon_items(count=4, vertices=3)) == "ack ERROR"
    assert server.items(MissionType.FENCE) == ()


def test_client_ack_too_early() -> None:
    assert client_script("ack ACCEPTED")[0] is UploadState.ANNOUNCED
    assert client_script("req 0, ack ACCEPTED")[0] is UploadState.SERVING


def test_vehicle_ack_too_early() -> None:
    assert vehicle_script("list, ack ACCEPTED, req 0", vehicle(held=3)) == [], "PX4's download is over then"
    assert vehicle_script("list, ack ACCEPTED, req 0", vehicle(ARDUPILOT, held=3)) == ["item 0"]


@BOTH
def test_client_last_ack_lost(autopilot: Autopilot) -> None:
    peer = losing(VehiclePeer(autopilot), lambda m: isinstance(m, MissionAck) and m.result == MissionResult.ACCEPTED)
    connected(peer).upload(MissionType.MISSION, items(9))
    assert len(held(peer)) == 9


def test_vehicle_last_ack_lost() -> None:
    assert vehicle_script("count 2, item 0, item 1, item 1", vehicle()) == ["ack ACCEPTED"]
    assert vehicle_script("count 2, item 0, item 1, item 1", vehicle(ARDUPILOT)) == ["ack ERROR"]
    assert vehicle_script("list, req 0, wait 5.4, count 1", vehicle(held=1)) == ["req 0"], "and of a download"


def test_client_ack_of_another_type() -> None:
    assert client_script("req 4, ack ACCEPTED /rally")[0] is UploadState.CONFIRMING


def test_vehicle_ack_of_another_type() -> None:
    server = vehicle(held=3)
    assert vehicle_script("count 2, item 0, ack OPERATION_CANCELLED /rally, item 1", server) == ["ack ACCEPTED"]


def test_client_ack_for_another_station() -> None:
    machine = upload()
    play(machine, "req 4", sender=VEHICLE, to=GROUND)
    play(machine, "ack ACCEPTED", sender=VEHICLE, to=Address(254, 190))
    assert machine.state is UploadState.CONFIRMING


def test_vehicle_ack_for_another_station() -> None:
    assert vehicle_script("count 2, item 0, ack OPERATION_CANCELLED @9, item 1", vehicle()) == ["ack ACCEPTED"]


def test_client_legacy_request() -> None:
    assert client_script("oldreq 0") == (UploadState.SERVING, ["item 0", "item 1"]), "MISSION_ITEM_INT all the same"


def test_vehicle_legacy_request() -> None:
    assert vehicle_script("list, oldreq 0", vehicle(held=3)) == ["item 0"]


# Cancelling, other stations, other lists.


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


def test_client_item_from_a_wrong_system() -> None:
    assert client_script("req 0 @2") == (UploadState.ANNOUNCED, [])


def test_vehicle_item_from_a_wrong_system() -> None:
    assert vehicle_script("count 2, item 0 @9, wait 0.1", vehicle()) == []
    assert vehicle_script("count 2, item 0 @9, item 0", vehicle()) == ["req 1"]


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
    """Of a download: dropped, and asked for again."""
    peer = losing(VehiclePeer(PX4), first_of(MissionItemInt))
    peer.server.set_items(MissionType.MISSION, items(9))
    assert connected(peer).download(MissionType.MISSION) == items(9)


def test_vehicle_out_of_sequence_item() -> None:
    assert vehicle_script("count 5, item 0, item 3", vehicle()) == [], "PX4 drops it"
    assert vehicle_script("count 5, item 0, item 3", vehicle(ARDUPILOT)) == ["ack INVALID_SEQUENCE"]
    assert vehicle_script("count 2, item 1, item 0, item 1", vehicle()) == ["ack ACCEPTED"]


# Lists that cannot be.


def partial_list(start: int, end: int) -> bytes:
    sender = common.MAVLink(None, srcSystem=255, srcComponent=190)
    return bytes(common.MAVLink_mission_write_partial_list_message(1, 1, start, end).pack(sender))


@pytest.mark.parametrize(("start", "end"), [(0, 2), (-1, 5), (3, 1), (0, 32767)])
def test_vehicle_write_partial(start: int, end: int) -> None:
    """Not supported, whatever its bounds: nothing is answered and nothing changes."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(MissionType.MISSION, items(5))
    peer.receive_datagram(partial_list(start, end), 0.0)
    assert peer.heard == []
    assert peer.server.messages_to_send(0.0) == []
    assert held(peer) == items(5)


def test_client_write_partial() -> None:
    """Never sent: a list is replaced as a whole."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(MissionType.MISSION, items(9))
    connected(peer).upload(MissionType.MISSION, (*items(8), replace(items(9)[8], alt_m=1.0)))
    counts = [r.message.count for r in peer.heard if isinstance(r.message, MissionCount)]
    assert counts == [9]


def polygon_items(*, count: int, vertices: int, frame: Frame = Frame.AMSL) -> list[MissionItem]:
    return [
        MissionItem(
            Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, frame, (float(count), 0.0, 0.0, 0.0), 46.0 + i * i, 7.0 + i
        )
        for i in range(vertices)
    ]


def fence_answer(server: MissionServer, fence: list[MissionItem]) -> str:
    server.receive(Received(MissionCount(1, 1, len(fence), MissionType.FENCE), 255, 190), 0.0)
    for seq, item in enumerate(fence):
        message = message_from_item(item, seq, mission_type=MissionType.FENCE, target_system=1, target_component=1)
        server.receive(Received(message, 255, 190), 0.0)
    return text(server.messages_to_send(0.0)[-1])


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


# Time.


def test_client_slow_but_progressing() -> None:
    """A vehicle that takes two seconds for each item, and asks again each quarter of a second."""

    class Slow(VehiclePeer):
        free_at = 0.0

        def receive_datagram(self, data: bytes, now: float) -> None:
            for received in self.codec.decode(data):
                if not isinstance(received.message, MissionItemInt):
                    self.server.receive(received, now)
                elif now >= self.free_at:
                    self.free_at = now + 2.0
                    self.server.receive(received, now)

    peer = Slow(PX4)
    client = connected(peer)
    client.upload(MissionType.MISSION, items(40))
    assert len(held(peer)) == 40
    assert client.clock.now() > 70.0


def test_vehicle_slow_but_progressing() -> None:
    """Items that come just before it would give up keep the upload alive."""
    steps = ", ".join(["count 8", *(f"wait 4.9, item {i}" for i in range(8))])
    assert vehicle_script(steps, vehicle()) == ["ack ACCEPTED"]


def test_client_random_traffic_when_idle() -> None:
    """What a finished conversation hears changes nothing, and the next one begins as if nothing had been."""
    peer = VehiclePeer(PX4)
    client = connected(peer)
    peer.outbox = [MissionRequestInt(255, 190, 3), MissionAck(255, 190, 0), MissionCount(255, 190, 7)] * 20
    client.poll(1.5)
    client.upload(MissionType.MISSION, items(5))
    assert len(held(peer)) == 5


@BOTH
def test_vehicle_random_traffic_when_idle(autopilot: Autopilot) -> None:
    rng, server = random.Random(7), vehicle(autopilot, held=3)
    steps = ("req 0", "req 9", "item 0", "item 9", "ack ACCEPTED", "ack DENIED", "list", "list /rally")
    vehicle_script(", ".join(rng.choices(steps, k=200)), server)
    assert server.items(MissionType.MISSION)[1:] == items(3)[1:]
    assert vehicle_script("wait 6, count 2", server)[-1].endswith("req 0")


def test_client_heartbeat_stops() -> None:
    """A transfer does not need heartbeats; whoever waits for the vehicle sees how old the last one is."""
    peer = losing(VehiclePeer(PX4), lambda m: isinstance(m, Heartbeat))
    client = connected(peer)
    peer.next_timer = lambda: peer.server.next_timer()  # type: ignore[method-assign]
    peer.datagrams_to_send = lambda now: [peer.codec.encode(m) for m in peer.server.messages_to_send(now)]  # type: ignore[method-assign]
    client.poll(9.0)
    assert client.heartbeat_age_s > 8.0
    client.upload(MissionType.MISSION, items(5))
    assert len(held(peer)) == 5


def test_vehicle_heartbeat_stops() -> None:
    """Nor does the vehicle's side need the ground station's."""
    server = vehicle()
    assert vehicle_script("wait 60, count 1, item 0", server) == ["ack ACCEPTED"]


@BOTH
def test_client_reboot_in_the_middle(autopilot: Autopilot) -> None:
    """The vehicle forgets the upload; it is begun anew, also while ArduPilot has no space just after booting."""

    class Reboots(VehiclePeer):
        booted = False

        def on_message(self, received: Received, now: float) -> None:
            if not self.booted and isinstance(received.message, MissionItemInt) and received.message.seq == 10:
                self.booted = True
                self.server = MissionServer(self.autopilot, local=Address(1, 1), booted_at=now)

    peer = Reboots(autopilot)
    client = connected(peer)
    client.upload(MissionType.MISSION, items(30))
    assert peer.booted
    assert len(held(peer)) == 30


def test_vehicle_reboot_in_the_middle() -> None:
    """The ground station goes on where it was: it is told that there is no upload, or hears nothing."""
    assert vehicle_script("item 7", vehicle(ARDUPILOT)) == ["ack ERROR"]
    assert vehicle_script("item 7", vehicle(PX4)) == []


# Bytes.


@BOTH
def test_client_duplicated_reordered_corrupted(autopilot: Autopilot) -> None:
    conditions = Conditions(loss=0.1, duplication=0.2, corruption=0.1, delay_s=0.005, jitter_s=0.05)
    for seed in range(5):
        peer = VehiclePeer(autopilot)
        client = connected(peer, seed=seed, conditions=conditions)
        result = client.upload_and_verify(Mission(GeoPoint(46.5, -7.5, 500.0), items(20)))
        assert result.passed
        expected = items(20) if autopilot is PX4 else (home_item(GeoPoint(46.5, -7.5, 500.0)), *items(20))
        assert held(peer) == expected


@BOTH
def test_vehicle_duplicated_reordered_corrupted(autopilot: Autopilot) -> None:
    ground, rng = Codec(system_id=255, component_id=190), random.Random(3)
    peer = VehiclePeer(autopilot)
    sent = [ground.encode(MissionCount(1, 1, 3))]
    for seq, item in enumerate(items(3)):
        sent.append(
            ground.encode(
                message_from_item(item, seq, mission_type=MissionType.MISSION, target_system=1, target_component=1)
            )
        )
    for _ in range(200):
        data = bytearray(rng.choice(sent))
        if rng.random() < 0.3:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        peer.receive_datagram(bytes(data), 0.0)
    ends = {text(message) for message in peer.server.messages_to_send(0.0)}
    assert "ack ACCEPTED" in ends
    assert all(item in items(3) for item in held(peer))


def test_client_garbage_bytes() -> None:
    class Noisy(VehiclePeer):
        def datagrams_to_send(self, now: float) -> list[bytes]:
            noise = random.Random(now).randbytes(40)
            return [noise + data for data in super().datagrams_to_send(now)]

    peer = Noisy(PX4)
    client = connected(peer)
    client.upload(MissionType.MISSION, items(9))
    assert client.download(MissionType.MISSION) == items(9)


def test_vehicle_garbage_bytes() -> None:
    peer = VehiclePeer(PX4)
    peer.receive_datagram(random.Random(1).randbytes(5000), 0.0)
    assert peer.server.messages_to_send(0.0) == []


def test_a_fence_is_made_of_the_items_that_are_tested_here() -> None:
    corners = tuple(LatLon(46.0 + i * i, 7.0 + i) for i in range(3))
    assert [item.command for item in items_of(Fence((FencePolygon(corners),)), PX4)] == [
        item.command for item in polygon_items(count=3, vertices=3)
    ]
