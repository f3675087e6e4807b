"""The runs of an MMF benchmark: made in processes, kept as one file each.

Files are written whole, so that a killed benchmark goes on where it was; only runs that are not there yet are made.
"""

import csv
import io
import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from uavcover.benchmarks.mmf.contenders import CONTENDERS, Budget, solve, table_order
from uavcover.benchmarks.mmf.problems import PROBLEMS
from uavcover.benchmarks.runs import completed
from uavcover.errors import InputError, OutputError
from uavcover.kernels.arrays import FloatArray
from uavcover.run.folder import RunFolder, json_text, write_text

_SETTINGS = "settings.json"
_COLON = "="
"""In the name of a folder, for the colon of ``module:Class``, which Windows does not take."""


@dataclass(frozen=True, slots=True, order=True)
class RunId:
    """One run: its number, from 1, is the seed."""

    number: int
    function: str
    algorithm: str

    def __str__(self) -> str:
        return f"{self.function}/{self.algorithm}/{self.number}"


class MmfFolder:
    """Where the runs of a benchmark are kept: ``sets/FUNCTION/ALGORITHM/RUN.csv``, columns x1.., f1...

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @contextmanager
    def reserved(self, budget: Budget) -> Iterator[None]:
        """Make the folder, or take up one made with the same budget, and keep other processes out of it.

        Raises:
            InputError: its runs were made with another budget.
            OutputError: it has files but is none of ours, or cannot be written to.
        """
        with RunFolder(self.path).reserved([], force=False):
            settings = self.path / _SETTINGS
            if settings.exists():
                self._check(budget, settings)
            elif any(self.path.iterdir()):
                raise OutputError(f"{self.path}: has files, but no {_SETTINGS} of a benchmark; use another folder")
            else:
                write_text(settings, json_text(asdict(budget)))
            yield

    def _check(self, budget: Budget, settings: Path) -> None:
        try:
            before = Budget(**json.loads(settings.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{settings}: cannot be read ({error}); use another folder") from error
        if before != budget:
            raise InputError(
                f"{self.path}: its runs were made with {_told(before)}, not with {_told(budget)}; use another folder"
            )

    def file(self, run: RunId) -> Path:
        """Where the returned solutions of a run are."""
        return self.path / "sets" / run.function / _folder_name(run.algorithm) / f"{run.number}.csv"

    def runs(self) -> list[RunId]:
        """Every run in the folder, sorted by function and algorithm as the tables list them, then by number."""
        return [
            RunId(number, function, algorithm)
            for function in PROBLEMS
            for algorithm in self._algorithms(function)
            for number in sorted(
                int(path.stem)
                for path in (self.path / "sets" / function / _folder_name(algorithm)).glob("*.csv")
                if path.stem.isdecimal()
            )
        ]

    def _algorithms(self, function: str) -> list[str]:
        others = (path.name.replace(_COLON, ":") for path in (self.path / "sets" / function).glob(f"*{_COLON}*"))
        return table_order([*CONTENDERS, *others])

    def write(self, run: RunId, x: FloatArray, objectives: FloatArray) -> None:
        """Write the solutions ``(k, n)`` and ``(k, m)`` of a run, whole or not at all; numbers unrounded.

        Raises:
            OutputError: it cannot be written.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(_header(x.shape[1], objectives.shape[1]))
        writer.writerows(np.hstack([x, objectives]).tolist())
        path = self.file(run)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path.parent}: cannot be made ({error.strerror})") from error
        write_text(path, text.getvalue())

    def read(self, run: RunId) -> tuple[FloatArray, FloatArray]:
        """The solutions ``(k, n)`` and their objectives ``(k, m)`` of a run.

        Raises:
            InputError: the file is not as ``write`` makes it.
        """
        path, problem = self.file(run), PROBLEMS[run.function]
        n, m = problem.n_variables, problem.n_objectives
        try:
            header, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
            if header != _header(n, m) or not rows:
                raise ValueError(f"expected the header {','.join(_header(n, m))} and rows")
            values = np.array(rows, dtype=float)
            if values.shape[1] != n + m or not np.isfinite(values).all():
                raise ValueError(f"expected {n + m} finite numbers in a row")
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: cannot be read ({error}); remove it and give the same command again") from error
        return values[:, :n], values[:, n:]


def _folder_name(algorithm: str) -> str:
    return algorithm.replace(":", _COLON)


def _header(n: int, m: int) -> list[str]:
    return [f"x{i + 1}" for i in range(n)] + [f"f{i + 1}" for i in range(m)]


def _told(budget: Budget) -> str:
    return f"population {budget.population}, {budget.iterations} iterations, archive {budget.archive}"


@dataclass(frozen=True, slots=True)
class _MmfTask:
    folder: Path
    run: RunId
    budget: Budget

    def __str__(self) -> str:
        return str(self.run)


def missing_runs(
    folder: MmfFolder, *, functions: Collection[str], algorithms: Collection[str], runs: int
) -> list[RunId]:
    """What is still to be done, first runs first, so that a benchmark that is stopped early has seen everything once."""
    done = set(folder.runs())
    wanted = (
        RunId(number, function, algorithm)
        for number in range(1, runs + 1)
        for function in functions
        for algorithm in algorithms
    )
    return [run for run in wanted if run not in done]


def make_runs(folder: MmfFolder, runs: Collection[RunId], budget: Budget, *, processes: int) -> Iterator[RunId]:
    """Make the runs and yield each once it is in the folder; the result does not depend on the number of processes.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    tasks = [_MmfTask(folder.path, run, budget) for run in runs]
    for task, _ in completed(_make, tasks, processes=processes):
        yield task.run


def _make(task: _MmfTask) -> None:
    x, objectives = solve(PROBLEMS[task.run.function], task.run.algorithm, seed=task.run.number, budget=task.budget)
    MmfFolder(task.folder).write(task.run, x, objectives)
