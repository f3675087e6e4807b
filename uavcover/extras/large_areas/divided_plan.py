"""The division of a request, within its limit of memory, and its plan: parts are searched by threads or a scheduler's workers.

It provides :class:`uavcover.planner.plan_search.LargeAreas`.
"""

import dataclasses
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from uavcover.errors import InputError
from uavcover.extras.large_areas.kept_parts import KeptParts
from uavcover.extras.large_areas.memory import at_a_time_within, in_words, memory_need, parts_within
from uavcover.extras.large_areas.part_search import PartTask, search_part
from uavcover.extras.large_areas.plan_by_parts import (
    RunTasks,
    most_parts,
    part_count,
    plan_by_parts,
    require_parts,
    search_parts_with,
)
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Plan
from uavcover.model.scenario import PlannerSettings
from uavcover.planner.plan_search import Division, SearchRequest
from uavcover.planner.planner import Effort, SearchProgress
from uavcover.planner.search.optimizer_search import SearchRun
from uavcover.run.scheduling import Workers, local_count, workers_of
from uavcover.scenario.site import Site
from uavcover.sensing.block_map import BlockLook, BlockTask, RunBlocks, look_at_block

_log = logging.getLogger(__name__)


def divided(site: Site, settings: PlannerSettings, request: SearchRequest) -> Division:
    """The requested division, within the memory limit.

    Raises:
        InputError: the scenario cannot be planned by parts, or needs more memory.
    """
    threads, scheduler = request.workers or os.cpu_count() or 1, request.scheduler
    parts = 1
    if settings.parts != 1:
        require_parts(settings, site)
        parts = part_count(site) if settings.parts == "auto" else settings.parts
    if request.memory_bytes is None:
        return Division(parts, threads, scheduler)
    processes = None if scheduler is None else local_count(scheduler)
    if scheduler is not None and processes is None:
        raise InputError(
            f"--memory: this limits only this machine; limit the workers of {scheduler} with: dask worker "
            "--memory-limit"
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
        return Division(within, min(threads, at_a_time), None)
    return Division(within, threads, f"local:{at_a_time}")


def plan_divided(
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
    """Plan a site by its parts: see :func:`uavcover.extras.large_areas.plan_by_parts.plan_by_parts`."""
    with (
        ThreadPoolExecutor(division.threads) as executor,
        part_searchers(division.scheduler, executor, threads=division.threads, should_stop=should_stop) as (
            search,
            look,
            at_a_time,
        ),
    ):
        return plan_by_parts(
            site,
            parts=division.parts,
            settings=settings,
            select_rule=select_rule,
            run=SearchRun(
                effort=effort,
                started=effort.now(),
                executor=executor,
                should_stop=should_stop,
                on_progress=on_progress,
            ),
            run_tasks=search if kept is None else KeptParts(kept).before(search, is_whole=lambda: not should_stop()),
            run_blocks=look,
            workers=at_a_time,
            or_sorties=or_sorties,
        )


@contextmanager
def part_searchers(
    scheduler: str | None, executor: Executor, *, threads: int, should_stop: Callable[[], bool]
) -> Iterator[tuple[RunTasks, RunBlocks, int]]:
    """Functions that search the parts and judge a large area block by block, and their number at a time.

    Args:
        scheduler: see :func:`uavcover.run.scheduling.workers_of`; none: threads.
        executor: those threads.
        threads: how many there are.
        should_stop: whether the user wants the best there is.
    """
    if scheduler is None:
        yield (
            search_parts_with(executor, now=time.monotonic, should_stop=should_stop),
            look_with(executor),
            min(threads, os.cpu_count() or 1),
        )
        return
    with workers_of(scheduler) as workers:
        yield search_parts_on(workers, should_stop=should_stop), look_on(workers), workers.count


def search_parts_on(workers: Workers, *, should_stop: Callable[[], bool]) -> RunTasks:
    """Search in the parts by workers. When the user ends the search, unfinished parts return their incumbent at once."""

    def run(site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, FloatArray]]:
        left = {task.number: task for task in tasks}
        # A copy of the site has nothing that can be computed again.
        done = workers.completed(_search, dataclasses.replace(site), tasks, should_stop=should_stop)
        for task, route_m in done:
            del left[task.number]
            yield task, route_m
        yield from search_parts_with(None, now=time.monotonic, should_stop=should_stop)(site, list(left.values()))

    return run


def look_with(executor: Executor) -> RunBlocks:
    """Look at blocks of a large area by threads."""

    def run(site: Site, tasks: Sequence[BlockTask]) -> Iterator[tuple[BlockTask, BlockLook]]:
        return zip(tasks, executor.map(lambda task: look_at_block(site, task), tasks), strict=True)

    return run


def look_on(workers: Workers) -> RunBlocks:
    """Evaluate blocks of a large area by workers, even if the user has ended the search: a plan requires it."""

    def run(site: Site, tasks: Sequence[BlockTask]) -> Iterator[tuple[BlockTask, BlockLook]]:
        return workers.completed(look_at_block, dataclasses.replace(site), tasks)

    return run


def _search(site: Site, task: PartTask) -> FloatArray:
    return search_part(site, task, now=time.monotonic, should_stop=lambda: False).waypoints_m
