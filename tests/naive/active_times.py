"""When a zone is in force, found by looking at every minute."""

from datetime import UTC, datetime, timedelta

_NAMES = ["MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN"]


def in_force_at(moment, *, interval=None, days=(), hours=None, offset_h=0.0):
    """Whether a period holds at a moment: ``interval`` of two times, days by name, ``hours`` in minutes."""
    if interval is not None and not interval[0] <= moment <= interval[1]:
        return False
    local = moment.astimezone(UTC).replace(tzinfo=None) + timedelta(hours=offset_h)
    begin, end = hours if hours is not None else (0, 1440)
    if end <= begin:
        end += 1440
    for back in (0, 1):
        day = datetime(local.year, local.month, local.day) - timedelta(days=back)
        minute = (local - day).total_seconds() / 60.0
        if begin <= minute <= end and (not days or _NAMES[day.weekday()] in days):
            return True
    return False


def in_force_in(window, **period):
    """Whether it holds at any minute of a window, ends included."""
    moment = window[0]
    while moment <= window[1]:
        if in_force_at(moment, **period):
            return True
        moment += timedelta(minutes=1)
    return False
