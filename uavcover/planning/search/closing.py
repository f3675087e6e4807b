"""Gaps of a search's routes, closed.

Where a search ends short of its goal, what else has to be flown to reach it is put behind one of its routes
(:mod:`uavcover.planning.gap_route` lays that out), and the search goes on from there.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.route import Route
from uavcover.planning.baselines.boustrophedon import PLAIN_TOLERANCE_M
from uavcover.planning.gap_route import plan_closing_route
from uavcover.planning.joining import joined
from uavcover.planning.search.insertion import with_viewpoints
from uavcover.planning.search.local_search import Work
from uavcover.planning.search.route_judge import SAFETY, RouteJudge, share_seen
from uavcover.planning.search.route_problem import RouteProblem
from uavcover.planning.search.starts import SearchStart
from uavcover.planning.sure_pictures import surely
from uavcover.planning.terrain_following import lay_over_terrain
from uavcover.routes.leg_checks import measure_violations
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

_MOST_MISSING = 10_000
"""Cells; to close the gaps of more takes seconds."""

_NEARLY_CLOSED = 0.1
"""Where so much of what was lacking is left, the rest is closed behind what closed it."""

_CLOSE_SAMPLES_M = 1.0
"""Of the ground, where routes are laid over it that break a limit when they are joined."""


def closed_end(
    work: Work,
    found: Sequence[SearchStart],
    goal: float,
    judge: RouteJudge,
    *,
    until: float,
    least_short: int = 0,
) -> SearchStart | None:
    """What a search ended with, its gaps closed, where it ends short of its goal and some of the work is left for it.

    Where nearly everything is to be seen, gaps are dear: then the ends of all its stages are tried, and the cheapest counts.

    Args:
        work: what is looked at, and how much may be done.
        found: what the stages of the search ended with.
        goal: share of what can be covered.
        judge: judges the ends, and closes their gaps.
        until: share of all the work, 0..1, after which no more are tried.
        least_short: so many ends that lack least are tried in any case.

    Returns:
        None where an end reaches the goal, or none could be closed.
    """

    def is_over() -> bool:
        return work.pace.fraction >= until

    if not found or work.stopped or is_over():
        return None
    tuned = work.tuning.goal
    ends: list[SearchStart] = []
    ends_of_stages = list(reversed(found if goal > tuned.nearly_all else found[-1:]))
    near = sorted(found, key=lambda each: -judge.coverage(each.route, goal))[:least_short] if least_short else []
    for each in dict.fromkeys([*near, *ends_of_stages]):
        if is_over():
            break
        short = goal - judge.coverage(each.route, goal)
        if short <= 0.0:
            return None
        closed = judge.closed(each.route, goal + SAFETY, is_over) if short <= tuned.most_short else None
        if closed is not None:
            ends.append(SearchStart(closed, each.seen + short))
    return min(ends, key=lambda end: work.problem.cost(end.route), default=None)


def closed_beginning(
    work: Work,
    starts: Sequence[SearchStart],
    found: Sequence[SearchStart],
    goal: float,
    judge: RouteJudge,
    *,
    until: float,
    at_last: float,
) -> SearchStart | None:
    """A beginning that sees enough, or the cheapest of those that see most, their gaps closed.

    On ground whose last part is dear, such as the walls of a canyon, a search from a short beginning loses what it sees there,
    and long lines are the better beginning.

    Args:
        work: what is looked at, and how much may be done.
        starts: the beginnings of the search.
        found: what its stages ended with.
        goal: share of what can be covered.
        judge: judges beginnings, and closes their gaps.
        until: share of all the work, 0..1, after which no more are tried, ...
        at_last: ... and the same while none is closed: a search that is far from its goal hardly reaches it otherwise.

    Returns:
        None where the search did not end far from its goal, or none could be closed.
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
    most = sorted(different, key=lambda each: -each.seen)[: tuned.most_beginnings]
    # Those that may see enough by themselves come first, the cheapest of them before the others.
    cheapest = sorted((each for each in different if each.seen >= goal), key=lambda each: work.problem.cost(each.route))
    judged: list[tuple[float, SearchStart]] = []
    for each in dict.fromkeys([*cheapest[: tuned.most_beginnings], *most]):
        if is_over():
            return None
        judged.append((judge.coverage(each.route, goal), each))
        if judged[-1][0] >= goal:
            return each
    judged = [one for one in judged if one[0] >= goal - tuned.most_short_beginning] or [(before, found[-1])]
    for tried, (seen, each) in enumerate(sorted(judged, key=lambda item: -item[0])):
        if is_over() or (ends and tried >= tuned.most_closed):
            break
        route = judge.closed(each.route, goal + SAFETY, is_over)
        if route is not None:
            ends.append(SearchStart(route, min(1.0, each.seen + max(0.0, goal - seen))))
    return min(ends, key=lambda end: work.problem.cost(end.route), default=None)


