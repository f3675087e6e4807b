"""Slow links, garbage, other traffic, vehicles that fall silent or restart in the middle of a transfer; from both sides."""

import random
from collections.abc import Iterable

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import home_item
from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from mission_io.model.items import GeoPoint, Mission, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.protocol.timing import RateLimit
from mission_io.wire.codec import Codec
from mission_io.wire.messages import (
    Address,
    Heartbeat,
    Message,
    MissionAck,
    MissionCount,
    MissionItemInt,
    MissionRequestInt,
    Received,
    message_from_item,
)
from mission_io.wire.telemetry_messages import TimeSync
from tests.mission_io.protocol.scripts import items, text
from tests.mission_io.protocol.two_sides import BOTH, held, losing, untested, vehicle, vehicle_script
from tests.mission_io.vehicle import VehiclePeer, connected

FAULTS = (
    "slow_but_progressing", "random_traffic_when_idle", "heartbeat_stops", "reboot_in_the_middle",
    "duplicated_reordered_corrupted", "garbage_bytes",
)  # fmt: skip


def test_each_fault_is_tested_from_both_sides() -> None:
    assert untested(FAULTS, globals()) == []


# Time.


def test_client_slow_but_progressing() -> None:
    """A vehicle that takes two seconds for each item, and asks again each quarter of a second."""

    class Slow(VehiclePeer):
        free_at = 0.0

        def instead(self, message: Message, now: float) -> Iterable[Message] | None:
            if not isinstance(message, MissionItemInt):
                return None
            if now < self.free_at:
                return []
            self.free_at = now + 2.0
            return None

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


def test_so_many_at_once_and_then_so_many_a_second() -> None:
    limit = RateLimit(per_s=10.0)
    assert sum(limit.allows(5.0) for _ in range(100)) == 10
    assert sum(limit.allows(5.0 + step * 0.01) for step in range(1, 301)) == 30
    assert sum(limit.allows(1000.0) for _ in range(100)) == 10
    with pytest.raises(MisuseError, match="per_s must"):
        RateLimit(per_s=0)


def test_a_flood_of_questions_for_the_time_is_answered_within_limits() -> None:
    peer = VehiclePeer()
    client = connected(peer)
    for step in range(20):
        peer.outbox = [TimeSync(0, 1 + step * 1000 + n) for n in range(500)]
        client.poll(0.1)
    client.poll(0.1)
    answers = sum(isinstance(received.message, TimeSync) for received in peer.heard)
    assert 500 <= answers <= 500 + 2.2 * 500
