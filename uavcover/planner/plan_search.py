"""The search for a plan."""

import dataclasses
import logging
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, cast, get_args

from uavcover.errors import InfeasibleError, InputError, ScenarioError
from uavcover.model.route import Plan
from uavcover.model.scenario import PlannerAlgorithm, PlannerSettings
from uavcover.model.vehicle import autopilot_name
from uavcover.optimizers import ALGORITHMS
from uavcover.planner.budget import FRACTIONS, CommandTime, StageTimes
from uavcover.planner.fleet_areas import is_one_flight_each, plan_by_area
from uavcover.planner.fleet_parts import plan_parts
from uavcover.planner.planner import Effort, SearchProgress, plan_in_time
from uavcover.planner.selection_rule import parse_rule, with_sizes
from uavcover.plugins import loaded
from uavcover.run.user import StopRequests
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of, on_pads
from uavcover.sensing.site_maps import in_blocks, with_maps_of

_log = logging.getLogger(__name__)

_LEAST_SEARCH_S = 1e-3
"""Time of a search that starts after its deadline: it takes the first route."""
_LEAST_S, _LEAST_EACH_S = 6.0, 1.5
"""Least time to divide a fleet's area: in total, and per vehicle. With less, one route is found sooner."""
_LEAST_LEFT = 0.66
"""Least fraction of the time, after what the whole area took to prepare: that of each vehicle takes a part of it again."""
_SEVERAL_S, _SEVERAL_EVALUATIONS = 4.0, 300
"""Least time and evaluations per vehicle to divide it more than once."""
_ARRANGING_S = 0.6
"""Time of each vehicle in which flights are arranged after the search."""
_PART_EVALUATIONS = 1.75
"""Evaluations on a vehicle's part that take as long as one on the whole area."""
_ANOTHER_SEED = 1_000_003
_LATE = 1.04
"""After this number of budgets a search ends with what it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchRequest:
    """Request of a search. None: the scenario's value."""

    seed: int | None = None  # of every random number
    # full route evaluations, 50 proposals of the local search counted as one; equal seed and evaluations give an equal
    # plan
    evaluations: int | None = None
    budget_s: float | None = None  # search this long instead
    # "memetic", "local-search", "imodbo", "modbo", "nsga2", "moead", "lines" or "contour-lines"; or another optimizer:
    # a name or ``module:Class`` that :func:`uavcover.optimizers.optimizer_class` finds, or the class itself
    algorithm: str | type | None = None
    max_waypoints: int | None = None  # of the routes, or of the nodes where the encoding is "waypoints"
    select: str | None = None  # the rule by which one route is chosen
    # number of parts of a large area, or "auto"; see :class:`uavcover.model.scenario.PlannerSettings`
    parts: int | Literal["auto"] | None = None
    workers: int | None = None  # threads; the result does not depend on it. None: one a core.
    # the scheduler that searches the parts, see :func:`uavcover.run.scheduling.workers_of`; the result does not depend on it.
    # None: threads.
    scheduler: str | None = None
    # memory limit of all local processes together. It may divide a large area into more parts, and search fewer at a time.
    # None: no limit.
    memory_bytes: int | None = None
    autopilot: str | None = None  # for whom the missions are
    # start of the command to which the budget applies, by the monotonic clock; None: start of the search
    begun_s: float | None = None


@dataclass(frozen=True, slots=True)
class Division:
    """Number of parts of an area, the threads that search, and the scheduler that is used instead, if any."""

    parts: int
    threads: int
    scheduler: str | None


class LargeAreas(Protocol):
    """Interface of an entry of the group ``uavcover.large_areas``."""

    def divided(self, site: Site, settings: PlannerSettings, request: SearchRequest) -> Division:
        """The requested division, within the memory limit."""
        ...

    def plan_divided(
        self,
        site: Site,
        division: Division,
        settings: PlannerSettings,
        effort: Effort,
        *,
        select_rule: str,
        should_stop: Callable[[], bool],
        on_progress: Callable[[SearchProgress], None],
        kept: Path | None,
        or_sorties: bool,
    ) -> Plan:
        """Plan a site in more than one part; ``or_sorties``: a part may be one flight if that is better."""
        ...


