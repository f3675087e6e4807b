"""Runs the trials that are missing from the grid over real UDP, and keeps each outcome as it comes.

One process has the vehicles, and each client that runs at a time has a process of its own.
"""

import csv
import multiprocessing
import queue
import threading
from collections.abc import Collection, Iterator, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from mission_io.model.items import MissionItem
from uavcover.errors import InputError
from uavcover.extras.benchmarks.link.peers import (
    AUTOPILOTS,
    COLUMNS,
    DIRECTIONS,
    REAL_CLIENTS,
    TransferOutcome,
    Transferred,
    Trial,
    outcome_of,
    run_real,
    run_simulated,
    serve,
)

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
            error = f"did not respond for {LONGEST_S:g} s"
        except EOFError:
            error = "its process ended unexpectedly"
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


def run_over_udp(trials: Sequence[Trial], *, at_a_time: int) -> Iterator[TransferOutcome]:
    """Run trials, ``at_a_time`` of them at once, and yield each outcome as it comes."""
    todo: queue.SimpleQueue[Trial | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[TransferOutcome | BaseException] = queue.SimpleQueue()
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


OUTCOMES: Final = "outcomes.csv"


def trials(*, clients: Collection[str], losses: Collection[float], delay_s: float, seeds: int) -> list[Trial]:
    """Every trial, first seeds first, so that a benchmark that is stopped early has run every cell."""
    return [
        Trial(client, vehicle, direction, delay_s, loss, seed)
        for seed in range(seeds)
        for loss in losses
        for vehicle in AUTOPILOTS
        for direction in DIRECTIONS
        for client in clients
    ]


def read_outcomes(folder: Path) -> list[TransferOutcome]:
    """The outcomes in a folder; a last line that was cut off by a kill is omitted.

    Raises:
        InputError: another line cannot be read.
    """
    file = folder / OUTCOMES
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    outcomes = []
    for number, row in enumerate(csv.DictReader(whole.splitlines()), start=2):
        try:
            outcomes.append(TransferOutcome.of_row(row))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{file}: cannot read line {number} ({error}); delete the file to start again") from None
    return outcomes


def run_missing(folder: Path, wanted: Collection[Trial], *, at_a_time: int) -> Iterator[TransferOutcome]:
    """Run what is not in the folder yet, and yield each outcome once it is written.

    In simulated time first, then over UDP: without loss one after the other, because the processor limits them, and with loss
    ``at_a_time`` at once, because all of them wait.
    """
    done = {outcome.trial for outcome in read_outcomes(folder)}
    missing = [trial for trial in wanted if trial not in done]
    real = [trial for trial in missing if trial.client in REAL_CLIENTS]
    with _Writer(folder) as writer:
        for trial in missing:
            if trial.client not in REAL_CLIENTS:
                yield writer.write(run_simulated(trial))
        for group, processes in (
            ([trial for trial in real if trial.loss == 0.0], 1),
            ([trial for trial in real if trial.loss != 0.0], at_a_time),
        ):
            if group:
                for outcome in run_over_udp(group, at_a_time=processes):
                    yield writer.write(outcome)


class _Writer:
    """Appends outcomes to the file, each at once."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / OUTCOMES

    def __enter__(self) -> "_Writer":
        old = self._path.read_text(encoding="utf-8") if self._path.exists() else ""
        self._file = self._path.open("w", encoding="utf-8", newline="")
        self._file.write(old[: old.rfind("\n") + 1])
        self._rows = csv.DictWriter(self._file, COLUMNS, lineterminator="\n")
        if not old:
            self._rows.writeheader()
        self._file.flush()
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, outcome: TransferOutcome) -> TransferOutcome:
        self._rows.writerow(outcome.row())
        self._file.flush()
        return outcome
