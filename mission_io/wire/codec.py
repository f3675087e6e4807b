"""MAVLink bytes to messages and back.

The layout of each message is in ``message_table``. Frames are found by their checksum, so garbage, corrupted and unknown
messages are skipped and counted, and no datagram affects the next one. Peers are addressed in MAVLink 2, or in MAVLink 1
when they speak nothing newer.
"""

import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from mission_io.errors import MisuseError
from mission_io.wire import messages as m
from mission_io.wire.framing import SIGNED_FLAG, Framer, WireFrame, mavlink1_frame, mavlink2_frame
from mission_io.wire.message_table import BY_CLASS, BY_ID, MessageRow
from mission_io.wire.signing import SignatureCheck, Signing


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
        lost: Numbers that were left out and did not come late either.
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
