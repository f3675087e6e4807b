"""Polygons out of GeoJSON files."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from uavcover.errors import ScenarioError


def read_geojson(path: Path, *, key: str) -> Any:
    """The document of a GeoJSON file in longitudes and latitudes.

    Args:
        path: of the file.
        key: of the scenario, for errors.

    Raises:
        ScenarioError: it cannot be read, or is in another coordinate system.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(f"{key}: {path} cannot be read as GeoJSON ({error})") from error
    # RFC 7946 has longitude and latitude on WGS 84 only; older files may name another system.
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
    """Every polygon's rings as they stand in a document, with the properties of its feature; other shapes are left out."""
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
