"""MAVLink 1 and 2 frames: found in bytes that may be corrupted, checked, and built by MAVLink's own tables.

The tables say which messages exist, how their payloads are laid out, and how the checksum is computed; this is the only
module that imports pymavlink.

A frame is found by its checksum. Bytes that are no frame are skipped one at a time and counted, and the result does not
depend on how the bytes were split. At most one unfinished frame is kept, and the checksum reads every byte at most once
for each earlier position where a frame could begin: no input makes this slow.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from mission_io.errors import MisuseError

_EVENT_ID: Final = 410
_EVENT_STRUCT: Final = Struct("<IIH3B40B")
_EVENT_CRC_EXTRA: Final = 160
"""EVENT of the common message set, which pymavlink's tables lack."""

CRC_EXTRAS: Final[Mapping[int, int]] = {
    **{number: kind.crc_extra for number, kind in _dialect.mavlink_map.items()},
    _EVENT_ID: _EVENT_CRC_EXTRA,
}
"""For each message id of the dialect, the byte that goes last into its checksum."""

PAYLOAD_SIZES: Final[Mapping[int, int]] = {
    **{number: kind.unpacker.size for number, kind in _dialect.mavlink_map.items()},
    _EVENT_ID: _EVENT_STRUCT.size,
}
"""For each message id of the dialect, the size of its payload with all extensions, in bytes."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Packing of the payload of a kind of message."""

    name: str  # its MAVLink name, in small letters
    message_id: int  # its number
    struct: Struct  # packs and unpacks the whole payload, extensions included
    # for each field, where its first value is among the values of ``struct``, and how many it has
    places: Mapping[str, tuple[int, int]]

    @property
    def value_count(self) -> int:
        """Number of values that ``struct`` packs."""
        return sum(count for _, count in self.places.values())

    def size_before(self, field: str) -> int:
        """The bytes of the payload before a field; before its first extension that is all MAVLink 1 has."""
        index = self.places[field][0]
        items = _format_items(self.struct.format)
        return Struct("<" + "".join(items[:index])).size


_LATER_EXTENSIONS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "mission_ack": (("opaque_id", "I"),),
    "mission_count": (("opaque_id", "I"),),
    "mission_current": (("mission_id", "I"), ("fence_id", "I"), ("rally_points_id", "I")),
}
"""Extensions of the common message set that pymavlink's tables may lack, each with its format. Checksums do not know them."""


_EVENT_PLACES: Final = {
    **{
        field: (place, 1)
        for place, field in enumerate(
            ("id", "event_time_boot_ms", "sequence", "destination_component", "destination_system", "log_levels")
        )
    },
    "arguments": (6, 40),
}


