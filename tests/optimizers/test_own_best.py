"""Beetles that keep their own best place."""

import numpy as np

from tests.optimizers.problems import two_spheres
from uavcover.optimizers import ALGORITHMS


def test_a_beetle_moves_only_to_a_place_that_dominates_its_own() -> None:
    optimizer = ALGORITHMS["modbo+own-best"](
        [-1.0, -1.0], [1.0, 1.0], n_objectives=2, n_constraints=1, population_size=6, max_iterations=3, seed=2
    )
    first = optimizer.ask().copy()
    optimizer.tell([[1.0, 1.0]] * 6, [[0.0], [0.0], [0.0], [1.0], [1.0], [0.0]])
    second = optimizer.ask().copy()
    parents = optimizer._parents.copy()
    # by parent: dominates; equal; incomparable; less violation, worse objectives; more violation; better but now violated
    objectives = np.array([[0.5, 1.0], [1.0, 1.0], [0.0, 2.0], [5.0, 5.0], [0.0, 0.0], [0.0, 0.0]])
    violations = np.array([[0.0], [0.0], [0.0], [0.5], [2.0], [0.1]])
    optimizer.tell(objectives[parents], violations[parents])
    moved = np.array([True, False, False, True, False, False])
    offspring = second[np.argsort(parents)]
    assert np.array_equal(optimizer._alive.x, np.where(moved[:, None], offspring, first))
    assert np.array_equal(optimizer._alive.objectives[moved], objectives[moved])
    assert np.array_equal(optimizer._previous, first)


def test_no_beetle_ever_gets_worse() -> None:
    optimizer = ALGORITHMS["imodbo+own-best"](
        [-2.0] * 3, [2.0] * 3, n_objectives=2, population_size=20, max_iterations=30, seed=4
    )
    optimizer.tell(two_spheres(optimizer.ask()))
    while not optimizer.should_stop:
        before = optimizer._alive.objectives
        optimizer.tell(two_spheres(optimizer.ask()))
        after = optimizer._alive.objectives
        assert ((after == before).all(axis=1) | (after <= before).all(axis=1)).all()
