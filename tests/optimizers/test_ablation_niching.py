"""Each variant of imodbo-niching differs from it where it says, and only there."""

import numpy as np
import pytest

from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.optimizers.ablations import CHOICE_VARIANTS, SEARCH_VARIANTS
from uavcover.optimizers.imodbo_niching import ImodboNiching

PROBLEM = PROBLEMS["MMF1_e"]
LOCAL = PROBLEMS["MMF15_l"]


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
