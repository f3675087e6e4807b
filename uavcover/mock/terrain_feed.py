"""Terrain heights as ArduPilot obtains them: a grid requested with TERRAIN_REQUEST and answered block by block.

As in ArduPilot's AP_Terrain, a block is 28 by 32 heights in 7 by 8 parts of 4 by 4. Blocks overlap by one part. Their
south-west corners are counted from that of the whole degree, with ArduPilot's metres per degree of longitude.
"""

import math
from collections.abc import Callable, Iterable, Iterator

from mission_io.model.items import Frame, GeoPoint, MissionItem
from mission_io.wire.messages import TerrainData, TerrainReport, TerrainRequest

PART_SIDE = 4
PARTS_NORTH, PARTS_EAST = 7, 8
PART_COUNT = PARTS_NORTH * PARTS_EAST
ALL_PARTS = (1 << PART_COUNT) - 1

METRES_PER_DEGREE = 0.011131884502145034e7
"""ArduPilot's LOCATION_SCALING_FACTOR, for a degree instead of 1e-7 of one."""

Ground = Callable[[float, float], float | None]
"""Height of the ground above mean sea level in metres, at a latitude and a longitude in degrees; None where unknown."""


def block_corner(lat_deg: float, lon_deg: float, spacing_m: int) -> tuple[float, float]:
    """South-west corner (latitude, longitude in degrees) of the block that a place belongs to."""
    south, west = math.floor(lat_deg), math.floor(lon_deg)
    north_m, east_m = offset_m((south, west), (lat_deg, lon_deg))
    step_north_m = (PARTS_NORTH - 1) * PART_SIDE * spacing_m
    step_east_m = (PARTS_EAST - 1) * PART_SIDE * spacing_m
    corner = shifted(
        (south, west), math.floor(north_m / step_north_m) * step_north_m, math.floor(east_m / step_east_m) * step_east_m
    )
    return round(corner[0], 7), round(corner[1], 7)


def part_places(corner: tuple[float, float], spacing_m: int, part: int) -> Iterator[tuple[float, float]]:
    """The 16 places (latitude, longitude in degrees) of a part, in the order of its heights."""
    south = part // PARTS_EAST * PART_SIDE
    west = part % PARTS_EAST * PART_SIDE
    for north in range(PART_SIDE):
        for east in range(PART_SIDE):
            yield shifted(corner, (south + north) * spacing_m, (west + east) * spacing_m)


def terrain_answers(request: TerrainRequest, ground: Ground) -> list[TerrainData]:
    """A ground station's answers to a request: the requested parts whose heights are all known."""
    corner = (request.lat_deg, request.lon_deg)
    answers: list[TerrainData] = []
    for part in range(PART_COUNT):
        if not request.mask >> part & 1:
            continue
        heights = [ground(lat, lon) for lat, lon in part_places(corner, request.spacing_m, part)]
        known = tuple(round(height) for height in heights if height is not None)
        if len(known) == len(heights):
            answers.append(TerrainData(request.lat_deg, request.lon_deg, request.spacing_m, part, known))
    return answers


def offset_m(origin: tuple[float, float], place: tuple[float, float]) -> tuple[float, float]:
    """Metres north and east from one place to another."""
    scale = math.cos(math.radians(0.5 * (origin[0] + place[0])))
    return (place[0] - origin[0]) * METRES_PER_DEGREE, (place[1] - origin[1]) * METRES_PER_DEGREE * scale


def shifted(origin: tuple[float, float], north_m: float, east_m: float) -> tuple[float, float]:
    """The place so many metres north and east of another; the inverse of ``offset_m``."""
    lat_deg = origin[0] + north_m / METRES_PER_DEGREE
    scale = math.cos(math.radians(0.5 * (origin[0] + lat_deg)))
    return lat_deg, origin[1] + east_m / (METRES_PER_DEGREE * scale)


_SPACING_M = 100
_ASK_EVERY_S = 2.0

Corner = tuple[float, float]


