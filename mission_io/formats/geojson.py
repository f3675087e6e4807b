"""GeoJSON (RFC 7946): writes a route as a line and its points, and reads drawings."""

import json
import math
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.drawings import (
    Drawing,
    DrawnArea,
    DrawnLine,
    RoutePoint,
    Spot,
    alt_amsl_m,
    open_ring,
    place_of,
    route_of,
)
from mission_io.formats.json_node import Node, parse_json
from mission_io.formats.text import clean_text
from mission_io.model.areas import LatLon
from mission_io.model.items import Mission


def write_mission(mission: Mission, *, name: str = "mission") -> str:
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


def read_drawing(text: str) -> Drawing:
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
                rings = [open_ring(_places(ring), ring.where, repairs) for ring in polygon.nodes()]
                unclosed += repairs[before:]
                if not rings:
                    repairs.append(f"{polygon.where}: ignored an empty polygon")
                    continue
                areas.append(DrawnArea(rings[0], tuple(rings[1:]), name))
        elif kind in ("LineString", "MultiLineString"):
            lines += [DrawnLine(tuple(_places(line)), name) for line in _one_or_many(node, kind)]
        elif kind in ("Point", "MultiPoint"):
            spots += [Spot(_place(point), name) for point in _one_or_many(node, kind)]
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


def _places(node: Node) -> list[LatLon]:
    positions = node.value
    if type(positions) is list:
        places = [_plain_place(position) for position in positions]
        if None not in places:
            return [place for place in places if place is not None]
    return [_place(position) for position in node.nodes()]


def _plain_place(position: Any) -> LatLon | None:
    """The position, if it is valid; None leaves the error message to the careful reader."""
    if (
        type(position) is not list
        or len(position) < 2
        or type(position[0]) is not float
        or type(position[1]) is not float
    ):
        return None
    lon_deg, lat_deg = position[:2]
    return LatLon(lat_deg, lon_deg) if -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0 else None


def _place(node: Node) -> LatLon:
    numbers = node.nodes()
    if len(numbers) < 2:
        raise FormatError(f"the position has {len(numbers)} numbers", where=node.where, advice="use longitude,latitude")
    lon_deg, lat_deg = numbers[0].number(), numbers[1].number()
    return place_of(lon_deg, lat_deg, node.where)


def _check_reference_system(node: Node) -> None:
    """Refuse another reference system, which documents before RFC 7946 could name; read as WGS 84, positions would be wrong."""
    if node.value.get("crs") is None:
        return
    crs = node.get("crs")
    name = crs.get("properties").get("name").text()
    if name.upper().replace("::", ":").rpartition(":")[2] not in ("CRS84", "4326"):
        raise FormatError(f"the reference system is {name[:40]!r}", where=crs.where, advice="export the file in WGS 84")
