"""Relatives of IMODBO: DBO for one objective, from which it comes, and variants that lack or add a part.

Equations of DBO are numbered as in Xue and Shen, "Dung beetle optimizer: a new meta-heuristic algorithm for global optimization",
The Journal of Supercomputing 79, 2023. The moves are the ones that MODBO uses, so each line names both numbers.

Variants show what each part is worth. IMODBO's three improvements are added to MODBO alone, or taken from IMODBO alone: the
Latin hypercube (Eq. 19), the dynamic k and b (Eq. 20, 21), the sine-cosine disturbance (Eq. 22, 23).

``OwnBest`` variants have the survival of the single-objective DBO: each beetle keeps the best place it has been at. The paper
does not say who survives. Our frame lets parents and offspring compete by front and crowding; these variants are the other
reading, kept to compare with (docs/explanation/fidelity.md).
"""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.dominance import non_dominated_ranks
from uavcover.optimizers.ask_tell import AskTellOptimizer, Solutions
from uavcover.optimizers.imodbo import (
    IMODBO,
    MODBO,
    DungBeetleOptimizer,
    Region,
    Swarm,
    area_around,
    breeder,
    disturbed_small_beetle,
    dynamic_deflection,
    dynamic_step,
    group_sizes,
    roller,
    small_beetle,
    thief,
)


class DBO(AskTellOptimizer):
    """Rollers, breeders, small beetles and thieves for a single objective; arguments as `AskTellOptimizer`.

    As in the original, a beetle stays in its group, moves from the best place it has ever been at, and eggs stay inside the
    oviposition area. Parameters are the original's: k = 0.1, b = 0.3, S = 0.5.
    """

    smallest_population: ClassVar[int] = 4  # one beetle in each group
    most_objectives: ClassVar[int | None] = 1
    deflection: ClassVar[float] = 0.1  # k
    step: ClassVar[float] = 0.3  # b
    theft_constant: ClassVar[float] = 0.5  # S

    _own_best: Solutions  # of each beetle
    _previous: FloatArray  # (n, d): where that was one round earlier, x(t-1)
    _current_best: FloatArray  # (d,): X*, of the last evaluated round
    _current_worst: FloatArray  # (d,): X^w, of the last evaluated round

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        x, here, worst = self._own_best.x, self._current_best, self._current_worst
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

    def _area_around(self, centre: FloatArray) -> Region:
        return area_around(centre, self._box.lower, self._box.upper, t=self._iteration, t_max=self._max_iterations)

    def _learn(self, evaluated: Solutions) -> None:
        order = np.lexsort((evaluated.objectives[:, 0], evaluated.total_violation))  # feasibility rules
        self._current_best, self._current_worst = evaluated.x[order[0]], evaluated.x[order[-1]]
        if self._iteration == 0:
            self._own_best, self._previous = evaluated, evaluated.x
            return
        old = self._own_best
        same = evaluated.total_violation == old.total_violation
        better = np.where(
            same, evaluated.objectives[:, 0] < old.objectives[:, 0], evaluated.total_violation < old.total_violation
        )
        self._previous = old.x
        n = self._population_size
        self._own_best = old.followed_by(evaluated).rows(np.where(better, n + np.arange(n), np.arange(n)))

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        if self._iteration == 0:
            return {}
        return {
            "x": self._own_best.x,
            "objectives": self._own_best.objectives,
            "violations": self._own_best.violations,
            "previous": self._previous,
            "current_best": self._current_best,
            "current_worst": self._current_worst,
        }

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        self._own_best = Solutions(memory["x"], memory["objectives"], memory["violations"])
        self._previous = memory["previous"]
        self._current_best, self._current_worst = memory["current_best"], memory["current_worst"]


def _each(position: FloatArray, members: IntArray) -> FloatArray:
    """The same ``(d,)`` position for each member: ``(g, d)``."""
    return np.broadcast_to(position, (len(members), len(position)))


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
