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
from mission_io.model.items import (
    Command,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    land,
    return_to_launch,
    takeoff,
    waypoint,
)
from uavcover.errors import InputError, OutputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.clearance_checks import position_of
from uavcover.extras.check.findings import FlownPath, Segment
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.mission_file import CheckQuery, aircraft_of, own_return_of, read_mission_file
from uavcover.extras.check.tuning import CHECKS, REPAIR
from uavcover.extras.check.world import Aircraft, Limits, World
from uavcover.kernels.arrays import FloatArray
from uavcover.run.file_group import numbered, write_file
from uavcover.run.user import User

# A mission with too many items in parts that are flights of their own: take-off, way there, part, way home.

_TRIGGERS = (int(Command.DO_SET_CAM_TRIGG_DIST), int(Command.IMAGE_START_CAPTURE), 214)
_STOPS = {int(Command.IMAGE_STOP_CAPTURE): int(Command.IMAGE_START_CAPTURE)}
_KEPT = (
    int(Command.DO_CHANGE_SPEED), int(Command.DO_MOUNT_CONTROL), int(Command.DO_GIMBAL_MANAGER_PITCHYAW),
    int(Command.DO_SET_ROI_LOCATION), 201, int(Command.DO_SET_ROI_NONE),
)  # fmt: skip
"""Commands whose last item holds from there on."""
_ONCE = (int(Command.DO_DIGICAM_CONTROL), int(Command.CONDITION_YAW))
_ENDS = (int(Command.NAV_RETURN_TO_LAUNCH), int(Command.NAV_LAND))


def parts_of(
    mission: Mission, world: World, limits: Limits, aircraft: Aircraft, *, most_items: int
) -> tuple[Mission, ...]:
    """Cut a mission of plain waypoints; parts share the waypoint at a cut.

    Each part takes off at home, climbs to where the straight way to its first waypoint keeps the least height above ground, flies
    over that waypoint and down to it, and ends as the whole mission does: with a return, or with legs back over home and a
    landing. Speed, gimbal, region of interest and photos hold in a part as they held in the whole.

    Args:
        mission: as it is.
        world: its ground.
        limits: whose least height above ground is kept.
        aircraft: who flies it.
        most_items: of a part, home not counted.

    Raises:
        InputError: it is not plain, or a part has no room.
    """
    first, last = _refuse_what_is_not_plain(mission, aircraft)
    _refuse_another_landing(mission, world)
    items = mission.items[first:last]
    positions = [k for k, item in enumerate(items) if item.command == Command.NAV_WAYPOINT]
    parts, begin = [], 0
    while True:
        held = _held(mission.items[: first + positions[begin]])
        head = _outbound_items(mission, items[positions[begin]], held, world, limits)
        around = len(head) + len(_return_items(mission, items[positions[begin]], world, limits))
        # What takes photos is switched on again at the first waypoint, and off before the way home.
        room = most_items - around - sum(one.command in _TRIGGERS for one in held) - len(_TRIGGERS)
        end = begin
        while end + 1 < len(positions) and positions[end + 1] - positions[begin] + 1 <= room:
            end += 1
        rest = len(items) - positions[begin]
        is_last = end + 1 == len(positions) and rest <= room
        body = items[positions[begin] :] if is_last else items[positions[begin] : positions[end] + 1]
        if len(body) > room or (end == begin and len(body) < rest):
            raise InputError(f"--max-items: {most_items} items are too few for take-off, a leg and both transits")
        tail = [_stop(one) for one in _held((*held, *body)) if one.command in _TRIGGERS]
        home = _return_items(mission, items[positions[end]], world, limits)
        triggers = [one for one in held if one.command in _TRIGGERS]
        parts.append(dataclasses.replace(mission, items=(*head, body[0], *triggers, *body[1:], *tail, *home)))
        if len(body) == rest:
            return tuple(parts)
        begin = end


