"""ArduPilot's lists as files of its file system: ``@MISSION/mission.dat``, ``fence.dat`` and ``rally.dat``.

Little-endian: magic number 0x763d, type of the list, options, number of the first item, number of items (16 bits each), then for
each item the payload of its MISSION_ITEM_INT, 38 bytes. The numbers, targets and types in these are not filled in: the place in
the file counts.

It takes a list back when a file that was written is closed (AP_Filesystem_Mission.cpp): the size has to agree with the number
of items, and none may be all zero. Whether it took it is never said, a refused item ends a mission there with the old one gone,
and what is read afterwards differs from what was written (home, zeros in fields that a command does not have), so that a CRC
never agrees. Hence ``mission_io.client.files.FileUploads.upload_list`` reads back item by item.
"""

import struct
from collections.abc import Sequence

from mission_io.errors import FormatError
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.messages import MissionItemInt
from mission_io.wire.mission_items import item_from_message, message_from_item

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
