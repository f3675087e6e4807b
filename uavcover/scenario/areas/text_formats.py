"""Areas in text: GeoJSON, KML, WKT, QGroundControl's .plan, ArduPilot's .poly and .fen."""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final

import shapely
from pyproj import CRS, Geod
from pyproj.exceptions import CRSError

from mission_io.errors import FormatError
from mission_io.formats import plan
from mission_io.formats.csv_tables import words_of
from mission_io.formats.drawings import Drawing, read_area_list, read_fence_list
from mission_io.formats.map_xml import read_kml_drawing
from mission_io.formats.text import Node, parse_json
from mission_io.model.items import Fence, LatLon
from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.model.area import Ring, Rings
from uavcover.scenario.areas.features import WGS84, AreaDocument, AreaFeature, polygons_of_shape

# ``.poly`` files of OpenStreetMap's tools (Osmosis, Geofabrik): sections of longitude and latitude, each ended by ``END``.


def is_osmosis(text: str) -> bool:
    """Whether a ``.poly`` file is one of these: those of MAVProxy and Mission Planner have numbers alone."""
    return any(line.strip() == "END" for line in text.splitlines())


def read_osmosis(text: str, source: str) -> AreaDocument:
    """The polygons of a file, each with the holes (sections whose name begins with ``!``) that lie in it.

    Raises:
        FormatError: with the line, for a place that is none, a section without ``END``, and a hole in no polygon.
    """
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    name = lines[0][1]
    outers: list[tuple[Ring, list[Ring]]] = []
    holes: list[tuple[int, Ring]] = []
    at = 1
    while at < len(lines) and lines[at][1] != "END":
        first, section = lines[at]
        ring, at = _section(lines, at + 1)
        if section.startswith("!"):
            holes.append((first, ring))
        else:
            outers.append((ring, []))
    for number, hole in holes:
        around = [inner for outer, inner in outers if shapely.Polygon(outer).intersects(shapely.Point(hole[0]))]
        if not around:
            raise FormatError("the hole does not lie inside a polygon", where=f"line {number}", advice="remove it")
        around[0].append(hole)
    features = tuple(AreaFeature(((outer, *inner),), name) for outer, inner in outers)
    return AreaDocument(source, features, rings_may_be_open=True)


def _section(lines: list[tuple[int, str]], at: int) -> tuple[Ring, int]:
    """The ring that begins at a line, and the line behind its ``END``."""
    positions: list[tuple[float, float]] = []
    for number, line in lines[at:]:
        at += 1
        if line == "END":
            if len(positions) < 3:
                raise FormatError(
                    f"the section has {len(positions)} positions",
                    where=f"line {number}",
                    advice="an area requires at least three",
                )
            return tuple(positions), at
        try:
            lon, lat = (float(word) for word in words_of(line, 2).words)
        except (ValueError, FormatError):
            lon = lat = math.nan
        if not (abs(lon) <= 180.0 and abs(lat) <= 90.0):
            raise FormatError(
                f"{line[:40]!r} is not a valid position",
                where=f"line {number}",
                advice="write longitude, then latitude",
            )
        positions.append((lon, lat))
    raise FormatError("the last section lacks END", where=f"line {lines[-1][0]}", advice="download the file again")


_CIRCLE_CORNERS = 72
_EARTH = Geod(ellps="WGS84")
_SURVEYS = ("survey", "StructureScan")


