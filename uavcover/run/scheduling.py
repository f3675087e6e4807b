"""Scheduling of a command's tasks: workers that ``--scheduler`` names (Dask), and the input that they share.

Tasks are functions of their arguments alone, and workers return each task with its result. This is the only importer of Dask,
which is loaded when a scheduler is named.

Input of all workers of this machine is in one file that they map into memory: large arrays exist once. The file has no name: it
is gone with the command that wrote it, also when that is killed. Workers open it by its number in the command (Linux).
"""

import asyncio
import hashlib
import logging
import mmap
import os
import pickle
import struct
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeVar

from uavcover.errors import InputError, UavcoverError
from uavcover.run.provenance import differences, program

if TYPE_CHECKING:
    from distributed import Client, Future

Shared = TypeVar("Shared")
Task = TypeVar("Task")
Result = TypeVar("Result")

_log = logging.getLogger(__name__)

_ANSWER_S = 10.0

_IDLE = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
}
"""Profiles and monitors of local processes have no reader: without them three processes that wait take 0.4 s of
processor time in 15 s, in place of 1.3 s."""

_DEAF_TO_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
"""Workers ignore Ctrl-C, which a terminal sends to all processes of a command; the parent process decides."""

_DASK = r"(dask|distributed)(\.|$)"
_GOES_ON = "finished work is kept; run the command again"


def workers_of(scheduler: str) -> "AbstractContextManager[Workers]":
    """The workers of a scheduler, for as long as the context lasts.

    Args:
        scheduler: ``local`` (a process for each core), ``local:N``, or ``tcp://HOST:PORT`` of a Dask scheduler.

    Raises:
        InputError: it cannot be understood; the extra ``cluster`` is missing; no scheduler answers, or one of another version.
    """
    if (count := local_count(scheduler)) is not None:
        _require_dask(scheduler)
        return _local_workers(count)
    kind, _, rest = scheduler.partition(":")
    host, _, port = rest.removeprefix("//").rpartition(":")
    if kind in ("tcp", "tls") and rest.startswith("//") and host and _is_number(port) and 1 <= int(port) <= 65535:
        _require_dask(scheduler)
        return _remote_workers(scheduler)
    raise InputError(
        f"--scheduler: unknown scheduler {scheduler!r}; use local, local:N (N worker processes on this machine), or "
        "tcp://HOST:PORT of a Dask scheduler"
    )


def local_count(scheduler: str) -> int | None:
    """Number of worker processes of this machine; None for workers elsewhere, or for unreadable text."""
    kind, _, count = scheduler.partition(":")
    if scheduler == "local":
        return os.cpu_count() or 1
    return int(count) if kind == "local" and _is_number(count) and int(count) >= 1 else None


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= 6


def _require_dask(scheduler: str) -> None:
    try:
        import distributed  # noqa: F401
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("dask", "distributed"):
            raise
        raise InputError(f"--scheduler {scheduler}: requires Dask: pip install 'uavcover[cluster]'") from None


class _TaskError(Exception):
    """A task raised its cause."""


class Workers:
    """The workers of a Dask scheduler.

    Attributes:
        count: threads of all workers.
    """

    def __init__(self, client: "Client", where: str, *, here: bool = False) -> None:
        """Use the workers of a client.

        Args:
            client: of the scheduler.
            where: the text of the request.
            here: whether the workers are processes of this machine, which can open its files.
        """
        self._client = client
        self._where = where
        self._here = here and can_share_files()
        self._about = program()
        self.count = max(1, sum(client.nthreads().values()))

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
        from distributed import KilledWorker
        from distributed.comm import CommClosedError

        what = function.__name__.strip("_")
        file = shared_file(shared) if self._here else None
        packed = b"" if file is not None else pickle.dumps(shared, protocol=5)
        name, size = (hashlib.sha256(packed).hexdigest(), len(packed)) if file is None else (file.sha256, file.size)
        name = name[:16]
        _log.info("%s: %d tasks, with %d bytes for each worker", what, len(tasks), size)
        pending: dict[Future, Task] = {}
        try:
            there: object
            if file is not None:
                there = InFile(file.path, file.sha256, self._about)
            else:
                # What is shared is a task of its own: a scheduler can make it again when every worker that had it is gone.
                there = self._client.submit(_unpacked, packed, self._about, key=f"uavcover-shared-{name}")
            for number, task in enumerate(tasks):
                key = f"uavcover-{function.__name__}-{name}-{_digest(task)}-{number}"
                future = self._client.submit(_done, function, there, pickle.dumps(task, protocol=5), key=key)
                pending[future] = task
            while pending and not should_stop():
                for future in self._ended(list(pending)):
                    task = pending[future]
                    packed_answer, sent, cpu_s = future.result()
                    del pending[future]
                    _log.info(
                        "%s: task of %d bytes, answer of %d, %.2f s of processor time",
                        what,
                        sent,
                        len(packed_answer),
                        cpu_s,
                    )
                    well, answer = pickle.loads(packed_answer)
                    if not well:
                        raise _TaskError from answer
                    result: Result = answer
                    yield task, result
        except _TaskError as error:
            # What a task raises is not taken for what becomes of the scheduler: both may be an OSError.
            raise error.__cause__ or error from None
        except KilledWorker as error:
            raise UavcoverError(
                f"{self._where}: a task lost its worker repeatedly (last: {error.last_worker.address}); check the "
                f"worker's memory; {_GOES_ON}"
            ) from error
        except (CancelledError, asyncio.CancelledError, CommClosedError, OSError) as error:
            raise UavcoverError(f"{self._where}: the scheduler stopped; {_GOES_ON}") from error
        finally:
            if pending and self._client.status == "running":
                self._client.cancel(list(pending), force=True)
            if file is not None:
                file.file.close()

    def _ended(self, futures: "list[Future]") -> "list[Future]":
        """Those that are done, after a moment at most."""
        from distributed import wait
        from distributed.comm import CommClosedError

        try:
            with self._client.as_current():
                wait(futures, timeout=0.5, return_when="FIRST_COMPLETED")
        except TimeoutError:
            if self._client.status != "running":
                raise CommClosedError from None
        return [future for future in futures if future.status not in ("pending",)]


