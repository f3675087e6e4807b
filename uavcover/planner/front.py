"""Pareto front of a plan: whole and partial routes, evaluated on the area's own cells and thinned.

A vehicle that cannot fly the whole route flies the part with the best coverage for its length. Snapshots record what the
planner would have returned at earlier times, so one run gives the result for every budget.
"""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import least_crowded, non_dominated_mask
from uavcover.kernels.path_cost import route_cost
from uavcover.missions.leg_checks import (
    LegProblem,
    find_corner_problems,
    find_problems,
    find_waypoint_problems,
    measure_violations,
)
from uavcover.missions.objectives import judge_member
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import PART_OF, Route, RouteMember
from uavcover.planner.budget import FRACTIONS
from uavcover.planner.search.optimizer_search import Effort
from uavcover.planner.selection_rule import Rule, select
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, path_lengths_m

NamedRoute = tuple[Route, str]
"""A route and what made it: the algorithm, or the name of a baseline."""


class Snapshots:
    """Routes worth evaluating at given times of a run, and at its end.

    Attributes:
        moments_s: times since planning started, by the effort's clock; ascending.
        taken: the routes by time; the final result for times after the end of the run.
        last: the routes at the end.
    """

    def __init__(self, moments_s: Sequence[float]) -> None:
        self.moments_s = tuple(sorted(moments_s))
        self.taken: dict[float, tuple[NamedRoute, ...]] = {}
        self.last: tuple[NamedRoute, ...] = ()

    def look(self, elapsed_s: float, found: Callable[[], Sequence[NamedRoute]]) -> None:
        """Call ``found`` and record its result if a moment has passed without one."""
        due = [moment for moment in self.moments_s if moment <= elapsed_s and moment not in self.taken]
        if due:
            self.taken |= dict.fromkeys(due, tuple(found()))

    def close(self, routes: Sequence[NamedRoute]) -> None:
        """Record the final result."""
        self.last = tuple(routes)
        self.taken |= {moment: self.last for moment in self.moments_s if moment not in self.taken}


_ADVICE = {
    "no elevation data": "use elevation data that also covers the surroundings of the area",
    "too low": "widen limits.min_height_agl_m..max_height_agl_m or allow a larger limits.max_climb_angle_deg",
    "too high": "widen limits.min_height_agl_m..max_height_agl_m or allow a larger limits.max_climb_angle_deg",
    "below sea-level limit": "lower limits.min_alt_amsl_m",
    "above sea-level limit": "raise limits.max_alt_amsl_m",
    "climb": "allow a larger limits.max_climb_angle_deg",
    "fence": "use a larger fence",
    "no-fly zone": "allow a smaller margin_m of the zone, or change the area",
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
        return judge_member(coverage, route, name, margin_m=margin)

    return list(executor.map(one, routes) if executor is not None else map(one, routes))


def pareto_members(members: Sequence[RouteMember]) -> list[RouteMember]:
    """The members that no other dominates, by coverage; the first of equal ones.

    Coverage is that of the visible ground, as in the selection rules.
    """
    values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in members])
    _, first = np.unique(values, axis=0, return_index=True)
    keep = np.zeros(len(members), dtype=bool)
    keep[first] = True
    keep &= non_dominated_mask(values, np.zeros(len(values)))
    kept = [member for member, ok in zip(members, keep, strict=True) if ok]
    return sorted(kept, key=lambda m: (m.metrics.coverage_of_coverable, -m.metrics.cost))


def why_infeasible(site: Site, members: Sequence[RouteMember]) -> str:
    """One line about the route closest to feasible: the limit, the position, the excess, and the remedy."""
    least = min(members, key=lambda member: member.violation)
    limits = site.scenario.limits
    find = find_problems if limits.applies_to == "legs" else find_waypoint_problems
    problems = find(
        site,
        least.route.waypoints_m,
        lowest_agl_m=limits.min_height_agl_m + limits.height_margin_m,
        highest_agl_m=limits.max_height_agl_m - limits.height_margin_m,
    )
    problems = problems or find_corner_problems(site, least.route.waypoints_m)
    worst = max(problems, key=_seriousness)
    more = f", and has {len(problems) - 1} similar or smaller violations" if len(problems) > 1 else ""
    taken_off = _is_band(worst) and not worst.in_corner
    margin = f" (after limits.height_margin_m = {limits.height_margin_m:g} m)" if taken_off else ""
    return f"no route meets the scenario's limits; the best route violates one: {worst}{margin}{more}; {_ADVICE[worst.kind]}"


