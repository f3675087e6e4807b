"""MOWOA: the multi-objective whale optimization algorithm.

Equations are numbered as in Mirjalili and Lewis, "The whale optimization algorithm", Advances in Engineering Software 95,
2016, which has one objective. Its best whale X* becomes, for each whale, a leader drawn from the archive.
"""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.interface import Solutions


def swim(
    x: FloatArray, best: FloatArray, other: FloatArray, *, a: float, spiral: float, rng: np.random.Generator
) -> FloatArray:
    """New positions of whales: around X*, towards or away from another whale, or along a spiral to X*.

    Draws ``random((n, 1))`` four times: for A, for C, for l, for p; one number for all variables of a whale, because
    ``|A| < 1`` and ``p < 0.5`` decide for the whole whale.

    Args:
        x: ``(n, d)`` positions X(t).
        best: ``(n, d)`` X* of each.
        other: ``(n, d)`` X_rand of each.
        a: falls from 2 to 0 over the rounds.
        spiral: b, the shape of the spiral.
        rng: source of random numbers.

    Returns:
        ``(n, d)`` positions X(t+1).
    """
    each = (len(x), 1)
    big_a = 2 * a * rng.random(each) - a  # Eq. 2.3
    c = 2 * rng.random(each)  # Eq. 2.4
    length = 2 * rng.random(each) - 1  # l in [-1, 1]
    p = rng.random(each)
    around = best - big_a * np.abs(c * best - x)  # Eq. 2.1, 2.2
    search = other - big_a * np.abs(c * other - x)  # Eq. 2.7, 2.8
    turn = np.exp(spiral * length) * np.cos(2 * np.pi * length)
    along = np.abs(best - x) * turn + best  # Eq. 2.5
    return np.where(p < 0.5, np.where(np.abs(big_a) < 1, around, search), along)  # Eq. 2.6


class MOWOA(AskTellOptimizer):
    """Whales around leaders of the archive; arguments as `AskTellOptimizer`. Table 2: no parameters.

    Whales go where they swim, better or not; the archive is the memory.
    """

    spiral: ClassVar[float] = 1.0  # b, as the original

    _whales: FloatArray  # (n, d) positions X(t)

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        n = self._population_size
        a = 2 - 2 * self._iteration / self._max_iterations
        best = self._archive.leaders(n, rng)
        other = self._whales[rng.integers(0, n, n)]
        return swim(self._whales, best, other, a=a, spiral=self.spiral, rng=rng)

    def _learn(self, evaluated: Solutions) -> None:
        self._whales = evaluated.x

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        return {} if self._iteration == 0 else {"whales": self._whales}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        self._whales = memory["whales"]
