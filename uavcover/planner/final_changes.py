"""Final changes of a route: fewer waypoints, corners that keep the limits as flown, robust photos.

Remove waypoints that are not needed. Raise or lower a waypoint if its corner leaves the height band. Move a waypoint outwards
if the vehicle cuts its corner, and by centimetres if a distance-triggered photo may be missed.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.annealing import snapshot
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.route_state import RouteState
from uavcover.kernels.route_state_cost import merge, take_out
from uavcover.missions.leg_checks import (
    corner_excess_around_m,
    corner_excess_m,
    corner_heights_off_m,
    measure_violations,
)
from uavcover.model.route import Route
from uavcover.planner.search.route_problem import SAFETY, RouteProblem, route_problem, state_of, with_safety
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.flown_line import corners_flown, corners_matter, line_flown, photos_on
from uavcover.sensing.sensors import trigger_distance_m

_SPARE_FRACTIONS = (0.0, 0.001, 0.004, 0.016, 0.063, 0.25, 1.0)
"""Fraction of the spare coverage that one waypoint may cost, sweep by sweep. Waypoints that cost nothing go first."""

_ATTEMPTS = 5
"""Each keeps twice as much more coverage as the one before it lacked on the exact count, or on finer cells."""

_ROUNDING = 1e-12


def simplified(
    # the evaluation grid, and finer cells that must be observed as well
    judges: Sequence[CoverageMap],
    route: Route,  # keeps the limits
    *,
    required: float | None,  # required coverage of the visible ground, if any
    # whether the time is over: called between attempts and between sweeps. The first sweep is made all the same.
    is_over: Callable[[], bool] = lambda: False,
) -> Route | None:
    """A route without the waypoints that limits, cost and coverage do not need; None if it needs all.

    Coverage is counted exactly. Coverage beyond ``required`` may decrease, except for the margin that the search keeps. Without
    ``required``, or below it, coverage may not decrease.
    """
    before = [_observed(each, route) for each in judges]
    least = [least_coverage(observed, required, finer=number > 0) for number, observed in enumerate(before)]
    attempts = 0
    # What loses nothing on the judging cells may do so on finer ones, and is then counted there.
    for judge, had, wanted in zip(judges, before, least, strict=True):
        problem, slack = _problem(judge), had - wanted
        for _ in range(_ATTEMPTS):
            if attempts > 0 and is_over():
                return None
            attempts += 1
            state = state_of(problem, route, capacity=len(route))
            _sweep(problem, state, slack, is_over)
            simpler = certainly(judge.site, Route(snapshot(state)))
            if len(simpler) >= len(route):
                return None
            # Kernels count photos by distance as if every leg had them everywhere.
            lacks = max(needed - _observed(each, simpler) for each, needed in zip(judges, least, strict=True))
            if lacks <= _ROUNDING:
                return simpler
            if slack == 0.0:
                break
            slack = max(0.0, slack - 2.0 * lacks)
    return None


def _sweep(problem: RouteProblem, state: RouteState, slack: float, is_over: Callable[[], bool] = lambda: False) -> None:
    """Remove and merge waypoints until none can go or the time is over; lose no more coverage than ``slack``."""
    fewest = 1 if problem.numbers.limits.legs == 0 else 2
    least = float(state.observed[0]) - slack - _ROUNDING
    for fraction in _SPARE_FRACTIONS:
        take_out(problem.numbers, state, fewest, least, fraction * slack + _ROUNDING)
        if is_over():
            return
    for change in (take_out, merge):
        while change(problem.numbers, state, fewest, least, slack + _ROUNDING) > 0:
            if is_over():
                return


def _observed(judge: CoverageMap, route: Route) -> float:
    return judge.fraction_of_coverable(judge.observed(route.waypoints_m))


def least_coverage(observed: float, required: float | None, *, finer: bool) -> float:
    """Least coverage of a changed route, as a fraction of the visible ground.

    Args:
        observed: by the route as it is.
        required: required coverage, if any.
        finer: whether the cells are finer than the evaluation grid.
    """
    if finer:
        return required if required is not None and observed >= required else observed - SAFETY
    return min(observed, with_safety(required)) if required is not None and observed >= required else observed


def _problem(judging: CoverageMap) -> RouteProblem:
    limits = judging.site.scenario.limits
    middle_agl_m = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    reach_m = max(judging.site.scenario.sensor.half_width_m(middle_agl_m), judging.grid.cells.size_m)
    return route_problem(judging, margin_m=0.0, reach_m=reach_m)


_CUT_FRACTIONS = (1.0, 1.5, 2.0, 3.0, 0.5, -1.0, -2.0)
"""Fractions of the corner cut by which a waypoint moves.

First outward, so that the vehicle passes the original waypoint; at last inward, where the ground outside is worse.
"""

_LOWER = (1.0, 2.0, 4.0)
"""Multiples of a corner's excess above the height band by which its waypoint is lowered, tried in this order."""

_MORE, _SPARE_M = 1.2, 0.01
"""Factor and metres by which a waypoint moves more than its corner has to, which comes with it in part."""

_MOST_SWEEPS = 4
"""A waypoint that moves changes the corners beside it."""


