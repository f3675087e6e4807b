import itertools

import numba
import numpy as np
import pytest

from tests.naive import tour as naive
from uavcover.kernels.tours import nearest, short_tour, shorten_open


def some_points(seed, n):
    return np.random.default_rng([seed, n]).uniform(0.0, 10.0, (n, 3))


@pytest.mark.parametrize("n", [0, 1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("seed", range(4))
def test_a_few_points_are_visited_in_the_best_of_all_orders(seed, n):
    points = some_points(seed, n)
    before = points.copy()
    order = short_tour(points)
    assert sorted(order.tolist()) == list(range(n))
    assert naive.length(points, order) == pytest.approx(naive.shortest_open_tour(points))
    assert (points == before).all()


@pytest.mark.parametrize("n", [4, 9, 30, 150])
def test_it_is_never_longer_than_before_and_more_kicks_never_lengthen_it(n):
    points = some_points(1, n)
    order = np.random.default_rng(2).permutation(n)
    start = order.copy()
    lengths = [naive.length(points, order)]
    for kicks in (0, 10, 200):
        shorter = shorten_open(points, order, kicks, np.random.default_rng(3))
        assert sorted(shorter.tolist()) == list(range(n))
        lengths.append(naive.length(points, shorter))
    assert lengths == sorted(lengths, reverse=True)
    assert (order == start).all()


def test_part_of_the_points_stays_that_part():
    points = some_points(4, 12)
    assert sorted(shorten_open(points, np.array([7, 1, 4, 8, 2]), 5, np.random.default_rng(0))) == [1, 2, 4, 7, 8]


def test_equal_places_and_a_line_are_no_trouble():
    assert sorted(short_tour(np.zeros((20, 3)))) == list(range(20))
    line = np.column_stack([np.random.default_rng(0).permutation(40).astype(float), np.zeros((40, 2))])
    assert naive.length(line, short_tour(line)) == pytest.approx(39.0)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_nearest_agrees_with_sorting(count):
    points = np.round(some_points(5, 9))
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert nearest(distance, count).tolist() == naive.nearest(distance.tolist(), count)


MANY = pytest.param(
    300,
    marks=pytest.mark.skipif(
        numba.config.DISABLE_JIT, reason="takes half a minute interpreted; 60 reach the same lines"
    ),
)


@pytest.mark.parametrize("n", [20, 45, 60, MANY])
def test_within_one_percent_of_lkh(n):
    elkai = pytest.importorskip("elkai", reason="elkai (LKH) is not installed; it comes with the extra dev")
    points = some_points(6, n)
    units = np.zeros((n + 1, n + 1))
    units[:n, :n] = np.linalg.norm(points[:, None] - points[None], axis=2) * 1e4
    closed = elkai.DistanceMatrix(np.rint(units).astype(int).tolist()).solve_tsp(runs=3)[:-1]
    at = closed.index(n)
    assert naive.length(points, short_tour(points)) <= 1.01 * naive.length(points, closed[at + 1 :] + closed[:at])


@pytest.mark.parametrize("n", [1, 2, 3, 5, 7])
@pytest.mark.parametrize("seed", range(4))
def test_a_few_points_are_visited_in_the_best_of_all_orders_from_home_and_back(seed, n):
    points, home = some_points(seed, n), np.array([-3.0, 14.0, 500.0])

    def from_home_and_back(order):
        ends = np.array([points[order[0]], points[order[-1]]])[:, :2]
        return naive.length(points, order) + np.hypot(*(ends - home[:2]).T).sum()

    best = min(from_home_and_back(list(order)) for order in itertools.permutations(range(n)))
    assert from_home_and_back(short_tour(points, home)) == pytest.approx(best)
