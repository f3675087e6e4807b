"""Routes whose corners keep the limits as they are flown.

A waypoint lies as much lower or higher as its corner leaves the band of heights, or moves outward by as much as it is passed
inside of it.
"""

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.leg_checks import (
    corner_excess_around_m,
    corner_excess_m,
    corner_heights_off_m,
    measure_violations,
)
from uavcover.model.route import Route
from uavcover.scenario.site import Site
from uavcover.sensing.flown_line import corners_flown

_SHARES = (1.0, 1.5, 2.0, 3.0, 0.5, -1.0, -2.0)
"""Shares of the corner cut by which a waypoint moves.

First outward, so that the vehicle passes the original waypoint; at last inward, where the ground outside is worse.
"""

_LOWER = (1.0, 2.0, 4.0)
"""Multiples of a corner's excess above the height band by which its waypoint is lowered, tried in this order."""

_MORE, _SPARE_M = 1.2, 0.01
"""Factor and metres by which a waypoint moves more than its corner has to, which comes with it in part."""

_MOST_SWEEPS = 4
"""A waypoint that moves changes the corners beside it."""


def with_sound_corners(site: Site, route: Route) -> Route:
    """The route, or one whose corners break no limit or break them by less.

    Its legs break them by no more.

    Args:
        site: the scenario on its ground.
        route: keeps the limits in its legs.
    """
    points = np.array(route.waypoints_m)
    excess_m = corner_excess_m(site, points)
    before = excess_m.sum()
    if before <= 0.0:
        return route
    points = _into_band(site, points)
    excess_m = corner_excess_m(site, points)
    for _ in range(_MOST_SWEEPS):
        for k in np.flatnonzero(excess_m > 0.0):
            points = _moved(site, points, int(k))
        excess_m = corner_excess_m(site, points)
        if excess_m.sum() <= 0.0:
            break
    return Route(points, route.begins) if excess_m.sum() < before else route


def _into_band(site: Site, points_m: FloatArray) -> FloatArray:
    """The (n, 3) points, those at corners that leave the height band as much lower or higher, all at once.

    Over slopes that costs next to no coverage, and on a long route most corners are mended by it.
    """
    broken, least_m = _broken(site, points_m), float(corner_excess_m(site, points_m).sum())
    for _ in range(_MOST_SWEEPS):
        moved_m = points_m.copy()
        off_m = corner_heights_off_m(site, points_m)
        moved_m[:, 2] -= _MORE * off_m + np.copysign(_SPARE_M, off_m) * (off_m != 0.0)
        excess_m = float(corner_excess_m(site, moved_m).sum())
        if excess_m >= least_m or _broken(site, moved_m) > broken:
            break
        points_m, least_m = moved_m, excess_m
    return points_m


def _moved(site: Site, points_m: FloatArray, number: int) -> FloatArray:
    """The (n, 3) points with one moved, so that the corners break limits by the least, the legs by no more."""
    begin = max(number - 1, 0)
    beside_m = points_m[begin : number + 2]
    places_m = corners_flown(site, beside_m)
    if places_m is None:
        return points_m
    outward_m = points_m[number] - places_m[number - begin, places_m.shape[1] // 2]
    best_m, least_m = points_m, corner_excess_around_m(site, points_m, number)
    broken = _broken(site, beside_m)
    off_m = corner_heights_off_m(site, points_m[max(number - 2, 0) : number + 3])[min(number, 2)]
    down_m = np.array([0.0, 0.0, -off_m])
    moves = [*(share * down_m for share in _LOWER if off_m != 0.0), *(share * outward_m for share in _SHARES)]
    for move_m in moves:
        moved_m = points_m.copy()
        moved_m[number] += move_m
        excess_m = corner_excess_around_m(site, moved_m, number)
        if excess_m < least_m and _broken(site, moved_m[begin : number + 2]) <= broken:
            best_m, least_m = moved_m, excess_m
            if excess_m <= 0.0:
                break
    return best_m


def _broken(site: Site, points_m: FloatArray) -> float:
    return measure_violations(site, points_m, margin_m=site.scenario.limits.height_margin_m).total
