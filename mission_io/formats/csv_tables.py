"""Tables as text, with the separators and decimals of other programs; missions as CSV: ours, and Litchi's.

All readers of tables and lines of numbers use this module, so that they accept the same dialects, and errors name the dialect.
"""

import csv
import dataclasses
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Final

from mission_io.errors import FormatError
from mission_io.formats.point_route import (
    CameraFlight,
    CameraPoint,
    PointRoute,
    RouteStop,
    StopCamera,
    course_deg,
    route_from_stops,
)
from mission_io.formats.text import (
    MissionFile,
    check_position,
    clean_text,
    degrees_text,
    finite_number,
    number_in,
    plain_decimal,
)
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem, earth_centred_m, ground_distance_m
from mission_io.model.plain_text import counted

_NAMES: Final = MappingProxyType({",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"})
_DECIMAL_COMMA: Final = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?", re.ASCII)
_DECIMAL_POINT: Final = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?", re.ASCII)
_SPREADSHEET: Final = re.compile(r"sep=(.)\s*", re.IGNORECASE)
"""A first line that states the separator for spreadsheets."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """Notation of a table."""

    separator: str = ","  # between columns
    decimal: str = "."  # between the whole and the rest of a number
    first_line: int = 1  # of the header, from 1

    def __str__(self) -> str:
        decimals = "decimal commas" if self.decimal == "," else "decimal points"
        return f"columns separated by {_NAMES[self.separator]}, {decimals}"

    @property
    def repairs(self) -> tuple[str, ...]:
        """Unusual features of it, one line each."""
        return () if (self.separator, self.decimal) == (",", ".") else (f"line {self.first_line}: read as {self}",)

    def rows(self, text: str) -> Iterator[tuple[int, list[str]]]:
        """The rows with their lines, the header first: cells without space around, decimals with points; empty rows omitted.

        Raises:
            FormatError: quotes that do not match, or a row with more cells than the header.
        """
        reader = csv.reader(
            text.split("\n")[self.first_line - 1 :], delimiter=self.separator, skipinitialspace=True, strict=True
        )
        columns = 0
        try:
            for cells in reader:
                line = reader.line_num + self.first_line - 1
                cells = [cell.strip() for cell in cells]
                if not any(cells):
                    continue
                columns = columns or len(cells)
                if any(cells[columns:]):
                    raise self._too_many(len(cells), columns, line)
                if self.decimal == ",":
                    cells = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]
                yield line, cells
        except csv.Error as error:
            raise FormatError(f"invalid CSV: {error}", where=f"line {reader.line_num + self.first_line - 1}") from None

    def _too_many(self, count: int, columns: int, line: int) -> FormatError:
        advice = "save the table again as CSV"
        if self.separator == ",":
            advice = "if it also has decimal commas, save it with decimal points, or with semicolons between columns"
        return FormatError(f"{count} cells, but the header has {columns} ({self})", where=f"line {line}", advice=advice)


def sniff(text: str) -> Dialect:
    """The dialect of a table whose first row names the columns.

    Raises:
        FormatError: decimals are written with commas in one row and with points in another.
    """
    lines = text.split("\n")
    separator_row = _SPREADSHEET.fullmatch(lines[0].rstrip("\r\n"))
    first = 1 if separator_row else 0
    header = next((line for line in lines[first:] if line.strip()), "")
    counts = {each: _cells(header, each) for each in _NAMES}
    separator = max(_NAMES, key=lambda each: counts[each])
    if separator_row and separator_row[1] in _NAMES:
        separator = separator_row[1]
    plain = Dialect(separator, ".", first + 1)
    with_comma = with_point = 0
    for number, (line, cells) in enumerate(plain.rows(text)):
        if number > 200:  # rows that show how decimals are written
            break
        with_comma = with_comma or (line if any(map(_DECIMAL_COMMA.fullmatch, cells)) else 0)
        with_point = with_point or (line if any(map(_DECIMAL_POINT.fullmatch, cells)) else 0)
    if with_comma and with_point:
        raise FormatError(
            f"the file has both decimal commas (line {with_comma}) and decimal points (line {with_point}), with "
            f"columns separated by {_NAMES[separator]}",
            where=f"line {max(with_comma, with_point)}", advice="save it with decimal points only",
        )  # fmt: skip
    return Dialect(separator, "," if with_comma else ".", first + 1)


def header_of(text: str) -> list[str]:
    """The names of a table's columns, independent of its other rows; empty for text that is no table."""
    lines = [line for line in text.lstrip("\ufeff\r\n ").splitlines() if line.strip()][:2]
    if lines and not _SPREADSHEET.fullmatch(lines[0]):
        lines = lines[:1]
    try:
        return next(sniff("\n".join(lines)).rows("\n".join(lines)), (0, []))[1]
    except FormatError:
        return []


