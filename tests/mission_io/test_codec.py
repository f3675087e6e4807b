import dataclasses
import math
import random
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.dialects.v20 import ardupilotmega as pymavlink

from mission_io.errors import MisuseError
from mission_io.model.enums import LandedState, MissionState
from mission_io.wire import message_table
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec, LinkStatistics, SequenceCounter, mavlink2_frame, message_id
from mission_io.wire.message_table import layout_of
from mission_io.wire.messages import Heartbeat, HomePosition, Message

SAMPLES: list[m.Message] = [
    m.Heartbeat(3, 2, 128 + 1, 5, 4),
    m.GlobalPositionInt(12.345, 46.1234567, -7.7654321, 1234.567, -3.21, 1.23, -4.56, 0.07, 359.99),
    m.GlobalPositionInt(0.0, -46.1234567, 7.7654321, 0.0, 0.0, 0.0, 0.0, 0.0, None),
    m.Attitude(1.5, 0.25, -0.5, 3.0, 0.125, 0.0, -1.0),
    m.HomePosition(46.1234567, -7.7654321, 512.345),
    m.GpsGlobalOrigin(46.1234567, -7.7654321, 512.345),
    m.MissionCurrent(4, 20, MissionState.ACTIVE),
    m.MissionCurrent(0),
    m.MissionItemReached(65535),
    m.StatusText(4, "Reached waypoint #2"),
    m.StatusText(2, "t ", 513, 1),
    m.CommandLong(1, 1, 400, (1.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.5), 3),
    m.CommandInt(1, 1, 6, 192, (-1.0, 1.0, 0.0, 0.0), 461234567, -77654321, 30.0),
    m.CommandAck(400, 5, 50, -1, 255, 190),
    m.SysStatus(7, 6, 5, 0.125, 12.6, 3.5, 87),
    m.SysStatus(0, 0, m.PREARM_CHECK_BIT),
    m.GpsRawInt(17.25, 3, 46.1234567, -7.7654321, 512.0, 0.9, 1.2, 4.5, 271.25, 14),
    m.GpsRawInt(0.0, 0, 0.0, 0.0, 0.0),
    m.EkfStatusReport(0x1F, 0.25, 0.5, 0.125, 0.0625, 0.0),
    m.ExtendedSysState(LandedState.IN_AIR, 3),
    m.MissionCount(1, 1, 650, 1),
    m.MissionWritePartialList(1, 1, 3, 650, 2),
    m.MissionCount(255, 190, 7, 2, opaque_id=2**32 - 3),
    m.MissionRequest(255, 190, 7, 2),
    m.MissionRequestInt(255, 190, 65535),
    m.MissionItemInt(1, 1, 3, 6, 16, (1.5, 0.0, -2.0, 90.0), 461234567, -77654321, 10.5, 1, 0, 2),
    m.MissionItemFloat(1, 1, 3, 3, 16, (1.5, 0.0, -2.0, 90.0), 46.5, -7.25, 10.5),
    m.MissionAck(255, 190, 13, 1),
    m.MissionAck(255, 190, 0, 2, opaque_id=2**32 - 3),
    m.MissionAck(255, 190, 0, 1, 2**32 - 5),
    m.MissionCount(1, 1, 650, 1, 2**32 - 7),
    m.MissionCurrent(4, 20, MissionState.ACTIVE, 1, 2, 2**32 - 1),
    m.MissionRequestList(1, 1, 2),
    m.MissionClearAll(1, 1, 255),
    m.MissionSetCurrent(1, 1, 9),
    m.AutopilotVersion(2**63 + 5, 0x04070000, 2**64 - 1, tuple(range(1, 19))),
    m.SetMode(1, 209, 4),
    m.ParamRequestRead(1, 1, "SIXTEEN_LETTERS_"),
    m.ParamSet(1, 1, "FENCE_ALT_MAX", 120.5),
    m.ParamValue("WPNAV_SPEED", 500.0, 9, 1200, 17),
    m.ParamError(255, 190, "NO_SUCH_ONE", -1, 1),
    m.ParamExtRequestRead(1, 100, "CAM_MODE", 3),
    m.ParamExtRequestList(1, 100),
    m.ParamExtValue("CAM_MODE", bytes(range(128)), 2, 12, 3),
    m.ParamExtSet(1, 100, "CAM_MODE", bytes(range(128)), 2),
    m.ParamExtAck("CAM_MODE", bytes(range(1, 129)), 2, 3),
    m.SystemTime(1790000000.123456, 4.5),
    m.TimeSync(1790000000123456789, -(2**63)),
    m.Event(0, 0, 26528394, 61_234, 7, 0x42, (*range(38), 254, 255)),
    m.BatteryStatus(0, (15.25, *(None,) * 9), 12.5, 1234, 71, 640, 1),
    m.BatteryStatus(1, (None,) * 10),
    m.VfrHud(7.5, 6.25, 271, 45, 512.5, -1.5),
    m.ParamRequestList(1, 1),
    m.RequestDataStream(1, 1, 6, 4),
    m.TerrainRequest(46.1234567, -7.7654321, 100, 2**56 - 1),
    m.FileTransfer(1, 1, bytes(range(251))),
    m.TerrainData(46.1234567, -7.7654321, 100, 55, tuple(range(-8, 8))),
    m.TerrainReport(46.1234567, -7.7654321, 100, 512.5, 60.25, 56, 1120),
    m.LogRequestList(1, 1, 3, 8),
    m.LogEntry(4, 5, 8, 1790000000, 123456789),
    m.LogRequestData(1, 1, 4, 90000, 46080),
    m.LogData(4, 90000, 2, (7, 255, *(0,) * 88)),
    m.LogRequestEnd(1, 1),
    m.CameraFeedback(71.25, 3, 46.1234567, -7.7654321, 512.5, 60.25, 1.5, -2.5, 271.0, 2),
    m.CameraImageCaptured(71.25, 46.1234567, -7.7654321, 512.5, 60.25, (0.5, -0.5, 0.5, -0.5), 3, 1),
    m.RadioStatus(180, 175, 98, 40, 41, 300, 7),
]


