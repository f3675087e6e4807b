"""KML writer: the route as a line and its points, for Google Earth and map programs."""

from xml.sax.saxutils import escape

from mission_io.formats.numbers import degrees_text, plain_decimal
from mission_io.formats.route import RoutePoint, alt_amsl_m, route_of
from mission_io.items import Mission

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
<Document>
<name>{name}</name>
"""
_LINE = """<Placemark><name>route</name><LineString><altitudeMode>absolute</altitudeMode><coordinates>
{coordinates}
</coordinates></LineString></Placemark>
"""
_POINT = """<Placemark><name>{number}</name><Point><altitudeMode>absolute</altitudeMode>\
<coordinates>{coordinates}</coordinates></Point></Placemark>
"""
_TAIL = "</Document>\n</kml>\n"


def write_mission(mission: Mission, *, name: str = "mission") -> str:
    """A mission's route as KML: longitude, latitude, height above mean sea level in metres.

    Raises:
        FormatError: a height above mean sea level that cannot be known, or a number that is not finite.
    """

    def coordinates(point: RoutePoint) -> str:
        where, item = f"item {point.number}", point.item
        lon, lat = degrees_text(item.lon_deg, where), degrees_text(item.lat_deg, where)
        return f"{lon},{lat},{plain_decimal(alt_amsl_m(point, mission), where)}"

    points = [(point.number, coordinates(point)) for point in route_of(mission)]
    line = _LINE.format(coordinates="\n".join(text for _, text in points)) if len(points) > 1 else ""
    marks = "".join(_POINT.format(number=number, coordinates=text) for number, text in points)
    return _HEAD.format(name=escape(name)) + line + marks + _TAIL
