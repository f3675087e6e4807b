"""Workers that search and judge the parts of a plan: threads of this process, or the workers of a scheduler."""

import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager

from uavcover.kernels.arrays import FloatArray
from uavcover.planner.parts.part_search import PartTask, search_part
from uavcover.planner.parts.planner import RunTasks, search_parts_with
from uavcover.run.scheduling import Workers, workers_of
from uavcover.scenario.site import Site
from uavcover.sensing.block_map import BlockLook, BlockTask, RunBlocks, look_at_block


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
