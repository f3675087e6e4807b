"""Mission files on disk, written by the suffix of their name; the only module of the formats that opens files.

| Suffix | Read | Written | Holds |
| --- | --- | --- | --- |
| `.plan` | yes | yes | mission, fence and rally points |
| `.waypoints`, `.txt` and any other | yes | yes | one of the three lists |
| `.csv` | yes | yes | a mission |
| `.fen` | yes | no | a fence |
| `.mission`, `.fence`, `.rally` (JSON) | yes | no | one of the three lists, of a QGroundControl before `.plan` |
| `.kml`, `.geojson`, `.gpx` | no | yes | a route to look at |

Except for `.csv`, the first lines of a file decide its format, not its name: also MAVProxy's old lists of positions (a fence)
and of lines that begin with ``RALLY``.
"""

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from mission_io.autopilots.autopilot import ARDUPILOT, Autopilot
from mission_io.autopilots.mission_lists import items_of
from mission_io.errors import FormatError, MisuseError
from mission_io.formats import plan, wpl
from mission_io.formats.csv_tables import read_csv, write_csv
from mission_io.formats.drawings import read_fence_list, read_rally_list, write_geojson
from mission_io.formats.map_xml import write_gpx, write_kml
from mission_io.formats.text import MissionFile, text_from_bytes
from mission_io.model.items import FENCE_COMMANDS, Command, Fence, Mission, MissionType, RallyPoints

_log = logging.getLogger(__name__)

DRAWING_SUFFIXES: Final = frozenset({".kml", ".geojson", ".json", ".poly", ".gpx"})
"""Suffixes of files that hold drawn shapes and no mission items."""
ONLY_LIST: Final[Mapping[str, MissionType]] = MappingProxyType({".csv": MissionType.MISSION, ".fen": MissionType.FENCE})
"""The one list that a file of this suffix can hold."""
EVERY_LIST: Final = (".waypoints", ".plan")
"""Suffixes of files that hold whichever of a vehicle's lists: one of them, or all three."""
_LONGEST_FIRST_LINE = 400


def read_file(path: str | Path, *, mission_type: MissionType | None = None) -> MissionFile:
    """Read a mission file.

    Args:
        path: The file; see the table at the top of this module for suffixes.
        mission_type: Which list to read. None reads every list of a ``.plan`` file, and recognises the list of a
            ``.waypoints`` file by its commands.

    Raises:
        FormatError: the text is no such file, with file and line.
        MisuseError: the file cannot be opened, or its format cannot hold the list.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in DRAWING_SUFFIXES:
        raise MisuseError(f"{path}: a {suffix} file contains shapes, not mission items; save the mission as .waypoints")
    only = ONLY_LIST.get(suffix)
    if only is not None and mission_type not in (None, only):
        raise MisuseError(f"{path}: a {suffix} file contains only a {only.name.lower()}")
    try:
        decoded = text_from_bytes(path.read_bytes())
        reader, surprise = _reader_of(suffix, decoded.text)
        read = reader(decoded.text, mission_type)
    except OSError as error:
        raise MisuseError(f"{path}: cannot read the file ({error.strerror})") from error
    except FormatError as error:
        where = f"{path}: {error.where}" if error.where else str(path)
        raise FormatError(error.what, where=where, advice=error.advice) from error
    if mission_type is not None and not read.has(mission_type):
        raise FormatError(
            f"the file contains no {mission_type.name.lower()}",
            where=str(path),
            advice="request the list that the file contains",
        )
    return MissionFile(read.mission, read.fence, read.rally, (*decoded.repairs, *surprise, *read.repairs))


def read_mission(path: str | Path) -> Mission:
    """Read the mission of a file; repairs and probable mistakes are logged as warnings.

    Raises:
        FormatError: as :func:`read_file`.
        MisuseError: as :func:`read_file`.
    """
    file = read_file(path, mission_type=MissionType.MISSION)
    if file.mission is None:
        raise FormatError("the file contains no mission", where=str(path))
    for line in (*file.repairs, *file.doubts()):
        _log.warning("%s: %s", path, line)
    return file.mission


def write_mission(
    mission: Mission,  # what to write
    path: str | Path,  # the file; see the table at the top of this module for suffixes
    *,
    fence: Fence | None = None,  # written to a ``.plan`` file along with the mission
    rally: RallyPoints | None = None,  # the same
    autopilot: Autopilot = ARDUPILOT,  # the autopilot that a ``.plan`` file names
) -> tuple[str, ...]:
    """Write a mission to a file, which replaces an older one.

    Returns:
        What the format cannot hold exactly, one line each; empty when the file holds every bit.

    Raises:
        FormatError: the mission has no home although the format needs one, or a number that the format cannot hold. An
            older file stays as it was.
        MisuseError: the suffix cannot be written or cannot hold a fence or rally points, or the disk refuses.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    lists = plan.PlanFile(mission, fence or Fence(), rally or RallyPoints(), autopilot.mav_autopilot)
    if suffix != ".plan" and (fence is not None or rally is not None):
        raise MisuseError(f"{path}: only a .plan file can contain fence and rally points together with a mission")
    if suffix in {".fen", ".poly"}:
        raise MisuseError(f"{path}: a {suffix} file cannot contain a mission; name it .waypoints or .plan")
    file_format = _FORMATS_OF_SUFFIXES.get(suffix, "waypoints")
    text = mission_text(file_format, lists)
    losses: tuple[str, ...] = ()
    if file_format == "plan":
        losses = plan.losses(lists)
    elif file_format == "waypoints":
        losses = wpl.losses(mission)
    try:
        path.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise MisuseError(f"{path}: cannot write the file ({error.strerror})") from error
    return losses