def plan(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[SearchProgress], None] = lambda _: None,
    kept: Path | None = None,
) -> Plan:
    """Plan the sensing route; for vehicles with parts of the area, one route for each part.

    Args:
        site: the scenario on its ground.
        request: settings of the search.
        should_stop: called after every round of the search; the best route so far is returned.
        on_progress: called after every round.
        kept: folder for finished routes of parts, for a later process that continues.

    Raises:
        InfeasibleError: no route keeps the limits.
        InputError: a value of the request is out of range.
        OptimizerError: the optimizer cannot be found, is invalid, or fails.
    """
    return plan_and_site(site, request, should_stop=should_stop, on_progress=on_progress, kept=kept)[0]


def plan_and_site(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool],
    on_progress: Callable[[SearchProgress], None],
    kept: Path | None,
    stops: StopRequests | None = None,
) -> tuple[Plan, Site]:
    """As :func:`plan`; also return the site, which is divided into blocks if a large area was planned in parts.

    ``stops`` ends a search that exceeds its time by too much.
    """
    autopilot = autopilot_name(request.autopilot, site.scenario.vehicle.autopilot)
    if request.budget_s is not None and not request.budget_s > 0.0:
        raise InputError(f"budget: must be greater than 0, not {request.budget_s} s")
    begun_s = time.monotonic() if request.begun_s is None else request.begun_s
    limit = CommandTime(begun_s=begun_s, budget_s=request.budget_s, should_stop=should_stop)
    given_s = request.budget_s or math.inf
    if request.budget_s is not None:
        left_s = begun_s + (1.0 - FRACTIONS.sizes) * request.budget_s - time.monotonic()
        request = dataclasses.replace(request, budget_s=max(left_s, _LEAST_SEARCH_S))
    settings = site.scenario.planner
    seed = settings.seed if request.seed is None else request.seed
    total, done = request.evaluations or settings.evaluations, 0

    def search(own: Site, fraction: float, rule: str, again: int = 0) -> Plan:
        nonlocal done
        before = done
        evaluations = max(settings.population_size, round(fraction * total))
        budget_s = None if request.budget_s is None else fraction * request.budget_s
        requested = dataclasses.replace(
            request, evaluations=evaluations, budget_s=budget_s, select=rule, seed=seed + again * _ANOTHER_SEED
        )

        def tell(progress: SearchProgress) -> None:
            on_progress(dataclasses.replace(progress, evaluations=before + progress.evaluations, total=total))

        plan, _ = _plan_one(own, requested, should_stop=should_stop, on_progress=tell, kept=kept, stops=stops)
        done += evaluations
        return plan

    def sized(found: Plan, on: Site) -> tuple[Plan, Site]:
        with StageTimes(time.monotonic, limit.budget_s).stage("mission sizes", FRACTIONS.sizes):
            return with_sizes(on, found, autopilot=autopilot, limit=limit), on

    rule = request.select if request.select is not None else site.scenario.select
    if groups_of(site.scenario):
        return sized(plan_parts(site, select_rule=rule, search=search), site)
    padded, required = with_maps_of(site, on_pads(site)), parse_rule(rule).required_coverage
    vehicles, budget_s = padded.scenario.fleet.vehicles, request.budget_s
    each_s = math.inf if budget_s is None else budget_s / vehicles
    if (
        required is not None
        and each_s >= max(_LEAST_EACH_S, _LEAST_S / vehicles)
        and (budget_s is None or budget_s >= _LEAST_LEFT * given_s)
        and _may_be_allocated(padded, request, rule)
    ):
        several = each_s >= _SEVERAL_S and total >= _SEVERAL_EVALUATIONS * vehicles
        efforts = FRACTIONS.fleet_parts if several else (1.0 - FRACTIONS.fleet_whole,)
        if budget_s is not None:
            request = dataclasses.replace(request, budget_s=budget_s - _ARRANGING_S * vehicles)
        try:
            total = round(_PART_EVALUATIONS * total)
            shared = plan_by_area(padded, rule=rule, required=required, search=search, efforts=efforts)
        except (InfeasibleError, ScenarioError) as error:
            _log.info("no plan by parts of the area: %s", error)
            shared = None
        if shared is not None and (found := sized(*shared))[0].chosen.mission is not None:
            return found
        if budget_s is not None:
            request = dataclasses.replace(request, budget_s=FRACTIONS.fleet_whole * budget_s)
    whole, judged = _plan_one(site, request, should_stop=should_stop, on_progress=on_progress, kept=kept, stops=stops)
    return sized(whole, padded if judged is site else on_pads(judged))


