"""MAVLink bytes to messages and back: frames found in bytes that may be corrupted, checked, decoded, encoded and built.

The layout of each message is in ``message_table``. A frame is found by its checksum. Bytes that are no frame are skipped one
at a time and counted, and the result does not depend on how the bytes were split: no datagram affects the next one. At most one
unfinished frame is kept, and the checksum reads every byte at most once for each earlier position where a frame could begin: no
input makes this slow. Peers are addressed in MAVLink 2, or in MAVLink 1 when they speak nothing newer.
"""

import re
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

from mission_io.errors import MisuseError
from mission_io.wire import messages as m
from mission_io.wire.message_table import BY_CLASS, BY_ID, CRC_EXTRAS, PAYLOAD_SIZES, MessageRow, checksum
from mission_io.wire.messages import WireFrame
from mission_io.wire.signing import SignatureCheck, Signing

SIGNATURE_SIZE: Final = 13
SIGNED_FLAG: Final = 0x01
"""The incompatibility flag of a frame with a signature; frames with any other such flag are no frames to us."""

LARGEST_FRAME: Final = 10 + 255 + 2 + SIGNATURE_SIZE

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_HEADER_1, _HEADER_2 = 6, 10
_CHECKSUM_SIZE = 2
_MAGIC: Final = re.compile(rb"[\xfd\xfe]")


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
    """Finds the frames in a stream of bytes. Never raises on any input."""

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
        """End the datagram: return the frames inside an unfinished one."""
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
    """The frames of a datagram by their lengths, checksums unread; empty where the lengths do not fit."""
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
    """A MAVLink 2 frame without its signature; zeros at the payload's end are omitted, as MAVLink 2 does."""
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


def message_id(kind: type[Any]) -> int:
    """The MAVLink number of a message class, as SET_MESSAGE_INTERVAL and REQUEST_MESSAGE need it."""
    return BY_CLASS[kind].layout.message_id


_REMEMBERED = 200
"""Number of own frames recognised when they come back; fewer than there are sequence numbers."""

_USE_2 = "the peer uses MAVLink 1; switch its link to MAVLink 2 (ArduPilot: SERIALn_PROTOCOL = 2)"
_WHAT_IS_NEW = {"mission_type": "fences and rally points"}


_HALF = 128


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Counts since the link was opened; ``str`` is one line with those that are not 0."""

    frames_in: int = 0  # frames with a right checksum
    frames_out: int = 0  # frames sent
    lost: int = 0  # frames that never came, by the gaps in their senders' sequence numbers
    late: int = 0  # frames that came behind a later one of their sender
    duplicates: int = 0  # frames that came twice
    checksum_errors: int = 0  # places where a whole frame would be, if its checksum were right
    truncated_frames: int = 0  # frames that began and did not end
    garbage_bytes: int = 0  # bytes that belong to no frame
    signed: int = 0  # frames with an unverified signature, because this side has no key
    unsigned: int = 0  # frames refused because they are not signed
    forged: int = 0  # frames refused because their signature is not made with our key, or damaged
    replayed: int = 0  # frames refused because their signature is not newer than what was heard before
    other_kinds: int = 0  # good frames of kinds that mission_io has no use for
    for_others: int = 0  # messages to other systems or components; ignored
    echoes: int = 0  # our own frames that came back; ignored

    @property
    def refused(self) -> int:
        """Frames that were refused because of their signature, or because they have none."""
        return self.unsigned + self.forged + self.replayed

    @property
    def loss(self) -> float:
        """Fraction of the frames sent to us that were lost, from 0 to 1; 0 when there were none."""
        sent = self.frames_in - self.duplicates + self.lost
        return self.lost / sent if sent else 0.0

    def as_json(self) -> Mapping[str, int]:
        """Every count by its name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def __str__(self) -> str:
        shown = [f"{count} {name.replace('_', ' ')}" for name, count in self.as_json().items() if count]
        return ", ".join(shown) or "no data arrived on the link"


class SequenceCounter:
    """Counts what is missing in the sequence numbers of each sender, which run from 0 to 255 and over again.

    Attributes:
        lost: Numbers that were omitted and did not come late either.
        late: Numbers that came behind later ones.
        duplicates: Numbers that came twice.
    """

    def __init__(self) -> None:
        self.lost = self.late = self.duplicates = 0
        self._senders: dict[tuple[int, int], _Sender] = {}

    def take(self, sender: tuple[int, int], seq: int) -> None:
        """Take the number of a frame from a sender."""
        state = self._senders.get(sender)
        if state is None:
            self._senders[sender] = _Sender(seq)
            return
        missing = state.missing
        ahead = (seq - state.latest) % 256
        if 1 <= ahead <= _HALF:
            state.latest = seq
            self.lost += ahead - 1
            if missing:  # half a round behind looks the same as half a round ahead
                missing.difference_update((seq + _HALF - 1 - step) % 256 for step in range(ahead))
            if ahead > 1:
                missing.update((seq - step) % 256 for step in range(1, ahead))
        elif seq in missing:
            missing.discard(seq)
            self.lost -= 1
            self.late += 1
        else:
            self.duplicates += 1