def read_geojson(text: str, source: str) -> AreaDocument:
    """GeoJSON of any kind; a ``crs`` as programs before RFC 7946 wrote it counts."""
    root = parse_json(text, "document")
    crs = WGS84
    found: list[AreaFeature] = []
    others: Counter[str] = Counter()
    todo: list[tuple[Node, Mapping[str, Any]]] = [(root, {})]
    while todo:
        node, properties = todo.pop()
        name = _name_of(properties)
        kind = node.get("type").text()
        if node.value.get("crs") is not None:
            crs = _named_system(node.get("crs"))
        if kind == "FeatureCollection":
            todo += [(one, {}) for one in reversed(node.get("features").nodes())]
        elif kind == "Feature":
            if node.value.get("geometry") is not None:
                todo.append((node.get("geometry"), _properties(node)))
        elif kind == "GeometryCollection":
            todo += [(one, properties) for one in reversed(node.get("geometries").nodes())]
        elif kind == "Polygon":
            found.append(AreaFeature((_rings(node.get("coordinates")),), name, properties=properties))
        elif kind == "MultiPolygon":
            parts = tuple(_rings(part) for part in node.get("coordinates").nodes())
            found += [AreaFeature(parts, name, properties=properties)] if parts else []
        else:
            others[kind[:30]] += 1
    return AreaDocument(source, tuple(found), crs, _counted(others))


def _named_system(node: Node) -> CRS:
    name = node.get("properties").get("name").text()
    if name.upper().replace("::", ":").rpartition(":")[2] == "CRS84":
        return WGS84
    try:
        return CRS.from_user_input(name)
    except CRSError:
        raise FormatError(f"unknown CRS {name[:60]!r}", where=node.where, advice="specify it with --crs") from None


def _properties(feature: Node) -> Mapping[str, Any]:
    properties = feature.value.get("properties")
    return properties if isinstance(properties, dict) else {}


def _name_of(properties: Mapping[str, Any]) -> str:
    for key, value in properties.items():
        if str(key).casefold() == "name" and isinstance(value, str | int | float):
            return str(value)
    return ""


def _rings(node: Node) -> Rings:
    rings = tuple(tuple(_pair(position) for position in ring.nodes()) for ring in node.nodes())
    if not rings:
        raise FormatError("the polygon has no rings", where=node.where, advice="remove it")
    return rings


def _pair(node: Node) -> tuple[float, float]:
    numbers = node.nodes()
    if len(numbers) < 2:
        raise FormatError(
            f"the position has {len(numbers)} numbers", where=node.where, advice="write longitude, latitude"
        )
    return numbers[0].number(), numbers[1].number()


_SRID = re.compile(r"\s*SRID\s*=\s*(\d+)\s*;", re.IGNORECASE)


def read_wkt(text: str, source: str) -> AreaDocument:
    """Well-known text: a POLYGON, MULTIPOLYGON or collection, also several, one a line; ``SRID=32632;`` in front counts."""
    prefix = _SRID.match(text)
    crs = WGS84
    if prefix is not None:
        try:
            crs = CRS.from_epsg(int(prefix[1]))
        except CRSError:
            raise InputError(
                f"{source}: SRID={prefix[1]} is not an EPSG coordinate system; specify it with --crs"
            ) from None
    body = text[prefix.end() :] if prefix is not None else text
    try:
        shapes = [shapely.from_wkt(body)]
    except (shapely.errors.GEOSException, NotImplementedError):
        shapes = [_shape_of_line(line, source) for line in body.splitlines() if line.strip()]
    features, others = [], Counter[str]()
    for shape in shapes:
        polygons = polygons_of_shape(shape)
        if polygons:
            features.append(AreaFeature(polygons))
        else:
            others[shape.geom_type if not shape.is_empty else "empty shape"] += 1
    return AreaDocument(source, tuple(features), crs, _counted(others))


def _shape_of_line(line: str, source: str) -> Any:
    try:
        return shapely.from_wkt(line)
    except NotImplementedError:
        raise InputError(f"{source}: curves are not supported; save the shape with straight sides") from None
    except shapely.errors.GEOSException as error:
        reason = str(error).strip().splitlines()[0]
        if "closed" in reason:
            raise InputError(f"{source}: a ring is not closed; repeat its first corner at the end") from error
        raise InputError(
            f"{source}: the argument is not valid WKT ({reason}); write it as POLYGON ((lon lat, lon lat, ...))"
        ) from error


def read_kml(text: str, source: str) -> AreaDocument:
    """KML, always longitude and latitude on WGS 84; folders are its layers."""
    document = _of_drawing(read_kml_drawing(text), source)
    if not document.features and not document.others and "<NetworkLink" in text:
        raise InputError(
            f"{source}: the file only links to another file, which uavcover does not download; save the polygon itself as KML"
        )
    return document


