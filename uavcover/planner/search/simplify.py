"""Routes without the waypoints that they can do without: the last step of a search."""

from collections.abc import Callable, Sequence

from uavcover.kernels.annealing import snapshot
from uavcover.kernels.route_state import RouteState
from uavcover.kernels.simplification import merge, take_out
from uavcover.model.route import Route
from uavcover.planner.search.route_judge import SAFETY, with_safety
from uavcover.planner.search.route_problem import RouteProblem, route_problem, state_of
from uavcover.planner.sure_pictures import surely
from uavcover.sensing.coverage_map import CoverageMap

_SHARES = (0.0, 0.001, 0.004, 0.016, 0.063, 0.25, 1.0)
"""Share of the spare coverage that one waypoint may cost, sweep by sweep. Waypoints that cost nothing go first."""

_ATTEMPTS = 5
"""Each keeps twice as much more coverage as the one before it lacked on the exact count, or on finer cells."""

_ROUNDING = 1e-12


def simplified(
    # the cells that routes are judged on, and finer ones, where as much must be seen too
    judges: Sequence[CoverageMap],
    route: Route,  # keeps the limits
    *,
    asked: float | None,  # share of what can be covered that the selection rule asks for, if it does
    # whether there is no time left: asked between attempts and between sweeps. The first sweep is made all the same.
    is_over: Callable[[], bool] = lambda: False,
) -> Route | None:
    """A route without the waypoints whose removal keeps limits, cost and coverage, counted exactly; none when it needs them all.

    Coverage beyond ``asked`` may go, but for the margin that the search keeps to it; without ``asked``, or below it, none may.
    """
    before = [_seen(each, route) for each in judges]
    least = [least_seen(seen, asked, finer=number > 0) for number, seen in enumerate(before)]
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
            simpler = surely(judge.site, Route(snapshot(state)))
            if len(simpler) >= len(route):
                return None
            # Kernels count photos by distance as if every leg had them everywhere.
            lacks = max(needed - _seen(each, simpler) for each, needed in zip(judges, least, strict=True))
            if lacks <= _ROUNDING:
                return simpler
            if slack == 0.0:
                break
            slack = max(0.0, slack - 2.0 * lacks)
    return None


def _sweep(problem: RouteProblem, state: RouteState, slack: float, is_over: Callable[[], bool] = lambda: False) -> None:
    """Take out and merge waypoints until none can go or time is over, losing no more coverage than ``slack``."""
    fewest = 1 if problem.numbers.limits.legs == 0 else 2
    least = float(state.seen[0]) - slack - _ROUNDING
    for share in _SHARES:
        take_out(problem.numbers, state, fewest, least, share * slack + _ROUNDING)
        if is_over():
            return
    for change in (take_out, merge):
        while change(problem.numbers, state, fewest, least, slack + _ROUNDING) > 0:
            if is_over():
                return


def _seen(judge: CoverageMap, route: Route) -> float:
    return judge.share_of_coverable(judge.seen(route.waypoints_m))


def least_seen(seen: float, asked: float | None, *, finer: bool) -> float:
    """Least coverage of a changed route, as a share of the visible ground.

    Args:
        seen: by the route as it is.
        asked: by the selection rule, if it does.
        finer: whether it is not the cells that routes are judged on, but finer ones.
    """
    if finer:
        return asked if asked is not None and seen >= asked else seen - SAFETY
    return min(seen, with_safety(asked)) if asked is not None and seen >= asked else seen


def _problem(judging: CoverageMap) -> RouteProblem:
    limits = judging.site.scenario.limits
    middle_agl_m = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    reach_m = max(judging.site.scenario.sensor.half_width_m(middle_agl_m), judging.grid.cells.size_m)
    return route_problem(judging, margin_m=0.0, reach_m=reach_m)
