"""Shortest paths on the map between two positions inside a polygon with holes, around no-fly zones and bays."""

import numpy as np
import shapely
from shapely.ops import nearest_points

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.obstacle_breach import parts_over
from uavcover.kernels.obstacles import NO_OBSTACLES, ObstaclePrisms, make_obstacles
from uavcover.kernels.shortest_way import are_clear, shortest_way
from uavcover.scenario.airspace.zones import Polygons, footprints_of

_INSIDE_M = 0.02
"""Corners of ways lie this far inside, so that rounding does not take them out."""
_MOST_CORNERS = 48
"""A wall with more corners is divided: every line that comes near asks all corners of it."""


class WayRound:
    """Ways inside a region. Corners of shortest ways are corners of the region that stick into it."""

    def __init__(self, region: Polygons) -> None:
        self.region = region
        self._inner = region.buffer(-_INSIDE_M, join_style="mitre")
        self._corners = _corners_that_stick_in(self._inner)
        self._walls, self._free = _walls_around(region), footprints_of([self._inner])
        # A prepared polygon builds its index on first use, which is not thread-safe: use it now.
        shapely.prepare(self._inner)
        shapely.covers(self._inner, shapely.centroid(region))

    def inside(self, place_m: FloatArray) -> FloatArray:
        """A (2,) place, or the nearest one inside."""
        point = shapely.Point(place_m)
        if self._inner.is_empty or self._inner.covers(point):
            return place_m
        return np.asarray(nearest_points(self._inner, point)[0].coords[0])

    @property
    def corners_m(self) -> FloatArray:
        """(k, 2) corners of ways."""
        return self._corners[:, :2]

    def are_straight(self, ends_m: FloatArray) -> BoolArray:
        """(n,) whether each of (n, 2, 2) straight lines is inside."""
        lines = np.ascontiguousarray(ends_m, dtype=float).reshape(-1, 4)
        return are_clear(self._walls, lines) & (not self.region.is_empty)

    def is_straight(self, a_m: FloatArray, b_m: FloatArray) -> bool:
        """Whether the straight line between two places is inside."""
        return bool(self.are_straight(np.array([[a_m, b_m]]))[0])

    def between(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of the shortest way from one place to another, both included; none where there is no way.

        Both places have to be inside.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        a, b = ((float(place[0]), float(place[1])) for place in (a_m, b_m))
        numbers = shortest_way(self._walls, self._corners, a, b)
        return np.array([a_m, *self._corners[numbers, :2], b_m]) if numbers.size else None

    def along(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of a path that follows the straight line wherever that is inside, and is shortest in between.

        A flight line is to see the ground beside it: the shortest way around what is in its middle would leave it at its end.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        line = np.array([[*a_m, *b_m]], dtype=float)
        step_m = line[0, 2:] - line[0, :2]
        _, shares = parts_over(self._free, np.zeros(1, dtype=np.int64), line)
        kept = (shares[:, 1] - shares[:, 0]) * np.hypot(*step_m) > _INSIDE_M
        ends_m = line[0, :2] + shares[kept].reshape(-1, 1) * step_m
        ends_m[shares[kept].ravel() == 1.0] = b_m
        way = [np.asarray(a_m, dtype=float)]
        for place in [*ends_m, np.asarray(b_m, dtype=float)]:
            if np.hypot(*(place - way[-1])) <= _INSIDE_M:
                continue
            part = self.between(way[-1], place)
            if part is None:
                return self.between(a_m, b_m)
            way += list(part[1:])
        return np.array(way)


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
