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


def mission_type_of(content: MissionList) -> MissionType:
    """Which of a vehicle's lists some content belongs into."""
    if isinstance(content, Mission):
        return MissionType.MISSION
    return MissionType.FENCE if isinstance(content, Fence) else MissionType.RALLY


def items_of(content: MissionList, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """The items of some content as they are sent to an autopilot.

    Raises:
        FormatError: a fence polygon or circle that is none.
    """
    if isinstance(content, Mission):
        return wire_items(content, autopilot)
    return items_from_fence(content) if isinstance(content, Fence) else items_from_rally(content)


def mission_list_of(mission_type: MissionType, items: Sequence[MissionItem], autopilot: Autopilot) -> MissionList:
    """What an autopilot's item list stands for; the inverse of ``items_of``.

    Raises:
        FormatError: items that do not belong in such a list.
    """
    if mission_type is MissionType.MISSION:
        return mission_from_wire(items, autopilot)
    return fence_from_items(items) if mission_type is MissionType.FENCE else rally_from_items(items)
