"""Obstacles from KML and KMZ: polygons that are extruded from the ground, or that carry a height as data."""

from pathlib import Path
from xml.etree import ElementTree

from mission_io.errors import FormatError
from mission_io.formats.point_route import child_text, local_name, number_in, xml_root
from mission_io.formats.text import text_from_bytes
from uavcover.errors import ScenarioError
from uavcover.model.area import Ring
from uavcover.model.obstacles import Obstacle
from uavcover.scenario.areas.kmz import kml_of

_HEIGHT_NAMES = ("height_m", "height")


def read_kml_obstacles(path: Path, *, key: str) -> tuple[Obstacle, ...]:
    """Every polygon of every placemark, with the placemark's name.

    Its height is its data ``height_m`` (ExtendedData), or else the largest height of its corners, with altitudeMode
    relativeToGround.

    Args:
        path: the file.
        key: the scenario's key, for errors.

    Raises:
        ScenarioError: it cannot be read, or a polygon has no height above ground; says which.
        InputError: a KMZ that cannot be opened.
    """
    try:
        data = kml_of(path) if path.suffix.lower() == ".kmz" else path.read_bytes()
        root, _ = xml_root(text_from_bytes(data).text)
        found = []
        marks = [each for each in root.iter() if local_name(each) == "Placemark"]
        for number, mark in enumerate(marks):
            name = child_text(mark, "name") or str(number)
            for polygon in (each for each in mark.iter() if local_name(each) == "Polygon"):
                found.append(_obstacle(polygon, _told_height_m(mark), name))
    except (FormatError, ValueError) as error:
        raise ScenarioError(f"{key}: {path}: {error}") from error
    except OSError as error:
        raise ScenarioError(f"{key}: {path} cannot be read ({error.__class__.__name__})") from error
    if not found:
        raise ScenarioError(f"{key}: {path}: has no polygon")
    return tuple(found)


def _told_height_m(mark: ElementTree.Element) -> float | None:
    for each in mark.iter():
        if each.attrib.get("name", "").casefold() in _HEIGHT_NAMES and local_name(each) in ("Data", "SimpleData"):
            text = child_text(each, "value") if local_name(each) == "Data" else (each.text or "").strip()
            return number_in(text, each.attrib["name"])
    return None


def _obstacle(polygon: ElementTree.Element, told_m: float | None, name: str) -> Obstacle:
    rings: list[Ring] = []
    tops: list[float] = []
    boundaries = [each for each in polygon if local_name(each) in ("outerBoundaryIs", "innerBoundaryIs")]
    for boundary in sorted(boundaries, key=lambda each: local_name(each) != "outerBoundaryIs"):
        text = next((each.text or "" for each in boundary.iter() if local_name(each) == "coordinates"), "")
        corners = [[number_in(part, f"{name}, coordinates") for part in place.split(",")] for place in text.split()]
        if any(len(corner) < 2 for corner in corners):
            raise ScenarioError(f"{name}: a corner has no longitude,latitude")
        rings.append(tuple((corner[0], corner[1]) for corner in corners))
        tops += [corner[2] for corner in corners if len(corner) > 2]
    if told_m is None:
        mode = child_text(polygon, "altitudeMode") or "clampToGround"
        if mode != "relativeToGround" or not tops:
            raise ScenarioError(
                f"polygon {name!r} has no height above ground (altitudeMode {mode}); save it with relativeToGround, or give it "
                "data height_m"
            )
        told_m = max(tops)
    return Obstacle(height_m=told_m, rings_lon_lat_deg=tuple(rings), name=name)