def every_kind_of_message() -> set[type[m.Message]]:
    kinds = {kind for kind in vars(m).values() if isinstance(kind, type) and issubclass(kind, m.Message)}
    return kinds - {m.Message, m.Addressed}


def codec() -> Codec:
    return Codec(system_id=1, component_id=1)


@pytest.mark.parametrize("message", SAMPLES, ids=lambda s: type(s).__name__)
def test_every_message_comes_back_equal_with_its_sender(message: m.Message) -> None:
    assert codec().decode(Codec(system_id=42, component_id=7).encode(message)) == [m.Received(message, 42, 7)]


def test_there_is_a_sample_of_every_message() -> None:
    assert {type(sample) for sample in SAMPLES} == every_kind_of_message()


def test_bytes_are_mavlink_2_with_a_sequence_number() -> None:
    sender = codec()
    first, second = sender.encode(SAMPLES[0]), sender.encode(SAMPLES[0])
    assert (first[0], first[4], second[4]) == (0xFD, 0, 1)
    for _ in range(254):
        last = sender.encode(SAMPLES[0])
    assert (last[4], sender.encode(SAMPLES[0])[4]) == (255, 0)


def test_a_nan_parameter_survives() -> None:
    item = m.MissionItemInt(1, 1, 0, 6, 16, (0.0, 0.0, 0.0, math.nan), 0, 0, 0.0)
    (received,) = codec().decode(codec().encode(item))
    assert isinstance(received.message, m.MissionItemInt)
    assert math.isnan(received.message.params[3])


