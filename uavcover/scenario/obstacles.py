"""Obstacles as prisms with flat tops: footprints with heights from GeoJSON, or a table of boxes in the local frame.

Lines are checked against the prisms along their full length.
"""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import sniff
from mission_io.formats.text import child_text, clean_text, local_name, number_in, text_from_bytes, xml_root
from uavcover.errors import ScenarioError, TerrainError
from uavcover.kernels import obstacle_breach as kernels
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.kernels.obstacles import make_obstacles
from uavcover.kernels.surface import GRID
from uavcover.model.area import Ring, Rings
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.model.scenario import Scenario
from uavcover.scenario.areas.features import WGS84, kml_of
from uavcover.scenario.areas.text_formats import read_geojson
from uavcover.terrain.frames import nodes_inside_m
from uavcover.terrain.ground import Ground


@dataclass(frozen=True, eq=False)
class Footprint:
    """A footprint before its ground is known."""

    name: str  # shown to the user
    polygon: shapely.Polygon  # (east, north) metres, courtyards cut out
    height_m: float  # height of the flat top above the highest ground under the footprint


@dataclass(frozen=True, eq=False)
class Prism:
    """An obstacle in the local frame."""

    footprint: Footprint  # its footprint
    top_m: float  # up coordinate of its flat top


def stand_on(
    ground: Ground, footprints: Sequence[Footprint], *, largest_clearance_m: float, foot: Ground | None = None
) -> tuple[Ground, tuple[Prism, ...]]:
    """Put obstacles on a ground; the kernels' obstacle numbers index the returned tuple.

    Args:
        ground: the ground without obstacles.
        footprints: the footprints of the obstacles.
        largest_clearance_m: largest horizontal clearance that will be requested.
        foot: what they stand on, where a surface model lies over it; None: the ground.

    Raises:
        TerrainError: the ground under a footprint is unknown.
    """
    prisms = tuple(Prism(f, _highest_ground_m(foot or ground, f) + f.height_m) for f in footprints)
    edges = [_edges_m(f.polygon) for f in footprints]
    obstacles = make_obstacles(
        np.vstack([np.empty((0, 4)), *edges]),
        np.concatenate([[0], np.cumsum([len(part) for part in edges])]).astype(np.int64),
        np.array([prism.top_m for prism in prisms]),
        grown_m=largest_clearance_m,
    )
    return dataclasses.replace(ground, surface=ground.surface._replace(obstacles=obstacles)), prisms


def rings_m(polygons: shapely.Polygon | shapely.MultiPolygon) -> list[FloatArray]:
    """(k, 2) east and north of the corners of outlines and holes, one array for each ring, each outline before its holes."""
    return [
        np.asarray(ring.coords)[:, :2]
        for polygon in shapely.get_parts(polygons)
        for ring in (polygon.exterior, *polygon.interiors)
    ]


def _edges_m(polygon: shapely.Polygon) -> FloatArray:
    """(m, 4) east and north of both ends of the edges, courtyards included."""
    return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in rings_m(polygon)])


def _highest_ground_m(ground: Ground, footprint: Footprint) -> float:
    """Up coordinate of the highest ground under a footprint, exactly.

    A bilinear cell has no interior peak: the ground is highest at a node or on an edge of the footprint.
    """
    edges = _edges_m(footprint.polygon)
    # Level lines along the edges: the ground is highest where they are lowest above it. They are at the height of the
    # corners, so that plumb lines from them to the ground are short.
    ends = np.empty((2 * len(edges), 3))
    ends[0::2, :2], ends[1::2, :2] = edges[:, :2], edges[:, 2:]
    ends[:, 2] = np.max(ground.heights_m(ends[:, :2]))
    on_edges = ends[0, 2] - ground.leg_height_ranges_m(ends)[0::2, 0]
    peaks = _peaks(ground, footprint.polygon.bounds)
    inside = ground.heights_m(peaks[shapely.contains_xy(footprint.polygon, peaks[:, 0], peaks[:, 1])])
    if not (np.isfinite(on_edges).all() and np.isfinite(inside).all()):
        east, north = footprint.polygon.representative_point().coords[0]
        raise TerrainError(
            f"obstacle {footprint.name!r}: no elevation data below its footprint at {east:.0f} m east, {north:.0f} m "
            f"north of the origin ({ground.source}); remove it, or use elevation data that covers it"
        )
    return float(max(on_edges.max(), inside.max(initial=-math.inf)))


def _peaks(ground: Ground, bounds_m: tuple[float, float, float, float]) -> FloatArray:
    """(k, 2) positions between west, south, east, north where the ground may have a peak."""
    west, south, east, north = bounds_m
    surface = ground.surface
    if surface.kind == GRID:
        return nodes_inside_m(surface.grid, surface.up_m, bounds_m)[:, :2]
    # sin(y / s) cos(x / s) is 1 only where both factors are 1 or -1.
    easts = _steps(west, east, math.pi * surface.step_m)
    quarter = 0.5 * math.pi * surface.step_m
    norths = _steps(south - quarter, north - quarter, math.pi * surface.step_m) + quarter
    return np.array(list(itertools.product(easts, norths)), dtype=float).reshape(-1, 2)


