"""What the runs of a reading come to, beside the paper's figures."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from uavcover.benchmarks.paper.published import TABLE_5, Figures
from uavcover.benchmarks.paper.runs import PaperResult
from uavcover.planning.selection import PAPER_WEIGHTS

FloatArray = NDArray[np.float64]
Results = Mapping[tuple[str, str], Sequence[PaperResult]]
"""The results of the runs by reading and algorithm, in the order of their numbers."""

PAPERS_NODES = (38, 44)
"""Numbers of nodes that the paper's schemes have: both means of Table 5, give or take a standard deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class Scheme:
    """A member of a run's Pareto set that was chosen."""

    figures: Figures
    route: FloatArray


def by_weights(results: Sequence[PaperResult]) -> Scheme:
    """The smallest weighted sum of the objectives, each scaled to 0..1 over the sets of all results (section 5.3)."""
    schemes = _all(results)
    values = np.array([[-s.figures.coverage, s.figures.nodes, s.figures.length] for s in schemes])
    spread = np.ptp(values, axis=0)
    scaled = (values - values.min(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return schemes[int(np.argmin(scaled @ np.array(PAPER_WEIGHTS)))]


def by_nodes(results: Sequence[PaperResult]) -> Scheme:
    """Most coverage with as many nodes as the paper has; with the nearest number where there is none such."""
    low, high = PAPERS_NODES

    def away(scheme: Scheme) -> float:
        return max(0.0, low - scheme.figures.nodes, scheme.figures.nodes - high)

    return min(_all(results), key=lambda s: (away(s), -s.figures.coverage, s.figures.length))


CHOICES: Final = MappingProxyType[str, Callable[[Sequence[PaperResult]], Scheme]](
    {"weights": by_weights, "nodes": by_nodes}
)
"""How one scheme is chosen: by the paper's weights, or by its number of nodes."""


def _all(results: Sequence[PaperResult]) -> list[Scheme]:
    return [
        Scheme(figures, route) for result in results for figures, route in zip(result.front, result.routes, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class Row:
    """A row of Table 5: mean and standard deviation (of a sample; NaN for one run) over the runs."""

    mean: Figures
    std: Figures
    runs: int


def row(results: Sequence[PaperResult], choice: str) -> Row:
    """The runs of one algorithm on one reading."""
    chosen = [CHOICES[choice]([result]).figures for result in results]
    values = np.array([[c.coverage, c.nodes, c.length] for c in chosen])
    std = values.std(axis=0, ddof=1) if len(values) > 1 else np.full(3, math.nan)
    return Row(Figures(*values.mean(axis=0).tolist()), Figures(*std.tolist()), len(values))


def misfit(rows: Mapping[str, Row]) -> float:
    """How far the rows of both algorithms are from Table 5: root mean square of the six means' relative deviations."""
    deviations = [
        getattr(rows[algorithm].mean, name) / getattr(mean, name) - 1.0
        for algorithm, (mean, _) in TABLE_5.items()
        for name in ("coverage", "nodes", "length")
    ]
    return math.sqrt(sum(d * d for d in deviations) / len(deviations))
