"""Every contender keeps to the problem's box and the budget, and repeats itself by seed."""

import numpy as np
import pytest

from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, MmfProblem
from uavcover.extras.benchmarks.mmf.runs import CONTENDERS, FLOOR, Budget, solve
from uavcover.optimizers import ALGORITHMS

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
