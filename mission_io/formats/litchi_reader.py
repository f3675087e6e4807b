"""CSV of Litchi's Mission Hub, metric, as a mission (litchiutilities.com/docs/litchiCsv.php)."""

import dataclasses

from mission_io.errors import FormatError
from mission_io.formats.dialects import header_of, sniff
from mission_io.formats.point_route import PointRoute, RouteStop, number_in, route_from_stops
from mission_io.formats.route_cameras import StopCamera
from mission_io.formats.text import clean_text
from mission_io.model.items import Command, Frame

_STAY_FOR, _TAKE_PHOTO, _ROTATE_AIRCRAFT, _TILT_CAMERA = 0.0, 1.0, 4.0, 5.0
"""Kinds of actions; the others, video among them, take no picture."""
_ACTIONS = 15
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
        raise FormatError("the header is not that of Litchi's Mission Hub", where="line 1")
    dialect = sniff(clean.text)
    (first, header), *rows = dialect.rows(clean.text)
    header = [name.lower() for name in header]
    if "altitude(m)" not in header and rows:
        raise FormatError("heights are not in metres", where=f"line {first}", advice="export it with metric units")
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
            raise FormatError(f"altitude mode {mode:g}", where=where, advice="it must be 0 (take-off) or 1 (ground)")
        speed = number_in(fields.get("speed(m/s)") or "0", f"{where}, speed")
        curves += number_in(fields.get("curvesize(m)") or "0", f"{where}, curvesize") > 0.0
        camera = _camera(fields, where)
        stops.append(RouteStop(lat, lon, alt, _FRAMES[int(mode)], speed if speed > 0.0 else None, camera))
        looks_at_poi += fields.get("gimbalmode", "").strip() == "1"
    if curves:
        repairs.append(f"{curves} corners are curved; they are taken as sharp")
    if looks_at_poi:
        repairs.append(f"{looks_at_poi} points look at a point of interest; their camera's angle is not known here")
    route = route_from_stops(stops, repairs=repairs)
    turns = sum(item.command == Command.CONDITION_YAW for item in route.mission.items)
    messages = (
        [f'{turns} headings differ from their legs; they are held, as Heading Mode "Custom (WD)" does'] if turns else []
    )
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
