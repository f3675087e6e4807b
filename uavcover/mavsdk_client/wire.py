"""Mission items as MAVSDK's and as ours."""

from collections.abc import Sequence
from typing import Any

from mavsdk.plugins.mission_raw import MissionItem as RawItem

from mission_io.items import MissionItem, MissionType
from mission_io.messages import MissionItemInt
from mission_io.wire import item_from_message, message_from_item


def raw_items(items: Sequence[MissionItem], mission_type: MissionType) -> list[Any]:
    """Items as MAVSDK uploads them: numbered from 0, the first one of a mission current.

    Raises:
        mission_io.errors.MisuseError: coordinates that are not finite or that do not fit 32 bits.
    """
    return [_raw_item(item, seq, mission_type) for seq, item in enumerate(items)]


def items_from_raw(raw: Sequence[Any], mission_type: MissionType) -> tuple[MissionItem, ...]:
    """Items as MAVSDK downloaded them.

    Raises:
        mission_io.errors.FormatError: a frame in which the coordinates mean nothing to mission_io.
    """
    return tuple(
        item_from_message(
            MissionItemInt(
                0,
                0,
                item.seq,
                item.frame,
                item.command,
                (item.param1, item.param2, item.param3, item.param4),
                item.x,
                item.y,
                item.z,
                current=item.current,
                autocontinue=item.autocontinue,
                mission_type=mission_type,
            )
        )
        for item in raw
    )


def _raw_item(item: MissionItem, seq: int, mission_type: MissionType) -> Any:
    message = message_from_item(item, seq, mission_type=mission_type, target_system=0, target_component=0)
    return RawItem(
        seq, message.frame, message.command, message.current, message.autocontinue, *message.params,
        message.x, message.y, message.z, int(mission_type),
    )  # fmt: skip