@dataclass(slots=True)
class _Sender:
    """The latest number of a sender, and the missing ones of the half round before it."""

    latest: int
    missing: set[int] = field(default_factory=set)


class Codec:
    """Encodes and decodes for one system and component; numbers what it sends and counts what it skips.

    Args:
        system_id: Our MAVLink system.
        component_id: Our component.
        signing: Signs what is sent and refuses what is not signed with the same key; None disables both.

    Attributes:
        version: The MAVLink version that is spoken: 2, or 1 to peers that know no other.
    """

    def __init__(self, *, system_id: int, component_id: int, signing: Signing | None = None) -> None:
        for name, value in (("system_id", system_id), ("component_id", component_id)):
            if not 1 <= value <= 255:
                raise MisuseError(f"{name} must be between 1 and 255, not {value}")
        self.system_id, self.component_id = system_id, component_id
        self.signing = signing
        self.version = 2
        self._seq = 0
        self._sent: dict[bytes, None] = {}
        self._framer = Framer()
        self._sequence = SequenceCounter()
        self._counts: Counter[str] = Counter()

    @property
    def statistics(self) -> LinkStatistics:
        """Counts of messages sent, received, lost and refused so far."""
        framing = self._framer.counts
        return LinkStatistics(
            **self._counts,
            lost=self._sequence.lost,
            late=self._sequence.late,
            duplicates=self._sequence.duplicates,
            checksum_errors=framing.checksum_errors,
            truncated_frames=framing.truncated_frames,
            garbage_bytes=framing.garbage_bytes,
        )

    def encode(self, message: m.Message) -> bytes:
        """The bytes of one message.

        Raises:
            MisuseError: a value that does not fit its MAVLink field, or that does not exist in MAVLink 1 when that is
                spoken; it names the message and the field.
        """
        row = BY_CLASS[type(message)]
        frame = self._frame_1(row, message) if self.version == 1 else self._frame_2(row, message)
        self._seq = (self._seq + 1) % 256
        self._counts["frames_out"] += 1
        self._sent[frame] = None
        if len(self._sent) > _REMEMBERED:
            del self._sent[next(iter(self._sent))]
        return frame

    def _frame_2(self, row: MessageRow, message: m.Message) -> bytes:
        signing = self.signing
        flags = 0 if signing is None else SIGNED_FLAG
        frame = mavlink2_frame(
            row.layout.message_id,
            _payload(row, message),
            seq=self._seq,
            system_id=self.system_id,
            component_id=self.component_id,
            flags=flags,
        )
        return frame if signing is None else frame + signing.signature(frame)

    def _frame_1(self, row: MessageRow, message: m.Message) -> bytes:
        if self.signing is not None:
            raise MisuseError(f"MAVLink 1 cannot be signed; {_USE_2}")
        for name, unsaid in row.extensions.items():
            value = getattr(message, name)
            if value != unsaid:
                what = _WHAT_IS_NEW.get(name, f"{name} = {value}")
                raise MisuseError(f"{row.layout.name.upper()}: {what} do not exist in MAVLink 1; {_USE_2}")
        return mavlink1_frame(
            row.layout.message_id,
            _payload(row, message)[: row.size_1],
            seq=self._seq,
            system_id=self.system_id,
            component_id=self.component_id,
        )

    def decode(self, datagram: bytes) -> list[m.Received]:
        """The messages in one datagram, in order. Never raises on what a peer sent."""
        found: list[m.Received] = []
        for frame in [*self._framer.feed(datagram), *self._framer.end()]:
            self._counts["frames_in"] += 1
            if frame.data in self._sent:
                self._counts["echoes"] += 1
                continue
            verdict = SignatureCheck.ACCEPTED if self.signing is None else self.signing.judge(frame)
            if verdict is not SignatureCheck.ACCEPTED:
                self._counts[verdict.value] += 1
                continue
            if frame.signature and self.signing is None:
                self._counts["signed"] += 1
            self._sequence.take((frame.system_id, frame.component_id), frame.seq)
            row = BY_ID.get(frame.message_id)
            if row is None:
                self._counts["other_kinds"] += 1
                continue
            found.append(m.Received(_message_of(row, frame), frame.system_id, frame.component_id, frame.version))
        return found


def _payload(row: MessageRow, message: m.Message) -> bytes:
    values = list(row.constants)
    for cell, slot, value in zip(row.fields, row.slots, row.attributes(message), strict=True):
        values[slot] = value if cell.encode is None else cell.encode(value)
    try:
        return row.layout.struct.pack(*values)
    except (struct.error, OverflowError) as error:
        raise MisuseError(f"{message} does not fit in {row.layout.name.upper()}: {error}") from None


def _message_of(row: MessageRow, frame: WireFrame) -> m.Message:
    """Our message; what does not exist in MAVLink 1 keeps its default when that was spoken."""
    size = row.layout.struct.size
    wire = row.layout.struct.unpack(frame.payload[:size].ljust(size, b"\0"))
    values = [
        take(wire) if field.decode is None else field.decode(take(wire))
        for field, take in zip(row.fields, row.takers, strict=True)
    ]
    message = row.ours(*values)
    return replace(message, **row.extensions) if frame.version == 1 and row.extensions else message
