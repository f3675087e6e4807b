"""Close the gaps of a search's routes.

If a search ends short of its goal, :mod:`uavcover.planner.gap_route` plans a route for enough of the missing ground. It is
appended to one of the search's routes, and the search continues from there.
"""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner.final_changes import certainly
from uavcover.planner.gap_route import MissingCells, few_enough, grid_positions, plan_gap_route, positions_around
from uavcover.planner.search.local_search import SearchStart, Work
from uavcover.planner.search.route_problem import RouteJudge, RouteProblem, fraction_observed, route_problem
from uavcover.planner.set_cover import observed_from_each
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, joined, joined_over, lay_over_terrain, route_lattice
from uavcover.scenario.airspace.lattice import Lattice
from uavcover.scenario.site import Site, once
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import any_heading
from uavcover.sensing.site_maps import planning_map

_MOST_MISSING = 10_000
"""Cells; closing the gaps of more takes seconds."""

_NEARLY_CLOSED = 0.1
"""At this fraction of the missing ground, the rest is repaired after the main repair."""

_CLOSE_SAMPLES_M = 1.0
"""Sample spacing over the ground, for joined routes that exceed a limit."""


def repaired_end(
    work: Work,  # the problem and the remaining budget
    found: Sequence[SearchStart],  # what the stages of the search ended with
    goal: float,  # fraction of the visible ground
    judge: RouteJudge,  # judges the ends, and closes their gaps
    *,
    until: float,  # fraction of all the work, 0..1, after which no more are tried
    least_short: int = 0,  # number of ends with the least shortfall that are always tried
) -> SearchStart | None:
    """Repair the end of a search that misses its goal, with the work that is left for it.

    If nearly full coverage is required, gaps are expensive. Then the ends of all stages are tried, and the cheapest wins.

    Returns:
        None if an end reaches the goal at no higher cost, or no gaps could be closed.
    """

    def is_over() -> bool:
        return work.pace.fraction >= until

    if not found or work.stopped or is_over():
        return None
    tuned, cost = work.tuning.goal, work.problem.cost
    nearly = goal > tuned.nearly_all
    ends = found if nearly or least_short else found[-1:]
    short = {each: goal - judge.coverage(each.route, goal) for each in ends}
    if not nearly:
        near = sorted(short, key=short.__getitem__)[:least_short]
        short = {each: short[each] for each in dict.fromkeys([*near, found[-1]])}
    if min(short.values()) <= 0.0 and not nearly:
        return None
    best, least = None, min((cost(each.route) for each, lacking in short.items() if lacking <= 0.0), default=math.inf)
    for each, lacking in sorted(short.items(), key=lambda item: item[1]):
        if is_over():
            break
        if not 0.0 < lacking <= tuned.most_short or cost(each.route) >= least:
            continue
        closed = judge.closed(each.route, goal, is_over)
        if closed is not None and cost(closed) < least:
            best, least = SearchStart(closed, each.observed + lacking), cost(closed)
    return best


def repaired_start(
    work: Work,  # the problem and the remaining budget
    starts: Sequence[SearchStart],  # the beginnings of the search
    found: Sequence[SearchStart],  # what its stages ended with
    goal: float,  # fraction of the visible ground
    judge: RouteJudge,  # judges beginnings, and closes their gaps
    *,
    until: float,  # fraction of all the work, 0..1, after which no more are tried, ..
    # ... and the same while none is closed: a search that is far from its goal rarely reaches it otherwise.
    at_last: float,
) -> SearchStart | None:
    """An initial solution with enough coverage, or the cheapest of those with the most coverage, with its gaps closed.

    If the last part of the ground is expensive, such as the walls of a canyon, a search from a short route loses its coverage.
    Long lines are then the better initial solution.

    Returns:
        None if the search ended near its goal, or no gaps could be closed.
    """
    ends: list[SearchStart] = []

    def is_over() -> bool:
        return work.pace.fraction >= (until if ends else at_last)

    if not found or work.stopped or is_over() or work.problem.free_order:
        return None
    tuned, before = work.tuning.goal, judge.coverage(found[-1].route, goal)
    if goal - before <= tuned.most_short:
        return None
    different = {each.route.length_m: each for each in starts}.values()
    most = sorted(different, key=lambda each: -each.observed)[: tuned.most_starts]
    # First those that may reach the goal themselves, the cheapest first.
    cheapest = sorted(
        (each for each in different if each.observed >= goal), key=lambda each: work.problem.cost(each.route)
    )
    judged: list[tuple[float, SearchStart]] = []
    for each in dict.fromkeys([*cheapest[: tuned.most_starts], *most]):
        if is_over():
            return None
        judged.append((judge.coverage(each.route, goal), each))
        if judged[-1][0] >= goal:
            return each
    judged = [one for one in judged if one[0] >= goal - tuned.most_short_start] or [(before, found[-1])]
    for tried, (observed, each) in enumerate(sorted(judged, key=lambda item: -item[0])):
        if is_over() or (ends and tried >= tuned.most_closed):
            break
        route = judge.closed(each.route, goal, is_over)
        if route is not None:
            ends.append(SearchStart(route, min(1.0, each.observed + max(0.0, goal - observed))))
    return min(ends, key=lambda end: work.problem.cost(end.route), default=None)


