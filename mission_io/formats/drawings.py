"""Drawings of map programs, as data, as GeoJSON and as lists of positions: areas with holes, lines and spots.

Also the positions of a mission in flying order, as the export formats draw them.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import words_of
from mission_io.formats.text import (
    MissionFile,
    Node,
    check_position,
    clean_text,
    finite_number,
    is_position,
    parse_json,
)
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    Mission,
    MissionItem,
    RallyPoints,
)


def position_of(lon_deg: float, lat_deg: float, where: str) -> LatLon:
    """A position of a format that writes the longitude first. Raises FormatError: it is none, with ``where``."""
    if not is_position(lat_deg, lon_deg):
        what = f"longitude {lon_deg:g}, latitude {lat_deg:g} is not a valid position"
        raise FormatError(what, where=where, advice="write longitude first")
    return LatLon(lat_deg, lon_deg)


@dataclass(frozen=True, slots=True)
class DrawnArea:
    """A polygon, possibly with holes. Its rings are not closed: no vertex is repeated."""

    exterior: tuple[LatLon, ...]  # the outer ring
    holes: tuple[tuple[LatLon, ...], ...] = ()  # the inner rings
    name: str = ""  # of its feature or placemark
    folder: str = ""  # the innermost folder that it is in, where a format has folders


@dataclass(frozen=True, slots=True)
class DrawnLine:
    """A line through positions."""

    points: tuple[LatLon, ...]
    name: str = ""


@dataclass(frozen=True, slots=True)
class Spot:
    """A single position."""

    point: LatLon
    name: str = ""


@dataclass(frozen=True, slots=True)
class Drawing:
    """The content of a drawing, each kind in the order of the file."""

    areas: tuple[DrawnArea, ...] = ()  # the polygons; a multipolygon is several
    lines: tuple[DrawnLine, ...] = ()  # the lines
    spots: tuple[Spot, ...] = ()  # the single positions
    repairs: tuple[str, ...] = ()  # what was repaired or dropped to read it, one line each
    unclosed: tuple[str, ...] = ()  # those of the repairs that are about rings that were not closed


def open_ring(points: list[LatLon], where: str, repairs: list[str]) -> tuple[LatLon, ...]:
    """A closed ring, as files have it, without the repeated first point.

    Raises:
        FormatError: fewer than three different corners.
    """
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    elif points:
        repairs.append(f"{where}: the ring was not closed")
    if len(set(points)) < 3:
        raise FormatError(f"only {len(set(points))} different corners", where=where, advice="an area needs at least 3")
    return tuple(points)


_FLOWN_TO = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_TAKEOFF, Command.NAV_LAND})


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A position of the route: the item's number (from 1) and the item, with the height in its own frame."""

    number: int
    item: MissionItem


def route_of(mission: Mission) -> tuple[RoutePoint, ...]:
    """The items with a position to fly to, in order, with their numbers in the mission (home is 0)."""
    return tuple(
        RoutePoint(number, item)
        for number, item in enumerate(mission.items, start=1)
        if item.has_position and item.command in _FLOWN_TO
    )


def alt_amsl_m(point: RoutePoint, mission: Mission) -> float:
    """The height of a point above mean sea level in metres.

    Raises:
        FormatError: heights above home in a mission without home, or heights above terrain, which is unknown here.
    """
    item = point.item
    if item.frame is Frame.AMSL:
        return item.alt_m
    where = f"item {point.number}"
    if item.frame is Frame.ABOVE_TERRAIN:
        raise FormatError("its height is above the terrain, which this conversion does not know", where=where)
    if mission.home is None:
        raise FormatError(
            "its height is above home, but the mission has no home", where=where, advice="specify the home"
        )
    return mission.home.alt_amsl_m + item.alt_m


# GeoJSON (RFC 7946): writes a route as a line and its points, and reads drawings.


