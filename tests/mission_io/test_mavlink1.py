"""Peers that speak MAVLink 1, and those that only begin with it; pymavlink's own MAVLink 1 tables are the judge."""

import random

import pytest
from pymavlink.dialects.v10 import ardupilotmega as pymavlink_1

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.client.client import Client
from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import Frame, MissionType, waypoint
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Message, Received
from mission_io.wire.signing import SigningKey
from tests.mission_io.test_codec import SAMPLES, every_kind_of_message
from tests.mission_io.vehicle import VehiclePeer

ITEMS = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(20))


class OldVehicle(VehiclePeer):
    """Reads and speaks only MAVLink 1: pymavlink's, which knows no other."""

    def __init__(self) -> None:
        super().__init__(ARDUPILOT)
        self.codec.version = 1
        self.parser = pymavlink_1.MAVLink(None)
        self.parser.robust_parsing = True
        self.heard_1 = 0

    def receive_datagram(self, data: bytes, now: float) -> None:
        for message in self.parser.parse_buffer(bytearray(data)) or []:
            if message.get_type() != "BAD_DATA":
                self.heard_1 += 1
                super().receive_datagram(bytes(message.get_msgbuf()), now)


class PoliteVehicle(VehiclePeer):
    """Begins in MAVLink 1 and changes to MAVLink 2 when it hears some."""

    def __init__(self, deaf_for_s: float = 0.0) -> None:
        super().__init__(ARDUPILOT)
        self.codec.version = 1
        self.deaf_for_s = deaf_for_s

    def receive_datagram(self, data: bytes, now: float) -> None:
        if now >= self.deaf_for_s:
            super().receive_datagram(data, now)

    def on_message(self, received: Received, *_: object) -> None:
        if received.mavlink_version == 2:
            self.codec.version = 2


def client_of(peer: VehiclePeer) -> Client:
    return Client(SimulatedLink(peer, rng=random.Random(2), conditions=Conditions(delay_s=0.01)))


def speaking_1() -> Codec:
    codec = Codec(system_id=9, component_id=1)
    codec.version = 1
    return codec


OLD_SAMPLES: list[Message] = [
    m.StatusText(4, "Reached waypoint #2"),
    m.MissionCurrent(4),
    m.CommandAck(400, 4),
    m.MissionCount(1, 1, 650),
    m.MissionRequest(255, 190, 7),
    m.MissionWritePartialList(1, 1, 3, 650),
    m.MissionItemInt(1, 1, 3, 6, 16, (1.5, 0.0, -2.0, 90.0), 461234567, -77654321, 10.5, 1, 0),
    m.MissionAck(255, 190, 13),
    m.MissionRequestList(1, 1),
    m.MissionClearAll(1, 1),
    m.BatteryStatus(0, (15.25, *(None,) * 9), 12.5, 1234, 71),
    m.CameraFeedback(71.25, 3, 46.1234567, -7.7654321, 512.5, 60.25, 1.5, -2.5, 271.0, 0),
    m.AutopilotVersion(2**63 + 5, 0x04070000, 2**64 - 1),
]
NEWER = {
    m.CameraImageCaptured, m.ParamError, m.ParamExtRequestRead, m.ParamExtRequestList, m.ParamExtValue, m.ParamExtSet,
    m.ParamExtAck, m.Event,
}  # fmt: skip
"""Their numbers are above 255, where MAVLink 1 ends."""
SAYABLE = OLD_SAMPLES + [
    s for s in SAMPLES if type(s) not in {type(old) for old in OLD_SAMPLES} | {m.MissionRequestList} | NEWER
]


@pytest.mark.parametrize("message", SAYABLE, ids=lambda s: type(s).__name__)
def test_what_mavlink_1_can_say_is_read_by_its_own_parser_and_by_us(message: Message) -> None:
    data = speaking_1().encode(message)
    (theirs,) = pymavlink_1.MAVLink(None).parse_buffer(bytearray(data))
    assert (data[0], theirs.get_srcSystem(), theirs.get_msgId()) == (0xFE, 9, data[5])
    assert len(data) == 8 + theirs.unpacker.size
    assert Codec(system_id=1, component_id=1).decode(data) == [Received(message, 9, 1, 1)]


def test_every_kind_of_message_was_tried() -> None:
    assert {type(message) for message in SAYABLE} | NEWER == every_kind_of_message()


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (
            m.MissionCount(1, 1, 3, MissionType.FENCE),
            "MISSION_COUNT: fences and rally points do not exist in MAVLink 1",
        ),
        (m.MissionRequestList(1, 1, MissionType.RALLY), "MISSION_REQUEST_LIST: fences and rally points do not exist"),
        (m.MissionClearAll(1, 1, 255), "MISSION_CLEAR_ALL: fences and rally points do not exist"),
        *((sample, r"message \d{3} does not exist in MAVLink 1") for sample in SAMPLES if type(sample) in NEWER),
        (m.MissionCurrent(4, 20), "MISSION_CURRENT: total = 20 do not exist in MAVLink 1; .* SERIALn_PROTOCOL = 2"),
    ],
)
def test_what_mavlink_1_cannot_say_is_refused(message: Message, what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        speaking_1().encode(message)


def test_a_mission_goes_to_and_from_a_vehicle_that_speaks_nothing_newer() -> None:
    peer = OldVehicle()
    client = client_of(peer)
    client.wait_for_vehicle()
    assert client.codec.version == 1
    client.upload(MissionType.MISSION, ITEMS)
    assert client.download(MissionType.MISSION) == peer.server.items(MissionType.MISSION)
    assert len(peer.server.items(MissionType.MISSION)) == len(ITEMS)
    assert peer.heard_1 > len(ITEMS)


@pytest.mark.parametrize("mission_type", [MissionType.FENCE, MissionType.RALLY])
def test_fences_and_rally_points_are_refused_before_anything_is_sent(mission_type: MissionType) -> None:
    peer = OldVehicle()
    client = client_of(peer)
    client.wait_for_vehicle()
    before = peer.heard_1
    for attempt in (
        lambda: client.download(mission_type),
        lambda: client.clear(mission_type),
        lambda: client.upload(mission_type, ITEMS),
    ):
        with pytest.raises(
            MisuseError,
            match=r"fences and rally points do not exist in MAVLink 1; the peer uses MAVLink 1",
        ):
            attempt()
    assert peer.heard_1 == before


def test_a_vehicle_that_begins_in_mavlink_1_and_can_do_better_is_spoken_to_in_mavlink_2() -> None:
    client = client_of(PoliteVehicle())
    client.wait_for_vehicle()
    assert client.codec.version == 2
    client.upload(MissionType.FENCE, ())


def test_a_vehicle_that_missed_our_first_mavlink_2_is_found_out_later() -> None:
    client = client_of(PoliteVehicle(deaf_for_s=6.0))
    client.wait_for_vehicle()
    assert client.codec.version == 1
    while client.clock.now() < 9.0:
        client.poll(1.0)
    assert client.codec.version == 2
    assert client.wait_for_vehicle().system_id == 1
    assert client.codec.version == 2


def test_one_heartbeat_in_mavlink_1_is_enough_when_the_time_is_over() -> None:
    client = client_of(OldVehicle())
    assert client.wait_for_vehicle(0.5).system_id == 1
    assert client.codec.version == 1


def test_a_signed_link_does_not_speak_mavlink_1() -> None:
    client = client_of(OldVehicle())
    client.sign_with(SigningKey.from_passphrase("correct horse"))
    client.codec.version = 1
    with pytest.raises(MisuseError, match="MAVLink 1 cannot be signed"):
        client.send(m.MissionRequestList(1, 1))
