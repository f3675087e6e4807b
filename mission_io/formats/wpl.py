"""``.waypoints`` files (QGC WPL): written so that every known reader takes them, read as generously as is safe.

One item per line, twelve columns: number, current, frame, command, four parameters, latitude, longitude, height,
autocontinue. In version 110 the first row is home. Fences and rally points are files of the same kind.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.areas import Fence, RallyPoints, fence_from_items, items_from_fence, items_from_rally, rally_from_items
from mission_io.autopilots import home_item
from mission_io.errors import FormatError
from mission_io.formats.numbers import degrees_text, plain_decimal
from mission_io.items import Command, Frame, GeoPoint, Mission, MissionItem

_HEADER = "QGC WPL 110"
_YAW_IS_FREE = frozenset({Command.NAV_WAYPOINT, Command.NAV_TAKEOFF, Command.NAV_LAND})


@dataclass(frozen=True, slots=True)
class WplFile:
    """What a ``.waypoints`` file holds.

    Attributes:
        version: 110 (the first row is home) or 120 (it is not).
        home: The first row of a version 110 file; None in a version 120 file and when there are no rows.
        items: The other rows.
        repairs: What had to be repaired to read it, one line each; empty for a file in strict form.
    """

    version: int
    home: GeoPoint | None
    items: tuple[MissionItem, ...]
    repairs: tuple[str, ...]

    def mission(self) -> Mission:
        """The file as a mission."""
        return Mission(self.home, self.items)

    def fence(self) -> Fence:
        """The file as a fence.

        Raises:
            FormatError: rows that are no fence.
        """
        return fence_from_items(self.items)

    def rally(self) -> RallyPoints:
        """The file as rally points.

        Raises:
            FormatError: rows that are no rally points.
        """
        return rally_from_items(self.items)


def write_mission(mission: Mission) -> str:
    """A mission as text.

    Parameter 4 of a waypoint, take-off or landing that is NaN ("any heading") is written as 0, which is what the
    readers of this format write for it; every other NaN is an error.

    Raises:
        FormatError: no home (the format needs it), or a number that the format cannot hold; with the row.
    """
    if mission.home is None:
        raise FormatError("the mission has no home", where="row 0", advice="give the place it starts from")
    return _write(mission.home, mission.items)


def write_fence(fence: Fence, home: GeoPoint) -> str:
    """A fence as text, with home in the first row like every file of this format; errors as ``write_mission``."""
    return _write(home, items_from_fence(fence))


def write_rally(rally: RallyPoints, home: GeoPoint) -> str:
    """Rally points as text, with home in the first row; errors as ``write_mission``."""
    return _write(home, items_from_rally(rally))


def _write(home: GeoPoint, items: Sequence[MissionItem]) -> str:
    rows = [home_item(home), *items]
    lines = [_HEADER, *(_row_text(number, item) for number, item in enumerate(rows))]
    return "\n".join(lines) + "\n"


def _row_text(number: int, item: MissionItem) -> str:
    where = f"row {number}"
    columns = [str(number), "1" if number == 0 else "0", str(int(item.frame)), str(int(item.command))]
    for index, value in enumerate(item.params, start=1):
        free = index == 4 and item.command in _YAW_IS_FREE and math.isnan(value)
        columns.append("0" if free else plain_decimal(value, f"{where}, param{index}"))
    if item.has_position:
        columns += [degrees_text(item.lat_deg, f"{where}, latitude"), degrees_text(item.lon_deg, f"{where}, longitude")]
    else:
        columns += [plain_decimal(item.lat_deg, f"{where}, param5"), plain_decimal(item.lon_deg, f"{where}, param6")]
    columns += [plain_decimal(item.alt_m, f"{where}, altitude"), "1" if item.autocontinue else "0"]
    return "\t".join(columns)


_HEADER_PATTERN = re.compile(r"QGC[ \t]+WPL[ \t]+(\d{1,9})")
_SEPARATORS = re.compile(r"[ \t,;]+")
_COLUMNS = 12
_LONGEST_NUMBER = 400  # the smallest double has 341 characters without an exponent


def read(text: str) -> WplFile:
    """Read a ``.waypoints`` file, version 110 or 120.

    Repaired, and listed: other line ends than LF, a byte order mark, comments and empty lines, spaces or commas for
    tabs, whole numbers written with decimals, the frames of MISSION_ITEM_INT, numbers that do not count up by one.

    Raises:
        FormatError: with the line, for anything that would have to be guessed.
    """
    repairs: list[str] = []
    if text.startswith("\ufeff"):
        repairs.append("removed a byte order mark")
        text = text[1:]
    if "\r" in text:
        repairs.append("changed the line ends to LF")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    version: int | None = None
    items: list[MissionItem] = []
    lines = text.split("\n")
    for line_number, line in enumerate(lines, start=1):
        content = line.split("#", 1)[0].strip()
        if "#" in line:
            repairs.append(f"line {line_number}: skipped a comment")
        elif not content and line_number < len(lines):
            repairs.append(f"line {line_number}: skipped an empty line")
        if not content:
            continue
        if version is None:
            version = _version(content, line_number)
        else:
            items.append(_item(line, content, line_number, len(items), repairs))
    if version is None:
        raise FormatError("no header", where="line 1", advice=f"a .waypoints file starts with {_HEADER!r}")
    if version == 120 or not items:
        return WplFile(version, None, tuple(items), tuple(repairs))
    first, *rest = items
    return WplFile(version, GeoPoint(first.lat_deg, first.lon_deg, first.alt_m), tuple(rest), tuple(repairs))


def _version(content: str, line_number: int) -> int:
    match = _HEADER_PATTERN.fullmatch(content)
    version = int(match.group(1)) if match else 0
    if version not in (110, 120):
        raise FormatError(
            f"{content[:40]!r} is not the header of a file that can be read",
            where=f"line {line_number}",
            advice=f"it has to be {_HEADER!r} or 'QGC WPL 120'",
        )
    return version


def _item(line: str, content: str, line_number: int, number: int, repairs: list[str]) -> MissionItem:
    where = f"line {line_number}"
    columns = content.split("\t")
    if len(columns) != _COLUMNS or any(not column or column != column.strip() for column in columns):
        columns = _SEPARATORS.split(content)
        if len(columns) == _COLUMNS:
            repairs.append(f"{where}: changed the separators to tabs")
    elif line != content:
        repairs.append(f"{where}: removed space around the row")
    if len(columns) != _COLUMNS:
        raise FormatError(f"{len(columns)} columns, a row has {_COLUMNS}", where=where)

    def whole(column: int, name: str) -> int:
        value = _number(columns[column], f"{where}, {name}")
        if value != int(value):
            raise FormatError(f"{columns[column]!r} is not a whole number", where=f"{where}, {name}")
        if not columns[column].lstrip("+-").isdigit():
            repairs.append(f"{where}: {name} {columns[column]!r} is written as a whole number")
        return int(value)

    if whole(0, "number") != number:
        repairs.append(f"{where}: renumbered from {columns[0]} to {number}")
    whole(1, "current")
    frame_number, command = whole(2, "frame"), whole(3, "command")
    if not 0 <= command <= 65535:
        raise FormatError(f"command {command} is not from 0 to 65535", where=where)
    try:
        frame = Frame.from_mav_frame(frame_number)
    except FormatError as error:
        raise FormatError(error.what, where=where, advice=error.advice) from None
    if frame_number != frame:
        repairs.append(f"{where}: changed frame {frame_number} to {int(frame)}")
    names = ("param1", "param2", "param3", "param4", "latitude", "longitude", "altitude")
    p1, p2, p3, p4, lat, lon, alt = (
        _number(columns[column], f"{where}, {name}") for column, name in enumerate(names, start=4)
    )
    if frame is not Frame.COMMAND and not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        advice = "latitude comes first" if abs(lon) <= 90.0 else ""
        raise FormatError(f"latitude {lat:g}, longitude {lon:g} is no place", where=where, advice=advice)
    return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, bool(whole(11, "autocontinue")))


def _number(text: str, where: str) -> float:
    try:
        value = float(text) if len(text) <= _LONGEST_NUMBER and "_" not in text and text.isascii() else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{text[:20]!r} is not a finite number", where=where)
    return value