@contextmanager
def _local_workers(count: int) -> Iterator[Workers]:
    """Worker processes on this machine; they end with the context.

    They listen on 127.0.0.1 alone, and there is no dashboard.
    """
    import dask
    from distributed import Client, LocalCluster

    _be_quiet()
    settings = {
        # a local task may lose its worker this often before it is taken for the cause
        "distributed.scheduler.allowed-failures": 20,
        "distributed.worker.preload": [_DEAF_TO_CTRL_C],
        "distributed.admin.system-monitor.gil.enabled": False,
        **_IDLE,
    }
    with dask.config.set(settings), warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=_DASK)
        with (
            LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1",
                silence_logs=logging.CRITICAL,
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},  # any free port, in place of 8787
            ) as cluster,
            Client(cluster, set_as_default=False) as client,
        ):  # fmt: skip
            yield Workers(client, "--scheduler local", here=True)


@contextmanager
def _remote_workers(address: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler.

    Raises:
        InputError: no scheduler answers, there are no workers, or their versions are not ours.
    """
    from distributed import Client

    _be_quiet()
    where = f"--scheduler {address}"
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=_DASK)  # of versions; what matters is compared below
        try:
            client = Client(address, timeout=_ANSWER_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"{where}: no Dask scheduler answers at this address; start one with: dask scheduler --host HOST --port PORT"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=30.0)
            except TimeoutError:
                raise InputError(
                    f"{where}: the scheduler has no workers; start some with: dask worker {address}"
                ) from None
            _require_same_program(client, where)
            yield Workers(client, where)


def _require_same_program(client: "Client", where: str) -> None:
    try:
        found: dict[str, dict[str, str]] = client.run(program)
    except Exception as error:
        raise InputError(
            f"{where}: the workers cannot import uavcover ({type(error).__name__}: {error}); install uavcover "
            f"{program()['uavcover']} in their environment"
        ) from error
    for worker, theirs in sorted(found.items()):
        if other := differences(program(), theirs):
            raise InputError(
                f"{where}: worker {worker} runs different software: {other}; install the same versions on both sides"
            )


class InFile(NamedTuple):
    """Shared input of all tasks of a worker, in a file of this machine."""

    path: str  # of the file
    sha256: str  # of its content
    about: dict[str, str]  # the program that wrote it


_FROM_FILE: dict[str, Any] = {}
"""Inputs that a worker read last, by hash, for later tasks."""


def _read(there: InFile) -> Any:
    if there.sha256 not in _FROM_FILE:
        _require_program(there.about)
        _FROM_FILE.clear()
        _FROM_FILE[there.sha256] = read_shared(there.path)
    return _FROM_FILE[there.sha256]


def _unpacked(packed: bytes, about: dict[str, str]) -> Any:
    """The shared input of all tasks of a worker."""
    _require_program(about)
    return pickle.loads(packed)


def _require_program(about: dict[str, str]) -> None:
    """A worker may have joined after the others were compared."""
    if other := differences(about, program()):
        raise InputError(
            f"--scheduler: a worker runs different software: {other}; install the same versions on both sides"
        )


def _done(function: Callable[[Any, Any], Any], shared: Any, task: bytes) -> tuple[bytes, int, float]:
    """The result of a task, the bytes of the task, and its processor time."""
    begin_s = time.thread_time()
    answer: tuple[bool, object]
    try:
        answer = True, function(_read(shared) if isinstance(shared, InFile) else shared, pickle.loads(task))
    except Exception as error:
        answer = False, error
    return pickle.dumps(answer, protocol=5), len(task), time.thread_time() - begin_s


def _digest(task: object) -> str:
    return hashlib.sha256(pickle.dumps(task, protocol=5)).hexdigest()[:16]


def _be_quiet() -> None:
    """Silence Dask's loggers: our errors report a failure in one line."""
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


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
        """Path by which other processes of this user open it."""
        return f"/proc/{os.getpid()}/fd/{self.file.fileno()}"


def can_share_files() -> bool:
    """Whether processes of this machine can open each other's files without a name."""
    return sys.platform == "linux" and os.path.isdir(f"/proc/{os.getpid()}/fd")


def shared_file(value: object) -> SharedFile:
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
