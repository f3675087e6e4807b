"""Tables of a scenario file before they are validated: lists of vehicles and launch points, and rings with mistakes."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import shapely

from uavcover.errors import InputError, ScenarioError
from uavcover.model.area import Outline, Ring, Rings
from uavcover.model.limits import FlightLimits, NoFly, Obstacle
from uavcover.model.scenario import Scenario
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.obstacles import geojson_polygons

LAUNCH_POINTS = "launch_point"

_OF_SEVERAL = {
    "home": "takes its home from [home]",
    "area": "covers the whole [area]",
    "sensor": "takes its sensor from [sensor]",
}
"""Keys of a [[vehicle]] that one vehicle alone does not have, and where it has them."""


def with_fleet(raw: dict[str, Any], *, source: str) -> dict[str, Any]:
    """Rewrite a scenario file's list of vehicles: as one [vehicle] and their number, or as one each where they differ.

    Args:
        raw: of the whole file; not changed.
        source: names the file in errors.

    Raises:
        ScenarioError: a vehicle has no home, [home] belongs to no vehicle, or their number is not that of [fleet].
    """
    if "vehicles" in raw:
        raise ScenarioError(f"{source}: vehicles: unknown key; write one [[vehicle]] table for each vehicle")
    raw = _with_launch_points(raw, source=source)
    listed, fleet, home = raw.get("vehicle"), raw.get("fleet", {}), raw.get("home")
    if isinstance(listed, dict):
        _refuse_of_several(listed, f"{source}: vehicle")
    if not isinstance(listed, list) or not listed or not all(isinstance(table, dict) for table in listed):
        return raw
    count = len(listed)
    if isinstance(fleet, dict):
        if fleet.get("vehicles", count) != count:
            raise ScenarioError(
                f"{source}: fleet.vehicles: the value is {fleet['vehicles']!r}, but there are {count} [[vehicle]] "
                "tables; use only one of the two"
            )
        fleet = {**fleet, "vehicles": count}
    first = listed[0]
    if not _OF_SEVERAL.keys() & first.keys() and all(table == first for table in listed[1:]):
        return raw | {"vehicle": first, "fleet": fleet}
    if count == 1:
        _refuse_of_several(first, f"{source}: vehicle.0")
    homes = [table.get("home", home) for table in listed]
    if missing := [number for number, position in enumerate(homes) if position is None]:
        raise ScenarioError(
            f"{source}: vehicle.{missing[0]}.home: the key is missing, and there is no [home] for vehicles without their own home"
        )
    if home is not None and home not in homes:
        raise ScenarioError(f"{source}: home: every [[vehicle]] has its own home; remove [home]")
    own = [{**table, "home": position} for table, position in zip(listed, homes, strict=True)]
    alike = {key: value for key, value in first.items() if key not in (*_OF_SEVERAL, "link", "system_id")}
    return raw | {"vehicle": alike, "vehicles": own, "home": homes[0], "fleet": fleet}


def _with_launch_points(raw: dict[str, Any], *, source: str) -> dict[str, Any]:
    """The tables with a [[vehicle]] for [home] and for each launch point."""
    if LAUNCH_POINTS not in raw:
        return raw
    points, vehicle, home, fleet = raw[LAUNCH_POINTS], raw.get("vehicle", {}), raw.get("home"), raw.get("fleet", {})
    if not isinstance(points, list) or not points or not all(isinstance(point, dict) for point in points):
        raise ScenarioError(
            f"{source}: {LAUNCH_POINTS}: write one [[{LAUNCH_POINTS}]] table with lat_deg and lon_deg for each position"
        )
    if home is None:
        raise ScenarioError(f"{source}: {LAUNCH_POINTS}: launch points require a [home]; write one of them as [home]")
    if not isinstance(vehicle, dict) or not isinstance(fleet, dict) or fleet.get("vehicles", 1) != 1:
        raise ScenarioError(
            f"{source}: {LAUNCH_POINTS}: launch points are supported for only one [vehicle]; define a home for each"
        )
    if fleet.get("one_at_a_time", True) is not True:
        raise ScenarioError(
            f"{source}: fleet.one_at_a_time: remove this key, because one vehicle with launch points "
            "always flies one sortie at a time"
        )
    _refuse_of_several(vehicle, f"{source}: vehicle")
    homes = [home, *points]
    for number, point in enumerate(homes):
        if point in homes[:number]:
            raise ScenarioError(f"{source}: {LAUNCH_POINTS}.{number - 1}: duplicates an earlier position; remove it")
    others = {key: value for key, value in raw.items() if key != LAUNCH_POINTS}
    return others | {
        "vehicle": [{**vehicle, "home": position} for position in homes],
        "fleet": {key: value for key, value in fleet.items() if key != "vehicles"} | {"one_at_a_time": True},
    }


def _refuse_of_several(table: dict[str, Any], where: str) -> None:
    for key, instead in _OF_SEVERAL.items():
        if key in table:
            raise ScenarioError(f"{where}.{key}: a single vehicle {instead}; use [[vehicle]] only for several vehicles")


def across_180(*rings: Ring) -> list[Ring]:
    """Rings of one polygon with continuous longitudes, for checks on a plane. Across 180 degrees they continue to the east."""
    lons = [lon for lon, _ in rings[0]]
    if not lons or max(lons) - min(lons) <= 180.0:
        return list(rings)
    return [tuple((lon + 360.0 if lon < 0.0 else lon, lat) for lon, lat in ring) for ring in rings]


def valid_ring(ring: Ring, where: str, found: list[str]) -> Any:
    """The polygon of a ring; None for an invalid one, which adds a line to ``found``."""
    if len({*ring}) < 3:
        found.append(f"{where}: a ring needs at least 3 different corners, but this one has {len({*ring})}")
        return None
    polygon = shapely.Polygon(ring)
    if not polygon.is_valid:
        found.append(f"{where}: {shapely.is_valid_reason(polygon)}; a ring must not cross or touch itself")
        return None
    return polygon


def fence_mistakes(limits: FlightLimits) -> list[str]:
    """Mistakes in the rings of a fence."""
    found: list[str] = []
    for key in ("fence_lon_lat_deg", "fence_east_north_m"):
        ring = getattr(limits, key)
        if ring is not None:
            valid_ring(across_180(ring)[0] if key == "fence_lon_lat_deg" else ring, f"limits.{key}", found)
    for number, ring in enumerate(limits.fence_polygons_lon_lat_deg or ()):
        valid_ring(across_180(ring)[0], f"limits.fence_polygons_lon_lat_deg.{number}", found)
    for number, ring in enumerate(limits.fence_polygons_east_north_m or ()):
        valid_ring(ring, f"limits.fence_polygons_east_north_m.{number}", found)
    return found


def no_fly_mistakes(zones: Sequence[NoFly], *, on_earth: bool) -> list[str]:
    """Mistakes in the outlines of zones.

    Args:
        zones: as the scenario has them, files omitted.
        on_earth: whether the local frame has a position on Earth.
    """
    found: list[str] = []
    for number, zone in enumerate(zones):
        where = f"no_fly.{number}{f' ({zone.name})' if zone.name else ''}"
        if zone.is_geographic and not on_earth:
            found.append(
                f"{where}: longitudes and latitudes require an [origin]; add it, or use polygon_east_north_m or "
                "center_east_north_m"
            )
        for rings in zone.parts:
            outer, *holes = across_180(*rings) if zone.is_geographic else rings
            polygon = valid_ring(outer, where, found)
            if polygon is not None and not polygon.area > 0.0:
                found.append(f"{where}: the area of the ring is zero; draw it again")
            for hole_number, ring in enumerate(holes):
                hole = valid_ring(ring, f"{where}: hole {hole_number}", found)
                if polygon is not None and hole is not None and not polygon.covers(hole):
                    found.append(f"{where}: hole {hole_number} reaches outside the zone")
    return found


def prism_mistakes(prisms: Sequence[Obstacle], *, on_earth: bool) -> list[str]:
    """Mistakes in the footprints of obstacles; see :func:`no_fly_mistakes` for ``on_earth``."""
    found: list[str] = []
    for number, prism in enumerate(prisms):
        where = f"obstacles.prisms.{number} ({prism.name or 'no name'})"
        if prism.rings_lon_lat_deg and not on_earth:
            found.append(f"{where}: longitudes and latitudes require an [origin]; add it, or use rings_east_north_m")
        outer, *courts = [
            valid_ring(ring, where, found) for ring in prism.rings_lon_lat_deg or prism.rings_east_north_m
        ]
        if outer is not None and any(court is not None and not outer.covers(court) for court in courts):
            found.append(f"{where}: a courtyard reaches outside the footprint")
    return found


def area_mistakes(area: Outline, file_key: str | None, *, key: str = "area") -> list[str]:
    """Mistakes in the rings of an area.

    Args:
        area: with its rings.
        file_key: the key of the file that they came from; None where the scenario has them.
        key: its place in the scenario file.
    """
    kind = "lon_lat_deg" if area.is_geographic else "east_north_m"
    found: list[str] = []
    for part, (outer_ring, *hole_rings) in enumerate(area.parts):
        outer_key = f"{key}.polygon_{kind}"
        hole_key = f"{key}.holes_{kind}."
        if len(area.parts) > 1:
            outer_key = f"{file_key}: polygon {part}" if file_key else f"{key}.polygons_{kind}.{part}"
            hole_key = f"{outer_key}: hole "
        elif file_key:
            outer_key, hole_key = file_key, f"{file_key}: hole "
        if area.is_geographic:
            outer_ring, *hole_rings = across_180(outer_ring, *hole_rings)
        left = outer = valid_ring(outer_ring, outer_key, found)
        holes_end = len(found)
        for number, ring in enumerate(hole_rings):
            hole = valid_ring(ring, f"{hole_key}{number}", found)
            if hole is None or outer is None:
                continue
            if not outer.covers(hole):
                found.append(f"{hole_key}{number}: the hole reaches outside the polygon")
            left = left.difference(hole)
        if outer is not None and len(found) == holes_end and not left.area > 0.0:
            found.append(f"{outer_key}: the holes cover the whole area; remove some of them")
    return found


def bounds_deg(area: Outline, scenario: Scenario) -> tuple[float, float, float, float] | None:
    """West, south, east, north of area, fence and homes, or of the origin; None without a position on Earth.

    Args:
        area: with its rings.
        scenario: for fence, home and origin.
    """
    rings = [rings[0] for rings in area.parts] if area.is_geographic else []
    rings += scenario.limits.fence_rings_lon_lat_deg
    positions = [position for ring in rings for position in across_180(ring)[0]]
    for position in (scenario.home, scenario.origin, *(vehicle.home for vehicle in scenario.vehicles)):
        if position is not None and position.lat_deg is not None and position.lon_deg is not None:
            beside = positions[0][0] if positions else position.lon_deg
            positions.append((position.lon_deg + 360.0 * round((beside - position.lon_deg) / 360.0), position.lat_deg))
    if not positions:
        return None
    lons, lats = zip(*positions, strict=True)
    return min(lons), min(lats), max(lons), max(lats)


# Outlines of a scenario's area and of a vehicle's part of it. Files are replaced by their rings and checked.

_MOST_MISTAKES = 5
"""Largest number of mistakes of one outline in an error line."""
_Given = TypeVar("_Given", bound=Outline)


def with_rings(outline: _Given, folder: Path, *, key: str) -> _Given:
    """The outline with its file replaced by the rings.

    Raises:
        ScenarioError: the file cannot be used.
    """
    if outline.file is not None:
        return _from_file(outline, folder, key)
    if outline.geojson is None:
        return outline
    path = folder / outline.geojson
    parts = tuple(rings for rings, _ in geojson_polygons(path, key=f"{key}.geojson"))
    if not parts:
        raise ScenarioError(f"{key}.geojson: {path}: the file contains no polygons; at least one is required")
    try:
        return _of_parts(parts, outline)
    except ValueError as error:
        raise ScenarioError(f"{key}.geojson: {path}: {error}") from error


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
    """The same outline with its rings, and without the settings of a file."""
    without: dict[str, Any] = {field.name: field.default for field in dataclasses.fields(Outline)}
    if len(parts) > 1:
        return dataclasses.replace(outline, **(without | {"polygons_lon_lat_deg": parts}))
    outer, *holes = parts[0]
    rings: dict[str, Any] = {"polygon_lon_lat_deg": outer, "holes_lon_lat_deg": tuple(holes)}
    return dataclasses.replace(outline, **(without | rings))
