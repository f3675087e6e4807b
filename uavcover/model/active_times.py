"""Moments, and times that come again: when a no-fly zone is in force."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta, timezone, tzinfo

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.value_checks import require

Window = tuple[datetime, datetime]
"""First and last moment, in UTC."""

DAYS = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")

_EXAMPLE = '"MON-FRI 08:00-17:00Z" or "2026-06-01T06:00Z/2026-06-03T18:00Z"'
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:\.\d+)?)?"
_HOURS = re.compile(rf"{_CLOCK}-{_CLOCK}(Z|[+-]\d{{2}}:\d{{2}})")
_A_DAY = timedelta(days=1)
_FIRST_YEAR, _LAST_YEAR = 1970, 2999
_FIRST_FLIGHT_S, _LAST_FLIGHT_S = 946_684_800.0, 32_472_144_000.0
"""The years 2000 and 2999."""


def utc_time(text: str, key: str) -> datetime:
    """A time of ISO 8601 with its zone, in UTC. Raises ValueError: it is not one; the message begins with the key."""
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        moment = None
    require(
        moment is not None and moment.tzinfo is not None,
        f"{key}: {text!r} is not a valid time; write it as 2026-06-01T06:00Z",
    )
    assert moment is not None
    try:
        return moment.astimezone(UTC)
    except OverflowError:
        raise ValueError(f"{key}: {text!r} is not a valid time; write it as 2026-06-01T06:00Z") from None


def is_flight_time(unix_s: float) -> bool:
    """Whether seconds since 1970 can be the time of a flight. Receivers without a fix send 0, or the time since start."""
    return _FIRST_FLIGHT_S <= unix_s < _LAST_FLIGHT_S


def flown_window(unix_time_s: FloatArray) -> Window | None:
    """First and last of the known times since 1970 of a track; none where none is known."""
    known = unix_time_s[np.isfinite(unix_time_s)]
    return None if known.size == 0 else (_moment(float(known.min())), _moment(float(known.max())))


def _moment(unix_s: float) -> datetime:
    return datetime.fromtimestamp(unix_s, UTC)


def window_in_words(window: Window) -> str:
    """Both ends, to the minute; the day of the last only where it is another one."""
    begin, end = window
    last = f"{end:%H:%M}" if begin.date() == end.date() else f"{end:%Y-%m-%d %H:%M}"
    return f"{begin:%Y-%m-%d %H:%M} to {last} UTC"


def window_of(begin: str, end: str, key: str) -> Window:
    """The time between two times.

    Raises:
        ValueError: one is not a time, or of no year of flight, or they are in the wrong order; the message begins with the key.
    """
    first, last = utc_time(begin, key), utc_time(end, key)
    for moment, text in ((first, begin), (last, end)):
        require(_FIRST_YEAR <= moment.year <= _LAST_YEAR, f"{key}: {text!r} is not a valid flight time")
    require(first < last, f"{key}: the latest landing must be after the earliest take-off")
    return first, last


@dataclass(frozen=True, slots=True)
class ActivePeriod:
    """A stretch of time, or the part of it on some days of the week and some hours of the day."""

    begin_utc: datetime | None = None  # its first moment; none: it has always begun
    end_utc: datetime | None = None  # its last moment; none: it does not end
    days: frozenset[int] = frozenset()  # numbers of the weekdays on which it begins, Monday is 0; empty: every day
    hours: tuple[time, timedelta] | None = None  # when it begins on such a day and how long it lasts; none: all day
    zone: tzinfo = UTC  # where these days and hours are counted

    def meets(self, window: Window) -> bool:
        """Whether any moment of it lies in a window, ends included."""
        begin = window[0] if self.begin_utc is None else max(window[0], self.begin_utc)
        end = window[1] if self.end_utc is None else min(window[1], self.end_utc)
        if begin > end:
            return False
        if not self.days and self.hours is None:
            return True
        first, lasts = self.hours or (time(), _A_DAY)
        # From the day before: hours may go on over midnight.
        day = begin.astimezone(self.zone).date() - _A_DAY
        for _ in range(10):  # days of a window that are examined: every day of the week is among them
            opens = datetime.combine(day, first, tzinfo=self.zone)
            if opens > end:
                return False
            if (not self.days or day.weekday() in self.days) and opens + lasts >= begin:
                return True
            day += _A_DAY
        return False


def active_period(text: str, key: str) -> ActivePeriod:
    """Read a period from text.

    It has an ISO 8601 interval, days of the week and hours, each at most once.

    An open end of an interval is ``..``. Days are MON to SUN, as a list or a range; hours have a zone, ``Z`` or ``+02:00``,
    and may go on over midnight, on the day after. Days without hours are days of UTC.

    Raises:
        ValueError: it is not one; the message begins with the key.
    """
    interval: tuple[datetime | None, datetime | None] | None = None
    days: frozenset[int] | None = None
    hours: tuple[tuple[time, timedelta], tzinfo] | None = None
    words = text.split()
    wrong = f"{key}: {text[:60]!r} is not a valid period; write, for example, {_EXAMPLE}"
    require(bool(words), wrong)
    for word in words:
        if "/" in word:
            require(interval is None, wrong)
            interval = _interval(word, key)
        elif (match := _HOURS.fullmatch(word)) is not None:
            require(hours is None, wrong)
            hours = _hours(match, wrong)
        else:
            found = _days(word.upper())
            require(days is None and bool(found), wrong)
            days = found
    begin, end = interval or (None, None)
    return ActivePeriod(begin, end, days or frozenset(), *(hours or (None, UTC)))


def _interval(word: str, key: str) -> tuple[datetime | None, datetime | None]:
    first, _, last = word.partition("/")
    begin, end = (None if part == ".." else utc_time(part, key) for part in (first, last))
    require(begin is None or end is None or begin < end, f"{key}: {word[:60]!r} ends before it begins")
    return begin, end


def _hours(match: re.Match[str], wrong: str) -> tuple[tuple[time, timedelta], tzinfo]:
    seconds = []
    for hour, minute, second in (match.group(1, 2, 3), match.group(4, 5, 6)):
        total = int(hour) * 3600 + int(minute) * 60 + int(second or 0)
        require(int(minute) < 60 and int(second or 0) < 60 and total <= 86400, wrong)
        seconds.append(total)
    begin, end = seconds
    require(begin < 86400, wrong)
    lasts = timedelta(seconds=(end - begin) % 86400 or 86400)
    return ((datetime.min + timedelta(seconds=begin)).time(), lasts), _zone(match[7], wrong)


def _zone(text: str, wrong: str) -> tzinfo:
    if text == "Z":
        return UTC
    offset = timedelta(hours=int(text[1:3]), minutes=int(text[4:6]))
    require(offset < _A_DAY and int(text[4:6]) < 60, wrong)
    return timezone(-offset if text[0] == "-" else offset)


def _days(word: str) -> frozenset[int]:
    """Numbers of weekdays; empty where the word is not one of days."""
    found: set[int] = set()
    for part in word.split(","):
        first, dash, last = part.partition("-")
        last = last if dash else first
        if first not in DAYS or last not in DAYS:
            return frozenset()
        begin, end = DAYS.index(first), DAYS.index(last)
        found |= {(begin + k) % 7 for k in range((end - begin) % 7 + 1)}
    return frozenset(found)