def write_geojson(mission: Mission, *, name: str = "mission") -> str:
    """Write a mission's route as a FeatureCollection.

    Positions are longitude, latitude and height in metres. Unlike in RFC 7946 the height is above mean sea level, not above
    the ellipsoid; the property ``height_datum`` of each feature says so.

    Raises:
        FormatError: an unknown height above mean sea level, or a number that is not finite.
    """
    points = [(point, _position(point, mission)) for point in route_of(mission)]
    features: list[dict[str, Any]] = []
    if len(points) > 1:
        line = {"type": "LineString", "coordinates": [position for _, position in points]}
        features.append(_feature(line, {"name": name, "height_datum": "AMSL"}))
    for point, position in points:
        properties = {
            "item": point.number,
            "command": int(point.item.command),
            "frame": point.item.frame.name,
            "alt_m": point.item.alt_m,
            "height_datum": "AMSL",
        }
        features.append(_feature({"type": "Point", "coordinates": position}, properties))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False) + "\n"


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _position(point: RoutePoint, mission: Mission) -> list[float]:
    position = [point.item.lon_deg, point.item.lat_deg, alt_amsl_m(point, mission)]
    if not all(math.isfinite(value) for value in position):
        raise FormatError("a coordinate is not a finite number", where=f"item {point.number}")
    return position


def read_geojson(text: str) -> Drawing:
    """Read areas with holes, lines and points of a GeoJSON document, in order, with the ``name`` of their feature.

    Heights are dropped. Open rings are closed, and listed as repairs.

    Raises:
        FormatError: with the place in the document, for invalid GeoJSON, a reference system other than WGS 84 (the only
            one of RFC 7946), and invalid coordinates.
    """
    clean = clean_text(text)
    areas: list[DrawnArea] = []
    lines: list[DrawnLine] = []
    spots: list[Spot] = []
    repairs, unclosed = list(clean.repairs), list[str]()
    todo = [(parse_json(clean.text, "document"), "")]
    while todo:
        node, name = todo.pop()
        kind = node.get("type").text()
        _check_reference_system(node)
        if kind == "FeatureCollection":
            todo += [(feature, name) for feature in reversed(node.get("features").nodes())]
        elif kind == "Feature":
            if node.get("geometry").value is None:
                repairs.append(f"{node.where}: ignored a feature without a geometry")
            else:
                todo.append((node.get("geometry"), _name_of(node)))
        elif kind == "GeometryCollection":
            todo += [(geometry, name) for geometry in reversed(node.get("geometries").nodes())]
        elif kind in ("Polygon", "MultiPolygon"):
            for polygon in _one_or_many(node, kind):
                before = len(repairs)
                rings = [open_ring(_positions(ring), ring.where, repairs) for ring in polygon.nodes()]
                unclosed += repairs[before:]
                if not rings:
                    repairs.append(f"{polygon.where}: ignored an empty polygon")
                    continue
                areas.append(DrawnArea(rings[0], tuple(rings[1:]), name))
        elif kind in ("LineString", "MultiLineString"):
            lines += [DrawnLine(tuple(_positions(line)), name) for line in _one_or_many(node, kind)]
        elif kind in ("Point", "MultiPoint"):
            spots += [Spot(_read_position(point), name) for point in _one_or_many(node, kind)]
        else:
            raise FormatError(f"{kind[:30]!r} is not a GeoJSON type", where=f"{node.where}.type")
    return Drawing(tuple(areas), tuple(lines), tuple(spots), tuple(repairs), tuple(unclosed))


def _name_of(feature: Node) -> str:
    properties = feature.value.get("properties")
    name = properties.get("name") if isinstance(properties, dict) else None
    return name if isinstance(name, str) else ""


def _one_or_many(node: Node, kind: str) -> list[Node]:
    coordinates = node.get("coordinates")
    return coordinates.nodes() if kind.startswith("Multi") else [coordinates]


def _positions(node: Node) -> list[LatLon]:
    pairs = node.value
    if type(pairs) is list:
        positions = [_plain_position(pair) for pair in pairs]
        if None not in positions:
            return [position for position in positions if position is not None]
    return [_read_position(pair) for pair in node.nodes()]


def _plain_position(pair: Any) -> LatLon | None:
    """The position, if it is valid; None leaves the error message to the careful reader."""
    if type(pair) is not list or len(pair) < 2 or type(pair[0]) is not float or type(pair[1]) is not float:
        return None
    lon_deg, lat_deg = pair[:2]
    return LatLon(lat_deg, lon_deg) if -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0 else None


def _read_position(node: Node) -> LatLon:
    numbers = node.nodes()
    if len(numbers) < 2:
        raise FormatError(f"the position has {len(numbers)} numbers", where=node.where, advice="use longitude,latitude")
    lon_deg, lat_deg = numbers[0].number(), numbers[1].number()
    return position_of(lon_deg, lat_deg, node.where)


