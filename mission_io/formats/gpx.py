"""GPX 1.1, for GPS receivers and map programs: a mission's route with home as a waypoint of its own.

Heights are above mean sea level, as GPS receivers show them. Elements stand in the order that the schema demands
(www.topografix.com/GPX/1/1/gpx.xsd); it takes longitudes from -180 to below 180 degrees.
"""

from mission_io.errors import FormatError
from mission_io.formats.drawings import alt_amsl_m, route_of
from mission_io.formats.point_route import (
    PointRoute,
    RouteStop,
    child_text,
    local_name,
    number_in,
    route_from_stops,
    xml_root,
)
from mission_io.formats.text import check_place, degrees_text, plain_decimal, rendered
from mission_io.model.items import Command, Frame, GeoPoint, Mission

_KINDS = {Command.NAV_TAKEOFF: "take-off", Command.NAV_LAND: "landing"}


def write_mission(mission: Mission, *, name: str = "mission") -> str:
    """Write a mission's route as GPX; ``ele`` is the height above mean sea level in metres.

    Raises:
        FormatError: an unknown height above mean sea level, a position that is none, or a name that XML cannot hold.
    """
    home = None if mission.home is None else _point(mission.home, "home", "home")
    points = []
    for point in route_of(mission):
        item, kind = point.item, _KINDS.get(Command(point.item.command), "waypoint")
        place = GeoPoint(item.lat_deg, item.lon_deg, alt_amsl_m(point, mission))
        points.append(_point(place, str(point.number), kind))
    return rendered("route.gpx.jinja", name=name, home=home, points=points)


def _point(place: GeoPoint, name: str, kind: str) -> dict[str, str]:
    where = "home" if name == "home" else f"item {name}"
    check_place(place.lat_deg, place.lon_deg, where)
    lat, lon = degrees_text(place.lat_deg, where), degrees_text(place.lon_deg, where)
    if float(lon) >= 180.0:
        lon = degrees_text(-180.0, where)  # the same meridian
    ele = plain_decimal(place.alt_amsl_m, where)
    return {"lat": lat, "lon": lon, "ele": ele, "name": name, "kind": kind}


def read_route(text: str) -> PointRoute:
    """Read the only route of a GPX document, or where it has none its only track.

    Raises:
        FormatError: no GPX, no or several routes, or a point without place or height, with its number.
    """
    root, repairs = xml_root(text)
    if local_name(root) != "gpx":
        raise FormatError(f"the root element is {local_name(root)[:40]!r}", where="XML", advice="use a GPX file")
    routes = [element for element in root if local_name(element) == "rte"]
    tracks = [element for element in root if local_name(element) == "trk"]
    chosen = routes or tracks
    if len(chosen) != 1:
        what = "routes" if routes else "routes or tracks"
        raise FormatError(f"{len(chosen)} {what}", where="gpx", advice="save only one of them")
    stops = []
    points = [element for element in chosen[0].iter() if local_name(element) in ("rtept", "trkpt")]
    for number, point in enumerate(points, start=1):
        where = f"point {number}"
        lat, lon = (number_in(point.get(name), f"{where}, {name}") for name in ("lat", "lon"))
        height = child_text(point, "ele")
        if height is None:
            raise FormatError(
                "the point has no height (ele)", where=where, advice="export the route with heights above sea level"
            )
        stops.append(RouteStop(lat, lon, number_in(height, f"{where}, ele"), Frame.AMSL))
    return route_from_stops(stops, repairs=repairs)
