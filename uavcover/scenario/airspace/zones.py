"""No-fly zones in the local frame, the entries of straight legs, and shortest paths around the zones.

Legs are checked exactly, at full length, with floor and ceiling. Over the outline, a leg is in a zone unless all of it is below
every floor, or all of it is above every ceiling. Heights change continuously along a leg, so for one floor and one ceiling of the
same kind this is exact.
"""

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import nearest_points

from uavcover.errors import ScenarioError
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.obstacle_breach import edge_distances_m, parts_over
from uavcover.kernels.obstacles import NO_OBSTACLES, ObstaclePrisms, make_obstacles
from uavcover.kernels.shortest_path import are_clear, shortest_path
from uavcover.model.limits import NoFly
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

Polygons = shapely.Polygon | shapely.MultiPolygon

CIRCLE_CORNERS = 64
"""Corners of the polygon around a circle, where one is needed: it is 0.12 % wider."""
_CORNER_REACH_M = 3.0
"""Distance of corners of paths around circles from the circles."""
_TOUCHING_M = 1e-6
"""Legs along an edge are outside."""
_HEIGHT_TOLERANCE_M = 1e-6
_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class Zone:
    """A no-fly zone in the local frame."""

    entry: NoFly  # as the scenario has it
    name: str  # as text, never empty
    outline: Polygons  # (east, north) metres; of a circle, a polygon around it
    circle: tuple[float, float, float] | None = None  # east, north, radius, metres; None for polygons

    def grown(self, margin_m: float) -> Polygons:
        """The outline with everything that is nearer to it than a margin, and a little more at corners."""
        if margin_m == 0.0:
            return self.outline
        if self.circle is not None:
            east, north, radius = self.circle
            return around_circle(east, north, radius + margin_m, corners=_corners_around(radius + margin_m))
        # Mitred corners are nowhere nearer than the margin; round ones made of chords would be.
        return self.outline.buffer(margin_m, join_style="mitre", mitre_limit=2.0)

    def depth_m(self, east_m: float, north_m: float) -> float:
        """Distance of a position to the outline from inside, at any height; 0 outside."""
        if self.circle is not None:
            return max(0.0, self.circle[2] - math.hypot(east_m - self.circle[0], north_m - self.circle[1]))
        position = shapely.Point(east_m, north_m)
        return float(shapely.distance(self.outline.boundary, position)) if self.outline.contains(position) else 0.0

    def heights_text(self) -> str:
        """Floor and ceiling as text."""
        entry = self.entry
        floors = [(entry.floor_agl_m, "above ground"), (entry.floor_amsl_m, "AMSL")]
        ceilings = [(entry.ceiling_agl_m, "above ground"), (entry.ceiling_amsl_m, "AMSL")]
        low = " or ".join(f"{height:.0f} m {datum}" for height, datum in floors if height is not None)
        high = " or ".join(f"{height:.0f} m {datum}" for height, datum in ceilings if height is not None)
        return f"from {low or 'the ground'} {f'to {high}' if high else 'up'}"


@dataclass(frozen=True, slots=True)
class ZoneBreach:
    """A leg in a zone."""

    leg: int  # number of the leg, from 0; of places alone, number of the place
    zone: int  # number of the zone
    depth_m: float  # horizontal distance to the edge of the zone, margin included, at the deepest place
    at: float  # parameter 0..1 along the leg there


def around_circle(east_m: float, north_m: float, radius_m: float, *, corners: int = CIRCLE_CORNERS) -> shapely.Polygon:
    """A regular polygon around a circle, whose sides touch it."""
    angles = (np.arange(corners) + 0.5) * (2.0 * math.pi / corners)
    reach = radius_m / math.cos(math.pi / corners)
    return shapely.Polygon(np.column_stack([east_m + reach * np.cos(angles), north_m + reach * np.sin(angles)]))


def _corners_around(radius_m: float) -> int:
    """Corners of a polygon close around a circle. It has few, because each is a turn of a detour."""
    return min(max(8, math.ceil(math.pi / math.acos(radius_m / (radius_m + _CORNER_REACH_M)))), 180)


