"""From rings of a file to valid polygons in longitude and latitude. Errors say where and what to do."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import ProjError

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Ring, Rings
from uavcover.scenario.areas.gis_file import polygons_of_shape

SMALLEST_M2 = 1.0
_EARTH = Geod(ellps="WGS84")


@dataclass(frozen=True, slots=True)
class RingReading:
    """Settings for reading rings."""

    crs: CRS  # their coordinate system
    may_be_open: bool = False  # whether the last corner need not repeat the first
    # whether rings that are not closed are closed, and invalid polygons replaced by the union of their outlines minus
    # the union of their holes
    make_valid: bool = False
    swap_axes: bool = False  # whether the file has latitude, or north, first


def read_polygons(rings: Rings, reading: RingReading, where: str) -> tuple[list[shapely.Polygon], tuple[str, ...]]:
    """Read a polygon of a file in longitude and latitude, in several parts where repair gives several.

    Also return a note on repair.

    Longitudes of one polygon are continuous: across 180 degrees they go beyond it.

    Raises:
        InputError: says what is wrong with the polygon, where, and the way out.
    """
    outlines = [_outline(ring, reading, f"{where}{f', hole {n}' if n else ''}") for n, ring in enumerate(rings)]
    if reading.crs.is_geographic:
        outlines = _continuous(outlines, reading, where)
    polygon = shapely.Polygon(outlines[0], outlines[1:])
    parts = [polygon]
    if not polygon.is_valid:
        parts = _mended(polygon, reading, where)
    if not any(part.area > 0.0 for part in parts):
        if shapely.Polygon(outlines[0]).area > 0.0:
            raise InputError(f"{where}: the holes cover the whole area; remove some of them")
        raise InputError(f"{where}: all corners lie on one line, so the area is zero; draw it again")
    found = [_geographic(part, reading, where) for part in parts if part.area > 0.0]
    size_m2 = sum(_area_m2(part) for part in found)
    if size_m2 < SMALLEST_M2:
        raise InputError(
            f"{where}: the area is only {size_m2:.2g} square metres; if the coordinates use another coordinate "
            "system, specify it with --crs"
        )
    if polygon.is_valid:
        return found, ()
    written_m2 = _area_m2(_geographic(polygon, reading, where))
    return found, (
        f"{where}: repaired with make_valid ({written_m2 / 1e4:,.4g} ha before, {size_m2 / 1e4:,.4g} ha after)",
    )


def _area_m2(polygon: shapely.Polygon) -> float:
    """Area of the outline minus its holes, each as it is drawn."""
    outer, *holes = (abs(_EARTH.geometry_area_perimeter(ring)[0]) for ring in (polygon.exterior, *polygon.interiors))
    return float(outer - sum(holes))


def _outline(ring: Ring, reading: RingReading, where: str) -> FloatArray:
    """(n, 2) corners, x or longitude first, closed."""
    corners = np.array(ring, dtype=float).reshape(-1, 2)
    if not np.isfinite(corners).all():
        number = int(np.argmin(np.isfinite(corners).all(axis=1))) + 1
        raise InputError(f"{where}: corner {number} is not a pair of finite numbers; remove or correct it")
    if len(np.unique(corners, axis=0)) < 3:
        raise InputError(
            f"{where}: the ring has {len(np.unique(corners, axis=0))} different corners, but needs at least 3; draw it again"
        )
    if not np.array_equal(corners[0], corners[-1]):
        if not (reading.may_be_open or reading.make_valid):
            raise InputError(
                f"{where}: the ring is not closed: it ends at {_pair(corners[-1])} and begins at {_pair(corners[0])}; "
                "repeat the first corner at the end, or use --make-valid"
            )
        corners = np.vstack([corners, corners[:1]])
    return corners[:, ::-1] if reading.swap_axes else corners


def _continuous(outlines: Sequence[FloatArray], reading: RingReading, where: str) -> list[FloatArray]:
    """Longitudes without jumps of 360 degrees, those of holes beside those of the outer ring."""
    turn = 2.0 * math.pi / reading.crs.axis_info[0].unit_conversion_factor
    found: list[FloatArray] = []
    for outline in outlines:
        lons, lats = outline.T
        worst = int(np.argmax(np.abs(lats)))
        if abs(lats[worst]) > 0.25 * turn or np.abs(lons).max() > turn:
            swapped = np.abs(lons).max() <= 0.25 * turn and np.abs(lats).max() <= 0.5 * turn
            worst = worst if abs(lats[worst]) > 0.25 * turn else int(np.argmax(np.abs(lons)))
            raise InputError(
                f"{where}: longitude {lons[worst]:.10g}, latitude {lats[worst]:.10g} is not a position on Earth; "
                + (
                    "the axes seem to be swapped: write longitude first, or use --swap-axes"
                    if swapped
                    else "specify the file's coordinate system with --crs EPSG:NUMBER"
                )
            )
        steps = np.diff(lons)
        steps -= turn * np.round(steps / turn)
        unwrapped = np.concatenate([lons[:1], lons[0] + np.cumsum(steps)])
        if np.array_equal(np.round((unwrapped - lons) / turn), np.zeros(len(lons))):
            unwrapped = lons  # to the bit as it was
        elif abs(unwrapped[-1] - unwrapped[0]) > 0.5 * turn:
            raise InputError(f"{where}: the area contains a pole, which is not supported; use a smaller area")
        if found:
            unwrapped = unwrapped + turn * np.round((found[0][:, 0].mean() - unwrapped.mean()) / turn)
        found.append(np.column_stack([unwrapped, lats]))
    return found


def _mended(polygon: shapely.Polygon, reading: RingReading, where: str) -> list[shapely.Polygon]:
    if polygon.area == 0.0 and polygon.convex_hull.area == 0.0:
        return [polygon]
    if not reading.make_valid:
        reason, _, place = shapely.is_valid_reason(polygon).partition("[")
        numbers = [float(number) for number in place.rstrip("]").split()[:2]]
        at = f" at {_place(numbers, reading)}" if len(numbers) == 2 else ""
        what = {
            "Self-intersection": "the outline crosses itself",
            "Ring Self-intersection": "the outline touches itself",
            "Hole lies outside shell": "a hole lies outside",
            "Nested holes": "a hole lies in another hole",
            "Interior is disconnected": "holes divide the area into separate parts",
        }.get(reason.strip(), reason.strip().lower())
        raise InputError(f"{where}: {what}{at}; correct it there, or use --make-valid")
    # Ring by ring: the default method counts crossings and fills holes that overlap or touch the outline, and "structure" takes
    # a hole outside of the outline for another outline.
    outline, *holes = (
        shapely.make_valid(shapely.Polygon(ring), method="structure", keep_collapsed=False)
        for ring in (polygon.exterior, *polygon.interiors)
    )
    return [shapely.Polygon(one[0], one[1:]) for one in polygons_of_shape(outline - shapely.union_all(holes))]


def _geographic(polygon: shapely.Polygon, reading: RingReading, where: str) -> shapely.Polygon:
    """A polygon of the file's system in longitude and latitude on WGS 84."""
    if reading.crs.equals(CRS.from_epsg(4326), ignore_axis_order=True):
        return polygon
    rings = [
        _lon_lat(np.asarray(ring.coords)[:, :2], reading, where) for ring in (polygon.exterior, *polygon.interiors)
    ]
    wgs84 = RingReading(CRS.from_epsg(4326))
    rings = _continuous(rings, wgs84, where)
    return shapely.Polygon(rings[0], rings[1:])


