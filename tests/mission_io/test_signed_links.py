"""A ground station and a vehicle on a signed link, and what is said when their keys differ."""

import random
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.errors import VehicleSilentError
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat
from mission_io.wire.signing import Signing, SigningKey, TimestampFile, UnsavedTimestamps
from tests.mission_io.test_signing import NOW_TICKS, WallClock, private
from tests.mission_io.vehicle import VehiclePeer

ITEMS = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(30))
KEY = SigningKey.from_passphrase("correct horse")


def signed_vehicle(key: SigningKey, *, clock_s: float = WallClock().time_s) -> VehiclePeer:
    peer = VehiclePeer(PX4)
    peer.codec.signing = Signing(key, clock=WallClock(clock_s), store=UnsavedTimestamps())
    return peer


def client_of(peer: VehiclePeer, conditions: Conditions | None = None) -> Client:
    return Client(SimulatedLink(peer, rng=random.Random(5), conditions=conditions))


def test_a_mission_goes_over_a_signed_link_that_loses_repeats_and_damages() -> None:
    peer = signed_vehicle(KEY)
    client = client_of(peer, Conditions(loss=0.2, duplication=0.1, corruption=0.05, delay_s=0.02))
    client.sign_with(KEY, clock=WallClock())
    client.wait_for_vehicle()
    client.upload(MissionType.MISSION, ITEMS)
    assert client.download(MissionType.MISSION) == peer.server.items(MissionType.MISSION)
    counts = client.statistics
    assert counts.unsigned == 0
    assert counts.forged < 10  # damaged in the signature, where no checksum looks
    assert counts.replayed > 0  # the repeated ones
    assert counts.lost > 0


def test_a_recorded_conversation_does_not_work_again() -> None:
    class Recording(VehiclePeer):
        def __init__(self) -> None:
            super().__init__(PX4)
            self.recorded: list[bytes] = []

        def receive_datagram(self, data: bytes, now: float) -> None:
            self.recorded.append(data)
            super().receive_datagram(data, now)

    peer = Recording()
    peer.codec.signing = Signing(KEY, clock=WallClock(), store=UnsavedTimestamps())
    client = client_of(peer)
    client.sign_with(KEY, clock=WallClock())
    client.wait_for_vehicle()
    client.upload(MissionType.MISSION, ITEMS)
    client.clear(MissionType.MISSION)
    heard, recorded = len(peer.heard), list(peer.recorded)
    for data in recorded:
        peer.receive_datagram(data, client.clock.now())
    assert len(peer.heard) == heard
    assert peer.server.items(MissionType.MISSION) == ()
    assert peer.codec.statistics.replayed == len(recorded)


@pytest.mark.parametrize(
    ("peer", "reason"),
    [
        (VehiclePeer(PX4), r"3 unsigned, 0 signed with another key, 0 with an old timestamp"),
        (
            signed_vehicle(SigningKey.from_passphrase("another")),
            r"0 unsigned, 3 signed with another key, 0 with an old",
        ),
        (
            signed_vehicle(KEY, clock_s=WallClock().time_s - 90.0),
            r"0 unsigned, 0 signed with another key, 3 with an old",
        ),
    ],
)
def test_a_vehicle_that_is_not_believed_is_not_found_and_the_error_says_why(peer: VehiclePeer, reason: str) -> None:
    client = client_of(peer)
    client.sign_with(KEY, clock=WallClock())
    client.codec.signing.signature(b"")  # type: ignore[union-attr]
    peer.receive_datagram = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(
        VehicleSilentError, match=rf"3 frames were refused \({reason}.*\); does the vehicle have the same signing"
    ):
        client.wait_for_vehicle(2.5)


def test_a_vehicle_whose_clock_is_late_is_believed_once_it_has_heard_us() -> None:
    peer = signed_vehicle(KEY, clock_s=0.0)
    client = client_of(peer)
    client.sign_with(KEY, clock=WallClock())
    assert client.wait_for_vehicle(3.0).system_id == 1


def test_a_key_file_keeps_its_time_between_two_connections(tmp_path: Path) -> None:
    key = SigningKey.from_file(private(tmp_path / "key", b"correct horse\n"))
    for clock_s in (WallClock().time_s, 0.0):
        client = client_of(signed_vehicle(KEY))
        client.sign_with(key, clock=WallClock(clock_s), link_id=3)
        client.wait_for_vehicle()
        client.send(Heartbeat(8, 6))
        before = TimestampFile(tmp_path / "key").read()
        client.close()
        kept = TimestampFile(tmp_path / "key").read()
        assert NOW_TICKS < kept < before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["key", "key.timestamp"]


def test_without_a_clock_given_it_is_the_systems() -> None:
    client = client_of(VehiclePeer(PX4))
    client.sign_with(KEY)
    client.send(Heartbeat(8, 6))
    reader = Codec(system_id=1, component_id=1)
    client.sign_with(KEY)
    frame = client.codec.encode(Heartbeat(8, 6))
    assert len(reader.decode(frame)) == 1
    assert int.from_bytes(frame[-12:-6], "little") > NOW_TICKS - 10**14
    client.close()


class Noise:
    """The other end of a link with the wrong baud rate."""

    def __init__(self) -> None:
        self.next_s = 0.0

    def receive_datagram(self, data: bytes, now: float) -> None:
        del data, now

    def datagrams_to_send(self, now: float) -> list[bytes]:
        if now < self.next_s:
            return []
        self.next_s = now + 1.0
        return [b"\x80\xf8\x06\x98" * 5]

    def next_timer(self) -> float | None:
        return self.next_s


def test_noise_instead_of_mavlink_is_said() -> None:
    client = Client(SimulatedLink(Noise(), rng=random.Random(1)))
    with pytest.raises(
        VehicleSilentError, match=r"within 2\.5 s; 60 received bytes are not MAVLink; is the baud rate correct\?"
    ):
        client.wait_for_vehicle(2.5)


@pytest.mark.parametrize("call", ["upload", "download", "clear", "command"])
def test_a_vehicle_that_signs_while_we_have_no_key_is_named(call: str) -> None:
    """It is heard, and believes nothing of what we say: the key is what is missing, not the vehicle."""
    client = client_of(signed_vehicle(KEY))
    client.wait_for_vehicle()
    calls = {
        "upload": lambda: client.upload(MissionType.MISSION, ITEMS),
        "download": lambda: client.download(MissionType.FENCE),
        "clear": lambda: client.clear(MissionType.RALLY),
        "command": lambda: client.command(400, 1.0),
    }
    with pytest.raises(VehicleSilentError, match=r"the vehicle signs .* has no key: use --signing-key"):
        calls[call]()
    assert client.statistics.signed > 5


def test_a_silent_vehicle_that_does_not_sign_is_asked_no_key() -> None:
    peer = VehiclePeer(PX4)
    client = client_of(peer)
    client.wait_for_vehicle()
    peer.receive_datagram = lambda *_: None  # type: ignore[method-assign]
    with pytest.raises(VehicleSilentError) as caught:
        client.download(MissionType.MISSION)
    assert "key" not in str(caught.value)
