"""Plain repairs of a mission: waypoints that are too low are raised, and legs that hit the ground get a waypoint over it."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mission_io.model.items import Command, Frame, Mission, MissionItem
from uavcover.extras.check.ground_checks import TOLERANCE_M, place_of
from uavcover.extras.check.limits import Limits
from uavcover.extras.check.segments import FlownPath, Segment
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray

_SPARE_M = 1.0
_NEAR_M = 5.0
"""Nearer to a waypoint than this, the waypoint is raised; farther away, the leg gets another one."""
_ROUNDS = 40

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

    Curves, circles, heights above the terrain, take-off and landing stay as they are; the check that follows tells of them.

    Args:
        mission: as it is.
        world: its ground.
        limits: whose least height above ground is kept.
        fly: the path of a mission.
    """
    raised: set[int] = set()
    inserted: set[int] = set()
    for _ in range(_ROUNDS):
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
        if short_m > TOLERANCE_M:
            found.append(_Low(segment, short_m + _SPARE_M, place_of(segment, piece, float(ranges[piece, 1]))))
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
        if math.hypot(*(leg.place_m - leg.segment.enu_m[end])[:2]) < _NEAR_M and _is_plain(mission, number):
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