def _cells(line: str, separator: str) -> int:
    try:
        return len(next(csv.reader([line], delimiter=separator, skipinitialspace=True), []))
    except csv.Error:
        return 0


@dataclass(frozen=True, slots=True)
class Words:
    """The words of a line of numbers."""

    words: tuple[str, ...]  # without quotes, decimals with points
    changed: str = ""  # what was unusual, for a list of repairs; empty where nothing was
    has_other_separators: bool = False  # whether that is the separators


_SPLITS: Final = (
    ("\t", re.compile(r"\t")),
    (";", re.compile(";")),
    (" ", re.compile(r"[,;]?\s+")),
    (",", re.compile(",")),
)
_ANY: Final = re.compile(r"[\s,;]+")


def words_of(line: str, count: int, *, usual: str = " ") -> Words:
    """A line of ``count`` numbers or words: separated by tabs, semicolons, spaces or commas, with decimal points or commas.

    Args:
        line: the line.
        count: words that it has.
        usual: separator of the format, a space or a tab.

    Raises:
        FormatError: it has another number of words in every dialect.
    """
    content = line.strip().replace('"', "")
    for _, pattern in _SPLITS:
        parts = [part.strip() for part in pattern.split(content)]
        if len(parts) != count or not all(parts):
            continue
        with_comma, with_point = (any(map(each.fullmatch, parts)) for each in (_DECIMAL_COMMA, _DECIMAL_POINT))
        if with_comma and with_point:
            break
        if with_comma:
            return Words(tuple(part.replace(",", ".") for part in parts), "decimal commas were read as decimal points")
        is_usual = content == line.strip() and (content.split() if usual == " " else content.split(usual)) == parts
        return Words(tuple(parts)) if is_usual else _with_other_separators(parts)
    parts = _ANY.split(content)
    if len(parts) == count and all(parts):
        return _with_other_separators(parts)
    advice = ""
    if "," in content and len(parts) > count:
        advice = "if it has decimal commas, use decimal points, or put spaces or semicolons between the numbers"
    raise FormatError(f"expected {count} columns, not {len(parts)}", where="", advice=advice)


def _with_other_separators(parts: Sequence[str]) -> Words:
    return Words(tuple(parts), "changed the separators", has_other_separators=True)


# A mission as CSV: every item, one row each, with units in the column names.

HEADER = "item,command,frame,param1,param2,param3,param4,lat_deg,lon_deg,alt_m,alt_datum,autocontinue"
_COLUMNS = tuple(HEADER.split(","))


def write_csv(mission: Mission) -> str:
    """Write all items, numbered from 1, with home as row 0 when known; numbers are unrounded, missing values empty.

    ``alt_datum`` says what ``alt_m`` is measured from: AMSL, ABOVE_HOME, ABOVE_TERRAIN, or COMMAND for none.
    """
    lines = [HEADER]
    if mission.home is not None:
        home = mission.home
        position = ",".join(_text(value) for value in (home.lat_deg, home.lon_deg, home.alt_amsl_m))
        lines.append(f"0,16,0,0.0,0.0,0.0,0.0,{position},AMSL,1")
    for number, item in enumerate(mission.items, start=1):
        values = ",".join(_text(value) for _, value in item.values())
        lines.append(
            f"{number},{int(item.command)},{int(item.frame)},{values},{item.frame.name},{int(item.autocontinue)}"
        )
    return "\n".join(lines) + "\n"