def _refuse_what_is_not_plain(mission: Mission, aircraft: Aircraft) -> tuple[int, int]:
    """Numbers, from 0, of the first item behind the take-off and of the one at which the mission ends."""

    def refuse(number: int, why: str) -> InputError:
        return InputError(f"--fix: {'item ' + str(number) + ' ' if number else ''}{why}; split the mission manually")

    if aircraft.has_wings:
        raise refuse(0, "each part of a fixed-wing mission needs a runway")
    takeoffs = [k for k, item in enumerate(mission.items) if item.command == Command.NAV_TAKEOFF]
    if len(takeoffs) != 1:
        raise refuse(0, f"the mission has {len(takeoffs)} take-offs")
    last = next((k for k, item in enumerate(mission.items) if item.command in _ENDS), len(mission.items))
    if last + 1 < len(mission.items):
        raise refuse(last + 2, "follows the end of the mission")
    for number, item in enumerate(mission.items[:last], 1):
        if item.command == Command.NAV_WAYPOINT:
            has_position = math.isfinite(item.lat_deg + item.lon_deg + item.alt_m) and (item.lat_deg, item.lon_deg) != (
                0.0,
                0.0,
            )
            if number <= takeoffs[0] or not has_position or item.alt_m == 0.0:
                raise refuse(number, "is a waypoint before take-off, or has no position and height of its own")
        elif item.command not in (*_TRIGGERS, *_KEPT, *_ONCE, *_STOPS, Command.NAV_TAKEOFF, Command.NAV_DELAY):
            raise refuse(number, f"has the unsupported command {int(item.command)}")
    if not any(item.command == Command.NAV_WAYPOINT for item in mission.items[:last]):
        raise refuse(0, "the mission has no waypoint")
    first = next(k for k, item in enumerate(mission.items) if item.command == Command.NAV_WAYPOINT)
    return first, last


def _refuse_another_landing(mission: Mission, world: World) -> None:
    landing = next((item for item in mission.items if item.command == Command.NAV_LAND), None)
    if landing is None:
        return
    position = landing
    if (landing.lat_deg, landing.lon_deg) == (0.0, 0.0):
        position = [item for item in mission.items if item.command == Command.NAV_WAYPOINT][-1]
    if math.hypot(*world.position(position.lat_deg, position.lon_deg)) > REPAIR.at_home_m:
        raise InputError("--fix: the mission does not land at home, so uavcover cannot split it; split it manually")


def _held(items: tuple[MissionItem, ...]) -> list[MissionItem]:
    """The items that still hold at the end of some items, one for each command."""
    held: dict[int, MissionItem] = {}
    for item in items:
        command = int(item.command)
        if command in _STOPS:
            held.pop(_STOPS[command], None)
        elif command in _TRIGGERS:
            single = command == Command.IMAGE_START_CAPTURE
            amount = item.params[1] if single else item.params[0]
            if amount > 0.0:
                held[command] = item
            elif not single:
                held.pop(command, None)
        elif command in _KEPT:
            held.pop(command, None)
            held[command] = item
    return list(held.values())


def _stop(trigger: MissionItem) -> MissionItem:
    if trigger.command == Command.IMAGE_START_CAPTURE:
        return MissionItem(Command.IMAGE_STOP_CAPTURE, Frame.COMMAND)
    return dataclasses.replace(trigger, params=(0.0, 0.0, 0.0, 0.0))


def _over_m(point: MissionItem, world: World, limits: Limits) -> float:
    """Height above home at which the straight path between home and a waypoint keeps the least height, not below the waypoint."""
    east, north = world.position(point.lat_deg, point.lon_deg)
    pieces = max(1, math.ceil(math.hypot(east, north) / CHECKS.return_line_piece_m))
    t = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    line = world.at_alts(t * np.array([east, north]), world.home_alt_amsl_m)
    ranges = world.leg_height_ranges_m(line)
    if not np.isfinite(ranges[:, 0]).all():
        raise InputError(
            "--fix: the elevation data does not cover the whole path to a part; use elevation data of a larger area"
        )
    needed_m = limits.min_height_agl_m + REPAIR.spare_m - float(ranges[:, 0].min())
    return math.ceil(max(needed_m, _above_home_m(point, world)))


def _above_home_m(point: MissionItem, world: World) -> float:
    if point.frame is Frame.ABOVE_HOME:
        return point.alt_m
    if point.frame is Frame.AMSL:
        return point.alt_m - world.home_alt_amsl_m
    position = world.above_ground([world.position(point.lat_deg, point.lon_deg)], point.alt_m)
    return float(world.alts_amsl_m(position)[0]) - world.home_alt_amsl_m


