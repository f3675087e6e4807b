"""Signs in name and metadata that elevation data is a surface, in feet, has other bands, or is a known free data set."""

import re

import rasterio.errors

from uavcover.errors import TerrainError
from uavcover.new.elevation_sets import all_sets
from uavcover.terrain.terrain_source import TerrainSource

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


def surface_in_words(source: TerrainSource) -> str | None:
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
        return f"{name} is named like an SRTM tile: a radar surface of 2000, which includes some trees and buildings"
    if word := _WORDS.search(name):
        return f'its name contains "{word.group(0)}"'
    return _by_metadata(source)


def _of_set(name: str) -> str:
    (found,) = [each for each in all_sets() if each.name == name]
    return f"{found.title} is a {found.surface}"


def feet_in_words(source: TerrainSource) -> str | None:
    """Reason why heights in metres seem to be in feet.

    None without a sign of it, or with a given unit.

    Args:
        source: the elevation data; the name of the first of several files is looked at.
    """
    if source.height_unit is not None:
        return None
    try:
        with source.opened() as dataset:
            band = source.band_of(dataset)
            stated = bool(dataset.units[band - 1]) or (dataset.crs is not None and "VERT" in dataset.crs.to_wkt())
    except (TerrainError, rasterio.errors.RasterioError, OSError):
        return None  # its own error tells more
    if stated:
        return None
    if word := _FEET.search(source.files[0].stem):
        return f'its name contains "{word.group(0)}"'
    for text in _said(source):
        if word := _FEET.search(text[:_TAGS_READ]):
            return f'its metadata contain "{word.group(0)}"'
    return None


def bands_in_words(source: TerrainSource) -> str | None:
    """List the bands beside the first, which is used. None with one band, or with an explicit choice."""
    if source.band is not None:
        return None
    try:
        with source.opened() as dataset:
            names = [name or "without a name" for name in dataset.descriptions]
    except (TerrainError, rasterio.errors.RasterioError, OSError):
        return None
    return None if len(names) < 2 else ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))


def shading_in_words(source: TerrainSource) -> str | None:
    """Reason why values seem to be an image of heights, such as a hillshade; None without a sign of it."""
    try:
        with source.opened() as dataset:
            kind, count = dataset.dtypes[source.band_of(dataset) - 1], dataset.count
    except (TerrainError, rasterio.errors.RasterioError, OSError):
        return None  # its own error tells more
    if word := _SHADING.search(source.files[0].stem):
        return f'its name contains "{word.group(0)}"'
    return f"{source.files[0].name} has 8 bits (0 to 255), like an image" if kind == "uint8" and count < 3 else None


def _by_metadata(source: TerrainSource) -> str | None:
    for text in _said(source):
        if (word := _WORDS.search(text[:_TAGS_READ])) and not _GROUND_WORDS.search(text[:_TAGS_READ]):
            return f'its metadata contain "{word.group(0)}"'
    return None


def _said(source: TerrainSource) -> list[str]:
    """Description and metadata of the band with the heights, and of its file; nothing where it cannot be opened."""
    try:
        with source.opened() as dataset:
            band = source.band_of(dataset)
            said = [str(dataset.descriptions[band - 1] or ""), *map(str, dataset.tags().values())]
            return [*said, *(str(value) for value in dataset.tags(band).values())]
    except (TerrainError, rasterio.errors.RasterioError, OSError):
        return []  # its own error tells more
