"""Who takes part: planners that get a budget and a seed, and constructions that need neither."""

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from uavcover.benchmarks.coverage.cases import Case
from uavcover.benchmarks.coverage.judging import Judge
from uavcover.benchmarks.coverage.line_scan import Tried, scan
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import InfeasibleError
from uavcover.model.scenario import InitialRoute, PlannerAlgorithm
from uavcover.planning.baselines import plain_boustrophedon
from uavcover.planning.initial_routes import constructed_routes
from uavcover.planning.node_rows import fly_rows, plain_rows
from uavcover.planning.planner import Effort, plan_routes
from uavcover.planning.set_cover.programs import SolverEffort
from uavcover.planning.snapshots import NamedRoute, Snapshots
from uavcover.planning.swaths import fly_layout
from uavcover.site import Site

PLANNERS: tuple[PlannerAlgorithm, ...] = ("memetic", "imodbo", "modbo", "nsga2", "moead")
"""The planners by name; the first is ours, the others are plain optimizers: only what they found themselves counts for them."""

OURS = PLANNERS[0]

_SOLVER_S = 120.0
"""What the exact set cover may take; on large scenarios it then is the best that was found."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a contender found.

    Attributes:
        moments: the routes worth judging, by processor time; under the key of the last moment what it ended with.
        evaluations: full evaluations that were spent.
        cpu_s: processor time that it took, judging by itself included.
        tried: every boustrophedon, for a scan.
    """

    moments: dict[float, tuple[NamedRoute, ...]]
    evaluations: int
    cpu_s: float
    tried: tuple[Tried, ...] = ()


def plan_for(
    site: Site, case: Case, algorithm: PlannerAlgorithm, *, seed: int, evaluations: int, moments_s: Sequence[float]
) -> Found:
    """A planner's run on one core; the clock is the process's own processor time, so that other work does not count.

    Args:
        site: the scenario on its ground.
        case: has the rule.
        algorithm: one of PLANNERS.
        seed: of every random number.
        evaluations: how many, when no moments are given.
        moments_s: when to look; the last one is the budget.
    """
    settings = dataclasses.replace(site.scenario.planner, algorithm=algorithm, seed=seed, evaluations=evaluations)
    budget_s = max(moments_s, default=None)
    snapshots = Snapshots(moments_s[:-1])
    begin = time.process_time()
    effort = Effort(evaluations, budget_s, time.process_time)
    spent = 0
    try:
        plan = plan_routes(site, settings=settings, select_rule=case.rule, effort=effort, snapshots=snapshots)
        spent = plan.evaluations
    except InfeasibleError:
        pass  # a rival that finds no route within the limits has found nothing: its moments say so
    cpu_s = time.process_time() - begin
    last_s = cpu_s if budget_s is None else budget_s
    routes = {**snapshots.taken, last_s: snapshots.last}
    if algorithm != OURS:
        routes = {at: tuple(item for item in found if item[1] == algorithm) for at, found in routes.items()}
    return Found(routes, spent, cpu_s)


def _plain(judge: Judge) -> Found:
    site = judge.site
    begin = time.process_time()
    if site.scenario.sensor.sensing == "along-path":
        route = fly_layout(site, plain_boustrophedon(site))
    else:
        route = fly_rows(site, plain_rows(site))
    cpu_s = time.process_time() - begin
    return Found({cpu_s: ((route, "boustrophedon"),)}, 1, cpu_s)


def _tuned(judge: Judge) -> Found:
    begin = time.process_time()
    tried, routes = scan(judge)
    cpu_s = time.process_time() - begin
    return Found({cpu_s: tuple(routes)}, len(routes), cpu_s, tuple(tried))


def _set_cover(name: InitialRoute) -> Callable[[Judge], Found]:
    def make(judge: Judge) -> Found:
        site = judge.site
        coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
        settings = dataclasses.replace(site.scenario.planner, initial=(name,), seed=1)
        begin = time.process_time()
        made = constructed_routes(
            coarse, settings, asked=judge.case.asked, solver=SolverEffort(time_s=_SOLVER_S), executor=None,
            should_stop=lambda: False,
        )  # fmt: skip
        cpu_s = time.process_time() - begin
        # Lines are made beside a cover where they are the encoding; here they are a baseline of their own.
        routes = tuple((one.route, one.name) for one in made if one.name == name)
        return Found({cpu_s: routes}, len(routes), cpu_s)

    return make


CONSTRUCTIONS: Final = MappingProxyType[str, Callable[[Judge], Found]](
    {
        "boustrophedon": _plain,
        "boustrophedon-tuned": _tuned,
        "greedy-set-cover": _set_cover("greedy-set-cover"),
        "set-cover": _set_cover("set-cover"),
        "exact-set-cover": _set_cover("exact-set-cover"),
    }
)
"""Baselines that need no random numbers, each run once and for as long as it takes."""

CONTENDERS: Final = (*CONSTRUCTIONS, *PLANNERS)
"""The names of all, baselines first."""
