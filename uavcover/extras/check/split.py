"""A mission with too many items in parts that are flights of their own: take-off, way there, part, way home."""

import dataclasses
import math

import numpy as np

from mission_io.model.items import Command, Frame, Mission, MissionItem, land, return_to_launch, takeoff, waypoint
from uavcover.errors import InputError
from uavcover.extras.check.aircraft import Aircraft
from uavcover.extras.check.limits import Limits
from uavcover.extras.check.tuning import CHECKS, REPAIR
from uavcover.extras.check.world import World

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
    ways = mission.items[first:last]
    places = [k for k, item in enumerate(ways) if item.command == Command.NAV_WAYPOINT]
    parts, begin = [], 0
    while True:
        held = _held(mission.items[: first + places[begin]])
        head = _way_there(mission, ways[places[begin]], held, world, limits)
        around = len(head) + len(_way_home(mission, ways[places[begin]], world, limits))
        # What takes photos is switched on again at the first waypoint, and off before the way home.
        room = most_items - around - sum(one.command in _TRIGGERS for one in held) - len(_TRIGGERS)
        end = begin
        while end + 1 < len(places) and places[end + 1] - places[begin] + 1 <= room:
            end += 1
        rest = len(ways) - places[begin]
        is_last = end + 1 == len(places) and rest <= room
        body = ways[places[begin] :] if is_last else ways[places[begin] : places[end] + 1]
        if len(body) > room or (end == begin and len(body) < rest):
            raise InputError(
                f"--max-items: {most_items} items are not enough for take-off, outbound transit, a leg and return transit"
            )
        tail = [_stop(one) for one in _held((*held, *body)) if one.command in _TRIGGERS]
        home = _way_home(mission, ways[places[end]], world, limits)
        triggers = [one for one in held if one.command in _TRIGGERS]
        parts.append(dataclasses.replace(mission, items=(*head, body[0], *triggers, *body[1:], *tail, *home)))
        if len(body) == rest:
            return tuple(parts)
        begin = end


def _refuse_what_is_not_plain(mission: Mission, aircraft: Aircraft) -> tuple[int, int]:
    """Numbers, from 0, of the first item behind the take-off and of the one at which the mission ends."""

    def refuse(number: int, why: str) -> InputError:
        return InputError(
            f"--fix: {'item ' + str(number) + ' ' if number else ''}{why}: it is not split; split it manually"
        )

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
            has_place = math.isfinite(item.lat_deg + item.lon_deg + item.alt_m) and (item.lat_deg, item.lon_deg) != (
                0.0,
                0.0,
            )
            if number <= takeoffs[0] or not has_place or item.alt_m == 0.0:
                raise refuse(number, "is a waypoint before the take-off, or without a position and a height of its own")
        elif item.command not in (
            *_TRIGGERS,
            *_KEPT,
            *_ONCE,
            *_STOPS,
            int(Command.NAV_TAKEOFF),
            int(Command.NAV_DELAY),
        ):
            raise refuse(number, f"has command {int(item.command)}")
    if not any(item.command == Command.NAV_WAYPOINT for item in mission.items[:last]):
        raise refuse(0, "the mission has no waypoint")
    first = next(k for k, item in enumerate(mission.items) if item.command == Command.NAV_WAYPOINT)
    return first, last


def _refuse_another_landing(mission: Mission, world: World) -> None:
    landing = next((item for item in mission.items if item.command == Command.NAV_LAND), None)
    if landing is None:
        return
    place = landing
    if (landing.lat_deg, landing.lon_deg) == (0.0, 0.0):
        place = [item for item in mission.items if item.command == Command.NAV_WAYPOINT][-1]
    if math.hypot(*world.place(place.lat_deg, place.lon_deg)) > REPAIR.at_home_m:
        raise InputError("--fix: the mission does not land at home: it is not split; split it manually")


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
    east, north = world.place(point.lat_deg, point.lon_deg)
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
    place = world.above_ground([world.place(point.lat_deg, point.lon_deg)], point.alt_m)
    return float(world.alts_amsl_m(place)[0]) - world.home_alt_amsl_m


def _way_there(
    mission: Mission, point: MissionItem, held: list[MissionItem], world: World, limits: Limits
) -> list[MissionItem]:
    """Take-off, what holds at the first waypoint but photos, and the place over it."""
    first = next(item for item in mission.items if item.command == Command.NAV_TAKEOFF)
    over_m = _over_m(point, world, limits)
    up = takeoff(first.lat_deg, first.lon_deg, over_m, frame=Frame.ABOVE_HOME)
    over = waypoint(point.lat_deg, point.lon_deg, over_m, frame=Frame.ABOVE_HOME)
    return [up, *(one for one in held if one.command not in _TRIGGERS), over]


def _way_home(mission: Mission, end: MissionItem, world: World, limits: Limits) -> list[MissionItem]:
    if not any(item.command == Command.NAV_LAND for item in mission.items):
        return [return_to_launch()]
    over_m = _over_m(end, world, limits)
    home = world.frame.lat_deg, world.frame.lon_deg
    legs = [waypoint(*place, over_m, frame=Frame.ABOVE_HOME) for place in ((end.lat_deg, end.lon_deg), home)]
    return [*legs, land(*home, frame=Frame.ABOVE_HOME)]
