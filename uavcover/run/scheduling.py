"""Scheduling of a command's tasks: this process, or workers that ``--scheduler`` names.

A command sees tasks as functions of their arguments alone, and workers as something that gives back each task with its result. It
does not know Dask: only :mod:`uavcover.run.cluster` does, and it is loaded when a scheduler is named.
"""

import importlib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Protocol, TypeVar, cast

from uavcover.errors import InputError

Shared = TypeVar("Shared")
Task = TypeVar("Task")
Result = TypeVar("Result")


class Workers(Protocol):
    """Workers that do tasks, wherever they are."""

    count: int  # how many tasks they do at a time

    def completed(
        self,
        # importable by name; its result depends on its arguments alone, so that a task that was lost with its worker is
        # simply done again
        function: Callable[[Shared, Task], Result],
        shared: Shared,  # what all tasks need; sent to each worker once
        tasks: Sequence[Task],  # small; arguments and results pickle
        *,
        # polled; once true, unfinished tasks are given up, and the iteration ends
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[tuple[Task, Result]]:
        """Each task with its result, in the order in which they get done.

        Raises:
            UavcoverError: the scheduler, or all workers, are gone for good, or a task ended its worker repeatedly.
            Exception: what ``function`` raised.
        """
        ...


class _OpensWorkers(Protocol):
    def local_workers(self, count: int) -> AbstractContextManager[Workers]: ...

    def remote_workers(self, address: str) -> AbstractContextManager[Workers]: ...


def workers_of(scheduler: str) -> AbstractContextManager[Workers]:
    """The workers of a scheduler, for as long as the context lasts.

    Args:
        scheduler: ``local`` (a process for each core), ``local:N``, or ``tcp://HOST:PORT`` of a Dask scheduler.

    Raises:
        InputError: it cannot be understood; the extra ``cluster`` is missing; no scheduler answers, or one of another version.
    """
    if (count := local_count(scheduler)) is not None:
        return _cluster(scheduler).local_workers(count)
    kind, _, rest = scheduler.partition(":")
    host, _, port = rest.removeprefix("//").rpartition(":")
    if kind in ("tcp", "tls") and rest.startswith("//") and host and _is_number(port) and 1 <= int(port) <= 65535:
        return _cluster(scheduler).remote_workers(scheduler)
    raise InputError(
        f"--scheduler: unknown scheduler {scheduler!r}; use local, local:N (N worker processes on this machine), or "
        "tcp://HOST:PORT of a Dask scheduler"
    )


def local_count(scheduler: str) -> int | None:
    """Number of worker processes of this machine; none for workers elsewhere, or for unreadable text."""
    kind, _, count = scheduler.partition(":")
    if scheduler == "local":
        return os.cpu_count() or 1
    return int(count) if kind == "local" and _is_number(count) and int(count) >= 1 else None


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= 6


def _cluster(scheduler: str) -> _OpensWorkers:
    """The module that knows Dask."""
    try:
        return cast("_OpensWorkers", importlib.import_module("uavcover.run.cluster"))
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("dask", "distributed"):
            raise
        raise InputError(f"--scheduler {scheduler}: requires Dask: pip install 'uavcover[cluster]'") from None
