"""Check a track's clocks: its date, and the receive times on the clock of the ground station.

A date counts only when it is plausible: not before the firmware that flew it, nor before the plan that was flown, not after
the file that holds it, and in agreement with the ground station. Receivers count weeks modulo 1,024; when the count starts anew
they report a date 1,024 weeks too early.

A vehicle's own time begins when it is switched on, so it says nothing about other vehicles. What all share is the clock on which
their positions arrived. A position may arrive late, and never early: near every sample, the one that was least late tells how the
two clocks stand to each other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.active_times import flown_window, window_in_words
from uavcover.model.track import Track
from uavcover.verification.firmware import Firmware
from uavcover.verification.tuning import CLOCK

ROLLOVER_S = 1024 * 604_800.0
FIRST_LOG_S = 1_420_070_400.0
"""2015: no firmware that writes the logs read here is older."""
BEFORE_PLAN_S, AFTER_FILE_S = 600.0, 86_400.0
"""Differences that clocks of computers have; files on memory cards have the local time."""


@dataclass(frozen=True, slots=True)
class DateBounds:
    """Between what a track's date lies, seconds since 1970; none where it is not known.

    Attributes:
        planned_s: when its plan was made.
        written_s: when its file was written.
        firmware: that flew it.
    """

    planned_s: float | None = None
    written_s: float | None = None
    firmware: Firmware | None = None


UNKNOWN_DATES = DateBounds()


def dated(track: Track, bounds: DateBounds) -> tuple[Track, tuple[str, ...]]:
    """The track without a date that is not plausible, and what is wrong with that."""
    window = flown_window(track.unix_time_s)
    if window is None:
        return track, ()
    wrong = [*_date_problems(track, bounds)]
    if not wrong:
        return track, ()
    text = f"the track's date, {window_in_words(window)}, is not plausible: {'; '.join(wrong)}"
    later_s = track.unix_time_s + ROLLOVER_S
    if (
        not [*_date_problems(replace(track, unix_time_s=later_s), bounds)]
        and (later := flown_window(later_s)) is not None
    ):
        text += (
            f"; 1,024 weeks later it is plausible ({window_in_words(later)}): the receiver's week number rolled over"
        )
    unknown = np.full(len(track), np.nan)
    return replace(track, unix_time_s=unknown), (
        f"{text}. No-fly zones with times are judged as if the time were unknown",
    )


def clocks_apart(track: Track) -> str | None:
    """Find where one of two clocks that run alike advances more than the other: the record lost or gained time."""
    known = np.isfinite(track.unix_time_s)
    own_s, apart_s = track.time_s[known], track.unix_time_s[known] - track.time_s[known]
    if not own_s.size or np.ptp(apart_s) <= CLOCK.clock_step_s:
        return None
    at_s = np.append(np.arange(own_s[0], own_s[-1], CLOCK.clocks_compared_s), own_s[-1])
    drift_s = np.diff(np.interp(at_s, own_s, apart_s))
    # A simulation that runs fast, or waits, drifts all the time.
    if np.median(np.abs(drift_s)) > CLOCK.alike_s and np.abs(np.diff(apart_s)).max() <= CLOCK.clock_step_s:
        return None
    worst = int(np.argmax(np.abs(drift_s)))
    further, other = ("satellites'", "vehicle's") if drift_s[worst] > 0.0 else ("vehicle's", "satellites'")
    return (
        f"from {at_s[worst]:.1f} s to {at_s[worst + 1]:.1f} s the {further} clock advances {abs(drift_s[worst]):.1f} "
        f"s more than the {other}: time was inserted or removed there"
    )


def _date_problems(track: Track, bounds: DateBounds) -> Iterator[str]:
    known = np.isfinite(track.unix_time_s)
    unix_s, own_s = track.unix_time_s[known], track.time_s[known]
    first_s, last_s = float(unix_s.min()), float(unix_s.max())
    jumps_s = np.diff(unix_s) - np.diff(own_s)
    if jumps_s.size and np.abs(jumps_s).max() > CLOCK.jump_s:
        at = int(np.argmax(np.abs(jumps_s)))
        yield f"its clock jumps by {jumps_s[at] / 3600.0:.1f} hours at {own_s[at + 1]:.1f} s"
    released_s = None if bounds.firmware is None else bounds.firmware.released_s
    if released_s is not None and first_s < released_s:
        yield f"its firmware, {bounds.firmware}, dates from {_day(released_s)[:7]}"
    elif first_s < FIRST_LOG_S:
        yield f"no firmware that writes such logs is older than {_day(FIRST_LOG_S)}"
    if bounds.planned_s is not None and first_s < bounds.planned_s - BEFORE_PLAN_S:
        yield f"its plan dates from {_day(bounds.planned_s)}"
    if bounds.written_s is not None and last_s > bounds.written_s + AFTER_FILE_S:
        yield f"its file dates from {_day(bounds.written_s)}"
    late_s = track.received_utc_s[known] - unix_s
    if np.isfinite(late_s).any() and abs(float(np.nanmedian(late_s))) > CLOCK.disagrees_s:
        yield f"the ground station received it on {_day(float(np.nanmedian(track.received_utc_s)))}"


def _day(unix_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M}"


@dataclass(frozen=True, slots=True, eq=False)
class SharedTimes:
    """The samples of a track on the shared clock.

    Attributes:
        taken_utc_s: (n,) when each sample was taken, not decreasing.
        pace: seconds of the shared clock in a second of vehicle time; below 1 for a simulation that runs fast.
    """

    taken_utc_s: FloatArray
    pace: float


def shared_times(track: Track) -> SharedTimes | None:
    """The samples of a track on the shared clock; none where times of arrival are missing, or go back."""
    received, own = track.received_utc_s, track.time_s
    if len(track) < 2 or not np.isfinite(received).all() or (np.diff(received) < 0.0).any():
        return None
    pace = float((received[-1] - received[0]) / (own[-1] - own[0]))
    if not pace > 0.0:
        return None
    late_s = received - pace * own
    first = np.searchsorted(own, own - CLOCK.window_s)
    last = np.searchsorted(own, own + CLOCK.window_s, side="right")
    least = np.array([late_s[a:b].min() for a, b in zip(first, last, strict=True)])
    return SharedTimes(np.maximum.accumulate(np.minimum(pace * own + least, received)), pace)
