"""Elevation data of ``uavcover check``: the ground, and the surface with its objects."""

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
import shapely

from mission_io.errors import FormatError
from mission_io.formats import csv_tables, wpml
from mission_io.formats.map_xml import read_gpx_route, read_kml_route
from mission_io.formats.point_route import PointRoute
from mission_io.formats.text import text_from_bytes
from mission_io.model.items import Mission
from uavcover.cli.new import ElevationData, open_elevation_data
from uavcover.errors import InputError, NoTileNearError, TerrainError
from uavcover.extras.check.tuning import WORLD
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.new.elevation_questions import ask_about_heights, ask_about_surface
from uavcover.new.terrain_look import read_as_needed, surface_datum
from uavcover.run.user import User
from uavcover.scenario.areas.features import entry_of, kml_of
from uavcover.scenario.surface_model import higher_of, of_surface, refuse_misfit
from uavcover.terrain.elevation_file import read_ground, read_heights_amsl_m
from uavcover.terrain.frames import Bounds, LocalFrame, lons_beside
from uavcover.terrain.ground import Ground
from uavcover.terrain.suspect_heights import SuspectPosition, suspect_positions
from uavcover.terrain.terrain_source import TerrainSource

# Routes of drone apps and map programs as missions: GPX, KML lines, DJI's WPML, Litchi's CSV.

ROUTE_SUFFIXES: Final = (".gpx", ".kml", ".kmz", ".wpml")
MOST_BYTES: Final = 64 * 1024 * 1024
_READERS: Final[Mapping[str, Callable[[str], PointRoute]]] = MappingProxyType(
    {".gpx": read_gpx_route, ".kml": read_kml_route, ".wpml": wpml.read_route}
)


def read_route_file(path: Path) -> PointRoute | None:
    """Read a route file; None for any other file, by its name and, with ``.csv``, its header.

    Raises:
        InputError: it cannot be opened, or is too large.
        FormatError: it is not what its name says, with file and place.
    """
    suffix = path.suffix.lower()
    if suffix not in (*ROUTE_SUFFIXES, ".csv"):
        return None
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: the file is larger than {MOST_BYTES:,} bytes; save only the route")
        if suffix == ".kmz":
            return _read_kmz(path)
        text = text_from_bytes(path.read_bytes()).text
        if suffix == ".csv":
            return csv_tables.read_litchi(text) if csv_tables.is_litchi(text) else None
        return _READERS[suffix](text)
    except FormatError as error:
        where = f"{path}: {error.where}" if error.where else str(path)
        raise FormatError(error.what, where=where, advice=error.advice) from error
    except OSError as error:
        raise InputError(f"{path}: the file cannot be read ({error.strerror or type(error).__name__})") from error


def _read_kmz(path: Path) -> PointRoute:
    """A flight of DJI's, or a KMZ with a line."""
    flight = entry_of(path, wpml.DOCUMENT)
    if flight is None and entry_of(path, wpml.TEMPLATE) is not None:
        raise FormatError(
            f"the file contains DJI's template ({wpml.TEMPLATE}) but no {wpml.DOCUMENT}, which the aircraft flies",
            advice="export the flight from DJI Pilot 2 or FlightHub, or use its area with new",
        )  # fmt: skip
    if flight is not None:
        return wpml.read_route(text_from_bytes(flight).text)
    return read_kml_route(text_from_bytes(kml_of(path)).text)


_AS_OPTIONS = (
    (r'; set terrain\.(?:surface_)?height_unit to "ft"', "; convert it to metres, or use --height-unit ft"),
    (r"; set terrain\.surface_vertical_datum or surface_height_unit", "; convert both to one datum and unit"),
    (
        r"\(file: the ground; surface_file: the surface with trees and roofs\)",
        "(--dem: the ground; --dsm: the surface with trees and roofs)",
    ),
    (r"terrain\.surface_(?:file|crs|band|height_unit|vertical_datum)", "--dsm"),
    (r"terrain\.file", "--dem"),
)


@dataclass(frozen=True, slots=True)
class CheckElevation:
    """Sources of heights."""

    ground: TerrainSource  # the ground's files
    datum: str  # of their heights
    over: TerrainSource | None = None  # files of a surface model; None without one
    over_datum: str = ""  # of its heights
    # places of the ground's files that do not look like ground: their heights count as unknown
    suspects: tuple[SuspectPosition, ...] = ()

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """Heights (n,) of the ground above sea level at (n,) positions, NaN if unknown."""
        heights = read_heights_amsl_m(self.ground, self.datum, lat_deg, lon_deg)
        return np.where(_is_suspect(self.suspects, lat_deg, lon_deg), np.nan, heights)

    def doubt(self, lat_deg: float, lon_deg: float) -> str:
        """Reason to distrust the height of a position; empty if there is none."""
        here = (one.words for one in self.suspects if _is_suspect([one], np.array([lat_deg]), np.array([lon_deg]))[0])
        return next(here, "")

    def read_ground(self, frame: LocalFrame, bounds_m: Bounds) -> Ground:
        """The ground within west, south, east, north. Raises TerrainError: the files cannot be used there."""
        ground = read_ground(self.ground, self.datum, frame=frame, bounds_m=bounds_m, grid_step_m=None)
        return ground.without([(one.in_frame(frame), one.words) for one in self.suspects]) if self.suspects else ground

    def read_surface(self, frame: LocalFrame, bounds_m: Bounds, ground: Ground) -> Ground:
        """The surface model over a ground. Raises TerrainError: it cannot be used there, or does not fit the ground."""
        assert self.over is not None
        try:
            surface = read_ground(self.over, self.over_datum, frame=frame, bounds_m=bounds_m, grid_step_m=None)
            refuse_misfit(ground, surface, bounds_m=bounds_m, alt_amsl_offset_m=frame.alt_amsl_m)
        except TerrainError as error:
            raise _in_options(of_surface(error)) from error
        return surface

    def read_higher(self, frame: LocalFrame, bounds_m: Bounds, ground: Ground) -> Ground:
        """The higher of a ground and the surface model on one grid, for the problem.

        Raises:
            TerrainError: as in :meth:`read_surface`, or the two cannot be laid into one grid.
        """
        surface = self.read_surface(frame, bounds_m, ground)
        try:
            higher = higher_of(ground, surface, bounds_m=bounds_m, alt_amsl_offset_m=frame.alt_amsl_m)
        except TerrainError as error:
            raise _in_options(error) from error
        return higher