def _steps(first: float, last: float, step: float) -> FloatArray:
    """Integer multiples of a step from first to last."""
    return np.asarray(np.arange(math.ceil(first / step), math.floor(last / step) + 1) * step, dtype=np.float64)


def leg_breaches(ground: Ground, route_m: FloatArray, limits: Obstacles) -> FloatArray:
    """Missing obstacle clearance of the legs of an (n, 3) ENU route.

    Returns:
        (n - 1, 3) number of the obstacle, -1 for none; metres of missing clearance at the worst point, beside or above it,
        whichever is less; the parameter 0..1 along the leg there.
    """
    route = read_only(route_m).reshape(-1, 3)
    return _breaches(ground, route[:-1], route[1:], limits)


def waypoint_breaches(ground: Ground, positions_m: FloatArray, limits: Obstacles) -> FloatArray:
    """(n, 3) the same for (n, 3) ENU positions alone."""
    positions = read_only(positions_m).reshape(-1, 3)
    return _breaches(ground, positions, positions, limits)


def _breaches(ground: Ground, begins: FloatArray, ends: FloatArray, limits: Obstacles) -> FloatArray:
    return kernels.breaches(ground.surface.obstacles, begins, ends, limits.clearance_beside_m, limits.clearance_above_m)


def geojson_polygons(path: Path, *, key: str) -> list[tuple[Rings, Mapping[str, Any]]]:
    """The polygons of a GeoJSON file in longitude and latitude, each with the properties of its feature.

    Other shapes are ignored.

    Raises:
        ScenarioError: it cannot be read, or is in another coordinate system.
    """
    try:
        document = read_geojson(path.read_text(encoding="utf-8-sig"), str(path))
    except (OSError, ValueError, FormatError) as error:
        raise ScenarioError(f"{key}: {path}: cannot read the file as GeoJSON ({error})") from error
    # RFC 7946 allows longitude and latitude on WGS 84 only; older files may name another system.
    if document.crs is not None and document.crs != WGS84:
        raise ScenarioError(
            f"{key}: {path}: the file has a different coordinate system ({document.crs.name}); convert it to longitude "
            "and latitude on WGS 84 (ogr2ogr -t_srs EPSG:4326)"
        )
    return [(rings, feature.properties) for feature in document.features for rings in feature.polygons]


_KEY = "obstacles.file"
_COLUMNS = ("east_m", "north_m", "length_m", "width_m", "heading_deg", "height_m")


def read_obstacles(path: Path) -> tuple[Obstacle, ...]:
    """Read the obstacles of a file.

    ``.geojson``, ``.json``: every polygon of every feature, with the feature's property ``height_m`` and, if there is one,
    ``name``. ``.csv``: boxes by their centre, length along and width across a heading (clockwise from north).
    ``.kml``, ``.kmz``: :func:`uavcover.scenario.obstacles.read_kml_obstacles`.

    Raises:
        ScenarioError: it cannot be read; the message names the invalid feature or row.
    """
    suffix = path.suffix.lower()
    if suffix in {".geojson", ".json"}:
        return _from_geojson(path)
    if suffix == ".csv":
        return _from_table(path)
    if suffix in {".kml", ".kmz"}:
        return read_kml_obstacles(path, key=_KEY)
    raise ScenarioError(f"{_KEY}: {path}: use a .geojson, .kml, .kmz or .csv file")


def _from_geojson(path: Path) -> tuple[Obstacle, ...]:
    found = []
    for number, (rings, properties) in enumerate(geojson_polygons(path, key=_KEY)):
        if "height_m" not in properties:
            raise ScenarioError(f"{_KEY}: {path}: polygon {number} has no height_m; add it, in metres")
        height = properties["height_m"]
        try:
            if isinstance(height, bool) or not isinstance(height, int | float):
                raise ValueError(f"height_m: expected a number, not {height!r}")
            name = str(properties.get("name", number))
            found.append(Obstacle(height_m=float(height), rings_lon_lat_deg=rings, name=name))
        except ValueError as error:
            raise ScenarioError(f"{_KEY}: {path}: polygon {number}: {error}") from error
    return tuple(found)


