"""Timeouts and retries of a transfer (`Timing`), and the longest duration of a client's call.

Every exchange has a deadline that only progress moves: ``Timing.no_progress_s`` after it last got further than ever,
where "further" means one more item held (download) or one more item requested (upload). Restarts, at most ``TRANSFERS.restarts``,
add only the time needed to get as far again. The round-trip time of the link does not matter while it is shorter than
``no_progress_s``.
"""

import math
from dataclasses import dataclass

from mission_io.errors import MisuseError
from mission_io.protocol.tuning import TRANSFERS


@dataclass(frozen=True, slots=True)
class Timing:
    """Time-outs of a client, in seconds, and how far ahead it works.

    Attributes:
        resend_s: Silence after which the last thing the vehicle waits for is sent again, until the round trip is
            measured. From then on it follows the measurement (``RoundTrip.time_out_s``) ...
        resend_shortest_s: ... but is never shorter than this.
        resend_growth: Each further silence in a row is longer by this factor ...
        resend_longest_s: ... up to this.
        items_ahead: Number of items sent (or requested, where the vehicle serves any order) ahead of their turn. A silence
            sets it to 0, every eight answers in a row add one back.
        stall_s: Silence after which an exchange is restarted. Longer than PX4 takes to drop one.
        give_up_s: Silence after which the vehicle counts as silent. A vehicle that answered late gets twice the time of
            its latest answer before it counts as stalled, and as much longer before it counts as silent.
        no_progress_s: Time without progress after which an exchange is given up, although the vehicle answers.
        busy_retry_s: Wait after "busy" or "no space" before asking again.
        busy_give_up_s: Time after which a busy vehicle counts as refusing. Longer than ArduPilot's own time-out.
        doubt_s: Wait for a sign of progress after an ERROR that may only answer a duplicate.
        recheck_s: The same after an ERROR when everything was sent. Longer than a vehicle takes to repeat a request.
        linger_s: How long a cancelled transfer repeats the cancellation.
    """

    resend_s: float = 0.1
    resend_shortest_s: float = 0.02
    resend_growth: float = 1.25
    resend_longest_s: float = 0.5
    items_ahead: int = 1
    stall_s: float = 6.0
    give_up_s: float = 15.0
    no_progress_s: float = 60.0
    busy_retry_s: float = 0.5
    busy_give_up_s: float = 15.0
    doubt_s: float = 2.5
    recheck_s: float = 0.8
    linger_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse times that would never end or never begin."""
        for name in (
            "resend_s", "resend_shortest_s", "stall_s", "give_up_s", "no_progress_s", "busy_retry_s", "busy_give_up_s",
            "doubt_s", "recheck_s", "linger_s",
        ):  # fmt: skip
            if not 0.0 < getattr(self, name) < math.inf:
                raise MisuseError(f"Timing.{name} is {getattr(self, name)}; it must be a positive number of seconds")
        if not (self.resend_growth >= 1.0 and self.resend_longest_s >= max(self.resend_s, self.resend_shortest_s)):
            raise MisuseError(
                "Timing: resend_growth must be at least 1, and resend_longest_s at least resend_s and resend_shortest_s"
            )
        if self.items_ahead < 0:
            raise MisuseError(f"Timing.items_ahead is {self.items_ahead}; it must be 0 or more")


@dataclass(frozen=True, slots=True)
class LongestTimes:
    """Bounds in seconds, reached only by a hostile vehicle.

    Attributes:
        stuck_s: From the last progress of a transfer to its end.
        download_s: ``Client.download``.
        upload_s: ``Client.upload``, with reading back what the vehicle holds when it fails.
        verified_upload_s: ``Client.upload_and_verify`` of a list within the known item limit.
        clear_s: ``Client.clear``, with reading back.
    """

    stuck_s: float
    download_s: float
    upload_s: float
    verified_upload_s: float
    clear_s: float


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
    """Allows ``per_s`` answers a second on average, and as many at once after a pause.

    Args:
        per_s: Answers a second.
    """

    def __init__(self, *, per_s: float) -> None:
        if not per_s >= 1.0:
            raise MisuseError(f"per_s is {per_s}; it must be 1 or more")
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
