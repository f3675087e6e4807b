"""KML and GPX, the XML of map programs: writes a mission's route, reads drawings and routes."""

import re
from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree
from xml.parsers import expat

from mission_io.errors import FormatError
from mission_io.formats.drawings import (
    Drawing,
    DrawnArea,
    DrawnLine,
    RoutePoint,
    Spot,
    alt_amsl_m,
    open_ring,
    position_of,
    route_of,
)
from mission_io.formats.point_route import PointRoute, RouteStop, route_from_stops
from mission_io.formats.text import (
    check_position,
    child_text,
    clean_text,
    degrees_text,
    finite_number,
    local_name,
    number_in,
    parse_xml,
    plain_decimal,
    rendered,
    xml_root,
)
from mission_io.model.items import Command, Frame, GeoPoint, LatLon, Mission


def write_kml(mission: Mission, *, name: str = "mission") -> str:
    """Write a mission's route as KML: longitude, latitude, height above mean sea level in metres.

    Raises:
        FormatError: an unknown height above mean sea level, or a number that is not finite.
    """

    def coordinates(point: RoutePoint) -> str:
        where, item = f"item {point.number}", point.item
        lon, lat = degrees_text(item.lon_deg, where), degrees_text(item.lat_deg, where)
        return f"{lon},{lat},{plain_decimal(alt_amsl_m(point, mission), where)}"

    points = [(point.number, coordinates(point)) for point in route_of(mission)]
    return rendered("route.kml.jinja", name=name, points=points)


def read_kml_drawing(text: str) -> Drawing:
    """Read areas with holes, lines and points of a KML document, in order, with the names of their placemarks.

    Heights and everything else (photos, tracks, styles) are dropped. Any KML version is read, also without a namespace. Open
    rings are closed, and listed as repairs.

    Raises:
        FormatError: with the line, for invalid XML or KML, for a document type or entities (which let a small file expand
            to gigabytes), and for invalid coordinates.
    """
    clean = clean_text(text)
    reader = _DrawingReader(list(clean.repairs))
    parser = expat.ParserCreate("utf-8", "}")
    parser.StartElementHandler = reader.start
    parser.EndElementHandler = reader.end
    parser.CharacterDataHandler = reader.text
    parser.StartDoctypeDeclHandler = reader.refuse_document_type
    reader.line = lambda: parser.CurrentLineNumber
    parse_xml(clean.text, parser)
    return reader.drawing()


_GEOMETRIES = {"Point": 1, "LineString": 2, "LinearRing": 1}
_NAMED = (["Placemark", "name"], ["Folder", "name"])
_COORDINATE_SEPARATORS = re.compile(r"\s*,\s*")
_SPACE_AT_COMMA = re.compile(r"\s,|,\s")
_WITH_TIME = 4
"""Numbers of a place in the files of some loggers: longitude, latitude, height and a time or a speed."""