def _from_table(path: Path) -> tuple[Obstacle, ...]:
    try:
        text = clean_text(path.read_text(encoding="utf-8-sig")).text
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{_KEY}: {path} cannot be read ({error.__class__.__name__})") from error
    try:
        dialect = sniff(text)
        (_, header), *rows = list(dialect.rows(text)) or [(1, [])]
    except FormatError as error:
        raise ScenarioError(f"{_KEY}: {path}: {error}") from error
    missing = [column for column in _COLUMNS if column not in header]
    if missing:
        raise ScenarioError(
            f"{_KEY}: {path}: the file has no column {', '.join(missing)} (read as {dialect}); columns: name, "
            f"{', '.join(_COLUMNS)}"
        )
    found = []
    for line, cells in rows:
        try:
            if len(cells) < len(header):
                raise ValueError(f"the row has {len(cells)} cells, but the header has {len(header)}")
            row = dict(zip(header, cells, strict=False))
            east, north, length, width, heading, height = (float(row[column]) for column in _COLUMNS)
            if not all(map(math.isfinite, (east, north, length, width, heading))) or min(length, width) <= 0.0:
                raise ValueError("length_m and width_m must be greater than 0, and all values must be finite numbers")
            corners = box_corners_m(east, north, length, width, heading)
            found.append(
                Obstacle(height_m=height, rings_east_north_m=(corners,), name=row.get("name") or str(line - 2))
            )
        except (TypeError, ValueError) as error:
            raise ScenarioError(f"{_KEY}: {path}: line {line}: {error}") from error
    return tuple(found)


def box_corners_m(east_m: float, north_m: float, length_m: float, width_m: float, heading_deg: float) -> Ring:
    """The four corners (east, north) of a box by its centre, with its length along a heading clockwise from north."""
    heading = math.radians(heading_deg)
    along = (math.sin(heading), math.cos(heading))
    across = (math.cos(heading), -math.sin(heading))
    return tuple(
        (
            east_m + 0.5 * (f * length_m * along[0] + s * width_m * across[0]),
            north_m + 0.5 * (f * length_m * along[1] + s * width_m * across[1]),
        )
        for f, s in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    )


_HEIGHT_NAMES = ("height_m", "height")


def read_kml_obstacles(path: Path, *, key: str) -> tuple[Obstacle, ...]:
    """Every polygon of every placemark, with the placemark's name.

    Its height is its data ``height_m`` (ExtendedData), or else the largest height of its corners, with altitudeMode
    relativeToGround.

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
                found.append(_obstacle(polygon, _stated_height_m(mark), name))
    except (FormatError, ValueError) as error:
        raise ScenarioError(f"{key}: {path}: {error}") from error
    except OSError as error:
        raise ScenarioError(f"{key}: {path} cannot be read ({error.__class__.__name__})") from error
    if not found:
        raise ScenarioError(f"{key}: {path}: the file contains no polygons")
    return tuple(found)


def _stated_height_m(mark: ElementTree.Element) -> float | None:
    for each in mark.iter():
        if each.attrib.get("name", "").casefold() in _HEIGHT_NAMES and local_name(each) in ("Data", "SimpleData"):
            text = child_text(each, "value") if local_name(each) == "Data" else (each.text or "").strip()
            return number_in(text, each.attrib["name"])
    return None


def _obstacle(polygon: ElementTree.Element, stated_m: float | None, name: str) -> Obstacle:
    rings: list[Ring] = []
    tops: list[float] = []
    boundaries = [each for each in polygon if local_name(each) in ("outerBoundaryIs", "innerBoundaryIs")]
    for boundary in sorted(boundaries, key=lambda each: local_name(each) != "outerBoundaryIs"):
        text = next((each.text or "" for each in boundary.iter() if local_name(each) == "coordinates"), "")
        corners = [[number_in(part, f"{name}, coordinates") for part in corner.split(",")] for corner in text.split()]
        if any(len(corner) < 2 for corner in corners):
            raise ScenarioError(f"{name}: a corner has no longitude and latitude")
        rings.append(tuple((corner[0], corner[1]) for corner in corners))
        tops += [corner[2] for corner in corners if len(corner) > 2]
    if stated_m is None:
        mode = child_text(polygon, "altitudeMode") or "clampToGround"
        if mode != "relativeToGround" or not tops:
            raise ScenarioError(
                f"polygon {name!r} has no height above ground (altitudeMode {mode}); save it with relativeToGround, "
                "or add the data field height_m"
            )
        stated_m = max(tops)
    return Obstacle(height_m=stated_m, rings_lon_lat_deg=tuple(rings), name=name)


def check_is_clear(key: str, scenario: Scenario, position_en: FloatArray, footprints: list[Footprint]) -> None:
    """Refuse a home or rally point that is nearer to an obstacle than its clearance."""
    clearance_m = scenario.obstacles.clearance_beside_m
    for footprint in footprints:
        distance_m = footprint.polygon.distance(shapely.Point(position_en))
        if distance_m < clearance_m:
            raise ScenarioError(
                f"{key}: the position is {distance_m:.1f} m from obstacle {footprint.name!r}, but "
                f"obstacles.clearance_beside_m is {clearance_m:g} m; move the position"
            )