def local_zones(entries: Sequence[NoFly], frame: LocalFrame | None, positions: shapely.Geometry) -> tuple[Zone, ...]:
    """The zones that come near to places, in the local frame.

    Args:
        entries: zones with outlines, checked.
        frame: the local frame; needed for zones in degrees.
        positions: positions of possible flights, (east, north) metres.
    """
    found = []
    for number, entry in enumerate(entries):
        zone = _local(entry, frame, entry.name or f"no_fly {number}")
        if zone.grown(entry.margin_m).intersects(positions):
            found.append(zone)
    return tuple(found)


def _local(entry: NoFly, frame: LocalFrame | None, name: str) -> Zone:
    def local(positions: Sequence[tuple[float, float]]) -> FloatArray:
        if entry.is_geographic and frame is not None:
            return frame.en_from_lon_lat(positions)
        return np.asarray(positions, dtype=float)

    center = entry.center_lon_lat_deg or entry.center_east_north_m
    if center is not None and entry.radius_m is not None:
        ((east, north),) = local([center])
        circle = (float(east), float(north), entry.radius_m)
        return Zone(entry, name, around_circle(*circle), circle)
    outline = shapely.union_all(
        [shapely.Polygon(local(outer), [local(hole) for hole in holes]) for outer, *holes in entry.parts]
    )
    return Zone(entry, name, outline if isinstance(outline, Polygons) else shapely.MultiPolygon())


@dataclass(frozen=True, eq=False)
class ZoneCheck:
    """Tests legs against zones."""

    zones: tuple[Zone, ...]  # the zones
    ground: Ground  # for heights above ground
    frame: LocalFrame | None  # for heights above sea level; None where up is such a height
    height_margin_m: float = 0.0  # floors count as this much lower, ceilings as this much higher
    margins: bool = False  # whether the margins of the zones are kept too

    def leg_breaches(self, route_m: FloatArray, legs: BoolArray | None = None) -> list[ZoneBreach]:
        """Every entry of a leg of an (n, 3) ENU route into a zone, by legs.

        A single position is one leg.

        Args:
            route_m: the places.
            legs: (n - 1,) which legs count; default: all.
        """
        route = np.asarray(route_m, dtype=float).reshape(-1, 3)
        if len(route) == 1:
            return self.position_breaches(route)
        return self._breaches(route[:-1], route[1:], legs)

    def position_breaches(self, positions_m: FloatArray) -> list[ZoneBreach]:
        """The same for (n, 3) positions without legs."""
        positions = np.asarray(positions_m, dtype=float).reshape(-1, 3)
        return self._breaches(positions, positions, None)

    def _breaches(self, begins: FloatArray, ends: FloatArray, legs: BoolArray | None) -> list[ZoneBreach]:
        if not self.zones or len(begins) == 0:
            return []
        counts = np.isfinite(begins).all(axis=1) & np.isfinite(ends).all(axis=1)
        if legs is not None:
            counts &= legs
        parts = _solids(self.zones, self.margins).parts_inside(begins, ends, np.flatnonzero(counts))
        parts = parts.only(~self._are_over_or_under(parts, begins, ends))
        depths, at = parts.deepest(begins, ends)
        # Of the parts of a leg in one zone the deepest counts; the first of equal ones.
        order = np.lexsort((np.arange(len(depths)), -depths, parts.zone, parts.leg))
        leg, zone = parts.leg[order], parts.zone[order]
        first = np.ones(len(order), dtype=bool)
        first[1:] = (np.diff(leg) != 0) | (np.diff(zone) != 0)
        return [ZoneBreach(int(parts.leg[k]), int(parts.zone[k]), float(depths[k]), float(at[k])) for k in order[first]]

    def _are_over_or_under(self, parts: "_PartsInside", begins: FloatArray, ends: FloatArray) -> BoolArray:
        """Which parts of legs are below all floors or above all ceilings; not where the ground is unknown."""
        out = np.zeros(len(parts.leg), dtype=bool)
        limited = parts.solids.limited[parts.zone]
        if not limited.any():
            return out
        legs, fraction = parts.leg[limited], parts.fraction[limited]
        p, q = (begins[legs] + fraction[:, k, None] * (ends[legs] - begins[legs]) for k in (0, 1))
        line = np.stack([p, q, np.full_like(p, np.nan)], axis=1).reshape(-1, 3)
        ranges = self.ground.leg_height_ranges_m(line)[0::3]
        both = np.stack([p, q], axis=1)
        alts = both[:, :, 2]
        if self.frame is not None:
            alts = self.frame.geodetic_from_enu(both.reshape(-1, 3))[2].reshape(-1, 2)
        leeway = _HEIGHT_TOLERANCE_M + self.ground.cut_error_m - self.height_margin_m
        out[limited] = [
            is_over_or_under(self.zones[zone].entry, (low, high), (float(a.min()), float(a.max())), leeway)
            for zone, (low, _, high, _), a in zip(parts.zone[limited], ranges.tolist(), alts, strict=True)
        ]
        return out


