"""MODBO and IMODBO with the survival of the single-objective DBO: each beetle keeps the best place it has been at.

The paper does not say who survives. Our frame lets parents and offspring compete by front and crowding; these variants
are the other reading, kept to compare with (docs/fidelity.md).
"""

import numpy as np
import numpy.typing as npt

from uavcover.kernels.dominance import non_dominated_ranks
from uavcover.optimizers.dung_beetle import DungBeetleOptimizer, Swarm
from uavcover.optimizers.imodbo import IMODBO
from uavcover.optimizers.modbo import MODBO
from uavcover.optimizers.solutions import Solutions

BoolArray = npt.NDArray[np.bool_]


class _OwnBest(DungBeetleOptimizer):
    """A beetle goes to where it was sent only if that dominates where it is, by the feasibility rules."""

    def _learn(self, told: Solutions) -> None:
        if self._iteration == 0:
            super()._learn(told)
            return
        order = np.argsort(self._parents)  # offspring in the order of their parents
        parents, offspring = self._swarm.solutions, told.rows(order)
        moved = _dominate(offspring, parents)[:, None]
        alive = Solutions(
            np.where(moved, offspring.x, parents.x),
            np.where(moved, offspring.objectives, parents.objectives),
            np.where(moved, offspring.violations, parents.violations),
        )
        previous = np.where(moved, parents.x, self._swarm.previous)
        self._swarm = Swarm(alive, previous, non_dominated_ranks(alive.objectives, alive.total_violation))


def _dominate(these: Solutions, others: Solutions) -> BoolArray:
    """``(n,)`` whether each row dominates the same row of the others: less total violation, or equal and dominance."""
    no_worse = (these.objectives <= others.objectives).all(axis=1)
    better = (these.objectives < others.objectives).any(axis=1)
    equal = these.total_violation == others.total_violation
    dominating: BoolArray = np.where(equal, no_worse & better, these.total_violation < others.total_violation)
    return dominating


class ModboOwnBest(_OwnBest, MODBO):
    """MODBO whose beetles keep their own best place."""


class ImodboOwnBest(_OwnBest, IMODBO):
    """IMODBO whose beetles keep their own best place."""
