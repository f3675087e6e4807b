"""The one reader of areas: a file of any known format, a box, a circle, or well-known text."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import shapely
from pyproj import CRS
from pyproj.exceptions import CRSError

from mission_io.errors import FormatError
from mission_io.formats.text import text_from_bytes
from uavcover.errors import InputError
from uavcover.model.area import Rings
from uavcover.plugins import load, registered
from uavcover.scenario.areas import gis_file
from uavcover.scenario.areas.features import AreaDocument, AreaFeature, chosen
from uavcover.scenario.areas.gis_file import kml_of
from uavcover.scenario.areas.rings import RingReading, joined, read_polygons, rings_of
from uavcover.scenario.areas.text_formats import TEXT_FORMATS, circle_ring, read_kml, read_wkt

SUFFIXES = (
    *TEXT_FORMATS,
    ".kmz",
    *gis_file.SUFFIXES,
    ".zip",
    *(f".{name}" for name in registered("uavcover.area_readers")),
)
MAX_BYTES = 256 * 1024 * 1024
_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"\s*(?:(bbox|box|circle):)?\s*({_NUMBER}(?:\s*,\s*{_NUMBER})*)\s*(m|km)?\s*", re.IGNORECASE)
_WKT = re.compile(
    r"\s*(SRID\s*=\s*\d+\s*;)?\s*((MULTI|CURVE)?POLYGON|(MULTI)?(POINT|LINESTRING|CURVE|SURFACE)|CIRCULARSTRING|COMPOUNDCURVE"
    r"|POLYHEDRALSURFACE|TIN|TRIANGLE|GEOMETRYCOLLECTION)\s*(Z|M|ZM)?\s*(\(|EMPTY\b|$)",
    re.IGNORECASE,
)
"""Also shapes that are no area: their error says so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaQuery:
    """Selection of features to read."""

    # a file; or ``WEST,SOUTH,EAST,NORTH`` in degrees; or ``LAT,LON,RADIUS`` in degrees and metres; or well-known text
    source: str
    layer: str | None = None  # of the file; none: the only one
    feature: str | None = None  # name or number (from 1) of one feature; none: all of them
    crs: str | None = None  # the coordinate system, such as ``EPSG:32632``, instead of the one that the file names
    make_valid: bool = False  # whether outlines that cross themselves and rings that are not closed are mended
    swap_axes: bool = False  # whether the file has latitude, or north, first


@dataclass(frozen=True, slots=True)
class FoundArea:
    """An area on WGS 84."""

    parts: tuple[Rings, ...]  # its polygons, each an outer ring and holes of (longitude, latitude), -180..180
    name: str  # of its only feature, or of the file; empty for a box, a circle or text
    is_file: bool  # whether it was read from a file
    notes: tuple[str, ...]  # what was repaired or left out, one line each


def is_area_file(source: str) -> bool:
    """Whether the name or the text is an area's, and not a scenario's."""
    return Path(source).suffix.lower() in SUFFIXES or is_area_text(source)


def is_area_text(source: str) -> bool:
    """Whether it is a box, a circle or well-known text, and not the name of a file."""
    return bool(_NUMBERS.fullmatch(source) and "," in source) or bool(_WKT.match(source))


def read_area(query: AreaQuery, *, folder: Path = Path()) -> FoundArea:
    """Read an area.

    Raises:
        InputError: one line that names the file and the feature, what is wrong there, and the way out.
    """
    is_file = not is_area_text(query.source)
    path = folder / query.source
    document = read_document(path, query.layer) if is_file else _read_text(query.source)
    if document.unclosed and not query.make_valid:
        raise InputError(
            f"{document.source}: {document.unclosed[0]}; repeat its first corner at the end, or use --make-valid"
        )
    features = chosen(document, query.layer, query.feature)
    reading = RingReading(_system(document, query), document.rings_may_be_open, query.make_valid, query.swap_axes)
    polygons: list[shapely.Polygon] = []
    mended: list[str] = []
    for where, feature in features:
        for rings in feature.polygons:
            found, notes = read_polygons(rings, reading, f"{document.source}, {where}" if is_file else document.source)
            polygons += found
            mended += notes
    names = {feature.name for _, feature in features}
    name = names.pop() if len(names) == 1 else ""
    return FoundArea(
        tuple(rings_of(polygon) for polygon in joined(polygons)),
        name or (path.stem if is_file else ""), is_file, (*document.notes, *document.unclosed, *mended),
    )  # fmt: skip


