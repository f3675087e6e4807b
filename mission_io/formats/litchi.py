"""CSV of Litchi's Mission Hub, metric: one row a waypoint (litchiutilities.com/docs/litchiCsv.php).

Litchi keeps settings of the whole mission outside of the file; set them after the import: Path Mode "Straight Lines" (with
curves, actions are not carried out and corners are cut), Heading Mode "Custom (WD)", Finish Action "Land" (the last waypoint
is straight above the landing).
"""

import dataclasses
import math
from collections.abc import Sequence

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import header_of, sniff
from mission_io.formats.point_route import (
    CameraFlight,
    CameraPoint,
    PointRoute,
    RouteStop,
    StopCamera,
    course_deg,
    route_from_stops,
)
from mission_io.formats.text import clean_text, degrees_text, number_in, plain_decimal
from mission_io.model.items import Command, Frame, earth_centred_m, ground_distance_m
from mission_io.model.plain_text import counted

MOST_WAYPOINTS = 99
"""Limit of DJI's mobile SDK; Litchi chains more of them only while it has a signal."""
_HEIGHTS_M = (-200.0, 500.0)
_PITCHES_DEG = (-90.0, 0.0)
_APART_M = (0.5, 2000.0)
_ACTIONS = 15
_NO_ACTION, _STAY_FOR, _TAKE_PHOTO, _ROTATE_AIRCRAFT, _TILT_CAMERA = -1, 0, 1, 4, 5
"""Kinds of actions; the others, video among them, take no photo."""
_COLUMNS = (
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *(f"action{what}{number}" for number in range(1, _ACTIONS + 1) for what in ("type", "param")),
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
)  # fmt: skip
HEADER = ",".join(_COLUMNS)


def write_csv(flight: CameraFlight) -> str:
    """Write a flight as CSV; heights are above the take-off.

    Raises:
        FormatError: Litchi cannot do it, with the point.
    """
    points = flight.points
    if not 2 <= len(points) <= MOST_WAYPOINTS:
        raise FormatError(
            f"the mission has {len(points)} points, but Litchi accepts 2 to {MOST_WAYPOINTS}",
            where="flight",
            advice="split the mission",
        )
    _check_distances(points)
    rows = [_row(number, points) for number in range(len(points))]
    return "\n".join([HEADER, *rows]) + "\n"


def _row(number: int, points: Sequence[CameraPoint]) -> str:
    point, where = points[number], f"point {number + 1}"
    before = points[number - 1].picture_distance_m if number else None
    begins = point.picture_distance_m is not None and point.picture_distance_m != before
    pictures = point.pictures + begins  # where pictures by distance begin, one is taken at once
    pitch_deg = 0.0 if point.pitch_deg is None else point.pitch_deg
    _check("m above home", point.height_above_home_m, _HEIGHTS_M, where)
    _check("degrees of camera pitch", pitch_deg, _PITCHES_DEG, where)
    _check("m/s", point.speed_m_s, (0.1, 15.0), where)
    if pictures > _ACTIONS:
        raise FormatError(f"a point has {pictures} photos, but the limit of Litchi is {_ACTIONS}", where=where)
    heading_deg = _course_deg(points, number) if point.heading_deg is None else point.heading_deg
    distance_m = -1.0 if point.picture_distance_m is None else point.picture_distance_m
    actions = [_TAKE_PHOTO] * pictures + [_NO_ACTION] * (_ACTIONS - pictures)
    numbers = (
        point.height_above_home_m, heading_deg, 0.0, 0, 0 if point.pitch_deg is None else 2, pitch_deg,
        *(value for action in actions for value in (action, 0)),
        0, point.speed_m_s, 0.0, 0.0, 0.0, 0, -1.0, distance_m,
    )  # fmt: skip
    place = (degrees_text(point.lat_deg, where), degrees_text(point.lon_deg, where))
    return ",".join((*place, *(plain_decimal(value, where) for value in numbers)))


def _check(what: str, value: float, limits: tuple[float, float], where: str) -> None:
    if not limits[0] <= value <= limits[1]:
        raise FormatError(f"{value:g} {what} is invalid; Litchi accepts {limits[0]:g} to {limits[1]:g}", where=where)


def _check_distances(points: Sequence[CameraPoint]) -> None:
    for number in range(1, len(points)):
        a, b = points[number - 1], points[number]
        apart_m = math.dist(
            earth_centred_m(a.lat_deg, a.lon_deg, a.height_above_home_m),
            earth_centred_m(b.lat_deg, b.lon_deg, b.height_above_home_m),
        )
        _check("m to the next point", apart_m, _APART_M, f"point {number}")


