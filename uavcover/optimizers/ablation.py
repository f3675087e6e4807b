"""IMODBO's three improvements one by one: added to MODBO alone, or taken from IMODBO alone; a class for each.

The improvements: the Latin hypercube (Eq. 19), the dynamic k and b (Eq. 20, 21), the sine-cosine disturbance (Eq. 22, 23).
"""

import numpy as np

from uavcover.optimizers.dung_beetle_moves import (
    Area,
    disturbed_small_beetle,
    dynamic_deflection,
    dynamic_step,
    small_beetle,
)
from uavcover.optimizers.imodbo import IMODBO
from uavcover.optimizers.interface import FloatArray
from uavcover.optimizers.modbo import MODBO


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

    def _walk_small_beetles(self, x: FloatArray, area: Area, rng: np.random.Generator) -> FloatArray:
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

    def _walk_small_beetles(self, x: FloatArray, area: Area, rng: np.random.Generator) -> FloatArray:
        return small_beetle(x, area, rng=rng)  # Eq. 17
