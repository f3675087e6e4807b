"""Mission items to MISSION_ITEM_INT messages and back, and to the files that ArduPilot keeps its lists in."""

import struct
from collections.abc import Sequence
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


# ArduPilot's lists as files of its file system: ``@MISSION/mission.dat``, ``fence.dat`` and ``rally.dat``.
#
# Little-endian: magic number 0x763d, type of the list, options, number of the first item, number of items (16 bits each), then
# for each item the payload of its MISSION_ITEM_INT, 38 bytes. The numbers, targets and types in these are not filled in: the
# place in the file counts.
#
# It takes a list back when a file that was written is closed (AP_Filesystem_Mission.cpp): the size has to agree with the number
# of items, and none may be all zero. Whether it took it is never said, a refused item ends a mission there with the old one
# gone, and what is read afterwards differs from what was written (home, zeros in fields that a command does not have), so that
# a CRC never agrees. Hence ``FileUploads.upload_list`` reads back item by item.

_MAGIC = 0x763D
_HEAD = struct.Struct("<5H")
_ITEM = struct.Struct("<4f2if2H6B")


def dat_path(mission_type: MissionType) -> str:
    """Where ArduPilot has a list."""
    return f"@MISSION/{mission_type.name.lower()}.dat"


def read_mission_dat(content: bytes, mission_type: MissionType) -> list[MissionItem]:
    """The items of a file, as an item-by-item download gives them.

    Raises:
        FormatError: it is no such file, of another list, or not whole.
    """
    if len(content) < _HEAD.size:
        raise FormatError(f"the file has {len(content)} bytes, but the header of an ArduPilot list has {_HEAD.size}")
    magic, kind, _, start, count = _HEAD.unpack_from(content)
    if magic != _MAGIC:
        raise FormatError(f"not an ArduPilot list, because it begins with {magic:#06x} instead of {_MAGIC:#06x}")
    if kind != mission_type:
        raise FormatError(
            f"the file contains a list of type {kind}, not {mission_type.value} ({mission_type.name.lower()})"
        )
    if start != 0:
        raise FormatError(f"the file contains only a part of a list, which begins at item {start}")
    size = len(content) - _HEAD.size
    if size != count * _ITEM.size:
        raise FormatError(
            f"the header announces {count} items ({count * _ITEM.size} bytes), but {size} bytes follow",
            advice="download the file again",
        )
    items = []
    for seq, fields in enumerate(_ITEM.iter_unpack(content[_HEAD.size :])):
        p1, p2, p3, p4, x, y, z, _, command, _, _, frame, current, autocontinue, _ = fields
        items.append(
            item_from_message(
                MissionItemInt(
                    0, 0, seq, frame, command, (p1, p2, p3, p4), x, y, z, current, autocontinue, mission_type
                )
            )
        )
    return items


def write_mission_dat(items: Sequence[MissionItem], mission_type: MissionType) -> bytes:
    """The file of a list. Raises MisuseError: a coordinate that does not fit."""
    out = [_HEAD.pack(_MAGIC, mission_type, 0, 0, len(items))]
    for seq, item in enumerate(items):
        m = message_from_item(item, seq, mission_type=mission_type, target_system=0, target_component=0)
        out.append(
            _ITEM.pack(*m.params, m.x, m.y, m.z, seq, m.command, 0, 0, m.frame, m.current, m.autocontinue, mission_type)
        )
    return b"".join(out)
