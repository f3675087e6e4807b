"""Outlines of a scenario's area and of a vehicle's part of it. Files are replaced by their rings and checked."""

import dataclasses
from pathlib import Path
from typing import Any, TypeVar

from uavcover.errors import InputError, ScenarioError
from uavcover.model.area import Outline, Rings
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.obstacles import polygons_of, read_geojson
from uavcover.scenario.ring_checks import area_mistakes

_MOST_MISTAKES = 5
"""Largest number of mistakes of one outline in an error line."""
_Given = TypeVar("_Given", bound=Outline)


def with_rings(outline: _Given, folder: Path, *, key: str) -> _Given:
    """The outline with its file replaced by the rings.

    Args:
        outline: as the scenario has it.
        folder: base of relative paths.
        key: its place in the scenario file, for errors.

    Raises:
        ScenarioError: the file cannot be used.
    """
    if outline.file is not None:
        return _from_file(outline, folder, key)
    if outline.geojson is None:
        return outline
    path = folder / outline.geojson
    document = read_geojson(path, key=f"{key}.geojson")
    try:
        parts = tuple(
            tuple(tuple((float(p[0]), float(p[1])) for p in ring) for ring in rings)
            for rings, _ in polygons_of(document)
        )
        if not parts:
            raise ScenarioError(f"{key}.geojson: {path} has no polygon; at least one is needed")
        return _of_parts(parts, outline)
    except (TypeError, ValueError, IndexError, KeyError, AttributeError) as error:
        raise ScenarioError(f"{key}.geojson: {path}: the file is not a GeoJSON polygon ({error})") from error


def outline_mistakes(outline: Outline, folder: Path, *, key: str) -> list[str]:
    """Mistakes in the rings of an outline; arguments as of :func:`with_rings`."""
    file_key = f"{key}.file" if outline.file is not None else f"{key}.geojson" if outline.geojson is not None else None
    try:
        return area_mistakes(with_rings(outline, folder, key=key), file_key, key=key)[:_MOST_MISTAKES]
    except ScenarioError as error:
        return [str(error)]


def _from_file(outline: _Given, folder: Path, key: str) -> _Given:
    query = AreaQuery(
        source=outline.file or "", layer=outline.layer, feature=outline.feature, crs=outline.crs,
        make_valid=outline.make_valid, swap_axes=outline.swap_axes,
    )  # fmt: skip
    try:
        parts = read_area(query, folder=folder).parts
    except InputError as error:
        raise ScenarioError(f"{key}.file: {error}") from error
    return _of_parts(parts, outline)


def _of_parts(parts: tuple[Rings, ...], outline: _Given) -> _Given:
    """The same outline with its rings, and without what a file needs."""
    without: dict[str, Any] = {field.name: field.default for field in dataclasses.fields(Outline)}
    if len(parts) > 1:
        return dataclasses.replace(outline, **(without | {"polygons_lon_lat_deg": parts}))
    outer, *holes = parts[0]
    rings: dict[str, Any] = {"polygon_lon_lat_deg": outer, "holes_lon_lat_deg": tuple(holes)}
    return dataclasses.replace(outline, **(without | rings))