class TerrainFeed:
    """Requests blocks of terrain heights, keeps the answers, and interpolates between them."""

    def __init__(self, spacing_m: int = _SPACING_M) -> None:
        self.spacing_m = spacing_m
        self._blocks: dict[Corner, dict[int, tuple[int, ...]]] = {}
        self._asked_at_s = -math.inf
        self._next = 0

    def want(self, places: Iterable[tuple[float, float]]) -> None:
        """Ask for the blocks of these places (latitude, longitude in degrees) from now on."""
        for lat_deg, lon_deg in places:
            self._blocks.setdefault(block_corner(lat_deg, lon_deg, self.spacing_m), {})

    def want_for(self, home: GeoPoint, items: Iterable[MissionItem]) -> None:
        """Ask for the blocks of home and of every item that names a height above terrain."""
        named = (i for i in items if i.frame is Frame.ABOVE_TERRAIN and i.has_position)
        self.want([(home.lat_deg, home.lon_deg), *((item.lat_deg, item.lon_deg) for item in named)])

    def requests(self, now: float) -> list[TerrainRequest]:
        """One request each two seconds while something is missing, block after block."""
        lacking = [corner for corner, parts in self._blocks.items() if len(parts) < PARTS_NORTH * PARTS_EAST]
        if not lacking or now < self._asked_at_s + _ASK_EVERY_S:
            return []
        self._asked_at_s, self._next = now, self._next + 1
        corner = lacking[self._next % len(lacking)]
        there = sum(1 << part for part in self._blocks[corner])
        return [TerrainRequest(*corner, self.spacing_m, ALL_PARTS & ~there)]

    def take(self, data: TerrainData) -> None:
        """Keep an answer; one that was not requested is ignored."""
        parts = self._blocks.get((data.lat_deg, data.lon_deg))
        if parts is not None and data.spacing_m == self.spacing_m and 0 <= data.part < PARTS_NORTH * PARTS_EAST:
            parts[data.part] = data.heights_amsl_m

    def height_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """Height of the ground, bilinear between the heights that are there; None where one is missing."""
        corner = block_corner(lat_deg, lon_deg, self.spacing_m)
        parts = self._blocks.get(corner, {})
        north_m, east_m = offset_m(corner, (lat_deg, lon_deg))
        north, south_share = math.floor(north_m / self.spacing_m), north_m / self.spacing_m % 1.0
        east, west_share = math.floor(east_m / self.spacing_m), east_m / self.spacing_m % 1.0
        height = 0.0
        for row, row_weight in ((north, 1.0 - south_share), (north + 1, south_share)):
            for column, weight in ((east, 1.0 - west_share), (east + 1, west_share)):
                part = parts.get(row // PART_SIDE * PARTS_EAST + column // PART_SIDE)
                if part is None:
                    return None
                height += row_weight * weight * part[row % PART_SIDE * PART_SIDE + column % PART_SIDE]
        return height

    def known_or(self, otherwise: Callable[[float, float], float]) -> Callable[[float, float], float]:
        """The known ground, and ``otherwise`` where it is not known."""

        def ground(lat_deg: float, lon_deg: float) -> float:
            height = self.height_amsl_m(lat_deg, lon_deg)
            return otherwise(lat_deg, lon_deg) if height is None else height

        return ground

    def report(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> TerrainReport:
        """The TERRAIN_REPORT at a place and a height above sea level."""
        loaded = sum(len(parts) for parts in self._blocks.values())
        pending = PARTS_NORTH * PARTS_EAST * len(self._blocks) - loaded
        ground_m = self.height_amsl_m(lat_deg, lon_deg)
        if ground_m is None:  # MAVLink cannot express "unknown" here: spacing 0 stands for it
            return TerrainReport(lat_deg, lon_deg, 0, 0.0, 0.0, pending, loaded)
        return TerrainReport(lat_deg, lon_deg, self.spacing_m, ground_m, alt_amsl_m - ground_m, pending, loaded)
