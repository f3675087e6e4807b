"""The elevation data that an area needs: tiles by name, and what of it is there."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import shapely

from mission_io.data_tables import read_document
from mission_io.model.items import M_PER_DEG
from mission_io.model.plain_text import counted
from uavcover.cli.new import ElevationData, open_elevation_data
from uavcover.errors import InputError, NoTileNearError
from uavcover.model.area import Rings
from uavcover.new.quantities import TERRAIN
from uavcover.run.user import User
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.frames import Bounds, lons_beside

# Free elevation data: which tiles of which sets an area needs, by name, and which of them a folder has. Nothing is fetched.


@dataclass(frozen=True, slots=True)
class ElevationSet:
    """A set of tiles with heights."""

    name: str  # short
    title: str  # as its provider calls it
    resolution: str  # of its pixels
    surface: str  # what the heights are those of
    vertical_datum: str  # what they are above
    files: tuple[str, ...]  # names of a tile, the usual one first, with fields for its corners
    licence: str  # in short
    address: str  # of the provider
    tile_deg: int = 1  # side of a tile
    south_deg: int = -90  # lowest latitude that it has
    north_deg: int = 90  # highest latitude
    hgt_bytes: int | None = None  # size of a .hgt file, which tells its resolution
    note: str = ""  # what else to know

    def names(self, corner: tuple[int, int]) -> tuple[str, ...]:
        """The file names that a tile goes by, the usual one first."""
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
    """Tiles of one set that an area needs."""

    of: ElevationSet  # the set
    corners: tuple[tuple[int, int], ...]  # south-west corners of the tiles, from south to north and then eastward
    beyond: int  # how many tiles would be beyond the latitudes that the set has

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
    return lons_beside(lon, lon[0]), lat


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
        raise InputError(
            f"{where}: the area spans {len(rows) * len(columns)} tiles of {counted(side, 'degree')}; use a part"
        )
    for row in rows:
        for column in columns:
            tile = shapely.box(column * side * scale, row * side, (column + 1) * side * scale, (row + 1) * side)
            if grown.intersects(tile) and not grown.touches(tile):
                yield row * side, (column * side + 180) % 360 - 180


_GRID = 60
_SHOWN = 12


@dataclass(frozen=True, slots=True)
class AreaTerrain:
    """Data that an area needs."""

    needed: tuple[NeededTiles, ...]  # the tiles of each free set
    national: tuple[NationalSource, ...]  # national models that may have it
    around: Bounds  # west, south, east, north with what is around; east may be above 180
    positions: np.ndarray  # (latitude, longitude) of places all over the area, degrees


def terrain_of_area(query: AreaQuery, *, around_m: float) -> AreaTerrain:
    """Find out what elevation data an area needs. Raises InputError: the area cannot be read, or is too large."""
    area = read_area(query)
    needed = needed_tiles(area.parts, around_m=around_m, where=query.source)
    first = area.parts[0][0][0][0]
    polygons = [
        shapely.Polygon(
            [((lon - first + 180.0) % 360.0 - 180.0 + first, lat) for lon, lat in outer],
            [[((lon - first + 180.0) % 360.0 - 180.0 + first, lat) for lon, lat in hole] for hole in holes],
        )
        for outer, *holes in area.parts
    ]
    whole = shapely.union_all(polygons)
    west, south, east, north = whole.bounds
    up = around_m / M_PER_DEG
    side = up / max(0.01, float(np.cos(np.radians(min(89.99, max(abs(south), abs(north)) + up)))))
    grid = np.stack(np.meshgrid(np.linspace(west, east, _GRID), np.linspace(south, north, _GRID)), axis=-1)
    positions = grid.reshape(-1, 2)
    positions = positions[shapely.intersects_xy(whole, positions[:, 0], positions[:, 1])]
    if not len(positions):
        positions = shapely.get_coordinates(whole.representative_point())
    around = (west - side, max(-90.0, south - up), east + side, min(90.0, north + up))
    return AreaTerrain(needed, national_sources(area.parts), around, positions[:, ::-1])


def known_fraction(area: AreaTerrain, data: ElevationData, user: User) -> float:
    """The share of an area, 0 to 1, where elevation data has heights; data that is elsewhere has none.

    Raises:
        TerrainError: a file cannot be used.
        InputError: an option is wrong.
    """
    try:
        source, datum = open_elevation_data(data, around=area.around)
    except NoTileNearError as error:
        user.warn(str(error).removeprefix("terrain.file: "))
        return 0.0
    lat, lon = area.positions.T
    return float(np.isfinite(read_heights_amsl_m(source, datum, lat, (lon + 180.0) % 360.0 - 180.0)).mean())


def files_in(names: Sequence[str]) -> list[Path]:
    """The files that the user named, and those in folders that he named. Raises InputError: one is not there."""
    found: list[Path] = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            found += [file for file in path.rglob("*") if file.is_file()]
        elif path.is_file():
            found.append(path)
        elif not any(sign in name for sign in "*?["):
            raise InputError(f"--dem: {name}: no such file or folder")
        else:
            found += [file for file in Path().glob(name) if file.is_file()]
    return found


def print_needed(area: AreaTerrain, there: Sequence[Path] | None, user: User) -> list[dict[str, object]]:
    """Report the needed tiles of each set, and the missing ones where files are given; as JSON too."""
    documents: list[dict[str, object]] = []
    for needed in area.needed:
        one, names = needed.of, needed.names
        missing = None if there is None else needed.missing_in(there)
        user.say(f"{one.name}: {one.title}, {one.resolution}; {one.surface}; heights above {one.vertical_datum}")
        if not names:
            user.say(f"  no data at these latitudes (only from {_lat(one.south_deg)} to {_lat(one.north_deg)})")
        else:
            beyond = f", {needed.beyond} more beyond its range of latitudes" if needed.beyond else ""
            user.say(f"  {len(names)} {'tile' if len(names) == 1 else 'tiles'}{beyond}:")
            for name in names[:_SHOWN]:
                user.say(f"    {name}{'' if missing is None else '  missing' if name in missing else '  there'}")
            if len(names) > _SHOWN:
                left = "" if missing is None else f"; {len(missing)} missing in all"
                user.say(f"    and {len(names) - _SHOWN} more{left} (use --json to list all)")
            user.say(f"  {one.address}")
            user.say(f"  {one.licence}{f'; {one.note}' if one.note else ''}")
        documents.append(
            {
                "name": one.name,
                "title": one.title,
                "resolution": one.resolution,
                "vertical_datum": one.vertical_datum,
                "licence": one.licence,
                "address": one.address,
                "tiles": list(names),
                "beyond": needed.beyond,
                **({} if missing is None else {"missing": list(missing)}),
            }
        )
    for source in area.national:
        user.say(f"maybe {source.title}: {source.address}")
    user.say("the data sets have no tiles for open sea")
    return documents


def _lat(degrees: int) -> str:
    return f"{abs(degrees)} {'south' if degrees < 0 else 'north'}"