def read_csv(text: str) -> MissionFile:
    """Read what ``write_csv`` writes; columns may be in any order, and unknown ones are dropped and listed.

    Raises:
        FormatError: with line and column, for a missing value, an invalid number or position, or a wrong order.
    """
    clean = clean_text(text)
    dialect = sniff(clean.text)
    repairs = [*clean.repairs, *dialect.repairs]
    rows = dialect.rows(clean.text)
    first, header = next(rows, (1, []))
    for name in _COLUMNS:
        if header.count(name) != 1:
            what = f"{header.count(name)} columns are named {name}, but there must be one"
            raise FormatError(what, where=f"line {first}", advice=f"the file was read as {dialect}")
    left_out = [name for name in header if name not in _COLUMNS]
    if left_out:
        repairs.append(f"line {first}: ignored {len(left_out)} columns, the first of which is {left_out[0][:30]!r}")
    home: GeoPoint | None = None
    items: list[MissionItem] = []
    for line, cells in rows:
        where = f"line {line}"
        if len(cells) < len(header):
            raise FormatError(f"the row has {len(cells)} columns, but the header has {len(header)}", where=where)
        row = dict(zip(header, cells, strict=False))
        number, item = _whole(row, "item", where), _item(row, where)
        if number == 0 and home is None and not items:
            home = GeoPoint(item.lat_deg, item.lon_deg, item.alt_m)
            continue
        items.append(item)
        if number != len(items):
            repairs.append(f"{where}: renumbered from {number} to {len(items)}")
    return MissionFile(Mission(home, tuple(items)), repairs=tuple(repairs))


def _item(row: Mapping[str, str], where: str) -> MissionItem:
    try:
        frame = Frame[row["alt_datum"].strip()]
    except KeyError:
        what = f"{row['alt_datum'][:20]!r} is not a supported datum"
        raise FormatError(what, where=f"{where}, alt_datum", advice=f"use {', '.join(Frame.__members__)}") from None
    if _whole(row, "frame", where) != frame:
        raise FormatError(f"frame {row['frame']} is not {frame.name}", where=where, advice=f"use {int(frame)}")
    command = _whole(row, "command", where)
    if not 0 <= command <= 65535:
        raise FormatError(f"the command must be between 0 and 65535, not {command}", where=where)
    texts = {name: row[name].strip() for name in _COLUMNS[3:10]}
    p1, p2, p3, p4, lat, lon, alt = (
        finite_number(text, f"{where}, {name}") if text else math.nan for name, text in texts.items()
    )
    if frame is not Frame.COMMAND:
        check_position(lat, lon, where)
    autocontinue = row["autocontinue"].strip()
    if autocontinue not in ("0", "1"):
        raise FormatError(f"must be 0 or 1, not {autocontinue[:20]!r}", where=f"{where}, autocontinue")
    return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, autocontinue == "1")


def _whole(row: Mapping[str, str], name: str, where: str) -> int:
    value = finite_number(row[name].strip(), f"{where}, {name}")
    if not value.is_integer():
        raise FormatError(f"{row[name][:20]!r} is not a whole number", where=f"{where}, {name}")
    return int(value)


def _text(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))


# Litchi's Mission Hub, metric: one row a waypoint (litchiutilities.com/docs/litchiCsv.php). Litchi keeps settings of the whole
# mission outside of the file; set them after the import: Path Mode "Straight Lines" (with curves, actions are not carried out
# and corners are cut), Heading Mode "Custom (WD)", Finish Action "Land" (the last waypoint is straight above the landing).

LITCHI_WAYPOINTS = 99
"""Limit of DJI's mobile SDK; Litchi chains more of them only while it has a signal."""
_HEIGHTS_M = (-200.0, 500.0)
_PITCHES_DEG = (-90.0, 0.0)
_APART_M = (0.5, 2000.0)
_ACTIONS = 15
_NO_ACTION, _STAY_FOR, _TAKE_PHOTO, _ROTATE_AIRCRAFT, _TILT_CAMERA = -1, 0, 1, 4, 5
"""Kinds of actions; the others, video among them, take no photo."""
_LITCHI_COLUMNS = (
    "latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode",
    "gimbalpitchangle",
    *(f"action{what}{number}" for number in range(1, _ACTIONS + 1) for what in ("type", "param")),
    "altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode",
    "photo_timeinterval", "photo_distinterval",
)  # fmt: skip


