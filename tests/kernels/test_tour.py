import itertools

import numpy as np
import pytest

from uavcover.kernels.tours import order_between_ends


def distances(points):
    return np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))


def length(distance, order):
    return sum(distance[a, b] for a, b in itertools.pairwise(order))


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("seed", range(6))
def test_within_a_tenth_of_the_best_of_all_orders_and_both_ends_stay(seed, n):
    points = np.random.default_rng([seed, n]).uniform(0.0, 100.0, (n, 2))
    distance = distances(points)
    order = order_between_ends(distance)
    assert sorted(order) == list(range(n))
    assert (order[0], order[-1]) == (0, n - 1)
    best = min(length(distance, (0, *middle, n - 1)) for middle in itertools.permutations(range(1, n - 1)))
    assert length(distance, order) <= 1.1 * best + 1e-9


def test_a_line_is_flown_out_and_back_when_start_and_end_are_one_place():
    points = np.array([[0.0, 0.0], [30.0, 0.0], [10.0, 1.0], [20.0, -1.0], [0.0, 0.0]])
    assert length(distances(points), order_between_ends(distances(points))) == pytest.approx(60.0, abs=0.3)
