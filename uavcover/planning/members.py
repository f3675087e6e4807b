"""What the search and the baselines found, judged on the area's own cells: members of the Pareto set, or why there is none."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.dominance import non_dominated_mask
from uavcover.leg_checks import LegProblem, find_problems, find_waypoint_problems, measure_violations
from uavcover.model.route import Route, RouteMember
from uavcover.planning.objectives import judge
from uavcover.site import Site

_ADVICE = {
    "no elevation data": "give elevation data for the whole neighbourhood of the area",
    "too low": "widen limits.min_height_agl_m..max_height_agl_m or allow a larger limits.max_climb_angle_deg",
    "too high": "widen limits.min_height_agl_m..max_height_agl_m or allow a larger limits.max_climb_angle_deg",
    "below sea-level limit": "lower limits.min_alt_amsl_m",
    "above sea-level limit": "raise limits.max_alt_amsl_m",
    "climb": "allow a larger limits.max_climb_angle_deg",
    "fence": "give a larger fence",
    "obstacle": "allow smaller obstacles.clearance_beside_m and clearance_above_m, or raise limits.max_height_agl_m",
}


def judge_members(
    coverage: CoverageMap, routes: Sequence[tuple[Route, str]], executor: Executor | None = None
) -> list[RouteMember]:
    """Routes with the names of what made them, judged on the cells of ``coverage``."""
    margin = coverage.site.scenario.limits.height_margin_m
    # Every route is judged by the coverable cells: found once, here, and not by several threads at once.
    _ = coverage.coverable

    def one(item: tuple[Route, str]) -> RouteMember:
        route, name = item
        violations = measure_violations(coverage.site, route.waypoints_m, margin_m=margin)
        return RouteMember(route, judge(coverage, route), violations.total, name)

    return list(executor.map(one, routes) if executor is not None else map(one, routes))


def pareto_members(members: Sequence[RouteMember]) -> list[RouteMember]:
    """The members that no other dominates on the judged figures, by coverage; of equals the first.

    Coverage is that of the coverable area, which the selection rules speak of.
    """
    values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in members])
    _, first = np.unique(values, axis=0, return_index=True)
    keep = np.zeros(len(members), dtype=bool)
    keep[first] = True
    keep &= non_dominated_mask(values, np.zeros(len(values)))
    kept = [member for member, ok in zip(members, keep, strict=True) if ok]
    return sorted(kept, key=lambda m: (m.metrics.coverage_of_coverable, -m.metrics.cost))


def why_infeasible(site: Site, members: Sequence[RouteMember]) -> str:
    """One line on the least bad of routes that all break a limit: which limit, where, by how much, what to do."""
    least = min(members, key=lambda member: member.violation)
    limits = site.scenario.limits
    find = find_problems if limits.applies_to == "legs" else find_waypoint_problems
    problems = find(
        site,
        least.route.waypoints_m,
        lowest_agl_m=limits.min_height_agl_m + limits.height_margin_m,
        highest_agl_m=limits.max_height_agl_m - limits.height_margin_m,
    )
    worst = max(problems, key=_seriousness)
    more = f", and {len(problems) - 1} more like it or smaller" if len(problems) > 1 else ""
    margin = f" (limits.height_margin_m = {limits.height_margin_m:g} m taken off)" if _is_band(worst) else ""
    return f"no route keeps the limits of the scenario; the best one found breaks: {worst}{margin}{more}; {_ADVICE[worst.kind]}"


def _is_band(problem: LegProblem) -> bool:
    return problem.kind in {"too low", "too high"}


def _seriousness(problem: LegProblem) -> float:
    return np.inf if problem.kind == "no elevation data" else abs(problem.value - problem.limit)
