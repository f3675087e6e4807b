"""Obstacle files: GeoJSON footprints on Earth, or a table of boxes in the local frame."""

import csv
import io
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from uavcover.errors import ScenarioError
from uavcover.model.area import Ring
from uavcover.model.obstacles import Obstacle


def read_geojson(path: Path, *, key: str) -> Any:
    """Read a GeoJSON file in longitude and latitude.

    Args:
        path: the file.
        key: the scenario's key, for errors.

    Raises:
        ScenarioError: it cannot be read, or is in another coordinate system.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{key}: {path} cannot be read as GeoJSON ({error})") from error
    # RFC 7946 allows longitude and latitude on WGS 84 only; older files may name another system.
    crs = document.get("crs") if isinstance(document, dict) else None
    if crs and not any(name in json.dumps(crs) for name in ("CRS84", "EPSG::4326", "EPSG:4326")):
        text = repr(crs)
        shown = text if len(text) <= 60 else f"{text[:57]}..."
        raise ScenarioError(
            f"{key}: {path} names another coordinate system ({shown}); convert it to longitude and latitude "
            "on WGS 84 (ogr2ogr -t_srs EPSG:4326)"
        )
    return document


def polygons_of(document: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
    """The rings of every polygon of a document, with the properties of its feature; other shapes are ignored."""
    yield from _polygons(document, {})


def _polygons(document: Any, properties: dict[str, Any]) -> Iterator[tuple[Any, dict[str, Any]]]:
    if not isinstance(document, dict):
        return
    match document.get("type"):
        case "FeatureCollection":
            for feature in document.get("features") or []:
                yield from _polygons(feature, {})
        case "Feature":
            yield from _polygons(document.get("geometry"), document.get("properties") or {})
        case "MultiPolygon":
            for rings in document.get("coordinates") or []:
                yield rings, properties
        case "Polygon":
            yield document.get("coordinates"), properties


_KEY = "obstacles.file"
_COLUMNS = ("east_m", "north_m", "length_m", "width_m", "heading_deg", "height_m")


def read_obstacles(path: Path) -> tuple[Obstacle, ...]:
    """Read the obstacles of a file.

    ``.geojson``, ``.json``: every polygon of every feature, with the feature's property ``height_m`` and, if there is one,
    ``name``. ``.csv``: boxes by their centre, length along and width across a heading (clockwise from north).

    Raises:
        ScenarioError: it cannot be read; the message names the invalid feature or row.
    """
    suffix = path.suffix.lower()
    if suffix in {".geojson", ".json"}:
        return _from_geojson(path)
    if suffix == ".csv":
        return _from_table(path)
    raise ScenarioError(f"{_KEY}: {path} is neither .geojson nor .csv")


def _from_geojson(path: Path) -> tuple[Obstacle, ...]:
    found = []
    for number, (rings, properties) in enumerate(polygons_of(read_geojson(path, key=_KEY))):
        try:
            height = properties["height_m"]
            if isinstance(height, bool) or not isinstance(height, int | float):
                raise ValueError(f"height_m: {height!r} is no number")
            found.append(
                Obstacle(
                    height_m=float(height),
                    rings_lon_lat_deg=tuple(tuple((float(p[0]), float(p[1])) for p in ring) for ring in rings),
                    name=str(properties.get("name", number)),
                )
            )
        except KeyError as error:
            raise ScenarioError(f"{_KEY}: {path}: polygon {number} has no property height_m (metres)") from error
        except (TypeError, ValueError, IndexError) as error:
            raise ScenarioError(f"{_KEY}: {path}: polygon {number}: {error}") from error
    return tuple(found)


def _from_table(path: Path) -> tuple[Obstacle, ...]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{_KEY}: {path} cannot be read ({error.__class__.__name__})") from error
    rows = csv.DictReader(io.StringIO(text))
    missing = [column for column in _COLUMNS if column not in (rows.fieldnames or ())]
    if missing:
        raise ScenarioError(f"{_KEY}: {path} has no column {', '.join(missing)}; columns: name, {', '.join(_COLUMNS)}")
    found = []
    for line, row in enumerate(rows, start=2):
        try:
            east, north, length, width, heading, height = (float(row[column]) for column in _COLUMNS)
            if not all(map(math.isfinite, (east, north, length, width, heading))) or min(length, width) <= 0.0:
                raise ValueError("length_m and width_m must be above 0, and every value a finite number")
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
