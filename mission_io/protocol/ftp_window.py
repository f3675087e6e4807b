"""Requests of MAVLink FTP under way: their timeouts, their losses, and the retries of questions."""

import math
from collections import OrderedDict
from dataclasses import dataclass

from mission_io.protocol.ftp import FtpMessage
from mission_io.protocol.round_trip import RoundTrip
from mission_io.protocol.tuning import FILES


class FtpWaits:
    """Timeout of an answer, learnt from earlier ones."""

    def __init__(self) -> None:
        self._round_trip: RoundTrip | None = None
        self._shortest_s = math.inf

    def measure(self, sample_s: float) -> None:
        """Learn from the delay of an answer."""
        self._shortest_s = min(self._shortest_s, sample_s)
        first = self._round_trip is None
        self._round_trip = (
            RoundTrip.first(sample_s) if first or self._round_trip is None else self._round_trip.updated(sample_s)
        )

    def alone_s(self, tries: int) -> float:
        """Before a question is asked again when nothing else is on the way.

        An answer is given again for a repeated number: a longer timeout would only cost time.
        """
        if self._round_trip is None:
            return FILES.first_wait_s
        slow_tries = max(0, tries - FILES.hasty_tries)
        shortest = max(FILES.least_control_wait_s, 1.5 * self._shortest_s)
        return min(FILES.most_wait_s, shortest * 2.0 ** min(slow_tries, 10))

    @property
    def among_others_s(self) -> float:
        """Before a request of several is taken for lost."""
        if self._round_trip is None:
            return FILES.first_wait_s
        waits = 2.0 * self._round_trip.smoothed_s + 4.0 * self._round_trip.variation_s
        return min(FILES.most_wait_s, max(FILES.least_wait_s, waits))


class FtpQuestion:
    """One request with nothing else on the way, repeated until it is answered."""

    def __init__(self, request: FtpMessage, waits: FtpWaits) -> None:
        self.request = request
        self._waits, self._asked_at_s, self._tries = waits, -math.inf, 0

    @property
    def next_timer(self) -> float:
        """When it is asked again."""
        return self._asked_at_s + self._waits.alone_s(self._tries)

    def messages_to_send(self, now: float) -> list[FtpMessage]:
        """The request, when it is due."""
        if now < self.next_timer:
            return []
        self._asked_at_s, self._tries = now, self._tries + 1
        return [self.request]

    def is_answered_by(self, answer: FtpMessage, now: float) -> bool:
        """Whether this is its answer."""
        if (answer.seq - 1) % 65536 != self.request.seq or answer.answers != self.request.operation:
            return False
        if self._tries == 1:
            self._waits.measure(now - self._asked_at_s)
        return True


@dataclass(slots=True)
class _Sent:
    """A request under way: its piece, its number, its time, and the count of later answered ones."""

    piece: int
    at_s: float
    number: int
    later: int = 0


class FtpWindow:
    """Requests for pieces of a file, several on their way at once."""

    def __init__(self, waits: FtpWaits) -> None:
        self._waits = waits
        self._sent: OrderedDict[int, _Sent] = OrderedDict()
        self._late: dict[int, _Sent] = {}
        self._count = 0

    def __len__(self) -> int:
        """Number of requests under way."""
        return len(self._sent)

    def add(self, seq: int, piece: int, now: float) -> None:
        """A request was sent."""
        self._sent[seq] = _Sent(piece, now, self._count)
        self._count += 1

    def take(self, seq: int, now: float) -> int | None:
        """The piece of the request that was answered, one that was taken for lost included; None for an unknown one."""
        sent = self._sent.pop(seq, None)
        if sent is None:
            sent = self._late.pop(seq, None)
            if sent is None:
                return None
        else:
            for other in self._sent.values():
                if other.number > sent.number:
                    break
                other.later += 1
        self._waits.measure(now - sent.at_s)
        return sent.piece

    def lost(self, now: float) -> list[int]:
        """The pieces of requests that are taken for lost from now on."""
        lost = [
            seq
            for seq, sent in self._sent.items()
            if sent.later >= FILES.overtaking_answers or now >= sent.at_s + self._waits.among_others_s
        ]
        self._late |= {seq: self._sent.pop(seq) for seq in lost}
        return [self._late[seq].piece for seq in lost]

    def next_timer(self) -> float | None:
        """When the oldest is taken for lost; None when none is on the way."""
        oldest = next(iter(self._sent.values()), None)
        return None if oldest is None else oldest.at_s + self._waits.among_others_s

    def clear(self) -> None:
        """Forget all of them."""
        self._sent.clear()
        self._late.clear()
