"""Simple repairs of a mission: raise waypoints that are too low, and insert a waypoint where a leg hits the ground."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission_io.formats import files, plan
from mission_io.formats.text import text_from_bytes
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem
from uavcover.errors import InputError, OutputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.ground_checks import place_of
from uavcover.extras.check.limits import Limits
from uavcover.extras.check.mission_file import CheckQuery, aircraft_of, read_mission_file
from uavcover.extras.check.segments import FlownPath, Segment
from uavcover.extras.check.split import parts_of
from uavcover.extras.check.tuning import CHECKS, REPAIR
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.run.file_group import numbered, write_file
from uavcover.run.user import User

Fly = Callable[[Mission], FlownPath]


@dataclass(frozen=True, slots=True)
class Repaired:
    """A repaired mission.

    Attributes:
        mission: with what was changed.
        raised: numbers of items that were raised, in the mission as it is now.
        inserted: numbers of waypoints that were put in.
    """

    mission: Mission
    raised: tuple[int, ...]
    inserted: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Low:
    """A leg that is too low: by how much, and where."""

    segment: Segment
    short_m: float
    place_m: FloatArray


def repaired(mission: Mission, world: World, limits: Limits, fly: Fly) -> Repaired:
    """Lift straight legs between waypoints to the least height above ground.

    Curves, circles, heights above the terrain, take-off and landing stay as they are; the check that follows reports them.

    Args:
        mission: as it is.
        world: its ground.
        limits: whose least height above ground is kept.
        fly: the path of a mission.
    """
    raised: set[int] = set()
    inserted: set[int] = set()
    for _ in range(REPAIR.rounds):
        low = _lowest(fly(mission), world, limits)
        rises: dict[int, float] = {}
        for leg in low:
            number = _to_raise(leg, mission)
            if number is not None:
                rises[number] = max(leg.short_m, rises.get(number, 0.0))
        if rises:
            mission = _with_raised(mission, rises)
            raised |= set(rises)
            continue
        hit = next((leg for leg in low if _may_insert(leg.segment, mission)), None)
        if hit is None:
            break
        number = hit.segment.items[1]
        mission = _with_inserted(mission, number, _over(hit, mission.items[number - 1], world))
        raised = {n + (n >= number) for n in raised}
        inserted = {n + (n >= number) for n in inserted} | {number}
    return Repaired(mission, tuple(sorted(raised - inserted)), tuple(sorted(inserted)))


def _lowest(path: FlownPath, world: World, limits: Limits) -> list[_Low]:
    found = []
    for segment in path.distinct:
        if segment.phase != "route" or not segment.is_straight:
            continue
        ranges = world.leg_height_ranges_m(segment.enu_m)
        if not np.isfinite(ranges).all():
            continue
        piece = int(np.argmin(ranges[:, 0]))
        short_m = limits.min_height_agl_m - float(ranges[piece, 0])
        if short_m > CHECKS.clearance_tolerance_m:
            found.append(_Low(segment, short_m + REPAIR.spare_m, place_of(segment, piece, float(ranges[piece, 1]))))
    return found


def _is_plain(mission: Mission, number: int) -> bool:
    """Whether an item is a waypoint with a place and a height of its own."""
    if not 1 <= number <= len(mission.items):
        return False
    item = mission.items[number - 1]
    plain = item.command == Command.NAV_WAYPOINT and item.frame in (Frame.AMSL, Frame.ABOVE_HOME)
    return plain and math.isfinite(item.alt_m) and item.alt_m != 0.0 and (item.lat_deg, item.lon_deg) != (0.0, 0.0)


def _to_raise(leg: _Low, mission: Mission) -> int | None:
    """The waypoint at or beside which a leg is lowest, if it may be raised."""
    for end, number in ((-1, leg.segment.items[1]), (0, leg.segment.items[0])):
        if math.hypot(*(leg.place_m - leg.segment.enu_m[end])[:2]) < REPAIR.near_m and _is_plain(mission, number):
            return number
    return None


def _may_insert(segment: Segment, mission: Mission) -> bool:
    """Whether a leg leads from one item to the next in the file, and not by a jump."""
    begin, end = segment.items
    between = mission.items[begin : end - 1]
    follows = begin < end and all(item.frame is Frame.COMMAND and item.command != Command.DO_JUMP for item in between)
    return follows and _is_plain(mission, end)


def _with_raised(mission: Mission, rises: Mapping[int, float]) -> Mission:
    items = [
        dataclasses.replace(item, alt_m=round(item.alt_m + rises[number], 2)) if number in rises else item
        for number, item in enumerate(mission.items, 1)
    ]
    return dataclasses.replace(mission, items=tuple(items))


def _over(leg: _Low, like: MissionItem, world: World) -> MissionItem:
    lat, lon, alt = world.geodetic(leg.place_m)
    base = world.home_alt_amsl_m if like.frame is Frame.ABOVE_HOME else 0.0
    params = (0.0, *like.params[1:])
    return dataclasses.replace(
        like, params=params, lat_deg=round(lat, 7), lon_deg=round(lon, 7), alt_m=round(alt + leg.short_m - base, 2)
    )


def _with_inserted(mission: Mission, number: int, item: MissionItem) -> Mission:
    """The mission with an item in front of an item; jumps lead to where they led."""
    moved = [
        dataclasses.replace(one, params=(one.params[0] + 1.0, *one.params[1:]))
        if one.command == Command.DO_JUMP and one.params[0] >= number
        else one
        for one in mission.items
    ]
    return dataclasses.replace(mission, items=tuple(itertools.chain(moved[: number - 1], [item], moved[number - 1 :])))


def refuse_repair_into(file: Path, out: Path | None, *, force: bool) -> Path:
    """Check the output file of repairs.

    Raises:
        InputError: there is no name, or one of another format.
        OutputError: it is the mission itself, or there already.
    """
    wanted = ".plan" if file.suffix.lower() == ".plan" else ".waypoints"
    if out is None:
        raise InputError(
            f"--fix: specify another file for the repaired mission with -o, such as {file.stem}-fixed{wanted}"
        )
    if out.suffix.lower() != wanted:
        raise InputError(f"-o: {out}: repairs of a {file.suffix} file are written as {wanted}; use this suffix")
    if out.exists() and out.samefile(file):
        raise OutputError(f"-o: {out} is the mission itself; use another name")
    if out.exists() and not force:
        raise OutputError(f"{out}: this file already exists; choose another name, or use --force to replace it")
    return out


def repair_mission(
    query: CheckQuery, checked: Checked, out: Path, user: User, *, force: bool = False
) -> tuple[Path, ...]:
    """Write the mission with plain repairs, and tell what was changed; no file where there is nothing to repair.

    With more items than ``query.most_items`` it is written in parts, ``OUT-1`` and so on.

    Raises:
        InputError: positions are wrong, which only the user can repair, or it is to be split and is not plain.
        OutputError: a file cannot be written.
        FormatError: the format cannot hold the mission.
    """
    wrong = next((one for one in checked.findings if one.kind == "place" and one.weight == "breaks"), None)
    if wrong is not None or checked.world is None:
        what = "its positions are wrong" if wrong is None else wrong.what
        raise InputError(f"--fix: {query.file}: {what}; correct that first")
    world = checked.world
    read = read_mission_file(query.file)
    aircraft = aircraft_of(query, read)
    fixed = repaired(read.mission, world, query.limits, lambda mission: flown_path(mission, world, aircraft))
    mission = fixed.mission
    most = query.most_items
    is_long = most is not None and len(mission.items) > most
    if not fixed.raised and not fixed.inserted and not is_long:
        user.say("simple repairs would not change the mission; no file was written")
        return ()
    if mission.home is None:
        mission = dataclasses.replace(mission, home=GeoPoint(*world.geodetic([0.0, 0.0, 0.0])))
    parts: tuple[Mission, ...] = (mission,)
    names = [out]
    if is_long and most is not None:
        parts = parts_of(mission, world, query.limits, aircraft, most_items=most)
        names = [out.with_name(numbered(out, number)) for number in range(1, len(parts) + 1)]
        there = next((name for name in names if name.exists()), None)
        if there is not None and not force:
            raise OutputError(f"{there}: this file already exists; choose another name, or use --force to replace it")
    for name, part in zip(names, parts, strict=True):
        _write(query.file, name, part)
    changes = f"{_numbers(fixed.raised)} raised, {_numbers(fixed.inserted)} inserted"
    split = f"; {len(parts)} flights of {max(len(part.items) for part in parts)} items at most" if is_long else ""
    user.say(f"written: {', '.join(map(str, names))}: {changes}{split}")
    return tuple(names)


def _write(file: Path, out: Path, mission: Mission) -> None:
    if file.suffix.lower() == ".plan":
        document = plan.read_to_keep(text_from_bytes(file.read_bytes()).text)
        write_file(out, plan.write(document.with_mission(mission)).encode())
    else:
        files.write_mission(mission, out)


def _numbers(numbers: tuple[int, ...]) -> str:
    if not numbers:
        return "no item"
    return f"{'item' if len(numbers) == 1 else 'items'} {', '.join(map(str, numbers))}"
