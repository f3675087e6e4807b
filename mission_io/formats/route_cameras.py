"""Camera actions at the points of drone apps' routes, as items of a mission."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.model.actions import PointGimbal, StartPictures, StopPictures, TriggerEvery, Turn, item_of
from mission_io.model.items import MissionItem, delay


@dataclass(frozen=True, slots=True)
class StopCamera:
    """Actions at a point, and settings from there on."""

    pitch_deg: float | None = None  # of the camera from there on, -90 is straight down; None: as before
    heading_deg: float | None = None  # of the aircraft's nose on the leg after it; None: along the leg
    pictures: int = 0  # how many are taken there
    distance_m: float | None = None  # between pictures from there on; None: none by distance
    interval_s: float | None = None  # the same by time
    hover_s: float = 0.0  # how long it stays


NOTHING = StopCamera()


def items_at_stop(before: StopCamera, here: StopCamera, course_deg: float | None) -> list[MissionItem]:
    """The items behind a point's waypoint.

    Args:
        before: what the point before says.
        here: what this one says.
        course_deg: of the leg after it; None at the last point.
    """
    found = []
    if here.hover_s > 0.0:
        found.append(delay(here.hover_s))
    if here.pitch_deg is not None and here.pitch_deg != before.pitch_deg:
        found.append(item_of(PointGimbal(pitch_deg=here.pitch_deg)))
    if here.heading_deg is not None and course_deg is not None:
        off_deg = math.remainder(here.heading_deg - course_deg, 360.0)
        if abs(off_deg) > 1.0:
            found.append(item_of(Turn(heading_deg=here.heading_deg % 360.0)))
    found += [item_of(StartPictures(count=1))] * min(here.pictures, 1000)
    if here.distance_m != before.distance_m:
        found.append(item_of(TriggerEvery(distance_m=here.distance_m or 0.0)))
    if here.interval_s != before.interval_s:
        found.append(item_of(StopPictures() if here.interval_s is None else StartPictures(interval_s=here.interval_s)))
    return found


def course_deg(lat_deg: Sequence[float], lon_deg: Sequence[float]) -> float | None:
    """Direction from a first position to a second one, clockwise from north; None where they are the same.

    >>> round(course_deg((46.0, 46.0), (8.0, 8.001)) or 0.0, 3)
    90.0
    """
    if (lat_deg[0], lon_deg[0]) == (lat_deg[1], lon_deg[1]):
        return None
    a, b = map(math.radians, lat_deg)
    east = math.radians(math.remainder(lon_deg[1] - lon_deg[0], 360.0))
    x = math.sin(east) * math.cos(b)
    y = math.cos(a) * math.sin(b) - math.sin(a) * math.cos(b) * math.cos(east)
    return math.degrees(math.atan2(x, y)) % 360.0
