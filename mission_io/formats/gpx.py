"""GPX 1.1, for GPS receivers and map programs: a mission's route with home as a waypoint of its own.

Heights are above mean sea level, as GPS receivers show them. Elements stand in the order that the schema demands
(www.topografix.com/GPX/1/1/gpx.xsd); it takes longitudes from -180 to below 180 degrees.
"""

from mission_io.errors import FormatError
from mission_io.formats.drawings import alt_amsl_m, route_of
from mission_io.formats.text import degrees_text, place_problem, plain_decimal, xml_text
from mission_io.model.items import Command, GeoPoint, Mission

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="uavcover" xmlns="http://www.topografix.com/GPX/1/1">
<metadata><name>{name}</name></metadata>
"""
_KINDS = {Command.NAV_TAKEOFF: "take-off", Command.NAV_LAND: "landing"}


def write_mission(mission: Mission, *, name: str = "mission") -> str:
    """Write a mission's route as GPX; ``ele`` is the height above mean sea level in metres.

    Raises:
        FormatError: an unknown height above mean sea level, a position that is none, or a name that XML cannot hold.
    """
    name = xml_text(name)
    lines: list[str] = []
    if mission.home is not None:
        lines.append(_point("wpt", mission.home, "home", "home"))
    lines.append(f"<rte><name>{name}</name>")
    for point in route_of(mission):
        item, kind = point.item, _KINDS.get(Command(point.item.command), "waypoint")
        place = GeoPoint(item.lat_deg, item.lon_deg, alt_amsl_m(point, mission))
        lines.append(_point("rtept", place, str(point.number), kind))
    return _HEAD.format(name=name) + "\n".join([*lines, "</rte>", "</gpx>"]) + "\n"


def _point(tag: str, place: GeoPoint, name: str, kind: str) -> str:
    where = "home" if name == "home" else f"item {name}"
    problem = place_problem(place.lat_deg, place.lon_deg)
    if problem is not None:
        raise FormatError(problem.what, where=where, advice=problem.advice)
    lat, lon = degrees_text(place.lat_deg, where), degrees_text(place.lon_deg, where)
    if float(lon) >= 180.0:
        lon = degrees_text(-180.0, where)  # the same meridian
    ele = plain_decimal(place.alt_amsl_m, where)
    return f'<{tag} lat="{lat}" lon="{lon}"><ele>{ele}</ele><name>{name}</name><type>{kind}</type></{tag}>'
