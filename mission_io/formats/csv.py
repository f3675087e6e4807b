"""CSV: every item of a mission, one row each, with units in the column names."""

import math
from collections.abc import Mapping

from mission_io.errors import FormatError
from mission_io.formats.dialects import sniff
from mission_io.formats.text import MissionFile, check_place, clean_text, finite_number
from mission_io.model.items import Frame, GeoPoint, Mission, MissionItem

HEADER = "item,command,frame,param1,param2,param3,param4,lat_deg,lon_deg,alt_m,alt_datum,autocontinue"
_COLUMNS = tuple(HEADER.split(","))
_VALUES = _COLUMNS[3:10]


def write_mission(mission: Mission) -> str:
    """Write all items, numbered from 1, with home as row 0 when known; numbers are unrounded, missing values empty.

    ``alt_datum`` says what ``alt_m`` is measured from: AMSL, ABOVE_HOME, ABOVE_TERRAIN, or COMMAND for none.
    """
    lines = [HEADER]
    if mission.home is not None:
        home = mission.home
        place = ",".join(_text(value) for value in (home.lat_deg, home.lon_deg, home.alt_amsl_m))
        lines.append(f"0,16,0,0.0,0.0,0.0,0.0,{place},AMSL,1")
    for number, item in enumerate(mission.items, start=1):
        values = ",".join(_text(value) for _, value in item.values())
        lines.append(
            f"{number},{int(item.command)},{int(item.frame)},{values},{item.frame.name},{int(item.autocontinue)}"
        )
    return "\n".join(lines) + "\n"


def read_mission(text: str) -> MissionFile:
    """Read what ``write_mission`` writes; columns may be in any order, and unknown ones are dropped and listed.

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
    p1, p2, p3, p4, lat, lon, alt = (_value(row[name].strip(), f"{where}, {name}") for name in _VALUES)
    if frame is not Frame.COMMAND:
        check_place(lat, lon, where)
    autocontinue = row["autocontinue"].strip()
    if autocontinue not in ("0", "1"):
        raise FormatError(f"must be 0 or 1, not {autocontinue[:20]!r}", where=f"{where}, autocontinue")
    return MissionItem(command, frame, (p1, p2, p3, p4), lat, lon, alt, autocontinue == "1")


def _value(text: str, where: str) -> float:
    return finite_number(text, where) if text else math.nan


def _whole(row: Mapping[str, str], name: str, where: str) -> int:
    value = finite_number(row[name].strip(), f"{where}, {name}")
    if not value.is_integer():
        raise FormatError(f"{row[name][:20]!r} is not a whole number", where=f"{where}, {name}")
    return int(value)


def _text(value: float) -> str:
    return "" if math.isnan(value) else repr(float(value))
