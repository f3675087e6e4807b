"""The runs of an MMF benchmark: every algorithm by name, in processes, one file for each run.

A run is one algorithm on one problem with one seed and one budget. Files are written whole, so that a killed benchmark goes on
where it was; only runs that are not there yet are made.
"""

import csv
import inspect
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from uavcover.errors import InputError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, MmfProblem
from uavcover.extras.benchmarks.runs import completed_by, csv_text, reserved_folder, write_run
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers import ALGORITHMS, DBO, make_optimizer, optimizer_class
from uavcover.optimizers.pymoo.adapters import spread_weights


@dataclass(frozen=True, slots=True)
class Budget:
    """Budget of every contender, and size of its result."""

    population: int = 200  # candidates of each round
    iterations: int = 500  # rounds; ``population * iterations`` evaluations in all
    archive: int = 200  # most solutions to return


Solver = Callable[[MmfProblem, int, Budget], FloatArray]


def solve(problem: MmfProblem, algorithm: str, *, seed: int, budget: Budget) -> tuple[FloatArray, FloatArray]:
    """One run of a contender.

    Args:
        problem: what to minimise.
        algorithm: a key of `CONTENDERS`, or ``module:Class`` as `optimizer_class` takes it.
        seed: of every random number in the run.
        budget: the evaluations it may use and the solutions it may return.

    Returns:
        ``(k, n)`` decision vectors and ``(k, m)`` their objectives, k <= ``budget.archive``.

    Raises:
        OptimizerError: no such contender, or the budget is too small for it.
    """
    solver = CONTENDERS[algorithm] if algorithm in CONTENDERS else _optimized(algorithm)
    x = solver(problem, seed, budget)
    return x, problem.evaluate(x)


def contender_names(asked: Iterable[str] = ()) -> list[str]:
    """Every contender by name, in the order of the tables: ours, other classes by name, the floor.

    Args:
        asked: names; those of the form ``module:Class`` are added.

    Raises:
        OptimizerError: one is no optimizer.
    """
    others = sorted({name for name in asked if ":" in name})
    for name in others:
        optimizer_class(name)
    return table_order([*CONTENDERS, *others])


def try_each(algorithms: Iterable[str], budget: "Budget") -> None:
    """Run each contender for one iteration, so that none fails after hours.

    Causes: a missing package, too small a budget.

    Raises:
        OptimizerError: one cannot be run.
    """
    for algorithm in algorithms:
        solve(PROBLEMS["MMF1"], algorithm, seed=1, budget=replace(budget, iterations=1))


def table_order(names: Iterable[str]) -> list[str]:
    """Names of contenders in the order of the tables: ours, other classes by name, the floor."""
    wanted = set(names)
    others = sorted(wanted.difference(CONTENDERS))
    return [*(name for name in CONTENDERS if name in wanted and name != FLOOR), *others, *wanted.intersection({FLOOR})]


def _optimized(algorithm: str) -> Solver:
    declared = algorithm in ALGORITHMS and "local_sets_wanted" in inspect.signature(ALGORITHMS[algorithm]).parameters

    def solver(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
        settings: dict[str, Any] = {"local_sets_wanted": problem.local_sets_wanted} if declared else {}
        optimizer = make_optimizer(
            algorithm,
            problem.lower,
            problem.upper,
            n_objectives=problem.n_objectives,
            population_size=budget.population,
            max_iterations=budget.iterations,
            archive_size=budget.archive,
            seed=seed,
            **settings,
        )
        while not optimizer.should_stop:
            optimizer.tell(problem.evaluate(optimizer.ask()))
        return optimizer.pareto_set().x

    return solver


def _uniform_points(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
    """As many uniform random points as may be returned: the floor under every indicator. No evaluation is used."""
    rng = np.random.default_rng(seed)
    return rng.uniform(problem.lower, problem.upper, (budget.archive, problem.n_variables))


def _weighted_dbo(problem: MmfProblem, seed: int, budget: Budget) -> FloatArray:
    """DBO, which has one objective, on one weighted sum of the objectives for each solution that may be returned.

    The budget is shared evenly: with 100,000 evaluations and 200 solutions 20 rounds of 25 beetles for each sum.
    """
    share = max(1, budget.population * budget.iterations // budget.archive)
    beetles = max(DBO.smallest_population, min(25, budget.population))
    seeds = np.random.SeedSequence(seed).spawn(budget.archive)
    found = []
    for weights, one_seed in zip(spread_weights(budget.archive, problem.n_objectives), seeds, strict=True):
        dbo = DBO(
            problem.lower,
            problem.upper,
            n_objectives=1,
            population_size=beetles,
            max_iterations=max(1, share // beetles),
            seed=one_seed,
        )
        while not dbo.should_stop:
            dbo.tell(problem.evaluate(dbo.ask()) @ weights[:, None])
        found.append(dbo.pareto_set().x[0])
    return np.array(found)


FLOOR: Final = "uniform"

CONTENDERS: Final = MappingProxyType[str, Solver](
    {name: _optimized(name) for name, algorithm in ALGORITHMS.items() if algorithm.most_objectives is None}
    | {"dbo": _weighted_dbo, FLOOR: _uniform_points}
)
"""Every contender by name; `FLOOR` is no algorithm but uniform random points."""


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
    """Folder of a benchmark's runs: ``sets/FUNCTION/ALGORITHM/RUN.csv``, columns x1.., f1...

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def reserved(self, budget: Budget) -> AbstractContextManager[None]:
        """As `uavcover.extras.benchmarks.runs.reserved_folder` does it, for runs of one budget."""
        return reserved_folder(self.path, asdict(budget), runs="sets")

    def file(self, run: RunId) -> Path:
        """File of a run's solutions."""
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
        rows = np.hstack([x, objectives]).tolist()
        write_run(self.file(run), csv_text(_header(x.shape[1], objectives.shape[1]), rows))

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
            raise InputError(f"{path}: cannot read it ({error}); delete it and run the command again") from error
        return values[:, :n], values[:, n:]


def _folder_name(algorithm: str) -> str:
    return algorithm.replace(":", _COLON)


def _header(n: int, m: int) -> list[str]:
    return [f"x{i + 1}" for i in range(n)] + [f"f{i + 1}" for i in range(m)]


@dataclass(frozen=True, slots=True)
class _MmfTask:
    run: RunId
    budget: Budget

    def __str__(self) -> str:
        return str(self.run)


def missing_runs(
    folder: MmfFolder, *, functions: Collection[str], algorithms: Collection[str], runs: int
) -> list[RunId]:
    """Missing runs, first runs first, so that a benchmark that is stopped early has run everything once."""
    done = set(folder.runs())
    wanted = (
        RunId(number, function, algorithm)
        for number in range(1, runs + 1)
        for function in functions
        for algorithm in algorithms
    )
    return [run for run in wanted if run not in done]


def make_runs(
    folder: MmfFolder,
    runs: Collection[RunId],
    budget: Budget,
    *,
    processes: int | None,
    scheduler: str | None = None,
) -> Iterator[RunId]:
    """Make the runs and yield each once it is in the folder.

    The result does not depend on the workers.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    tasks = [_MmfTask(run, budget) for run in runs]
    for task, (x, objectives) in completed_by(scheduler, _made, tasks, processes=processes):
        folder.write(task.run, x, objectives)
        yield task.run


def _made(task: _MmfTask) -> tuple[FloatArray, FloatArray]:
    return solve(PROBLEMS[task.run.function], task.run.algorithm, seed=task.run.number, budget=task.budget)