def _check_reference_system(node: Node) -> None:
    """Refuse another reference system, which documents before RFC 7946 could name; read as WGS 84, positions would be wrong."""
    if node.value.get("crs") is None:
        return
    crs = node.get("crs")
    name = crs.get("properties").get("name").text()
    if name.upper().replace("::", ":").rpartition(":")[2] not in ("CRS84", "4326"):
        raise FormatError(f"the reference system is {name[:40]!r}", where=crs.where, advice="export the file in WGS 84")


# ``.poly`` and ``.fen`` files of MAVProxy and Mission Planner: one position a line, latitude and longitude.
#
# A ``.poly`` file is an area. A ``.fen`` file is a fence of the old kind: the return point first, then one inclusion polygon.
# Both begin with a comment and repeat the first corner at the end. MAVProxy's old rally points are a word and six numbers.


def read_area_list(text: str) -> Drawing:
    """Read a ``.poly`` file, which has one area.

    Raises:
        FormatError: with the line, for an invalid position, and for fewer than three corners.
    """
    positions, repairs = _listed_positions(text)
    ring = open_ring(positions, "the area", repairs)
    return Drawing((DrawnArea(ring),), repairs=tuple(repairs))


def read_fence_list(text: str) -> MissionFile:
    """Read a ``.fen`` file.

    The return point has no height in the file. It is set to 0 m above home, which autopilots take as "the height set in the
    parameters".

    Raises:
        FormatError: with the line, for an invalid position, and for fewer than a return point and three corners.
    """
    positions, repairs = _listed_positions(text)
    if not positions:
        raise FormatError("the file contains no positions", where="line 1", advice="begin with the return point")
    ring = open_ring(positions[1:], "the fence", repairs)
    return_point = FramedPoint(positions[0].lat_deg, positions[0].lon_deg, 0.0, Frame.ABOVE_HOME)
    return MissionFile(fence=Fence((FencePolygon(ring),), (), return_point), repairs=tuple(repairs))


def _contents(text: str) -> Iterator[tuple[str, str]]:
    """Each line with content other than a comment: its position, and its content."""
    for number, line in enumerate(text.split("\n"), start=1):
        content = line.split("#", 1)[0].strip()
        if content:
            yield f"line {number}", content


def _listed_positions(text: str) -> tuple[list[LatLon], list[str]]:
    clean = clean_text(text)
    repairs = list(clean.repairs)
    positions: list[LatLon] = []
    for where, content in _contents(clean.text):
        try:
            found = words_of(content, 2)
        except FormatError as error:
            raise FormatError(error.what, where=where, advice=error.advice or "latitude, then longitude") from None
        if found.changed:
            repairs.append(f"{where}: {found.changed}{' to spaces' if found.has_other_separators else ''}")
        lat_deg, lon_deg = (finite_number(word, where) for word in found.words)
        check_position(lat_deg, lon_deg, where)
        positions.append(LatLon(lat_deg, lon_deg))
    return positions, repairs


_RALLY_ADVICE = "a rally point must consist of RALLY and 6 numbers"


def read_rally_list(text: str) -> MissionFile:
    """Read rally points, ``RALLY latitude longitude altitude break_altitude landing_direction flags`` a line.

    The altitude is in metres above home. Fields without a present equivalent are dropped, and listed where they are set.

    Raises:
        FormatError: with the line.
    """
    clean = clean_text(text)
    repairs = list(clean.repairs)
    points: list[FramedPoint] = []
    for where, content in _contents(clean.text):
        try:
            found = words_of(content, 7)
        except FormatError as error:
            what = f"the row has {len(content.split())} columns and begins with {content.split()[0][:20]!r}"
            raise FormatError(what, where=where, advice=error.advice or _RALLY_ADVICE) from None
        word, *columns = found.words
        if word != "RALLY":
            raise FormatError(f"7 columns beginning with {word[:20]!r}", where=where, advice=_RALLY_ADVICE)
        if found.changed:
            repairs.append(f"{where}: {found.changed}")
        lat_deg, lon_deg, alt_m, *dropped = (finite_number(column, where) for column in columns)
        check_position(lat_deg, lon_deg, where)
        if any(dropped):
            repairs.append(f"{where}: break altitude, landing direction and flags were dropped")
        points.append(FramedPoint(lat_deg, lon_deg, alt_m, Frame.ABOVE_HOME))
    return MissionFile(rally=RallyPoints(tuple(points)), repairs=tuple(repairs))