def is_over_or_under(entry: NoFly, agl_m: tuple[float, float], amsl_m: tuple[float, float], leeway_m: float) -> bool:
    """Whether all heights between two are below all floors or above all ceilings, exceeded by at most a leeway."""
    floors = [(entry.floor_agl_m, agl_m[1]), (entry.floor_amsl_m, amsl_m[1])]
    ceilings = [(entry.ceiling_agl_m, agl_m[0]), (entry.ceiling_amsl_m, amsl_m[0])]
    under = [highest <= floor + leeway_m for floor, highest in floors if floor is not None]
    over = [lowest >= ceiling - leeway_m for ceiling, lowest in ceilings if ceiling is not None]
    return bool((under and all(under)) or (over and all(over)))


@dataclass(frozen=True, slots=True, eq=False)
class _PartsInside:
    """Parts of legs that are inside of zones on the map."""

    solids: "_Solids"  # of the zones
    leg: IntArray  # (k,) number of the leg
    zone: IntArray  # (k,) number of the zone
    fraction: FloatArray  # (k, 2) parameters 0..1 along the leg where the part begins and ends

    def only(self, kept: BoolArray) -> "_PartsInside":
        """Some of the parts."""
        return _PartsInside(self.solids, self.leg[kept], self.zone[kept], self.fraction[kept])

    def deepest(self, begins: FloatArray, ends: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(k,) largest distances to the edge of the zone, and the parameters there. Above 0, because the parts are inside."""
        solids, (begin, end) = self.solids, self.fraction.T
        at = begin[:, None] + (end - begin)[:, None] * (np.arange(_SAMPLES + 1) / _SAMPLES)
        p, q = begins[self.leg, None, :2], ends[self.leg, None, :2]
        positions = p + at[:, :, None] * (q - p)
        circle = solids.circles[self.zone]
        depths = circle[:, 2, None] - np.hypot(*np.moveaxis(positions - circle[:, None, :2], 2, 0))
        around = np.isnan(circle[:, 2])
        depths[around] = edge_distances_m(solids.footprints, self.zone[around], np.ascontiguousarray(positions[around]))
        worst = depths.argmax(axis=1)
        rows = np.arange(len(worst))
        return np.maximum(depths[rows, worst], _TOUCHING_M), at[rows, worst]


class _Solids:
    """Outlines of zones, slightly shrunk so that legs along the edges are outside, in a spatial index.

    Args:
        zones: the zones.
        margins: whether they are grown by their margins.
    """

    def __init__(self, zones: Sequence[Zone], margins: bool) -> None:
        grown = [zone.grown(zone.entry.margin_m if margins else 0.0) for zone in zones]
        solids = np.array([each.buffer(-_TOUCHING_M, join_style="mitre") for each in grown], dtype=object)
        self.footprints = footprints_of(solids)
        self.limited = np.array([zone.entry.has_heights for zone in zones])
        self.circles = np.full((len(zones), 3), np.nan)
        for number, zone in enumerate(zones):
            if zone.circle is not None:
                self.circles[number] = zone.circle
                self.circles[number, 2] += zone.entry.margin_m if margins else 0.0
        self._tree = shapely.STRtree(solids)

    def parts_inside(self, begins: FloatArray, ends: FloatArray, legs: IntArray) -> _PartsInside:
        """The parts of some legs between (n, 3) places inside of the zones. Touching an edge is outside."""
        line, zone = self._tree.query(shapely.linestrings(np.stack([begins[legs, :2], ends[legs, :2]], axis=1)))
        leg = legs[line]
        ends_m = np.hstack([begins[leg, :2], ends[leg, :2]])
        round_ = np.flatnonzero(~np.isnan(self.circles[zone, 2]))
        other = np.flatnonzero(np.isnan(self.circles[zone, 2]))
        pair, fraction = parts_over(self.footprints, zone[other], ends_m[other])
        in_circle, of_circle = _parts_in_circles(self.circles[zone[round_]], ends_m[round_])
        pair = np.concatenate([other[pair], round_[in_circle]])
        return _PartsInside(self, leg[pair], zone[pair], np.concatenate([fraction, of_circle]))


def footprints_of(shapes: Sequence[shapely.Geometry] | NDArray[Any]) -> ObstaclePrisms:
    """Polygons as footprints with tops above 0, for the kernels that are given their numbers: without an index of tiles."""
    edges, counts = [np.empty((0, 4))], [0]
    for shape in shapes:
        rings = [shapely.get_coordinates(ring) for ring in shapely.get_parts(shapely.boundary(shape))]
        rings = rings or [np.zeros((2, 2))]  # nothing is over it
        edges += [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
        counts.append(sum(len(ring) - 1 for ring in rings))
    return NO_OBSTACLES._replace(
        edges_m=np.concatenate(edges), first_edge=np.cumsum(counts), top_m=np.ones(len(shapes))
    )


_BUILDING: Final = threading.Lock()


def _solids(zones: tuple[Zone, ...], margins: bool) -> _Solids:
    """The index of zones: one for all threads."""
    with _BUILDING:
        return _solids_once(zones, margins)


@lru_cache(maxsize=16)
def _solids_once(zones: tuple[Zone, ...], margins: bool) -> _Solids:
    return _Solids(zones, margins)


def _parts_in_circles(circles: FloatArray, lines: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which of (n, 4) lines are partly inside one circle (n, 3) each, and (k, 2) the parameters 0..1 of the parts."""
    away, steps, radius = lines[:, :2] - circles[:, :2], lines[:, 2:] - lines[:, :2], circles[:, 2]
    length = np.hypot(*steps.T)
    still = length <= _TOUCHING_M
    unit = np.where(still, 1.0, length)
    towards = steps / unit[:, None]
    nearest = -(away * towards).sum(axis=1)
    aside = np.where(still, np.hypot(*away.T), np.abs(away[:, 0] * towards[:, 1] - away[:, 1] * towards[:, 0]))
    half = np.sqrt(np.maximum(radius * radius - aside * aside, 0.0))
    fraction = np.clip(np.column_stack([nearest - half, nearest + half]) / unit[:, None], 0.0, 1.0)
    fraction[still] = 0.0, 1.0
    inside = (aside < radius - _TOUCHING_M) & (still | ((fraction[:, 1] - fraction[:, 0]) * length > _TOUCHING_M))
    return np.flatnonzero(inside), fraction[inside]


def check_is_outside(key: str, zones: tuple[Zone, ...], position_m: FloatArray, alt_amsl_offset_m: float) -> None:
    """Refuse a home or rally point in a no-fly zone that begins at the ground, or nearer to it than its margin."""
    position = shapely.Point(position_m[:2])
    for zone in zones:
        entry = zone.entry
        floors = [floor for floor in (entry.floor_agl_m,) if floor is not None]
        floors += [entry.floor_amsl_m - (position_m[2] + alt_amsl_offset_m)] if entry.floor_amsl_m is not None else []
        if floors and min(floors) > 0.0:
            continue
        distance_m = zone.outline.distance(position)
        if zone.circle is not None:
            distance_m = max(0.0, math.hypot(*(position_m[:2] - zone.circle[:2])) - zone.circle[2])
        if distance_m < entry.margin_m or distance_m == 0.0:
            where = "lies in" if distance_m == 0.0 else f"is {distance_m:.1f} m from"
            more = "" if distance_m == 0.0 else f", whose margin_m is {entry.margin_m:g} m"
            raise ScenarioError(f"{key}: {where} no-fly zone {zone.name!r}{more}; move the position")


_INSIDE_M = 0.02
"""Distance of corners of paths from the edge, for rounding."""
_MOST_CORNERS = 48
"""A wall with more corners is divided, because every nearby line tests all its corners."""


class PathAround:
    """Shortest paths on the map inside a region with holes. Their corners are corners of the region that protrude into it."""

    def __init__(self, region: Polygons) -> None:
        self.region = region
        self._inner = region.buffer(-_INSIDE_M, join_style="mitre")
        self._corners = _corners_that_stick_in(self._inner)
        self._walls, self._free = _walls_around(region), footprints_of([self._inner])
        # A prepared polygon builds its index on first use, which is not thread-safe: use it now.
        shapely.prepare(self._inner)
        shapely.covers(self._inner, shapely.centroid(region))

    def inside(self, position_m: FloatArray) -> FloatArray:
        """A (2,) place, or the nearest one inside."""
        point = shapely.Point(position_m)
        if self._inner.is_empty or self._inner.covers(point):
            return position_m
        return np.asarray(nearest_points(self._inner, point)[0].coords[0])

    @property
    def corners_m(self) -> FloatArray:
        """(k, 2) possible corners of paths."""
        return self._corners[:, :2]

    def are_straight(self, ends_m: FloatArray) -> BoolArray:
        """(n,) whether each of (n, 2, 2) straight lines is inside."""
        lines = np.ascontiguousarray(ends_m, dtype=float).reshape(-1, 4)
        return are_clear(self._walls, lines) & (not self.region.is_empty)

    def is_straight(self, a_m: FloatArray, b_m: FloatArray) -> bool:
        """Whether the straight line between two places is inside."""
        return bool(self.are_straight(np.array([[a_m, b_m]]))[0])

    def between(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of the shortest way from one place to another, both included; None where there is no way.

        Both places have to be inside.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        a, b = ((float(position[0]), float(position[1])) for position in (a_m, b_m))
        numbers = shortest_path(self._walls, self._corners, a, b)
        return np.array([a_m, *self._corners[numbers, :2], b_m]) if numbers.size else None

    def along(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of a path that follows the straight line inside the region, and is shortest in between.

        A flight line should observe the ground beside it; a shortest path around its middle would leave the line at its end.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        line = np.array([[*a_m, *b_m]], dtype=float)
        step_m = line[0, 2:] - line[0, :2]
        _, fractions = parts_over(self._free, np.zeros(1, dtype=np.int64), line)
        kept = (fractions[:, 1] - fractions[:, 0]) * np.hypot(*step_m) > _INSIDE_M
        ends_m = line[0, :2] + fractions[kept].reshape(-1, 1) * step_m
        ends_m[fractions[kept].ravel() == 1.0] = b_m
        path = [np.asarray(a_m, dtype=float)]
        for position in [*ends_m, np.asarray(b_m, dtype=float)]:
            if np.hypot(*(position - path[-1])) <= _INSIDE_M:
                continue
            part = self.between(path[-1], position)
            if part is None:
                return self.between(a_m, b_m)
            path += list(part[1:])
        return np.array(path)


def _walls_around(region: Polygons) -> ObstaclePrisms:
    """Everything but a region, as footprints in an index of tiles, none of them with many corners."""
    if region.is_empty:
        return NO_OBSTACLES
    outside = shapely.box(*region.bounds).buffer(1.0, join_style="mitre").difference(region.buffer(1e-7))
    walls = [wall for part in shapely.get_parts(outside) for wall in _divided(part)]
    found = footprints_of(walls)
    return make_obstacles(found.edges_m, found.first_edge, found.top_m, grown_m=0.0)


def _divided(wall: shapely.Geometry) -> list[shapely.Polygon]:
    """A polygon, or pieces of it with few corners."""
    if not isinstance(wall, shapely.Polygon):
        return []
    if shapely.get_num_coordinates(wall) <= _MOST_CORNERS:
        return [wall]
    west, south, east, north = wall.bounds
    if max(east - west, north - south) < _INSIDE_M:
        return [wall]
    if east - west > north - south:
        middle = 0.5 * (west + east)
        halves = shapely.box(west, south, middle, north), shapely.box(middle, south, east, north)
    else:
        middle = 0.5 * (south + north)
        halves = shapely.box(west, south, east, middle), shapely.box(west, middle, east, north)
    return [piece for half in halves for part in shapely.get_parts(wall.intersection(half)) for piece in _divided(part)]


def _corners_that_stick_in(region: shapely.Geometry) -> FloatArray:
    """(k, 6) corners at which the region is wider than half a turn, each with the ones before and after it."""
    found = [np.empty((0, 6))]
    for part in shapely.get_parts(region):
        oriented = shapely.orient_polygons(part)
        for ring in (oriented.exterior, *oriented.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
            onto, off = corners - before, after - corners
            # The region is to the left of its rings: a turn to the right sticks in.
            sticks = onto[:, 0] * off[:, 1] - onto[:, 1] * off[:, 0] < 0.0
            found.append(np.hstack([corners, before, after])[sticks])
    return np.ascontiguousarray(np.vstack(found))
