"""The one reader of areas: a file of any known format, a box, a circle, or well-known text.

Rings of a file become valid polygons in longitude and latitude; errors say where and what to do.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import CRSError, ProjError

from mission_io.errors import FormatError
from mission_io.formats.text import text_from_bytes
from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Ring, Rings
from uavcover.plugins import load, registered
from uavcover.scenario.areas.features import (
    GIS_SUFFIXES,
    AreaDocument,
    AreaFeature,
    chosen,
    kml_of,
    polygons_of_shape,
    read_gis_file,
)
from uavcover.scenario.areas.text_formats import TEXT_FORMATS, circle_ring, read_kml, read_wkt

SMALLEST_M2 = 1.0
_EARTH = Geod(ellps="WGS84")


@dataclass(frozen=True, slots=True)
class RingReading:
    """Settings for reading rings."""

    crs: CRS  # their coordinate system
    may_be_open: bool = False  # whether the last corner need not repeat the first
    # whether rings that are not closed are closed, and invalid polygons replaced by the union of their outlines minus
    # the union of their holes
    make_valid: bool = False
    swap_axes: bool = False  # whether the file has latitude, or north, first


def read_polygons(rings: Rings, reading: RingReading, where: str) -> tuple[list[shapely.Polygon], tuple[str, ...]]:
    """Read a polygon of a file in longitude and latitude, in several parts if the repair gives several.

    Also return a note on the repair. Longitudes of one polygon are continuous, also across 180 degrees.

    Raises:
        InputError: describes the problem of the polygon, its position, and the solution.
    """
    outlines = [_outline(ring, reading, f"{where}{f', hole {n}' if n else ''}") for n, ring in enumerate(rings)]
    if reading.crs.is_geographic:
        outlines = _continuous(outlines, reading, where)
    polygon = shapely.Polygon(outlines[0], outlines[1:])
    parts = [polygon]
    if not polygon.is_valid:
        parts = _repaired(polygon, reading, where)
    if not any(part.area > 0.0 for part in parts):
        if shapely.Polygon(outlines[0]).area > 0.0:
            raise InputError(f"{where}: the holes cover the whole area; remove some of them")
        raise InputError(f"{where}: all corners lie on one line, so the area is zero; draw it again")
    found = [_geographic(part, reading, where) for part in parts if part.area > 0.0]
    size_m2 = sum(_area_m2(part) for part in found)
    if size_m2 < SMALLEST_M2:
        raise InputError(
            f"{where}: the area is only {size_m2:.2g} square metres; if the coordinates use another coordinate "
            "system, specify it with --crs"
        )
    if polygon.is_valid:
        return found, ()
    written_m2 = _area_m2(_geographic(polygon, reading, where))
    return found, (
        f"{where}: repaired with make_valid ({written_m2 / 1e4:,.4g} ha before, {size_m2 / 1e4:,.4g} ha after)",
    )


def _area_m2(polygon: shapely.Polygon) -> float:
    """Area of the outline minus its holes, each as it is drawn."""
    outer, *holes = (abs(_EARTH.geometry_area_perimeter(ring)[0]) for ring in (polygon.exterior, *polygon.interiors))
    return float(outer - sum(holes))


def _outline(ring: Ring, reading: RingReading, where: str) -> FloatArray:
    """(n, 2) corners, x or longitude first, closed."""
    corners = np.array(ring, dtype=float).reshape(-1, 2)
    if not np.isfinite(corners).all():
        number = int(np.argmin(np.isfinite(corners).all(axis=1))) + 1
        raise InputError(f"{where}: corner {number} is not a pair of finite numbers; remove or correct it")
    if len(np.unique(corners, axis=0)) < 3:
        raise InputError(
            f"{where}: the ring has {len(np.unique(corners, axis=0))} different corners, but needs at least 3; draw it again"
        )
    if not np.array_equal(corners[0], corners[-1]):
        if not (reading.may_be_open or reading.make_valid):
            raise InputError(
                f"{where}: the ring is not closed: it ends at {_pair(corners[-1])} and begins at {_pair(corners[0])}; "
                "repeat the first corner at the end, or use --make-valid"
            )
        corners = np.vstack([corners, corners[:1]])
    return corners[:, ::-1] if reading.swap_axes else corners


def _continuous(outlines: Sequence[FloatArray], reading: RingReading, where: str) -> list[FloatArray]:
    """Longitudes without jumps of 360 degrees, those of holes beside those of the outer ring."""
    turn = 2.0 * math.pi / reading.crs.axis_info[0].unit_conversion_factor
    found: list[FloatArray] = []
    for outline in outlines:
        lons, lats = outline.T
        worst = int(np.argmax(np.abs(lats)))
        if abs(lats[worst]) > 0.25 * turn or np.abs(lons).max() > turn:
            swapped = np.abs(lons).max() <= 0.25 * turn and np.abs(lats).max() <= 0.5 * turn
            worst = worst if abs(lats[worst]) > 0.25 * turn else int(np.argmax(np.abs(lons)))
            raise InputError(
                f"{where}: longitude {lons[worst]:.10g}, latitude {lats[worst]:.10g} is not a position on Earth; "
                + (
                    "the axes seem to be swapped: write longitude first, or use --swap-axes"
                    if swapped
                    else "specify the file's coordinate system with --crs EPSG:NUMBER"
                )
            )
        steps = np.diff(lons)
        steps -= turn * np.round(steps / turn)
        unwrapped = np.concatenate([lons[:1], lons[0] + np.cumsum(steps)])
        if np.array_equal(np.round((unwrapped - lons) / turn), np.zeros(len(lons))):
            unwrapped = lons  # to the bit as it was
        elif abs(unwrapped[-1] - unwrapped[0]) > 0.5 * turn:
            raise InputError(f"{where}: the area contains a pole, which is not supported; use a smaller area")
        if found:
            unwrapped = unwrapped + turn * np.round((found[0][:, 0].mean() - unwrapped.mean()) / turn)
        found.append(np.column_stack([unwrapped, lats]))
    return found


def _repaired(polygon: shapely.Polygon, reading: RingReading, where: str) -> list[shapely.Polygon]:
    if polygon.area == 0.0 and polygon.convex_hull.area == 0.0:
        return [polygon]
    if not reading.make_valid:
        reason, _, position = shapely.is_valid_reason(polygon).partition("[")
        numbers = [float(number) for number in position.rstrip("]").split()[:2]]
        at = f" at {_position(numbers, reading)}" if len(numbers) == 2 else ""
        what = {
            "Self-intersection": "the outline crosses itself",
            "Ring Self-intersection": "the outline touches itself",
            "Hole lies outside shell": "a hole lies outside",
            "Nested holes": "a hole lies in another hole",
            "Interior is disconnected": "holes divide the area into separate parts",
        }.get(reason.strip(), reason.strip().lower())
        raise InputError(f"{where}: {what}{at}; correct it there, or use --make-valid")
    # Ring by ring: the default method counts crossings and fills holes that overlap or touch the outline, and "structure" takes
    # a hole outside of the outline for another outline.
    outline, *holes = (
        shapely.make_valid(shapely.Polygon(ring), method="structure", keep_collapsed=False)
        for ring in (polygon.exterior, *polygon.interiors)
    )
    return [shapely.Polygon(one[0], one[1:]) for one in polygons_of_shape(outline - shapely.union_all(holes))]


def _geographic(polygon: shapely.Polygon, reading: RingReading, where: str) -> shapely.Polygon:
    """A polygon of the file's system in longitude and latitude on WGS 84."""
    if reading.crs.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        return polygon
    rings = [
        _lon_lat(np.asarray(ring.coords)[:, :2], reading, where) for ring in (polygon.exterior, *polygon.interiors)
    ]
    wgs84 = RingReading(CRS.from_epsg(4326))
    rings = _continuous(rings, wgs84, where)
    return shapely.Polygon(rings[0], rings[1:])


