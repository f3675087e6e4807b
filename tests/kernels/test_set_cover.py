import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.naive import set_cover as naive
from uavcover.kernels import set_cover as kernels
from uavcover.kernels.set_cover import search_cover

ITEMS = 9


def table(sets):
    start = np.concatenate([[0], np.cumsum([len(s) for s in sets])]).astype(np.int64)
    return start, np.array([item for s in sets for item in sorted(s)], dtype=np.int32)


some_sets = st.lists(st.frozensets(st.integers(0, ITEMS - 1)), min_size=1, max_size=8)
# Multiples of 1/8, whose sums are exact in any order.
some_weights = st.lists(st.integers(1, 8).map(lambda k: k / 8.0), min_size=ITEMS, max_size=ITEMS).map(np.array)


def random_sets(seed, count, *, items=ITEMS, largest=4):
    rng = np.random.default_rng(seed)
    sets = [
        frozenset(rng.choice(items, size=rng.integers(1, largest + 1), replace=False).tolist()) for _ in range(count)
    ]
    return [*sets, frozenset(range(items)) - frozenset().union(*sets)]


@given(some_sets)
@settings(max_examples=cases(compiled=60, interpreted=6), deadline=None)
def test_transposed_lists_the_sets_of_each_item(sets):
    back, numbers = kernels.transposed(*table(sets), ITEMS)
    for item in range(ITEMS):
        assert numbers[back[item] : back[item + 1]].tolist() == [k for k, s in enumerate(sets) if item in s]


@given(some_sets, some_weights, st.sampled_from([0.5, 2.0, 100.0]), st.integers(0, 5))
@settings(max_examples=cases(compiled=100, interpreted=6), deadline=None)
def test_the_greedy_choice_agrees_with_its_twin(sets, weight, enough, most):
    assert kernels.choose_greedily(*table(sets), weight, enough, most).tolist() == naive.greedily(
        sets, weight, enough, most
    )


@given(some_sets)
@settings(max_examples=cases(compiled=150, interpreted=6), deadline=None)
def test_undominated_agrees_with_comparing_all_pairs(sets):
    assert kernels.undominated(*table(sets), ITEMS).tolist() == naive.undominated(sets)


@given(some_sets, some_weights, st.sampled_from([1.0, 2.5, 100.0]), st.integers(1, 8))
@settings(max_examples=cases(compiled=100, interpreted=6), deadline=None)
def test_what_is_left_after_dropping_is_enough_and_nothing_more_can_go(sets, weight, enough, most):
    everything = np.arange(len(sets))
    left = kernels.drop_needless(*table(sets), weight, everything, enough, most).tolist()
    assert len(left) <= most
    if naive.worth(sets, weight, everything) < enough or len(left) == most:
        return
    assert naive.worth(sets, weight, left) >= enough
    assert all(naive.worth(sets, weight, [k for k in left if k != out]) < enough for out in left)


@pytest.mark.parametrize("seed", range(25))
def test_the_local_search_finds_the_fewest_sets_of_small_cases(seed):
    sets = random_sets(seed, 14)
    first = np.array([k for k, s in enumerate(sets)])
    found = search_cover(*table(sets), ITEMS, first, 2000, np.random.default_rng(1))
    assert naive.covered(sets, found) == set(range(ITEMS))
    assert len(found) == naive.fewest(sets, np.ones(ITEMS), ITEMS)


def test_the_local_search_gives_back_its_beginning_when_it_may_do_nothing():
    sets = random_sets(3, 14)
    first = np.arange(len(sets))
    assert search_cover(*table(sets), ITEMS, first, 0, np.random.default_rng(1)).tolist() == first.tolist()


def test_one_set_of_everything_is_enough():
    sets = [frozenset({0, 1}), frozenset(range(ITEMS)), frozenset({4})]
    assert search_cover(*table(sets), ITEMS, np.array([0, 1, 2]), 50, np.random.default_rng(1)).tolist() == [1]
