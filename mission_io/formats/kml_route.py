"""A line of KML with heights as a mission."""

from xml.etree import ElementTree

from mission_io.errors import FormatError
from mission_io.formats.point_route import (
    PointRoute,
    RouteStop,
    child_text,
    local_name,
    number_in,
    route_from_stops,
    xml_root,
)
from mission_io.model.items import Frame

_HEAD = 2000
"""Characters in which a document names its formats."""
_FRAMES = {"absolute": Frame.AMSL, "relativeToGround": Frame.ABOVE_TERRAIN}


def read_route(text: str) -> PointRoute:
    """Read the only line of a KML document that has heights.

    ``altitudeMode`` absolute is above mean sea level, relativeToGround above the terrain; a line that is clamped to the ground
    has no heights to fly at.

    Raises:
        FormatError: no KML, no such line or several, or a place that is none, with its number.
    """
    root, repairs = xml_root(text)
    if local_name(root) != "kml":
        raise FormatError(f"the document is a {local_name(root)[:40]!r}", where="XML", advice="give a KML file")
    if "dji.com/wpmz" in text[:_HEAD]:
        raise FormatError(
            "is DJI's template.kml, the settings from which a flight is made, and not a flight", where="kml",
            advice="give the .kmz with its waylines.wpml, or the area in it to new",
        )  # fmt: skip
    lines = [element for element in root.iter() if local_name(element) == "LineString"]
    high = [line for line in lines if (child_text(line, "altitudeMode") or "") in _FRAMES]
    if len(high) != 1:
        raise FormatError(
            f"{len(lines)} lines, {len(high)} of them with heights (altitudeMode absolute or relativeToGround)", where="kml",
            advice="save the one that is flown alone, with heights",
        )  # fmt: skip
    return route_from_stops(_stops(high[0]), repairs=repairs)


def _stops(line: ElementTree.Element) -> list[RouteStop]:
    frame = _FRAMES[child_text(line, "altitudeMode") or ""]
    stops = []
    for number, entry in enumerate((child_text(line, "coordinates") or "").split(), start=1):
        numbers = entry.split(",")
        where = f"point {number}"
        if len(numbers) != 3:
            raise FormatError(f"{entry[:40]!r} is not longitude,latitude,height", where=where, advice="give heights")
        lon, lat, alt = (number_in(part, where) for part in numbers)
        stops.append(RouteStop(lat, lon, alt, frame))
    return stops