def _is_band(problem: LegProblem) -> bool:
    return problem.kind in {"too low", "too high"}


def _seriousness(problem: LegProblem) -> float:
    return np.inf if problem.kind == "no elevation data" else abs(problem.value - problem.limit)


PART_FRACTIONS = tuple(k / 25 for k in range(1, 25))
"""Least coverage of the parts, as fractions of the whole route's coverage."""


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """A route of n waypoints, and the coverage that each leg adds."""

    route: Route  # its waypoints
    along_m: FloatArray  # (n,) length of the path up to each waypoint
    observed: FloatArray  # (n,) fraction of the area's ground that is observed up to each waypoint, 0..1


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A stretch of a route."""

    route: Route  # its waypoints
    # lower limit of the observed fraction of the area: ground that the route observes before the stretch does not count. An
    # estimate in corners, and if distance-triggered photos restart with the stretch.
    observed: float


def gains_of(coverage: CoverageMap, route: Route) -> Gains:
    """Coverage that each leg of a route adds, on the cells of ``coverage``; a single waypoint counts alone."""
    along_m = path_lengths_m(route.waypoints_m)
    if len(route) == 1:
        return Gains(route, along_m, np.array([coverage.fraction(coverage.observed(route.waypoints_m))]))
    leg = coverage.observed_legs(route.waypoints_m)
    first = coverage.first_observed(coverage.observations(route.waypoints_m))
    observed = first >= 0
    weight_m2 = coverage.grid.weight_m2
    gained = np.bincount(leg[first[observed]], weights=weight_m2[observed], minlength=len(along_m) - 1)
    return Gains(route, along_m, np.concatenate([[0.0], np.cumsum(gained)]) / coverage.grid.area_m2)


def parts_of(gains: Gains, *, fractions: Sequence[float] = PART_FRACTIONS) -> list[Part]:
    """For each fraction of a route's coverage, the shortest known stretch of whole legs that reaches it.

    Each stretch keeps the limits that the route keeps. A stretch is listed once, and the whole route never.

    Args:
        gains: of the route.
        fractions: 0..1.
    """
    points, along_m, observed = gains.route.waypoints_m, gains.along_m, gains.observed
    if len(points) < 3:
        return []
    first = np.arange(len(points) - 1)
    found: dict[tuple[int, int], Part] = {}
    for fraction in fractions:
        # For each waypoint, the first later one with enough coverage; past the end without one.
        last = np.maximum(
            np.searchsorted(observed, observed[first] + fraction * observed[-1] * (1.0 - 1e-12)), first + 1
        )
        lengths = np.where(last < len(points), along_m[np.minimum(last, len(points) - 1)] - along_m[first], np.inf)
        best = int(np.argmin(lengths))
        ends = best, int(last[best])
        if ends != (0, len(points) - 1):
            found[ends] = Part(Route(points[ends[0] : ends[1] + 1]), float(observed[ends[1]] - observed[ends[0]]))
    return list(found.values())


MOST_MEMBERS = 100
"""A larger Pareto set is thinned, because a user cannot survey it."""

_MOST_OTHERS = 80
_FEWEST_OTHERS = 5
"""Least and most parts and optimizer routes that are judged, for any time left."""

_MOST_FOUND = 25
"""This number of found routes is expected when time is set aside for judging them."""

_PART = 0.5
"""Time of judging a part, as a fraction of that of a whole route."""

_FEWEST_JUDGED = 12
"""Time is set aside for judging this number of routes at least, up to a fraction of the budget."""

_JUDGED_FIRST = 2
"""This number of baselines is always judged, the others while that takes no more than a fraction of the budget."""

_WHOLE = 0.9
"""A route has parts worth flying when it observes at least this fraction of the most that any observes."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A route with its values on the planner's cells."""

    route: NamedRoute  # the route and what made it
    objectives: FloatArray  # (3,) as in :mod:`uavcover.missions.objectives`
    violation: float  # total violation of the hard limits


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A route that may be shortened to a part: its values, and the coverage that each leg adds."""

    candidate: Candidate
    gains: Gains


class Finish:
    """The final stage of a plan: chooses the routes and parts to evaluate in the remaining time."""

    def __init__(
        self,
        coarse: CoverageMap,  # on the planner's cells
        fine: CoverageMap,  # on the evaluation grid
        baselines: Sequence[Candidate],  # the most useful ones first
        others: Sequence[Candidate],  # from an optimizer
        lines: Sequence[NamedRoute],  # further named routes; evaluated if nothing dominates them
        *,
        evaluating_s: float,  # time to construct a route and evaluate it on the planner's cells
        effort: Effort,  # of the whole plan
        started: float,  # when planning began, by the effort's clock
        executor: Executor | None,  # looks at routes in parallel
    ) -> None:
        """Look at the lines."""
        self._coarse, self._fine, self._baselines, self._others = coarse, fine, baselines, others
        self._effort, self._started, self._executor = effort, started, executor
        self._wholes: list[Whole] = []
        # Judging takes as many times longer as there are more cells.
        self._looking_s = evaluating_s
        self._judging_s = evaluating_s * fine.grid.count / max(coarse.grid.count, 1)
        self._judged_s = 0.0
        self._lines = self._evaluated(lines)

    @property
    def known(self) -> list[Candidate]:
        """Every candidate before the local search, on the planner's cells."""
        return [*self._others, *(each.candidate for each in self._lines), *self._baselines]

    def search_effort(self, late_s: float = 0.0) -> Effort:
        """The effort without the time reserved for evaluating the result and for later stages."""
        budget_s = self._effort.budget_s
        if budget_s is None:
            return self._effort
        finish_s = _MOST_FOUND * (self._judging_s + self._looking_s) + _PART * _MOST_OTHERS * self._judging_s
        finish_s = min(finish_s, FRACTIONS.judging * budget_s)
        # Every route is judged by the coverable cells, and along the same transits, which are found with the first one.
        for each in self._baselines[:_JUDGED_FIRST]:
            begin = self._effort.now()
            judge_members(self._fine, [each.route])
            judging_s = self._effort.now() - begin
        if self._baselines:
            self._judged_s = judging_s
            finish_s = max(finish_s, min(_FEWEST_JUDGED * judging_s, FRACTIONS.judging_of_fewest * budget_s))
        return dataclasses.replace(self._effort, budget_s=budget_s - late_s - finish_s)

    def judged_baselines(self, baselines: Sequence[Candidate]) -> list[RouteMember]:
        """Baselines evaluated in their order; under a time budget, the first ones.

        Args:
            baselines: the most useful ones first.
        """
        now, named = self._effort.now, [each.route for each in baselines]
        # Every route is judged by the coverable cells: found once.
        _ = self._fine.coverable
        begin = now()
        judged = judge_members(self._fine, named[:_JUDGED_FIRST], self._executor)
        count = len(named)
        if self._effort.budget_s is not None and count > _JUDGED_FIRST:
            # Routes that were evaluated before the search take no time now, and do not show how long others take.
            each_s = max((now() - begin) / _JUDGED_FIRST, self._judged_s, 1e-6)
            count = min(count, _JUDGED_FIRST + int(FRACTIONS.judging_baselines * self._effort.budget_s / each_s))
        judged += judge_members(self._fine, named[_JUDGED_FIRST:count], self._executor)
        self._judging_s = max(self._judged_s, (now() - begin) / max(count, 1))
        self._wholes = self._evaluated(named[:count])
        return judged

    def worth_judging(self, found: Sequence[NamedRoute]) -> list[NamedRoute]:
        """The routes found, their parts, and the optimizer's routes that no known route dominates."""
        scenario = self._coarse.site.scenario
        if not scenario.sensor.looks_along_path and scenario.limits.applies_to == "waypoints":
            # With a free order, every number of waypoints has its own search, so parts add nothing.
            return [*found, *(each.route for each in self._others), *(each.candidate.route for each in self._lines)]
        evaluated = [*self._wholes, *self._evaluated(found)]
        lines = _unbeaten([each.candidate for each in self._lines], [each.candidate for each in evaluated])
        most = _MOST_OTHERS
        if self._effort.budget_s is not None:
            left_s = self._started + self._effort.budget_s - self._effort.now()
            fit = left_s / max(self._judging_s, 1e-6) - len(found) - len(lines)
            most = max(_FEWEST_OTHERS, min(most, int(fit / _PART)))
        judged = [each.candidate for each in evaluated] + lines
        offered = [*self._others, *_parts(self._coarse.site, [*evaluated, *self._lines])]
        new = _unbeaten(offered, judged)
        kept = least_crowded(np.array([each.objectives for each in new]), most) if new else ()
        return [*found, *(each.route for each in lines), *(new[k].route for k in kept)]

    def _evaluated(self, routes: Sequence[NamedRoute]) -> list[Whole]:
        site = self._coarse.site
        margin_m = site.scenario.limits.height_margin_m

        def one(named: NamedRoute) -> Whole:
            route, _ = named
            gains = gains_of(self._coarse, route)
            violation = measure_violations(site, route.waypoints_m, margin_m=margin_m).total
            objectives = np.array([-gains.observed[-1], len(route), _cost(site, route)])
            return Whole(Candidate(named, objectives, violation), gains)

        return list(map(one, routes) if self._executor is None else self._executor.map(one, routes))


