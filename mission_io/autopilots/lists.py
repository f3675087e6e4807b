"""The three lists a vehicle keeps (mission, fence, rally points) and the item lists that represent them on the wire."""

from collections.abc import Sequence
from typing import TypeAlias

from mission_io.autopilots.autopilot import Autopilot, mission_from_wire, wire_items
from mission_io.model.areas import (
    Fence,
    RallyPoints,
    fence_from_items,
    items_from_fence,
    items_from_rally,
    rally_from_items,
)
from mission_io.model.items import Mission, MissionItem, MissionType

MissionList: TypeAlias = Mission | Fence | RallyPoints


def mission_type_of(mission_list: MissionList) -> MissionType:
    """The type of a mission list."""
    if isinstance(mission_list, Mission):
        return MissionType.MISSION
    return MissionType.FENCE if isinstance(mission_list, Fence) else MissionType.RALLY


def items_of(mission_list: MissionList, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """The items of a mission list as sent to an autopilot.

    Raises:
        FormatError: an invalid fence polygon or circle.
    """
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
