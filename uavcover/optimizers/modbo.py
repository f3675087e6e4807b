"""MODBO: the multi-objective dung beetle optimizer that IMODBO improves on."""

from typing import ClassVar

import numpy as np

from uavcover.optimizers.dung_beetle import DungBeetleOptimizer
from uavcover.optimizers.dung_beetle_moves import Area, small_beetle
from uavcover.optimizers.interface import FloatArray


class MODBO(DungBeetleOptimizer):
    """Uniform first population, fixed k and b (Table 2), small beetles by Eq. 17; arguments as `AskTellOptimizer`."""

    deflection: ClassVar[float] = 0.2  # K, Table 2
    step: ClassVar[float] = 0.2  # b, Table 2

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _roller_coefficients(self) -> tuple[float, float]:
        return self.deflection, self.step

    def _walk_small_beetles(self, x: FloatArray, area: Area, rng: np.random.Generator) -> FloatArray:
        return small_beetle(x, area, rng=rng)
