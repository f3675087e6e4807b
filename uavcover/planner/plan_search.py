"""The search for a plan."""

import dataclasses
import logging
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, get_args

from uavcover.errors import InputError
from uavcover.model.route import Plan
from uavcover.model.scenario import PlannerAlgorithm, PlannerSettings
from uavcover.model.vehicle import autopilot_name
from uavcover.optimizers.by_name import ALGORITHMS
from uavcover.planner.fleet_parts import plan_parts
from uavcover.planner.kept_parts import KeptParts
from uavcover.planner.memory import at_a_time_within, in_words, memory_need, parts_within
from uavcover.planner.mission_sizes import with_sizes
from uavcover.planner.part_workers import part_searchers
from uavcover.planner.parts.planner import most_parts, part_count, plan_by_parts, require_parts
from uavcover.planner.planner import Effort, SearchProgress, plan_routes
from uavcover.planner.search.optimizer_search import SearchRun
from uavcover.run.scheduling import local_count
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_parts import groups_of

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchRequest:
    """Request of a search.

    None is taken from the scenario.

    Attributes:
        seed: of every random number.
        evaluations: full route evaluations, 50 proposals of the local search counted as one; equal seed and evaluations
            give an equal plan.
        budget_s: search this long instead.
        algorithm: "memetic", "local-search", "imodbo", "modbo", "nsga2", "moead", "lines" or "contour-lines"; or another
            optimizer: a name or ``module:Class`` that :func:`uavcover.optimizers.optimizer_class` finds, or the class itself.
        max_waypoints: of the routes, or of the nodes where the encoding is "waypoints".
        select: the rule by which one route is chosen.
        parts: into how many parts a large area is divided, or "auto"; see :class:`uavcover.model.scenario.PlannerSettings`.
        workers: threads; the result does not depend on it. None: one a core.
        scheduler: who searches in the parts, see :func:`uavcover.run.scheduling.workers_of`; the result does not depend on it.
            None: threads.
        memory_bytes: what planning may take here, in all processes together: a large area is divided into more parts, and fewer
            are searched at a time, as far as that needs it. None: no limit.
        autopilot: for whom the missions are.
    """

    seed: int | None = None
    evaluations: int | None = None
    budget_s: float | None = None
    algorithm: str | type | None = None
    max_waypoints: int | None = None
    select: str | None = None
    parts: int | Literal["auto"] | None = None
    workers: int | None = None
    scheduler: str | None = None
    memory_bytes: int | None = None
    autopilot: str | None = None


def plan(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[SearchProgress], None] = lambda _: None,
    kept: KeptParts | None = None,
) -> Plan:
    """Plan the sensing route; of vehicles that have parts of the area, the route of each part.

    Args:
        site: the scenario on its ground.
        request: how to search.
        should_stop: asked after every round of the search; the best so far is returned.
        on_progress: called after every round.
        kept: where the routes of parts are kept as they are found, for a process that goes on after this one.

    Raises:
        InfeasibleError: no route keeps the limits.
        InputError: a value of the request is out of range.
        OptimizerError: the optimizer cannot be found, is none, or fails.
    """
    found = _search(site, request, should_stop=should_stop, on_progress=on_progress, kept=kept)
    return with_sizes(site, found, autopilot=autopilot_name(request.autopilot, site.scenario.vehicle.autopilot))


def _search(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool],
    on_progress: Callable[[SearchProgress], None],
    kept: KeptParts | None,
) -> Plan:
    """The Pareto set and the choice."""
    if not groups_of(site.scenario):
        return _plan_one(site, request, should_stop=should_stop, on_progress=on_progress, kept=kept)
    settings = site.scenario.planner
    total, done = request.evaluations or settings.evaluations, 0

    def search(own: Site, share: float, rule: str) -> Plan:
        nonlocal done
        before = done
        evaluations = max(settings.population_size, round(share * total))
        budget_s = None if request.budget_s is None else share * request.budget_s
        asked = dataclasses.replace(request, evaluations=evaluations, budget_s=budget_s, select=rule)

        def tell(progress: SearchProgress) -> None:
            on_progress(dataclasses.replace(progress, evaluations=before + progress.evaluations, total=total))

        plan = _plan_one(own, asked, should_stop=should_stop, on_progress=tell, kept=kept)
        done += evaluations
        return plan

    rule = request.select if request.select is not None else site.scenario.select
    return plan_parts(site, select_rule=rule, search=search)


