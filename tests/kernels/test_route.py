import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.compiled_kernels import cases
from tests.naive import route as naive
from uavcover.kernels import route as kernels

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=25, interpreted=8))

coordinates = st.one_of(st.integers(-2, 2).map(float), st.floats(-100, 100, width=32))


def points(least, most):
    return hnp.arrays(np.float64, st.tuples(st.integers(least, most), st.just(3)), elements=coordinates)


@deterministic
@given(points(0, 9), points(1, 1))
def test_nearest_neighbour_order_equals_the_naive_twin(positions, reference):
    positions.setflags(write=False)
    expected = naive.nearest_neighbour_order(positions.tolist(), reference[0].tolist())
    assert kernels.nearest_neighbour_order(positions, reference[0]).tolist() == expected


@deterministic
@given(points(0, 8), st.randoms(use_true_random=False))
def test_two_opt_is_a_permutation_never_longer_with_the_first_in_place(positions, random):
    order = list(range(len(positions)))
    random.shuffle(order)
    before = np.array(order, dtype=np.int64)
    after = kernels.two_opt(positions, before)
    assert before.tolist() == order
    assert sorted(after.tolist()) == list(range(len(positions)))
    assert after[:1].tolist() == order[:1]
    assert kernels.path_length(positions[after]) <= kernels.path_length(positions[before]) + 1e-9


def test_regression_two_opt_of_part_of_the_points_read_beyond_its_distances():
    positions = np.random.default_rng(2).random((9, 3))
    assert sorted(kernels.two_opt(positions, np.array([7, 1, 4, 8, 2])).tolist()) == [1, 2, 4, 7, 8]


def test_two_opt_comes_close_to_the_best_order():
    gaps = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        positions = rng.random((7, 3))
        order = kernels.two_opt(positions, rng.permutation(7))
        best = naive.best_open_tour_length(positions.tolist(), int(order[0]))
        gaps.append(kernels.path_length(positions[order]) / best - 1.0)
    # Stated: the optimum in most cases, within 15 % in all, 2 % on average.
    assert min(gaps) >= -1e-12
    assert sum(gap < 1e-9 for gap in gaps) >= 15
    assert max(gaps) < 0.15
    assert np.mean(gaps) < 0.02


def test_two_opt_shortens_what_nearest_neighbour_leaves():
    positions = np.random.default_rng(8).random((60, 3)) * [1000.0, 1000.0, 10.0]
    start = kernels.nearest_neighbour_order(positions, np.zeros(3))
    order = kernels.two_opt(positions, start)
    # Nearest neighbour wastes a quarter on average.
    assert kernels.path_length(positions[order]) < 0.9 * kernels.path_length(positions[start])
    # Nothing is left to gain: running it again changes nothing.
    assert kernels.two_opt(positions, order).tolist() == order.tolist()


def test_or_opt_moves_a_stretch_that_reversing_cannot():
    line = np.array([[x, 0.0, 0.0] for x in range(12)], dtype=float)
    for order in (
        [0, 5, 6, 7, 1, 2, 3, 4, 8, 9, 10, 11],
        [0, 1, 2, 3, 7, 8, 9, 10, 4, 5, 6, 11],
        [0, *range(2, 12), 1],
    ):
        assert kernels.two_opt(line, np.array(order)).tolist() == list(range(12))


@deterministic
@given(points(0, 6))
def test_length_equals_the_naive_twin(route):
    route.setflags(write=False)
    assert kernels.path_length(route) == pytest.approx(naive.path_length(route.tolist()), rel=1e-12)
