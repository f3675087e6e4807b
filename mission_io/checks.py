"""Whether an autopilot will take a list of items, and understand it as it was meant, before it is sent."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.areas import fence_from_items, rally_from_items
from mission_io.autopilots import WITHOUT_POSITION, Autopilot
from mission_io.errors import FormatError
from mission_io.items import Command, MissionItem, MissionType

_LARGEST_FLOAT32 = 3.4028234663852886e38
_LONGEST_HOLD_S = 65535
_WHOLE_ITEM_COUNT = 65535


@dataclass(frozen=True, slots=True)
class Problem:
    """Something an autopilot would refuse or misunderstand.

    Attributes:
        item: Number of the item as it goes on the wire, from 0; None when it is about the whole list.
        field: The field it is about; empty for the whole item.
        what: What is wrong and what to do.
    """

    item: int | None
    field: str
    what: str

    def __str__(self) -> str:
        """One line for people."""
        where = "the list" if self.item is None else f"item {self.item}"
        return f"{where}{f', {self.field}' if self.field else ''}: {self.what}"


def check_for_autopilot(
    items: Sequence[MissionItem], autopilot: Autopilot, mission_type: MissionType = MissionType.MISSION
) -> tuple[Problem, ...]:
    """Everything that ``autopilot`` would refuse or silently change the meaning of.

    ``items`` are numbered as they go on the wire, so with home in front for ArduPilot (see ``wire_items``).
    """
    problems: list[Problem] = []
    limit = autopilot.item_limit if autopilot.item_limit is not None else _WHOLE_ITEM_COUNT
    if len(items) > limit:
        problems.append(Problem(None, "", f"{len(items)} items, {autopilot.name} takes {limit}; split the mission"))
    for number, item in enumerate(items):
        problems.extend(Problem(number, name, what) for name, what in _item_problems(item, autopilot))
    if mission_type is not MissionType.MISSION:
        read = fence_from_items if mission_type is MissionType.FENCE else rally_from_items
        try:
            read(items)
        except FormatError as error:
            problems.append(Problem(None, "", str(error)))
    return tuple(problems)


def _item_problems(item: MissionItem, autopilot: Autopilot) -> list[tuple[str, str]]:
    found = list(_frame_problems(item, autopilot))
    nan_allowed = autopilot.nan_allowed.get(item.command, autopilot.nan_allowed.get(0, frozenset()))
    for number, value in enumerate(item.params, start=1):
        if math.isnan(value) and number not in nan_allowed:
            found.append((f"param{number}", f"NaN is not taken by {autopilot.name} here; give a number"))
    for name, value in item.values():
        if math.isinf(value) or abs(value) > _LARGEST_FLOAT32:
            found.append((name, f"{value} cannot be sent; give a finite number"))
    if math.isnan(item.alt_m):
        found.append(("alt_m", "is not a number; give a height in metres"))
    if item.has_position:
        if not -90.0 <= item.lat_deg <= 90.0:
            found.append(("lat_deg", f"latitude {item.lat_deg} is not from -90 to 90"))
        if not -180.0 <= item.lon_deg <= 180.0:
            found.append(("lon_deg", f"longitude {item.lon_deg} is not from -180 to 180"))
    elif not (item.lat_deg.is_integer() and item.lon_deg.is_integer()):
        found.append(("", "parameters 5 and 6 of a command without a position travel as whole numbers"))
    if item.command in (Command.NAV_WAYPOINT, Command.NAV_DELAY) and item.params[0] < 0:
        advice = "ArduPilot would wait for hours" if autopilot.home_in_item_0 else "a wait cannot be negative"
        found.append(("param1", f"a hold of {item.params[0]:g} s; {advice}"))
    elif item.command == Command.NAV_WAYPOINT and item.params[0] > _LONGEST_HOLD_S:
        found.append(("param1", f"a hold of {item.params[0]:g} s is longer than {_LONGEST_HOLD_S} s"))
    return found


def _frame_problems(item: MissionItem, autopilot: Autopilot) -> list[tuple[str, str]]:
    if item.command in WITHOUT_POSITION or not item.has_position:
        if item.frame not in autopilot.position_free_frames:
            return [("frame", f"{autopilot.name} takes this command only in frame 2 (no position)")]
    elif item.frame not in autopilot.frames:
        return [("frame", f"{autopilot.name} does not take heights {item.frame.name}; use ABOVE_HOME or AMSL")]
    return []
