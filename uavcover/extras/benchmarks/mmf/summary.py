"""From the files of the runs to indicators, and their mean, deviation and median.

IGDx, cover rate and PSP are the MMF suite's indicators in decision space: plain distances, no normalisation.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import astuple, dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.extras.benchmarks.mmf.reference_sets import reference_sets
from uavcover.extras.benchmarks.mmf.runs import MmfFolder
from uavcover.extras.benchmarks.runs import csv_text
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.indicators import hypervolume, inverted_generational_distance

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
    """``summary.csv``: function, algorithm, metric, mean, std, median, runs; numbers unrounded."""
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
