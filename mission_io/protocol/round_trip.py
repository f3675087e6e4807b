"""The round-trip time of a link, measured during an exchange (RFC 6298)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

_QUITE_ANOTHER = 8.0
_FIRST_DOUBTFUL, _DOUBTFUL = 3, 8


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """A smoothed round trip and how much it varies, both in seconds."""

    smoothed_s: float
    variation_s: float

    @classmethod
    def first(cls, sample_s: float) -> "RoundTrip":
        """From the first measurement (RFC 6298, 2.2)."""
        return cls(sample_s, sample_s / 2.0)

    def updated(self, sample_s: float) -> "RoundTrip":
        """With one more measurement (RFC 6298, 2.3), more readily downwards.

        When the vehicle's answer gets lost and the vehicle repeats it by itself, the measurement is too long by the
        time it took to do so; too short it never is.
        """
        if sample_s < self.smoothed_s / _QUITE_ANOTHER:
            return RoundTrip.first(sample_s)
        gain = 0.125 if sample_s > self.smoothed_s else 0.5
        variation_s = 0.75 * self.variation_s + 0.25 * abs(self.smoothed_s - sample_s)
        return RoundTrip((1.0 - gain) * self.smoothed_s + gain * sample_s, variation_s)

    @property
    def time_out_s(self) -> float:
        """After this silence something was lost, most likely (RFC 6298, 2.3)."""
        return self.smoothed_s + 4.0 * self.variation_s


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for an answer, from the answers so far.

    An answer to a question that went out more than once does not tell which of them it answers (Karn), but it bounds the
    round trip: it cannot be longer than the time since the first. On a link that loses every third datagram it is the
    wrong conclusion to wait longer and longer; only after a run of doubtful answers is the smallest bound among them
    taken for the round trip.

    Attributes:
        round_trip: The estimate; None before the first answer.
        is_bound: Whether the estimate is such a bound, which the first certain answer replaces.
        doubtful: How many doubtful answers came in a row.
        smallest_s: The smallest bound among them.
    """

    round_trip: RoundTrip | None = None
    is_bound: bool = False
    doubtful: int = 0
    smallest_s: float = math.inf

    def after(self, answer: "AnswerDelay") -> "Patience":
        """With one more answer."""
        if answer.certain:
            known = None if self.is_bound else self.round_trip
            return Patience(
                RoundTrip.first(answer.since_first_s) if known is None else known.updated(answer.since_first_s)
            )
        doubtful, smallest_s = self.doubtful + 1, min(self.smallest_s, answer.since_first_s)
        if doubtful >= (_FIRST_DOUBTFUL if self.round_trip is None else _DOUBTFUL):
            return Patience(RoundTrip(smallest_s, smallest_s / 64.0), True, doubtful, smallest_s)
        return Patience(self.round_trip, self.is_bound, doubtful, smallest_s)


class AnswerDelay(NamedTuple):
    """How long an answer took since its question went out for the first time, and whether it went out only once."""

    since_first_s: float
    certain: bool


class Departures:
    """When what was sent and is not answered yet went out, by a number that stands for the question.

    Forgets what is answered, so that it stays as small as what is under way.
    """

    def __init__(self) -> None:
        self._first: dict[int, float] = {}
        self._last: dict[int, float] = {}

    def sent(self, question: int, now: float) -> None:
        """A question went out, for the first time or again."""
        self._first.setdefault(question, now)
        self._last[question] = now

    def answered(self, question: int, now: float) -> AnswerDelay | None:
        """Forget a question; how long its answer took, None when it was not asked."""
        if question not in self._first:
            return None
        first, last = self._first.pop(question), self._last.pop(question)
        return AnswerDelay(now - first, first == last)

    def forget_to(self, question: int) -> None:
        """Forget the questions up to this one: a later answer answered them, too."""
        for number in [number for number in self._first if number <= question]:
            del self._first[number], self._last[number]

    def age_s(self, question: int, now: float) -> float | None:
        """How long ago a question that is not answered went out for the last time; None when it did not."""
        sent_at = self._last.get(question)
        return None if sent_at is None else now - sent_at

    def clear(self) -> None:
        """Forget everything: the conversation begins anew."""
        self._first.clear()
        self._last.clear()
