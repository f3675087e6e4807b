"""The planner: baselines, search, judging on finer cells, choice."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import InfeasibleError
from uavcover.kernels.dominance import non_dominated_mask
from uavcover.leg_checks import find_problems, measure_violations
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.scenario import PlannerSettings
from uavcover.optimizers import ALGORITHMS
from uavcover.optimizers.interface import Optimizer
from uavcover.planning.baselines import Baseline, boustrophedons
from uavcover.planning.objectives import Evaluation, evaluate_routes, judge
from uavcover.planning.selection import parse_rule, select
from uavcover.planning.swath_encoding import SwathEncoding
from uavcover.planning.waypoint_encoding import WaypointEncoding
from uavcover.site import Site

FloatArray = NDArray[np.float64]

CONSTRUCTED_SHARE = 0.25
"""At most this share of the first population is constructed routes; the rest is sampled by the optimizer itself."""


class Encoding(Protocol):
    """Genes on one side, routes on the other.

    Attributes:
        lower: (d,) lower bounds.
        upper: (d,) upper bounds.
    """

    lower: FloatArray
    upper: FloatArray

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        ...


@dataclass(frozen=True, slots=True)
class Progress:
    """Where the search is.

    Attributes:
        evaluations: routes evaluated so far.
        total: routes that will be evaluated, or an estimate under a time budget.
        best_coverage: largest share of the planner's cells that a feasible route sees.
        shortest_m: shortest feasible route that reaches the required coverage, none yet or none required.
    """

    evaluations: int
    total: int
    best_coverage: float
    shortest_m: float | None


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to search: a number of evaluations, or a time budget in seconds measured by ``now``."""

    evaluations: int
    budget_s: float | None
    now: Callable[[], float]