def _unbeaten(offered: Sequence[Candidate], known: Sequence[Candidate]) -> list[Candidate]:
    """Offered routes that no offered or known route dominates; the first of equal ones."""
    if not offered:
        return []
    values = np.array([each.objectives for each in (*known, *offered)])
    mask = non_dominated_mask(values, np.array([each.violation for each in (*known, *offered)]))
    new = np.flatnonzero(mask[len(known) :])
    _, first = np.unique(values[len(known) :][new], axis=0, return_index=True)
    return [offered[k] for k in new[np.sort(first)]]


def _parts(site: Site, wholes: Sequence[Whole]) -> list[Candidate]:
    """Parts of the routes with the most coverage, unless the whole route is dominated."""
    sound = [each for each in wholes if each.candidate.violation <= 0.0]
    if not sound:
        return []
    values = np.array([each.candidate.objectives for each in sound])
    mask = non_dominated_mask(values, np.zeros(len(values))) & (values[:, 0] <= _WHOLE * values[:, 0].min())
    found = []
    for each, keep in zip(sound, mask, strict=True):
        if keep:
            _, name = each.candidate.route
            for part in parts_of(each.gains):
                objectives = np.array([-part.observed, len(part.route), _cost(site, part.route)])
                found.append(Candidate((part.route, PART_OF + name), objectives, 0.0))
    return found


def thinned(pareto: Sequence[RouteMember], rule: Rule) -> list[RouteMember]:
    """At most MOST_MEMBERS of a Pareto set, in its order: the rule's choice and the least crowded ones."""
    if len(pareto) <= MOST_MEMBERS:
        return list(pareto)
    metrics = [member.metrics for member in pareto]
    values = np.array([[-m.coverage_of_coverable, m.waypoint_count, m.cost] for m in metrics])
    kept = set(least_crowded(values, MOST_MEMBERS - 1).tolist())
    if rule.kind != "index":  # a number means one of those that are left
        kept.add(select(pareto, rule).index)
    return [pareto[k] for k in sorted(kept)]


def _cost(site: Site, route: Route) -> float:
    return float(route_cost(site.ground.surface, path_cost_of(site), route.waypoints_m))
