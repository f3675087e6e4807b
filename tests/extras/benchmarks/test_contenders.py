"""Every contender keeps to the problem's box and the budget, and repeats itself by seed."""

import math

import numpy as np
import pytest

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, MmfProblem
from uavcover.extras.benchmarks.mmf.reference_sets import reference_sets
from uavcover.extras.benchmarks.mmf.runs import CONTENDERS, FLOOR, Budget, solve
from uavcover.extras.benchmarks.mmf.summary import CONSTANT_VARIABLES, cover_rate, pareto_sets_proximity
from uavcover.optimizers import ALGORITHMS

#

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


SMALL = Budget(population=24, iterations=6, archive=12)


@pytest.mark.parametrize("name", CONTENDERS)
@pytest.mark.parametrize("function", ["MMF8", "MMF15_l"])
def test_stays_in_the_box_and_returns_no_more_than_allowed(name: str, function: str) -> None:
    problem = PROBLEMS[function]
    x, objectives = solve(problem, name, seed=3, budget=SMALL)
    assert 1 <= len(x) <= SMALL.archive
    assert ((x >= problem.lower) & (x <= problem.upper)).all()
    assert np.array_equal(objectives, problem.evaluate(x))


@pytest.mark.parametrize("name", CONTENDERS)
def test_seed_decides(name: str) -> None:
    one, again, other = (solve(PROBLEMS["MMF1"], name, seed=seed, budget=SMALL)[0] for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert one.shape != other.shape or not np.array_equal(one, other)


@pytest.mark.parametrize("name", [name for name in CONTENDERS if name != FLOOR])
def test_uses_the_budget_and_no_more(name: str) -> None:
    problem, counted = PROBLEMS["MMF4"], []

    def counting(x: np.ndarray) -> np.ndarray:
        counted.append(len(x))
        return problem.function(x)

    watched = MmfProblem(
        problem.name,
        problem.lower,
        problem.upper,
        problem.n_objectives,
        problem.hypervolume_reference,
        problem.local_sets_wanted,
        counting,
    )
    budget = Budget(population=50, iterations=20, archive=10)
    x = CONTENDERS[name](watched, 1, budget)
    assert sum(counted) == 1000
    assert len(x) <= 10


def test_every_algorithm_takes_part() -> None:
    assert set(CONTENDERS) == set(ALGORITHMS) | {FLOOR}


def test_weighted_sums_find_the_ends_of_a_front() -> None:
    problem = PROBLEMS["MMF4"]
    _, objectives = solve(problem, "dbo", seed=1, budget=Budget(population=50, iterations=100, archive=5))
    assert objectives[0, 0] == pytest.approx(0.0, abs=1e-2)  # all weight on the first
    assert objectives[-1, 1] == pytest.approx(0.0, abs=1e-2)
