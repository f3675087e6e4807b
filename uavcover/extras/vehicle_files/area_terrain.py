"""The elevation data that an area needs: tiles by name, and what of it is there."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from mission_io.model.items import M_PER_DEG
from uavcover.cli.new import ElevationData, open_elevation_data
from uavcover.errors import InputError, NoTileNearError
from uavcover.new.elevation_questions import (
    NationalSource,
    NeededTiles,
    national_sources,
    needed_tiles,
)
from uavcover.run.user import User
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.frames import Bounds

_GRID = 60
_SHOWN = 12


@dataclass(frozen=True, slots=True)
class AreaTerrain:
    """Data that an area needs."""

    needed: tuple[NeededTiles, ...]  # the tiles of each free set
    national: tuple[NationalSource, ...]  # national models that may have it
    around: Bounds  # west, south, east, north with what is around; east may be above 180
    places: np.ndarray  # (latitude, longitude) of places all over the area, degrees


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
    places = grid.reshape(-1, 2)
    places = places[shapely.intersects_xy(whole, places[:, 0], places[:, 1])]
    if not len(places):
        places = shapely.get_coordinates(whole.representative_point())
    around = (west - side, max(-90.0, south - up), east + side, min(90.0, north + up))
    return AreaTerrain(needed, national_sources(area.parts), around, places[:, ::-1])


def known_share(area: AreaTerrain, data: ElevationData, user: User) -> float:
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
    lat, lon = area.places.T
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


def say_needed(area: AreaTerrain, there: Sequence[Path] | None, user: User) -> list[dict[str, object]]:
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
