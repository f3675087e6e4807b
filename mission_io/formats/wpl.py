"""ArduPilot's lists as files: ``.waypoints`` (QGC WPL), and the ``.dat`` files of its own file system.

``.waypoints`` files are written so that every known reader accepts them, and read as tolerantly as is safe.

One item per line in twelve columns: number, current, frame, command, four parameters, latitude, longitude, height,
autocontinue. In version 110 the first row is home. Fences and rally points use the same format.
"""

import itertools
import math
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from mission_io.autopilots.comparison import Meaning, has_no_position, meaning_of, number_for_nan
from mission_io.autopilots.mission_lists import home_item, jumps_moved
from mission_io.errors import FormatError
from mission_io.formats.csv_tables import words_of
from mission_io.formats.text import check_position, clean_text, degrees_text, doubts_about, finite_number, plain_decimal
from mission_io.model.items import (
    NOT_STEPS,
    Command,
    Fence,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    fence_from_items,
    items_from_fence,
    items_from_rally,
    rally_from_items,
)
from mission_io.wire.messages import MissionItemInt, item_from_message, message_from_item

_HEADER = "QGC WPL 110"
_HEADER_PATTERN = re.compile(r"QGC\s+WPL\s+([0-9]{1,9})", re.ASCII | re.IGNORECASE)
_UNUSUAL = frozenset(' ,;"')
"""Characters of a row that is not written as the format says."""
_COMMENT = re.compile(r"(?<!1\.)#")
"""Not the sign in "1.#QNAN", which is NaN."""
_NAN_PATTERN = re.compile(r"[-+]?(nan|1\.#(qnan|snan|ind)0*)", re.ASCII | re.IGNORECASE)
"""NaN as programs write it, those compiled with Microsoft's library included."""
_COLUMNS = 12
_SHORT_LINE = 400
_HOME_COMMANDS = (Command.NAV_WAYPOINT, 0)
"""Of a first row that is home; any other is an item, of a program that knows no home row."""
_PARAM_NAMES = ("param1", "param2", "param3", "param4")
_LEFT_TO_THE_VEHICLE = "NaN that leaves a parameter to the vehicle is written as"
_NAN_AS_NUMBER: Mapping[Meaning, str] = MappingProxyType(
    {
        Meaning.HEADING: "'any heading' is written as 0",
        Meaning.RESERVED: "NaN in a parameter without a use is written as 0",
        Meaning.OR_DEFAULT: f"{_LEFT_TO_THE_VEHICLE} 0",
        Meaning.IF_ABOVE_ZERO: f"{_LEFT_TO_THE_VEHICLE} 0",
        Meaning.IF_NOT_NEGATIVE: f"{_LEFT_TO_THE_VEHICLE} -1",
        Meaning.NUMBER: "NaN in the rate of a gimbal with a set angle is written as 0",
    }
)
"""Replacement of NaN, which only a gimbal's rate can have here."""


@dataclass(frozen=True, slots=True)
class WplFile:
    """The content of a ``.waypoints`` file."""

    version: int  # 110 (the first row is home) or 120 (it is not)
    # the first row of a version 110 file; None in a version 120 file, when there are no rows, and when the first row is
    # no waypoint: a fence item or a rally point, as in MAVProxy's files, or a take-off
    home: GeoPoint | None
    items: tuple[MissionItem, ...]  # the other rows
    repairs: tuple[str, ...]  # what had to be repaired to read it, one line each; empty for a file in strict form

    def mission(self) -> Mission:
        """The file as a mission."""
        return Mission(self.home, self.items)

    def doubts(self) -> tuple[str, ...]:
        """Probable mistakes, such as a route far from home; see ``formats.text.doubts_about``."""
        return doubts_about(self.mission())

    def fence(self) -> Fence:
        """The file as a fence. Raises FormatError: rows that are not fence items."""
        return fence_from_items(self.items)

    def rally(self) -> RallyPoints:
        """The file as rally points. Raises FormatError: rows that are not rally points."""
        return rally_from_items(self.items)


def write_mission(mission: Mission) -> str:
    """Write a mission as text.

    NaN in a heading ("any heading") is written as 0, as other programs do, and so is NaN in a parameter that the command
    does not use; where 0 or -1 leaves a parameter to the vehicle as NaN does, that is written (``losses`` lists all three).
    Any other NaN is an error.

    Raises:
        FormatError: no home (the format needs it), or a number that the format cannot hold; with the row.
    """
    if mission.home is None:
        raise FormatError("the mission has no home", where="row 0", advice="specify the start position")
    return _write(mission.home, mission.items)


