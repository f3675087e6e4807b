"""IMODBO: the paper's improved multi-objective dung beetle optimizer."""

import numpy as np

from uavcover.optimizers.dung_beetle import DungBeetleOptimizer
from uavcover.optimizers.dung_beetle_moves import (
    Area,
    disturbed_small_beetle,
    dynamic_deflection,
    dynamic_step,
)
from uavcover.optimizers.interface import FloatArray


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

    def _walk_small_beetles(self, x: FloatArray, area: Area, rng: np.random.Generator) -> FloatArray:
        return disturbed_small_beetle(x, area, t=self._iteration, t_max=self._max_iterations, rng=rng)