class _DrawingReader:
    """Callbacks for expat."""

    def __init__(self, repairs: list[str]) -> None:
        self.line: Callable[[], int] = int
        self._repairs = repairs
        self._unclosed: list[str] = []
        self._path: list[str] = []
        self._kept: list[str] | None = None
        # A name may follow what it names, so shapes refer to a list that holds it.
        self._name = [""]
        self._folders: list[list[str]] = []
        self._points: list[LatLon] = []
        self._exterior: tuple[LatLon, ...] | None = None
        self._holes: list[tuple[LatLon, ...]] = []
        self._areas: list[tuple[DrawnArea, list[str], list[str]]] = []
        self._lines: list[tuple[DrawnLine, list[str]]] = []
        self._spots: list[tuple[Spot, list[str]]] = []

    def start(self, tag: str, _: dict[str, str]) -> None:
        name = tag.rpartition("}")[2]
        if not self._path and name != "kml":
            raise FormatError(f"<{name[:30]}> is not the root element of a KML file", where=self._where())
        self._path.append(name)
        if name == "Placemark":
            self._name = [""]
        elif name == "Folder":
            self._folders.append([""])
        elif name == "Polygon":
            self._exterior, self._holes = None, []
        elif name in _GEOMETRIES:
            self._points = []
        if name == "coordinates" or self._path[-2:] in _NAMED:
            self._kept = []

    def text(self, data: str) -> None:
        if self._kept is not None:
            self._kept.append(data)

    def end(self, _: str) -> None:
        name = self._path.pop()
        parent = self._path[-1] if self._path else ""
        if name == "coordinates" and self._kept is not None:
            self._points = self._positions("".join(self._kept)) if parent in _GEOMETRIES else []
            self._kept = None
        elif name == "name" and self._kept is not None:
            self._end_name(parent, "".join(self._kept).strip())
        elif name == "Folder":
            self._folders.pop()
        elif name in _GEOMETRIES and len(self._points) < _GEOMETRIES[name]:
            self._repairs.append(f"{self._where()}: ignored an empty {name}")
        elif name == "Point":
            self._spots.append((Spot(self._points[0]), self._name))
        elif name == "LineString":
            self._lines.append((DrawnLine(tuple(self._points)), self._name))
        elif name == "LinearRing":
            self._end_ring(parent)
        elif name == "Polygon":
            if self._exterior is None:
                raise FormatError("the polygon has no outer boundary", where=self._where())
            self._add_area(DrawnArea(self._exterior, tuple(self._holes)))
            self._exterior = None

    def refuse_document_type(self, *_: object) -> None:
        raise FormatError("document types are not supported", where=self._where(), advice="remove <!DOCTYPE>")

    def drawing(self) -> Drawing:
        return Drawing(
            tuple(replace(area, name=name[0], folder=folder[0]) for area, name, folder in self._areas),
            tuple(replace(line, name=name[0]) for line, name in self._lines),
            tuple(replace(spot, name=name[0]) for spot, name in self._spots),
            tuple(self._repairs),
            tuple(self._unclosed),
        )

    def _add_area(self, area: DrawnArea) -> None:
        self._areas.append((area, self._name, self._folders[-1] if self._folders else [""]))

    def _end_name(self, parent: str, name: str) -> None:
        self._kept = None
        if parent == "Folder":
            self._folders[-1][0] = name
        else:
            self._name[0] = name

    def _end_ring(self, boundary: str) -> None:
        before = len(self._repairs)
        ring = open_ring(self._points, self._where(), self._repairs)
        self._unclosed += self._repairs[before:]
        if boundary == "innerBoundaryIs":
            self._holes.append(ring)
        elif boundary == "outerBoundaryIs" and self._exterior is None:
            self._exterior = ring
        elif boundary == "outerBoundaryIs":
            raise FormatError(
                "the polygon has a second outer boundary", where=self._where(),
                advice="save the second part as a separate polygon",
            )  # fmt: skip
        else:
            self._add_area(DrawnArea(ring))

    def _positions(self, text: str) -> list[LatLon]:
        where = self._where()
        positions: list[LatLon] = []
        for number, entry in enumerate(self._entries(text, where)):
            numbers = entry.split(",")
            here = f"{where}, coordinate {number}"
            if len(numbers) not in (2, 3, _WITH_TIME):
                raise FormatError(f"{entry[:40]!r} is not longitude,latitude or longitude,latitude,height", where=here)
            lon_deg, lat_deg = finite_number(numbers[0], here), finite_number(numbers[1], here)
            positions.append(position_of(lon_deg, lat_deg, here))
        return positions

    def _entries(self, text: str, where: str) -> list[str]:
        """The text of each position. Space around commas belongs to a position if that makes positions of two or three numbers.

        Otherwise space separates places and the comma before it is dropped: "10,50, 11,51" is two places.
        """
        if not text.strip(", \t\n\r"):
            return []
        if _SPACE_AT_COMMA.search(text) is not None:
            joined = _COORDINATE_SEPARATORS.sub(",", text).split()
            if all(entry.count(",") in (1, 2) for entry in joined):
                self._repairs.append(f"{where}: removed space around commas")
                return joined
            apart = [entry.strip(",") for entry in text.split() if entry != ","]
            for number, entry in enumerate(apart):
                if entry.count(",") not in (1, 2):
                    here = f"{where}, coordinate {number}"
                    raise FormatError(
                        f"{entry[:40]!r} is not a position", where=here, advice="remove the spaces around commas"
                    )
            self._repairs.append(f"{where}: removed commas between positions")
            return apart
        entries = text.split()
        if any(entry.count(",") == _WITH_TIME - 1 for entry in entries):
            self._repairs.append(f"{where}: ignored a fourth number")
        return entries

    def _where(self) -> str:
        return f"line {self.line()}"