@settings(derandomize=True, max_examples=200)
@given(st.integers(-900000000, 900000000), st.integers(-1800000000, 1800000000))
def test_coordinates_are_exact_in_both_directions(lat: int, lon: int) -> None:
    home = m.HomePosition(lat / 1e7, lon / 1e7, 0.0)
    (received,) = codec().decode(codec().encode(home))
    assert received.message == home


def test_coordinates_are_rounded_not_truncated() -> None:
    data = codec().encode(m.HomePosition(46.00000019, -7.00000019, 0.0))
    (received,) = codec().decode(data)
    assert received.message == m.HomePosition(46.0000002, -7.0000002, 0.0)


def test_garbage_around_and_between_messages_is_skipped_and_counted() -> None:
    one, two = codec().encode(SAMPLES[0]), codec().encode(SAMPLES[4])
    reader = codec()
    received = reader.decode(b"\x00\xfd\xfe\xfd" + one + b"\xfd\x05" + two + b"\xfe")
    assert [r.message for r in received] == [SAMPLES[0], SAMPLES[4]]
    assert reader.statistics.garbage_bytes == 7


def test_a_damaged_message_is_dropped_and_the_next_one_read() -> None:
    for position in range(len(codec().encode(SAMPLES[0]))):
        damaged = bytearray(codec().encode(SAMPLES[0]))
        damaged[position] ^= 0x10
        received = codec().decode(bytes(damaged) + codec().encode(SAMPLES[4]))
        assert m.Received(SAMPLES[4], 1, 1) in received
        assert SAMPLES[0] not in [r.message for r in received]


def test_random_bytes_never_raise() -> None:
    rng, reader = random.Random(1), codec()
    for _ in range(500):
        assert reader.decode(bytes(rng.choices([0xFD, 0xFE, 0, 9, *range(256)], k=60))) == []
    assert reader.statistics.garbage_bytes == 500 * 60


def test_a_cut_off_message_holds_nothing_back() -> None:
    reader = codec()
    assert reader.decode(codec().encode(SAMPLES[0])[:-1]) == []
    assert len(reader.decode(codec().encode(SAMPLES[0]))) == 1


def test_valid_messages_of_other_kinds_are_counted() -> None:
    other = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    reader = codec()
    assert reader.decode(dialect.MAVLink_rangefinder_message(1, 1).pack(other)) == []
    assert (reader.statistics.other_kinds, reader.statistics.garbage_bytes) == (1, 0)


def test_mavlink_1_and_signed_messages_are_read() -> None:
    old = dialect.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 3).pack(dialect.MAVLink(None, 9, 1), force_mavlink1=True)
    signer = dialect.MAVLink(None, 8, 1)
    signer.signing.secret_key, signer.signing.sign_outgoing = b"k" * 32, True
    signed = dialect.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 3).pack(signer)
    assert (old[0], signed[2]) == (0xFE, 1)
    assert [r.system_id for r in codec().decode(bytes(old) + bytes(signed))] == [9, 8]


