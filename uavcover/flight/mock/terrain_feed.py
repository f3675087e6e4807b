"""The ground as ArduPilot knows it: what ground stations answered to TERRAIN_REQUEST, block by block."""

import math
from collections.abc import Callable, Iterable

from mission_io.items import Frame, GeoPoint, MissionItem
from mission_io.messages import TerrainData, TerrainReport, TerrainRequest
from mission_io.terrain_grid import ALL_PARTS, PART_SIDE, PARTS_EAST, PARTS_NORTH, block_corner, offset_m

_SPACING_M = 100
_ASK_EVERY_S = 2.0

Corner = tuple[float, float]


class TerrainFeed:
    """Asks for blocks of heights, keeps the answers, and tells the ground between them."""

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
        """Keep an answer; one that was not asked for is left alone."""
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
        """The ground as it is known, and as ``otherwise`` tells it where it is not."""

        def ground(lat_deg: float, lon_deg: float) -> float:
            height = self.height_amsl_m(lat_deg, lon_deg)
            return otherwise(lat_deg, lon_deg) if height is None else height

        return ground

    def report(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> TerrainReport:
        """What it knows, seen from a place at a height above sea level."""
        loaded = sum(len(parts) for parts in self._blocks.values())
        pending = PARTS_NORTH * PARTS_EAST * len(self._blocks) - loaded
        ground_m = self.height_amsl_m(lat_deg, lon_deg)
        if ground_m is None:  # MAVLink has no word for "unknown" here: spacing 0 says it
            return TerrainReport(lat_deg, lon_deg, 0, 0.0, 0.0, pending, loaded)
        return TerrainReport(lat_deg, lon_deg, self.spacing_m, ground_m, alt_amsl_m - ground_m, pending, loaded)
