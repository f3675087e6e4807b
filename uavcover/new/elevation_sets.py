"""Free elevation data: which tiles of which sets an area needs, by name, and which of them a folder has. Nothing is fetched."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import shapely

from mission_io.data_tables import read_document
from mission_io.model.places import M_PER_DEG
from uavcover.errors import InputError
from uavcover.model.area import Rings
from uavcover.new.tuning import TERRAIN


@dataclass(frozen=True, slots=True)
class ElevationSet:
    """A set of tiles with heights.

    Attributes:
        name: short.
        title: as its provider calls it.
        resolution: of its pixels.
        surface: what the heights are those of.
        vertical_datum: what they are above.
        files: names of a tile, the usual one first, with fields for its corners.
        licence: in short.
        address: of the provider.
        tile_deg: side of a tile.
        south_deg: lowest latitude that it has.
        north_deg: highest latitude.
        hgt_bytes: size of a .hgt file, which tells its resolution.
        note: what else to know.
    """

    name: str
    title: str
    resolution: str
    surface: str
    vertical_datum: str
    files: tuple[str, ...]
    licence: str
    address: str
    tile_deg: int = 1
    south_deg: int = -90
    north_deg: int = 90
    hgt_bytes: int | None = None
    note: str = ""

    def names(self, corner: tuple[int, int]) -> tuple[str, ...]:
        """The file names that a tile goes by, the usual one first.

        Args:
            corner: latitude and longitude of its south-west corner.
        """
        lat, lon = corner
        lat2, lon2 = lat + self.tile_deg, lon + self.tile_deg
        fields = {
            "ns": "S" if lat < 0 else "N", "lat": abs(lat), "ew": "W" if lon < 0 else "E", "lon": abs(lon),
            "ns2": "S" if lat2 < 0 else "N", "lat2": abs(lat2), "ew2": "W" if lon2 < 0 else "E", "lon2": abs(lon2),
        }  # fmt: skip
        return tuple(file.format(**fields) for file in self.files)

    def is_in(self, folder_files: dict[str, Path], corner: tuple[int, int]) -> bool:
        """Whether one of the files of a folder, by their names in small letters, is this tile."""
        found = [folder_files[name.lower()] for name in self.names(corner) if name.lower() in folder_files]
        if self.hgt_bytes is None:
            return bool(found)
        return any(path.suffix.lower() != ".hgt" or path.stat().st_size == self.hgt_bytes for path in found)


@dataclass(frozen=True, slots=True)
class NationalSource:
    """A national model of the ground, and roughly where it is (west, south, east, north)."""

    title: str
    box: tuple[float, float, float, float]
    address: str


@dataclass(frozen=True, slots=True)
class NeededTiles:
    """Tiles of one set that an area needs.

    Attributes:
        of: the set.
        corners: south-west corners of the tiles, from south to north and then eastward.
        beyond: how many tiles would be beyond the latitudes that the set has.
    """

    of: ElevationSet
    corners: tuple[tuple[int, int], ...]
    beyond: int

    @property
    def names(self) -> tuple[str, ...]:
        """The usual name of each tile."""
        return tuple(self.of.names(corner)[0] for corner in self.corners)

    def missing_in(self, paths: Iterable[Path]) -> tuple[str, ...]:
        """The usual names of the tiles that are not among these files."""
        there = {path.name.lower(): path for path in paths}
        return tuple(self.of.names(corner)[0] for corner in self.corners if not self.of.is_in(there, corner))


@cache
def _table() -> tuple[tuple[ElevationSet, ...], tuple[NationalSource, ...]]:
    table = read_document("uavcover/data/elevation_data.toml")
    sets = tuple(ElevationSet(**{**row, "files": tuple(row["files"])}) for row in table["set"])
    return sets, tuple(NationalSource(row["title"], tuple(row["box"]), row["address"]) for row in table["national"])


def all_sets() -> tuple[ElevationSet, ...]:
    """The sets, in the order of preference."""
    return _table()[0]


def needed_tiles(parts: tuple[Rings, ...], *, around_m: float, where: str) -> tuple[NeededTiles, ...]:
    """The tiles of every set that an area touches.

    Args:
        parts: the area, rings of (longitude, latitude).
        around_m: how far around it the ground matters.
        where: names the area in errors.

    Raises:
        InputError: more tiles than anybody would want.
    """
    found = []
    for one in all_sets():
        corners = sorted({corner for part in parts for corner in _touched(part[0], one.tile_deg, around_m, where)})
        inside = tuple(corner for corner in corners if one.south_deg <= corner[0] < one.north_deg)
        found.append(NeededTiles(one, inside, len(corners) - len(inside)))
    return tuple(found)


def national_sources(parts: tuple[Rings, ...]) -> tuple[NationalSource, ...]:
    """National models whose rough box an area touches."""
    outlines = [_unwrapped(part[0]) for part in parts]
    boxes = [
        shapely.box(float(lon.min()) + turn, float(lat.min()), float(lon.max()) + turn, float(lat.max()))
        for lon, lat in outlines
        for turn in (-360.0, 0.0, 360.0)
    ]
    return tuple(one for one in _table()[1] if any(shapely.box(*one.box).intersects(box) for box in boxes))


def _unwrapped(ring: tuple[tuple[float, float], ...]) -> tuple[np.ndarray, np.ndarray]:
    """Longitudes that run on across 180 degrees, and latitudes."""
    lon, lat = np.array(ring, dtype=float).T
    return lon[0] + np.mod(lon - lon[0] + 180.0, 360.0) - 180.0, lat


def _touched(
    ring: tuple[tuple[float, float], ...], side: int, around_m: float, where: str
) -> Iterator[tuple[int, int]]:
    """South-west corners of the tiles that an outline with so much around it touches."""
    lon, lat = _unwrapped(ring)
    scale = max(TERRAIN.least_scale, math.cos(math.radians(min(90.0, float(np.abs(lat).max()) + around_m / M_PER_DEG))))
    grown = shapely.Polygon(np.column_stack([lon * scale, lat])).buffer(around_m / M_PER_DEG)
    west, south, east, north = grown.bounds
    rows = range(math.floor(max(south, -90.0) / side), math.ceil(min(north, 90.0) / side))
    columns = range(math.floor(west / scale / side), math.ceil(east / scale / side))
    if len(rows) * len(columns) > TERRAIN.max_tiles:
        raise InputError(f"{where}: spans {len(rows) * len(columns)} tiles of {side} degrees; use a part of it")
    for row in rows:
        for column in columns:
            tile = shapely.box(column * side * scale, row * side, (column + 1) * side * scale, (row + 1) * side)
            if grown.intersects(tile) and not grown.touches(tile):
                yield row * side, (column * side + 180) % 360 - 180