def penalty_between(problem: RouteProblem, less: SearchStart, more: SearchStart) -> float:
    """Cost of full coverage at the rate between two routes, in lengths of the one with more coverage."""
    cost = problem.cost(more.route)
    return max(0.0, cost - problem.cost(less.route)) / (max(cost, 1e-12) * max(more.observed - less.observed, 1e-3))


def with_gaps_closed(
    judging: CoverageMap,  # the evaluation grid
    route: Route,  # keeps the limits
    goal: float,  # fraction of the visible ground
    # multiples of the missing ground that are tried, one after the other, until the goal is reached
    more_ground: Sequence[float],
    is_over: Callable[[], bool],  # whether the time is over
    *,
    most_trials: int,  # to make each of those routes shorter
) -> Route | None:
    """The route, extended by a repair for enough of its missing ground, or with added viewpoints.

    Returns:
        None if the route reaches the goal, if closing its gaps is too slow, or if it exceeds a limit.
    """
    observed = judging.observed(route.waypoints_m)
    missing = judging.coverable & ~observed
    lacking = goal - judging.fraction_of_coverable(observed)
    if lacking <= 0.0 or np.count_nonzero(missing) > _MOST_MISSING:
        return None
    if not judging.site.scenario.sensor.looks_along_path:
        whole = with_viewpoints(judging, route, goal, is_over)
        if whole is not None:
            return whole
    whole_m2 = float(judging.grid.weight_m2[judging.coverable].sum())
    missing_m2 = float(judging.grid.weight_m2[missing].sum())
    useful_m2 = (1.0 - _NEARLY_CLOSED) * lacking * whole_m2
    for more in more_ground:
        areas_m2 = more * lacking * whole_m2, useful_m2
        whole = _with_repair(judging, route, missing, areas_m2, is_over, most_trials)
        if whole is None:
            return None
        # After a route, distance-triggered photos fall elsewhere than after home, so more ground may be needed.
        still_lacking = goal - fraction_observed(whole, judging)
        if still_lacking <= 0.0:
            return whole
        if is_over():
            return None
        if still_lacking <= _NEARLY_CLOSED * lacking:
            return with_gaps_closed(judging, whole, goal, more_ground, is_over, most_trials=most_trials)
        if more * lacking * whole_m2 >= missing_m2:
            return None
    return None


def _over_after(trials: int, is_over: Callable[[], bool]) -> Callable[[], bool]:
    """The same test, also True after ``trials`` trials."""
    required = itertools.count()
    return lambda: is_over() or next(required) >= trials


def _with_repair(
    judging: CoverageMap,
    route: Route,
    missing: BoolArray,
    areas_m2: tuple[float, float],  # to observe, and below which the repair is useless
    is_over: Callable[[], bool],
    most_trials: int,
) -> Route | None:
    """The route, extended by a repair for part of the missing ground; None if useless or beyond a limit."""
    site, points = judging.site, route.waypoints_m
    end_m = points[-1] if site.home_m is None else site.home_m
    try:
        repair = plan_gap_route(
            judging, missing, start_m=points[-1], end_m=end_m, needed_m2=areas_m2[0], useful_m2=areas_m2[1],
            is_over=_over_after(most_trials, is_over), gives_up=is_over,
        )  # fmt: skip
    except InfeasibleError:
        return None
    whole = joined(site, [points, repair.route.waypoints_m])
    if _breaks_a_limit(site, whole):
        # At a cliff the link may be too steep, so adjust the heights at both ends.
        heights_agl_m = site.ground.heights_agl_m(whole)
        whole = lay_over_terrain(
            site, whole[:, :2], heights_agl_m, tolerance_m=PLAIN_TOLERANCE_M, spacing_m=_CLOSE_SAMPLES_M
        )
    if _breaks_a_limit(site, whole):
        # A path of no length would be no link of a sparse matrix.
        aside_m = np.array([1e-3, 0.0, 0.0])
        stops = [np.stack([position, position + aside_m]) for position in repair.route.waypoints_m]
        whole = joined_over(_lattice(site), [points, *stops])
    return None if _breaks_a_limit(site, whole) else certainly(site, Route(whole))