def write_fence(fence: Fence, home: GeoPoint | None) -> str:
    """Write a fence as text, with home in the first row, or without it (None) for MAVProxy; errors as ``write_mission``.

    MAVProxy uploads every row of such a file, and vehicles refuse home as an item of a fence.
    """
    return _write(home, items_from_fence(fence))


def write_rally(rally: RallyPoints, home: GeoPoint | None) -> str:
    """Write rally points as text, with home in the first row, or without (None) for MAVProxy; same errors."""
    return _write(home, items_from_rally(rally))


def losses(mission: Mission) -> tuple[str, ...]:
    """Values that ``write_mission`` drops or rounds, one line each; empty when the file is exact."""
    rows_of: dict[Meaning, list[int]] = {}
    for row, item in enumerate(mission.items, start=1):
        for number, value in enumerate(item.params, start=1):
            if math.isnan(value):
                rows_of.setdefault(meaning_of(item.command, number), []).append(row)
    home = () if mission.home is None else ((0, mission.home.lat_deg), (0, mission.home.lon_deg))
    degrees = itertools.chain(
        home,
        *(((n, i.lat_deg), (n, i.lon_deg)) for n, i in enumerate(mission.items, start=1) if i.has_position),
    )
    rounded = [n for n, value in degrees if math.isfinite(value) and float(degrees_text(value, "")) != value]
    found = []
    for meaning, written in _NAN_AS_NUMBER.items():
        if meaning in rows_of:
            rows = list(dict.fromkeys(rows_of[meaning]))
            found.append(f"row {rows[0]}: {written} (affected rows: {len(rows)})")
    if rounded:
        count = len(dict.fromkeys(rounded))
        found.append(f"row {rounded[0]}: degrees were rounded to 8 decimals (0.6 mm) (affected rows: {count})")
    return tuple(found)


def _write(home: GeoPoint | None, items: Sequence[MissionItem]) -> str:
    rows = [*([] if home is None else [home_item(home)]), *items]
    lines = [_HEADER, *(_row_text(number, item) for number, item in enumerate(rows))]
    return "\n".join(lines) + "\n"


def _without_free_values(item: MissionItem) -> tuple[float, float, float, float]:
    """The parameters with the number for NaN wherever there is one; see ``number_for_nan``."""
    p1, p2, p3, p4 = (
        number_for_nan(item, number) if math.isnan(value) else value
        for number, value in enumerate(item.params, start=1)
    )
    return p1, p2, p3, p4


def _row_text(number: int, item: MissionItem) -> str:
    position = degrees_text if item.has_position else plain_decimal
    params = item.params
    if any(map(math.isnan, params)):
        params = _without_free_values(item)
    try:
        columns = (
            str(number),
            "1" if number == 0 else "0",
            str(int(item.frame)),
            str(int(item.command)),
            *map(plain_decimal, params, _PARAM_NAMES),
            position(item.lat_deg, "latitude" if item.has_position else "param5"),
            position(item.lon_deg, "longitude" if item.has_position else "param6"),
            plain_decimal(item.alt_m, "altitude"),
            "1" if item.autocontinue else "0",
        )
    except FormatError as error:
        raise FormatError(error.what, where=f"row {number}, {error.where}", advice=error.advice) from None
    return "\t".join(columns)


def read(text: str) -> WplFile:
    """Read a ``.waypoints`` file, version 110 or 120.

    Repaired and listed: line ends other than LF, a byte order mark, comments and empty lines, spaces or commas instead of
    tabs, integers written with decimals, NaN as a parameter, the frames of MISSION_ITEM_INT, numbers that do not increase
    by one, a home row with more than a position. Jumps of version 120, which has no home row, are counted from 1.

    Raises:
        FormatError: with the line, for anything that would require guessing.
    """
    clean = clean_text(text)
    repairs = list(clean.repairs)
    version: int | None = None
    items: list[MissionItem] = []
    lines = clean.text.split("\n")
    for line_number, line in enumerate(lines, start=1):
        content = _COMMENT.split(line, maxsplit=1)[0].strip()
        if "#" in line and _COMMENT.search(line):
            repairs.append(f"line {line_number}: skipped a comment")
        elif not content and line_number < len(lines):
            repairs.append(f"line {line_number}: skipped an empty line")
        if not content:
            continue
        if version is None:
            version = _version(content, line_number)
            continue
        row = _Row(line_number, content, line)
        items.append(row.item(len(items), repairs))
        if version == 110 and len(items) == 1 and items[0].command in _HOME_COMMANDS:
            _note_what_home_says(items[0], row, repairs)
    if version is None:
        raise FormatError("the header is missing", where="line 1", advice=f"write {_HEADER!r} as the first line")
    if version == 120:
        return WplFile(version, None, tuple(jumps_moved(items, by=1)), tuple(repairs))
    if not items:
        return WplFile(version, None, (), tuple(repairs))
    first, *rest = items
    if first.command in NOT_STEPS:  # MAVProxy's fence and rally files have no home row
        repairs.append("the first row is not home, so the mission has no home")
        return WplFile(version, None, tuple(items), tuple(repairs))
    if first.command not in _HOME_COMMANDS:
        repairs.append(f"the first row is command {first.command}, not home; it is now item 1, and home is missing")
        return WplFile(version, None, tuple(jumps_moved(items, by=1)), tuple(repairs))
    return WplFile(version, GeoPoint(first.lat_deg, first.lon_deg, first.alt_m), tuple(rest), tuple(repairs))


