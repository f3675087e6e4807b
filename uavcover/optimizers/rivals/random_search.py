"""Uniform random search: the floor that every other algorithm has to stand above."""

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.ask_tell import AskTellOptimizer


class RandomSearch(AskTellOptimizer):
    """Independent uniform samples in every round; see `AskTellOptimizer` for the arguments."""

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)
