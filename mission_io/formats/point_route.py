"""Routes of points, from drone apps and map programs, made into missions: take-off, waypoints, and the end."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.parsers import expat

from mission_io.errors import FormatError
from mission_io.formats.text import check_place, clean_text
from mission_io.model.actions import PointGimbal, StartPictures, StopPictures, TriggerEvery, Turn, item_of
from mission_io.model.items import Frame, Mission, MissionItem, change_speed, delay, takeoff, waypoint

# Camera actions at the points of drone apps' routes, as items of a mission.


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


_LOWEST_M, _HIGHEST_M = -500.0, 20_000.0


@dataclass(frozen=True, slots=True)
class RouteStop:
    """A point of a route: degrees, metres above ``frame``'s reference, and the speed of the leg after it.

    ``camera`` is what is done there.
    """

    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: Frame
    speed_m_s: float | None = None
    camera: StopCamera = NOTHING


@dataclass(frozen=True, slots=True)
class PointRoute:
    """A route as a mission."""

    # item 1 is a take-off to the height of the first point, the points follow. It has no home: the files have none.
    mission: Mission
    numbers: tuple[int, ...]  # the number of the item of each point
    repairs: tuple[str, ...] = ()  # what was read otherwise than it stands there, one line each
    # above home, at which the aircraft returns by itself; None where the file does not say
    return_height_m: float | None = None
    speed_m_s: float | None = None  # of all of it; None where the file states none, or several, which are then items


def route_from_stops(
    stops: Sequence[RouteStop], *, end: Sequence[MissionItem] = (), repairs: Sequence[str] = (),
    return_height_m: float | None = None, takeoff_height_m: float | None = None,
) -> PointRoute:  # fmt: skip
    """Make a mission of points.

    Args:
        stops: The points, in order.
        end: Items after the last one, such as a return.
        repairs: For the result.
        return_height_m: For the result.
        takeoff_height_m: Above home, to which it climbs first; None: to the height of the first point.

    Raises:
        FormatError: no point, or one that is no place, or a height that is none.
    """
    if not stops:
        raise FormatError("the route has no points", where="route", advice="use a route with at least one point")
    for number, stop in enumerate(stops, start=1):
        check_place(stop.lat_deg, stop.lon_deg, f"point {number}")
        if not _LOWEST_M <= stop.alt_m <= _HIGHEST_M:
            raise FormatError(
                f"the height is {stop.alt_m:g} m", where=f"point {number}", advice="use a finite height in metres"
            )
    first = stops[0]
    top_m, frame = first.alt_m, first.frame
    if takeoff_height_m is not None and frame is Frame.ABOVE_HOME:
        top_m = max(top_m, takeoff_height_m)
    items = [takeoff(first.lat_deg, first.lon_deg, top_m, frame=frame)]
    numbers = []
    speeds = {stop.speed_m_s for stop in stops if stop.speed_m_s is not None and stop.speed_m_s > 0.0}
    speed_m_s = next(iter(speeds)) if len(speeds) == 1 else None
    before = NOTHING
    for number, stop in enumerate(stops):
        items.append(waypoint(stop.lat_deg, stop.lon_deg, stop.alt_m, frame=stop.frame))
        numbers.append(len(items))
        after = stops[number + 1] if number + 1 < len(stops) else None
        way = None if after is None else course_deg((stop.lat_deg, after.lat_deg), (stop.lon_deg, after.lon_deg))
        items += items_at_stop(before, stop.camera, way)
        pitch_deg = before.pitch_deg if stop.camera.pitch_deg is None else stop.camera.pitch_deg
        before = dataclasses.replace(stop.camera, pitch_deg=pitch_deg)
        if len(speeds) > 1 and stop.speed_m_s in speeds and stop.speed_m_s != speed_m_s:
            speed_m_s = float(stop.speed_m_s or 0.0)
            items.append(change_speed(speed_m_s))
    return PointRoute(
        Mission(None, (*items, *end)),
        tuple(numbers),
        tuple(repairs),
        return_height_m,
        speed_m_s if len(speeds) == 1 else None,
    )


def xml_root(text: str) -> tuple[ElementTree.Element, tuple[str, ...]]:
    """The root of an XML document, and repairs of its text.

    Raises:
        FormatError: invalid XML, or a document type, whose entities let a small file expand to gigabytes.
    """
    clean = clean_text(text)

    def refuse(*_: object) -> None:
        raise FormatError("the file has a document type (DOCTYPE)", where="XML", advice="remove it")

    parser = expat.ParserCreate("utf-8")
    parser.StartDoctypeDeclHandler = refuse
    try:
        data = clean.text.encode("utf-8")
        parser.Parse(data, True)
        return ElementTree.fromstring(data), clean.repairs
    except UnicodeEncodeError:
        raise FormatError(
            "the text contains an incomplete character (a lone surrogate)",
            where="text",
            advice="save the file as UTF-8",
        ) from None
    except expat.ExpatError as error:
        raise FormatError(f"invalid XML: {expat.errors.messages[error.code]}", where=f"line {error.lineno}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"invalid XML: {error}", where="XML") from None


def local_name(element: ElementTree.Element) -> str:
    """The name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


def child_text(element: ElementTree.Element, name: str) -> str | None:
    """The text of the first child of a name, in any namespace; None where there is none."""
    text = element.findtext(f"{{*}}{name}")
    return None if text is None else text.strip()


def number_in(text: str | None, where: str) -> float:
    """A finite number of a document. Raises FormatError: it is missing or no number."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"expected a number, not {(text or 'nothing')[:40]!r}", where=where)
    return value
