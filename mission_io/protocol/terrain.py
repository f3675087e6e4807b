"""Terrain heights for ArduPilot: the grid it keeps them in, its files, and the answers to its requests.

The grid has blocks of 28 by 32 heights in 7 by 8 parts of 4 by 4. Each whole degree of latitude and longitude has a grid of its
own, counted in metres north and east from its south-west corner. Neighbouring blocks overlap by one part, so that every place
lies inside one block. Metres become degrees by ArduPilot's ``Location``: a sphere, single-precision factors, and the longitude
scale half-way between the two latitudes.
"""

import binascii
import math
import struct
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mission_io.errors import MisuseError
from mission_io.protocol.timing import VALUES
from mission_io.wire.messages import Message, Received
from mission_io.wire.telemetry_messages import TerrainData, TerrainRequest

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

Position = tuple[float, float]
"""Latitude and longitude in degrees."""

Heights = Callable[[Sequence[Position]], Sequence[float]]
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

    def position(self, row: int, column: int) -> Position:
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
class PositionInBlock:
    """A position by its block, and the rows and columns from the block's corner, with fractions."""

    block: TerrainBlock
    row: float
    column: float


def position_in_block(lat_deg: float, lon_deg: float, spacing_m: int) -> PositionInBlock:
    """The block in which ArduPilot looks up a position."""
    lat_e7, lon_e7 = round(lat_deg * _DEGREE_E7), round(lon_deg * _DEGREE_E7)
    south, west = lat_e7 // _DEGREE_E7, lon_e7 // _DEGREE_E7
    north_m = (lat_e7 - south * _DEGREE_E7) * _M_PER_E7
    scale = _longitude_scale(0.5 * (lat_e7 + south * _DEGREE_E7) / _DEGREE_E7)
    east_m = (lon_e7 - west * _DEGREE_E7) * _M_PER_E7 * scale
    row, column = north_m / spacing_m, east_m / spacing_m
    block = TerrainBlock(south, west, math.floor(row / STEP_NORTH), math.floor(column / STEP_EAST), spacing_m)
    return PositionInBlock(block, row - block.north * STEP_NORTH, column - block.east * STEP_EAST)


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


def positions_of_block(lat_deg: float, lon_deg: float, spacing_m: int) -> list[Position]:
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
        return [block.position(row, column) for row, column in at]
    return [_from_corner(lat_deg, lon_deg, row * spacing_m, column * spacing_m) for row, column in at]


def parts_of_block(positions: Sequence[Position], heights_amsl_m: Heights) -> tuple[Part | None, ...]:
    """Heights of a block's positions in whole metres, part by part; None for a part with an unknown height."""
    on_earth = [position for position in positions if abs(position[0]) <= 90.0]
    known = dict(zip(on_earth, heights_amsl_m(on_earth), strict=True)) if on_earth else {}
    return tuple(
        _part([known.get(position, math.nan) for position in positions[i : i + 16]])
        for i in range(0, len(positions), 16)
    )


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


def _from_corner(lat_deg: float, lon_deg: float, north_m: float, east_m: float) -> Position:
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
        blocks: The parts of each block, in the order of their numbers; None for those that are unknown. Blocks of which all is
            unknown are omitted, and the autopilot requests them.

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


# A ground station's answers to TERRAIN_REQUEST: the heights of the requested parts, as far as they are known.
#
# Sans-IO: requests go in, messages come out, and the clock is an argument. Only a bounded number of blocks waits; a vehicle
# requests what it lacks again every two seconds.

_MAX_REMEMBERED = 100 * VALUES.max_waiting

_Key = tuple[float, float, int]
"""A block as it is requested: latitude and longitude of its corner, and spacing."""


@dataclass(frozen=True, slots=True)
class TerrainCounts:
    """Counts of the requests by their outcome."""

    requests: int = 0  # requests that arrived
    blocks: int = 0  # different blocks that were requested
    blocks_incomplete: int = 0  # those of them with heights that are not known
    parts_sent: int = 0  # parts that were sent, again where they were requested again
    parts_unknown: int = 0  # requested parts that were not sent because a height in them is not known
    refused: int = 0  # requests that make no sense
    crowded_out: int = 0  # requests that were dropped because too many blocks were waiting


