"""MOGWO: the multi-objective grey wolf optimizer.

Equations are numbered as in Mirjalili, Mirjalili and Lewis, "Grey wolf optimizer", Advances in Engineering Software 69, 2014;
the archive and the choice of leaders are those of the multi-objective version (2016), see `uavcover.optimizers.grid`.
"""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.optimizers.archive import Archive
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.grid import LeaderChoice, cells, thinned
from uavcover.optimizers.interface import FloatArray, IntArray
from uavcover.optimizers.solutions import Solutions


def encircle(x: FloatArray, leader: FloatArray, *, a: float, rng: np.random.Generator) -> FloatArray:
    """Where one leader would have its wolves go. Draws ``random((n, d))`` for r1, then for r2.

    Args:
        x: ``(n, d)`` positions X(t).
        leader: ``(n, d)`` alpha, beta or delta of each.
        a: falls from 2 to 0 over the rounds.
        rng: source of random numbers.

    Returns:
        ``(n, d)``: X1, X2 or X3.
    """
    big_a = 2 * a * rng.random(x.shape) - a  # Eq. 3.3
    c = 2 * rng.random(x.shape)  # Eq. 3.4
    distance = np.abs(c * leader - x)  # Eq. 3.5
    return leader - big_a * distance  # Eq. 3.6


class MOGWO(AskTellOptimizer):
    """Grey wolves that follow three leaders from the least crowded cells of a grid; arguments as `AskTellOptimizer`.

    Wolves go where they are sent, better or not; the archive is the memory. Table 2 has beta = 10, the original 4. Its gamma
    belongs to the authors' code, which removes from a cell drawn by count ** gamma; here the most crowded cell loses a member,
    as their text says, because with gamma = 2 the archive loses the ends of the front (docs/optimizers.md has the figures).
    """

    n_grid: ClassVar[int] = 10  # Table 2
    grid_inflation: ClassVar[float] = 0.1  # alpha, Table 2
    leader_pressure: ClassVar[float] = 10.0  # beta, Table 2

    _wolves: FloatArray  # (n, d) positions X(t)

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        a = 2 - 2 * self._iteration / self._max_iterations
        best = self._archive.solutions
        choice = LeaderChoice.of(self._cells(best), pressure=self.leader_pressure)
        taken = np.empty((self._population_size, 0), np.int64)
        pulled = np.zeros_like(self._wolves)
        for _ in range(3):  # delta, beta, alpha: different ones as long as there are any
            row = choice.drawn(self._population_size, taken, rng)
            taken = np.column_stack([taken, row])
            pulled += encircle(self._wolves, best.x[row], a=a, rng=rng)
        return pulled / 3  # Eq. 3.7

    def _cells(self, solutions: Solutions) -> IntArray:
        return cells(solutions.objectives, n_grid=self.n_grid, inflation=self.grid_inflation)

    def _archive_with(self, told: Solutions) -> Archive:
        merged = self._archive.non_dominated_with(told)
        kept = thinned(self._cells(merged), self._archive.capacity, rng=self._rngs["moves"])
        return Archive(merged.rows(kept), self._archive.capacity)

    def _learn(self, told: Solutions) -> None:
        self._wolves = told.x

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        return {} if self._iteration == 0 else {"wolves": self._wolves}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        self._wolves = memory["wolves"]
