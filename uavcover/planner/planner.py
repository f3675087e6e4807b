"""The planner: baselines, optimizer, local search, judging on finer cells, selection."""

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np

from uavcover.errors import StageOver
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import least_crowded, non_dominated_mask
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.scenario import PlannerAlgorithm, PlannerSettings
from uavcover.optimizers import make_optimizer, optimizer_class, optimizer_name
from uavcover.optimizers.ask_tell import AskAndTell
from uavcover.planner.baselines import cut_lines
from uavcover.planner.baselines.boustrophedon import (
    RETURNING,
    TUNED,
    Baseline,
    SwathLayout,
    fewest_lines,
    long_side_angle_rad,
    taken,
)
from uavcover.planner.baselines.contour_lines import TUNED as TUNED_CONTOURS
from uavcover.planner.baselines.initial_routes import constructed_routes, initial_names
from uavcover.planner.budget import FRACTIONS, StageTimes
from uavcover.planner.final_choice import choose, choose_at_once
from uavcover.planner.front import Candidate, Finish, NamedRoute, Snapshots, judge_members
from uavcover.planner.parallel_lines import any_reaches, first_lines, one_line_more, plan_lines
from uavcover.planner.search.improve import improve
from uavcover.planner.search.optimizer_search import (
    Effort,
    Encoding,
    Searched,
    SearchProgress,
    SearchRun,
    SwathEncoding,
    WaypointEncoding,
    rounds_of,
    search,
)
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.sortie_order.reorder import OrderEffort, has_several_sorties, tries_of
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map, planning_map

__all__ = ["Effort", "SearchProgress", "plan_routes"]

_log = logging.getLogger(__name__)

CONSTRUCTED_FRACTION = 0.25
"""At most this fraction of the first population is constructed routes; the rest is sampled by the optimizer itself."""

_OPTIMIZER: dict[PlannerAlgorithm, tuple[str, float]] = {
    "memetic": ("imodbo", FRACTIONS.optimizer),
    "local-search": ("imodbo", 0.0),
    "imodbo": ("imodbo", 1.0),
    "modbo": ("modbo", 1.0),
    "nsga2": ("nsga2", 1.0),
    "moead": ("moead", 1.0),
}
"""Optimizer of an algorithm, and its fraction of the evaluations or the time; the rest is local search.

One round, which only samples, there always is, unless baselines keep the limits and it alone would take longer than that time.
"""


_MOST_ROUNDS = 50
"""Rounds of the optimizer before a local search: where a round is quick, more of them add nothing (docs/results/coverage.md)."""

_JUDGED_AT_ONCE, _AT_ONCE_S = 2, 0.3
"""This number of baselines is judged where there is no time for more, and routes of a search for this time."""

_MOST_TUNED = 12
"""This number of tuned lines of each kind is shown: the one of most merit, and the least crowded."""


@dataclass(slots=True, eq=False)
class SoFar:
    """The routes that a search has found so far.

    Attributes:
        baselines: all of them.
        incumbent: the best route of the search on its own cells; none before it.
        found: routes of the search that are worth judging.
        evaluations: full route evaluations spent on it.
        judged: everything that is worth choosing from, once it is judged.
    """

    baselines: Sequence[Baseline] = ()
    incumbent: Route | None = None
    found: list[Route] = field(default_factory=list)
    evaluations: int = 0
    judged: Sequence[RouteMember] = ()

    def noting(self, on_progress: Callable[[SearchProgress], None]) -> Callable[[SearchProgress], None]:
        """``on_progress``, and the incumbent and the evaluations are kept."""

        def note(progress: SearchProgress) -> None:
            self.incumbent = self.incumbent if progress.incumbent is None else progress.incumbent
            self.evaluations = progress.evaluations
            on_progress(progress)

        return note


