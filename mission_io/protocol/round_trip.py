"""The round-trip time of a link, measured during an exchange (RFC 6298)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mission_io.protocol.tuning import TRANSFERS


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """Smoothed round-trip time and its variation, in seconds."""

    smoothed_s: float
    variation_s: float

    @classmethod
    def first(cls, sample_s: float) -> "RoundTrip":
        """From the first measurement (RFC 6298, 2.2)."""
        return cls(sample_s, sample_s / 2.0)

    def updated(self, sample_s: float) -> "RoundTrip":
        """Updated by a measurement (RFC 6298, 2.3), faster downwards.

        When the vehicle's answer is lost and it repeats the answer by itself, the measurement is too long by that time; it is
        never too short.
        """
        if sample_s < self.smoothed_s / TRANSFERS.other_link_ratio:
            return RoundTrip.first(sample_s)
        gain = 0.125 if sample_s > self.smoothed_s else 0.5
        variation_s = 0.75 * self.variation_s + 0.25 * abs(self.smoothed_s - sample_s)
        return RoundTrip((1.0 - gain) * self.smoothed_s + gain * sample_s, variation_s)

    @property
    def time_out_s(self) -> float:
        """Silence after which something was most likely lost (RFC 6298, 2.3)."""
        return self.smoothed_s + 4.0 * self.variation_s


@dataclass(frozen=True, slots=True)
class Patience:
    """Timeout of an answer, learnt from the answers so far.

    An answer to a repeated question does not tell which repetition it answers (Karn), but it bounds the round trip, which
    cannot exceed the time since the first. On a link that loses every third datagram, waiting longer and longer would be
    wrong; only after a run of doubtful answers is the smallest bound among them taken as the round trip.
    """

    round_trip: RoundTrip | None = None  # the estimate; None before the first answer
    is_bound: bool = False  # whether the estimate is such a bound, which the first certain answer replaces
    doubtful: int = 0  # number of consecutive doubtful answers
    smallest_s: float = math.inf  # the smallest bound among them

    def after(self, answer: "AnswerDelay") -> "Patience":
        """Updated by an answer."""
        if answer.certain:
            known = None if self.is_bound else self.round_trip
            return Patience(
                RoundTrip.first(answer.since_first_s) if known is None else known.updated(answer.since_first_s)
            )
        doubtful, smallest_s = self.doubtful + 1, min(self.smallest_s, answer.since_first_s)
        if doubtful >= (TRANSFERS.first_doubtful_trips if self.round_trip is None else TRANSFERS.doubtful_trips):
            return Patience(RoundTrip(smallest_s, smallest_s / 64.0), True, doubtful, smallest_s)
        return Patience(self.round_trip, self.is_bound, doubtful, smallest_s)


class AnswerDelay(NamedTuple):
    """Time from the first sending of a question to its answer; certain if the question was sent only once."""

    since_first_s: float
    certain: bool


class Departures:
    """Sending times of unanswered questions, by number.

    Answered questions are forgotten, so its size is that of what is under way.
    """

    def __init__(self) -> None:
        self._first: dict[int, float] = {}
        self._last: dict[int, float] = {}

    def sent(self, question: int, now: float) -> None:
        """Note that a question was sent, for the first time or again."""
        self._first.setdefault(question, now)
        self._last[question] = now

    def answered(self, question: int, now: float) -> AnswerDelay | None:
        """Forget a question; returns the delay of its answer, None when it was not asked."""
        if question not in self._first:
            return None
        first, last = self._first.pop(question), self._last.pop(question)
        return AnswerDelay(now - first, first == last)

    def forget_to(self, question: int) -> None:
        """Forget the questions up to this one, which a later answer covers."""
        for number in [number for number in self._first if number <= question]:
            del self._first[number], self._last[number]

    def age_s(self, question: int, now: float) -> float | None:
        """Time since an unanswered question was last sent; None when it was not."""
        sent_at = self._last.get(question)
        return None if sent_at is None else now - sent_at

    def clear(self) -> None:
        """Forget everything: the exchange restarts."""
        self._first.clear()
        self._last.clear()