def _plan_one(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool],
    on_progress: Callable[[SearchProgress], None],
    kept: KeptParts | None,
) -> Plan:
    """Plan one route over the area of a site."""
    algorithm, budget_s, workers = request.algorithm, request.budget_s, request.workers
    planners = get_args(PlannerAlgorithm)
    known = algorithm is None or algorithm in planners
    if not known and isinstance(algorithm, str) and ":" not in algorithm and algorithm not in ALGORITHMS:
        raise InputError(
            f"algorithm: {algorithm!r} is not one of {', '.join(planners)}; nor one of the optimizers "
            f"{', '.join(name for name in ALGORITHMS if name not in planners)}; nor module:Class"
        )
    # Another optimizer stands in the place of a plain one.
    settings = _settings(site.scenario.planner, request, algorithm=algorithm if known else "imodbo")
    if budget_s is not None and not budget_s > 0.0:
        raise InputError(f"budget: {budget_s} s must be above 0")
    if workers is not None and workers < 1:
        raise InputError(f"workers: {workers} must be at least 1")
    division = _division(site, settings, request)
    if division.parts > 1 and not known:
        raise InputError(f"parts: {settings.parts} requires the planner's own local search, not another optimizer")
    if request.scheduler is not None and settings.parts == 1 and division.parts == 1:
        raise InputError("--scheduler: distributes the parts of a large area; give --parts N or --parts auto with it")
    with ThreadPoolExecutor(division.threads) as executor:
        if division.parts > 1:
            with part_searchers(division.scheduler, executor, threads=division.threads, should_stop=should_stop) as (
                search,
                look,
                at_a_time,
            ):
                return plan_by_parts(
                    site,
                    parts=division.parts,
                    settings=settings,
                    select_rule=request.select if request.select is not None else site.scenario.select,
                    run=SearchRun(
                        effort=Effort(settings.evaluations, budget_s, time.monotonic),
                        started=time.monotonic(),
                        executor=executor,
                        should_stop=should_stop,
                        on_progress=on_progress,
                    ),
                    run_tasks=search if kept is None else kept.before(search, is_whole=lambda: not should_stop()),
                    run_blocks=look,
                    workers=at_a_time,
                    or_sorties=settings.parts in (1, "auto"),
                )
        if request.scheduler is not None:
            _log.warning("--scheduler: the area is small and planned in one piece, in this process")
        return plan_routes(
            site,
            settings=settings,
            select_rule=request.select if request.select is not None else site.scenario.select,
            effort=Effort(settings.evaluations, budget_s, time.monotonic),
            executor=executor,
            should_stop=should_stop,
            on_progress=on_progress,
            own=None if known else algorithm,
        )


@dataclass(frozen=True, slots=True)
class _Division:
    """Number of parts of an area, and their workers."""

    parts: int
    threads: int
    scheduler: str | None


def _division(site: Site, settings: PlannerSettings, request: SearchRequest) -> _Division:
    """The requested division, within the memory limit."""
    threads, scheduler = request.workers or os.cpu_count() or 1, request.scheduler
    parts = 1
    if settings.parts != 1:
        require_parts(settings, site)
        parts = part_count(site) if settings.parts == "auto" else settings.parts
    if request.memory_bytes is None:
        return _Division(parts, threads, scheduler)
    processes = None if scheduler is None else local_count(scheduler)
    if scheduler is not None and processes is None:
        raise InputError(
            f"--memory: limits this machine, not the workers of {scheduler} are not; limit them there, with: "
            "dask worker --memory-limit"
        )
    need = memory_need(site, processes=scheduler is not None)
    given = request.parts not in (None, "auto")
    within = parts_within(need, request.memory_bytes, parts=parts, most_parts=most_parts(site), given=given)
    if within > 1:
        require_parts(settings, site)
    at_a_time = at_a_time_within(need, request.memory_bytes, parts=within, workers=processes or threads)
    _log.info(
        "--memory: %d %s, %d at a time, about %s", within, "parts" if within > 1 else "part", at_a_time,
        in_words(need.total(within, at_a_time)),
    )  # fmt: skip
    if processes is None:
        return _Division(within, min(threads, at_a_time), None)
    return _Division(within, threads, f"local:{at_a_time}")


def _settings(base: PlannerSettings, request: SearchRequest, *, algorithm: str | type | None) -> PlannerSettings:
    changes: dict[str, Any] = {
        "seed": request.seed,
        "evaluations": request.evaluations,
        "algorithm": algorithm,
        "max_waypoints": request.max_waypoints,
        "parts": request.parts,
    }
    try:
        return dataclasses.replace(base, **{key: value for key, value in changes.items() if value is not None})
    except ValueError as error:
        raise InputError(str(error)) from error