def read_poly(text: str, source: str) -> AreaDocument:
    """A ``.poly`` file: latitude and longitude of one polygon, line by line; or one of OpenStreetMap's tools."""
    if is_osmosis(text):
        return read_osmosis(text, source)
    return _of_drawing(Drawing(read_area_list(text).areas), source)


def read_fen(text: str, source: str) -> AreaDocument:
    """A ``.fen`` file: its fence is the area."""
    return AreaDocument(source, _of_fence(read_fence_list(text).fence or Fence()), rings_may_be_open=True)


def read_plan(text: str, source: str) -> AreaDocument:
    """A ``.plan`` file: the polygons of its surveys, or else its fence."""
    document = plan.read_to_keep(text)
    found = []
    for entry in document.entries:
        kind = entry.document.get("complexItemType")
        if kind in _SURVEYS:
            positions = [position.floats(2) for position in Node(entry.document, entry.kind).get("polygon").nodes()]
            found.append(AreaFeature(((tuple((lon, lat) for lat, lon in positions),),), layer="survey"))
    features = tuple(found) or _of_fence(document.fence)
    flown = len(document.mission.items)
    return AreaDocument(
        source, features, others=counted(flown, "mission item") if flown else "", rings_may_be_open=True
    )


def _of_drawing(drawing: Drawing, source: str) -> AreaDocument:
    features = tuple(
        AreaFeature((tuple(_corners(ring) for ring in (area.exterior, *area.holes)),), area.name, area.folder)
        for area in drawing.areas
    )
    others = _counted(Counter(line=len(drawing.lines), point=len(drawing.spots)))
    notes = tuple(repair for repair in drawing.repairs if repair not in drawing.unclosed)
    return AreaDocument(source, features, WGS84, others, rings_may_be_open=True, unclosed=drawing.unclosed, notes=notes)


def _of_fence(fence: Fence) -> tuple[AreaFeature, ...]:
    """Each inclusion as a feature; the exclusions are holes of it where they touch it."""
    shapes = [(one.inclusion, shapely.Polygon(_corners(one.vertices))) for one in fence.polygons]
    shapes += [
        (one.inclusion, shapely.Polygon(circle_ring(one.center.lat_deg, one.center.lon_deg, one.radius_m)))
        for one in fence.circles
    ]
    outside = [shape for inclusion, shape in shapes if not inclusion]
    found = []
    for inclusion, shape in shapes:
        if not inclusion:
            continue
        touching = [other for other in outside if other.is_valid and shape.is_valid and other.intersects(shape)]
        left = shape.difference(shapely.union_all(touching)) if touching else shape
        found.append(AreaFeature(polygons_of_shape(left), layer="fence"))
    return tuple(one for one in found if one.polygons)


def _corners(ring: Iterable[LatLon]) -> Ring:
    return tuple((position.lon_deg, position.lat_deg) for position in ring)


def circle_ring(lat_deg: float, lon_deg: float, radius_m: float) -> Ring:
    """A circle on the Earth as a closed ring of (longitude, latitude); its corners lie on the circle."""
    bearings = [360.0 * k / _CIRCLE_CORNERS for k in range(_CIRCLE_CORNERS)]
    count = len(bearings)
    lons, lats, _ = _EARTH.fwd([lon_deg] * count, [lat_deg] * count, bearings, [radius_m] * count)
    ring = tuple(zip(map(float, lons), map(float, lats), strict=True))
    return (*ring, ring[0])


def _counted(others: Counter[str]) -> str:
    return ", ".join(counted(n, kind) for kind, n in others.items() if n)


TEXT_FORMATS: Final[Mapping[str, Callable[[str, str], AreaDocument]]] = MappingProxyType(
    {
        ".geojson": read_geojson,
        ".json": read_geojson,
        ".kml": read_kml,
        ".wkt": read_wkt,
        ".plan": read_plan,
        ".poly": read_poly,
        ".fen": read_fen,
    }
)
"""Readers by the suffix of the file."""