def plan_in_time(
    site: Site,
    *,
    settings: PlannerSettings,
    select_rule: str,
    effort: Effort,
    executor: Executor,
    should_stop: Callable[[], bool],
    on_progress: Callable[[SearchProgress], None],
    own: str | type | None,
    no_longer_than: Callable[[Callable[[], bool]], AbstractContextManager[None]],
) -> Plan:
    """:func:`plan_routes`; what it has found, chosen at once, where it goes on for too long after its end.

    ``no_longer_than`` makes a context that may raise StageOver when its time is over and its argument says that there is a route.
    The other arguments are those of :func:`plan_routes`.
    """
    so_far, started = SoFar(), effort.now()
    try:
        with no_longer_than(lambda: bool(so_far.baselines)):
            return plan_routes(
                site, settings=settings, select_rule=select_rule, effort=effort, executor=executor, should_stop=should_stop,
                on_progress=on_progress, own=own, so_far=so_far,
            )  # fmt: skip
    except StageOver:
        _log.info("search and selection took %.2f s", effort.now() - started)
    rule, fine, judged = parse_rule(select_rule), judging_map(site), list(so_far.judged)
    judged = judged or _judged_at_once(fine, so_far, settings.algorithm, rule.required_coverage, effort.now)
    interrupted = should_stop()
    chosen = choose_at_once(fine, settings, rule, judged, interrupted=interrupted)
    return Plan(
        chosen=chosen.route, members=chosen.pareto, baselines=tuple(m for m in judged if m.origin != settings.algorithm),
        rule=rule.text, rule_met=chosen.rule_met, algorithm=settings.algorithm, evaluations=so_far.evaluations,
        wall_s=effort.now() - started, interrupted=interrupted,
    )  # fmt: skip


def _judged_at_once(
    fine: CoverageMap, so_far: SoFar, algorithm: str, required: float | None, now: Callable[[], float]
) -> list[RouteMember]:
    """The incumbent, the best baselines, and the shortest routes found until one reaches the required coverage."""
    # None of the pool: it may still be at work.
    best = [(each.route, each.name) for each in _by_merit(so_far.baselines, required)]
    incumbent = [] if so_far.incumbent is None else [(so_far.incumbent, algorithm)]
    judged, until = judge_members(fine, [*incumbent, *best[:_JUDGED_AT_ONCE]]), now() + _AT_ONCE_S
    for route in sorted(so_far.found, key=lambda route: route.length_m):
        if now() > until:
            break
        judged += judge_members(fine, [(route, algorithm)])
        if required is not None and judged[-1].violation <= 0.0 <= judged[-1].metrics.coverage_of_coverable - required:
            break
    return judged


