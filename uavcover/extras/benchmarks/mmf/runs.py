"""The runs of an MMF benchmark, every algorithm by name, and their indicators with mean, deviation and median.

A run is one algorithm on one problem with one seed and one budget, in a process and a file of its own. Files are written whole,
so that a killed benchmark continues where it stopped; only runs that are not there yet are made. IGDx, cover rate and PSP are the
MMF suite's indicators in decision space: plain distances, no normalisation.
"""

import csv
import functools
import inspect
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from uavcover.errors import InputError, OptimizerError
from uavcover.extras.benchmarks.indicators import hypervolume, inverted_generational_distance
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, MmfProblem, reference_sets
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


def contender_names(requested: Iterable[str] = ()) -> list[str]:
    """Every contender by name, in the order of the tables: ours, other classes by name, the floor.

    Args:
        requested: names; those of the form ``module:Class`` are added.

    Raises:
        OptimizerError: one is no optimizer.
    """
    others = sorted({name for name in requested if ":" in name})
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
    fraction = max(1, budget.population * budget.iterations // budget.archive)
    beetles = max(DBO.smallest_population, min(25, budget.population))
    seeds = np.random.SeedSequence(seed).spawn(budget.archive)
    found = []
    for weights, one_seed in zip(spread_weights(budget.archive, problem.n_objectives), seeds, strict=True):
        dbo = DBO(
            problem.lower,
            problem.upper,
            n_objectives=1,
            population_size=beetles,
            max_iterations=max(1, fraction // beetles),
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
        """Write the solutions ``(k, n)`` and ``(k, m)`` of a run, whole or not at all; with exact numbers.

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
    runs: Sequence[RunId],
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
    make = functools.partial(_made, budget=budget)
    for run, (x, objectives) in completed_by(scheduler, make, runs, processes=processes):
        folder.write(run, x, objectives)
        yield run


def _made(run: RunId, *, budget: Budget) -> tuple[FloatArray, FloatArray]:
    return solve(PROBLEMS[run.function], run.algorithm, seed=run.number, budget=budget)


CONSTANT_VARIABLES = {"MMF10": (1,), "MMF11": (1,), "MMF12": (1,), "MMF14": (2,), "MMF15": (2,)}
"""Variables (from 0) that the suite's own routine leaves out of the cover rate, by name of the problem; it matters for MMF14."""


def cover_rate(reference_set: ArrayLike, solutions: ArrayLike, *, ignored: Collection[int] = ()) -> float:
    """Share of the reference set's extent that a set of solutions spans, 0..1: the geometric mean over variables.

    Per variable, the overlap of both ranges over the reference's range, squared; a variable that is constant in the
    reference, or ignored, counts as 1; the product's 2n-th root (Yue et al., "A multiobjective particle swarm optimizer using
    ring topology for solving multimodal multiobjective problems", 2018).

    Args:
        reference_set: (r, n) the true Pareto set.
        solutions: (k, n) decision vectors, k >= 1.
        ignored: variables, from 0, that count as 1.

    Raises:
        OptimizerError: shapes that do not fit.

    >>> cover_rate([[0.0, 0.0], [1.0, 2.0]], [[0.0, 0.0], [0.5, 2.0]])
    0.7071067811865476
    """
    true, found = np.asarray(reference_set, float), np.asarray(solutions, float)
    if true.ndim != 2 or found.ndim != 2 or true.shape[1] != found.shape[1] or not len(true) or not len(found):
        raise OptimizerError(f"cover rate: shapes {true.shape} and {found.shape}; use (r, n) and (k, n)")
    product = 1.0
    for variable in range(true.shape[1]):
        low, high = float(true[:, variable].min()), float(true[:, variable].max())
        if variable in ignored or low == high:
            continue
        first, last = float(found[:, variable].min()), float(found[:, variable].max())
        if first >= high or last <= low:
            return 0.0
        product *= ((min(last, high) - max(first, low)) / (high - low)) ** 2
    return float(product ** (1.0 / (2 * true.shape[1])))


def pareto_sets_proximity(reference_set: ArrayLike, solutions: ArrayLike, *, ignored: Collection[int] = ()) -> float:
    """PSP = cover rate / IGDx (the paper's Eq. 25); more is better, infinite when IGDx is 0."""
    rate = cover_rate(reference_set, solutions, ignored=ignored)
    return _proximity(rate, inverted_generational_distance(reference_set, solutions))


def _proximity(rate: float, distance: float) -> float:  # Eq. 25
    if rate == 0.0:
        return 0.0
    return rate / distance if distance > 0.0 else math.inf


METRICS: Final = MappingProxyType[str, Literal["less", "more"]](
    {"IGD": "less", "IGDx": "less", "CR": "more", "PSP": "more", "HV": "more"}
)
"""The indicators by name, and whether less or more of it is better."""

Samples = Mapping[tuple[str, str], Mapping[str, FloatArray]]
"""(function, algorithm) -> metric -> its value in each run, in the order of their numbers."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A metric over several runs."""

    mean: float  # the average
    std: float  # the sample standard deviation (n - 1); NaN for one run
    median: float  # the middle one
    runs: int  # how many there were


def indicators(function: str, x: FloatArray, objectives: FloatArray) -> dict[str, float]:
    """All metrics of one set of solutions ``(k, n)`` with objectives ``(k, m)`` of a problem."""
    problem, reference = PROBLEMS[function], reference_sets(function)
    distance = inverted_generational_distance(reference.pareto_set, x)
    rate = cover_rate(reference.pareto_set, x, ignored=CONSTANT_VARIABLES.get(function, ()))
    return {
        "IGD": inverted_generational_distance(reference.pareto_front, objectives),  # Eq. 24
        "IGDx": distance,
        "CR": rate,
        "PSP": _proximity(rate, distance),
        "HV": hypervolume(objectives, problem.hypervolume_reference),
    }


def measured(folder: MmfFolder) -> Samples:
    """The indicators of every run in the folder. Raises InputError: a file cannot be read."""
    values: dict[tuple[str, str], dict[str, list[float]]] = {}
    for run in folder.runs():
        row = indicators(run.function, *folder.read(run))
        columns = values.setdefault((run.function, run.algorithm), {metric: [] for metric in METRICS})
        for metric, value in row.items():
            columns[metric].append(value)
    return {key: {metric: np.array(column) for metric, column in columns.items()} for key, columns in values.items()}


def figure(values: FloatArray) -> Figure:
    """Mean, deviation and median of ``(runs,)`` values.

    >>> figure(np.array([1.0, 2.0, 6.0]))
    Figure(mean=3.0, std=2.6457513110645907, median=2.0, runs=3)
    """
    finite = bool(np.isfinite(values).all())
    return Figure(
        mean=float(values.mean()),
        std=float(values.std(ddof=1)) if finite and len(values) > 1 else math.nan,
        median=float(np.median(values)),
        runs=len(values),
    )


def summary_csv(samples: Samples) -> str:
    """``summary.csv``: function, algorithm, metric, mean, std, median, runs; with exact numbers."""
    rows = ([*key, *astuple(figure(values))] for key, values in _by_metric(samples))
    return csv_text(["function", "algorithm", "metric", "mean", "std", "median", "runs"], rows)


def runs_csv(samples: Samples) -> str:
    """``runs.csv``: function, algorithm, metric, then the value of each run."""
    most = max((len(columns["IGD"]) for columns in samples.values()), default=0)
    rows = ([*key, *values.tolist()] for key, values in _by_metric(samples))
    return csv_text(["function", "algorithm", "metric", *range(1, most + 1)], rows)


def _by_metric(samples: Samples) -> Iterator[tuple[tuple[str, str, str], FloatArray]]:
    for key, columns in samples.items():
        for metric, values in columns.items():
            yield (*key, metric), values
