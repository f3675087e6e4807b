"""An incoming upload, and a vehicle's acceptance of its items, as each autopilot decides it."""

import math
from dataclasses import dataclass, field

from mission_io.autopilots.autopilot import WITHOUT_POSITION, Autopilot
from mission_io.errors import FormatError
from mission_io.model.areas import fence_from_items, rally_from_items
from mission_io.model.enums import MissionResult
from mission_io.model.items import Command, Frame, MissionItem, MissionType
from mission_io.wire.messages import Address, MissionItemFloat, MissionItemInt
from mission_io.wire.mission_items import item_from_message

_INVALID_PARAMS = (
    MissionResult.INVALID_PARAM1,
    MissionResult.INVALID_PARAM2,
    MissionResult.INVALID_PARAM3,
    MissionResult.INVALID_PARAM4,
)


@dataclass(slots=True)
class Incoming:
    """An upload in progress."""

    station: Address  # who sends it
    mission_type: MissionType  # the list
    count: int  # how many items come
    heard_at: float  # when the last one came
    asked_at: float  # when the next one was last asked for
    first: int = 0  # its first item's number; others than 0 where only a part of a list comes
    base: tuple[MissionItem, ...] | None = None  # the list of which a part is written over; None for a whole list
    items: list[MissionItem] = field(default_factory=list)  # those that have come

    @property
    def next_seq(self) -> int:
        """The number of the next item."""
        return self.first + len(self.items)

    @property
    def last(self) -> int:
        """The number of the last item of the list that it makes; a fence does not grow by a part."""
        held = len(self.base or ())
        if self.base is not None and self.mission_type is MissionType.FENCE:
            return held - 1
        return max(held, self.first + self.count) - 1

    def over(self, held: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """The list of the received items."""
        return (*held[: self.first], *self.items, *held[self.next_seq :])


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


def refusal_in_list(
    message: MissionItemInt | MissionItemFloat, autopilot: Autopilot, incoming: Incoming
) -> MissionResult | None:
    """The result with which ArduPilot refuses an item for its list; None when it accepts it.

    Source: MissionItemProtocol_Waypoints::append_item and replace_item, MissionItemProtocol_Fence::append_item.
    """
    if incoming.mission_type is MissionType.FENCE and message.seq > incoming.last:
        return MissionResult.INVALID_SEQUENCE
    jumps = autopilot.refuses_bad_numbers and message.command == Command.DO_JUMP
    return MissionResult.ERROR if jumps and not 1 <= message.params[0] <= incoming.last else None


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