_FRAMES = {"absolute": Frame.AMSL, "relativeToGround": Frame.ABOVE_TERRAIN}


def read_kml_route(text: str) -> PointRoute:
    """Read the only line of a KML document that has heights.

    ``altitudeMode`` absolute is above mean sea level, relativeToGround above the terrain; a line that is clamped to the ground
    has no heights to fly at.

    Raises:
        FormatError: no KML, no such line or several, or a place that is none, with its number.
    """
    root, repairs = xml_root(text)
    if local_name(root) != "kml":
        raise FormatError(f"the root element is {local_name(root)[:40]!r}", where="XML", advice="use a KML file")
    if "dji.com/wpmz" in text[:2000]:
        raise FormatError(
            "the file is DJI's template.kml, which contains the settings of a flight, but not its waypoints", where="kml",
            advice="use the .kmz with its waylines.wpml, or use its area with new",
        )  # fmt: skip
    lines = [element for element in root.iter() if local_name(element) == "LineString"]
    high = [line for line in lines if (child_text(line, "altitudeMode") or "") in _FRAMES]
    if len(high) != 1:
        raise FormatError(
            f"the file has {len(lines)} lines, {len(high)} with heights (altitudeMode absolute or relativeToGround)", where="kml",
            advice="save only the line to be flown, with heights",
        )  # fmt: skip
    return route_from_stops(_stops(high[0]), repairs=repairs)


def _stops(line: ElementTree.Element) -> list[RouteStop]:
    frame = _FRAMES[child_text(line, "altitudeMode") or ""]
    stops = []
    for number, entry in enumerate((child_text(line, "coordinates") or "").split(), start=1):
        numbers = entry.split(",")
        where = f"point {number}"
        if len(numbers) != 3:
            raise FormatError(f"{entry[:40]!r} is not longitude,latitude,height", where=where, advice="add heights")
        lon, lat, alt = (number_in(part, where) for part in numbers)
        stops.append(RouteStop(lat, lon, alt, frame))
    return stops


# GPX 1.1, for GPS receivers and map programs: a mission's route with home as a waypoint of its own.
#
# Heights are above mean sea level, as GPS receivers show them. Elements stand in the order that the schema demands
# (www.topografix.com/GPX/1/1/gpx.xsd); it takes longitudes from -180 to below 180 degrees.

_KINDS = {Command.NAV_TAKEOFF: "take-off", Command.NAV_LAND: "landing"}


def write_gpx(mission: Mission, *, name: str = "mission") -> str:
    """Write a mission's route as GPX; ``ele`` is the height above mean sea level in metres.

    Raises:
        FormatError: an unknown height above mean sea level, a position that is none, or a name that XML cannot hold.
    """
    home = None if mission.home is None else _point(mission.home, "home", "home")
    points = []
    for point in route_of(mission):
        item, kind = point.item, _KINDS.get(Command(point.item.command), "waypoint")
        position = GeoPoint(item.lat_deg, item.lon_deg, alt_amsl_m(point, mission))
        points.append(_point(position, str(point.number), kind))
    return rendered("route.gpx.jinja", name=name, home=home, points=points)


def _point(position: GeoPoint, name: str, kind: str) -> dict[str, str]:
    where = "home" if name == "home" else f"item {name}"
    check_position(position.lat_deg, position.lon_deg, where)
    lat, lon = degrees_text(position.lat_deg, where), degrees_text(position.lon_deg, where)
    if float(lon) >= 180.0:
        lon = degrees_text(-180.0, where)  # the same meridian
    ele = plain_decimal(position.alt_amsl_m, where)
    return {"lat": lat, "lon": lon, "ele": ele, "name": name, "kind": kind}


def read_gpx_route(text: str) -> PointRoute:
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
