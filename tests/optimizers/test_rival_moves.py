"""One hand-computed update per operator of MOGWO, MOWOA and MOSSA, with the random numbers given."""

import math

import numpy as np
import pytest

from tests.optimizers.given_numbers import GivenNumbers, near
from uavcover.optimizers.rivals import beware, encircle, produce, scrounge, swim

X = np.array([[1.0, -2.0]])
LEADER = np.array([[3.0, 4.0]])
E = math.e


def test_grey_wolf_eq_3_3_to_3_6():
    # A = 2a r1 - a = (0.5, -0.5), C = 2 r2 = (1, 0.5), D = (|3 - 1|, |2 + 2|): 3 - 0.5*2 and 4 + 0.5*4
    rng = GivenNumbers(("random", [[0.75, 0.25]]), ("random", [[0.5, 0.25]]))
    assert encircle(X, LEADER, a=1.0, rng=rng) == near([[2.0, 6.0]])


def test_whale_eq_2_1_to_2_8():
    # around X*, |A| = 0.5: (3, 4) - 0.5*(2, 6); search, A = 1.5: (-1, 0) - 1.5*(2, 2); spiral, l = 0.5: cos(pi) = -1
    rng = GivenNumbers(
        ("random", [[0.625], [0.875], [0.625]]),
        ("random", [[0.5], [0.5], [0.5]]),
        ("random", [[0.75], [0.75], [0.75]]),
        ("random", [[0.4], [0.4], [0.5]]),
    )
    three = [np.repeat(rows, 3, axis=0) for rows in (X, LEADER, np.array([[-1.0, 0.0]]))]
    turn = -math.exp(0.5)
    assert swim(*three, a=2.0, spiral=1.0, rng=rng) == near([[2.0, 1.0], [-4.0, -3.0], [3 + 2 * turn, 4 + 6 * turn]])
    assert not rng.draws


@pytest.mark.parametrize(
    ("alarm", "expected"),
    [(0.79, [[1 / E, -2 / E]]), (0.8, [[1.5, -1.5]])],  # exp(-2 / (0.5*4)); Q = 0.5
)
def test_sparrow_eq_3_producers(alarm, expected):
    rng = GivenNumbers(("random", [[alarm]]), ("random", [[0.5]]), ("standard_normal", [[0.5]]))
    assert produce(X, np.array([2]), threshold=0.8, t_max=4, rng=rng) == near(expected)


def test_sparrow_eq_4_scroungers():
    # place 3 of 4: 2 exp((10 - 1)/9) = 2e; place 2: signs (-1, 1), |X - X_P| A+ = (-2 + 6)/2 = 2
    rng = GivenNumbers(("standard_normal", [[7.0], [2.0]]), ("random", [[0.1, 0.9], [0.1, 0.9]]))
    two = [np.repeat(rows, 2, axis=0) for rows in (X, LEADER, np.array([[10.0, 7.0]]))]
    moved = scrounge(two[0], np.array([2, 3]), two[1], two[2], n=4, rng=rng)
    assert moved == near([[5.0, 6.0], [2 * E, 2 * E]])


def test_sparrow_eq_4_may_fly_to_infinity_without_a_warning():
    rng = GivenNumbers(("standard_normal", [[-1.0]]), ("random", [[0.1, 0.9]]))
    moved = scrounge(X, np.array([3]), LEADER, np.array([[1e6, 1e6]]), n=4, rng=rng)
    assert (moved == -np.inf).all()


def test_sparrow_eq_5_aware():
    # at the edge: 3 + 0.5*2, 4 - 1*6; in the middle: K = 0.5, |X - X_worst| = (4, 8), over 1 front + epsilon 1
    rng = GivenNumbers(("standard_normal", [[0.5, -1.0], [9.0, 9.0]]), ("random", [[0.9], [0.75]]))
    two = [np.repeat(rows, 2, axis=0) for rows in (X, LEADER, np.array([[5.0, -10.0]]))]
    moved = beware(two[0], np.array([1, 0]), two[1], two[2], depth=1, rng=rng)
    assert moved == near([[4.0, -2.0], [2.0, 0.0]])


def test_no_move_changes_its_arguments():
    rng = np.random.default_rng(0)
    x, leader, other = (rng.random((6, 3)) for _ in range(3))
    before = [array.copy() for array in (x, leader, other)]
    position = np.arange(1, 7)
    encircle(x, leader, a=1.0, rng=rng)
    swim(x, leader, other, a=1.0, spiral=1.0, rng=rng)
    produce(x, position, threshold=0.8, t_max=9, rng=rng)
    scrounge(x, position, leader, other, n=6, rng=rng)
    beware(x, position, leader, other, depth=2, rng=rng)
    assert all((now == then).all() for now, then in zip((x, leader, other), before, strict=True))
    assert position.tolist() == [1, 2, 3, 4, 5, 6]