def price_between(problem: RouteProblem, less: SearchStart, more: SearchStart) -> float:
    """What all coverage costs at the rate between two routes, in lengths of the one that sees more."""
    cost = problem.cost(more.route)
    return max(0.0, cost - problem.cost(less.route)) / (max(cost, 1e-12) * max(more.seen - less.seen, 1e-3))


def with_gaps_closed(
    judging: CoverageMap,
    route: Route,
    goal: float,
    more_ground: Sequence[float],
    is_over: Callable[[], bool],
    *,
    most_trials: int,
) -> Route | None:
    """The route, and behind it what sees enough of the ground that it misses, or viewpoints in it where a sensor looks from them.

    Args:
        judging: the cells by which routes are judged.
        route: keeps the limits.
        goal: share of what can be covered.
        more_ground: so many times the ground that is lacking is looked at, one after the other, until the goal is reached.
        is_over: whether there is no time left for it.
        most_trials: to make each of those routes shorter.

    Returns:
        None where the route reaches the goal, and where closing its gaps is too much to find out, or breaks a limit.
    """
    seen = judging.seen(route.waypoints_m)
    missing = judging.coverable & ~seen
    lacking = goal - judging.share_of_coverable(seen)
    if lacking <= 0.0 or np.count_nonzero(missing) > _MOST_MISSING:
        return None
    if judging.site.scenario.sensor.sensing == "at-waypoints":
        whole = with_viewpoints(judging, route, goal, is_over)
        if whole is not None:
            return whole
    whole_m2 = float(judging.grid.weight_m2[judging.coverable].sum())
    missing_m2 = float(judging.grid.weight_m2[missing].sum())
    useful_m2 = (1.0 - _NEARLY_CLOSED) * lacking * whole_m2
    for more in more_ground:
        over = _over_after(most_trials, is_over)
        whole = _with_closing(judging, route, missing, more * lacking * whole_m2, useful_m2, over)
        if whole is None:
            return None
        # Pictures by distance fall elsewhere behind a route than behind home: it may take more.
        still_lacking = goal - share_seen(whole, judging)
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
    """The same question, answered with yes also after so many trials."""
    asked = itertools.count()
    return lambda: is_over() or next(asked) >= trials


def _with_closing(
    judging: CoverageMap,
    route: Route,
    missing: BoolArray,
    needed_m2: float,
    useful_m2: float,
    is_over: Callable[[], bool],
) -> Route | None:
    """The route, and behind it one for so much of the missing ground; none where that is of no use, or breaks a limit."""
    site, points = judging.site, route.waypoints_m
    end_m = points[-1] if site.home_m is None else site.home_m
    try:
        closing = plan_closing_route(
            judging, missing, start_m=points[-1], end_m=end_m, needed_m2=needed_m2, useful_m2=useful_m2, is_over=is_over
        )
    except InfeasibleError:
        return None
    whole = joined(site, [points, closing.route.waypoints_m])
    if _breaks_a_limit(site, whole):
        # At a cliff the way from one to the other may be too steep: the heights of both have to give.
        heights_agl_m = site.ground.heights_agl_m(whole)
        whole = lay_over_terrain(
            site, whole[:, :2], heights_agl_m, tolerance_m=PLAIN_TOLERANCE_M, spacing_m=_CLOSE_SAMPLES_M
        )
    return None if _breaks_a_limit(site, whole) else surely(site, Route(whole))


def _breaks_a_limit(site: Site, points_m: FloatArray) -> bool:
    return measure_violations(site, points_m, margin_m=site.scenario.limits.height_margin_m).total > 0.0
