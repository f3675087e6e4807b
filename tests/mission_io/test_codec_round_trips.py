"""Messages of every kind with any values, through pymavlink's parser and packer and back."""

import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as pymavlink

from mission_io.wire import message_table
from mission_io.wire.codec import Codec
from mission_io.wire.framing import layout_of, mavlink2_frame
from mission_io.wire.messages import Heartbeat, HomePosition, Message

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
    base = [field for field in row.layout.places if row.layout.size_before(field) < row.size_1]
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
