"""Elevation data of ``uavcover check``: the ground, and what stands on it."""

import dataclasses
import math
import re
from dataclasses import dataclass

import numpy as np

from mission_io.model.items import Mission
from uavcover.checking.check import Bounds
from uavcover.errors import TerrainError
from uavcover.intake.surface_look import read_as_needed, surface_datum
from uavcover.kernels.arrays import FloatArray
from uavcover.run.new_elevation import ask_about_heights, ask_about_surface
from uavcover.run.user import User
from uavcover.run.vehicle_terrain import ElevationData, open_elevation_data
from uavcover.scenario.elevation_file import read_ground, read_heights_amsl_m
from uavcover.scenario.frames import LocalFrame
from uavcover.scenario.ground import Ground
from uavcover.scenario.surface_model import higher_of, of_surface, refuse_misfit
from uavcover.scenario.terrain_source import TerrainSource

_REACH_DEG = 1.0
_AS_OPTIONS = (
    (r'; set terrain\.(?:surface_)?height_unit to "ft"', "; convert it to metres, or give --height-unit ft"),
    (r"; set terrain\.surface_vertical_datum or surface_height_unit", "; bring both to one datum and unit"),
    (r"\(file is the ground, surface_file what stands on it\)", "(--dem is the ground, --dsm what stands on it)"),
    (r"terrain\.surface_(?:file|crs|band|height_unit|vertical_datum)", "--dsm"),
    (r"terrain\.file", "--dem"),
)


@dataclass(frozen=True, slots=True)
class CheckElevation:
    """Where heights come from.

    Attributes:
        ground: the ground's files.
        datum: of their heights.
        over: files of a surface model; none without one.
        over_datum: of its heights.
    """

    ground: TerrainSource
    datum: str
    over: TerrainSource | None = None
    over_datum: str = ""

    def heights_amsl_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """Heights (n,) of the ground above sea level at (n,) places, NaN where it is not known."""
        return read_heights_amsl_m(self.ground, self.datum, lat_deg, lon_deg)

    def read_ground(self, frame: LocalFrame, bounds_m: Bounds) -> Ground:
        """The ground within west, south, east, north.

        Raises:
            TerrainError: the files cannot be used there.
        """
        return read_ground(self.ground, self.datum, frame=frame, bounds_m=bounds_m, grid_step_m=None)

    def read_surface(self, frame: LocalFrame, bounds_m: Bounds, ground: Ground) -> Ground:
        """The surface model over a ground.

        Raises:
            TerrainError: it cannot be used there, or does not fit the ground.
        """
        assert self.over is not None
        try:
            surface = read_ground(self.over, self.over_datum, frame=frame, bounds_m=bounds_m, grid_step_m=None)
            refuse_misfit(ground, surface, bounds_m=bounds_m, alt_amsl_offset_m=frame.alt_amsl_m)
        except TerrainError as error:
            raise _in_options(of_surface(error)) from error
        return surface

    def read_higher(self, frame: LocalFrame, bounds_m: Bounds, ground: Ground) -> Ground:
        """The higher of a ground and the surface model on one grid, for what is looked at.

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
    data: ElevationData,
    surface: tuple[str, ...],
    mission: Mission,
    home: tuple[float, float] | None,
    user: User,
) -> CheckElevation:
    """Open what the user named as the ground, and as what stands on it; asks what looks like a mistake.

    Args:
        data: the ground.
        surface: files, folders or patterns of a surface model; empty without one.
        mission: whose places say which tiles are needed.
        home: latitude and longitude of the take-off place, where it is not the mission's.
        user: is asked.

    Raises:
        InputError: a name, a unit or a datum is not known.
        TerrainError: a file cannot be used.
    """
    ground, datum = _opened(data, mission, home)
    ask_about_heights(ground, user, option="--dem")
    if not surface:
        return CheckElevation(ground, datum)
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
    return CheckElevation(ground, datum, over, over_datum)


def _opened(data: ElevationData, mission: Mission, home: tuple[float, float] | None) -> tuple[TerrainSource, str]:
    places = [] if home is None else [home]
    if mission.home is not None:
        places.append((mission.home.lat_deg, mission.home.lon_deg))
    places += [(item.lat_deg, item.lon_deg) for item in mission.items if item.has_position]
    real = [place for place in places if all(map(math.isfinite, place)) and place != (0.0, 0.0)]
    if not real:
        return open_elevation_data(data)
    # Around what most places are near to: one wrong place must not bring the tiles of half the Earth.
    lat, lon = np.median(np.array(real), axis=0)
    around = (lon - _REACH_DEG, max(-90.0, lat - _REACH_DEG), lon + _REACH_DEG, min(90.0, lat + _REACH_DEG))
    try:
        return open_elevation_data(data, around=around)
    except TerrainError as error:
        if "none of" not in str(error):
            raise
        return open_elevation_data(data)


def _in_options(error: TerrainError) -> TerrainError:
    """An error about a scenario's keys, in the options of the command."""
    text = str(error)
    for key, option in _AS_OPTIONS:
        text = re.sub(key, option, text)
    return TerrainError(text)