@once
def _lattice(site: Site) -> Lattice:
    return route_lattice(site, route_problem(planning_map(site), margin_m=0.0, reach_m=0.0).numbers)


def _breaks_a_limit(site: Site, points_m: FloatArray) -> bool:
    return measure_violations(site, points_m, margin_m=site.scenario.limits.height_margin_m).total > 0.0


# Viewpoints put into a route, each where it costs least, until the route observes enough.
#
# For sensors that look from waypoints alone: one more waypoint takes nothing from what the others observe. Behind the route,
# where gaps are closed otherwise (:mod:`uavcover.planner.search.repair`), a viewpoint may be a steep way off.

_MOST_INSERTED = 40
_MOST_TRIED = 200
"""This number of viewpoints is inserted, and of candidates tried for each, the best for their detour first."""

_LEGS_TRIED = 4
"""Number of legs with the shortest detours that are tried."""

_LEAST_DETOUR_M = 5.0


def with_viewpoints(coverage: CoverageMap, route: Route, goal: float, is_over: Callable[[], bool]) -> Route | None:
    """The route with viewpoints inserted until it reaches the goal.

    Args:
        coverage: the evaluation grid; its sensor observes from waypoints only.
        route: keeps the limits.
        goal: fraction of the visible ground.
        is_over: whether the time is over: called before each viewpoint and in its search.

    Returns:
        None if the route already reaches the goal, or if no permitted viewpoints reach it.
    """
    site, points = coverage.site, route.waypoints_m
    observed = coverage.observed(points)
    if coverage.fraction_of_coverable(observed) >= goal:
        return None
    for _ in range(_MOST_INSERTED):
        found = None if is_over() else _one_more(site, coverage, points, observed, goal, is_over)
        if found is None:
            return None
        before, points = np.count_nonzero(observed), found
        observed = coverage.observed(points)
        if coverage.fraction_of_coverable(observed) >= goal:
            return Route(points, route.begins)
        if np.count_nonzero(observed) <= before:
            return None
    return None


def _one_more(
    site: Site,
    coverage: CoverageMap,
    points_m: FloatArray,
    observed: BoolArray,
    goal: float,
    is_over: Callable[[], bool],
) -> FloatArray | None:
    """The (n, 3) points and one viewpoint with much coverage for its detour; None if none keeps the limits."""
    unobserved = coverage.coverable & ~observed
    if not unobserved.any():
        return None
    missing = MissingCells.of(coverage, unobserved)
    positions = np.vstack([
        grid_positions(site, missing), positions_around(site, few_enough(missing.cells.centre_m))
    ])  # fmt: skip
    eyes_m = np.column_stack([positions[:, :2], site.ground.ups_m(positions[:, :2], positions[:, 2])])
    eyes_m = eyes_m[np.isfinite(eyes_m[:, 2])]
    start, cells = observed_from_each(coverage, eyes_m, missing.numbers, any_heading(coverage.sight), is_over)
    gained_m2 = np.zeros(len(eyes_m))
    np.add.at(gained_m2, np.repeat(np.arange(len(eyes_m)), np.diff(start)), coverage.grid.weight_m2[cells])
    whole_m2 = float(coverage.grid.weight_m2[coverage.coverable].sum())
    lacking_m2 = (goal - coverage.fraction_of_coverable(observed)) * whole_m2
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


def _detours_m(site: Site, points_m: FloatArray, positions_m: FloatArray) -> FloatArray:
    """(k, n + 1) length added to (n, 3) points by each of (k, 3) points: first, between two points, or last.

    Infinite for a leg that is too steep.
    """
    offsets_m = positions_m[:, None] - points_m[None]
    away_m = np.linalg.norm(offsets_m, axis=2)
    steepest = math.tan(math.radians(site.scenario.limits.max_climb_angle_deg))
    away_m[np.abs(offsets_m[..., 2]) > steepest * np.hypot(offsets_m[..., 0], offsets_m[..., 1])] = math.inf
    first_m, last_m = away_m[:, 0], away_m[:, -1]
    if site.home_m is not None:
        from_home_m = np.linalg.norm(positions_m - site.home_m, axis=1)
        first_m = first_m + from_home_m - np.linalg.norm(points_m[0] - site.home_m)
        last_m = last_m + from_home_m - np.linalg.norm(points_m[-1] - site.home_m)
    between_m = away_m[:, :-1] + away_m[:, 1:] - np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    return np.column_stack([first_m, between_m, last_m])
