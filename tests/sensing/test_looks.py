"""Photos from one place are one look, and overlap counts looks."""

import numpy as np
import pytest

from tests.naive.looks import looks_by_pairs
from uavcover.sensing.photos import looks_of

DOWN = (0.0, 0.0, -1.0)


def views(count, axis=DOWN):
    return np.tile(np.array(axis, dtype=float), (count, 1))


def line(count, step_m):
    return np.column_stack([step_m * np.arange(count), np.zeros(count), np.full(count, 80.0)])


@pytest.mark.parametrize(("step_m", "looks"), [(20.0, 30), (10.0, 30), (5.1, 30), (2.0, 10), (0.0, 1), (0.02, 1)])
def test_a_line_has_no_more_looks_than_a_quarter_of_the_spacing_allows(step_m, looks):
    assert looks_of(line(30, step_m), views(30), np.full(30, 5.0)).max() + 1 == looks


def test_a_slow_line_is_no_chain():
    """Photos every 4 m are one look each 8 m: looks do not grow along a line."""
    looks = looks_of(line(100, 4.0), views(100), np.full(100, 5.0))
    assert looks.max() + 1 == 50
    assert np.bincount(looks).max() == 2


def test_a_vehicle_that_climbs_over_one_place_takes_one_look_and_one_beside_a_wall_many():
    column = np.column_stack([np.zeros(12), np.zeros(12), 40.0 + 5.0 * np.arange(12)])
    assert looks_of(column, views(12), np.full(12, 4.0)).max() == 0
    assert looks_of(column, views(12, (0.0, 1.0, 0.0)), np.full(12, 4.0)).max() == 11


def test_other_directions_are_other_looks():
    tilts = [(0.0, 0.0, -1.0), (0.7071, 0.0, -0.7071), (0.0, 0.7071, -0.7071), (0.1, 0.0, -0.995)]
    assert looks_of(np.zeros((4, 3)), np.array(tilts), np.full(4, 3.0)).tolist() == [0, 1, 2, 0]


def test_files_of_one_capture_are_one_look_wherever_their_receiver_says_they_are():
    positions = line(12, 8.0)
    ids = ["a"] * 3 + ["b"] * 3 + [None] * 6
    assert looks_of(positions, views(12), np.full(12, 3.0), ids).tolist() == [0, 0, 0, 1, 1, 1, 2, 3, 4, 5, 6, 7]
    # An id that every photo has is no id of a capture.
    assert looks_of(positions, views(12), np.full(12, 3.0), ["x"] * 12).max() == 11


@pytest.mark.parametrize("seed", range(5))
def test_as_the_naive_twin_groups_them(seed):
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0.0, 60.0, (80, 3))
    axes = rng.normal(0.0, 0.3, (80, 3)) + DOWN
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    closer = rng.uniform(2.0, 8.0, 80)
    ids = [None if rng.random() < 0.6 else f"c{rng.integers(30)}" for _ in range(80)]
    assert looks_of(positions, axes, closer, ids).tolist() == looks_by_pairs(positions, axes, closer, ids)
