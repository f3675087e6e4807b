"""Parts of a route: whoever cannot fly all of it flies the stretch that sees most for its way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.route import Route

FloatArray = NDArray[np.float64]

SHARES = tuple(k / 25 for k in range(1, 25))
"""What the parts see at least, as shares of what the whole route sees."""

_SAME_PLACE_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """A route of n waypoints, and what each of its legs adds.

    Attributes:
        route: its waypoints.
        way_m: (n,) length of the path up to each waypoint.
        seen: (n,) share of the area's ground that is seen up to each waypoint, 0..1.
    """

    route: Route
    way_m: FloatArray
    seen: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A stretch of a route.

    Attributes:
        route: its waypoints.
        seen: share of the area's ground that it sees: at least this much, because what the route has seen before the
            stretch begins is not looked at again.
    """

    route: Route
    seen: float


def gains_of(coverage: CoverageMap, route: Route) -> Gains:
    """What each leg of a route is the first to see, on the cells of ``coverage``; a single waypoint sees by itself."""
    way_m = _way_m(route.waypoints_m)
    if len(route) == 1:
        return Gains(route, way_m, np.array([coverage.share(coverage.seen(route.waypoints_m))]))
    looks = coverage.looks(route.waypoints_m)
    first = coverage.first_seen(looks)
    at_m = _way_m(looks.places_m)
    # A look between two legs is the first one's; the second look from the same place, of a camera that turns, the other's.
    again = np.concatenate([[False], np.diff(at_m) == 0.0])
    leg = np.searchsorted(way_m, np.where(again, at_m + _SAME_PLACE_M, at_m - _SAME_PLACE_M)) - 1
    leg = np.clip(leg, 0, len(way_m) - 2)
    seen = first >= 0
    weight_m2 = coverage.grid.weight_m2
    gained = np.bincount(leg[first[seen]], weights=weight_m2[seen], minlength=len(way_m) - 1)
    return Gains(route, way_m, np.concatenate([[0.0], np.cumsum(gained)]) / float(weight_m2.sum()))


def parts_of(gains: Gains, *, shares: Sequence[float] = SHARES) -> list[Part]:
    """For each share of what a route sees, the shortest stretch of whole legs that is known to see so much.

    Every stretch keeps the limits that the route keeps. One that is the shortest for two shares is told once, the whole
    route never.

    Args:
        gains: of the route.
        shares: 0..1.
    """
    points, way_m, seen = gains.route.waypoints_m, gains.way_m, gains.seen
    if len(points) < 3:
        return []
    first = np.arange(len(points) - 1)
    found: dict[tuple[int, int], Part] = {}
    for share in shares:
        # From each waypoint to the first one behind it that has seen enough; past the end where none has.
        last = np.maximum(np.searchsorted(seen, seen[first] + share * seen[-1] * (1.0 - 1e-12)), first + 1)
        lengths = np.where(last < len(points), way_m[np.minimum(last, len(points) - 1)] - way_m[first], np.inf)
        best = int(np.argmin(lengths))
        ends = best, int(last[best])
        if ends != (0, len(points) - 1):
            found[ends] = Part(Route(points[ends[0] : ends[1] + 1]), float(seen[ends[1]] - seen[ends[0]]))
    return list(found.values())


def _way_m(points: FloatArray) -> FloatArray:
    """(n,) length of the path through (n, 3) points up to each of them."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
