"""The parts of `ImodboNiching`, each taken away alone; a class for each. Not in the registry: ``scripts/ablate_niching.py``."""

from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np

from uavcover.optimizers.imodbo_niching import ImodboNiching
from uavcover.optimizers.interface import IntArray
from uavcover.optimizers.niching import NichePool


class MinusNiches(ImodboNiching):
    """Solutions compete wherever they are: one niche as large as the box."""

    global_niche_radius: ClassVar[float] = np.inf
    local_niche_radius: ClassVar[float] = np.inf


class MinusNearLeaders(ImodboNiching):
    """Beetles follow any member of the pool."""

    def _followable(self, around: IntArray, rng: np.random.Generator) -> IntArray:
        anyone = rng.integers(0, len(self._pool), (len(around), self.leaders_at_hand))
        return np.column_stack([around[:, :1], anyone])


class MinusFollowers(ImodboNiching):
    """The groups of IMODBO; thieves take the followers' places at the end."""

    exploring_groups: ClassVar[tuple[float, ...]] = (0.2, 0.2, 0.25, 0.35, 0.0, 0.0)
    settling_groups: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.6, 0.0, 0.4)


class MinusSmoothers(ImodboNiching):
    """Thieves and followers share the smoothers' places."""

    settling_groups: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.4, 0.6, 0.0)


class MinusShadow(ImodboNiching):
    """What scouts dominate stays, if local sets are wanted; the same algorithm if they are not."""

    def _reviewed(self) -> NichePool:
        return self._pool if self._local_sets_wanted else super()._reviewed()


class MinusMedoids(ImodboNiching):
    """The result is spread by farthest points in decision space only."""

    medoid_passes: ClassVar[int] = 0


class MinusLeastWeight(ImodboNiching):
    """The front has the same weight in every choice."""

    front_weights: ClassVar[tuple[float, ...]] = (1.2,)


class MinusCrowds(ImodboNiching):
    """Every row counts the same in decision space, in a crowd or alone."""

    crowd_radius: ClassVar[float] = 0.0


SEARCH_VARIANTS: Final = MappingProxyType[str, type[ImodboNiching]](
    {
        "-niches": MinusNiches,
        "-near leaders": MinusNearLeaders,
        "-followers": MinusFollowers,
        "-smoothers": MinusSmoothers,
        "-shadow": MinusShadow,
    }
)
"""Variants that search in another way."""

CHOICE_VARIANTS: Final = MappingProxyType[str, type[ImodboNiching]](
    {"-medoids": MinusMedoids, "-least weight": MinusLeastWeight, "-crowds": MinusCrowds}
)
"""Variants that choose in another way from the same pool."""
