"""The grid in which a vehicle asks for heights of the ground, and the answers to its requests.

Read in ArduPilot's AP_Terrain: a block is 28 by 32 heights, 7 by 8 parts of 4 by 4; blocks overlap by one part, and
their south-west corners are counted from that of the whole degree, with metres per degree of longitude as there.
"""

import math
from collections.abc import Callable, Iterator

from mission_io.terrain_messages import TerrainData, TerrainRequest

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
    """What a ground station answers a request with: the parts that are wanted and known in whole."""
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