def _may_be_allocated(site: Site, request: SearchRequest, rule: str) -> bool:
    """Whether to divide a fleet's area among its vehicles before the search.

    The vehicles must differ only in their homes, and one flight each must suffice. Otherwise, or if the rule names no coverage or
    limits the mission, one route is planned and split.
    """
    scenario = site.scenario
    kinds = {dataclasses.replace(each, home=None, link=None, system_id=None) for each in scenario.vehicles}
    if len(kinds) != 1 or scenario.fleet.one_at_a_time or site.frame is None or parse_rule(rule).conditions:
        return False
    one_piece = _division(site, _settings(scenario.planner, request, algorithm=None), request).parts == 1
    return one_piece and is_one_flight_each(site)


def _plan_one(
    site: Site,
    request: SearchRequest,
    *,
    should_stop: Callable[[], bool],
    on_progress: Callable[[SearchProgress], None],
    kept: Path | None,
    stops: StopRequests | None = None,
) -> tuple[Plan, Site]:
    """Plan one route over the area of a site, and return the site on which it was evaluated."""
    algorithm, budget_s, workers = request.algorithm, request.budget_s, request.workers
    planners = get_args(PlannerAlgorithm)
    known = algorithm is None or algorithm in planners
    if not known and isinstance(algorithm, str) and ":" not in algorithm and algorithm not in ALGORITHMS:
        raise InputError(
            f"algorithm: unknown algorithm {algorithm!r}; use {', '.join(planners)}, one of the optimizers "
            f"{', '.join(name for name in ALGORITHMS if name not in planners)}, or module:Class"
        )
    # Another optimizer replaces a plain one.
    settings = _settings(site.scenario.planner, request, algorithm=algorithm if known else "imodbo")
    if workers is not None and workers < 1:
        raise InputError(f"workers: must be at least 1, not {workers}")
    rule = request.select if request.select is not None else site.scenario.select
    division = _division(site, settings, request)
    if division.parts > 1 and not known:
        raise InputError(f"parts: {settings.parts} parts require local search; change algorithm, or set it to 1")
    if request.scheduler is not None and settings.parts == 1 and division.parts == 1:
        raise InputError("--scheduler distributes the parts of a large area; add --parts N or --parts auto")
    if division.parts > 1:
        site = in_blocks(site)
        result = _large_areas("planner.parts").plan_divided(
            site,
            division,
            settings,
            Effort(settings.evaluations, budget_s, time.monotonic),
            select_rule=rule,
            should_stop=should_stop,
            on_progress=on_progress,
            kept=kept,
            or_sorties=settings.parts in (1, "auto"),
        )
        return result, site
    if request.scheduler is not None:
        _log.warning("--scheduler has no effect: the area is small and is planned as one part in this process")
    latest_s = math.inf if budget_s is None else _LATE * budget_s

    def no_longer_than(ready: Callable[[], bool]) -> AbstractContextManager[None]:
        return nullcontext() if stops is None else stops.no_longer_than(latest_s, ready)

    executor = ThreadPoolExecutor(division.threads)
    try:
        result = plan_in_time(
            site,
            settings=settings,
            select_rule=rule,
            effort=Effort(settings.evaluations, budget_s, time.monotonic),
            executor=executor,
            should_stop=should_stop,
            on_progress=on_progress,
            own=None if known else algorithm,
            no_longer_than=no_longer_than,
        )
    except InfeasibleError as error:
        if budget_s is None or should_stop():
            raise
        raise InfeasibleError(f"{error}, or use a larger --budget") from error
    finally:
        # If the search was ended from outside, some of its work may still be running or waiting.
        executor.shutdown(wait=False, cancel_futures=True)
    return result, site


def _division(site: Site, settings: PlannerSettings, request: SearchRequest) -> Division:
    """One piece with all threads, unless the request sets parts, workers or a memory limit."""
    if settings.parts == 1 and request.memory_bytes is None:
        return Division(1, request.workers or os.cpu_count() or 1, request.scheduler)
    option = "planner.parts" if settings.parts != 1 else "--memory"
    return _large_areas(option).divided(site, settings, request)


def _large_areas(option: str) -> LargeAreas:
    """The extra that plans by parts.

    Raises:
        InputError: it is not installed.
    """
    for large_areas in loaded("uavcover.large_areas").values():
        return cast(LargeAreas, large_areas)
    raise InputError(f"{option}: the extra large_areas is not installed; reinstall uavcover with its extras")


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