def plan_routes(
    site: Site,
    *,
    settings: PlannerSettings,
    select_rule: str,
    effort: Effort,
    executor: Executor | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[SearchProgress], None] = lambda _: None,
    snapshots: Snapshots | None = None,
    own: str | type | None = None,
    so_far: SoFar | None = None,
) -> Plan:
    """Plan the sensing route of a site.

    The search uses the planner's cells; every reported route is evaluated on the finer cells of the area. The choice includes the
    baselines, so it is never worse than these at the required coverage.

    Args:
        site: the scenario on its ground.
        settings: algorithm, encoding and seed.
        select_rule: see :mod:`uavcover.planner.selection_rule`.
        effort: when to stop.
        executor: evaluates routes in parallel; the result does not depend on it.
        should_stop: called before every round; the best so far is returned. There always is one: a baseline, or the first round,
            which is then not omitted.
        on_progress: called after every round.
        snapshots: given what was found at its moments, and at the end: baselines first.
        own: another optimizer in place of ``settings.algorithm``, for the whole search, as
            :func:`uavcover.optimizers.optimizer_class` takes it.
        so_far: filled with what is found, for a caller that ends the search from outside.

    Raises:
        OptimizerError: ``own`` cannot be found or is no optimizer; it is looked up before anything else.
        InfeasibleError: no route that was found keeps the hard limits; says which, where and by how much.
        InputError: the rule cannot be understood.
    """
    if settings.algorithm in {"lines", "contour-lines"} and own is None:
        return plan_lines(
            site, settings=settings, select_rule=select_rule, effort=effort, executor=executor, should_stop=should_stop
        )
    if own is not None:
        optimizer_class(own)
        # It begins with the constructed routes that the plain optimizers begin with.
        settings = dataclasses.replace(settings, algorithm="imodbo")
    algorithm: str = settings.algorithm
    name, fraction = _OPTIMIZER[settings.algorithm]
    if own is not None:
        algorithm = name = optimizer_name(own)
    started = effort.now()
    rule, so_far = parse_rule(select_rule), so_far or SoFar()
    on_progress = so_far.noting(on_progress)
    coarse = planning_map(site)
    goal = None
    if rule.required_coverage is not None:
        # The rule speaks of the visible ground, the objectives of the whole area.
        goal = rule.required_coverage * coarse.fraction(coarse.coverable)
    other_lines = fraction < 1.0 and settings.encoding == "swaths"
    baseline_fraction = FRACTIONS.baselines_before_lines if other_lines else FRACTIONS.baselines
    tuned = None
    along_contours = "contour-lines" in initial_names(coarse, settings)
    if other_lines and goal is not None and effort.budget_s is not None and not along_contours:
        tuned = fewest_lines(coarse, goal)
    times = StageTimes(time.monotonic, effort.budget_s)
    before = effort.now()
    with times.stage("initial solutions", baseline_fraction):
        baselines = constructed_routes(
            coarse, settings, required=rule.required_coverage, executor=executor,
            left_s=lambda: 0.0 if should_stop() else effort.left_s(started, fraction=baseline_fraction), tuned=tuned,
        )  # fmt: skip
        so_far.baselines = baselines
        if other_lines and goal is not None and cut_lines.needs_cuts(site):
            baselines += cut_lines.cut_baselines(
                coarse, goal, lambda: should_stop() or effort.is_over(started, fraction=FRACTIONS.cut_lines)
            )
    each_s = (effort.now() - before) / max(len(baselines), 1)
    constructed = _named(_worth_showing(baselines, goal))
    kept = Snapshots(()) if snapshots is None else snapshots

    def look(routes: Callable[[], Sequence[NamedRoute]]) -> None:
        kept.look(effort.now() - started, lambda: [*(each.route for each in constructed), *routes()])

    encoding, initial = _encoding(site, settings, baselines, goal)
    optimizing = effort if fraction == 1.0 else _shared(effort, fraction, started)
    rounds = 1
    left_out = fraction < 1.0 and _takes_too_long(settings.population_size * each_s, baselines, effort, fraction)
    if not left_out:
        rounds = rounds_of(
            optimizing, started, encoding=encoding, coverage=coarse, population_size=settings.population_size,
            executor=executor,
        )  # fmt: skip
    if fraction < 1.0:
        rounds = min(rounds, _MOST_ROUNDS)
    optimizer: AskAndTell = make_optimizer(
        name if own is None else own, encoding.lower, encoding.upper, n_objectives=3, n_constraints=1,
        population_size=settings.population_size, max_iterations=rounds, archive_size=max(100, settings.population_size),
        seed=settings.seed, initial=initial,
    )  # fmt: skip
    run = SearchRun(
        effort=optimizing, started=started, executor=executor, should_stop=should_stop, on_progress=on_progress,
        found=so_far.found,
    )  # fmt: skip
    searched = Searched(interrupted=False, scale=None)
    if not left_out:
        with times.stage(f"optimizer {name}", fraction):
            searched = search(
                optimizer,
                run,
                rounds=rounds,
                encoding=encoding,
                coverage=coarse,
                at_least_one_round=not baselines,
                goal=goal,
                look=lambda routes: look(lambda: [(route, name) for route in routes()]),
            )
    fine = judging_map(site)
    optimized = _candidates(optimizer, encoding, searched.scale, name)
    evaluations, interrupted = optimizer.evaluations, searched.interrupted
    in_several, found = False, list[NamedRoute]()
    if fraction == 1.0:
        reference = judge_members(fine, [each.route for each in constructed], executor)
        made = [candidate.route for candidate in optimized]
    else:
        lines: list[NamedRoute] = []
        if settings.encoding == "swaths" and not interrupted:
            best_straight = next((b.layout for b in _by_merit(baselines, goal) if b.layout is not None), None)
            with times.stage("bent lines", FRACTIONS.bent_lines):
                lines = _lines(coarse, best_straight, rule.required_coverage, dataclasses.replace(run, effort=effort))
        late_s = 0.0 if tuned is None or effort.budget_s is None else FRACTIONS.late_lines * effort.budget_s
        # What takes several sorties gets a search for their order at the end.
        best = _by_merit(baselines, goal)[:1]
        in_several = any(has_several_sorties(site, each.route) for each in best)
        order_s = FRACTIONS.order * effort.budget_s if in_several and effort.budget_s is not None else 0.0
        finish = Finish(
            coarse, fine, constructed, optimized, lines, evaluating_s=each_s, effort=effort, started=started,
            executor=executor,
        )  # fmt: skip
        if not interrupted:
            searching = finish.search_effort(late_s + order_s)
            used_s = effort.now() - started
            left = None if searching.budget_s is None or not effort.budget_s else searching.budget_s - used_s
            with times.stage(
                "local search", None if left is None or effort.budget_s is None else left / effort.budget_s
            ):
                improved = improve(
                    coarse, fine, finish.known, dataclasses.replace(run, effort=searching),
                    settings=settings, rule=rule, evaluations_done=evaluations,
                    look=lambda routes: look(
                        lambda: finish.worth_judging([(route, settings.algorithm) for route in routes()])
                    ),
                )  # fmt: skip
            found = [(route, settings.algorithm) for route in improved.routes]
            evaluations += improved.evaluations
            interrupted = improved.interrupted
        if tuned is not None and effort.budget_s is not None and not interrupted:
            until = min(effort.now() + late_s, started + effort.budget_s - order_s)
            with times.stage("lines left", FRACTIONS.late_lines):
                baselines += taken(tuned, lambda: should_stop() or effort.now() > until)
            constructed = _named(_worth_showing(baselines, goal))
        with times.stage("judging baselines", FRACTIONS.judging_baselines):
            reference = finish.judged_baselines(constructed)
        made = finish.worth_judging(found)
    members: list[RouteMember] = []
    with times.stage("judging routes", FRACTIONS.judging):
        # Of a stage that is interrupted the routes that were found are known, and what was judged beside them.
        for part in (made[: len(found)], made[len(found) :]):
            members += judge_members(fine, part, executor)
            so_far.judged = [*members, *reference]
    with times.stage("choice and repairs", FRACTIONS.order if in_several else None):
        chosen = choose(
            fine, settings, rule, (*members, *reference), executor=executor, interrupted=interrupted,
            is_over=(lambda: effort.is_over(started, fraction=FRACTIONS.simplified_until)) if fraction < 1.0 else None,
            order=_order_effort(effort, started, settings.seed, should_stop) if in_several and not interrupted else None,
        )  # fmt: skip
    kept.close([*(each.route for each in constructed), *made, *chosen.simpler])
    return Plan(
        chosen=chosen.route,
        members=chosen.pareto,
        baselines=tuple(reference),
        rule=rule.text,
        rule_met=chosen.rule_met,
        algorithm=algorithm,
        evaluations=evaluations,
        wall_s=effort.now() - started,
        interrupted=interrupted,
    )


