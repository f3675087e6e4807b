"""Shortest paths on the map between two positions inside a polygon with holes, around no-fly zones and bays."""

import heapq
import math
import threading
from typing import Any

import numpy as np
import shapely
from shapely.ops import nearest_points

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.scenario.airspace.zones import Polygons

_INSIDE_M = 0.02
"""Corners of ways lie this far inside, so that rounding does not take them out."""
_HAIR_M = 1e-7


class WayRound:
    """Ways inside a region. Corners of shortest ways are corners of the region that stick into it.

    Args:
        region: where ways may be.
    """

    def __init__(self, region: Polygons) -> None:
        self.region = region
        self._inner = region.buffer(-_INSIDE_M, join_style="mitre")
        self._nodes = _corners_that_stick_in(self._inner)
        self._seen: dict[int, BoolArray] = {}
        # A prepared polygon builds its index on first use: not thread-safe.
        self._prepared = region.buffer(_HAIR_M)
        self._lock = threading.Lock()
        shapely.prepare(self._prepared)

    def inside(self, place_m: FloatArray) -> FloatArray:
        """A (2,) place, or the nearest one inside."""
        point = shapely.Point(place_m)
        if self._inner.is_empty or self._inner.covers(point):
            return place_m
        return np.asarray(nearest_points(self._inner, point)[0].coords[0])

    def is_straight(self, a_m: FloatArray, b_m: FloatArray) -> bool:
        """Whether the straight line between two places is inside."""
        return bool(self._visible(a_m, b_m[None])[0])

    def between(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of the shortest way from one place to another, both included; none where there is no way.

        Both places have to be inside.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        if len(self._nodes) == 0:
            return None
        last = self._visible(b_m, self._nodes)
        to_goal = np.hypot(*(self._nodes - b_m).T)
        # A*: from the start to the corners, and from those that see the goal to it.
        length = np.full(len(self._nodes), math.inf)
        before = np.full(len(self._nodes), -1)
        first = self._visible(a_m, self._nodes)
        length[first] = np.hypot(*(self._nodes[first] - a_m).T)
        queue = [(float(length[k] + to_goal[k]), int(k)) for k in np.flatnonzero(first)]
        heapq.heapify(queue)
        done = np.zeros(len(self._nodes), dtype=bool)
        while queue:
            _, k = heapq.heappop(queue)
            if done[k]:
                continue
            done[k] = True
            if last[k]:
                return self._way(a_m, b_m, before, k)
            self._expand(k, length, before, to_goal, done, queue)
        return None

    def along(self, a_m: FloatArray, b_m: FloatArray) -> FloatArray | None:
        """(k, 2) corners of a path that follows the straight line wherever that is inside, and is shortest in between.

        A flight line is to see the ground beside it: the shortest way around what is in its middle would leave it at its end.
        """
        if self.is_straight(a_m, b_m):
            return np.array([a_m, b_m])
        line = shapely.LineString([a_m, b_m])
        pieces = [piece for piece in shapely.get_parts(line.intersection(self._inner)) if piece.length > _INSIDE_M]
        starts = sorted((line.project(shapely.Point(piece.coords[0])), piece) for piece in pieces if piece.length > 0.0)
        ends_m = [np.asarray(place) for _, piece in starts for place in (piece.coords[0], piece.coords[-1])]
        way = [np.asarray(a_m, dtype=float)]
        for place in [*ends_m, np.asarray(b_m, dtype=float)]:
            if np.hypot(*(place - way[-1])) <= _INSIDE_M:
                continue
            part = self.between(way[-1], place)
            if part is None:
                return self.between(a_m, b_m)
            way += list(part[1:])
        return np.array(way)

    def _expand(
        self,
        k: int,
        length: FloatArray,
        before: Any,
        to_goal: FloatArray,
        done: BoolArray,
        queue: list[tuple[float, int]],
    ) -> None:
        if k not in self._seen:
            self._seen[k] = self._visible(self._nodes[k], self._nodes)
        through = length[k] + np.hypot(*(self._nodes - self._nodes[k]).T)
        for other in np.flatnonzero(self._seen[k] & ~done & (through < length)):
            length[other], before[other] = through[other], k
            heapq.heappush(queue, (float(through[other] + to_goal[other]), int(other)))

    def _way(self, a_m: FloatArray, b_m: FloatArray, before: Any, k: int) -> FloatArray:
        way = [b_m]
        while k >= 0:
            way.append(self._nodes[k])
            k = int(before[k])
        return np.array([*way, a_m])[::-1]

    def _visible(self, from_m: FloatArray, to_m: FloatArray) -> BoolArray:
        """(k,) whether the straight lines from a place to (k, 2) others are inside."""
        ends = np.stack([np.broadcast_to(from_m, to_m.shape), to_m], axis=1)
        with self._lock:
            seen = shapely.covers(self._prepared, shapely.linestrings(ends))
        return np.asarray(seen, dtype=bool)


def _corners_that_stick_in(region: shapely.Geometry) -> FloatArray:
    """(k, 2) corners at which the region is wider than half a turn."""
    found = [np.empty((0, 2))]
    for part in shapely.get_parts(region):
        oriented = shapely.orient_polygons(part)
        for ring in (oriented.exterior, *oriented.interiors):
            corners = shapely.get_coordinates(ring)[:-1]
            onto, off = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
            # The region is to the left of its rings: a turn to the right sticks in.
            found.append(corners[onto[:, 0] * off[:, 1] - onto[:, 1] * off[:, 0] < 0.0])
    return np.vstack(found)
