"""Workers by Dask: processes of this machine, or those of a scheduler elsewhere. The only importer of Dask."""

import asyncio
import hashlib
import logging
import pickle
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, wait
from distributed.comm import CommClosedError

from uavcover.errors import InputError, UavcoverError
from uavcover.run.provenance import differences, program
from uavcover.run.scheduling import can_share_files, read_shared, share

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
"""A terminal sends Ctrl-C to all processes of a command; who started the workers decides."""

_DASK = r"(dask|distributed)(\.|$)"
_GOES_ON = "finished work is kept; run the command again"


class _TaskError(Exception):
    """A task raised its cause."""


class DaskWorkers:
    """The workers of a Dask scheduler.

    Attributes:
        count: threads of all workers.
    """

    def __init__(self, client: Client, where: str, *, here: bool = False) -> None:
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
        function: Callable[[Shared, Task], Result],
        shared: Shared,
        tasks: Sequence[Task],
        *,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> Iterator[tuple[Task, Result]]:
        """Each task with its result; see :class:`uavcover.run.scheduling.Workers`."""
        what = function.__name__.strip("_")
        file = share(shared) if self._here else None
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

    def _ended(self, futures: list[Future]) -> list[Future]:
        """Those that are done, after a moment at most."""
        try:
            with self._client.as_current():
                wait(futures, timeout=0.5, return_when="FIRST_COMPLETED")
        except TimeoutError:
            if self._client.status != "running":
                raise CommClosedError from None
        return [future for future in futures if future.status not in ("pending",)]


@contextmanager
def local_workers(count: int) -> Iterator[DaskWorkers]:
    """Worker processes on this machine; they end with the context.

    They listen on 127.0.0.1 alone, and there is no dashboard.
    """
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
            yield DaskWorkers(client, "--scheduler local", here=True)


@contextmanager
def remote_workers(address: str) -> Iterator[DaskWorkers]:
    """The workers of a Dask scheduler.

    Raises:
        InputError: no scheduler answers, there are no workers, or their versions are not ours.
    """
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
            yield DaskWorkers(client, where)


def _require_same_program(client: Client, where: str) -> None:
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
"""What a worker read last, by hash: tasks that come later find it in memory."""


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