def layout_of(name: str) -> Layout:
    """The layout of a message by its MAVLink name, in small letters."""
    if name == "event":
        return Layout(name, _EVENT_ID, _EVENT_STRUCT, _EVENT_PLACES)
    kind = getattr(_dialect, f"MAVLink_{name}_message")
    places: dict[str, tuple[int, int]] = {}
    start = 0
    for field, count in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
        places[field] = (start, count)
        start += count
    packed = kind.unpacker.format
    for field, letter in _LATER_EXTENSIONS.get(name, ()):
        if field not in places:
            places[field] = (start, 1)
            start, packed = start + 1, packed + letter
    return Layout(name, kind.id, Struct(packed), places)


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, the checksum of every MAVLink frame."""
    crc: int = _dialect.x25crc(data).crc
    return crc


def _format_items(text: str) -> list[str]:
    """One format for each value: ``<B50s2H`` is ``B``, ``50s``, ``H``, ``H``."""
    items: list[str] = []
    digits = ""
    for letter in text.removeprefix("<"):
        if letter.isdigit():
            digits += letter
            continue
        items.extend([digits + letter] if letter == "s" else [letter] * int(digits or 1))
        digits = ""
    return items


SIGNATURE_SIZE: Final = 13
SIGNED_FLAG: Final = 0x01
"""The incompatibility flag of a frame with a signature; frames with any other such flag are no frames to us."""

LARGEST_FRAME: Final = 10 + 255 + 2 + SIGNATURE_SIZE

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_HEADER_1, _HEADER_2 = 6, 10
_CHECKSUM_SIZE = 2
_MAGIC: Final = re.compile(rb"[\xfd\xfe]")


class WireFrame(NamedTuple):
    """One frame whose checksum is right."""

    version: int  # MAVLink 1 or 2
    seq: int  # the sender's count of its frames, from 0 to 255 and over again
    system_id: int  # who sent it
    component_id: int  # which part of the sender
    message_id: int  # the kind of message
    payload: bytes  # its payload; in MAVLink 2 without the zeros at its end
    data: bytes  # all of the frame's bytes, the signature included
    signature: bytes  # link id, timestamp and signature (13 bytes), or nothing


@dataclass(frozen=True, slots=True)
class FramingCounts:
    """Counts of a framer."""

    garbage_bytes: int = 0  # bytes that belong to no frame, those of damaged frames included
    checksum_errors: int = 0  # places where a whole frame would be, if its checksum were right
    truncated_frames: int = 0  # places where a frame begins that does not end

    def __add__(self, other: "FramingCounts") -> "FramingCounts":
        return FramingCounts(
            self.garbage_bytes + other.garbage_bytes,
            self.checksum_errors + other.checksum_errors,
            self.truncated_frames + other.truncated_frames,
        )


class Framer:
    """Finds the frames in a stream of bytes. Never raises on what it is fed."""

    def __init__(self) -> None:
        self._unfinished = b""
        self._garbage = self._checksum_errors = self._truncated = 0

    @property
    def counts(self) -> FramingCounts:
        """Counts up to now, without the bytes of an unfinished frame."""
        return FramingCounts(self._garbage, self._checksum_errors, self._truncated)

    @property
    def unfinished_bytes(self) -> int:
        """Bytes that may be the beginning of a frame; always fewer than ``LARGEST_FRAME``."""
        return len(self._unfinished)

    def feed(self, data: bytes) -> list[WireFrame]:
        """The frames that these bytes complete."""
        buffer = self._unfinished + data
        frames: list[WireFrame] = []
        start = 0
        while (magic := _MAGIC.search(buffer, start)) is not None:
            self._garbage += magic.start() - start
            start = magic.start()
            size = _claimed_size(buffer, start)
            if size > len(buffer) - start:
                break
            frame = _frame(buffer[start : start + size]) if size else None
            if frame is None:
                self._checksum_errors += int(size > 0)
                self._garbage += 1
                start += 1
            else:
                frames.append(frame)
                start += size
        else:
            self._garbage += len(buffer) - start
            start = len(buffer)
        self._unfinished = bytes(buffer[start:])
        return frames

    def end(self) -> list[WireFrame]:
        """Nothing belongs to the bytes so far any more (a datagram is over): the frames inside an unfinished one."""
        frames: list[WireFrame] = []
        while self._unfinished:
            frames.extend(self._give_up())
        return frames

    def end_if_frames_wait(self) -> list[WireFrame]:
        """The same, but only when whole frames wait after an unfinished one: for a quiet stream."""
        if Framer().feed(self._unfinished[1:]):
            return self._give_up()
        return []

    def _give_up(self) -> list[WireFrame]:
        rest, self._unfinished = self._unfinished[1:], b""
        self._truncated += 1
        self._garbage += 1
        return self.feed(rest)


def frames_of(data: bytes) -> list[WireFrame]:
    """The frames of one datagram, by their checksums."""
    framer = Framer()
    return [*framer.feed(data), *framer.end()]


def frames_by_length(data: bytes) -> list[bytes]:
    """The frames of a datagram by their lengths, checksums unread; none where the lengths do not fit."""
    frames, start = [], 0
    while start < len(data):
        size = _claimed_size(data, start) if data[start] in (_MAGIC_1, _MAGIC_2) else 0
        if not 0 < size <= len(data) - start:
            return []
        frames.append(data[start : start + size])
        start += size
    return frames


def mavlink2_frame(
    message_id: int, payload: bytes, *, seq: int, system_id: int, component_id: int, flags: int = 0
) -> bytes:
    """A MAVLink 2 frame without its signature; zeros at the payload's end are left out, as MAVLink 2 does."""
    payload = payload.rstrip(b"\0") or payload[:1]
    header = bytes([_MAGIC_2, len(payload), flags, 0, seq, system_id, component_id]) + message_id.to_bytes(3, "little")
    return _with_checksum(header + payload, message_id)


def mavlink1_frame(message_id: int, payload: bytes, *, seq: int, system_id: int, component_id: int) -> bytes:
    """A MAVLink 1 frame. Raises MisuseError: the message came with MAVLink 2: its number is above 255."""
    if message_id > 255:
        raise MisuseError(f"message {message_id} does not exist in MAVLink 1, whose message IDs end at 255")
    header = bytes([_MAGIC_1, len(payload), seq, system_id, component_id, message_id])
    return _with_checksum(header + payload, message_id)


def _with_checksum(frame: bytes, message_id: int) -> bytes:
    return frame + checksum(frame[1:] + bytes([CRC_EXTRAS[message_id]])).to_bytes(_CHECKSUM_SIZE, "little")


def _claimed_size(buffer: bytes, start: int) -> int:
    """The size of the frame that may begin here, at least its minimum; 0 when none begins."""
    rest = len(buffer) - start
    if buffer[start] == _MAGIC_1:
        if rest < _HEADER_1:
            return _HEADER_1 + _CHECKSUM_SIZE
        length = buffer[start + 1]
        known = length <= PAYLOAD_SIZES.get(buffer[start + 5], -1)
        return _HEADER_1 + length + _CHECKSUM_SIZE if known else 0
    if rest < _HEADER_2:
        return _HEADER_2 + _CHECKSUM_SIZE
    flags = buffer[start + 2]
    # a payload longer than we know is fine: a newer peer may have more extensions.
    if flags & ~SIGNED_FLAG or int.from_bytes(buffer[start + 7 : start + 10], "little") not in CRC_EXTRAS:
        return 0
    return _HEADER_2 + buffer[start + 1] + _CHECKSUM_SIZE + (SIGNATURE_SIZE if flags else 0)


def _frame(data: bytes) -> WireFrame | None:
    """The frame that these bytes are, if its checksum is right."""
    signature = b""
    if data[0] == _MAGIC_1:
        version, header = 1, _HEADER_1
        _, length, seq, system_id, component_id, message_id = data[:_HEADER_1]
    else:
        version, header = 2, _HEADER_2
        _, length, flags, _, seq, system_id, component_id = data[:7]
        message_id = int.from_bytes(data[7:10], "little")
        if flags:
            signature = data[-SIGNATURE_SIZE:]
    end = header + length
    if checksum(data[1:end] + bytes([CRC_EXTRAS[message_id]])) != int.from_bytes(data[end : end + 2], "little"):
        return None
    return WireFrame(version, seq, system_id, component_id, message_id, data[header:end], data, signature)
