"""ArduPilot's terrain files: one ``.DAT`` for a degree, 2,048 bytes for each block of the terrain grid.

A block is little-endian: bitmap of its parts (64 bits), latitude and longitude of its corner (1e-7 degrees), CRC-16 of the 1,821
bytes that are used with this field 0, format version, spacing, 28 rows of 32 heights in metres, the block's numbers to the
north and east, longitude and latitude of the degree. What is not filled is zero. Blocks lie row by row, south to north.
"""

import binascii
import struct
from collections.abc import Mapping

from mission_io.autopilots.terrain_grid import (
    COLUMNS,
    PART_COUNT,
    PART_SIDE,
    PARTS_EAST,
    ROWS,
    Part,
    TerrainBlock,
    blocks_east,
)
from mission_io.errors import MisuseError

BLOCK_BYTES = 2048
_VERSION = 1
_HEAD, _TAIL = struct.Struct("<QiiHHH"), struct.Struct("<HHhb")
_HEIGHTS = struct.Struct(f"<{ROWS * COLUMNS}h")


def dat_name(south_deg: int, west_deg: int) -> str:
    """The file that ArduPilot keeps a degree in, such as ``S34W071.DAT``."""
    return f"{'S' if south_deg < 0 else 'N'}{abs(south_deg):02d}{'W' if west_deg < 0 else 'E'}{abs(west_deg):03d}.DAT"


def dat_bytes(blocks: Mapping[TerrainBlock, tuple[Part | None, ...]]) -> bytes:
    """The file of a degree.

    Args:
        blocks: The parts of each block, in the order of their numbers; None for those that are unknown. Blocks of which all
            is unknown are left out, and the autopilot requests them.

    Raises:
        MisuseError: blocks of several degrees or spacings, or none.
    """
    if len({(block.south_deg, block.west_deg, block.spacing_m) for block in blocks}) != 1:
        raise MisuseError("a terrain file has the blocks of one degree at one spacing")
    data = bytearray()
    for block, parts in blocks.items():
        if all(part is None for part in parts):
            continue
        at = BLOCK_BYTES * (blocks_east(block.south_deg, block.spacing_m) * block.north + block.east)
        data.extend(bytes(max(0, at + BLOCK_BYTES - len(data))))
        data[at : at + BLOCK_BYTES] = _block_bytes(block, parts)
    return bytes(data)


def _block_bytes(block: TerrainBlock, parts: tuple[Part | None, ...]) -> bytes:
    if len(parts) != PART_COUNT:
        raise MisuseError(f"a terrain block has {PART_COUNT} parts, not {len(parts)}")
    bitmap = sum(1 << number for number, part in enumerate(parts) if part is not None)
    heights = [0] * (ROWS * COLUMNS)
    for number, part in enumerate(parts):
        row, column = number // PARTS_EAST * PART_SIDE, number % PARTS_EAST * PART_SIDE
        for line in range(PART_SIDE if part is not None else 0):
            start = (row + line) * COLUMNS + column
            heights[start : start + PART_SIDE] = part[line * PART_SIDE : (line + 1) * PART_SIDE]  # type: ignore[index]

    def packed(crc: int) -> bytes:
        head = _HEAD.pack(bitmap, *block.corner_e7, crc, _VERSION, block.spacing_m)
        return head + _HEIGHTS.pack(*heights) + _TAIL.pack(block.north, block.east, block.west_deg, block.south_deg)

    return packed(binascii.crc_hqx(packed(0), 0)).ljust(BLOCK_BYTES, b"\0")
