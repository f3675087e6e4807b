"""Checks before sending: would the autopilot accept a list of items, and would it understand them as they were meant?

And after receiving: are the items of a vehicle positions on Earth?
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mission_io.autopilots.autopilot import WITHOUT_POSITION, Autopilot
from mission_io.errors import FormatError
from mission_io.model.areas import Fence, LatLon, fence_from_items, rally_from_items
from mission_io.model.items import Command, MissionItem, MissionType

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
    what: str  # what is wrong and what to do

    def __str__(self) -> str:
        """One line for people."""
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
    if mission_type is MissionType.MISSION and autopilot.home_in_item_0 and items:
        problems.extend(_home_problems(items[0], autopilot))
    for number, item in enumerate(items):
        problems.extend(Problem(number, name, what) for name, what in _item_problems(item, autopilot, len(items)))
    if mission_type is not MissionType.MISSION:
        problems.extend(_list_problems(items, mission_type))
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
        if not all(_is_place(vertex) for vertex in polygon.vertices) or len(polygon.vertices) < 3:
            continue  # the items say so themselves
        ring = shapely.Polygon([(vertex.lon_deg, vertex.lat_deg) for vertex in polygon.vertices])
        if not ring.is_valid:
            reason = shapely.is_valid_reason(ring).split("[")[0].strip().lower()
            found.append(f"fence polygon {number} crosses or touches itself ({reason}); draw it again")
    return tuple(found)


def _is_place(vertex: LatLon) -> bool:
    return math.isfinite(vertex.lat_deg) and math.isfinite(vertex.lon_deg)


def _list_problems(items: Sequence[MissionItem], mission_type: MissionType) -> Iterator[Problem]:
    try:
        if mission_type is MissionType.RALLY:
            rally_from_items(items)
            return
        fence = fence_from_items(items)
    except FormatError as error:
        yield Problem(None, "", str(error))
        return
    yield from (Problem(None, "", what) for what in fence_problems(fence))


def _home_problems(item: MissionItem, autopilot: Autopilot) -> Iterator[Problem]:
    if item.command != Command.NAV_WAYPOINT:
        what = f"{autopilot.name} stores home in item 0, so this command {item.command} would be lost; send home first"
        yield Problem(0, "command", what)


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