def _lines(
    coarse: CoverageMap, straight: SwathLayout | None, required: float | None, run: SearchRun
) -> list[NamedRoute]:
    """Lines as initial solutions of the local search, in the direction of the best straight ones, as time permits."""
    site, budget_s, now = coarse.site, run.effort.budget_s, run.effort.now
    angle = long_side_angle_rad(site.area) if straight is None else straight.angle_rad
    until = now() + FRACTIONS.bent_lines * (math.inf if budget_s is None else budget_s)
    lines = first_lines(site, angle, run.executor, lambda: run.should_stop() or now() > until)
    if budget_s is not None and not any_reaches(coarse, lines, required):
        lines += one_line_more(site, angle)
    return lines


def _named(baselines: Sequence[Baseline]) -> list[Candidate]:
    return [Candidate((each.route, each.name), each.objectives, each.violation) for each in baselines]


def _takes_too_long(round_s: float, baselines: Sequence[Baseline], effort: Effort, fraction: float) -> bool:
    """Whether one round of the optimizer would take longer than the whole local search that has an initial solution."""
    feasible = any(each.violation <= 0.0 for each in baselines)
    return feasible and effort.budget_s is not None and round_s > fraction * effort.budget_s


def _candidates(optimizer: AskAndTell, encoding: Encoding, scale: FloatArray | None, name: str) -> list[Candidate]:
    """Routes of an optimizer's Pareto set; none before its first round."""
    if scale is None:
        return []
    found = optimizer.pareto_set()
    violations = found.violations.sum(axis=1)
    return [
        Candidate((encoding.decode(genes), name), values * scale, float(violation))
        for genes, values, violation in zip(found.x, found.objectives, violations, strict=True)
    ]


