"""Scheduling of a command's tasks: this process, or workers that ``--scheduler`` names, and the input that they share.

A command sees tasks as functions of their arguments alone, and workers as something that gives back each task with its result. It
does not know Dask: only :mod:`uavcover.run.cluster` does, and it is loaded when a scheduler is named.

Input of all workers of this machine is in one file that they map into memory: large arrays exist once. The file has no name: it
is gone with the command that wrote it, also when that is killed. Workers open it by its number in the command (Linux).
"""

import hashlib
import importlib
import mmap
import os
import pickle
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import IO, Any, Protocol, TypeVar, cast

from uavcover.errors import InputError, UavcoverError

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


_LARGE_BYTES = 65_536
_ALIGNED = 64
_COUNT = struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class SharedFile:
    """A file with an object."""

    file: IO[bytes]  # open in this process; the object can be read while it is
    sha256: str  # of its content
    size: int  # in bytes

    @property
    def path(self) -> str:
        """By which other processes of this user open it."""
        return f"/proc/{os.getpid()}/fd/{self.file.fileno()}"


def can_share_files() -> bool:
    """Whether processes of this machine can open each other's files without a name."""
    return sys.platform == "linux" and os.path.isdir(f"/proc/{os.getpid()}/fd")


def share(value: object) -> SharedFile:
    """Write an object into a file without a name; close it after the last worker has opened it.

    Large read-only arrays lie in it as they are; each reader copies the others, and may change them.

    Raises:
        UavcoverError: there is no room for it.
    """
    large: list[memoryview] = []

    def is_copied(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if not raw.readonly or raw.nbytes < _LARGE_BYTES:
            return True
        large.append(raw)
        return False

    content = pickle.dumps(value, protocol=5, buffer_callback=is_copied)
    head = b"".join(_COUNT.pack(each) for each in (len(large), len(content), *(raw.nbytes for raw in large)))
    found, size = hashlib.sha256(), 0
    file = tempfile.TemporaryFile()  # noqa: SIM115, it outlives this function
    try:
        pieces: list[bytes | memoryview] = [head, content, *large]
        for piece in pieces:
            gap = bytes(-len(piece) % _ALIGNED)
            for part in (piece, gap):
                file.write(part)
                found.update(part)
            size += len(piece) + len(gap)
        file.flush()
    except OSError as error:
        file.close()
        raise UavcoverError(
            f"--scheduler: cannot write the data for the workers to {tempfile.gettempdir()} "
            f"({error.strerror}); free some space, or "
            "set TMPDIR to another folder"
        ) from error
    return SharedFile(file, found.hexdigest(), size)


def read_shared(path: str) -> Any:
    """Read the object; its large arrays are the file itself, mapped into memory, and read-only."""
    with open(path, "rb") as file:
        mapped = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    count, length = (each for (each,) in _COUNT.iter_unpack(mapped[: 2 * _COUNT.size]))
    sizes = [each for (each,) in _COUNT.iter_unpack(mapped[2 * _COUNT.size : (2 + count) * _COUNT.size])]
    at = 0
    pieces = []
    for size in ((2 + count) * _COUNT.size, length, *sizes):
        pieces.append(mapped[at : at + size])
        at += size + -size % _ALIGNED
    return pickle.loads(pieces[1], buffers=pieces[2:])
