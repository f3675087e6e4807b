"""GeoJSON writer (RFC 7946): the route as a line and its points."""

import json
import math
from typing import Any

from mission_io.errors import FormatError
from mission_io.formats.route import RoutePoint, alt_amsl_m, route_of
from mission_io.items import Mission


def write_mission(mission: Mission, *, name: str = "mission") -> str:
    """A mission's route as a FeatureCollection.

    Positions are longitude, latitude and, as RFC 7946 would have it, a height in metres; it is above mean sea level,
    not above the ellipsoid, and the property ``height_datum`` of each feature says so.

    Raises:
        FormatError: a height above mean sea level that cannot be known, or a number that is not finite.
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
        raise FormatError("a coordinate is not finite", where=f"item {point.number}")
    return position
