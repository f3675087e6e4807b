"""Request of ``new``, and the elevation data for it: ground and surface model."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_args

import rasterio.errors

from mission_io.data_tables import read_document
from uavcover.errors import InputError, TerrainError
from uavcover.model.area import HeightUnit, Ring
from uavcover.new import quantities
from uavcover.new.quantities import TERRAIN
from uavcover.new.survey import SurveyDesign
from uavcover.new.terrain_look import SurfaceLook, TerrainLook, known_margin_m, look_at_surface, read_as_needed
from uavcover.run.user import User
from uavcover.scenario.areas.area_file import AreaQuery, FoundArea
from uavcover.terrain.terrain_source import TerrainSource, find_tiles

Answer = TypeVar("Answer")

# Signs in name and metadata that elevation data is a surface, in feet, has other bands, or is a known free data set.

_WORDS = re.compile(
    r"(?<![a-z])(dsm|dom|mns|mds|ndsm|chm|surface[ _-]?model|oberfl(ä|ae)chenmodell|mod(è|e)le num(é|e)rique de surface|canopy"
    r"|first[ _-]?return)(?![a-z])",
    re.IGNORECASE,
)
"""Words of English, German, French and Spanish: DSM, DOM, MNS, MDS. nDSM and CHM are heights of trees alone."""
_GROUND_WORDS = re.compile(r"(?<![a-z])(dtm|dgm|mnt|mdt|bare[ _-]?earth|terrain[ _-]?model)(?![a-z])", re.IGNORECASE)
_SRTM = re.compile(r"^[ns]\d{2}[ew]\d{3}(?!\d)|(?<![a-z])srtm(?![a-z])", re.IGNORECASE)
_AW3D30 = re.compile(r"^ALPSMLC30_|(?<![a-z])aw3d30(?![a-z])", re.IGNORECASE)
_FEET = re.compile(r"(?<![a-z])(feet|foot|us[ _-]?ft|ftus|ft)(?![a-z])", re.IGNORECASE)
_SHADING = re.compile(
    r"hill[ _-]?shade|shaded[ _-]?relief|(?<![a-z])(slope|aspect|schummerung)(?![a-z])", re.IGNORECASE
)
_TAGS_READ = 200


def surface_text(source: TerrainSource) -> str | None:
    """Reason why elevation data seems to be a surface model; None without a sign of it.

    The words of a name of a free data set say which; other names and metadata are quoted. A name that says ground model decides
    against: sets of bare ground keep the names of SRTM's tiles at times, and say so beside it.

    Args:
        source: the elevation data; the name of the first of several files is looked at.
    """
    name = source.files[0].name
    if _GROUND_WORDS.search(name):
        return None
    for title, pattern in (("glo-30", r"^Copernicus_DSM(_COG)?_10_"), ("glo-90", r"^Copernicus_DSM(_COG)?_30_")):
        if re.search(pattern, name, re.IGNORECASE):
            return _of_set(title)
    if _AW3D30.search(name):
        return _of_set("aw3d30")
    if re.match(r"^ASTGTM", name, re.IGNORECASE):
        return _of_set("aster")
    if _SRTM.search(name):
        return f"{name} has the name of an SRTM tile, a radar surface from 2000 that includes some trees and buildings"
    if word := _WORDS.search(name):
        return f'its name contains "{word.group(0)}"'
    return _by_metadata(source)


def _of_set(name: str) -> str:
    sets = read_document("uavcover/data/elevation_data.toml")["set"]
    (found,) = [each for each in sets if each["name"] == name]
    return f"{found['title']} is a {found['surface']}"


def feet_text(source: TerrainSource) -> str | None:
    """Reason why heights in metres seem to be in feet.

    None without a sign of it, or with a given unit.

    Args:
        source: the elevation data; the name of the first of several files is looked at.
    """
    if source.height_unit is not None:
        return None

    def states_unit(dataset: Any) -> bool:
        unit = dataset.units[source.band_of(dataset) - 1]
        return bool(unit) or (dataset.crs is not None and "VERT" in dataset.crs.to_wkt())

    if _answer_of(source, states_unit, otherwise=True):
        return None
    if word := _FEET.search(source.files[0].stem):
        return f'its name contains "{word.group(0)}"'
    for text in _said(source):
        if word := _FEET.search(text[:_TAGS_READ]):
            return f'its metadata contains "{word.group(0)}"'
    return None


def bands_text(source: TerrainSource) -> str | None:
    """List the bands beside the first, which is used. None with one band, or with an explicit choice."""
    if source.band is not None:
        return None
    described: tuple[str | None, ...] = _answer_of(source, lambda dataset: dataset.descriptions, otherwise=())
    names = [name or "without a name" for name in described]
    return None if len(names) < 2 else ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))


def shading_text(source: TerrainSource) -> str | None:
    """Reason why values seem to be an image of heights, such as a hillshade; None without a sign of it."""
    found = _answer_of(
        source, lambda dataset: (dataset.dtypes[source.band_of(dataset) - 1], dataset.count), otherwise=None
    )
    if found is None:
        return None
    kind, count = found
    if word := _SHADING.search(source.files[0].stem):
        return f'its name contains "{word.group(0)}"'
    return f"{source.files[0].name} has 8 bits (0 to 255), like an image" if kind == "uint8" and count < 3 else None


def _by_metadata(source: TerrainSource) -> str | None:
    for text in _said(source):
        if (word := _WORDS.search(text[:_TAGS_READ])) and not _GROUND_WORDS.search(text[:_TAGS_READ]):
            return f'its metadata contains "{word.group(0)}"'
    return None


def _said(source: TerrainSource) -> list[str]:
    """Description and metadata of the band with the heights, and of its file; nothing where it cannot be opened."""

    def said(dataset: Any) -> list[str]:
        band = source.band_of(dataset)
        tags = (*dataset.tags().values(), *dataset.tags(band).values())
        return [str(dataset.descriptions[band - 1] or ""), *map(str, tags)]

    return _answer_of(source, said, otherwise=[])


def _answer_of(source: TerrainSource, question: Callable[[Any], Answer], *, otherwise: Answer) -> Answer:
    """Answer of the open raster; if it cannot be opened, its own error follows elsewhere."""
    try:
        with source.opened() as dataset:
            return question(dataset)
    except (TerrainError, rasterio.errors.RasterioError, OSError):
        return otherwise


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRequest:
    """User input as text; None for what was omitted."""

    area: AreaQuery  # what is to be seen
    dem: tuple[str, ...] = ()  # elevation data: files, folders or patterns of tiles
    camera: str | None = None  # name or file
    gsd: str | None = None  # ground sample distance, as "2.5cm"
    overlap: str | None = None  # forward and side, as "75/70"
    battery: str | None = None  # time in the air, as "25min"
    vehicle: str | None = None  # name or file
    home: str | None = None  # "LAT,LON"
    max_height: str | None = None  # above ground, as "120m"
    speed: str | None = None  # as "8m/s"
    margin: str | None = None  # around the area, as "40m", or "0"
    mount: str | None = None  # "stabilised" or "fixed"
    vertical_datum: str | None = None  # "EGM96", "EGM2008" or "ellipsoid"
    autopilot: str | None = None  # "ardupilot" or "px4"
    dem_crs: str | None = None  # of the elevation data, where it names none
    height_unit: str | None = None  # of the elevation data: "m", "dm", "cm", "ft" or "us-ft"
    band: str | None = None  # its band, number or name
    fill_lakes: str | None = None  # gaps up to this long are interpolated, as "200m"
    water_height: str | None = None  # of open water above sea level, as "0m"
    no_fly: tuple[str, ...] = ()  # files of no-fly zones
    at: str | None = None  # when it is flown, as "2026-07-01T09:00Z/2h"
    pattern: str | None = None  # "single", "crosshatch" or "oblique"
    dsm: tuple[str, ...] = ()  # a surface model: files, folders or patterns of tiles
    fence: Ring | None = None  # ring of [longitude, latitude] that the vehicle must stay inside
    max_alt: str | None = None  # highest altitude above sea level, as "900m"
    rally: Ring | None = None  # [longitude, latitude] of each rally point
    trust_dem: bool = False  # whether heights are taken as they are where they do not look like ground


def _files(names: tuple[str, ...], area: FoundArea, option: str) -> tuple[Path, ...]:
    """The elevation files that are near the area."""
    outlines = [position for rings in area.parts for position in rings[0]]
    lons, lats = [position[0] for position in outlines], [position[1] for position in outlines]
    if max(lons) - min(lons) > 180.0:
        lons = [lon + 360.0 if lon < 0.0 else lon for lon in lons]
    try:
        files = find_tiles(names, folder=Path(), around=(min(lons), min(lats), max(lons), max(lats)), key=option)
    except TerrainError as error:
        raise InputError(str(error)) from error
    missing = [file for file in files if not file.is_file()]
    if missing:
        example = f"{option.removeprefix('--')}.tif"
        raise InputError(f"{option}: {missing[0]}: no such file; specify elevation data, such as {example}")
    return files


def requested_surface(
    request: NewRequest, area: FoundArea, dem: TerrainSource, look: TerrainLook, datum: str
) -> SurfaceLook | None:
    """The examined surface model, if one was given."""
    if not request.dsm:
        return None
    source = TerrainSource(
        _files(request.dsm, area, "--dsm"), fill_no_data_m=dem.fill_no_data_m, water_height_m=dem.water_height_m,
        key="terrain.surface_file",
    )  # fmt: skip
    source = read_as_needed(source, crs=request.dem_crs, height_unit=dem.height_unit)
    return look_at_surface(source, dem, look, ground_datum=datum, around_m=TERRAIN.around_m)


def requested_ground(request: NewRequest, area: FoundArea) -> TerrainSource:
    """The elevation data of the ground."""
    files = _files(request.dem, area, "--dem")
    unit = None if request.height_unit is None else request.height_unit.casefold()
    if unit not in (None, *get_args(HeightUnit)):
        raise InputError(f"--height-unit: unknown unit {request.height_unit!r}; use m, dm, cm, ft or us-ft")
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
    """Gaps in holes of the area are only crossed, so they are interpolated without a question."""
    if look.gap_m == 0.0 or dem.fill_no_data_m >= look.gap_m:
        return dem
    user.warn(
        f"the elevation data has gaps of up to {look.gap_m:.0f} m in holes of the area; they were interpolated from "
        "their edges, and flights may cross them"
    )
    return replace(dem, fill_no_data_m=look.gap_m)


def inside_data(design: SurveyDesign, dem: TerrainSource, look: TerrainLook, user: User) -> SurveyDesign:
    """The design with a margin that the elevation data reaches."""
    margin_m = math.floor(known_margin_m(dem, look, design.margin_m)) if design.margin_m > 0.0 else 0.0
    if margin_m < design.margin_m:
        less_m = design.margin_m - margin_m
        user.warn(
            f"the elevation data ends near the edge of the area: full overlap begins {less_m:g} m inside the edge of "
            f"the area (margin {margin_m:g} m instead of {design.margin_m:g} m)"
        )
    return replace(design, margin_m=float(margin_m))


def ask_about_surface(dem: TerrainSource, user: User, *, beside_surface: bool) -> None:
    """Ask whether elevation data that looks like a surface model is meant as the ground.

    Args:
        dem: given as the ground.
        user: answers.
        beside_surface: whether a surface model was given too.
    """
    why = surface_text(dem)
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
    """Ask whether heights are plausible and in metres if the data suggests otherwise; report the selected band."""
    if (why := feet_text(source)) is not None:
        user.warn(f"{option}: the heights may be in feet ({why}); they are read as metres; set --height-unit ft or m")
    if (why := shading_text(source)) is not None:
        user.warn(
            f"{option}: these may not be heights ({why}); they are read as metres; a hillshade or slope map is not "
            "an elevation model"
        )
    if (bands := bands_text(source)) is not None:
        user.warn(
            f"{option}: the file has several bands ({bands}): the first is read as the heights; select one with --band"
        )