def _read_plan(text: str, mission_type: MissionType | None) -> MissionFile:
    document = plan.read(text)

    def wanted(kind: MissionType) -> bool:
        return mission_type in (None, kind)

    return MissionFile(
        document.mission if wanted(MissionType.MISSION) else None,
        document.fence if wanted(MissionType.FENCE) else None,
        document.rally if wanted(MissionType.RALLY) else None,
        document.repairs,
    )


def _read_waypoints(text: str, mission_type: MissionType | None) -> MissionFile:
    read = wpl.read(text)
    if mission_type is None:
        commands = {item.command for item in read.items}
        if commands and all(command in FENCE_COMMANDS for command in commands):
            mission_type = MissionType.FENCE
        elif commands == {int(Command.NAV_RALLY_POINT)}:
            mission_type = MissionType.RALLY
    if mission_type is MissionType.FENCE:
        return MissionFile(fence=read.fence(), repairs=read.repairs)
    if mission_type is MissionType.RALLY:
        return MissionFile(rally=read.rally(), repairs=read.repairs)
    return MissionFile(read.mission(), repairs=read.repairs)


def _read_positions(text: str, _: MissionType | None) -> MissionFile:
    read = read_fence_list(text)
    return replace(read, repairs=("read as an old fence file: the first position is the return point", *read.repairs))


_Reader = Callable[[str, MissionType | None], MissionFile]
_READERS: Final[Mapping[str, _Reader]] = MappingProxyType(
    {".plan": _read_plan, ".fen": lambda text, _: read_fence_list(text)}
)
"""By suffix, for a file whose first line does not say what it is; of any other suffix: ``.waypoints``."""
_FIRST_LINES: Final[tuple[tuple[re.Pattern[str], _Reader, str], ...]] = (
    (re.compile(r"QGC\s+WPL\b", re.IGNORECASE), _read_waypoints, ".waypoints"),
    (re.compile(r"RALLY\s"), lambda text, _: read_rally_list(text), ""),
    (re.compile(r"[-+]?[0-9.]+[ \t,;]+[-+]?[0-9.]+[ \t]*(#.*)?$"), _read_positions, ".fen"),
)
"""What a first line looks like, its reader, and the suffix that such files should have, if there is one."""
_PLAN = re.compile(r'"fileType"\s*:\s*"Plan"')
_OLD_JSON = re.compile(r'"MAV_AUTOPILOT"\s*:|"fileType"\s*:\s*"(Mission|GeoFence|RallyPoints)"')
_COMMENTS = re.compile(r"(\s*(#[^\n]*)?\n)*\s*")


