"""Readers of routes of other programs, and of no-fly zones."""

import json
from collections.abc import Callable

from mission_io.errors import FormatError
from mission_io.formats import csv, gpx_route, kml_route, litchi_reader, wpml_reader
from mission_io.formats.point_route import PointRoute
from mission_io.model.items import GeoPoint, Mission
from scripts.fuzzing.target import Target, check, of_text
from uavcover.errors import InputError
from uavcover.scenario.airspace.zone_file import _of_text as read_zone_text


def try_route(read_route: Callable[[str], PointRoute]) -> Callable[[str], None]:
    """A route of points."""

    def attempt(text: str) -> None:
        read = read_route(text)
        items = read.mission.items
        check(all(items[number - 1].command == 16 for number in read.numbers), "every point is a waypoint")
        written = csv.write_mission(Mission(GeoPoint(1.0, 2.0, 3.0), items))
        check(csv.read_mission(written).mission.items == items, "the route survives as a table")

    return attempt


def try_zones(suffix: str) -> Callable[[str], None]:
    """No-fly zones as authorities and glider pilots publish them."""

    def attempt(text: str) -> None:
        try:
            read = read_zone_text(text, suffix)
        except InputError as error:
            raise FormatError(str(error)) from None
        for zone in read.zones if read is not None else ():
            check(bool(zone.polygons) != (zone.circle is not None), "a zone is an outline or a circle")

    return attempt


def _route_seeds() -> dict[str, list[str]]:
    points = ((33.2, -98.1, 30.5), (33.25, -98.15, 41.0), (33.3, -98.05, 25.0))
    places = " ".join(f"{lon},{lat},{up}" for lat, lon, up in points)
    rows = "".join(f'<rtept lat="{lat}" lon="{lon}"><ele>{up}</ele></rtept>' for lat, lon, up in points)
    line = f"<LineString><altitudeMode>absolute</altitudeMode><coordinates>{places}</coordinates></LineString>"
    marks = "".join(
        f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point><index>{n}</index>"
        f"<executeHeight>{up}</executeHeight><waypointSpeed>{n + 3}</waypointSpeed></Placemark>"
        for n, (lat, lon, up) in enumerate(points)
    )
    folder = f"<executeHeightMode>relativeToStartPoint</executeHeightMode><autoFlightSpeed>5</autoFlightSpeed>{marks}"
    config = "<finishAction>goHome</finishAction><takeOffSecurityHeight>20</takeOffSecurityHeight>"
    table = "".join(f"{lat},{lon},{up},90,0.2,0,7.5\n" for lat, lon, up in points)
    return {
        "gpx": [f"<gpx><rte>{rows}</rte></gpx>", f"<gpx><trk><trkseg>{rows.replace('rtept', 'trkpt')}</trkseg></trk></gpx>"],
        "kml_route": [f"<kml><Placemark>{line}</Placemark></kml>", f"<kml>{line.replace('absolute', 'relativeToGround')}</kml>"],
        "wpml": [f"<kml><missionConfig>{config}</missionConfig><Folder>{folder}</Folder></kml>"],
        "litchi": [f"latitude,longitude,altitude(m),heading(deg),curvesize(m),altitudemode,speed(m/s)\n{table}"],
    }  # fmt: skip


def _zone_seeds() -> dict[str, list[str]]:
    openair = (
        "AC R\nAN Range\nAL SFC\nAH 2500ft MSL\nDP 33:10:00 N 098:05:00 W\nDP 33:20:00 N 098:05:00 W\n"
        "V D=+\nV X=33:15:00 N 098:10:00 W\nDA 2.5,10,200\n\nAC D\nAN Circle\nAL 500ft AGL\nAH FL65\n"
        "V X=33:15:00 N 098:10:00 W\nDC 3.0\n"
    )
    ring = [[-98.2, 33.1], [-98.1, 33.1], [-98.1, 33.2], [-98.2, 33.1]]
    volume = {"uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 120,
              "upperVerticalReference": "AMSL", "horizontalProjection": {"type": "Polygon", "coordinates": [ring]}}  # fmt: skip
    circle = {**volume, "horizontalProjection": {"type": "Circle", "center": [-98.2, 33.1], "radius": 900.0}}
    old = {"features": [{"identifier": "A1", "name": "One", "restriction": "PROHIBITED", "geometry": [volume, circle],
                         "applicability": [{"startDateTime": "2026-01-01T00:00:00Z", "endDateTime": "2026-02-01T00:00:00Z",
                                            "permanent": "NO"}]}]}  # fmt: skip
    layer = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}
    shapes = [{"type": "Polygon", "coordinates": [ring], "layer": layer},
              {"type": "Point", "coordinates": [-98.2, 33.1], "extent": {"subType": "Circle", "radius": 90.0}}]  # fmt: skip
    new = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": shapes},
         "properties": {"identifier": "B2", "type": "PROHIBITED"}}]}  # fmt: skip
    return {"openair": [openair], "zones": [json.dumps(old), json.dumps(new)]}


def targets() -> dict[str, Target]:
    """By name."""
    good = {**_route_seeds(), **_zone_seeds()}
    readers = {
        "gpx": try_route(gpx_route.read_route),
        "kml_route": try_route(kml_route.read_route),
        "wpml": try_route(wpml_reader.read_route),
        "litchi": try_route(litchi_reader.read_route),
        "openair": try_zones(".txt"),
        "zones": try_zones(".json"),
    }
    return {name: of_text(read, good[name]) for name, read in readers.items()}
