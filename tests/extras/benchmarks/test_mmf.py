"""Problems, indicators and documentation of the MMF benchmark."""

import math

import numpy as np
import pytest

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, reference_sets, two_peaks
from uavcover.extras.benchmarks.mmf.runs import CONSTANT_VARIABLES, cover_rate, pareto_sets_proximity

# Rows of the reference files, from the suite's own description.
ROWS = {
    "MMF1": 400, "MMF2": 400, "MMF4": 400, "MMF5": 400, "MMF7": 400, "MMF8": 400, "MMF10": 200, "MMF11": 200, "MMF12": 200,
    "MMF13": 625, "MMF14": 1250, "MMF15": 625, "MMF1_e": 400, "MMF14_a": 1250, "MMF15_a": 625, "MMF10_l": 400,
    "MMF11_l": 400, "MMF12_l": 410, "MMF13_l": 1250, "MMF15_l": 1250, "MMF15_a_l": 1250, "MMF16_l1": 1875, "MMF16_l2": 1875,
    "MMF16_l3": 2500,
}  # fmt: skip


def test_the_suite_has_its_24_problems():
    assert list(PROBLEMS) == list(ROWS)


@pytest.mark.parametrize("name", ROWS)
def test_reference_has_the_published_number_of_rows(name):
    reference = reference_sets(name)
    problem = PROBLEMS[name]
    assert reference.pareto_set.shape == (ROWS[name], problem.n_variables)
    assert reference.pareto_front.shape == (ROWS[name], problem.n_objectives)


@pytest.mark.parametrize("name", [name for name in ROWS if name != "MMF2"])
def test_the_reference_set_maps_onto_the_reference_front(name):
    reference = reference_sets(name)
    image = PROBLEMS[name].evaluate(reference.pareto_set)
    distance = np.linalg.norm(image[:, None] - reference.pareto_front[None], axis=2).min(axis=1)
    # The fronts of MMF5 and MMF8 are sampled elsewhere: neighbours on them are 0.0025 and, near f2 = 0, 0.07 apart.
    assert distance.max() < {"MMF5": 2e-3, "MMF8": 0.04}.get(name, 1e-12)


def test_one_row_of_mmf2_folds_to_the_other_branch():
    """(0, 1) of the upper set is no Pareto optimum; the published file has it all the same."""
    reference = reference_sets("MMF2")
    f = PROBLEMS["MMF2"].evaluate(reference.pareto_set)
    off = np.abs(f[:, 1] - (1.0 - np.sqrt(f[:, 0]))) > 1e-9
    assert np.flatnonzero(off).tolist() == [200]
    assert f[200, 1] == pytest.approx(9.39, abs=0.01)


@pytest.mark.parametrize("name", [name for name in ROWS if name not in {"MMF2", "MMF13_l"}])
def test_the_reference_set_lies_in_the_box(name):
    problem, points = PROBLEMS[name], reference_sets(name).pareto_set
    assert (points >= problem.lower - 1e-12).all()
    assert (points <= problem.upper + 1e-12).all()


def test_75_rows_of_mmf13_l_lie_outside_of_the_box():
    problem, points = PROBLEMS["MMF13_l"], reference_sets("MMF13_l").pareto_set
    assert int((points > problem.upper + 1e-12).any(axis=1).sum()) == 75


def test_mmf12_stops_at_200_of_208_points():
    assert reference_sets("MMF12").pareto_set[-1, 0] == pytest.approx(0.80726, abs=1e-5)
    assert reference_sets("MMF12_l").pareto_set[207, 0] == pytest.approx(0.81727, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "x", "f"),
    [
        ("MMF1", [2.25, 1.0], [0.25, 0.5 + 2.0 * (1.0 - np.sin(2.5 * np.pi)) ** 2]),
        ("MMF4", [-0.5, 1.5], [0.5, 0.75 + 2.0 * (0.5 - 1.0) ** 2]),
        ("MMF8", [np.pi / 2, 4.0], [1.0, 2.0 * (4.0 - 1.0 - np.pi / 2) ** 2]),
        ("MMF10", [0.5, 0.6], [0.5, 2.4]),
        ("MMF11", [0.5, 0.25], [0.5, 1.02094374 / 0.5]),
        ("MMF14", [0.0, 0.0, 0.25], [2.0, 0.0, 0.0]),
        ("MMF15", [1.0, 0.3, 0.75], [0.0, 0.0, 2.32797092]),
        ("MMF16_l2", [0.0, 1.0, 0.625], [0.0, 2.22839738, 0.0]),
    ],
)
def test_values_worked_out_by_hand(name, x, f):
    assert PROBLEMS[name].evaluate(np.array([x]))[0] == pytest.approx(f, abs=1e-8)


def test_the_logarithm_of_the_envelope_has_base_ten():
    assert two_peaks(np.array([0.25, 0.75])) == pytest.approx([1.02094374, 1.32797092], abs=1e-8)


def test_local_sets_are_a_declared_property():
    assert {name for name, problem in PROBLEMS.items() if problem.local_sets_wanted} == {
        "MMF10_l", "MMF11_l", "MMF12_l", "MMF13_l", "MMF15_l", "MMF15_a_l", "MMF16_l1", "MMF16_l2", "MMF16_l3",
    }  # fmt: skip


def test_points_of_another_dimension_are_refused():
    with pytest.raises(ValueError, match=r"MMF1: points of shape \(2, 3\)"):
        PROBLEMS["MMF1"].evaluate(np.zeros((2, 3)))


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
