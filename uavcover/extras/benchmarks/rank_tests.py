"""Compare contenders with confidence: rank-sum tests with Holm's correction, Friedman's ranks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from uavcover.kernels.arrays import FloatArray

Outcome = Literal["win", "tie", "loss"]

SIGNIFICANCE = 0.05


def rank_sum_p(one: ArrayLike, other: ArrayLike) -> float:
    """Two-sided p of the Wilcoxon rank-sum test between two samples; exact for up to 30 runs each, without equal values.

    >>> round(rank_sum_p([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]), 3)
    0.1
    """
    a, b = np.asarray(one, float), np.asarray(other, float)
    different = np.unique(np.concatenate([a, b])).size
    if different == 1:
        return 1.0  # all equal: no evidence, and the variance of the ranks is 0
    exact = different == len(a) + len(b) and max(len(a), len(b)) <= 30
    result = stats.mannwhitneyu(a, b, alternative="two-sided", method="exact" if exact else "asymptotic")
    return float(result.pvalue)


def holm(p_values: ArrayLike) -> FloatArray:
    """P values ``(k,)`` adjusted for being k tests at once (Holm 1979), in the order given.

    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, float)
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of a contender with a rival."""

    rival: str  # its name
    p: float  # of the rank-sum test
    p_holm: float  # the same, adjusted for all rivals compared with at once
    outcome: Outcome  # of the contender; a tie if ``p_holm`` is not below `SIGNIFICANCE`


def compared(
    own: ArrayLike, rivals: Sequence[tuple[str, FloatArray]], *, better: Literal["less", "more"]
) -> list[Comparison]:
    """A contender's runs against those of each rival; the tests with all rivals are one family of Holm's correction.

    Args:
        own: ``(runs,)`` values of the contender.
        rivals: the names and their values.
        better: whether less or more is better.
    """
    mine = np.asarray(own, float)
    p_values = [rank_sum_p(mine, values) for _, values in rivals]
    comparisons = []
    for (name, values), p, p_holm in zip(rivals, p_values, holm(p_values), strict=True):
        # the test compares ranks, so the side is decided by ranks too
        ranks = stats.rankdata(np.concatenate([mine, values]))
        lower = ranks[: len(mine)].mean() < ranks[len(mine) :].mean()
        outcome: Outcome = "tie" if p_holm >= SIGNIFICANCE else "win" if lower == (better == "less") else "loss"
        comparisons.append(Comparison(name, p, float(p_holm), outcome))
    return comparisons


@dataclass(frozen=True, slots=True)
class FriedmanRanks:
    """Mean ranks of contenders over several problems."""

    ranks: FloatArray  # ``(k,)`` mean rank of each, 1 is best
    p: float  # of Friedman's chi-square, that all contenders are equal; NaN for fewer than 3 contenders


def friedman(values: ArrayLike, *, better: Literal["less", "more"]) -> FriedmanRanks:
    """Ranks of k contenders by their values ``(problems, k)``, and Friedman's test.

    >>> friedman([[1.0, 2.0, 3.0], [1.0, 3.0, 2.0]], better="less").ranks.tolist()
    [1.0, 2.5, 2.5]
    """
    table = np.asarray(values, float) * (1.0 if better == "less" else -1.0)
    ranks = stats.rankdata(table, axis=1).mean(axis=0)
    if table.shape[1] < 3 or len(table) < 2:
        return FriedmanRanks(ranks, float("nan"))
    return FriedmanRanks(ranks, float(stats.friedmanchisquare(*table.T).pvalue))
