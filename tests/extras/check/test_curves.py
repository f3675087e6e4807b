import itertools

import numpy as np
import pytest

from uavcover.extras.check.turns import circle, spline, straight


def bezier(begin, end, begin_vector, end_vector, t):
    """The same cubic by de Casteljau's construction, from the vectors as they are."""
    corners = [begin, begin + begin_vector / 3.0, end - end_vector / 3.0, end]
    while len(corners) > 1:
        corners = [a + t * (b - a) for a, b in itertools.pairwise(corners)]
    return corners[0]


@pytest.mark.parametrize("seed", range(5))
def test_a_spline_is_the_cubic_of_its_ends_and_vectors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin, end, v0, v1 = rng.uniform(-100.0, 100.0, (4, 3))
    scale = min(1.0, 4.0 * np.linalg.norm(end - begin) / (np.linalg.norm(v0) + np.linalg.norm(v1)))
    points = spline(begin, end, v0, v1, step_m=5.0)
    for k, t in enumerate(np.linspace(0.0, 1.0, len(points))):
        assert points[k] == pytest.approx(bezier(begin, end, scale * v0, scale * v1, t), abs=1e-9)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 10.0


def test_long_vectors_are_shortened_to_four_chords() -> None:
    begin, end = np.zeros(3), np.array([10.0, 0.0, 0.0])
    short = spline(begin, end, np.array([0.0, 20.0, 0.0]), np.array([0.0, 20.0, 0.0]), step_m=1.0)
    long = spline(begin, end, np.array([0.0, 2000.0, 0.0]), np.array([0.0, 2000.0, 0.0]), step_m=1.0)
    assert long == pytest.approx(short)


def test_a_spline_without_length_stays() -> None:
    place = np.array([1.0, 2.0, 3.0])
    assert (spline(place, place, place, place, step_m=1.0) == place).all()


def test_a_circle_goes_round_as_often_as_it_says() -> None:
    center, begin = np.array([100.0, 50.0, 0.0]), np.array([100.0, 80.0, 20.0])
    points = circle(center, 30.0, begin, turns=1.5, end_height_m=40.0, clockwise=True)
    away = points[:, :2] - center[:2]
    assert np.hypot(*away.T) == pytest.approx(30.0, rel=1e-3)
    turned = np.unwrap(np.arctan2(away[:, 0], away[:, 1]))
    assert turned[-1] - turned[0] == pytest.approx(3.0 * np.pi)
    assert points[[0, -1], 2] == pytest.approx([20.0, 40.0])
    back = circle(center, 30.0, begin, turns=0.25, end_height_m=20.0, clockwise=False)
    assert back[-1, 0] < center[0]


def test_a_straight_line_has_both_ends_and_short_pieces() -> None:
    points = straight(np.zeros(3), np.array([95.0, 0.0, 10.0]), step_m=10.0)
    assert len(points) == 11
    assert points[-1] == pytest.approx([95.0, 0.0, 10.0])