def _outbound_items(
    mission: Mission, point: MissionItem, held: list[MissionItem], world: World, limits: Limits
) -> list[MissionItem]:
    """Take-off, what holds at the first waypoint but photos, and the place over it."""
    first = next(item for item in mission.items if item.command == Command.NAV_TAKEOFF)
    over_m = _over_m(point, world, limits)
    up = takeoff(first.lat_deg, first.lon_deg, over_m, frame=Frame.ABOVE_HOME)
    over = waypoint(point.lat_deg, point.lon_deg, over_m, frame=Frame.ABOVE_HOME)
    return [up, *(one for one in held if one.command not in _TRIGGERS), over]


def _return_items(mission: Mission, end: MissionItem, world: World, limits: Limits) -> list[MissionItem]:
    if not any(item.command == Command.NAV_LAND for item in mission.items):
        return [return_to_launch()]
    over_m = _over_m(end, world, limits)
    home = world.frame.lat_deg, world.frame.lon_deg
    legs = [waypoint(*position, over_m, frame=Frame.ABOVE_HOME) for position in ((end.lat_deg, end.lon_deg), home)]
    return [*legs, land(*home, frame=Frame.ABOVE_HOME)]


Fly = Callable[[Mission], FlownPath]


@dataclass(frozen=True, slots=True)
class Repaired:
    """A repaired mission."""

    mission: Mission  # with what was changed
    raised: tuple[int, ...]  # numbers of items that were raised, in the mission as it is now
    inserted: tuple[int, ...]  # numbers of waypoints that were put in


@dataclass(frozen=True, slots=True)
class _Low:
    """A leg that is too low: by how much, and where."""

    segment: Segment
    short_m: float
    position_m: FloatArray


def repaired(mission: Mission, world: World, limits: Limits, fly: Fly) -> Repaired:
    """Lift straight legs between waypoints to the least height above ground.

    Curves, circles, heights above the terrain, take-off and landing stay as they are; the check that follows reports them.
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
            found.append(_Low(segment, short_m + REPAIR.spare_m, position_of(segment, piece, float(ranges[piece, 1]))))
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
        if math.hypot(*(leg.position_m - leg.segment.enu_m[end])[:2]) < REPAIR.near_m and _is_plain(mission, number):
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
    lat, lon, alt = world.geodetic(leg.position_m)
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
        raise OutputError(f"-o: {out} is the original mission; choose another name")
    if out.exists() and not force:
        raise OutputError(f"{out} already exists; use --force to overwrite it, or choose another name")
    return out


def repair_mission(
    query: CheckQuery, checked: Checked, out: Path, user: User, *, force: bool = False
) -> tuple[Path, ...]:
    """Write the mission with simple repairs, and report the changes; no file without a repair.

    With more items than ``query.most_items`` it is written in parts, ``OUT-1`` and so on.

    Raises:
        InputError: positions are wrong, which only the user can repair, or it is to be split and is not plain.
        OutputError: a file cannot be written.
        FormatError: the format cannot hold the mission.
    """
    wrong = next((one for one in checked.findings if one.kind == "place" and one.weight == "breaks"), None)
    if wrong is not None or checked.world is None or checked.around is None:
        what = "some of its positions are wrong" if wrong is None else wrong.what
        raise InputError(f"--fix: {query.file}: {what}; correct this first")
    world = checked.world
    read = read_mission_file(query.file)
    aircraft = aircraft_of(query, read)
    own, fence = own_return_of(query, read), checked.around.fence
    fixed = repaired(read.mission, world, query.limits, lambda one: flown_path(one, world, aircraft, own, fence))
    mission = fixed.mission
    most = query.most_items
    is_long = most is not None and len(mission.items) > most
    if not fixed.raised and not fixed.inserted and not is_long:
        user.say("no simple repair applies to the mission, so no file was written")
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
            raise OutputError(f"{there} already exists; use --force to overwrite it, or choose another name")
    for name, part in zip(names, parts, strict=True):
        _write(query.file, name, part)
    changes = f"{_numbers(fixed.raised)} raised, {_numbers(fixed.inserted)} inserted"
    split = f"; {len(parts)} flights of at most {max(len(part.items) for part in parts)} items" if is_long else ""
    user.say(f"wrote {', '.join(map(str, names))}: {changes}{split}")
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
