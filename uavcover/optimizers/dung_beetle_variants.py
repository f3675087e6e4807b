"""Relatives of IMODBO: DBO for one objective, its origin, and variants that lack or add a part.

Equations of DBO are numbered as in Xue and Shen, "Dung beetle optimizer: a new meta-heuristic algorithm for global optimization",
The Journal of Supercomputing 79, 2023. MODBO uses the same moves, so each line names both numbers.

Variants show the effect of each part. IMODBO's three improvements are added to MODBO one at a time, or removed from IMODBO one at
a time: the Latin hypercube (Eq. 19), the dynamic k and b (Eq. 20, 21), the sine-cosine disturbance (Eq. 22, 23).

``OwnBest`` variants have the survival of the single-objective DBO: each beetle keeps its best position. The paper does not
specify the survival. In our frame, parents and offspring compete by front and crowding; these variants are the other
interpretation, for comparison (docs/explanation/fidelity.md).
"""

from typing import ClassVar

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.dominance import non_dominated_ranks
from uavcover.optimizers.ask_tell import Solutions
from uavcover.optimizers.imodbo import (
    IMODBO,
    MODBO,
    ModboPlusDynamicParameters,
    ModboPlusLatinHypercube,
    ModboPlusSineCosine,
    breeder,
    group_sizes,
    roller,
    small_beetle,
    thief,
)


class DBO(MODBO):
    """Rollers, breeders, small beetles and thieves for a single objective; arguments as `AskTellOptimizer`.

    As in the original, a beetle stays in its group, moves from the best place it has ever been at, and eggs stay inside the
    oviposition area. Parameters are the original's: k = 0.1, b = 0.3, S = 0.5.
    """

    most_objectives: ClassVar[int | None] = 1
    deflection: ClassVar[float] = 0.1  # k
    step: ClassVar[float] = 0.3  # b
    theft_constant: ClassVar[float] = 0.5  # S
    remembered: ClassVar[tuple[str, ...]] = ("previous", "current_best", "current_worst")

    _alive: Solutions  # the best position of each beetle; _previous is the one of the round before, x(t-1)
    _current_best: FloatArray  # (d,): X*, of the last evaluated round
    _current_worst: FloatArray  # (d,): X^w, of the last evaluated round

    def _move(self, rng: np.random.Generator) -> FloatArray:
        x, here, worst = self._alive.x, self._current_best, self._current_worst
        ever = self._archive.solutions.x[0]  # X^b
        n = self._population_size
        rollers, breeders, smalls, thieves = np.split(np.arange(n), np.cumsum(group_sizes(n))[:-1])

        rolled = roller(
            x[rollers], self._previous[rollers], _each(worst, rollers), k=self.deflection, b=self.step, rng=rng
        )  # Eq. 1, 2 (9, 10, 11)

        area = self._area_around(_each(here, breeders))  # Eq. 3 (12, 13)
        laid = breeder(x[breeders], _each(here, breeders), area, rng=rng)  # Eq. 4 (14)
        bred = np.clip(laid, area.lower, area.upper)  # Algorithm 2 of the original: eggs stay in the area

        area = self._area_around(_each(ever, smalls))  # Eq. 5 (15, 16)
        walked = small_beetle(x[smalls], area, rng=rng)  # Eq. 6 (17)

        stolen = thief(
            x[thieves], _each(here, thieves), _each(ever, thieves), s=self.theft_constant, rng=rng
        )  # Eq. 7 (18)
        return np.concatenate([rolled, bred, walked, stolen])

    def _learn(self, evaluated: Solutions) -> None:
        order = np.lexsort((evaluated.objectives[:, 0], evaluated.total_violation))  # feasibility rules
        self._current_best, self._current_worst = evaluated.x[order[0]], evaluated.x[order[-1]]
        if self._iteration == 0:
            self._alive, self._previous = evaluated, evaluated.x
            return
        old = self._alive
        same = evaluated.total_violation == old.total_violation
        better = np.where(
            same, evaluated.objectives[:, 0] < old.objectives[:, 0], evaluated.total_violation < old.total_violation
        )
        self._previous = old.x
        n = self._population_size
        self._alive = old.followed_by(evaluated).rows(np.where(better, n + np.arange(n), np.arange(n)))


def _each(position: FloatArray, members: IntArray) -> FloatArray:
    """The same ``(d,)`` position for each member: ``(g, d)``."""
    return np.broadcast_to(position, (len(members), len(position)))


class ImodboMinusLatinHypercube(ModboPlusDynamicParameters, ModboPlusSineCosine):
    """IMODBO whose first population is uniform."""


class ImodboMinusDynamicParameters(ModboPlusLatinHypercube, ModboPlusSineCosine):
    """IMODBO with the fixed k and b of MODBO (Table 2)."""


class ImodboMinusSineCosine(ModboPlusLatinHypercube, ModboPlusDynamicParameters):
    """IMODBO whose small beetles are not disturbed."""


class ModboOwnBest(MODBO):
    """MODBO whose beetles keep their own best position.

    A beetle moves to its new position only if that dominates the current one, by the feasibility rules.
    """

    def _learn(self, evaluated: Solutions) -> None:
        if self._iteration == 0:
            super()._learn(evaluated)
            return
        order = np.argsort(self._parents)  # offspring in the order of their parents
        parents, offspring = self._alive, evaluated.rows(order)
        moved = _dominate(offspring, parents)[:, None]
        self._alive = Solutions(
            np.where(moved, offspring.x, parents.x),
            np.where(moved, offspring.objectives, parents.objectives),
            np.where(moved, offspring.violations, parents.violations),
        )
        self._previous = np.where(moved, parents.x, self._previous)
        self._ranks = non_dominated_ranks(self._alive.objectives, self._alive.total_violation)


def _dominate(these: Solutions, others: Solutions) -> BoolArray:
    """``(n,)`` whether each row dominates the same row of the others: less total violation, or equal and dominance."""
    no_worse = (these.objectives <= others.objectives).all(axis=1)
    better = (these.objectives < others.objectives).any(axis=1)
    equal = these.total_violation == others.total_violation
    dominating: BoolArray = np.where(equal, no_worse & better, these.total_violation < others.total_violation)
    return dominating


class ImodboOwnBest(ModboOwnBest, IMODBO):
    """IMODBO whose beetles keep their own best position."""
