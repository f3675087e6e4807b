"""The division of a request, within its limit of memory, and its plan: parts are searched by threads or a scheduler's workers.

It provides :class:`uavcover.planner.plan_search.LargeAreas`.
"""

import dataclasses
import hashlib
import io
import json
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import InputError
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
from uavcover.run.file_group import remove_half_written, write_file
from uavcover.run.provenance import program
from uavcover.run.scheduling import Workers, can_share_files, local_count, workers_of
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import BlockLook, BlockTask, RunBlocks, is_large, look_at_block

# Finished routes of parts, kept in the run folder, so that a plan continues after its process was killed.
#
# The search in a part is a function of its task, of the site and of the program alone, and the name of a file is a
# hash of all three. So what is kept is right for any later plan with the same inputs, and is never taken for anything
# else.

_DIGEST_BYTES = 32


class KeptParts:
    """A folder with the routes of parts.

    Attributes:
        path: where it is; made when the first route is kept.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def before(self, run_tasks: RunTasks, *, is_whole: Callable[[], bool]) -> RunTasks:
        """Search function that returns kept routes, has the others searched for, and keeps them.

        Args:
            run_tasks: who searches.
            is_whole: whether what comes now is what the task asks for, and not what there was when the user ended the search.
        """

        def run(site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, FloatArray]]:
            remove_half_written(self.path.glob("*"))
            of_site = _site_sha256(site)
            files = {task.number: self.path / _name(task, of_site) for task in tasks if task.budget_s is None}
            missing = []
            for task in tasks:
                route_m = _read(files[task.number]) if task.number in files else None
                if route_m is None:
                    missing.append(task)
                else:
                    yield task, route_m
            for task, route_m in run_tasks(site, missing):
                if task.number in files and is_whole():
                    _write(files[task.number], route_m)
                yield task, route_m

        return run


def _name(task: PartTask, of_site: str) -> str:
    found = hashlib.sha256(f"{of_site} {json.dumps(program(), sort_keys=True)}".encode())
    _add(found, dataclasses.astuple(task))
    return f"{task.round}-{task.number}-{found.hexdigest()[:32]}.route"


def _site_sha256(site: Site) -> str:
    found = hashlib.sha256(dump_scenario(site.scenario).encode())
    for value in (site.ground.surface, site.bare_ground.surface, site.home_m):
        _add(found, value)
    return found.hexdigest()


def _add(found: Any, value: object) -> None:
    """Add numbers, bytes and arrays to a hash, so that different values give different hashes."""
    if isinstance(value, tuple | list):
        found.update(f"({len(value)}".encode())
        for each in value:
            _add(found, each)
    elif isinstance(value, np.ndarray):
        found.update(f"{value.dtype.str}{value.shape}".encode())
        found.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8))
    elif isinstance(value, bytes):
        found.update(f"b{len(value)}".encode() + value)
    else:
        found.update(f";{value!r};".encode())


def _write(path: Path, route_m: FloatArray) -> None:
    content = io.BytesIO()
    np.save(content, np.ascontiguousarray(route_m), allow_pickle=False)
    write_file(path, hashlib.sha256(content.getvalue()).digest() + content.getvalue())


def _read(path: Path) -> FloatArray | None:
    """A route that was kept; None where there is no whole one."""
    try:
        raw = path.read_bytes()
    except OSError:
        return None
    if len(raw) <= _DIGEST_BYTES or hashlib.sha256(raw[_DIGEST_BYTES:]).digest() != raw[:_DIGEST_BYTES]:
        return None
    route_m: FloatArray = np.load(io.BytesIO(raw[_DIGEST_BYTES:]), allow_pickle=False)
    return route_m


# Memory of a plan, and how a limit is kept: more parts, and fewer of them at a time.
#
# What takes how much was measured, and some added: estimates are 6 to 36 % above what threads take, more with worker
# processes (``scripts/bench/memory.py``, docs/results/large.md). It is estimated from the scenario alone, because the
# number of parts decides what is planned: the same limit gives the same plan.

MIB = 2**20

_PROCESS = 330 * MIB
"""The program with its libraries and compiled code, in the command and in each worker process."""
_NODE = 24
_SHARED_NODE = 8
"""Bytes for each pixel of elevation data as it is read, or as a worker unpacks it; and in a file that all workers map."""
_OF_COMMAND = 420
"""Bytes for each cell of the whole area, in the command: the cells, what routes observe of them, and judging in parallel."""
_OF_LARGE_COMMAND = 60
_OF_BLOCKS = 500 * MIB
"""The same for an area so large that it is judged block by block, and all blocks that are looked at meanwhile."""
_OF_SAMPLE = 600
_SAMPLE_CELLS = 300_000
"""In its place where it is more: bytes for each cell on which lines over the whole area are looked at, and the most of them."""
_OF_PART = 850
_OF_LARGE_PART = 420
"""Bytes for each cell of a part while it is searched; in a large one there are no finer cells."""
_LARGE_PART_CELLS = 150_000
_LEAST_PART_CELLS = 5_000
"""Smaller parts are not made for the sake of memory: their seams would cost more than the rest."""


@dataclass(frozen=True, slots=True)
class MemoryNeed:
    """Approximate memory for planning a site, in bytes."""

    command: float  # the command itself, without searching
    worker: float  # each process beside it, without searching; 0 for threads
    cells: float  # of the whole area, their number

    def of_part(self, parts: int) -> float:
        """Memory of the search in one of this number of equal parts."""
        cells = self.cells / parts
        return max(cells * _OF_LARGE_PART, min(cells, _LARGE_PART_CELLS) * _OF_PART)

    def total(self, parts: int, at_a_time: int) -> float:
        """Memory with this number of parts, of which ``at_a_time`` are searched at a time."""
        return self.command + at_a_time * (self.worker + self.of_part(parts))


def memory_need(site: Site, *, processes: bool) -> MemoryNeed:
    """Memory for planning a site.

    Args:
        site: the scenario on its ground.
        processes: whether parts are searched by processes beside this one, instead of by its threads.
    """
    cells = site.area.area / site.scenario.area.cell_size_m**2
    nodes = site.ground.surface.up_m.size
    whole = max(cells * _OF_COMMAND, min(cells, _SAMPLE_CELLS) * _OF_SAMPLE)
    of_cells = _OF_BLOCKS + cells * _OF_LARGE_COMMAND if is_large(site) else whole
    mapped = processes and can_share_files()
    return MemoryNeed(
        command=_PROCESS + nodes * (_NODE + (_SHARED_NODE if mapped else 0)) + of_cells,
        worker=_PROCESS + nodes * (0 if mapped else _NODE) if processes else 0.0,
        cells=cells,
    )


def parts_within(need: MemoryNeed, limit: int, *, parts: int, most_parts: int, given: bool) -> int:
    """Number of parts of an area for which planning stays within a limit, with any workers.

    Args:
        need: what it takes.
        limit: in bytes, of all processes together.
        parts: how many there would be without the limit.
        most_parts: how many there can be.
        given: whether the user asked for that number.

    Raises:
        InputError: it takes more with any number of parts, or with the requested number.
    """
    if need.total(parts, 1) <= limit:
        return parts
    most = max(parts, min(most_parts, int(need.cells / _LEAST_PART_CELLS)))
    enough = next((count for count in range(parts, most + 1) if need.total(count, 1) <= limit), None)
    if enough is None:
        raise InputError(
            f"--memory: planning {need.cells:,.0f} cells takes at least about {count_text(need.total(most, 1))}; raise "
            "the limit to this amount, or set a larger area.cell_size_m"
        )
    if given:
        raise InputError(
            f"--memory: {parts} {'parts take' if parts > 1 else 'part takes'} about "
            f"{count_text(need.total(parts, 1))}; use --parts {enough} or --parts auto"
        )
    return enough


def at_a_time_within(need: MemoryNeed, limit: int, *, parts: int, workers: int) -> int:
    """Number of workers that may search at the same time; 1 at least."""
    each = need.worker + need.of_part(parts)
    return max(1, min(workers, int((limit - need.command) / each)))


def count_text(count: float) -> str:
    """Bytes, such as ``1.5 GiB``, rounded up."""
    tens = -(-count // (10 * MIB))
    return f"{10 * tens:.0f} MiB" if tens < 102 else f"{-(-count // (102.4 * MIB)) / 10:.1f} GiB"


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
        raise InputError(f"--memory applies only here; limit workers of {scheduler} with: dask worker --memory-limit")
    need = memory_need(site, processes=scheduler is not None)
    given = request.parts not in (None, "auto")
    within = parts_within(need, request.memory_bytes, parts=parts, most_parts=most_parts(site), given=given)
    if within > 1:
        require_parts(settings, site)
    at_a_time = at_a_time_within(need, request.memory_bytes, parts=within, workers=processes or threads)
    _log.info(
        "--memory: %d %s, %d at a time, about %s", within, "parts" if within > 1 else "part", at_a_time,
        count_text(need.total(within, at_a_time)),
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
        run = SearchRun(
            effort=effort, started=effort.now(), executor=executor, should_stop=should_stop, on_progress=on_progress
        )
        return plan_by_parts(
            site,
            parts=division.parts,
            settings=settings,
            select_rule=select_rule,
            run=run,
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
        scheduler: see :func:`uavcover.run.scheduling.workers_of`; None: threads.
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
    """Evaluate blocks of a large area by threads."""

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
