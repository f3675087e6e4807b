"""Routes that keep the limits, made from routes that break them.

Lines over ground that rises faster than a leg may climb break the climb limit or leave the height band. Their stretches that keep
both are joined here by ways over a lattice of places inside the height band: such a way follows a contour, or climbs in zigzags.
The local search begins with these routes where it is given no other.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy
import shapely
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.search_problem import SearchProblem, allowed_legs
from uavcover.model.route import Route
from uavcover.planner.terrain_following import allowed_band_m
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site

_SPOTS = 1600
"""Spots of the lattice on the map; at each there are three places, close to both ends of the height band and between."""

_SHARES = (0.02, 0.5, 0.98)
_LINKS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1), (1, 3), (3, 1), (1, -3), (3, -1))
"""Spots that a spot is linked with, and their opposites: some link is within 9 degrees of any contour."""

_NEAR = 8
"""Spots that an end of a stretch is linked with."""


def mended_routes(
    site: Site, problem: SearchProblem, routes: Sequence[Route], is_over: Callable[[], bool] = lambda: False
) -> Iterator[Route]:
    """Of each route the stretches that keep the limits, joined; nothing for a route without any.

    Args:
        site: the scenario on its ground; its limits apply to legs.
        problem: with these limits.
        routes: in the order in which they are mended.
        is_over: whether there is no time left; the first route is always mended.
    """
    if flyable_area(site).polygon.is_empty:
        return
    lattice = _Lattice(site, problem)
    for number, route in enumerate(routes):
        if number > 0 and is_over():
            return
        stretches = _stretches(problem, route.waypoints_m)
        if stretches:
            yield Route(lattice.joined(stretches))


def _stretches(problem: SearchProblem, points_m: FloatArray) -> list[FloatArray]:
    """The longest rows of (k, 3) waypoints, k >= 2, of an (n, 3) route whose legs keep the limits."""
    kept = np.concatenate([[False], _allowed(problem, points_m[:-1], points_m[1:]), [False]])
    begins, ends = np.flatnonzero(~kept[:-1] & kept[1:]), np.flatnonzero(kept[:-1] & ~kept[1:])
    return [points_m[begin : end + 1] for begin, end in zip(begins, ends, strict=True)]


def _allowed(problem: SearchProblem, begins_m: FloatArray, ends_m: FloatArray) -> BoolArray:
    """(n,) whether the legs between (n, 3) places may be flown."""
    return np.asarray(allowed_legs(problem, np.ascontiguousarray(np.hstack([begins_m, ends_m]))))


class _Lattice:
    """Places inside the height band, with the legs between them that keep the limits."""

    def __init__(self, site: Site, problem: SearchProblem) -> None:
        self._problem = problem
        polygon = flyable_area(site).polygon
        west, south, east, north = polygon.bounds
        self._step_m = max(math.sqrt((east - west) * (north - south) / _SPOTS), 1e-3)
        columns, rows = (max(1, math.floor(side / self._step_m)) + 1 for side in (east - west, north - south))
        grid = np.meshgrid(west + self._step_m * np.arange(columns), south + self._step_m * np.arange(rows))
        spots_m = np.column_stack([axis.ravel() for axis in grid])
        low, high = allowed_band_m(site, spots_m)
        open_to = (low <= high) & shapely.contains_xy(polygon, spots_m[:, 0], spots_m[:, 1])
        number = np.where(open_to, np.cumsum(open_to) - 1, -1).reshape(rows, columns)
        ups_m = low[:, None] + np.array(_SHARES) * (high - low)[:, None]
        levels = len(_SHARES)
        self._places_m = np.column_stack([np.repeat(spots_m[open_to], levels, axis=0), ups_m[open_to].ravel()])
        pairs: list[NDArray[np.int64]] = []
        for right, up in _LINKS:
            right_of, left_of = (number[:, max(0, sign * right) : columns + min(0, sign * right)] for sign in (1, -1))
            a = left_of[max(0, -up) : rows - max(0, up)].ravel()
            b = right_of[max(0, up) : rows + min(0, up)].ravel()
            both = (a >= 0) & (b >= 0)
            pairs += [
                levels * np.column_stack([a[both], b[both]]) + np.array([i, j])
                for i, j in itertools.product(range(levels), repeat=2)
            ]
        self._links = self._flyable(self._places_m, np.vstack(pairs))

    def _flyable(self, places_m: FloatArray, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """The (k, 2) pairs of (n, 3) places with a leg that keeps the limits."""
        a, b = places_m[pairs[:, 0]], places_m[pairs[:, 1]]
        return pairs[_allowed(self._problem, a, b)]

    def joined(self, stretches: Sequence[FloatArray]) -> FloatArray:
        """(n, 3) stretches in their order, each (k, 3), joined by the shortest ways over the lattice.

        Where no way leads from some stretches to others, those that are the longest together.
        """
        ends_m = np.vstack([stretch[[0, -1]] for stretch in stretches])
        first = len(self._places_m)
        places_m = np.vstack([self._places_m, ends_m])
        away = np.linalg.norm(self._places_m[None, :, :2] - ends_m[:, None, :2], axis=2)
        near = np.argsort(away, axis=1, kind="stable")[:, : _NEAR * len(_SHARES)]
        own = first + np.arange(len(ends_m))
        to_ends = np.column_stack([near.ravel(), np.repeat(own, near.shape[1])])
        next_to = np.column_stack([own[1:-1:2], own[2::2]])
        links = np.vstack([self._links, self._flyable(places_m, np.vstack([to_ends, next_to]))])
        length = np.linalg.norm(places_m[links[:, 0]] - places_m[links[:, 1]], axis=1)
        stays = own.reshape(-1, 2)
        whole = np.array([np.linalg.norm(np.diff(stretch, axis=0), axis=1).sum() for stretch in stretches])
        both, lengths = np.vstack([links, stays]), np.concatenate([length, whole])
        graph = scipy.sparse.csr_matrix((lengths, (both[:, 0], both[:, 1])), shape=(len(places_m), len(places_m)))
        _, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
        parts = part[stays[:, 0]]
        kept = np.flatnonzero(parts == np.argmax(np.bincount(parts, weights=whole))).tolist()
        out = [stretches[kept[0]]]
        _, before = scipy.sparse.csgraph.dijkstra(
            graph, directed=False, indices=stays[kept[:-1], 1], return_predecessors=True
        )
        for row, (last, k) in enumerate(itertools.pairwise(kept)):
            way = [int(stays[k, 0])]
            while way[-1] != stays[last, 1]:
                way.append(int(before[row, way[-1]]))
            between = [places_m[way[-1:]]]
            for a, b in itertools.pairwise(way[::-1]):
                if min(a, b) >= first and (a - first) // 2 == (b - first) // 2:
                    # Another stretch is the way.
                    between.append(stretches[(a - first) // 2][1:-1][:: 1 if a < b else -1])
                between.append(places_m[[b]])
            out += [self._with_few_corners(np.vstack(between))[1:-1], stretches[k]]
        return np.vstack(out)

    def _with_few_corners(self, way_m: FloatArray) -> FloatArray:
        """An (n, 3) way with the longest legs from each place that keep the limits."""
        kept = [0]
        while kept[-1] < len(way_m) - 1:
            rest = way_m[kept[-1] + 1 :]
            reached = np.flatnonzero(_allowed(self._problem, np.broadcast_to(way_m[kept[-1]], rest.shape), rest))
            kept.append(kept[-1] + 1 + (int(reached[-1]) if len(reached) else 0))
        return way_m[kept]
