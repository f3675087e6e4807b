"""Mission items to MISSION_ITEM_INT messages and back."""

import struct
from dataclasses import replace

from mission_io.errors import FormatError, MisuseError
from mission_io.model.items import Frame, MissionItem, MissionType
from mission_io.wire.messages import MissionItemFloat, MissionItemInt

DEGREES_SCALE = 1e7
"""Coordinates travel as whole numbers of 1e-7 degrees, about 11 mm of latitude."""

_INT32_LIMIT = 2**31


def message_from_item(
    item: MissionItem, seq: int, *, mission_type: MissionType, target_system: int, target_component: int
) -> MissionItemInt:
    """The message that carries an item.

    Raises:
        MisuseError: coordinates that are not finite or that do not fit 32 bits.
    """
    scale = DEGREES_SCALE if item.has_position else 1.0
    x, y = (
        _int32(value * scale, name, seq) for name, value in (("latitude", item.lat_deg), ("longitude", item.lon_deg))
    )
    return MissionItemInt(
        target_system,
        target_component,
        seq,
        item.frame.wire,
        item.command,
        item.params,
        x,
        y,
        item.alt_m,
        current=int(seq == 0 and mission_type is MissionType.MISSION),
        autocontinue=int(item.autocontinue),
        mission_type=mission_type,
    )


def message_to_send(
    item: MissionItem, seq: int, *, mission_type: MissionType, target_system: int, target_component: int
) -> MissionItemInt:
    """The message that carries an item to a vehicle; errors as ``message_from_item``.

    Rally points have the frames 0 and 3 (and 10), which name the same heights: PX4 1.17 stores frames 5 and 6 of rally points
    and then returns to no place at all ("RTL: unsupported MAV_FRAME": navigator/rtl.cpp, setSafepointAsDestination).
    """
    message = message_from_item(
        item, seq, mission_type=mission_type, target_system=target_system, target_component=target_component
    )
    return replace(message, frame=int(item.frame)) if mission_type is MissionType.RALLY else message


def item_from_message(message: MissionItemInt | MissionItemFloat) -> MissionItem:
    """The item that a message carries.

    Raises:
        FormatError: a frame in which the coordinates mean nothing to mission_io.
    """
    try:
        frame = Frame.from_mav_frame(message.frame)
    except FormatError as error:
        raise FormatError(error.what, where=f"item {message.seq}", advice=error.advice) from None
    scaled = isinstance(message, MissionItemInt) and frame is not Frame.COMMAND
    scale = DEGREES_SCALE if scaled else 1.0
    return MissionItem(
        message.command,
        frame,
        message.params,
        message.x / scale,
        message.y / scale,
        message.z,
        bool(message.autocontinue),
    )


def float_message(message: MissionItemInt) -> MissionItemFloat:
    """The same item in the deprecated form, with 32-bit degrees."""
    scale = 1.0 if message.frame == Frame.COMMAND else DEGREES_SCALE
    return MissionItemFloat(
        message.target_system, message.target_component, message.seq, message.frame, message.command, message.params,
        message.x / scale, message.y / scale, message.z, message.current, message.autocontinue, message.mission_type,
    )  # fmt: skip


def degrees_on_wire(value_deg: float) -> float:
    """The coordinate that arrives when ``value_deg`` is sent."""
    return round(value_deg * DEGREES_SCALE) / DEGREES_SCALE


def float32(value: float) -> float:
    """The number that arrives when ``value`` is sent as a 32-bit float.

    Raises:
        MisuseError: it is beyond the range of 32-bit floats.
    """
    try:
        result: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        raise MisuseError(f"{value} is beyond the range of MAVLink's 32-bit numbers") from None
    return result


def _int32(value: float, name: str, seq: int) -> int:
    if not -_INT32_LIMIT <= value < _INT32_LIMIT:  # also false for NaN
        raise MisuseError(f"item {seq}: the {name} does not fit in a MISSION_ITEM_INT")
    return round(value)
