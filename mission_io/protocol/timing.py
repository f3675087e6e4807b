"""Timeouts, tries and limits: those of a transfer, as data and learnt, and the longest duration of a client's call.

Numbers that are no matter of the link stand in ``data/protocol.toml``, which explains each. Every exchange has a deadline that
only progress moves: ``Timing.no_progress_s`` after it last got further than ever, where "further" means one more item held
(download) or one more item requested (upload). Restarts, at most ``TRANSFERS.restarts``, add only the time needed to get as far
again. The round-trip time of the link does not matter while it is shorter than ``no_progress_s``.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mission_io.data_tables import data_table
from mission_io.errors import MisuseError


@dataclass(frozen=True, slots=True, kw_only=True)
class _Transfers:
    restarts: int
    clear_tries: int
    readings: int
    stale_read_back_s: float
    clean_answers: int
    cancels_on_a_bad_link: int
    thanks_on_a_bad_link: int
    count_changes: int
    proven_items: int
    cheap_restart_s: float
    errors_at_an_item: int
    fresh_starts: int
    doubtful_items: int
    cancels: int
    deaf_tries: int
    stale_tries: int
    other_link_ratio: float
    first_doubtful_trips: int
    doubtful_trips: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Files:
    gaps_of_silence: float
    first_gap_s: float
    burst_most_wait_s: float
    hasty_bursts: int
    beyond_a_burst: int
    recent_answers: int
    tries_of_crc: int
    most_failures: int
    few_pieces: int
    small_fraction: float
    proving_pieces: int
    least_wait_s: float
    most_wait_s: float
    first_wait_s: float
    overtaking_answers: int
    least_control_wait_s: float
    hasty_tries: int
    most_entries: int
    burst: int
    quiet_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Values:
    most_refusals: int
    max_waiting: int
    reported_blocks: int
    latest_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Calls:
    answer_s: float
    item_limit_s: float
    resend_s: float
    heartbeat_s: float
    time_answers_per_s: float
    catch_up_s: float
    ardupilot_window: int
    list_again_s: float
    list_id_answer_s: float
    poll_s: float
    ask_again_s: float
    ask_version_s: float
    old_heartbeats: int
    listen_s: float
    terrain_every_s: float
    terrain_answer_s: float


TRANSFERS = data_table(_Transfers, "mission_io/data/protocol.toml", "transfers")
FILES = data_table(_Files, "mission_io/data/protocol.toml", "files")
VALUES = data_table(_Values, "mission_io/data/protocol.toml", "values")
CALLS = data_table(_Calls, "mission_io/data/protocol.toml", "calls")


# The round-trip time of a link, measured during an exchange (RFC 6298).


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
class RetryLimits:
    """Timeout of an answer, learnt from the answers so far.

    An answer to a repeated question does not tell which repetition it answers (Karn), but it bounds the round trip, which
    cannot exceed the time since the first. On a link that loses every third datagram, waiting longer and longer would be
    wrong; only after a run of doubtful answers is the smallest bound among them taken as the round trip.
    """

    round_trip: RoundTrip | None = None  # the estimate; None before the first answer
    is_bound: bool = False  # whether the estimate is such a bound, which the first certain answer replaces
    doubtful: int = 0  # number of consecutive doubtful answers
    smallest_s: float = math.inf  # the smallest bound among them

    def after(self, answer: "AnswerDelay") -> "RetryLimits":
        """Updated by an answer."""
        if answer.certain:
            known = None if self.is_bound else self.round_trip
            return RetryLimits(
                RoundTrip.first(answer.since_first_s) if known is None else known.updated(answer.since_first_s)
            )
        doubtful, smallest_s = self.doubtful + 1, min(self.smallest_s, answer.since_first_s)
        if doubtful >= (TRANSFERS.first_doubtful_trips if self.round_trip is None else TRANSFERS.doubtful_trips):
            return RetryLimits(RoundTrip(smallest_s, smallest_s / 64.0), True, doubtful, smallest_s)
        return RetryLimits(self.round_trip, self.is_bound, doubtful, smallest_s)


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


@dataclass(frozen=True, slots=True)
class Timing:
    """Time-outs of a client, in seconds, and how far ahead it works."""

    # silence after which the last thing the vehicle waits for is sent again, until the round trip is measured. From
    # then on it follows the measurement (``RoundTrip.time_out_s``) ...
    resend_s: float = 0.1
    resend_shortest_s: float = 0.02  # ... but is never shorter than this.
    resend_growth: float = 1.25  # each further silence in a row is longer by this factor ..
    resend_longest_s: float = 0.5  # ... up to this.
    # number of items sent (or requested, where the vehicle serves any order) ahead of their turn. A silence sets it to
    # 0, every eight answers in a row add one back.
    items_ahead: int = 1
    stall_s: float = 6.0  # silence after which an exchange is restarted. Longer than PX4 takes to drop one.
    # silence after which the vehicle counts as silent. A vehicle that answered late gets twice the time of its latest
    # answer before it counts as stalled, and as much longer before it counts as silent.
    give_up_s: float = 15.0
    # time without progress after which an exchange is given up, although the vehicle answers
    no_progress_s: float = 60.0
    busy_retry_s: float = 0.5  # wait after "busy" or "no space" before asking again
    # time after which a busy vehicle counts as refusing. Longer than ArduPilot's own time-out.
    busy_give_up_s: float = 15.0
    doubt_s: float = 2.5  # wait for a sign of progress after an ERROR that may only answer a duplicate
    # the same after an ERROR when everything was sent. Longer than a vehicle takes to repeat a request.
    recheck_s: float = 0.8
    linger_s: float = 1.0  # how long a cancelled transfer repeats the cancellation

    def __post_init__(self) -> None:
        """Refuse times that would never end or never begin."""
        for name in (
            "resend_s", "resend_shortest_s", "stall_s", "give_up_s", "no_progress_s", "busy_retry_s", "busy_give_up_s",
            "doubt_s", "recheck_s", "linger_s",
        ):  # fmt: skip
            if not 0.0 < getattr(self, name) < math.inf:
                raise MisuseError(f"Timing.{name} must be a positive number of seconds, not {getattr(self, name)}")
        if not (self.resend_growth >= 1.0 and self.resend_longest_s >= max(self.resend_s, self.resend_shortest_s)):
            raise MisuseError(
                "Timing: resend_growth must be at least 1, and resend_longest_s at least resend_s and resend_shortest_s"
            )
        if self.items_ahead < 0:
            raise MisuseError(f"Timing.items_ahead must be 0 or more, not {self.items_ahead}")


@dataclass(frozen=True, slots=True)
class LongestTimes:
    """Bounds in seconds, reached only by a hostile vehicle."""

    stuck_s: float  # from the last progress of a transfer to its end
    download_s: float  # ``Client.download``
    upload_s: float  # ``Client.upload``, with reading back what the vehicle holds when it fails
    verified_upload_s: float  # ``Client.upload_and_verify`` of a list within the known item limit
    clear_s: float  # ``Client.clear``, with reading back


def longest_times(timing: Timing, item_count: int) -> LongestTimes:
    """The bounds for at most ``item_count`` items transferred in either direction.

    A vehicle may take almost ``no_progress_s`` for each item and still progress, so the bounds grow with the number of items;
    for a vehicle that announces 65,535 items and sends three, the time for three applies.
    """
    steps = item_count + 1  # the count, and then each item
    restarts_s = TRANSFERS.restarts * steps * timing.resend_longest_s
    waits_s = max(timing.busy_retry_s, timing.doubt_s, timing.recheck_s)
    stuck_s = timing.no_progress_s + restarts_s + waits_s
    transfer_s = steps * timing.no_progress_s + stuck_s
    reading_s = TRANSFERS.readings * transfer_s + TRANSFERS.stale_read_back_s
    upload_s = transfer_s + timing.linger_s + reading_s
    clearing_s = timing.no_progress_s + timing.busy_retry_s
    return LongestTimes(
        stuck_s=stuck_s,
        download_s=transfer_s,
        upload_s=upload_s,
        verified_upload_s=upload_s + reading_s,
        clear_s=TRANSFERS.clear_tries * (clearing_s + transfer_s),
    )


class RateLimit:
    """Allows ``per_s`` answers a second on average, and as many at once after a pause."""

    def __init__(self, *, per_s: float) -> None:
        if not per_s >= 1.0:
            raise MisuseError(f"per_s must be 1 or more, not {per_s}")
        self._per_s = self._left = per_s
        self._at: float | None = None

    def allows(self, now: float) -> bool:
        """Whether one more answer may go out at ``now``; counts it if so."""
        if self._at is not None:
            self._left = min(self._per_s, self._left + (now - self._at) * self._per_s)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
