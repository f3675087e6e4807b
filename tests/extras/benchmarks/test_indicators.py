import math

import numpy as np
import pytest

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.mmf.problems import reference_sets
from uavcover.extras.benchmarks.mmf.runs import CONSTANT_VARIABLES, cover_rate, pareto_sets_proximity

SQUARE = np.array([[0.0, 0.0], [1.0, 2.0]])


def test_the_reference_covers_itself():
    points = reference_sets("MMF1").pareto_set
    assert cover_rate(points, points) == 1.0
    assert pareto_sets_proximity(points, points) == math.inf


def test_half_a_variable_covered():
    assert cover_rate(SQUARE, [[0.0, 0.0], [0.5, 2.0]]) == pytest.approx(math.sqrt(0.5))


def test_a_range_that_reaches_beyond_counts_only_its_overlap():
    assert cover_rate(SQUARE, [[-5.0, -1.0], [0.5, 9.0]]) == pytest.approx(math.sqrt(0.5))


def test_no_overlap_in_one_variable_is_zero():
    assert cover_rate(SQUARE, [[2.0, 0.0], [3.0, 2.0]]) == 0.0
    assert pareto_sets_proximity(SQUARE, [[2.0, 0.0], [3.0, 2.0]]) == 0.0


def test_a_constant_variable_counts_as_covered():
    assert cover_rate([[0.0, 0.2], [1.0, 0.2]], [[0.0, 0.9], [1.0, 0.9]]) == 1.0


def test_an_ignored_variable_counts_as_covered():
    points = reference_sets("MMF14").pareto_set
    one_sheet = points[points[:, 2] < 0.5]
    assert cover_rate(points, one_sheet, ignored=CONSTANT_VARIABLES["MMF14"]) == 1.0
    assert cover_rate(points, one_sheet) == 0.0  # the sheet touches the other's range in no more than a point


def test_psp_is_cover_rate_over_igdx():
    solutions = np.array([[0.0, 0.0], [0.5, 2.0]])
    igdx = (0.0 + 0.5) / 2.0
    assert pareto_sets_proximity(SQUARE, solutions) == pytest.approx(math.sqrt(0.5) / igdx)


def test_shapes_that_do_not_fit():
    with pytest.raises(OptimizerError, match="cover rate"):
        cover_rate(SQUARE, np.zeros((2, 3)))
    with pytest.raises(OptimizerError, match="cover rate"):
        cover_rate(SQUARE, np.zeros((0, 2)))