def _reader_of(suffix: str, text: str) -> tuple[_Reader, tuple[str, ...]]:
    """The reader for the file's content, and a line for a name that contradicts it."""
    if suffix == ".csv":
        return lambda text, _: read_csv(text), ()
    begin = _COMMENTS.match(text)
    rest = text[begin.end() if begin else 0 :]
    if rest.startswith("{"):
        old = _PLAN.search(text) is None and _OLD_JSON.search(text) is not None
        surprise = () if suffix != ".waypoints" else ("the file is JSON, not a .waypoints file",)
        return (lambda text, _: plan.read_old_json(text)) if old else _read_plan, surprise
    line = rest.split("\n", 1)[0][:_LONGEST_FIRST_LINE]
    for pattern, reader, usual in _FIRST_LINES:
        if pattern.match(line):
            named_otherwise = suffix in (".plan", ".fen", ".waypoints") and suffix != usual
            return _READERS.get(suffix, reader) if suffix == usual else reader, (
                (f"the file is {usual or 'a list of rally points'}, not a {suffix} file",) if named_otherwise else ()
            )
    return _READERS.get(suffix, _read_waypoints), ()


def _of_mavproxy(lists: plan.PlanFile, mission_type: MissionType) -> str:
    """A fence or rally points as MAVProxy's ``fence load`` and ``rally load`` want them: without a home row."""
    if mission_type is MissionType.FENCE:
        text, count = wpl.write_fence(lists.fence, None), len(items_of(lists.fence, ARDUPILOT))
    else:
        text, count = wpl.write_rally(lists.rally, None), len(lists.rally.points)
    if count == 0:
        raise FormatError(
            f"there is no {mission_type.name.lower()} to write", where="plan", advice="write only the mission"
        )
    return text


_WRITERS: Final[Mapping[str, Callable[[plan.PlanFile, str], str]]] = MappingProxyType(
    {
        "waypoints": lambda lists, _: wpl.write_mission(lists.mission),
        "plan": lambda lists, _: plan.write(lists),
        "kml": lambda lists, name: write_kml(lists.mission, name=name),
        "geojson": lambda lists, name: write_geojson(lists.mission, name=name),
        "csv": lambda lists, _: write_csv(lists.mission),
        "gpx": lambda lists, name: write_gpx(lists.mission, name=name),
        "mavproxy-fence": lambda lists, _: _of_mavproxy(lists, MissionType.FENCE),
        "mavproxy-rally": lambda lists, _: _of_mavproxy(lists, MissionType.RALLY),
    }
)
_FORMATS_OF_SUFFIXES: Final[Mapping[str, str]] = MappingProxyType(
    {".plan": "plan", ".kml": "kml", ".geojson": "geojson", ".json": "geojson", ".csv": "csv", ".gpx": "gpx"}
)
"""Any other suffix is ``waypoints``; MAVProxy's lists have no suffix of their own."""

FORMATS: Final = tuple(_WRITERS)
"""Formats that a mission can be written in, by name."""


def mission_text(file_format: str, lists: plan.PlanFile, *, name: str = "mission") -> str:
    """The text of a mission in one of FORMATS; only ``plan`` and MAVProxy's formats carry fence and rally points.

    Raises:
        FormatError: the mission has no home although the format needs one, or a number that the format cannot hold.
        MisuseError: another format.
    """
    writer = _WRITERS.get(file_format)
    if writer is None:
        raise MisuseError(f"unknown format {file_format!r}; use one of {', '.join(FORMATS)}")
    return writer(lists, name)