def _version(content: str, line_number: int) -> int:
    match = _HEADER_PATTERN.fullmatch(content)
    version = int(match.group(1)) if match else 0
    if version not in (110, 120):
        raise FormatError(
            f"{content[:40]!r} is not a supported header",
            where=f"line {line_number}",
            advice=f"use {_HEADER!r} or 'QGC WPL 120'",
        )
    return version


def _note_what_home_says(item: MissionItem, row: "_Row", repairs: list[str]) -> None:
    """List the values of the first row of version 110, which is home, beyond its position: they are not kept."""
    if item.frame is not Frame.AMSL:
        repairs.append(
            f"line {row.number}: the height of home was read as above sea level, not {item.frame.name}; if this row "
            "is the first waypoint, insert a row for home before it"
        )
    if any(item.params):
        repairs.append(f"line {row.number}: the first row is home; its parameters were dropped")


_NAMES = (
    "number", "current", "frame", "command", "param1", "param2", "param3", "param4", "latitude", "longitude",
    "altitude", "autocontinue",
)  # fmt: skip


class _Row:
    """A line being parsed into an item."""

    def __init__(self, number: int, content: str, line: str) -> None:
        self.number, self._content, self._line = number, content, line
        self._columns: list[str] = []

    def item(self, number: int, repairs: list[str]) -> MissionItem:
        columns = self._columns = self._split(repairs)
        if self._whole(0, repairs) != number:
            repairs.append(f"line {self.number}: renumbered from {columns[0]} to {number}")
        self._whole(1, repairs)
        frame_number, command = self._whole(2, repairs), self._whole(3, repairs)
        if not 0 <= command <= 65535:
            raise FormatError(f"the command must be between 0 and 65535, not {command}", where=f"line {self.number}")
        try:
            frame = Frame.from_mav_frame(frame_number)
        except FormatError as error:
            raise FormatError(error.what, where=f"line {self.number}", advice=error.advice) from None
        if frame_number != frame:
            repairs.append(f"line {self.number}: changed frame {frame_number} to {int(frame)}")
        p1, p2, p3, p4, lat, lon, alt = self._numbers(command, repairs)
        if frame is not Frame.COMMAND:
            check_position(lat, lon, f"line {self.number}")
        return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, bool(self._whole(11, repairs)))

    def _split(self, repairs: list[str]) -> list[str]:
        columns = self._content.split("\t")
        if len(columns) != _COLUMNS or "" in columns or not _UNUSUAL.isdisjoint(self._content):
            where = f"line {self.number}"
            try:
                found = words_of(self._content, _COLUMNS, usual="\t")
            except FormatError as error:
                what = error.what.replace(f"{_COLUMNS} are expected", f"a row must have {_COLUMNS}")
                raise FormatError(what, where=where, advice=error.advice) from None
            if found.changed:
                tabs = " to tabs" if found.has_other_separators else ""
                repairs.append(f"{where}: {found.changed}{tabs}")
            self._content = "\t".join(found.words)
            return [*found.words]
        if self._line != self._content:
            repairs.append(f"line {self.number}: removed space around the row")
        return columns

    def _numbers(self, command: int, repairs: list[str]) -> list[float]:
        """Parse parameters, position and height: all at once if plain, otherwise singly to name the invalid one."""
        content = self._content
        if content.isascii() and "_" not in content and len(content) <= _SHORT_LINE:
            try:
                numbers = [*map(float, self._columns[4:11])]
            except ValueError:
                numbers = [math.nan]
            if math.isfinite(sum(numbers)):
                return numbers
        return [self._number_or_nan(column, command, repairs) for column in range(4, 11)]

    def _number_or_nan(self, column: int, command: int, repairs: list[str]) -> float:
        """A number; NaN as a parameter stays NaN, and is 0 as the position of a command that has none."""
        text = self._columns[column]
        if _NAN_PATTERN.fullmatch(text) is None or (column > 7 and not has_no_position(command)):
            return self._number(column)
        repairs.append(f"line {self.number}: {_NAMES[column]} {text[:12]!r} is not a number; the vehicle chooses it")
        return math.nan if column <= 7 else 0.0

    def _number(self, column: int) -> float:
        text = self._columns[column]
        try:
            return finite_number(text, "")
        except FormatError as error:
            raise FormatError(error.what, where=f"line {self.number}, {_NAMES[column]}") from None

    def _whole(self, column: int, repairs: list[str]) -> int:
        text = self._columns[column]
        if text.isdecimal() and text.isascii() and len(text) < 10:
            return int(text)
        value = self._number(column)
        where = f"line {self.number}"
        if not value.is_integer():
            raise FormatError(f"{text!r} is not a whole number", where=f"{where}, {_NAMES[column]}")
        if not text.lstrip("+-").isdigit():
            repairs.append(f"{where}: {_NAMES[column]} {text!r} was converted to a whole number")
        return int(value)


