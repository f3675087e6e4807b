"""The grid of trials: which are still to be run, running them, and keeping each outcome as it comes."""

import csv
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from uavcover.benchmarks.link.clients import REAL_CLIENTS, run_simulated
from uavcover.benchmarks.link.trials import AUTOPILOTS, COLUMNS, DIRECTIONS, Outcome, Trial
from uavcover.benchmarks.link.workers import run_over_udp
from uavcover.errors import InputError

OUTCOMES: Final = "outcomes.csv"


def trials(*, clients: Collection[str], losses: Collection[float], delay_s: float, seeds: int) -> list[Trial]:
    """Every trial, first seeds first, so that a benchmark that is stopped early has seen every cell."""
    return [
        Trial(client, vehicle, direction, delay_s, loss, seed)
        for seed in range(seeds)
        for loss in losses
        for vehicle in AUTOPILOTS
        for direction in DIRECTIONS
        for client in clients
    ]


def read_outcomes(folder: Path) -> list[Outcome]:
    """The outcomes in a folder; a last line that was cut off by a kill is left out.

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
            outcomes.append(Outcome.of_row(row))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{file}: line {number}: cannot be read ({error}); remove the file to begin anew"
            ) from None
    return outcomes


def run_missing(folder: Path, wanted: Collection[Trial], *, at_a_time: int) -> Iterator[Outcome]:
    """Run what is not in the folder yet, and yield each outcome once it is written.

    In simulated time first, then over UDP: without loss one after the other, because there the processor is what takes
    time, and with loss ``at_a_time`` at once, because there everybody waits.
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

    def write(self, outcome: Outcome) -> Outcome:
        self._rows.writerow(outcome.row())
        self._file.flush()
        return outcome
