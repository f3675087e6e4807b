"""ArduPilot's grid of terrain heights: blocks of 28 by 32 heights in 7 by 8 parts of 4 by 4.

Each whole degree of latitude and longitude has a grid of its own, counted in metres north and east from its south-west corner.
Neighbouring blocks overlap by one part, so that every place lies inside one block. Metres become degrees by ArduPilot's
``Location``: a sphere, single-precision factors, and the longitude scale half-way between the two latitudes.
"""

import binascii
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mission_io.errors import MisuseError

PART_SIDE = 4
PARTS_NORTH, PARTS_EAST = 7, 8
PART_COUNT = PARTS_NORTH * PARTS_EAST
ROWS, COLUMNS = PARTS_NORTH * PART_SIDE, PARTS_EAST * PART_SIDE
ALL_PARTS = (1 << PART_COUNT) - 1
"""The mask of a whole block."""

STEP_NORTH, STEP_EAST = (PARTS_NORTH - 1) * PART_SIDE, (PARTS_EAST - 1) * PART_SIDE
"""Heights from one block's corner to the next one's."""

DEFAULT_SPACING_M = 100
"""TERRAIN_SPACING as ArduPilot comes."""

_DEGREE_E7 = 10_000_000
_M_PER_E7 = 0.011131884530186653
_E7_PER_M = 89.83204650878906
"""LOCATION_SCALING_FACTOR and its inverse, 0.011131884502145034 and 89.83204953368922, in single precision."""
_LEAST_SCALE = 0.01
_CORNER_MARGIN_E7 = 50
"""Corners of one block reckoned in single and in double precision differ by less; 50 is half a metre."""

_LOWEST_M, _HIGHEST_M = -32768, 32767

Place = tuple[float, float]
"""Latitude and longitude in degrees."""

Heights = Callable[[Sequence[Place]], Sequence[float]]
"""Heights of the ground above mean sea level in metres, at places; NaN where unknown."""

Part = tuple[int, ...]
"""16 heights in whole metres: 4 to the east, then the next row to the north."""


@dataclass(frozen=True, slots=True)
class TerrainBlock:
    """One block of the grid."""

    south_deg: int  # latitude of the whole degree that the block is counted from
    west_deg: int  # longitude of that degree
    north: int  # the block's number from the degree's corner to the north
    east: int  # the block's number from there to the east
    spacing_m: int  # distance of neighbouring heights

    @property
    def corner_e7(self) -> tuple[int, int]:
        """Latitude and longitude of the south-west corner, in 1e-7 degrees as ArduPilot reckons it."""
        return _shifted_e7(
            self.south_deg, self.west_deg,
            float(self.north * STEP_NORTH * self.spacing_m), float(self.east * STEP_EAST * self.spacing_m),
        )  # fmt: skip

    def place(self, row: int, column: int) -> Place:
        """Where the autopilot takes the height of a row and a column to be.

        ArduPilot looks heights up from the degree's corner, so they are placed from there. Places counted from the block's own
        corner, as other ground stations do it, are up to 50 m off in the east of a degree.
        """
        north_m = (self.north * STEP_NORTH + row) * self.spacing_m
        east_m = (self.east * STEP_EAST + column) * self.spacing_m
        lat_deg = self.south_deg + north_m / (_M_PER_E7 * _DEGREE_E7)
        scale = _longitude_scale(0.5 * (self.south_deg + lat_deg))
        return lat_deg, wrapped_deg(self.west_deg + east_m / (_M_PER_E7 * _DEGREE_E7 * scale))


@dataclass(frozen=True, slots=True)
class PlaceInBlock:
    """A position by its block, and the rows and columns from the block's corner, with fractions."""

    block: TerrainBlock
    row: float
    column: float


def place_in_block(lat_deg: float, lon_deg: float, spacing_m: int) -> PlaceInBlock:
    """The block in which ArduPilot looks up a position."""
    lat_e7, lon_e7 = round(lat_deg * _DEGREE_E7), round(lon_deg * _DEGREE_E7)
    south, west = lat_e7 // _DEGREE_E7, lon_e7 // _DEGREE_E7
    north_m = (lat_e7 - south * _DEGREE_E7) * _M_PER_E7
    scale = _longitude_scale(0.5 * (lat_e7 + south * _DEGREE_E7) / _DEGREE_E7)
    east_m = (lon_e7 - west * _DEGREE_E7) * _M_PER_E7 * scale
    row, column = north_m / spacing_m, east_m / spacing_m
    block = TerrainBlock(south, west, math.floor(row / STEP_NORTH), math.floor(column / STEP_EAST), spacing_m)
    return PlaceInBlock(block, row - block.north * STEP_NORTH, column - block.east * STEP_EAST)


