"""Link statistics: what was sent and received, and what was lost, corrupted or refused."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

_HALF = 128


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Counts since the link was opened; ``str`` is one line with those that are not 0.

    Attributes:
        frames_in: Frames with a right checksum.
        frames_out: Frames sent.
        lost: Frames that never came, by the gaps in their senders' sequence numbers.
        late: Frames that came behind a later one of their sender.
        duplicates: Frames that came twice.
        checksum_errors: Places where a whole frame would be, if its checksum were right.
        truncated_frames: Frames that began and did not end.
        garbage_bytes: Bytes that belong to no frame.
        signed: Frames with a signature that nobody looked at, because this side has no key.
        unsigned: Frames refused because they are not signed.
        forged: Frames refused because their signature is not made with our key, or damaged.
        replayed: Frames refused because their signature is not newer than what was heard before.
        other_kinds: Good frames of kinds that mission_io has no use for.
        for_others: Messages to other systems or components; ignored.
        echoes: Our own frames that came back; ignored.
    """

    frames_in: int = 0
    frames_out: int = 0
    lost: int = 0
    late: int = 0
    duplicates: int = 0
    checksum_errors: int = 0
    truncated_frames: int = 0
    garbage_bytes: int = 0
    signed: int = 0
    unsigned: int = 0
    forged: int = 0
    replayed: int = 0
    other_kinds: int = 0
    for_others: int = 0
    echoes: int = 0

    @property
    def refused(self) -> int:
        """Frames that were refused because of their signature, or because they have none."""
        return self.unsigned + self.forged + self.replayed

    @property
    def loss(self) -> float:
        """Share of the frames sent to us that never came, from 0 to 1; 0 when there were none."""
        sent = self.frames_in - self.duplicates + self.lost
        return self.lost / sent if sent else 0.0

    def as_json(self) -> Mapping[str, int]:
        """Every count by its name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def __str__(self) -> str:
        shown = [f"{count} {name.replace('_', ' ')}" for name, count in self.as_json().items() if count]
        return ", ".join(shown) or "nothing went over the link"


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
        """Take the number of a frame that came from a sender."""
        state = self._senders.get(sender)
        if state is None:
            self._senders[sender] = _Sender(seq)
            return
        missing = state.missing
        ahead = (seq - state.latest) % 256
        if 1 <= ahead <= _HALF:
            state.latest = seq
            self.lost += ahead - 1
            if missing:  # what is half a round behind cannot be told from what is half a round ahead
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
    """The latest number of a sender, and those of the half round before it that have not come."""

    latest: int
    missing: set[int] = field(default_factory=set)
