"""Routes and tracks of GPX 1.0 and 1.1 as missions; ``ele`` is taken as the height above mean sea level."""

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


def read_route(text: str) -> PointRoute:
    """Read the only route of a GPX document, or where it has none its only track.

    Raises:
        FormatError: no GPX, no or several routes, or a point without place or height, with its number.
    """
    root, repairs = xml_root(text)
    if local_name(root) != "gpx":
        raise FormatError(f"the document is a {local_name(root)[:40]!r}", where="XML", advice="give a GPX file")
    routes = [element for element in root if local_name(element) == "rte"]
    tracks = [element for element in root if local_name(element) == "trk"]
    chosen = routes or tracks
    if len(chosen) != 1:
        what = "routes" if routes else "routes or tracks"
        raise FormatError(f"{len(chosen)} {what}", where="gpx", advice="save one of them alone")
    stops = []
    points = [element for element in chosen[0].iter() if local_name(element) in ("rtept", "trkpt")]
    for number, point in enumerate(points, start=1):
        where = f"point {number}"
        lat, lon = (number_in(point.get(name), f"{where}, {name}") for name in ("lat", "lon"))
        height = child_text(point, "ele")
        if height is None:
            raise FormatError(
                "has no height (ele)", where=where, advice="export the route with heights above sea level"
            )
        stops.append(RouteStop(lat, lon, number_in(height, f"{where}, ele"), Frame.AMSL))
    return route_from_stops(stops, repairs=repairs)