class TerrainAnswers:
    """Answers a vehicle's requests for terrain heights.

    Heights are rounded to the nearest metre, which is what TERRAIN_DATA carries. A part with an unknown height is not sent.

    Args:
        heights_amsl_m: The ground.
        parts_per_s: Parts sent in a second, 55 bytes each: the default takes a third of a radio with 57,600 baud.
        say: Receives a message at the first requests that could not be answered.

    Raises:
        MisuseError: a rate that is not above 0.
    """

    def __init__(
        self, heights_amsl_m: Heights, *, parts_per_s: float = 35.0, say: Callable[[str], None] | None = None
    ) -> None:
        if not 0.0 < parts_per_s < math.inf:
            raise MisuseError(f"parts_per_s must be greater than 0, not {parts_per_s}")
        self._heights, self._interval_s = heights_amsl_m, 1.0 / parts_per_s
        self._print = say
        self._due_s = -math.inf
        self._waiting: dict[_Key, int] = {}
        self._parts: dict[_Key, tuple[Part | None, ...]] = {}
        self._met: set[_Key] = set()
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> TerrainCounts:
        """Counts of the requests by their outcome."""
        return TerrainCounts(**self._counts)

    def receive(self, received: Received, now: float) -> None:
        """Take a message of the vehicle; anything but a TERRAIN_REQUEST is ignored."""
        request = received.message
        if not isinstance(request, TerrainRequest):
            return
        self._counts["requests"] += 1
        mask = request.mask & ALL_PARTS
        if not (abs(request.lat_deg) <= 90.0 and abs(request.lon_deg) <= 180.0 and request.spacing_m > 0 and mask):
            self._count_and_tell(
                "refused",
                f"an invalid request for terrain heights was not answered: latitude {request.lat_deg:g}, longitude "
                f"{request.lon_deg:g}, spacing {request.spacing_m} m, mask {request.mask:#x}",
            )
            return
        key = (request.lat_deg, request.lon_deg, request.spacing_m)
        if key not in self._waiting and len(self._waiting) >= VALUES.max_waiting:
            self._counts["crowded_out"] += 1
            return
        if not self._waiting:
            self._due_s = max(self._due_s, now)
        self._waiting[key] = mask

    def messages_to_send(self, now: float) -> list[Message]:
        """Messages due: a part each ``1 / parts_per_s`` seconds while some wait; an unknown block takes a turn."""
        due: list[Message] = []
        self._due_s = max(self._due_s, now - VALUES.latest_s)
        while self._waiting and now >= self._due_s:
            self._due_s += self._interval_s
            due += self._next_part(next(iter(self._waiting)))
        return due

    def next_timer(self) -> float | None:
        """When the next part is due; None while nothing is waiting."""
        return self._due_s if self._waiting else None

    def _next_part(self, key: _Key) -> list[TerrainData]:
        """The next part of a block that is known; empty when no more of them is."""
        parts, mask = self._parts_of(key), self._waiting[key]
        found: list[TerrainData] = []
        for part in range(PART_COUNT):
            if found or not mask >> part & 1:
                continue
            mask &= ~(1 << part)
            heights = parts[part]
            if heights is None:
                self._counts["parts_unknown"] += 1
            else:
                self._counts["parts_sent"] += 1
                found.append(TerrainData(*key, part, heights))
        if mask:
            self._waiting[key] = mask
        else:
            del self._waiting[key]
        return found

    def _parts_of(self, key: _Key) -> tuple[Part | None, ...]:
        """The heights of a block; computed at its turn, and kept for the next request."""
        parts = self._parts.get(key)
        if parts is None:
            if len(self._parts) >= VALUES.max_waiting:
                del self._parts[next(iter(self._parts))]
            parts = self._parts[key] = parts_of_block(positions_of_block(*key), self._heights)
            self._meet(key, sum(part is None for part in parts))
        return parts

    def _meet(self, key: _Key, lacking: int) -> None:
        """Note a block the first time; a flood of them fills no memory, and the oldest are then counted again."""
        if key in self._met:
            return
        if len(self._met) >= _MAX_REMEMBERED:
            self._met.clear()
        self._met.add(key)
        self._counts["blocks"] += 1
        if lacking:
            self._count_and_tell(
                "blocks_incomplete",
                f"no elevation data for {lacking} of the {PART_COUNT} parts of the terrain block that begins at "
                f"latitude {key[0]:.5f}, longitude {key[1]:.5f} (grid spacing {key[2]} m), so they are not sent, and "
                "the vehicle keeps waiting for them",
            )

    def _count_and_tell(self, kind: str, text: str) -> None:
        self._counts[kind] += 1
        if self._print is not None and self._counts[kind] <= VALUES.reported_blocks:
            self._print(text)