def open_check_elevation(
    data: ElevationData,  # the ground
    surface: tuple[str, ...],  # files, folders or patterns of a surface model; empty without one
    mission: Mission,  # whose places say which tiles are needed
    home: tuple[float, float] | None,  # latitude and longitude of the take-off position, where it is not the mission's
    user: User,  # is asked
    *,
    trusted: bool = False,  # whether heights are taken as they are where they do not look like ground
) -> CheckElevation:
    """Open the user's ground and surface models; ask about probable mistakes.

    Raises:
        InputError: a name, a unit or a datum is unknown.
        TerrainError: a file cannot be used.
    """
    ground, datum = _opened(data, mission, home)
    ask_about_heights(ground, user, option="--dem")
    suspects = () if trusted else _suspects(ground, datum, mission, home)
    for one in suspects[: WORLD.most_suspects]:
        user.warn(f"--dem: {ground.name} contains {one.words}, treated as unknown (with --trust-dem, as ground)")
    if not surface:
        return CheckElevation(ground, datum, suspects=suspects)
    ask_about_surface(ground, user, beside_surface=True)
    named = dataclasses.replace(
        data, names=surface, crs=None, height_unit=None, band=None, vertical_datum=None, option="--dsm"
    )
    try:
        over, _ = _opened(named, mission, home)
        over = read_as_needed(over, crs=data.crs, height_unit=ground.height_unit)
        over_datum = surface_datum(over, datum)
    except TerrainError as error:
        raise _in_options(error) from error
    ask_about_heights(over, user, option="--dsm")
    return CheckElevation(ground, datum, over, over_datum, suspects)


def _real_positions(mission: Mission, home: tuple[float, float] | None) -> FloatArray:
    """(n, 2) latitudes and longitudes of home and items."""
    positions = [] if home is None else [home]
    if mission.home is not None:
        positions.append((mission.home.lat_deg, mission.home.lon_deg))
    positions += [(item.lat_deg, item.lon_deg) for item in mission.items if item.has_position]
    real = [position for position in positions if all(map(math.isfinite, position)) and position != (0.0, 0.0)]
    return np.array(real, dtype=float).reshape(-1, 2)


def _suspects(
    ground: TerrainSource, datum: str, mission: Mission, home: tuple[float, float] | None
) -> tuple[SuspectPosition, ...]:
    real = _real_positions(mission, home)
    if not len(real):
        return ()
    near = real[(np.abs(real - np.median(real, axis=0)) < WORLD.flown_deg).all(axis=1)]
    near = near if len(near) else real[:1]
    south, west = near.min(axis=0) - WORLD.flown_around_deg
    north, east = near.max(axis=0) + WORLD.flown_around_deg
    return suspect_positions(ground, datum, (west, max(south, -90.0), east, min(north, 90.0)))


def _opened(data: ElevationData, mission: Mission, home: tuple[float, float] | None) -> tuple[TerrainSource, str]:
    real = _real_positions(mission, home)
    if not len(real):
        return open_elevation_data(data)
    # Around what most places are near to: one wrong place must not bring the tiles of half the Earth.
    lat, lon = np.median(real, axis=0)
    reach = WORLD.reach_deg
    around = (lon - reach, max(-90.0, lat - reach), lon + reach, min(90.0, lat + reach))
    try:
        return open_elevation_data(data, around=around)
    except NoTileNearError:
        return open_elevation_data(data)


def _in_options(error: TerrainError) -> TerrainError:
    """An error about a scenario's keys, in the options of the command."""
    text = str(error)
    for key, option in _AS_OPTIONS:
        text = re.sub(key, option, text)
    return TerrainError(text)


def _is_suspect(positions: Iterable[SuspectPosition], lat_deg: FloatArray, lon_deg: FloatArray) -> BoolArray:
    """(n,) whether geodetic positions (n,) lie in one of the places."""
    found = np.zeros(len(lat_deg), dtype=bool)
    for position in positions:
        found |= shapely.intersects_xy(position.shape, lons_beside(lon_deg, position.shape.centroid.x), lat_deg)
    return found
