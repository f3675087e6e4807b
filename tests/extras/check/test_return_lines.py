"""Lines from many places at once are those from each place alone."""

import numpy as np

from uavcover.extras.check.return_checks import cut, with_gaps


def test_pieces_are_those_of_linspace() -> None:
    pieces = np.array([1, 3, 7, 2])
    owner, t = cut(pieces)
    assert owner.tolist() == [0] * 2 + [1] * 4 + [2] * 8 + [3] * 3
    assert t.tolist() == np.concatenate([np.linspace(0.0, 1.0, count + 1) for count in pieces]).tolist()


def test_lines_of_equal_number_beside_each_other() -> None:
    first = with_gaps(np.arange(9.0).reshape(3, 3), np.array([0, 0, 1]))
    second = with_gaps(10.0 + np.arange(6.0).reshape(2, 3), np.array([0, 1]))
    both = first + second
    assert both.owner.tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 1]
    assert np.nan_to_num(both.points_m[:, 0], nan=-1.0).tolist() == [0, 3, -1, 10, -1, 6, -1, 13, -1]