def _lon_lat(corners: FloatArray, reading: RingReading, where: str) -> FloatArray:
    try:
        transformer = Transformer.from_crs(reading.crs, 4326, always_xy=True, allow_ballpark=False)
        lon, lat = transformer.transform(corners[:, 0], corners[:, 1], errcheck=True)
    except ProjError as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(
            f"{where}: the area cannot be converted from {reading.crs.name} to longitude and latitude ({reason}); "
            "specify the correct coordinate system with --crs, or convert the file (ogr2ogr -t_srs EPSG:4326)"
        ) from error
    return np.column_stack([lon, lat])


def _place(numbers: list[float], reading: RingReading) -> str:
    """A position of the file, as longitude and latitude where possible."""
    try:
        lon, lat = (
            numbers
            if reading.crs.is_geographic
            else Transformer.from_crs(reading.crs, 4326, always_xy=True).transform(numbers[0], numbers[1])
        )
    except ProjError:
        return _pair(numbers)
    return f"longitude {math.remainder(lon, 360.0):.6f}, latitude {lat:.6f}"


def _pair(numbers: Any) -> str:
    return f"({numbers[0]:.10g}, {numbers[1]:.10g})"


def joined(polygons: Sequence[shapely.Polygon]) -> list[shapely.Polygon]:
    """Polygons side by side in longitude: those that were cut at 180 degrees, as GeoJSON wants it, are one again."""
    if not polygons:
        return []
    first = polygons[0].centroid.x
    turns = [round((polygon.centroid.x - first) / 360.0) for polygon in polygons]
    if not any(turns):
        return list(polygons)
    moved = [
        polygon if not turn else shapely.transform(polygon, lambda p, t=turn: p - np.array([360.0 * t, 0.0]))  # type: ignore[misc]
        for polygon, turn in zip(polygons, turns, strict=True)
    ]
    union = shapely.union_all(moved)
    return [part for part in shapely.get_parts(union) if isinstance(part, shapely.Polygon)]


def rings_of(polygon: shapely.Polygon) -> Rings:
    """The rings of a polygon, longitudes within -180..180."""
    (rings,) = polygons_of_shape(polygon)
    return tuple(tuple((_wrapped(lon), lat) for lon, lat in ring) for ring in rings)


def _wrapped(lon_deg: float) -> float:
    return lon_deg if -180.0 <= lon_deg <= 180.0 else math.remainder(lon_deg, 360.0)
