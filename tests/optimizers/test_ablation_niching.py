"""Each part of imodbo-niching, taken away alone, changes what it should, and nothing else."""

from types import MappingProxyType
from typing import ClassVar, Final

import numpy as np
import pytest

from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.kernels.arrays import IntArray
from uavcover.optimizers.imodbo_niching import ImodboNiching, NichePool

PROBLEM = PROBLEMS["MMF1_e"]
LOCAL = PROBLEMS["MMF15_l"]


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


def searched(algorithm, problem=PROBLEM):
    optimizer = algorithm(
        problem.lower,
        problem.upper,
        n_objectives=problem.n_objectives,
        local_sets_wanted=problem.local_sets_wanted,
        population_size=40,
        max_iterations=60,
        archive_size=20,
        seed=2,
    )
    while not optimizer.should_stop:
        optimizer.tell(problem.evaluate(optimizer.ask()))
    return optimizer


@pytest.fixture(scope="module")
def whole():
    return searched(ImodboNiching)


def same_pool(one, other):
    return np.array_equal(one.state_dict()["memory"]["pool"], other.state_dict()["memory"]["pool"])


@pytest.mark.parametrize("name", CHOICE_VARIANTS)
@pytest.mark.no_cover
def test_a_variant_of_the_choice_chooses_otherwise_from_the_same_pool(name, whole):
    variant = searched(CHOICE_VARIANTS[name])
    assert same_pool(variant, whole)
    assert not np.array_equal(variant.pareto_set().x, whole.pareto_set().x)


@pytest.mark.parametrize("name", sorted(SEARCH_VARIANTS.keys() - {"-shadow"}))
def test_a_variant_of_the_search_fills_another_pool(name, whole):
    assert not same_pool(searched(SEARCH_VARIANTS[name]), whole)


@pytest.mark.no_cover
def test_the_shadow_of_the_scouts_is_missed_where_local_sets_are_wanted_and_only_there(whole):
    without = SEARCH_VARIANTS["-shadow"]
    assert same_pool(searched(without), whole)
    assert len(searched(without, LOCAL)._pool) > len(searched(ImodboNiching, LOCAL)._pool)
