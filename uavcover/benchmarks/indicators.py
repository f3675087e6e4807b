"""Indicators of the MMF suite that look at decision space: IGDx, cover rate, PSP. Plain distances, no normalisation."""

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from uavcover.errors import OptimizerError
from uavcover.optimizers.indicators import inverted_generational_distance

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
        raise OptimizerError(f"cover rate: shapes {true.shape} and {found.shape}: give (r, n) and (k, n), none empty")
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
    distance = inverted_generational_distance(reference_set, solutions)
    if rate == 0.0:
        return 0.0
    return rate / distance if distance > 0.0 else math.inf
