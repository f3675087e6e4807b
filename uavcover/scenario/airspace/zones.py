"""No-fly zones in the local frame, and where straight legs enter them: exactly, at full length, with floor and ceiling.

Over the outline a leg is in a zone unless all of it is below every floor, or all of it is above every ceiling. Heights change
continuously along a leg, so for one floor and one ceiling of the same kind this is no more than what enters.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.no_fly import NoFly
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

Polygons = shapely.Polygon | shapely.MultiPolygon

CIRCLE_CORNERS = 64
"""Corners of the polygon around a circle, where one is needed: it is 0.12 % wider."""
_CORNER_REACH_M = 3.0
"""Corners of ways around circles lie this far outside of them."""
_TOUCHING_M = 1e-6
"""Legs along an edge are outside."""
_HEIGHT_TOLERANCE_M = 1e-6
_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class Zone:
    """A no-fly zone in the local frame.

    Attributes:
        entry: as the scenario has it.
        name: for people, never empty.
        outline: (east, north) metres; of a circle, a polygon around it.
        circle: east, north, radius, metres; none for polygons.
    """

    entry: NoFly
    name: str
    outline: Polygons
    circle: tuple[float, float, float] | None = None

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
        place = shapely.Point(east_m, north_m)
        return float(shapely.distance(self.outline.boundary, place)) if self.outline.contains(place) else 0.0

    def heights_in_words(self) -> str:
        """Floor and ceiling for people."""
        entry = self.entry
        floors = [(entry.floor_agl_m, "above ground"), (entry.floor_amsl_m, "AMSL")]
        ceilings = [(entry.ceiling_agl_m, "above ground"), (entry.ceiling_amsl_m, "AMSL")]
        low = " or ".join(f"{height:.0f} m {datum}" for height, datum in floors if height is not None)
        high = " or ".join(f"{height:.0f} m {datum}" for height, datum in ceilings if height is not None)
        return f"from {low or 'the ground'} {f'to {high}' if high else 'up'}"


@dataclass(frozen=True, slots=True)
class ZoneBreach:
    """A leg in a zone.

    Attributes:
        leg: number of the leg, from 0; of places alone, number of the place.
        zone: number of the zone.
        depth_m: horizontal distance to the edge of the zone, margin included, at the deepest place.
        at: parameter 0..1 along the leg there.
    """

    leg: int
    zone: int
    depth_m: float
    at: float


def around_circle(east_m: float, north_m: float, radius_m: float, *, corners: int = CIRCLE_CORNERS) -> shapely.Polygon:
    """A regular polygon around a circle, whose sides touch it."""
    angles = (np.arange(corners) + 0.5) * (2.0 * math.pi / corners)
    reach = radius_m / math.cos(math.pi / corners)
    return shapely.Polygon(np.column_stack([east_m + reach * np.cos(angles), north_m + reach * np.sin(angles)]))


def _corners_around(radius_m: float) -> int:
    """Corners of a polygon close around a circle. It has few, because each is a turn of a detour."""
    return min(max(8, math.ceil(math.pi / math.acos(radius_m / (radius_m + _CORNER_REACH_M)))), 180)


def local_zones(entries: Sequence[NoFly], frame: LocalFrame | None, places: shapely.Geometry) -> tuple[Zone, ...]:
    """The zones that come near to places, in the local frame.

    Args:
        entries: zones with outlines, checked.
        frame: the local frame; needed for zones in degrees.
        places: what may be flown over, (east, north) metres.
    """
    found = []
    for number, entry in enumerate(entries):
        zone = _local(entry, frame, entry.name or f"no_fly {number}")
        if zone.grown(entry.margin_m).intersects(places):
            found.append(zone)
    return tuple(found)


def _local(entry: NoFly, frame: LocalFrame | None, name: str) -> Zone:
    def local(places: Sequence[tuple[float, float]]) -> FloatArray:
        corners = np.asarray(places, dtype=float)
        if not entry.is_geographic or frame is None:
            return corners
        return frame.enu_from_geodetic(corners[:, 1], corners[:, 0], frame.alt_amsl_m)[:, :2]

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
    """Tests legs against zones.

    Attributes:
        zones: the zones.
        ground: for heights above ground.
        frame: for heights above sea level; none where up is such a height.
        height_margin_m: floors count as this much lower, ceilings as this much higher.
        margins: whether the margins of the zones are kept too.
    """

    zones: tuple[Zone, ...]
    ground: Ground
    frame: LocalFrame | None
    height_margin_m: float = 0.0
    margins: bool = False

    def leg_breaches(self, route_m: FloatArray, legs: BoolArray | None = None) -> list[ZoneBreach]:
        """Every entry of a leg of an (n, 3) ENU route into a zone, by legs.

        A single position is one leg.

        Args:
            route_m: the places.
            legs: (n - 1,) which legs count; default: all.
        """
        route = np.asarray(route_m, dtype=float).reshape(-1, 3)
        if len(route) == 1:
            return self.place_breaches(route)
        return self._breaches(route[:-1], route[1:], legs)

    def place_breaches(self, places_m: FloatArray) -> list[ZoneBreach]:
        """The same for (n, 3) places alone."""
        places = np.asarray(places_m, dtype=float).reshape(-1, 3)
        return self._breaches(places, places, None)

    def _breaches(self, begins: FloatArray, ends: FloatArray, legs: BoolArray | None) -> list[ZoneBreach]:
        if not self.zones or len(begins) == 0:
            return []
        counts = np.isfinite(begins).all(axis=1) & np.isfinite(ends).all(axis=1)
        if legs is not None:
            counts &= legs
        numbers = np.flatnonzero(counts)
        lines = np.asarray(shapely.linestrings(np.stack([begins[numbers, :2], ends[numbers, :2]], axis=1)))
        found = []
        for z, zone in enumerate(self.zones):
            margin_m = zone.entry.margin_m if self.margins else 0.0
            solid = _solid(zone, margin_m)
            # The bounds first: nearly all legs are far from nearly all zones.
            west, south, east, north = solid.bounds
            boxes = shapely.bounds(lines)
            near = (boxes[:, 0] <= east) & (boxes[:, 2] >= west) & (boxes[:, 1] <= north) & (boxes[:, 3] >= south)
            vertical = (boxes[:, 0] == boxes[:, 2]) & (boxes[:, 1] == boxes[:, 3])
            near[near] = vertical[near] | shapely.intersects(solid, lines[near])
            for k in numbers[near]:
                breach = self._breach(zone, solid, margin_m, begins[k], ends[k])
                if breach is not None:
                    found.append(ZoneBreach(int(k), z, *breach))
        return sorted(found, key=lambda breach: (breach.leg, breach.zone))

    def _breach(
        self, zone: Zone, solid: Polygons, margin_m: float, p: FloatArray, q: FloatArray
    ) -> tuple[float, float] | None:
        """Depth and parameter where the line p-q is deepest in a zone; none where it stays out."""
        worst: tuple[float, float] | None = None
        for begin, end in _parts_inside(zone, solid, margin_m, p[:2], q[:2]):
            if self._is_over_or_under(zone.entry, p + begin * (q - p), p + end * (q - p)):
                continue
            depth, at = _deepest(zone, solid, margin_m, p, q, (begin, end))
            if worst is None or depth > worst[0]:
                worst = depth, at
        return worst

    def _is_over_or_under(self, entry: NoFly, p: FloatArray, q: FloatArray) -> bool:
        """Whether the line p-q is below all floors or above all ceilings; not where the ground is unknown."""
        low, _, high, _ = self.ground.leg_height_ranges_m(np.vstack([p, q]))[0]
        alts = (p[2], q[2]) if self.frame is None else self.frame.geodetic_from_enu(np.vstack([p, q]))[2]
        leeway = _HEIGHT_TOLERANCE_M + self.ground.cut_error_m - self.height_margin_m
        floors = [(entry.floor_agl_m, high), (entry.floor_amsl_m, max(alts))]
        ceilings = [(entry.ceiling_agl_m, low), (entry.ceiling_amsl_m, min(alts))]
        under = [highest <= floor + leeway for floor, highest in floors if floor is not None]
        over = [lowest >= ceiling - leeway for ceiling, lowest in ceilings if ceiling is not None]
        return bool((under and all(under)) or (over and all(over)))


@lru_cache(maxsize=1024)
def _solid(zone: Zone, margin_m: float) -> Polygons:
    """The grown outline without a hair of its edge, so that legs along the edge are outside."""
    solid = zone.grown(margin_m).buffer(-_TOUCHING_M, join_style="mitre")
    return solid if isinstance(solid, Polygons) else shapely.MultiPolygon()


def _parts_inside(
    zone: Zone, solid: Polygons, margin_m: float, p: FloatArray, q: FloatArray
) -> list[tuple[float, float]]:
    """Intervals 0..1 of the line p-q on the map inside a zone. Touching its edge is outside."""
    length = math.hypot(*(q - p))
    if zone.circle is not None:
        return _parts_in_circle((*zone.circle[:2], zone.circle[2] + margin_m), p, q, length)
    if length <= _TOUCHING_M:
        return [(0.0, 1.0)] if solid.contains(shapely.Point(p)) else []
    pieces = shapely.get_parts(shapely.LineString([p, q]).intersection(solid))
    found = []
    for piece in pieces:
        if isinstance(piece, shapely.LineString) and piece.length > 0.0:
            at = (shapely.get_coordinates(piece) - p) @ (q - p) / length**2
            found.append((max(0.0, float(at.min())), min(1.0, float(at.max()))))
    return found


def _parts_in_circle(
    circle: tuple[float, float, float], p: FloatArray, q: FloatArray, length: float
) -> list[tuple[float, float]]:
    east, north, radius = circle
    away = p - (east, north)
    if length <= _TOUCHING_M:
        return [(0.0, 1.0)] if math.hypot(*away) < radius - _TOUCHING_M else []
    towards = (q - p) / length
    nearest = -float(away @ towards)
    aside = abs(float(away[0] * towards[1] - away[1] * towards[0]))
    if aside >= radius - _TOUCHING_M:
        return []
    half = math.sqrt(radius * radius - aside * aside)
    begin, end = max(0.0, (nearest - half) / length), min(1.0, (nearest + half) / length)
    return [(begin, end)] if (end - begin) * length > _TOUCHING_M else []


def _deepest(
    zone: Zone, solid: Polygons, margin_m: float, p: FloatArray, q: FloatArray, part: tuple[float, float]
) -> tuple[float, float]:
    """Largest distance to the edge on a part of the line p-q, and its position. It is above 0, because the part is inside."""
    at = np.linspace(part[0], part[1], _SAMPLES + 1)
    places = p[:2] + at[:, None] * (q[:2] - p[:2])
    if zone.circle is not None:
        depths = zone.circle[2] + margin_m - np.hypot(*(places - zone.circle[:2]).T)
    else:
        depths = np.asarray(shapely.distance(solid.boundary, shapely.points(places)))
    worst = int(np.argmax(depths))
    return max(float(depths[worst]), _TOUCHING_M), float(at[worst])