def _lon_lat(corners: FloatArray, reading: RingReading, where: str) -> FloatArray:
    try:
        transformer = Transformer.from_crs(reading.crs, 4326, always_xy=True, allow_ballpark=False)
        lon, lat = transformer.transform(corners[:, 0], corners[:, 1], errcheck=True)
    except ProjError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{where}: the area cannot be converted from {reading.crs.name} to longitude and latitude ({reason}); "
            "specify the correct coordinate system with --crs, or convert the file (ogr2ogr -t_srs EPSG:4326)"
        ) from error
    return np.column_stack([lon, lat])


def _position(numbers: list[float], reading: RingReading) -> str:
    """A position of the file, as longitude and latitude where possible."""
    try:
        lon, lat = (
            numbers
            if reading.crs.is_geographic
            else Transformer.from_crs(reading.crs, 4326, always_xy=True).transform(numbers[0], numbers[1])
        )
    except ProjError:
        return _pair(numbers)
    return f"longitude {math.remainder(lon, 360.0):.6f}, latitude {lat:.6f}"


def _pair(numbers: Any) -> str:
    return f"({numbers[0]:.10g}, {numbers[1]:.10g})"


def joined(polygons: Sequence[shapely.Polygon]) -> list[shapely.Polygon]:
    """Polygons side by side in longitude: those that were cut at 180 degrees, as GeoJSON wants it, are one again."""
    if not polygons:
        return []
    first = polygons[0].centroid.x
    turns = [round((polygon.centroid.x - first) / 360.0) for polygon in polygons]
    if not any(turns):
        return list(polygons)
    moved = [
        polygon if not turn else shapely.transform(polygon, lambda p, t=turn: p - np.array([360.0 * t, 0.0]))  # type: ignore[misc]
        for polygon, turn in zip(polygons, turns, strict=True)
    ]
    union = shapely.union_all(moved)
    return [part for part in shapely.get_parts(union) if isinstance(part, shapely.Polygon)]