def _shared(effort: Effort, fraction: float, started: float) -> Effort:
    """A fraction of the evaluations, or of the time, from now on."""
    budget_s = None if effort.budget_s is None else effort.now() - started + fraction * effort.budget_s
    return dataclasses.replace(effort, evaluations=int(fraction * effort.evaluations), budget_s=budget_s)


def _order_effort(effort: Effort, started: float, seed: int, should_stop: Callable[[], bool]) -> OrderEffort:
    """Effort for the order of several sorties: the rest of a time budget, else a number for each evaluation."""
    tries = tries_of(effort.evaluations)
    if effort.budget_s is None:
        return OrderEffort(tries, seed, should_stop=should_stop)
    begin, until = effort.now(), started + effort.budget_s
    length_s = max(until - begin, 1e-9)
    return OrderEffort(tries, seed, lambda: (effort.now() - begin) / length_s if until > begin else 1.0, should_stop)


def _encoding(
    site: Site, settings: PlannerSettings, baselines: Sequence[Baseline], goal: float | None
) -> tuple[Encoding, FloatArray | None]:
    """The encoding, and the constructed routes that its first population begins with."""
    count = max(1, int(CONSTRUCTED_FRACTION * settings.population_size))
    ranked = _by_merit(baselines, goal)
    if settings.encoding == "waypoints":
        origin = np.zeros(3) if site.home_m is None else site.home_m
        points = WaypointEncoding(site, capacity=settings.capacity, order=settings.order, reference_m=origin)
        rows = [points.near(b.route) for b in ranked if len(b.route) <= settings.capacity][:count]
        return points, np.array(rows) if rows else None
    layouts = [b.layout for b in ranked if b.layout is not None]
    swaths = SwathEncoding(site, centre=layouts[0])
    return swaths, np.array([swaths.near(layout) for layout in layouts[:count]])


def _by_merit(baselines: Sequence[Baseline], goal: float | None) -> list[Baseline]:
    """Feasible first; then those that reach the required coverage, by length; then the others, by coverage."""
    required = 1.0 if goal is None else goal
    return sorted(baselines, key=lambda b: (b.violation, max(0.0, required + b.objectives[0]), b.objectives[2]))


def _worth_showing(baselines: Sequence[Baseline], goal: float | None) -> list[Baseline]:
    """Each method's route; of tuned lines of each kind, a thinned set of those that no other dominates."""
    several = (TUNED, RETURNING, TUNED_CONTOURS, cut_lines.NAME)
    others = [b for b in baselines if b.name not in several]
    kinds = [[b for b in baselines if b.name == name and b.violation <= 0.0] for name in several]
    return others + [b for kind in kinds if kind for b in _thinned(kind, goal)]


def _thinned(tuned: Sequence[Baseline], goal: float | None) -> list[Baseline]:
    mask = non_dominated_mask(np.array([b.objectives for b in tuned]), np.zeros(len(tuned)))
    best = [b for b, keep in zip(tuned, mask, strict=True) if keep]
    if len(best) > _MOST_TUNED:
        values = np.array([b.objectives for b in best])
        first = _by_merit(best, goal)[0]
        best = [first, *(best[k] for k in least_crowded(values, _MOST_TUNED) if best[k] is not first)]
    return _by_merit(best, goal)
