"""The frame around the moves: groups, memory of x(t-1), survival, and which equations each algorithm uses."""

from collections import defaultdict

import numpy as np
import pytest

from tests.optimizers.problems import two_spheres
from uavcover.optimizers import IMODBO, MODBO
from uavcover.optimizers.ask_tell import Solutions
from uavcover.optimizers.imodbo import dynamic_deflection, dynamic_step, group_sizes, survivors


def build(algorithm, **overrides):
    arguments = {"n_objectives": 2, "population_size": 12, "max_iterations": 10, "seed": 5} | overrides
    return algorithm([-1.0] * 3, [2.0] * 3, **arguments)


def test_groups_are_20_20_25_35_percent_and_add_up():
    assert group_sizes(100).tolist() == [20, 20, 25, 35]
    assert group_sizes(30).tolist() == [6, 6, 7, 11]  # the original optimizer's
    for n in range(4, 300):
        sizes = group_sizes(n)
        assert sizes.sum() == n
        assert sizes.min() >= 1
        assert np.abs(sizes - n * np.array([0.20, 0.20, 0.25, 0.35])).max() < 1


@pytest.mark.parametrize("algorithm", [MODBO, IMODBO])
def test_previous_positions_stay_with_their_beetles(algorithm):
    optimizer = build(algorithm)
    optimizer.tell(two_spheres(optimizer.ask()))
    assert (optimizer._previous == optimizer._alive.x).all()
    moved = stayed = 0
    while not optimizer.should_stop:
        candidates = optimizer.ask()
        alive, previously = optimizer._alive.x, optimizer._previous
        allowed = defaultdict(set)  # x to x(t-1); a set, because a beetle that does not move repeats its parent
        for x, parent in zip(candidates, alive[optimizer._parents], strict=True):
            allowed[bytes(x)].add(bytes(parent))
        for x, previous in zip(alive, previously, strict=True):
            allowed[bytes(x)].add(bytes(previous))
        optimizer.tell(two_spheres(candidates))
        old = set(map(bytes, alive))
        for x, previous in zip(optimizer._alive.x, optimizer._previous, strict=True):
            assert bytes(previous) in allowed[bytes(x)]
            stayed += bytes(x) in old
            moved += bytes(x) not in old
    assert moved > 10
    assert stayed > 10


def test_groups_are_drawn_anew_in_each_round():
    optimizer = build(MODBO)
    memberships = []
    while not optimizer.should_stop:
        candidates = optimizer.ask()
        if optimizer.iteration > 0:
            assert sorted(optimizer._parents) == list(range(12))
            memberships.append(tuple(optimizer._parents))
        optimizer.tell(two_spheres(candidates))
    assert len(set(memberships)) == len(memberships)


def test_roller_coefficients_are_table_2_for_modbo_and_eq_20_21_for_imodbo():
    modbo, imodbo = build(MODBO), build(IMODBO)
    for _ in range(3):
        for optimizer in (modbo, imodbo):
            optimizer.tell(two_spheres(optimizer.ask()))
    assert modbo._roller_coefficients() == (0.2, 0.2)
    assert imodbo._roller_coefficients() == (dynamic_deflection(3, 10), dynamic_step(3, 10))
    assert MODBO.theft_constant == IMODBO.theft_constant == 0.25


def test_imodbo_starts_with_exactly_one_sample_in_each_stratum():
    x = build(IMODBO).ask()
    strata = np.floor((x + 1.0) / 3.0 * 12).astype(int)
    assert (np.sort(strata, axis=0) == np.arange(12)[:, None]).all()


def test_modbo_starts_uniformly():
    # Of 3 x 12 strata, independent samples leave some empty.
    strata = np.floor((build(MODBO).ask() + 1.0) / 3.0 * 12).astype(int)
    assert (np.sort(strata, axis=0) != np.arange(12)[:, None]).any()


def test_survivors_are_feasible_first_then_by_front_then_by_crowding():
    objectives = np.array([[5.0, 5.0], [0.0, 0.0], [1.0, 4.0], [2.0, 3.0], [2.1, 2.9], [4.0, 1.0], [9.0, 9.0]])
    violations = np.array([[0.0], [3.0], [0.0], [0.0], [0.0], [-1.0], [2.0]])
    solutions = Solutions(np.zeros((7, 1)), objectives, violations)
    assert [array.tolist() for array in survivors(solutions, 7)] == [[0, 1, 2, 3, 4, 5, 6], [1, 3, 0, 0, 0, 0, 2]]
    assert survivors(solutions, 6)[0].tolist() == [0, 2, 3, 4, 5, 6]  # less violated before more
    assert survivors(solutions, 5)[0].tolist() == [0, 2, 3, 4, 5]
    assert survivors(solutions, 3)[0].tolist() == [2, 4, 5]  # row 3 has the least room between its neighbours