def with_sound_corners(site: Site, route: Route) -> Route:
    """The route, or one whose corners exceed no limit or exceed them by less. Its legs exceed them no more.

    Args:
        site: the scenario on its ground.
        route: its legs keep the limits.
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
    """The (n, 3) points, with all corners that leave the height band moved into it at once.

    On slopes this costs almost no coverage, and it repairs most corners of a long route.
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
    """The (n, 3) points with one moved so that corners exceed limits least and legs no more than before."""
    begin = max(number - 1, 0)
    beside_m = points_m[begin : number + 2]
    positions_m = corners_flown(site, beside_m)
    if positions_m is None:
        return points_m
    outward_m = points_m[number] - positions_m[number - begin, positions_m.shape[1] // 2]
    best_m, least_m = points_m, corner_excess_around_m(site, points_m, number)
    broken = _broken(site, beside_m)
    off_m = corner_heights_off_m(site, points_m[max(number - 2, 0) : number + 3])[min(number, 2)]
    down_m = np.array([0.0, 0.0, -off_m])
    moves = [
        *(fraction * down_m for fraction in _LOWER if off_m != 0.0),
        *(fraction * outward_m for fraction in _CUT_FRACTIONS),
    ]
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


_MORE_M = 0.1
"""Extra move of a waypoint beyond that of the line, because its corner is cut."""

_MOST_TRIES = 40
"""Each moves one waypoint by a metre at most. A plan of 25 waypoints takes three; where they do not end, photos stay unsure."""


def certainly(site: Site, route: Route) -> Route:
    """The route, or the same route with sure photos if that keeps the limits equally well."""
    other = with_sure_photos(site, route)
    if other is None:
        return route
    margin_m = site.scenario.limits.height_margin_m
    before, after = (
        measure_violations(site, each.waypoints_m, margin_m=margin_m).total for each in (route, other)
    )  # fmt: skip
    return other if after <= before else route


def with_sure_photos(site: Site, route: Route) -> Route | None:
    """A route with the same photos, all of them sure; None if they already are, or cannot be.

    A waypoint keeps its height above ground. The caller checks limits and coverage.
    """
    points = np.array(route.waypoints_m)
    for tries in range(_MOST_TRIES):
        unsure = next(unsure_photos(site, points), None)
        if unsure is None:
            return Route(points, route.begins) if tries > 0 else None
        # The nearest waypoint is that of the corner, or the end.
        nearest = int(np.argmin(np.linalg.norm(points - unsure.turning_m, axis=1)))
        wanted_m = math.copysign(LEAST_SPARE_M + _MORE_M, unsure.spare_m)
        height_agl_m = site.ground.heights_agl_m(points[nearest])
        points[nearest, :2] += (wanted_m - unsure.spare_m) * unsure.away
        points[nearest, 2] = site.ground.ups_m(points[nearest, :2], height_agl_m)[0]
    return None


# Photos by distance that are taken or not by less than a vehicle keeps to its line.
#
# Where a line turns back just where the next photo is due, a few centimetres decide. If that photo is missing, all later ones
# come later by as much as their distance, and observe other ground than was planned.

LEAST_SPARE_M = 0.5
"""Below this spare a photo is unsure: in flights of the mock vehicle photos were up to 0.42 m from their planned positions."""


@dataclass(frozen=True, slots=True, eq=False)
class UnsurePhoto:
    """A photo that is unsure."""

    turning_m: FloatArray  # (3,) ENU place where the line turns back to the last photo, or ends
    away: FloatArray  # (2,) unit vector to it from there, east and north
    # by how much it is farther away than the distance between two photos; less than 0: the photo is not taken
    spare_m: float


def unsure_photos(site: Site, route_m: FloatArray) -> Iterator[UnsurePhoto]:
    """Unsure photos along an (n, 3) ENU route as flown, in their order; nothing if corners are flown exactly."""
    trigger_m = trigger_distance_m(site.scenario)
    if trigger_m is None or not corners_matter(site) or len(route_m) < 2:
        return
    line_m = line_flown(site, route_m).positions_m
    legs, positions_m = photos_on(line_m, trigger_m)
    for number, (leg, position_m) in enumerate(zip(legs, positions_m, strict=True)):
        is_last = number + 1 == len(legs)
        due = len(line_m) if is_last else int(legs[number + 1]) + 1
        # Between most photos the line is straight.
        turns = due - leg > 2
        missed = _turned_back(line_m[leg + 1 : due], position_m, least_m=trigger_m - LEAST_SPARE_M) if turns else None
        if missed is not None:
            yield _unsure(missed, position_m, trigger_m)
        if not is_last:
            taken = _barely_passed(positions_m[number + 1], line_m, due, position_m, trigger_m)
            if taken is not None:
                yield _unsure(taken, position_m, trigger_m)


def _unsure(turning_m: FloatArray, from_m: FloatArray, trigger_m: float) -> UnsurePhoto:
    away = turning_m[:2] - from_m[:2]
    reach_m = float(np.hypot(*away))
    return UnsurePhoto(turning_m, away / reach_m, reach_m - trigger_m)


def _turned_back(points_m: FloatArray, from_m: FloatArray, *, least_m: float) -> FloatArray | None:
    """The first of (k, 3) points with this distance from a point and a nearer one after it: a line is farthest at its points."""
    reach_m = np.hypot(points_m[:, 0] - from_m[0], points_m[:, 1] - from_m[1])
    turns = np.flatnonzero((reach_m[:-1] >= least_m) & (reach_m[1:] < reach_m[:-1]))
    return None if turns.size == 0 else points_m[turns[0]]


def _barely_passed(
    photo_m: FloatArray, line_m: FloatArray, first: int, from_m: FloatArray, trigger_m: float
) -> FloatArray | None:
    """Farthest point of a line from its last photo, if it ends or turns back within the tolerance of the next one."""
    farthest_m, most_m = photo_m, trigger_m
    for point_m in line_m[first:]:
        reach_m = math.hypot(point_m[0] - from_m[0], point_m[1] - from_m[1])
        if reach_m >= trigger_m + LEAST_SPARE_M:
            return None
        if reach_m < trigger_m:
            break
        if reach_m > most_m:
            farthest_m, most_m = point_m, reach_m
    return farthest_m
