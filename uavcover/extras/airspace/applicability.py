"""Times of zones in ED-269 (``applicability``) and ED-318 (``limitedApplicability``), as the periods of a scenario.

Both have a list of periods, each with a first and a last moment and a ``schedule`` of days and hours. What a schedule counts by
the sun or by holidays, and hours without a time zone, cannot be counted here: such a period holds all day.
"""

import re
from dataclasses import dataclass
from typing import Any

from mission_io.formats.json_node import Node
from uavcover.model.active_times import DAYS

_HOUR = re.compile(r"(\d{1,2}:\d{2}(?::\d{2}(?:\.\d+)?)?)(Z|[+-]\d{2}:\d{2})")
_YES = ("YES", "TRUE")
_EVERY_DAY = "ANY"


@dataclass(frozen=True, slots=True)
class Applicability:
    """When a zone is in force, by the keys of a scenario.

    Attributes:
        from_utc: its begin, none where it is open.
        until_utc: its end, none where it is open.
        active: its periods; empty: all the time between these two.
        whole_days: whether a schedule could not be read, and counts all day.
    """

    from_utc: str | None = None
    until_utc: str | None = None
    active: tuple[str, ...] = ()
    whole_days: bool = False


def read_applicability(about: Node, key: str) -> Applicability:
    """The times of a zone; without any it is always in force."""
    value = about.value.get(key) if isinstance(about.value, dict) else None
    tables = [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, dict)]
    if not tables:
        return Applicability()
    periods: list[str] = []
    whole_days = False
    for table in tables:
        interval, words = _interval(table), _schedule(table)
        if words is None:
            whole_days, words = True, [""]
        periods += [" ".join(part for part in (interval, word) if part) for word in words]
    if "" in periods:
        return Applicability(whole_days=whole_days)
    if len(periods) == 1 and "/" in periods[0] and " " not in periods[0]:
        begin, end = (None if part == ".." else part for part in periods[0].split("/", 1))
        return Applicability(begin, end, whole_days=whole_days)
    return Applicability(active=tuple(dict.fromkeys(periods)), whole_days=whole_days)


def _interval(table: dict[str, Any]) -> str:
    """First and last moment of a period; empty where it is permanent."""
    if str(table.get("permanent", "NO")).upper() in _YES:
        return ""
    ends = [str(table.get(key) or "..").strip() for key in ("startDateTime", "endDateTime")]
    return "" if ends == ["..", ".."] else "/".join(ends)


def _schedule(table: dict[str, Any]) -> list[str] | None:
    """Days and hours of a period, one text each; none where they cannot be read."""
    value = table.get("schedule")
    entries = value if isinstance(value, list) else [value] if value else []
    found = [_daily(entry) for entry in entries]
    if None in found:
        return None
    return [words for words in found if words is not None] or [""]


def _daily(entry: Any) -> str | None:
    """Days and hours of one entry; none where they cannot be read."""
    if not isinstance(entry, dict) or entry.get("startEvent") or entry.get("endEvent"):
        return None
    days = entry.get("day") or [_EVERY_DAY]
    names = [str(day).strip().upper()[:3] for day in (days if isinstance(days, list) else [days])]
    if not all(name in DAYS or name == _EVERY_DAY for name in names):
        return None
    words = [] if _EVERY_DAY in names else [",".join(dict.fromkeys(names))]
    times = [entry.get(key) for key in ("startTime", "endTime")]
    if times != [None, None]:
        begin, end = (_HOUR.fullmatch(str(time).strip()) for time in times)
        if begin is None or end is None or begin[2] != end[2]:
            return None
        words.append(f"{begin[1]}-{end[1]}{begin[2]}")
    return " ".join(words)
