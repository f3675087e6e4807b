"""The paper's method: MODBO, and IMODBO, the improved multi-objective dung beetle optimizer.

Both share one frame: four groups, one archive, survival of the better ones. The paper gives the moves but not the
multi-objective frame around them. What is filled in here is written down, with the reasons, in docs/explanation/imodbo.md.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.dung_beetle_moves import (
    Region,
    area_around,
    breeder,
    disturbed_small_beetle,
    dynamic_deflection,
    dynamic_step,
    roller,
    small_beetle,
    thief,
)
from uavcover.optimizers.interface import Solutions, survivors

# Percentages: rollers, breeders, small beetles, thieves; from the 6, 6, 7 and 11 of 30 of the single-objective DBO.
GROUP_SHARES: Final = (20, 20, 25, 35)


def group_sizes(population_size: int) -> IntArray:
    """``(4,)`` beetles in each group: the shares rounded so that they add up, larger remainders first.

    >>> group_sizes(50).tolist(), group_sizes(30).tolist()
    ([10, 10, 12, 18], [6, 6, 7, 11])
    """
    hundredths = population_size * np.array(GROUP_SHARES, dtype=np.int64)
    sizes = hundredths // 100
    short = population_size - int(sizes.sum())
    # stable: of equal remainders the later group (thieves before small beetles) gets the beetle
    by_remainder = np.lexsort((-np.arange(4), -(hundredths % 100)))
    sizes[by_remainder[:short]] += 1
    return sizes


@dataclass(frozen=True, slots=True, eq=False)
class Swarm:
    """The beetles alive: n solutions, where each came from and how good it is.

    Attributes:
        solutions: n rows, their x is x(t).
        previous: ``(n, d)`` x(t-1) of each; its own x as long as it has not moved.
        ranks: ``(n,)`` front of each, 0 is the first.
    """

    solutions: Solutions
    previous: FloatArray
    ranks: IntArray

    def drawn_from_front(self, rank: int, count: int, rng: np.random.Generator) -> FloatArray:
        """Decision vectors ``(count, d)`` of random members of one front."""
        members = np.flatnonzero(self.ranks == rank)
        return self.solutions.x[members[rng.integers(0, len(members), count)]]


class DungBeetleOptimizer(AskTellOptimizer):
    """Rollers, breeders, small beetles and thieves; see `AskTellOptimizer` for the arguments.

    Every round each beetle moves once, by the equations of the group it is drawn into; parents and offspring together
    are reduced to the population size by non-dominated sort and crowding.
    """

    smallest_population: ClassVar[int] = 4  # one beetle in each group
    theft_constant: ClassVar[float] = 0.25  # S, Table 2

    _swarm: Swarm
    _parents: IntArray

    @abstractmethod
    def _roller_coefficients(self) -> tuple[float, float]:
        """The k and b of Eq. 9 in this round."""

    @abstractmethod
    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        """New positions of small beetles ``(g, d)`` with these foraging areas."""

    def _move(self, rng: np.random.Generator) -> FloatArray:
        swarm, archive = self._swarm, self._archive
        parents = rng.permutation(self._population_size)  # groups are drawn anew in each round
        rollers, breeders, smalls, thieves = np.split(parents, np.cumsum(group_sizes(self._population_size))[:-1])
        x, worst_front = swarm.solutions.x, int(swarm.ranks.max())

        worst = swarm.drawn_from_front(worst_front, len(rollers), rng)
        k, b = self._roller_coefficients()
        rolled = roller(x[rollers], swarm.previous[rollers], worst, k=k, b=b, rng=rng)

        best = swarm.drawn_from_front(0, len(breeders), rng)
        bred = breeder(x[breeders], best, self._area_around(best), rng=rng)

        food = archive.leaders(len(smalls), rng)
        walked = self._walk_small_beetles(x[smalls], self._area_around(food), rng)

        best = swarm.drawn_from_front(0, len(thieves), rng)
        stolen = thief(x[thieves], best, archive.leaders(len(thieves), rng), s=self.theft_constant, rng=rng)

        self._parents = parents
        return np.concatenate([rolled, bred, walked, stolen])

    def _area_around(self, centre: FloatArray) -> Region:
        return area_around(centre, self._box.lower, self._box.upper, t=self._iteration, t_max=self._max_iterations)

    def _learn(self, evaluated: Solutions) -> None:
        if self._iteration == 0:
            alive, previous = evaluated, evaluated.x
        else:
            alive = self._swarm.solutions.followed_by(evaluated)
            # a survivor keeps the x(t-1) it has; an offspring comes from where its parent is
            previous = np.concatenate([self._swarm.previous, self._swarm.solutions.x[self._parents]])
        chosen, ranks = survivors(alive, self._population_size)
        self._swarm = Swarm(alive.rows(chosen), previous[chosen], ranks)

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        if self._iteration == 0:
            return {}
        swarm = self._swarm
        memory: dict[str, npt.NDArray[Any]] = {
            "x": swarm.solutions.x,
            "objectives": swarm.solutions.objectives,
            "violations": swarm.solutions.violations,
            "previous": swarm.previous,
            "ranks": swarm.ranks,
        }
        return memory | ({} if self._asked is None else {"parents": self._parents})

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        solutions = Solutions(memory["x"], memory["objectives"], memory["violations"])
        self._swarm = Swarm(solutions, memory["previous"], memory["ranks"])
        if "parents" in memory:
            self._parents = memory["parents"]


class MODBO(DungBeetleOptimizer):
    """Uniform first population, fixed k and b (Table 2), small beetles by Eq. 17; arguments as `AskTellOptimizer`."""

    deflection: ClassVar[float] = 0.2  # K, Table 2
    step: ClassVar[float] = 0.2  # b, Table 2

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _roller_coefficients(self) -> tuple[float, float]:
        return self.deflection, self.step

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        return small_beetle(x, area, rng=rng)


class IMODBO(DungBeetleOptimizer):
    """MODBO with the paper's three improvements; arguments as `AskTellOptimizer`.

    Latin hypercube for the first population (Eq. 19), k and b that change with time (Eq. 20, 21; the K and b of Table 2
    are not used), and small beetles disturbed by sine and cosine (Eq. 22, 23).
    """

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.latin_hypercube(self._population_size, rng)

    def _roller_coefficients(self) -> tuple[float, float]:
        t, t_max = self._iteration, self._max_iterations
        return dynamic_deflection(t, t_max), dynamic_step(t, t_max)

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        return disturbed_small_beetle(x, area, t=self._iteration, t_max=self._max_iterations, rng=rng)
