import numpy as np
import pytest

from tests.optimizers.given_numbers import GivenNumbers
from uavcover.optimizers.rivals import LeaderChoice, cells, thinned


def test_borders_are_at_equal_steps_over_the_widened_range():
    # 0..1 widened by 0.1 at both ends, 9 borders: -0.1, 0.05, ..., 0.95, 1.1
    objectives = np.array([[0.0], [0.049], [0.051], [0.951], [1.0]])
    assert cells(objectives, n_grid=10, inflation=0.1).tolist() == [0, 0, 1, 2, 2]


def test_cells_do_not_depend_on_scale_or_on_the_number_of_objectives():
    rng = np.random.default_rng(0)
    objectives = rng.random((50, 3))
    plain = cells(objectives, n_grid=10, inflation=0.1)
    assert np.array_equal(cells(objectives * [4.0, 0.5, 1024.0], n_grid=10, inflation=0.1), plain)
    assert set(plain) == set(range(plain.max() + 1))
    many = cells(rng.random((50, 40)), n_grid=10, inflation=0.1)  # 10^40 cells, of which 50 are numbered
    assert len(set(many)) == 50
    assert cells(np.ones((3, 2)), n_grid=10, inflation=0.1).tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("draws", "keep", "left"),
    [
        ([[0.9, 0.5]], 4, [0, 2, 3, 4]),  # the middle one of the three
        ([[0.9, 0.5], [0.0, 0.9]], 3, [0, 3, 4]),  # then, of two cells with two, the first cell's last
        ([[0.9, 0.5], [0.9, 0.9]], 3, [0, 2, 3]),  # or the second cell's
    ],
)
def test_the_most_crowded_cell_loses_members(draws, keep, left):
    rng = GivenNumbers(("random", draws))
    assert thinned(np.array([0, 0, 0, 1, 1]), keep, rng=rng).tolist() == left


def test_nothing_is_removed_or_drawn_when_there_is_room():
    assert thinned(np.array([0, 0, 1]), 3, rng=GivenNumbers()).tolist() == [0, 1, 2]


def test_leaders_come_from_uncrowded_cells_and_are_different():
    choice = LeaderChoice.of(np.array([0, 0, 1]), pressure=1.0)  # weights 1/2 and 1

    def drawn(taken, which, member):
        row = choice.drawn(
            1, np.array([taken], dtype=np.int64).reshape(1, -1), GivenNumbers(("random", [[which, member]]))
        )
        return row.tolist()

    assert drawn([], 0.32, 0.6) == [1]
    assert drawn([], 0.34, 0.6) == [2]
    assert drawn([1], 0.49, 0.9) == [0]  # one member left in each cell: equal chances
    assert drawn([0], 0.49, 0.0) == [1]
    assert drawn([0, 1], 0.01, 0.0) == [2]
    assert drawn([2], 0.99, 0.99) == [1]
    assert drawn([0, 1, 2], 0.34, 0.0) == [2]  # everything is taken: then nothing is barred


def test_each_wolf_has_its_own_leaders():
    cell = np.random.default_rng(1).integers(0, 5, 20)
    cell = np.unique(cell, return_inverse=True)[1]
    choice, rng = LeaderChoice.of(cell, pressure=10.0), np.random.default_rng(2)
    taken = np.empty((300, 0), np.int64)
    for _ in range(3):
        taken = np.column_stack([taken, choice.drawn(300, taken, rng)])
    assert all(len(set(row)) == 3 for row in taken.tolist())
    counts = np.bincount(cell)
    assert np.mean(counts[cell[taken[:, 0]]] == counts.min()) > 0.9
