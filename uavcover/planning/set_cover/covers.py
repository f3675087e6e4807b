"""Covers that take no solver: greedily, and by local search."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import set_cover as kernels
from uavcover.kernels.cover_search import search_cover
from uavcover.planning.set_cover.candidates import Candidates
from uavcover.planning.set_cover.reduced import Reduced

_ROUNDING = 1e-9


def greedy_cover(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    """Numbers of candidates that see a share of what can be covered, or all that the places see, each the one that adds most."""
    return reduced.numbers[_greedy(reduced, coverage)]


def searched_cover(reduced: Reduced, *, steps: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers of few candidates that see all that the places see: greedily, then by local search.

    Args:
        reduced: the places.
        steps: exchanges; 20,000 take about half a second on the paper's scenarios.
        rng: draws them.
    """
    first = _greedy(reduced, 1.0)
    return reduced.numbers[search_cover(reduced.start, reduced.classes, reduced.weight.size, first, steps, rng)]


def cut_down(candidates: Candidates, chosen: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of the chosen candidates: one after the other, the one is left out that alone sees least."""
    return kernels.drop_needless(candidates.start, candidates.cells, candidates.weight, chosen, np.inf, most)


def _greedy(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    enough = min(coverage, reduced.reachable) - _ROUNDING
    places = reduced.numbers.size
    table = (reduced.start, reduced.classes, reduced.weight)
    return kernels.drop_needless(*table, kernels.choose_greedily(*table, enough, places), enough, places)
