"""Mission lists as an autopilot takes them: conversion to its terms, checks before sending, and its refusals."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from mission_io.autopilots.autopilot import Autopilot
from mission_io.errors import FormatError
from mission_io.model.enums import MissionResult
from mission_io.model.items import (
    NOT_STEPS,
    WITHOUT_POSITION,
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
from mission_io.wire.messages import DEGREES_SCALE, MissionItemFloat, MissionItemInt, float32, item_from_message


def wire_items(mission: Mission, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """A mission's items as they are sent to an autopilot: with home in front where item 0 is home.

    An autopilot that keeps home in item 0 puts its own home there, so a mission without a home is sent with a
    waypoint at latitude 0, longitude 0, only to keep the place. Jumps name items as the vehicle counts them, and
    commands known to have no position go in the frame COMMAND, the only one that both autopilots take them in.
    """
    items = [_in_command_frame(item) for item in mission.items]
    if not autopilot.home_in_item_0:
        return tuple(jumps_moved(items, by=-1))
    home = mission.home if mission.home is not None else GeoPoint(0.0, 0.0, 0.0)
    return (home_item(home), *items)


def jumps_moved(items: Iterable[MissionItem], *, by: int) -> Iterator[MissionItem]:
    """The items, with the target of every DO_JUMP shifted by a number of items."""
    for item in items:
        if item.command == Command.DO_JUMP:
            p1, p2, p3, p4 = item.params
            yield replace(item, params=(p1 + by, p2, p3, p4))
        else:
            yield item


def home_item(home: GeoPoint) -> MissionItem:
    """Home as item 0, where files and ArduPilot keep it."""
    return MissionItem(
        Command.NAV_WAYPOINT, Frame.AMSL, lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_m=home.alt_amsl_m
    )


def mission_from_wire(items: Sequence[MissionItem], autopilot: Autopilot) -> Mission:
    """The mission of an autopilot's item list; the inverse of ``wire_items``.

    Commands known to have no position get the frame COMMAND, whichever the autopilot returned them with.
    """
    home = None
    if autopilot.home_in_item_0 and items:
        first, *items = items
        home = GeoPoint(first.lat_deg, first.lon_deg, first.alt_m)
    elif not autopilot.home_in_item_0:
        items = tuple(jumps_moved(items, by=1))
    return Mission(home, tuple(command_read_back(item) for item in items))


def _in_command_frame(item: MissionItem) -> MissionItem:
    return replace(item, frame=Frame.COMMAND) if item.command in WITHOUT_POSITION else item


def command_read_back(item: MissionItem) -> MissionItem:
    """The item with the frame COMMAND if its command has no position, in any returned frame.

    Parameters 5 and 6 that were read as degrees become whole numbers again.
    """
    if item.command not in WITHOUT_POSITION or not item.has_position:
        return item
    lat, lon = (
        float(round(value * DEGREES_SCALE)) if math.isfinite(value) else value for value in (item.lat_deg, item.lon_deg)
    )
    return replace(item, frame=Frame.COMMAND, lat_deg=lat, lon_deg=lon)


def stored_item(item: MissionItem, autopilot: Autopilot) -> MissionItem:
    """The item as this autopilot returns it: as sent on the wire, changed by its storage rules."""

    def kept(name: str, value: float) -> float:
        rule = autopilot.rule_for(item, name)
        return float32(rule.store(value) if rule is not None else value)

    p1, p2, p3, p4 = (kept(f"param{i}", value) for i, value in enumerate(item.params, start=1))
    item = _in_command_frame(item)
    lat, lon = item.lat_deg, item.lon_deg
    if not item.has_position:
        lat, lon = kept("lat_deg", lat), kept("lon_deg", lon)
        if autopilot.command_frame_returned is not Frame.COMMAND:
            lat, lon = lat / DEGREES_SCALE, lon / DEGREES_SCALE
    return MissionItem(
        item.command,
        item.frame if item.has_position else autopilot.command_frame_returned,
        (p1, p2, p3, p4),
        lat,
        lon,
        kept("alt_m", item.alt_m),
        item.autocontinue if autopilot.keeps_autocontinue else item.command not in NOT_STEPS,
    )


MissionList: TypeAlias = Mission | Fence | RallyPoints


def mission_type_of(mission_list: MissionList) -> MissionType:
    """The type of a mission list."""
    if isinstance(mission_list, Mission):
        return MissionType.MISSION
    return MissionType.FENCE if isinstance(mission_list, Fence) else MissionType.RALLY


def items_of(mission_list: MissionList, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """The items of a mission list as sent to an autopilot. Raises FormatError: an invalid fence polygon or circle."""
    if isinstance(mission_list, Mission):
        return wire_items(mission_list, autopilot)
    return items_from_fence(mission_list) if isinstance(mission_list, Fence) else items_from_rally(mission_list)


def mission_list_of(mission_type: MissionType, items: Sequence[MissionItem], autopilot: Autopilot) -> MissionList:
    """The mission, fence or rally points of an autopilot's item list; the inverse of ``items_of``.

    Raises:
        FormatError: items that do not belong in such a list.
    """
    if mission_type is MissionType.MISSION:
        return mission_from_wire(items, autopilot)
    return fence_from_items(items) if mission_type is MissionType.FENCE else rally_from_items(items)


# Checks before sending: would the autopilot accept a list of items, and would it understand them as they were meant? And after
# receiving: are the items of a vehicle positions on Earth?

_LARGEST_FLOAT32 = 3.4028234663852886e38
_LONGEST_HOLD_S = 65535
_WHOLE_ITEM_COUNT = 65535
_LARGEST_DEGREES = {"lat_deg": 90.0, "lon_deg": 180.0}
_NAMES = {"lat_deg": "latitude", "lon_deg": "longitude"}


@dataclass(frozen=True, slots=True)
class Problem:
    """Something an autopilot would refuse or misunderstand."""

    item: int | None  # number of the item on the wire, from 0; None for the whole list
    field: str  # the field; empty for the whole item
    what: str  # the problem and the remedy

    def __str__(self) -> str:
        """One line as text."""
        where = "the list" if self.item is None else f"item {self.item}"
        return f"{where}{f', {self.field}' if self.field else ''}: {self.what}"


def check_for_autopilot(
    items: Sequence[MissionItem],
    autopilot: Autopilot,
    mission_type: MissionType = MissionType.MISSION,
    *,
    item_limit: int | None = None,
) -> tuple[Problem, ...]:
    """Find everything that ``autopilot`` would refuse or silently misinterpret.

    ``items`` are numbered as on the wire, so with home first for ArduPilot (see ``wire_items``). ``item_limit`` is the
    limit stated by the vehicle; without it, the known limit of the autopilot applies.
    """
    problems: list[Problem] = []
    known_limit = autopilot.item_limit if autopilot.item_limit is not None else _WHOLE_ITEM_COUNT
    limit = known_limit if item_limit is None else item_limit
    if len(items) > limit:
        remedy = "split the mission" if mission_type is MissionType.MISSION else "use fewer or simpler zones or points"
        problems.append(Problem(None, "", f"{len(items)} items exceed the {autopilot.name} limit of {limit}; {remedy}"))
    home_first = mission_type is MissionType.MISSION and autopilot.home_in_item_0
    if home_first and items and items[0].command != Command.NAV_WAYPOINT:
        what = (
            f"{autopilot.name} stores home in item 0, so this command {items[0].command} would be lost; send home first"
        )
        problems.append(Problem(0, "command", what))
    for number, item in enumerate(items):
        problems.extend(Problem(number, name, what) for name, what in _item_problems(item, autopilot, len(items)))
    if mission_type is not MissionType.MISSION:
        problems.extend(_list_problems(items, mission_type, autopilot))
    return tuple(problems)


def refuse_impossible(items: Sequence[MissionItem], mission_type: MissionType) -> None:
    """Refuse a downloaded list with a position that is none: PX4 accepts and returns such items.

    Raises:
        FormatError: the first item and field, by its number on the wire.
    """
    for number, item in enumerate(items):
        for name, value in item.values():
            what = _impossible(item, name, value, mission_type)
            if what is not None:
                advice = "the vehicle cannot fly its current list; upload the list again, or clear it"
                raise FormatError(what, where=f"item {number}, {name}", advice=advice)


def _impossible(item: MissionItem, name: str, value: float, mission_type: MissionType) -> str | None:
    if math.isinf(value):
        return f"{value} is not a number"
    if not item.has_position or item.command in WITHOUT_POSITION:
        return None
    if name in _LARGEST_DEGREES and not abs(value) <= _LARGEST_DEGREES[name]:
        largest = _LARGEST_DEGREES[name]
        return f"the {_NAMES[name]} must be between -{largest:g} and {largest:g}, not {value}"
    if name == "alt_m" and math.isnan(value) and mission_type is not MissionType.FENCE:  # a fence has no heights
        return "NaN is not a valid height"
    return None


def fence_problems(fence: Fence) -> tuple[str, ...]:
    """Fence polygons that cross themselves or have no area, which ArduPilot accepts silently."""
    import shapely  # loads as slowly as the rest of the package, which also works without it

    found = []
    for number, polygon in enumerate(fence.polygons):
        if (
            not all(math.isfinite(v.lat_deg) and math.isfinite(v.lon_deg) for v in polygon.vertices)
            or len(polygon.vertices) < 3
        ):
            continue  # the items say so themselves
        west_deg = polygon.vertices[0].lon_deg  # longitudes from here, so that a ring may cross the 180th meridian
        ring = shapely.Polygon([(math.remainder(v.lon_deg - west_deg, 360.0), v.lat_deg) for v in polygon.vertices])
        if not ring.is_valid:
            reason = shapely.is_valid_reason(ring).split("[")[0].strip().lower()
            found.append(f"fence polygon {number} crosses or touches itself ({reason}); draw it again")
    return tuple(found)


def _list_problems(items: Sequence[MissionItem], mission_type: MissionType, autopilot: Autopilot) -> Iterator[Problem]:
    try:
        if mission_type is MissionType.RALLY:
            rally_from_items(items)
            return
        fence = fence_from_items(items)
    except FormatError as error:
        yield Problem(None, "", str(error))
        return
    yield from (Problem(None, "", what) for what in fence_problems(fence))
    for number, polygon in enumerate(fence.polygons):
        lon_deg = [vertex.lon_deg for vertex in polygon.vertices]
        if not autopilot.fences_cross_180 and max(lon_deg) - min(lon_deg) > 180.0:
            what = f"fence polygon {number} crosses the 180th meridian, but {autopilot.name} compares longitudes as numbers"
            yield Problem(None, "", f"{what}; keep the fence on one side of it")


def _item_problems(item: MissionItem, autopilot: Autopilot, count: int) -> list[tuple[str, str]]:
    found = list(_frame_problems(item, autopilot))
    nan_allowed = autopilot.nan_allowed.get(item.command, autopilot.nan_allowed.get(0, frozenset()))
    for number, value in enumerate(item.params, start=1):
        if math.isnan(value) and number not in nan_allowed:
            found.append((f"param{number}", f"{autopilot.name} does not accept NaN here; use a number"))
    for name, value in item.values():
        if math.isinf(value) or abs(value) > _LARGEST_FLOAT32:
            found.append((name, f"{value} cannot be sent; use a finite number"))
        elif (changed := _change_in_storage(item, autopilot, name, value)) is not None:
            found.append((name, changed))
    if math.isnan(item.alt_m):
        found.append(("alt_m", "is not a number; specify a height in metres"))
    if item.has_position:
        if not -90.0 <= item.lat_deg <= 90.0:
            found.append(("lat_deg", f"latitude must be between -90 and 90, not {item.lat_deg}"))
        if not -180.0 <= item.lon_deg <= 180.0:
            found.append(("lon_deg", f"longitude must be between -180 and 180, not {item.lon_deg}"))
    elif not (item.lat_deg.is_integer() and item.lon_deg.is_integer()):
        found.append(("", "parameters 5 and 6 of a command without a position are sent as whole numbers"))
    return found + _meaning_problems(item, range(int(autopilot.home_in_item_0), count))


def _change_in_storage(item: MissionItem, autopilot: Autopilot, name: str, value: float) -> str | None:
    """The problem with a number that the autopilot would return changed, beyond its changes by design."""
    rule = autopilot.rule_for(item, name)
    if rule is None or math.isnan(value):
        return None
    stored = rule.store(value)
    return f"{value:g} would become {stored:g}: {rule.why}" if abs(stored - value) > rule.largest_change else None


def _meaning_problems(item: MissionItem, to_fly: range) -> list[tuple[str, str]]:
    """Values that have no meaning; ``to_fly`` are the numbers of the items that can be jumped to."""
    first, second = item.params[:2]
    if item.command in (Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TIME) and first < 0:
        return [("param1", f"the hold time is {first:g} s, but must not be negative")]
    if item.command == Command.NAV_WAYPOINT and first > _LONGEST_HOLD_S:
        return [("param1", f"the hold time is {first:g} s, but the maximum is {_LONGEST_HOLD_S} s")]
    if item.command == Command.NAV_DELAY and first < 0 and all(value < 0 for value in item.params[1:]):
        return [("param1", f"the delay is {first:g} s without a time of day, but must not be negative")]
    if item.command == Command.DO_JUMP and first not in to_fly:
        return [
            ("param1", f"the jump leads to item {first:g}, but the list has items {to_fly.start} to {to_fly.stop - 1}")
        ]
    if item.command == Command.DO_CHANGE_SPEED and not (second > 0 or second in (-1, -2)):
        return [("param2", f"the speed must be greater than 0, not {second:g} m/s")]
    if item.command == Command.DO_SET_CAM_TRIGG_DIST and first < 0:
        return [("param1", f"the distance is {first:g} m; use 0 to stop triggering, or a distance above 0")]
    return []


def _frame_problems(item: MissionItem, autopilot: Autopilot) -> list[tuple[str, str]]:
    if item.command in WITHOUT_POSITION or not item.has_position:
        if item.frame not in autopilot.position_free_frames:
            return [("frame", f"{autopilot.name} accepts this command only in frame 2 (no position)")]
    elif item.frame not in autopilot.frames:
        return [
            ("frame", f"{autopilot.name} does not accept heights in frame {item.frame.name}; use ABOVE_HOME or AMSL")
        ]
    return []


# A vehicle's acceptance of the items that it receives, as each autopilot decides it.

_INVALID_PARAMS = (
    MissionResult.INVALID_PARAM1,
    MissionResult.INVALID_PARAM2,
    MissionResult.INVALID_PARAM3,
    MissionResult.INVALID_PARAM4,
)


def refusal_of(message: MissionItemInt | MissionItemFloat, autopilot: Autopilot) -> MissionResult | None:
    """The result with which the autopilot refuses an item; None when it accepts it.

    PX4 checks only the frame, ArduPilot the numbers as well. Neither checks the meaning of the mission.
    """
    try:
        item = item_from_message(message)
    except FormatError:
        return MissionResult.UNSUPPORTED_FRAME
    if item.frame is Frame.COMMAND or item.command in WITHOUT_POSITION:
        if item.frame not in autopilot.position_free_frames:
            return MissionResult.UNSUPPORTED
    elif item.frame not in autopilot.frames:
        return MissionResult.UNSUPPORTED_FRAME
    if not autopilot.refuses_bad_numbers:
        return None
    nan_allowed = autopilot.nan_allowed.get(item.command, autopilot.nan_allowed.get(0, frozenset()))
    for number, value in enumerate(item.params, start=1):
        if not math.isfinite(value) and not (math.isnan(value) and number in nan_allowed):
            return _INVALID_PARAMS[number - 1]
    if item.has_position and not abs(item.lat_deg) <= 90.0:
        return MissionResult.INVALID_PARAM5_X
    if item.has_position and not abs(item.lon_deg) <= 180.0:
        return MissionResult.INVALID_PARAM6_Y
    return None if math.isfinite(item.alt_m) else MissionResult.INVALID_PARAM7


def list_is_whole(items: tuple[MissionItem, ...], mission_type: MissionType) -> bool:
    """Whether a complete list is valid: polygons with enough vertices, circles with a radius."""
    try:
        if mission_type is MissionType.FENCE:
            fence_from_items(items)
        elif mission_type is MissionType.RALLY:
            rally_from_items(items)
    except FormatError:
        return False
    return True