@pytest.mark.parametrize(
    ("message", "what"),
    [
        (m.MissionCount(1, 1, 65536), "MISSION_COUNT"),
        (m.HomePosition(math.nan, 0.0, 0.0), "lat_deg"),
        (m.HomePosition(46.0, 0.0, 1e9), "HOME_POSITION"),
        (m.StatusText(3, "x" * 51), "51 bytes"),
        (m.ParamRequestRead(1, 1, "SEVENTEEN_LETTERS"), "17 bytes"),
        (m.MissionItemInt(1, 1, 0, 6, 16, (1e39, 0.0, 0.0, 0.0), 0, 0, 0.0), "MISSION_ITEM_INT"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(message: m.Message, what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        codec().encode(message)


@pytest.mark.parametrize("bad", [0, 256])
def test_ids_are_bytes(bad: int) -> None:
    with pytest.raises(MisuseError, match="must be between 1 and 255"):
        Codec(system_id=bad, component_id=1)


def test_message_ids() -> None:
    assert (message_id(m.GlobalPositionInt), message_id(m.HomePosition)) == (33, 242)


def test_armed_is_a_bit_of_the_heartbeat() -> None:
    assert m.Heartbeat(3, 2, 0x81).armed
    assert not m.Heartbeat(3, 2, 0x59).armed


def test_addressing() -> None:
    assert m.is_for(m.MissionCount(0, 0, 1), system_id=3, component_id=4)
    assert m.is_for(m.Heartbeat(3, 2), system_id=3, component_id=4)
    assert not m.is_for(m.MissionCount(3, 5, 1), system_id=3, component_id=4)
    assert all(dataclasses.is_dataclass(sample) for sample in SAMPLES)


def counted(numbers: list[int]) -> tuple[int, int, int]:
    counter = SequenceCounter()
    for number in numbers:
        counter.take((1, 1), number)
    return counter.lost, counter.late, counter.duplicates


@pytest.mark.parametrize(
    ("numbers", "lost_late_duplicates"),
    [
        ([], (0, 0, 0)),
        ([200], (0, 0, 0)),
        ([7, 8, 9], (0, 0, 0)),
        ([254, 255, 0, 1], (0, 0, 0)),
        ([7, 9], (1, 0, 0)),
        ([254, 2], (3, 0, 0)),
        ([7, 9, 8, 10], (0, 1, 0)),
        ([7, 9, 8, 8, 7], (0, 1, 2)),
        ([5, 5], (0, 0, 1)),
        ([0, 128], (127, 0, 0)),
        ([0, 129], (0, 0, 1)),
        ([0, 2, 128, 1], (125, 1, 0)),
        ([0, 2, 100, 200, 40, 1, 1], (291, 1, 1)),
    ],
)
def test_sequence_numbers(numbers: list[int], lost_late_duplicates: tuple[int, int, int]) -> None:
    assert counted(numbers) == lost_late_duplicates


def test_senders_are_counted_apart() -> None:
    counter = SequenceCounter()
    for seq in range(0, 200, 2):
        counter.take((1, 1), seq // 2)
        counter.take((1, 2), seq)
    assert counter.lost == 99


def test_loss_duplicates_and_order_are_told_apart_over_many_rounds() -> None:
    rng = random.Random(8)
    kept = [number for number in range(5000) if rng.random() < 0.8]
    kept[-1] = 4999
    numbers = sorted(kept, key=lambda number: number + rng.choice([0, 0, 0, 5.5]))
    lost, late, duplicates = counted([0, *[number % 256 for number in numbers if number], 4999 % 256])
    assert lost == 5000 - len({0, *kept})
    assert late > 500
    assert duplicates == 1


def test_statistics_read_well() -> None:
    counts = LinkStatistics(frames_in=90, frames_out=12, lost=10, garbage_bytes=7, unsigned=1, replayed=2)
    assert str(counts) == "90 frames in, 12 frames out, 10 lost, 7 garbage bytes, 1 unsigned, 2 replayed"
    assert (counts.loss, counts.refused) == (0.1, 3)
    assert str(LinkStatistics()) == "no data arrived on the link"
    assert LinkStatistics().loss == 0.0
    assert counts.as_json()["lost"] == 10


ROWS = {row.layout.name: row for row in message_table.ROWS}
EXACT = 2**53
"""Above it the microseconds of 64-bit times have no double of their own."""

INTEGERS = {
    "B": (0, 2**8 - 1),
    "b": (-(2**7), 2**7 - 1),
    "H": (0, 2**16 - 1),
    "h": (-(2**15), 2**15 - 1),
    "I": (0, 2**32 - 1),
    "i": (-(2**31), 2**31 - 1),
    "Q": (0, EXACT),
    "q": (-EXACT, EXACT),
}
LETTERS = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=16).map(str.encode)


def payloads(name: str) -> st.SearchStrategy[bytes]:
    """Payloads of a kind of message, as any other program could fill them."""
    struct = layout_of(name).struct
    values: list[st.SearchStrategy[Any]] = []
    for count, letter in re.findall(r"(\d*)([a-zA-Z])", struct.format):
        if letter == "s":
            values.append(LETTERS)
        elif letter == "f":
            values.extend([st.floats(width=32)] * int(count or 1))
        else:
            values.extend([st.integers(*INTEGERS[letter])] * int(count or 1))
    return st.tuples(*values).map(lambda numbers: struct.pack(*numbers))


def read(data: bytes) -> Message:
    (received,) = Codec(system_id=200, component_id=1).decode(data)
    return received.message


IDS = {
    "mission_ack": ("opaque_id",),
    "mission_count": ("opaque_id",),
    "mission_current": ("mission_id", "fence_id", "rally_points_id"),
}
"""Fields that pymavlink's tables may not have yet."""


NOT_IN_PYMAVLINK = {"event"}


@pytest.mark.parametrize("name", sorted(ROWS))
@pytest.mark.no_cover
def test_any_message_survives_pymavlink(name: str) -> None:
    sender, theirs = Codec(system_id=42, component_id=7), pymavlink.MAVLink(None, 42, 7)

    @settings(derandomize=True, max_examples=25, deadline=None)
    @given(payloads(name))
    def survives(payload: bytes) -> None:
        number = ROWS[name].layout.message_id
        message = read(mavlink2_frame(number, payload, seq=0, system_id=9, component_id=9))
        assert repr(read(sender.encode(message))) == repr(message)
        if name in NOT_IN_PYMAVLINK:
            return
        known = getattr(pymavlink, f"MAVLink_{name}_message").fieldnames
        message = replace(message, **{field: 0 for field in IDS.get(name, ()) if field not in known})
        (parsed,) = theirs.parse_buffer(bytearray(sender.encode(message)))
        assert (parsed.get_type(), parsed.get_srcSystem(), parsed.get_srcComponent()) == (name.upper(), 42, 7)
        assert repr(read(bytes(parsed.pack(theirs)))) == repr(message)  # NaN is not equal to itself

    survives()


@pytest.mark.parametrize("name", sorted(ROWS))
def test_every_field_of_mavlink_1_is_one_of_ours_or_a_constant(name: str) -> None:
    """Otherwise it would be sent as 0 without anybody having decided so."""
    row = ROWS[name]
    ours = {wire for field in row.fields for wire in field.wire}
    decided = ours | DECIDED_ZERO.get(name, set())
    base = [field for field in row.layout.spans if row.layout.size_before(field) < row.size_1]
    assert [field for field in base if field not in decided] == []


DECIDED_ZERO = {
    "file_transfer_protocol": {"target_network"},
    "heartbeat": {"mavlink_version"},
    "home_position": {"x", "y", "z", "q", "approach_x", "approach_y", "approach_z"},
    "command_int": {"current", "autocontinue"},
    "sys_status": {
        "drop_rate_comm", "errors_comm", "errors_count1", "errors_count2", "errors_count3", "errors_count4",
    },
    "camera_feedback": {"target_system", "cam_idx", "foc_len", "flags"},
    "camera_image_captured": {"time_utc", "camera_id", "file_url"},
    "battery_status": {"energy_consumed", "temperature", "battery_function", "type"},
    "autopilot_version": {
        "middleware_sw_version", "os_sw_version", "board_version", "flight_custom_version",
        "middleware_custom_version", "os_custom_version", "vendor_id", "product_id",
    },
}  # fmt: skip


def test_constants_are_sent_as_they_are_in_the_table() -> None:
    theirs = pymavlink.MAVLink(None)
    sender = Codec(system_id=1, component_id=1)
    (beat,) = theirs.parse_buffer(bytearray(sender.encode(Heartbeat(3, 2))))
    (home,) = theirs.parse_buffer(bytearray(sender.encode(HomePosition(46.0, -7.0, 100.0))))
    assert beat.mavlink_version == 3
    assert home.q == [1.0, 0.0, 0.0, 0.0]
