"""The single-objective frame: best-so-far of each beetle, X* and X^w of the last round."""

import numpy as np

from tests.optimizers.problems import minimise
from uavcover.optimizers import ALGORITHMS, DBO
from uavcover.optimizers.imodbo import area_around


def shifted(x):
    return ((x - 0.3) ** 2).sum(axis=1, keepdims=True)


def build(**overrides):
    arguments = {"n_objectives": 1, "population_size": 12, "max_iterations": 20, "seed": 5} | overrides
    return DBO([-1.0] * 3, [2.0] * 3, **arguments)


def test_each_beetle_keeps_its_best_place_and_the_one_before():
    optimizer = build()
    improved = 0
    optimizer.tell(shifted(optimizer.ask()))
    while not optimizer.should_stop:
        before, x = optimizer._alive, optimizer.ask()
        values = shifted(x)
        optimizer.tell(values)
        better = values < before.objectives
        assert np.array_equal(optimizer._alive.x, np.where(better, x, before.x))
        assert np.array_equal(optimizer._previous, before.x)
        assert np.array_equal(optimizer._current_best, x[values.argmin()])
        assert np.array_equal(optimizer._current_worst, x[values.argmax()])
        improved += better.sum()
    assert improved > 20


def test_eggs_stay_in_the_oviposition_area():
    optimizer = build(population_size=100)
    optimizer.tell(shifted(optimizer.ask()))
    optimizer.tell(shifted(optimizer.ask()))
    eggs, box = optimizer.ask()[20:40], (np.full(3, -1.0), np.full(3, 2.0))
    area = area_around(optimizer._current_best[None], *box, t=2, t_max=20)
    assert ((eggs >= area.lower) & (eggs <= area.upper)).all()


def test_less_violation_is_better_than_a_better_value():
    optimizer = build(n_constraints=1)
    first = optimizer.ask()
    optimizer.tell(shifted(first), np.ones((12, 1)))
    second = optimizer.ask()
    violations = np.where(np.arange(12) < 6, 0.5, 2.0)[:, None]
    optimizer.tell(shifted(second) + 100.0, violations)
    assert np.array_equal(optimizer._alive.x, np.where(violations < 1, second, first))


def test_the_best_is_found():
    optimizer = ALGORITHMS["dbo"]([-1.0] * 5, [2.0] * 5, n_objectives=1, population_size=30, max_iterations=200, seed=1)
    result = minimise(optimizer, shifted)
    assert result.objectives[0, 0] < 1e-3
