"""Viewpoints put into a route, each where it costs least, until the route sees enough.

For sensors that look from waypoints alone: a waypoint more takes nothing from what the others see. Behind the route, where gaps
are closed otherwise (:mod:`uavcover.planning.search.closing`), a viewpoint may be a steep way off.
"""

import math
from collections.abc import Callable

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.route import Route
from uavcover.planning.set_cover.candidates import seen_from_each
from uavcover.planning.viewpoints import MissingCells, few_enough, grid_places, places_around
from uavcover.routes.leg_checks import measure_violations
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import whatever_heading

_MOST_INSERTED = 40
_MOST_TRIED = 200
"""So many viewpoints are put in, and so many are tried for each, the best for their detour first."""

_LEGS_TRIED = 4
"""Of the legs with the shortest detours."""

_LEAST_DETOUR_M = 5.0


def with_viewpoints(coverage: CoverageMap, route: Route, goal: float, is_over: Callable[[], bool]) -> Route | None:
    """The route with viewpoints put in until it sees enough.

    Args:
        coverage: the cells it is judged on; its sensor looks from waypoints alone.
        route: keeps the limits.
        goal: share of what can be covered.
        is_over: whether there is no time left for it: asked before each viewpoint.

    Returns:
        None where it sees enough already, and where no viewpoints that keep the limits make it see enough.
    """
    site, points = coverage.site, route.waypoints_m
    seen = coverage.seen(points)
    if coverage.share_of_coverable(seen) >= goal:
        return None
    for _ in range(_MOST_INSERTED):
        found = None if is_over() else _one_more(site, coverage, points, seen, goal)
        if found is None:
            return None
        before, points = np.count_nonzero(seen), found
        seen = coverage.seen(points)
        if coverage.share_of_coverable(seen) >= goal:
            return Route(points, route.begins)
        if np.count_nonzero(seen) <= before:
            return None
    return None


def _one_more(
    site: Site, coverage: CoverageMap, points_m: FloatArray, seen: BoolArray, goal: float
) -> FloatArray | None:
    """The (n, 3) points and one viewpoint that sees much for its detour; none where none keeps the limits."""
    unseen = coverage.coverable & ~seen
    if not unseen.any():
        return None
    missing = MissingCells.of(coverage, unseen)
    places = np.vstack([
        grid_places(site, missing), places_around(site, few_enough(missing.cells.centre_m))
    ])  # fmt: skip
    eyes_m = np.column_stack([places[:, :2], site.ground.ups_m(places[:, :2], places[:, 2])])
    eyes_m = eyes_m[np.isfinite(eyes_m[:, 2])]
    start, cells = seen_from_each(coverage, eyes_m, missing.numbers, whatever_heading(coverage.sight))
    gained_m2 = np.zeros(len(eyes_m))
    np.add.at(gained_m2, np.repeat(np.arange(len(eyes_m)), np.diff(start)), coverage.grid.weight_m2[cells])
    whole_m2 = float(coverage.grid.weight_m2[coverage.coverable].sum())
    lacking_m2 = (goal - coverage.share_of_coverable(seen)) * whole_m2
    detours_m = _detours_m(site, points_m, eyes_m)
    worth = np.minimum(gained_m2, lacking_m2) / np.maximum(detours_m.min(axis=1), _LEAST_DETOUR_M)
    margin_m = site.scenario.limits.height_margin_m
    for k in np.argsort(-worth, kind="stable")[:_MOST_TRIED]:
        if worth[k] <= 0.0:
            return None
        for leg in np.argsort(detours_m[k], kind="stable")[:_LEGS_TRIED]:
            around = np.vstack([points_m[max(leg - 1, 0) : leg], eyes_m[k], points_m[leg : leg + 1]])
            if np.isfinite(detours_m[k, leg]) and measure_violations(site, around, margin_m=margin_m).total <= 0.0:
                return np.insert(points_m, leg, eyes_m[k], axis=0)
    return None


def _detours_m(site: Site, points_m: FloatArray, places_m: FloatArray) -> FloatArray:
    """(k, n + 1) by how much longer (n, 3) points are with each of (k, 3) places first, between two of them, and last.

    Infinite where a leg would be too steep.
    """
    ways_m = places_m[:, None] - points_m[None]
    away_m = np.linalg.norm(ways_m, axis=2)
    steepest = math.tan(math.radians(site.scenario.limits.max_climb_angle_deg))
    away_m[np.abs(ways_m[..., 2]) > steepest * np.hypot(ways_m[..., 0], ways_m[..., 1])] = math.inf
    first_m, last_m = away_m[:, 0], away_m[:, -1]
    if site.home_m is not None:
        from_home_m = np.linalg.norm(places_m - site.home_m, axis=1)
        first_m = first_m + from_home_m - np.linalg.norm(points_m[0] - site.home_m)
        last_m = last_m + from_home_m - np.linalg.norm(points_m[-1] - site.home_m)
    between_m = away_m[:, :-1] + away_m[:, 1:] - np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    return np.column_stack([first_m, between_m, last_m])
