import moocore
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pymoo.operators.survival.rank_and_crowding.metrics import calc_crowding_distance
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from tests.compiled_kernels import cases
from tests.naive import dominance as naive
from uavcover.kernels import dominance

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=50, interpreted=10))

# Whole numbers make ties; the others reach the ends of the floating-point range.
values = st.one_of(st.integers(-2, 2).map(float), st.floats(allow_nan=False, allow_infinity=False, width=64))


@st.composite
def fronts(draw):
    n, m = draw(st.integers(0, 16)), draw(st.integers(1, 4))
    objectives = draw(hnp.arrays(np.float64, (n, m), elements=values))
    violation = draw(hnp.arrays(np.float64, (n,), elements=st.sampled_from([0.0, 0.0, 0.5, 3.0])))
    objectives.setflags(write=False)
    violation.setflags(write=False)
    return objectives, violation


@deterministic
@given(fronts())
def test_ranks_and_mask_equal_the_naive_twin(case):
    objectives, violation = case
    expected = naive.non_dominated_ranks(objectives, violation)
    assert dominance.non_dominated_ranks(objectives, violation).tolist() == expected
    assert dominance.non_dominated_mask(objectives, violation).tolist() == [rank == 0 for rank in expected]


@deterministic
@given(fronts())
def test_pairwise_dominance_equals_the_naive_twin_and_is_a_strict_order(case):
    objectives, violation = case
    n = len(objectives)
    matrix = [[dominance.dominates(objectives, violation, p, q) for q in range(n)] for p in range(n)]
    for p in range(n):
        assert not matrix[p][p]
        for q in range(n):
            assert matrix[p][q] == naive.dominates(objectives[p], violation[p], objectives[q], violation[q])
            assert not (matrix[p][q] and matrix[q][p])


@deterministic
@given(fronts(), st.integers(0, 16))
def test_crowding_equals_the_naive_twin(case, keep):
    objectives, _ = case
    twin = naive.crowding_distance(objectives)
    assert dominance.crowding_distance(objectives).tolist() == [twin[i] for i in range(len(objectives))]
    assert dominance.least_crowded(objectives, keep).tolist() == naive.least_crowded(objectives, keep)


@deterministic
@given(hnp.arrays(np.float64, st.tuples(st.integers(0, 12), st.integers(1, 3)), elements=st.integers(-1, 1).map(float)))
def test_first_occurrences_equal_the_naive_twin(rows):
    assert dominance.first_occurrences(rows).tolist() == naive.first_occurrences(rows)


@pytest.mark.parametrize("m", [2, 3])
def test_ranks_equal_those_of_pymoo_and_moocore(m):
    objectives = np.random.default_rng(m).integers(0, 12, (60, m)).astype(float)
    ranks = dominance.non_dominated_ranks(objectives, np.zeros(60))
    for number, front in enumerate(NonDominatedSorting().do(objectives)):
        assert sorted(front) == np.flatnonzero(ranks == number).tolist()
    # moocore strips identical points unless told to keep them
    assert moocore.pareto_rank(objectives).tolist() == ranks.tolist()
    assert moocore.is_nondominated(objectives, keep_weakly=True).tolist() == (ranks == 0).tolist()


@pytest.mark.parametrize("m", [2, 3])
def test_crowding_equals_that_of_pymoo(m):
    objectives = np.random.default_rng(m).random((40, m))
    np.testing.assert_allclose(
        dominance.crowding_distance(objectives) / m, calc_crowding_distance(objectives), rtol=1e-12
    )


def test_a_smaller_violation_beats_any_objective():
    objectives = np.array([[9.0, 9.0], [0.0, 0.0], [1.0, 1.0]])
    ranks = dominance.non_dominated_ranks(objectives, np.array([0.0, 2.0, 1.0]))
    assert ranks.tolist() == [0, 2, 1]


def test_removal_one_at_a_time_thins_a_cluster_and_keeps_the_ends():
    # Four points at one end, one alone in the middle: crowding computed once would remove all the inner cluster points.
    first = np.array([0.0, 0.01, 0.02, 0.03, 0.5, 1.0])
    objectives = np.column_stack([first, 1 - first])
    assert dominance.least_crowded(objectives, 4).tolist() == [0, 3, 4, 5]


@pytest.mark.parametrize("factors", [(4.0, 0.125), (1024.0, 1.0)])
def test_nothing_changes_when_objectives_are_scaled(factors):
    # Powers of two: scaling is then exact, and so is the equality.
    objectives = np.random.default_rng(3).random((30, 2))
    scaled = objectives * np.array(factors)
    zeros = np.zeros(30)
    assert (
        dominance.non_dominated_ranks(scaled, zeros).tolist()
        == dominance.non_dominated_ranks(objectives, zeros).tolist()
    )
    assert dominance.crowding_distance(scaled).tolist() == dominance.crowding_distance(objectives).tolist()
    assert dominance.least_crowded(scaled, 9).tolist() == dominance.least_crowded(objectives, 9).tolist()


def test_an_objective_that_never_varies_counts_for_nothing():
    first = np.array([0.0, 0.25, 1.0])
    assert dominance.crowding_distance(np.column_stack([first, np.full(3, 7.0)])).tolist() == [np.inf, 1.0, np.inf]
    assert dominance.crowding_distance(np.full((3, 2), 7.0)).tolist() == [0.0, 0.0, 0.0]
