"""Search for the order and the direction of stretches in which their sorties take least.

An order is judged by its best split ("route first, cluster second"; Prins 2004, doi 10.1016/S0305-0548(03)00158-8), so one list
stands for all sorties, and what moves stretches within it moves them within a sortie or between several. Orders are short tours
by 2-opt and Or-opt, with reversals (:func:`uavcover.kernels.tours.shorten`), under lengths that are wrong at random (the noising
method, Charon and Hudry 1993, doi 10.1016/0167-6377(93)90023-A): from the order at hand, or from any. A link also costs a random
share of the way home from its nearer end, so that some tours pass home as often as batteries are changed.
"""

import math
from collections.abc import Callable

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.tours import nearest, shorten
from uavcover.planning.sortie_order.order_costs import OrderCosts

_NOISE = (0.1, 0.6)
"""Least and largest relative error of a length; drawn anew for every tour."""
_HOME = 0.36
"""Largest share of the way home and back that a link costs."""
_ANEW = 0.2
"""Of the tours begin from any order."""
_KICKS, _NEAR = 20, 8
"""Of one tour."""
_HEAT = 0.003
"""Of the time of all sorties: an order that takes as much more is gone on with, at first, with a probability of 1 / e."""

_LEAST_GAIN_S = 1e-6


def better_order(
    costs: OrderCosts, start: IntArray, *, done: Callable[[int], float], rng: np.random.Generator
) -> tuple[float, IntArray]:
    """The best order that was found, and what it takes; never worse than the first one.

    Args:
        costs: of orders of n stretches.
        start: (n,) numbers of stretches in their directions: the first order, which can be flown.
        done: share of the work that is done after so many tours, which ends at 1.
        rng: draws them.
    """
    now = best = start
    now_s = best_s = costs.total_s(now)
    tours, count = _Tours(costs, rng), 0
    while (cooled := done(count)) < 1.0:
        count += 1
        drawn = tours.drawn(now)
        # Backwards another end of the links between sorties is flown twice, and the wind blows from the other side.
        time_s, _, order = min((costs.total_s(way), number, way) for number, way in enumerate((drawn, drawn[::-1] ^ 1)))
        if time_s < now_s * (1.0 - _HEAT * (1.0 - cooled) * math.log(max(rng.random(), 1e-12))):
            now, now_s = order, time_s
        if time_s < best_s - _LEAST_GAIN_S:
            best, best_s = order, time_s
    return best_s, best


class _Tours:
    """Draws orders: open tours through both ends of every stretch, whose two ends stay neighbours.

    Number k of a stretch in its direction is the end at which it is begun, and k ^ 1 the one at which it is left.
    """

    def __init__(self, costs: OrderCosts, rng: np.random.Generator) -> None:
        self._rng = rng
        numbers = np.arange(len(costs.link_s))
        link_s = np.empty_like(costs.link_s)
        link_s[numbers ^ 1] = costs.link_s
        self._link_s = 0.5 * (link_s + link_s.T)
        self._home_s = np.empty(len(numbers))
        self._home_s[numbers ^ 1] = costs.back_s
        self._by_home_s = 2.0 * np.minimum(self._home_s[:, None], self._home_s[None])
        self._longest_s = float(link_s.max()) + float(self._by_home_s.max())

    def drawn(self, order: IntArray) -> IntArray:
        """Another order, near to this one or to none."""
        rng, free = self._rng, len(self._link_s)
        if rng.random() < _ANEW:
            order = 2 * rng.permutation(len(order))
        metric = self._metric()
        begin = np.concatenate([[free], np.column_stack([order, order ^ 1]).ravel()])
        tour = shorten(metric, nearest(metric, min(_NEAR, free)), begin, _KICKS, rng)
        at = int(np.flatnonzero(tour == free)[0])
        return np.asarray(np.roll(tour, -at)[1::2])

    def _metric(self) -> FloatArray:
        """(m + 1, m + 1) symmetric: what ends apart cost, with errors; the last place is where the tour is open."""
        rng, free = self._rng, len(self._link_s)
        error = rng.uniform(*_NOISE)
        factor = np.triu(rng.uniform(1.0 - error, 1.0 + error, (free, free)))
        metric = np.zeros((free + 1, free + 1))
        metric[:free, :free] = (self._link_s + rng.uniform(0.0, _HOME) * self._by_home_s) * (factor + factor.T)
        metric[:free, free] = metric[free, :free] = self._home_s * rng.random()
        begins = np.arange(0, free, 2)
        metric[begins, begins + 1] = metric[begins + 1, begins] = -10.0 * (2.0 * self._longest_s + 1.0)
        np.fill_diagonal(metric, 0.0)
        return metric