def block_with_corner(lat_deg: float, lon_deg: float, spacing_m: int) -> TerrainBlock | None:
    """The block whose corner this is; None for a position that is no corner of the grid.

    South of the equator the last blocks of a degree begin some metres east of it.
    """
    lat_e7, lon_e7 = round(lat_deg * _DEGREE_E7), round(lon_deg * _DEGREE_E7)
    south = lat_e7 // _DEGREE_E7
    north = round((lat_e7 - south * _DEGREE_E7) * _M_PER_E7 / (STEP_NORTH * spacing_m))
    for west in (lon_e7 // _DEGREE_E7, lon_e7 // _DEGREE_E7 - 1):
        scale = _longitude_scale(0.5 * (lat_e7 + south * _DEGREE_E7) / _DEGREE_E7)
        east = round((lon_e7 - west * _DEGREE_E7) * _M_PER_E7 * scale / (STEP_EAST * spacing_m))
        block = TerrainBlock(south, -180 + (west + 180) % 360, north, east, spacing_m)
        corner = block.corner_e7
        off_lon_e7 = (corner[1] - lon_e7 + 180 * _DEGREE_E7) % (360 * _DEGREE_E7) - 180 * _DEGREE_E7
        if abs(corner[0] - lat_e7) <= _CORNER_MARGIN_E7 and abs(off_lon_e7) <= _CORNER_MARGIN_E7:
            return block
    return None


def places_of_block(lat_deg: float, lon_deg: float, spacing_m: int) -> list[Place]:
    """The 896 positions of the block with this corner, part by part, in the order of a part's heights.

    Firmware from before 2021 has other corners; the places of such a block are counted from its own corner.
    """
    block = block_with_corner(lat_deg, lon_deg, spacing_m)
    at = [
        (part // PARTS_EAST * PART_SIDE + row, part % PARTS_EAST * PART_SIDE + column)
        for part in range(PART_COUNT)
        for row in range(PART_SIDE)
        for column in range(PART_SIDE)
    ]
    if block is not None:
        return [block.place(row, column) for row, column in at]
    return [_from_corner(lat_deg, lon_deg, row * spacing_m, column * spacing_m) for row, column in at]


def parts_of_block(places: Sequence[Place], heights_amsl_m: Heights) -> tuple[Part | None, ...]:
    """Heights of a block's positions in whole metres, part by part; None for a part with an unknown height."""
    on_earth = [place for place in places if abs(place[0]) <= 90.0]
    known = dict(zip(on_earth, heights_amsl_m(on_earth), strict=True)) if on_earth else {}
    return tuple(_part([known.get(place, math.nan) for place in places[i : i + 16]]) for i in range(0, len(places), 16))


def _part(heights_m: Sequence[float]) -> Part | None:
    if not all(_LOWEST_M <= height <= _HIGHEST_M for height in heights_m):  # NaN neither
        return None
    return tuple(round(height) for height in heights_m)


def blocks_east(south_deg: int, spacing_m: int) -> int:
    """Blocks from west to east in the file of a degree; ArduPilot leaves two more than it needs."""
    corner_e7 = south_deg * _DEGREE_E7
    room_m = float(2 * spacing_m * COLUMNS)
    width_e7 = _DEGREE_E7 + int(room_m * _E7_PER_M / _longitude_scale(corner_e7 / _DEGREE_E7))
    return int(width_e7 * _M_PER_E7 * _longitude_scale(corner_e7 / _DEGREE_E7) / (spacing_m * STEP_EAST))


def _from_corner(lat_deg: float, lon_deg: float, north_m: float, east_m: float) -> Place:
    north_deg = lat_deg + north_m / (_M_PER_E7 * _DEGREE_E7)
    scale = _longitude_scale(0.5 * (lat_deg + north_deg))
    return north_deg, wrapped_deg(lon_deg + east_m / (_M_PER_E7 * _DEGREE_E7 * scale))


def wrapped_deg(lon_deg: float) -> float:
    """The same longitude from -180 to below 180."""
    return lon_deg if -180.0 <= lon_deg < 180.0 else (lon_deg + 180.0) % 360.0 - 180.0


def _shifted_e7(south_deg: int, west_deg: int, north_m: float, east_m: float) -> tuple[int, int]:
    """The position at an offset in metres from a degree's corner, in 1e-7 degrees; ArduPilot truncates."""
    south, west = south_deg * _DEGREE_E7, west_deg * _DEGREE_E7
    off_lat = int(north_m * _E7_PER_M)
    off_lon = int(east_m * _E7_PER_M / _longitude_scale((south + off_lat / 2) / _DEGREE_E7))
    lon = west + off_lon
    return south + off_lat, lon - 360 * _DEGREE_E7 if lon > 180 * _DEGREE_E7 else lon


def _longitude_scale(lat_deg: float) -> float:
    return max(_LEAST_SCALE, math.cos(math.radians(lat_deg)))


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
        raise MisuseError("a terrain file must contain the blocks of one degree at one spacing")
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
        raise MisuseError(f"a terrain block must have {PART_COUNT} parts, not {len(parts)}")
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
