"""Who searches in the parts of a plan: threads of this process, or the workers of a scheduler."""

import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager

from uavcover.kernels.arrays import FloatArray
from uavcover.planning.parts.part_search import PartTask, search_part
from uavcover.planning.parts.planner import RunTasks, search_parts_with
from uavcover.run.scheduling import Workers, workers_of
from uavcover.scenario.site import Site


@contextmanager
def part_searchers(
    scheduler: str | None, executor: Executor, *, threads: int, should_stop: Callable[[], bool]
) -> Iterator[tuple[RunTasks, int]]:
    """Who searches in the parts, and in how many of them at a time.

    Args:
        scheduler: see :func:`uavcover.run.scheduling.workers_of`; none: threads.
        executor: those threads.
        threads: how many there are.
        should_stop: whether the user wants the best there is.
    """
    if scheduler is None:
        yield (
            search_parts_with(executor, now=time.monotonic, should_stop=should_stop),
            min(threads, os.cpu_count() or 1),
        )
        return
    with workers_of(scheduler) as workers:
        yield search_parts_on(workers, should_stop=should_stop), workers.count


def search_parts_on(workers: Workers, *, should_stop: Callable[[], bool]) -> RunTasks:
    """Search in the parts by workers; when the user ends the search, parts that are not done get what is found at once."""

    def run(site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, FloatArray]]:
        left = {task.number: task for task in tasks}
        # A copy of the site has nothing that can be computed again.
        done = workers.completed(_search, dataclasses.replace(site), tasks, should_stop=should_stop)
        for task, route_m in done:
            del left[task.number]
            yield task, route_m
        yield from search_parts_with(None, now=time.monotonic, should_stop=should_stop)(site, list(left.values()))

    return run


def _search(site: Site, task: PartTask) -> FloatArray:
    return search_part(site, task, now=time.monotonic, should_stop=lambda: False).waypoints_m