def plan_routes(
    site: Site,
    *,
    settings: PlannerSettings,
    select_rule: str,
    effort: Effort,
    executor: Executor | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Plan:
    """Plan the sensing route of a site.

    The search counts on the planner's cells; every route that is reported is judged on the finer cells of the area. The
    choice is made among the search's Pareto set and the baselines, so it is never worse than these at the coverage that
    was asked for.

    Args:
        site: the scenario on its ground.
        settings: algorithm, encoding and seed.
        select_rule: see :mod:`uavcover.planning.selection`.
        effort: when to stop.
        executor: evaluates routes side by side; the result does not depend on it.
        should_stop: asked after every round; the best so far is returned.
        on_progress: told after every round.

    Raises:
        InfeasibleError: no route keeps the hard limits; says which, where and by how much.
        InputError: the rule cannot be understood.
    """
    started = effort.now()
    rule = parse_rule(select_rule)
    coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    baselines: list[Baseline] = []
    if settings.encoding == "swaths":
        baselines = boustrophedons(coarse, executor, should_stop)
    encoding, initial = _encoding(site, settings, baselines, rule.required_coverage)
    rounds = _rounds(settings, effort, started, len(baselines))
    optimizer: Optimizer = ALGORITHMS[settings.algorithm](
        encoding.lower,
        encoding.upper,
        n_objectives=3,
        n_constraints=1,
        population_size=settings.population_size,
        max_iterations=rounds,
        archive_size=max(100, settings.population_size),
        seed=settings.seed,
        initial=initial,
    )
    interrupted = _search(
        optimizer, encoding, coarse, effort, started, executor, should_stop, on_progress, rule.required_coverage
    )
    found = optimizer.pareto_set() if optimizer.evaluations else None
    routes = [encoding.decode(genes) for genes in found.x] if found is not None else []
    fine = _judging_map(site, coarse)
    members = judge_members(fine, [(route, settings.algorithm) for route in routes])
    reference = judge_members(fine, [(b.route, b.name) for b in _worth_showing(baselines, rule.required_coverage)])
    feasible = [member for member in (*members, *reference) if member.violation <= 0.0]
    if not feasible:
        raise InfeasibleError(_why_infeasible(site, [*members, *reference]))
    pareto = _pareto(feasible)
    choice = select(pareto, rule)
    return Plan(
        chosen=pareto[choice.index],
        members=tuple(pareto),
        baselines=tuple(reference),
        rule=rule.text,
        rule_met=choice.met,
        algorithm=settings.algorithm,
        evaluations=optimizer.evaluations,
        wall_s=effort.now() - started,
        interrupted=interrupted,
    )


def _encoding(
    site: Site, settings: PlannerSettings, baselines: Sequence[Baseline], required: float | None
) -> tuple[Encoding, FloatArray | None]:
    """The encoding, and the constructed routes that its first population begins with."""
    if settings.encoding == "waypoints":
        origin = np.zeros(3) if site.home_m is None else site.home_m
        return WaypointEncoding(site, capacity=settings.max_waypoints, order=settings.order, reference_m=origin), None
    ranked = _by_merit(baselines, required)
    encoding = SwathEncoding(site, centre=ranked[0].layout)
    count = max(1, int(CONSTRUCTED_SHARE * settings.population_size))
    return encoding, np.array([encoding.near(baseline.layout) for baseline in ranked[:count]])


def _by_merit(baselines: Sequence[Baseline], required: float | None) -> list[Baseline]:
    """Feasible first; then those that reach the coverage by length; then the others by coverage."""
    goal = 1.0 if required is None else required
    return sorted(
        baselines,
        key=lambda b: (
            b.violation > 0.0,
            max(0.0, goal + float(b.objectives[0])),
            float(b.objectives[2]),
        ),
    )


def _worth_showing(baselines: Sequence[Baseline], required: float | None) -> list[Baseline]:
    """The plain baseline, and the tuned ones that nothing else among them beats."""
    if not baselines:
        return []
    plain, tuned = baselines[:1], [b for b in baselines[1:] if b.violation <= 0.0]
    if not tuned:
        return list(plain)
    mask = non_dominated_mask(np.array([b.objectives for b in tuned]), np.zeros(len(tuned)))
    best = [b for b, keep in zip(tuned, mask, strict=True) if keep]
    return list(plain) + _by_merit(best, required)


def _rounds(settings: PlannerSettings, effort: Effort, started: float, evaluated: int) -> int:
    """How many rounds of the optimizer: from the evaluations, or from the time that the baselines took."""
    if effort.budget_s is None:
        return max(1, effort.evaluations // settings.population_size)
    each_s = (effort.now() - started) / max(evaluated, 1) if evaluated else 1e-3
    return max(2, int(effort.budget_s / max(each_s, 1e-5) / settings.population_size))


def _search(
    optimizer: Optimizer,
    encoding: Encoding,
    coverage: CoverageMap,
    effort: Effort,
    started: float,
    executor: Executor | None,
    should_stop: Callable[[], bool],
    on_progress: Callable[[Progress], None],
    required: float | None,
) -> bool:
    """Run the optimizer to its end, the end of the budget or the user's stop; True in the last case."""
    best, shortest = 0.0, math.inf
    total = 0
    while not optimizer.should_stop:
        if should_stop():
            return True
        if effort.budget_s is not None and optimizer.iteration > 0 and effort.now() - started >= effort.budget_s:
            return False
        genes = optimizer.ask()
        values: Evaluation = evaluate_routes(coverage, [encoding.decode(row) for row in genes], executor)
        optimizer.tell(values.objectives, values.violations)
        keeps = values.violations[:, 0] <= 0.0
        best = max(best, float(-values.objectives[keeps, 0].min(initial=0.0)))
        reached = keeps & (-values.objectives[:, 0] >= (required if required is not None else 2.0))
        shortest = min(shortest, float(values.objectives[reached, 2].min(initial=math.inf)))
        total = max(total, optimizer.evaluations)
        on_progress(
            Progress(optimizer.evaluations, effort.evaluations, best, shortest if math.isfinite(shortest) else None)
        )
    return False


def _judging_map(site: Site, coarse: CoverageMap) -> CoverageMap:
    """The map on the area's own cells; the planner's own where they are the same."""
    if site.scenario.area.cell_size_m == site.scenario.planning_cell_size_m:
        return coarse
    return CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)


def judge_members(coverage: CoverageMap, routes: Sequence[tuple[Route, str]]) -> list[RouteMember]:
    """Routes with the names of what made them, judged on the cells of ``coverage``."""
    margin = coverage.site.scenario.limits.height_margin_m
    return [
        RouteMember(
            route,
            judge(coverage, route),
            measure_violations(coverage.site, route.waypoints_m, margin_m=margin).total,
            name,
        )
        for route, name in routes
    ]


def _pareto(members: Sequence[RouteMember]) -> list[RouteMember]:
    """The members that no other dominates on the judged figures, by coverage; of equals the first."""
    values = np.array(
        [[-m.metrics.coverage_fraction, m.metrics.waypoint_count, m.metrics.path_length_m] for m in members]
    )
    _, first = np.unique(values, axis=0, return_index=True)
    keep = np.zeros(len(members), dtype=bool)
    keep[first] = True
    keep &= non_dominated_mask(values, np.zeros(len(values)))
    kept = [member for member, ok in zip(members, keep, strict=True) if ok]
    return sorted(kept, key=lambda m: (m.metrics.coverage_fraction, -m.metrics.path_length_m))


def _why_infeasible(site: Site, members: Sequence[RouteMember]) -> str:
    least = min(members, key=lambda member: member.violation)
    limits = site.scenario.limits
    points = least.route.waypoints_m
    problems = find_problems(
        site,
        points,
        lowest_agl_m=limits.min_height_agl_m + limits.height_margin_m,
        highest_agl_m=limits.max_height_agl_m - limits.height_margin_m,
    )
    worst = f"; the best route found breaks: {problems[0]}" if problems else ""
    more = f" and {len(problems) - 1} more" if len(problems) > 1 else ""
    return (
        f"no route keeps the limits of the scenario{worst}{more}. Widen limits.min_height_agl_m..max_height_agl_m, allow a "
        "larger limits.max_climb_angle_deg, or a larger fence"
    )