def _system(document: AreaDocument, query: AreaQuery) -> CRS:
    if query.crs is not None:
        try:
            return _on_earth(CRS.from_user_input(query.crs), "--crs")
        except CRSError as error:
            raise InputError(f"--crs: unknown coordinate system {query.crs!r}; use, for example, EPSG:32632") from error
    if document.crs is None:
        raise InputError(
            f"{document.source}: the file does not state its coordinate system (for a Shapefile, this is in a .prj "
            "file beside it); specify it with --crs EPSG:NUMBER"
        )
    return _on_earth(document.crs, document.source)


def _on_earth(crs: CRS, where: str) -> CRS:
    """The horizontal part of a system."""
    crs = crs.sub_crs_list[0] if crs.is_compound else crs
    if not (crs.is_geographic or crs.is_projected):
        raise InputError(
            f"{where}: {crs.name!r} is not a coordinate system on Earth; specify one with --crs EPSG:NUMBER"
        )
    return crs


def read_document(path: Path, layer: str | None) -> AreaDocument:
    """The polygons of a file of any known format, not yet checked.

    Raises:
        InputError: it is no such file, or cannot be read.
    """
    suffix = path.suffix.lower()
    if not path.exists():
        raise InputError(f"{path}: no such file; an area is a file, WEST,SOUTH,EAST,NORTH, LAT,LON,RADIUS or WKT")
    if path.is_dir() or suffix not in SUFFIXES:
        what = "this is a folder" if path.is_dir() else f"{suffix or 'no suffix'} is not a supported area format"
        raise InputError(f"{path}: {what}; use one of {', '.join(SUFFIXES)}")
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path}: the file is empty; save it again")
    if size > MAX_BYTES:
        raise InputError(f"{path}: the file has {size:,} bytes, but the limit is {MAX_BYTES:,}; save only the area")
    if suffix in (*gis_file.SUFFIXES, ".zip"):
        return gis_file.read_gis_file(path, layer)
    try:
        data = kml_of(path) if suffix == ".kmz" else path.read_bytes()
        text = text_from_bytes(data).text
        if suffix == ".kmz":
            return read_kml(text, str(path))
        read = TEXT_FORMATS.get(suffix) or load("uavcover.area_readers", suffix.removeprefix("."))
        document: AreaDocument = read(text, str(path))
        return document
    except FormatError as error:
        advice = "" if error.advice else "; save it again with the program that wrote it"
        raise InputError(f"{path}: {error}{advice}") from error
    except OSError as error:
        raise InputError(f"{path}: the file cannot be read ({error.strerror or type(error).__name__})") from error


def _read_text(source: str) -> AreaDocument:
    if _WKT.match(source):
        return read_wkt(source, "the area")
    match = _NUMBERS.fullmatch(source)
    if match is None:
        raise InputError(f"{source}: this is not an area; use a file, WEST,SOUTH,EAST,NORTH, LAT,LON,RADIUS or WKT")
    kind, unit = (match[1] or "").lower(), (match[3] or "").lower()
    numbers = [float(number) for number in match[2].split(",")]
    if len(numbers) == 3 and kind in ("", "circle"):
        return _circle(source, numbers, 1000.0 if unit == "km" else 1.0)
    if len(numbers) == 4 and kind in ("", "bbox", "box") and not unit:
        return _box(source, numbers)
    raise InputError(
        f"{source}: cannot interpret {len(numbers)} numbers as an area; write a box as WEST,SOUTH,EAST,NORTH in "
        "degrees, or a circle as LAT,LON,RADIUS with the radius in metres"
    )


def _circle(source: str, numbers: list[float], metres: float) -> AreaDocument:
    lat, lon, radius = numbers[0], numbers[1], numbers[2] * metres
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        raise InputError(f"{source}: latitude {lat:g}, longitude {lon:g} is not a position; write LAT,LON,RADIUS")
    if not 1.0 <= radius <= 50_000.0:
        raise InputError(f"{source}: the radius must be between 1 and 50,000 m, not {radius:g} m; use metres")
    return AreaDocument(source, (AreaFeature(((circle_ring(lat, lon, radius),),)),))


def _box(source: str, numbers: list[float]) -> AreaDocument:
    west, south, east, north = numbers
    if not (max(abs(south), abs(north)) <= 90.0 and max(abs(west), abs(east)) <= 180.0):
        raise InputError(f"{source}: these are not longitudes and latitudes; write WEST,SOUTH,EAST,NORTH in degrees")
    if not north > south or west == east:
        raise InputError(
            f"{source}: north {north:g} is not above south {south:g}, or west is east; write WEST,SOUTH,EAST,NORTH"
        )
    if math.fmod(east - west + 360.0, 360.0) > 180.0:
        raise InputError(
            f"{source}: the box from west {west:g} to east {east:g} covers more than half the Earth; write "
            "WEST,SOUTH,EAST,NORTH"
        )
    ring = ((west, south), (east, south), (east, north), (west, north), (west, south))
    return AreaDocument(source, (AreaFeature(((ring,),)),))
