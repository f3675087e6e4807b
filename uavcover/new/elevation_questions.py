"""Request of ``new``, and the elevation data for it: ground and surface model."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from uavcover.errors import InputError, TerrainError
from uavcover.model.area import Ring
from uavcover.model.terrain import HeightUnit
from uavcover.new import quantities
from uavcover.new.elevation_words import bands_in_words, feet_in_words, shading_in_words, surface_in_words
from uavcover.new.surface_look import SurfaceLook, look_at_surface, read_as_needed
from uavcover.new.survey import SurveyDesign
from uavcover.new.terrain_look import TerrainLook, known_margin_m
from uavcover.new.tuning import TERRAIN
from uavcover.run.user import User
from uavcover.scenario.areas.area_file import AreaQuery, FoundArea
from uavcover.terrain.terrain_source import TerrainSource, find_tiles


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRequest:
    """User input as text; None for what was left out.

    Attributes:
        area: what is to be seen.
        dem: elevation data: files, folders or patterns of tiles.
        camera: name or file.
        gsd: ground sample distance, as "2.5cm".
        overlap: forward and side, as "75/70".
        battery: time in the air, as "25min".
        vehicle: name or file.
        home: "LAT,LON".
        max_height: above ground, as "120m".
        speed: as "8m/s".
        margin: around the area, as "40m", or "0".
        mount: "stabilised" or "fixed".
        vertical_datum: "EGM96", "EGM2008" or "ellipsoid".
        autopilot: "ardupilot" or "px4".
        dem_crs: of the elevation data, where it names none.
        height_unit: of the elevation data: "m", "dm", "cm", "ft" or "us-ft".
        band: its band, number or name.
        fill_lakes: gaps up to this long are interpolated, as "200m".
        water_height: of open water above sea level, as "0m".
        no_fly: files of no-fly zones.
        at: when it is flown, as "2026-07-01T09:00Z/2h".
        pattern: "single", "crosshatch" or "oblique".
        dsm: a surface model: files, folders or patterns of tiles.
        fence: ring of [longitude, latitude] that the vehicle must stay inside.
        max_alt: highest altitude above sea level, as "900m".
        rally: [longitude, latitude] of each rally point.
        trust_dem: whether heights are taken as they are where they do not look like ground.
    """

    area: AreaQuery
    dem: tuple[str, ...] = ()
    camera: str | None = None
    gsd: str | None = None
    overlap: str | None = None
    battery: str | None = None
    vehicle: str | None = None
    home: str | None = None
    max_height: str | None = None
    speed: str | None = None
    margin: str | None = None
    mount: str | None = None
    vertical_datum: str | None = None
    autopilot: str | None = None
    dem_crs: str | None = None
    height_unit: str | None = None
    band: str | None = None
    fill_lakes: str | None = None
    water_height: str | None = None
    no_fly: tuple[str, ...] = ()
    at: str | None = None
    pattern: str | None = None
    dsm: tuple[str, ...] = ()
    fence: Ring | None = None
    max_alt: str | None = None
    rally: Ring | None = None
    trust_dem: bool = False


def _files(names: tuple[str, ...], area: FoundArea, option: str) -> tuple[Path, ...]:
    """The elevation files that are near the area."""
    outlines = [place for rings in area.parts for place in rings[0]]
    lons, lats = [place[0] for place in outlines], [place[1] for place in outlines]
    if max(lons) - min(lons) > 180.0:
        lons = [lon + 360.0 if lon < 0.0 else lon for lon in lons]
    try:
        files = find_tiles(names, folder=Path(), around=(min(lons), min(lats), max(lons), max(lats)), key=option)
    except TerrainError as error:
        raise InputError(str(error)) from error
    missing = [file for file in files if not file.is_file()]
    if missing:
        example = f"{option.removeprefix('--')}.tif"
        raise InputError(
            f"{option}: {missing[0]}: no such file; specify the elevation data of the area, such as {example}"
        )
    return files


def surface_asked_for(
    request: NewRequest, area: FoundArea, dem: TerrainSource, look: TerrainLook, datum: str
) -> SurfaceLook | None:
    """A look at the surface model, where one was given."""
    if not request.dsm:
        return None
    source = TerrainSource(
        _files(request.dsm, area, "--dsm"), fill_no_data_m=dem.fill_no_data_m, water_height_m=dem.water_height_m,
        key="terrain.surface_file",
    )  # fmt: skip
    source = read_as_needed(source, crs=request.dem_crs, height_unit=dem.height_unit)
    return look_at_surface(source, dem, look, ground_datum=datum, around_m=TERRAIN.around_m)


def ground_asked_for(request: NewRequest, area: FoundArea) -> TerrainSource:
    """The elevation data of the ground."""
    files = _files(request.dem, area, "--dem")
    unit = None if request.height_unit is None else request.height_unit.casefold()
    if unit not in (None, *get_args(HeightUnit)):
        raise InputError(f"--height-unit: {request.height_unit!r} is not known; use m, dm, cm, ft or us-ft")
    filled_m = request.fill_lakes and quantities.length_m(request.fill_lakes, option="--fill-lakes", example="200m")
    if request.water_height is not None and filled_m:
        raise InputError(
            "--water-height: use either this option, which treats gaps as water, or --fill-lakes, which "
            "treats them as ground"
        )
    return TerrainSource(
        files, crs=request.dem_crs, band=request.band, height_unit=unit, fill_no_data_m=filled_m or 0.0,
        water_height_m=quantities.water_height_m(request.water_height),
    )  # fmt: skip


def over_lakes(dem: TerrainSource, look: TerrainLook, user: User) -> TerrainSource:
    """Gaps in holes of the area are never looked at but crossed: they are interpolated without being asked for."""
    if look.gap_m == 0.0 or dem.fill_no_data_m >= look.gap_m:
        return dem
    user.warn(
        f"the elevation data has gaps of up to {look.gap_m:.0f} m in holes of the area: they are interpolated from "
        "their edges, and flights may cross them"
    )
    return replace(dem, fill_no_data_m=look.gap_m)


def inside_data(design: SurveyDesign, dem: TerrainSource, look: TerrainLook, user: User) -> SurveyDesign:
    """The design with a margin that the elevation data reaches."""
    margin_m = math.floor(known_margin_m(dem, look, design.margin_m)) if design.margin_m > 0.0 else 0.0
    if margin_m < design.margin_m:
        less_m = design.margin_m - margin_m
        user.warn(
            f"the elevation data ends near the edge of the area: full overlap begins {less_m:g} m inside that edge "
            f"(margin {margin_m:g} m instead of {design.margin_m:g} m)"
        )
    return replace(design, margin_m=float(margin_m))


def ask_about_surface(dem: TerrainSource, user: User, *, beside_surface: bool) -> None:
    """Ask whether elevation data that calls itself a surface is meant as the ground.

    Args:
        dem: given as the ground.
        user: is asked.
        beside_surface: whether a surface model was given too.
    """
    why = surface_in_words(dem)
    if why is None:
        return
    if beside_surface:
        user.warn(
            f"--dem: this may not be the bare ground ({why}); --dem is the ground, --dsm includes what stands on it"
        )
    else:
        user.warn(
            f"--dem: this may not be the bare ground ({why}). Heights then refer to its trees and roofs, and the "
            "sensor observes these; to observe the ground, use a ground model as --dem and this file as --dsm"
        )


def ask_about_heights(source: TerrainSource, user: User, *, option: str) -> None:
    """Ask whether heights are heights, and in metres, where the data says otherwise; tell which of several bands is taken.

    Args:
        source: the elevation data.
        user: is asked.
        option: that named it, such as "--dem".
    """
    if (why := feet_in_words(source)) is not None:
        user.warn(f"{option}: the heights may be in feet ({why}); they are read as metres; set --height-unit ft or m")
    if (why := shading_in_words(source)) is not None:
        user.warn(
            f"{option}: these may not be heights ({why}); they are read as metres; a hillshade or slope map is not "
            "an elevation model"
        )
    if (bands := bands_in_words(source)) is not None:
        user.warn(
            f"{option}: the file has several bands ({bands}): the first is read as the heights; select one with --band"
        )