def rings_of(polygon: shapely.Polygon) -> Rings:
    """The rings of a polygon, longitudes within -180..180."""
    (rings,) = polygons_of_shape(polygon)
    return tuple(tuple((_wrapped(lon), lat) for lon, lat in ring) for ring in rings)


def _wrapped(lon_deg: float) -> float:
    return lon_deg if -180.0 <= lon_deg <= 180.0 else math.remainder(lon_deg, 360.0)


SUFFIXES = (
    *TEXT_FORMATS,
    ".kmz",
    *GIS_SUFFIXES,
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
"""Including shapes without area, which get an error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaQuery:
    """Selection of features to read."""

    # a file; or ``WEST,SOUTH,EAST,NORTH`` in degrees; or ``LAT,LON,RADIUS`` in degrees and metres; or well-known text
    source: str
    layer: str | None = None  # of the file; None: the only one
    feature: str | None = None  # name or number (from 1) of one feature; None: all of them
    crs: str | None = None  # the coordinate system, such as ``EPSG:32632``, instead of the one that the file names
    make_valid: bool = False  # whether to repair outlines that cross themselves and rings that are not closed
    swap_axes: bool = False  # whether the file has latitude, or north, first


@dataclass(frozen=True, slots=True)
class FoundArea:
    """An area on WGS 84."""

    parts: tuple[Rings, ...]  # its polygons, each an outer ring and holes of (longitude, latitude), -180..180
    name: str  # of its only feature, or of the file; empty for a box, a circle or text
    is_file: bool  # whether it was read from a file
    notes: tuple[str, ...]  # what was repaired or omitted, one line each


def is_area_file(source: str) -> bool:
    """Whether the name or the text describes an area rather than a scenario."""
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
    repaired: list[str] = []
    for where, feature in features:
        for rings in feature.polygons:
            found, notes = read_polygons(rings, reading, f"{document.source}, {where}" if is_file else document.source)
            polygons += found
            repaired += notes
    names = {feature.name for _, feature in features}
    name = names.pop() if len(names) == 1 else ""
    return FoundArea(
        tuple(rings_of(polygon) for polygon in joined(polygons)),
        name or (path.stem if is_file else ""), is_file, (*document.notes, *document.unclosed, *repaired),
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
    if suffix in (*GIS_SUFFIXES, ".zip"):
        return read_gis_file(path, layer)
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
            f"{source}: south {south:g} must be below north {north:g}, and west must differ from east; write "
            "WEST,SOUTH,EAST,NORTH"
        )
    if math.fmod(east - west + 360.0, 360.0) > 180.0:
        raise InputError(
            f"{source}: the box from west {west:g} to east {east:g} covers more than half the Earth; write "
            "WEST,SOUTH,EAST,NORTH"
        )
    ring = ((west, south), (east, south), (east, north), (west, north), (west, south))
    return AreaDocument(source, (AreaFeature(((ring,),)),))
