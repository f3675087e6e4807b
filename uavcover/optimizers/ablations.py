"""Variants that show what each part of IMODBO is worth; a class for each.

IMODBO's three improvements are added to MODBO alone, or taken from IMODBO alone: the Latin hypercube (Eq. 19), the dynamic k
and b (Eq. 20, 21), the sine-cosine disturbance (Eq. 22, 23).

``OwnBest`` variants have the survival of the single-objective DBO: each beetle keeps the best place it has been at. The paper
does not say who survives. Our frame lets parents and offspring compete by front and crowding; these variants are the other
reading, kept to compare with (docs/explanation/fidelity.md).
"""

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.dominance import non_dominated_ranks
from uavcover.optimizers.dung_beetle_moves import (
    Region,
    disturbed_small_beetle,
    dynamic_deflection,
    dynamic_step,
    small_beetle,
)
from uavcover.optimizers.imodbo import IMODBO, MODBO, DungBeetleOptimizer, Swarm
from uavcover.optimizers.interface import Solutions


class ModboPlusLatinHypercube(MODBO):
    """MODBO whose first population is a Latin hypercube."""

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.latin_hypercube(self._population_size, rng)  # Eq. 19


class ModboPlusDynamicParameters(MODBO):
    """MODBO whose k and b change with time."""

    def _roller_coefficients(self) -> tuple[float, float]:
        t, t_max = self._iteration, self._max_iterations
        return dynamic_deflection(t, t_max), dynamic_step(t, t_max)  # Eq. 21, 20


class ModboPlusSineCosine(MODBO):
    """MODBO whose small beetles are disturbed by sine and cosine."""

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        return disturbed_small_beetle(x, area, t=self._iteration, t_max=self._max_iterations, rng=rng)  # Eq. 22, 23


class ImodboMinusLatinHypercube(IMODBO):
    """IMODBO whose first population is uniform."""

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)


class ImodboMinusDynamicParameters(IMODBO):
    """IMODBO with the fixed k and b of MODBO (Table 2)."""

    def _roller_coefficients(self) -> tuple[float, float]:
        return MODBO.deflection, MODBO.step


class ImodboMinusSineCosine(IMODBO):
    """IMODBO whose small beetles are not disturbed."""

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        return small_beetle(x, area, rng=rng)  # Eq. 17


class _OwnBest(DungBeetleOptimizer):
    """A beetle goes to where it was sent only if that dominates where it is, by the feasibility rules."""

    def _learn(self, evaluated: Solutions) -> None:
        if self._iteration == 0:
            super()._learn(evaluated)
            return
        order = np.argsort(self._parents)  # offspring in the order of their parents
        parents, offspring = self._swarm.solutions, evaluated.rows(order)
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
