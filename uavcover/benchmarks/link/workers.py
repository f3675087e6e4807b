"""Runs trials over real UDP: one process with the vehicles, and one process for each client that runs at a time."""

import multiprocessing
import queue
import threading
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Self

from mission_io.items import MissionItem
from uavcover.benchmarks.link.clients import Transferred, outcome_of, run_real
from uavcover.benchmarks.link.trials import Outcome, Trial
from uavcover.benchmarks.link.vehicles import serve

LONGEST_S = 240.0
"""A client that takes longer is ended and counts as hung."""

_SPAWN = multiprocessing.get_context("spawn")


class Vehicles:
    """The process with the vehicles; a context manager."""

    def __init__(self) -> None:
        self._control, theirs = _SPAWN.Pipe()
        self._lock = threading.Lock()
        self._process = _SPAWN.Process(target=serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._control.send(None)
        self._process.join(10.0)

    def open(self, trial: Trial) -> int:
        """A new vehicle for a trial; the port it listens on."""
        with self._lock:
            self._control.send(trial)
            port: int = self._control.recv()
        return port

    def close(self, port: int) -> tuple[MissionItem, ...]:
        """End a vehicle; the mission that it held."""
        with self._lock:
            self._control.send(port)
            items: tuple[MissionItem, ...] = self._control.recv()
        return items


class _Worker:
    """A process that runs one client after the other, and is replaced when one hangs."""

    def __init__(self) -> None:
        self._process: BaseProcess | None = None
        self._control: Connection

    def run(self, trial: Trial, port: int) -> Transferred:
        if self._process is None:
            self._control, theirs = _SPAWN.Pipe()
            self._process = _SPAWN.Process(target=_work, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
        self._control.send((trial, port))
        try:
            if self._control.poll(LONGEST_S):
                transferred: Transferred = self._control.recv()
                return transferred
            error = f"hung for {LONGEST_S:g} s"
        except EOFError:
            error = "its process died"
        self._process.kill()
        self._process.join()
        self._process = None
        return Transferred(False, LONGEST_S, error=error)

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()  # MAVSDK's threads do not always end by themselves
            self._process.join()


def _work(control: Connection) -> None:
    while True:
        try:
            trial, port = control.recv()
        except (EOFError, KeyboardInterrupt):
            return
        try:
            control.send(run_real(trial, port))
        except Exception as error:
            control.send(Transferred(False, 0.0, error=f"{type(error).__name__}: {error}"))


def run_over_udp(trials: Sequence[Trial], *, at_a_time: int) -> Iterator[Outcome]:
    """Run trials, ``at_a_time`` of them at once, and yield each outcome as it comes."""
    todo: queue.SimpleQueue[Trial | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[Outcome | BaseException] = queue.SimpleQueue()
    for trial in (*trials, *(None,) * at_a_time):
        todo.put(trial)
    with Vehicles() as vehicles:

        def work() -> None:
            worker = _Worker()
            try:
                while (trial := todo.get()) is not None:
                    port = vehicles.open(trial)
                    transferred = worker.run(trial, port)
                    done.put(outcome_of(trial, transferred, vehicles.close(port)))
            except BaseException as error:
                done.put(error)
            finally:
                worker.close()

        threads = [threading.Thread(target=work, daemon=True) for _ in range(min(at_a_time, len(trials)))]
        for thread in threads:
            thread.start()
        try:
            for _ in trials:
                outcome = done.get()
                if isinstance(outcome, BaseException):
                    raise outcome
                yield outcome
        finally:
            while not todo.empty():  # stop after what is running
                todo.get()
            for _ in threads:
                todo.put(None)
            for thread in threads:
                thread.join(LONGEST_S)