# ArduPilot's lists as files of its file system: ``@MISSION/mission.dat``, ``fence.dat`` and ``rally.dat``.
#
# Little-endian: magic number 0x763d, type of the list, options, number of the first item, number of items (16 bits each), then
# for each item the payload of its MISSION_ITEM_INT, 38 bytes. The numbers, targets and types in these are not filled in: the
# place in the file counts.
#
# It takes a list back when a file that was written is closed (AP_Filesystem_Mission.cpp): the size has to agree with the number
# of items, and none may be all zero. Whether it took it is never said, a refused item ends a mission there with the old one
# gone, and what is read afterwards differs from what was written (home, zeros in fields that a command does not have), so that
# a CRC never agrees. Hence ``FileUploads.upload_list`` reads back item by item.

_MAGIC = 0x763D
_HEAD = struct.Struct("<5H")
_ITEM = struct.Struct("<4f2if2H6B")


def dat_path(mission_type: MissionType) -> str:
    """Where ArduPilot has a list."""
    return f"@MISSION/{mission_type.name.lower()}.dat"


def read_mission_dat(content: bytes, mission_type: MissionType) -> list[MissionItem]:
    """The items of a file, as an item-by-item download gives them.

    Raises:
        FormatError: it is no such file, of another list, or not whole.
    """
    if len(content) < _HEAD.size:
        raise FormatError(f"the file has {len(content)} bytes, but the header of an ArduPilot list has {_HEAD.size}")
    magic, kind, _, start, count = _HEAD.unpack_from(content)
    if magic != _MAGIC:
        raise FormatError(f"not an ArduPilot list, because it begins with {magic:#06x} instead of {_MAGIC:#06x}")
    if kind != mission_type:
        raise FormatError(
            f"the file contains a list of type {kind}, not {mission_type.value} ({mission_type.name.lower()})"
        )
    if start != 0:
        raise FormatError(f"the file contains only a part of a list, which begins at item {start}")
    size = len(content) - _HEAD.size
    if size != count * _ITEM.size:
        raise FormatError(
            f"the header announces {count} items ({count * _ITEM.size} bytes), but {size} bytes follow",
            advice="download the file again",
        )
    items = []
    for seq, fields in enumerate(_ITEM.iter_unpack(content[_HEAD.size :])):
        p1, p2, p3, p4, x, y, z, _, command, _, _, frame, current, autocontinue, _ = fields
        items.append(
            item_from_message(
                MissionItemInt(
                    0, 0, seq, frame, command, (p1, p2, p3, p4), x, y, z, current, autocontinue, mission_type
                )
            )
        )
    return items


def write_mission_dat(items: Sequence[MissionItem], mission_type: MissionType) -> bytes:
    """The file of a list. Raises MisuseError: a coordinate that does not fit."""
    out = [_HEAD.pack(_MAGIC, mission_type, 0, 0, len(items))]
    for seq, item in enumerate(items):
        m = message_from_item(item, seq, mission_type=mission_type, target_system=0, target_component=0)
        out.append(
            _ITEM.pack(*m.params, m.x, m.y, m.z, seq, m.command, 0, 0, m.frame, m.current, m.autocontinue, mission_type)
        )
    return b"".join(out)