def write_litchi(flight: CameraFlight) -> str:
    """Write a flight as CSV; heights are above the take-off.

    Raises:
        FormatError: Litchi cannot do it, with the point.
    """
    points = flight.points
    if not 2 <= len(points) <= LITCHI_WAYPOINTS:
        raise FormatError(
            f"the mission has {len(points)} points, but Litchi accepts 2 to {LITCHI_WAYPOINTS}",
            where="flight",
            advice="split the mission",
        )
    for number, (a, b) in enumerate(pairwise(points), start=1):
        positions_m = (earth_centred_m(each.lat_deg, each.lon_deg, each.height_above_home_m) for each in (a, b))
        _check("m to the next point", math.dist(*positions_m), _APART_M, f"point {number}")
    rows = [_row(number, points) for number in range(len(points))]
    return "\n".join([",".join(_LITCHI_COLUMNS), *rows]) + "\n"


def _row(number: int, points: Sequence[CameraPoint]) -> str:
    point, where = points[number], f"point {number + 1}"
    before = points[number - 1].photo_distance_m if number else None
    begins = point.photo_distance_m is not None and point.photo_distance_m != before
    photos = point.photos + begins  # where photos by distance begin, one is taken at once
    pitch_deg = 0.0 if point.pitch_deg is None else point.pitch_deg
    _check("m above home", point.height_above_home_m, _HEIGHTS_M, where)
    _check("degrees of camera pitch", pitch_deg, _PITCHES_DEG, where)
    _check("m/s", point.speed_m_s, (0.1, 15.0), where)
    if photos > _ACTIONS:
        raise FormatError(f"a point has {photos} photos, but the limit of Litchi is {_ACTIONS}", where=where)
    heading_deg = _course_deg(points, number) if point.heading_deg is None else point.heading_deg
    distance_m = -1.0 if point.photo_distance_m is None else point.photo_distance_m
    actions = [_TAKE_PHOTO] * photos + [_NO_ACTION] * (_ACTIONS - photos)
    numbers = (
        point.height_above_home_m, heading_deg, 0.0, 0, 0 if point.pitch_deg is None else 2, pitch_deg,
        *(value for action in actions for value in (action, 0)),
        0, point.speed_m_s, 0.0, 0.0, 0.0, 0, -1.0, distance_m,
    )  # fmt: skip
    position = (degrees_text(point.lat_deg, where), degrees_text(point.lon_deg, where))
    return ",".join((*position, *(plain_decimal(value, where) for value in numbers)))


def _check(what: str, value: float, limits: tuple[float, float], where: str) -> None:
    if not limits[0] <= value <= limits[1]:
        raise FormatError(f"{value:g} {what} is invalid; Litchi accepts {limits[0]:g} to {limits[1]:g}", where=where)


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


def read_litchi(text: str) -> PointRoute:
    """Read a mission of Litchi's Mission Hub.

    Heights are above take-off (altitude mode 0) or above the ground (1); curved corners become sharp, with a message. The file
    does not contain Litchi's action at the end, so the mission ends above its last point.

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
    """Actions at a row, the gimbal's angle, and distance or time triggers from there on.

    Headings are those of Heading Mode "Custom (WD)"; in the other modes they are those of the legs.
    """

    def number(name: str, otherwise: str = "-1") -> float:
        return number_in(fields.get(name) or otherwise, f"{where}, {name}")

    pitch = number("gimbalpitchangle") if fields.get("gimbalmode", "").strip().startswith("2") else None
    heading: float | None = number("heading(deg)") if fields.get("heading(deg)") else None
    photos, hover_s = 0, 0.0
    for k in range(1, _ACTIONS + 1):
        kind, value = number(f"actiontype{k}"), number(f"actionparam{k}", "0")
        if kind == _TAKE_PHOTO:
            photos += 1
        elif kind == _STAY_FOR:
            hover_s += max(value, 0.0) / 1000.0
        elif kind == _ROTATE_AIRCRAFT:
            heading = value
        elif kind == _TILT_CAMERA:
            pitch = value
    distance, interval = number("photo_distinterval"), number("photo_timeinterval")
    return StopCamera(
        pitch_deg=pitch, heading_deg=heading, photos=photos, distance_m=distance if distance > 0.0 else None,
        interval_s=interval if interval > 0.0 else None, hover_s=hover_s,
    )  # fmt: skip
