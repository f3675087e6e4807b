"""Terrain heights as ArduPilot obtains them: a grid requested with TERRAIN_REQUEST and answered block by block."""

import math
from collections.abc import Callable, Iterable

from mission_io.autopilots.terrain_grid import (
    ALL_PARTS,
    DEFAULT_SPACING_M,
    PART_COUNT,
    PART_SIDE,
    PARTS_EAST,
    Part,
    Place,
    TerrainBlock,
    block_with_corner,
    place_in_block,
    wrapped_deg,
)
from mission_io.model.items import Command, GeoPoint, MissionItem
from mission_io.model.places import EQUATOR_M_PER_DEG
from mission_io.wire.messages import TerrainData, TerrainReport, TerrainRequest
from uavcover.mock.tuning import LINK


class TerrainFeed:
    """Requests blocks of terrain heights, keeps the answers, and interpolates between them."""

    def __init__(self, spacing_m: int = DEFAULT_SPACING_M) -> None:
        self.spacing_m = spacing_m
        self._blocks: dict[TerrainBlock, dict[int, Part]] = {}
        self._asked_at_s = -math.inf
        self._next = 0

    def want(self, places: Iterable[Place]) -> None:
        """Request the blocks of these positions from now on."""
        for lat_deg, lon_deg in places:
            self._blocks.setdefault(place_in_block(lat_deg, lon_deg, self.spacing_m).block, {})

    def want_for(self, home: GeoPoint, items: Iterable[MissionItem]) -> None:
        """Request the blocks of home, of every waypoint, and of four positions around it."""
        self.want([(home.lat_deg, home.lon_deg)])
        step_deg = LINK.terrain_around_spacings * self.spacing_m / EQUATOR_M_PER_DEG
        for item in items:
            if item.command == Command.NAV_WAYPOINT and item.has_position:
                lat, lon = item.lat_deg, item.lon_deg
                step_lon_deg = step_deg / max(0.01, math.cos(math.radians(lat)))
                around = [(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
                self.want((lat + n * step_deg, wrapped_deg(lon + e * step_lon_deg)) for n, e in around)

    def request(self, now: float) -> TerrainRequest | None:
        """A request, at most each two seconds, while something is missing; block after block."""
        lacking = [block for block, parts in self._blocks.items() if len(parts) < PART_COUNT]
        if not lacking or now < self._asked_at_s + LINK.terrain_ask_every_s:
            return None
        self._asked_at_s, self._next = now, self._next + 1
        block = lacking[self._next % len(lacking)]
        there = sum(1 << part for part in self._blocks[block])
        lat_e7, lon_e7 = block.corner_e7
        return TerrainRequest(lat_e7 / 1e7, lon_e7 / 1e7, self.spacing_m, ALL_PARTS & ~there)

    def take(self, data: TerrainData) -> None:
        """Keep an answer; one that was not requested is ignored."""
        if data.spacing_m != self.spacing_m or not 0 <= data.part < PART_COUNT:
            return
        block = block_with_corner(data.lat_deg, data.lon_deg, data.spacing_m)
        if block is not None and block in self._blocks:
            self._blocks[block][data.part] = data.heights_amsl_m

    @property
    def pending(self) -> int:
        """Requested parts that have not arrived."""
        return sum(PART_COUNT - len(parts) for parts in self._blocks.values())

    def height_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """Height of the ground, bilinear between known heights; None where one is missing."""
        place = place_in_block(lat_deg, lon_deg, self.spacing_m)
        parts = self._blocks.get(place.block, {})
        row, column = math.floor(place.row), math.floor(place.column)
        north_share, east_share = place.row - row, place.column - column
        height = 0.0
        for at_row, row_weight in ((row, 1.0 - north_share), (row + 1, north_share)):
            for at_column, weight in ((column, 1.0 - east_share), (column + 1, east_share)):
                part = parts.get(at_row // PART_SIDE * PARTS_EAST + at_column // PART_SIDE)
                if part is None:
                    return None
                height += row_weight * weight * part[at_row % PART_SIDE * PART_SIDE + at_column % PART_SIDE]
        return height

    def known_or(self, otherwise: Callable[[float, float], float]) -> Callable[[float, float], float]:
        """The known ground, and ``otherwise`` where it is not known."""

        def ground(lat_deg: float, lon_deg: float) -> float:
            height = self.height_amsl_m(lat_deg, lon_deg)
            return otherwise(lat_deg, lon_deg) if height is None else height

        return ground

    def report(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> TerrainReport:
        """The TERRAIN_REPORT at a position and an altitude."""
        loaded = sum(len(parts) for parts in self._blocks.values())
        ground_m = self.height_amsl_m(lat_deg, lon_deg)
        if ground_m is None:  # MAVLink cannot express "unknown" here: spacing 0 stands for it
            return TerrainReport(lat_deg, lon_deg, 0, 0.0, 0.0, self.pending, loaded)
        return TerrainReport(lat_deg, lon_deg, self.spacing_m, ground_m, alt_amsl_m - ground_m, self.pending, loaded)