def _course_deg(points: Sequence[CameraPoint], number: int) -> float:
    """Direction of the leg that begins at a point, clockwise from north; a vertical leg keeps the one before."""
    for first in (*range(number, len(points) - 1), *range(number - 1, -1, -1)):
        a, b = points[first], points[first + 1]
        if ground_distance_m(a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg) > 0.1:
            return course_deg((a.lat_deg, b.lat_deg), (a.lon_deg, b.lon_deg)) or 0.0
    return 0.0


_FRAMES = {0: Frame.ABOVE_HOME, 1: Frame.ABOVE_TERRAIN}


def is_litchi(text: str) -> bool:
    """Whether a CSV text has the header of Litchi's Mission Hub, in any dialect."""
    names = [name.lower() for name in header_of(text)[:3]]
    return names[:2] == ["latitude", "longitude"] and len(names) == 3 and names[2].startswith("altitude(")


def read_route(text: str) -> PointRoute:
    """Read a mission of Litchi's Mission Hub.

    Heights are above take-off (altitude mode 0) or above the ground (1); curved corners become sharp, with a message.
    Litchi keeps what it does at the end outside of the file, so the mission ends above its last point.

    Raises:
        FormatError: another header, feet, or a value that is none, with its line.
    """
    clean = clean_text(text)
    if not is_litchi(clean.text):
        raise FormatError("the header differs from that of Litchi's Mission Hub", where="line 1")
    dialect = sniff(clean.text)
    (first, header), *rows = dialect.rows(clean.text)
    header = [name.lower() for name in header]
    if "altitude(m)" not in header and rows:
        raise FormatError("the heights are not in metres", where=f"line {first}", advice="export with metric units")
    repairs = [*clean.repairs, *dialect.repairs]
    stops, curves, looks_at_poi = [], 0, 0
    for line, cells in rows:
        fields = dict(zip(header, cells, strict=False))
        where = f"line {line}"
        lat, lon, alt = (
            number_in(fields.get(name), f"{where}, {name}") for name in ("latitude", "longitude", "altitude(m)")
        )
        mode = number_in(fields.get("altitudemode") or "0", f"{where}, altitudemode")
        if mode not in _FRAMES:
            raise FormatError(f"unknown altitude mode {mode:g}", where=where, advice="use 0 (take-off) or 1 (ground)")
        speed = number_in(fields.get("speed(m/s)") or "0", f"{where}, speed")
        curves += number_in(fields.get("curvesize(m)") or "0", f"{where}, curvesize") > 0.0
        camera = _camera(fields, where)
        stops.append(RouteStop(lat, lon, alt, _FRAMES[int(mode)], speed if speed > 0.0 else None, camera))
        looks_at_poi += fields.get("gimbalmode", "").strip() == "1"
    if curves:
        repairs.append(f"{counted(curves, 'curved corner was', 'curved corners were')} read as sharp")
    if looks_at_poi:
        points = counted(
            looks_at_poi, "point faces a point of interest, so its", "points face a point of interest, so their"
        )
        repairs.append(f"{points} camera angle is unknown")
    route = route_from_stops(stops, repairs=repairs)
    turns = sum(item.command == Command.CONDITION_YAW for item in route.mission.items)
    headings = counted(turns, "heading differs from its leg and was", "headings differ from their legs and were")
    messages = [f'{headings} kept, as with Heading Mode "Custom (WD)"'] if turns else []
    return dataclasses.replace(route, repairs=(*route.repairs, *messages))


def _camera(fields: dict[str, str], where: str) -> StopCamera:
    """Actions at a row, the gimbal's angle, and photos by distance or time from there on.

    Headings are those of Heading Mode "Custom (WD)"; in the others they are the legs' own.
    """

    def number(name: str, otherwise: str = "-1") -> float:
        return number_in(fields.get(name) or otherwise, f"{where}, {name}")

    pitch = number("gimbalpitchangle") if fields.get("gimbalmode", "").strip().startswith("2") else None
    heading: float | None = number("heading(deg)") if fields.get("heading(deg)") else None
    pictures, hover_s = 0, 0.0
    for k in range(1, _ACTIONS + 1):
        kind, value = number(f"actiontype{k}"), number(f"actionparam{k}", "0")
        if kind == _TAKE_PHOTO:
            pictures += 1
        elif kind == _STAY_FOR:
            hover_s += max(value, 0.0) / 1000.0
        elif kind == _ROTATE_AIRCRAFT:
            heading = value
        elif kind == _TILT_CAMERA:
            pitch = value
    distance, interval = number("photo_distinterval"), number("photo_timeinterval")
    return StopCamera(
        pitch_deg=pitch, heading_deg=heading, pictures=pictures, distance_m=distance if distance > 0.0 else None,
        interval_s=interval if interval > 0.0 else None, hover_s=hover_s,
    )  # fmt: skip
