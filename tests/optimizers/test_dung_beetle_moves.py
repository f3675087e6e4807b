"""One hand-computed update per operator, with the random numbers given."""

import math

import numpy as np
import pytest

from tests.optimizers.given_numbers import GivenNumbers, near
from uavcover.optimizers import imodbo as moves

X, PREVIOUS, WORST = np.array([[1.0, -2.0]]), np.array([[2.0, 4.0]]), np.array([[3.0, -5.0]])


def test_eq_9_and_10_roll():
    # |x - worst| = (2, 3); 1 + 0.2*2 + 0.3*2 = 2, -2 + 0.2*4 + 0.3*3 = -0.3; with alpha = -1: 1.2 and -1.9
    assert moves.roll(X, PREVIOUS, WORST, np.array([[1.0]]), k=0.2, b=0.3) == near([[2.0, -0.3]])
    assert moves.roll(X, PREVIOUS, WORST, np.array([[-1.0]]), k=0.2, b=0.3) == near([[1.2, -1.9]])


def test_eq_11_dance():
    # |x - previous| = (1, 6); tan 45 = 1, tan 135 = -1
    assert moves.dance(X, PREVIOUS, np.array([[45.0]])) == near([[2.0, 4.0]])
    assert moves.dance(X, PREVIOUS, np.array([[135.0]])) == near([[0.0, -8.0]])


@pytest.mark.parametrize("degrees", [0.0, 90.0, 180.0])
def test_eq_11_no_move_at_0_90_180_degrees(degrees):
    assert moves.dance(X, PREVIOUS, np.array([[degrees]])).tolist() == X.tolist()


def test_rollers_choose_between_straight_backwards_and_dance():
    rng = GivenNumbers(
        ("random", [[0.0], [0.89], [0.9]]), ("random", [[0.89], [0.9], [0.0]]), ("integers", [[10], [10], [45]])
    )
    three = [np.repeat(rows, 3, axis=0) for rows in (X, PREVIOUS, WORST)]
    assert moves.roller(*three, k=0.2, b=0.3, rng=rng) == near([[2.0, -0.3], [1.2, -1.9], [2.0, 4.0]])
    assert not rng.draws


@pytest.mark.parametrize(
    ("t", "lower", "upper"),
    [
        (0, [0.0, -8.0], [8.0, 0.0]),  # R = 1
        (1, [2.0, -6.0], [6.0, -2.0]),  # R = 1/2; unordered, the second interval would be the empty (-2, -6)
        (2, [4.0, -4.0], [4.0, -4.0]),  # R = 0
    ],
)
def test_eq_12_13_15_16_ends_are_ordered_for_negative_coordinates(t, lower, upper):
    area = moves.area_around(np.array([[4.0, -4.0]]), np.full(2, -10.0), np.full(2, 10.0), t=t, t_max=2)
    assert (area.lower.tolist(), area.upper.tolist()) == ([lower], [upper])


def test_eq_12_13_15_16_area_is_clipped_to_the_search_space():
    area = moves.area_around(np.array([[4.0, -4.0]]), np.full(2, -5.0), np.full(2, 5.0), t=0, t_max=2)
    assert (area.lower.tolist(), area.upper.tolist()) == ([[0.0, -5.0]], [[5.0, 0.0]])


HERE = np.array([[1.0, 2.0]])
AREA = moves.Region(np.array([[0.0, 1.0]]), np.array([[2.0, 5.0]]))


def test_eq_14_breeder():
    # 3 + 0.5*(1-0) + 0.1*(1-2) = 3.4; 4 + 0.25*(2-1) + 0.2*(2-5) = 3.65
    rng = GivenNumbers(("random", [[0.5, 0.25]]), ("random", [[0.1, 0.2]]))
    assert moves.breeder(HERE, np.array([[3.0, 4.0]]), AREA, rng=rng) == near([[3.4, 3.65]])


def test_eq_17_small_beetle():
    # 1 + 2*(1-0) + 0.5*(1-2) = 2.5; 2 + 2*(2-1) + 0.25*(2-5) = 3.25
    rng = GivenNumbers(("standard_normal", [[2.0]]), ("random", [[0.5, 0.25]]))
    assert moves.small_beetle(HERE, AREA, rng=rng) == near([[2.5, 3.25]])


def test_eq_23_disturbed_small_beetle():
    # as Eq. 17, plus 0.1 * delta * (2, 4) with delta = a(0) sin(pi/2) * 1 = 2
    rng = GivenNumbers(
        ("standard_normal", [[2.0]]), ("random", [[0.5, 0.25]]), ("random", [[0.25]]), ("random", [[0.5]])
    )
    assert moves.disturbed_small_beetle(HERE, AREA, t=0, t_max=9, rng=rng) == near([[2.9, 4.05]])
    assert not rng.draws


@pytest.mark.parametrize(
    ("t", "delta"),
    [
        (2, (2 - 2 / 9) * math.sin(1.0) * 1.5),
        (3, (2 - 3 / 9) * (math.sin(1.0) + math.cos(1.0)) / 2 * 1.5),  # Tmax/3 itself is in the middle
        (6, (2 - 6 / 9) * (math.sin(1.0) + math.cos(1.0)) / 2 * 1.5),  # and so is 2 Tmax/3
        (7, (2 - 7 / 9) * math.cos(1.0) * 1.5),
    ],
)
def test_eq_22_stages(t, delta):
    r2, r3 = np.array([[1.0]]), np.array([[1.5]])
    assert moves.sine_cosine_disturbance(r2, r3, t=t, t_max=9) == near([[delta]])


def test_eq_18_thief():
    # |x - best| + |x - leader| = (3, 3); 2 + 0.25*2*3 = 3.5; -2 + 0.25*(-1)*3 = -2.75
    rng = GivenNumbers(("standard_normal", [[2.0, -1.0]]))
    stolen = moves.thief(np.array([[1.0, -1.0]]), np.array([[3.0, 1.0]]), np.array([[2.0, -2.0]]), s=0.25, rng=rng)
    assert stolen == near([[3.5, -2.75]])


@pytest.mark.parametrize(
    ("t", "b", "k", "a"),
    [(0, 0.4, 0.5, 2.0), (50, 0.4 * math.exp(-6.25), 0.55, 1.5), (100, 0.4 * math.exp(-25), 0.6, 1)],
)
def test_eq_20_21_22_dynamic_parameters_at_start_half_and_end(t, b, k, a):
    assert moves.dynamic_step(t, 100) == pytest.approx(b)
    assert moves.dynamic_deflection(t, 100) == pytest.approx(k)
    assert moves.disturbance_decay(t, 100) == pytest.approx(a)


def test_no_move_changes_its_arguments():
    rng = np.random.default_rng(0)
    x, other, third = (rng.random((6, 3)) for _ in range(3))
    before = [array.copy() for array in (x, other, third)]
    area = moves.area_around(other, np.zeros(3), np.ones(3), t=1, t_max=3)
    moves.roller(x, other, third, k=0.5, b=0.4, rng=rng)
    moves.breeder(x, other, area, rng=rng)
    moves.disturbed_small_beetle(x, area, t=1, t_max=3, rng=rng)
    moves.thief(x, other, third, s=0.25, rng=rng)
    assert all((now == then).all() for now, then in zip((x, other, third), before, strict=True))
