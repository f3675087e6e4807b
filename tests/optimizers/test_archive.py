import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.naive.dominance import dominates
from uavcover.optimizers.ask_tell import Archive, Solutions


def archive_of(capacity, *, d=1, m=2, c=1):
    return Archive(Solutions.none(d, m, c), capacity)


def solutions(objectives, violations=None, x=None):
    objectives = np.array(objectives, dtype=float)
    n = len(objectives)
    violations = np.zeros((n, 1)) if violations is None else np.array(violations, dtype=float)
    return Solutions(
        np.arange(n, dtype=float)[:, None] if x is None else np.array(x, dtype=float), objectives, violations
    )


@st.composite
def batches(draw):
    n = draw(st.integers(1, 10))
    small = st.integers(0, 3).map(float)
    return Solutions(
        draw(hnp.arrays(np.float64, (n, 1), elements=small)),
        draw(hnp.arrays(np.float64, (n, 2), elements=small)),
        draw(hnp.arrays(np.float64, (n, 1), elements=st.sampled_from([-1.0, 0.0, 2.0]))),
    )


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(batches(), min_size=1, max_size=4), st.integers(1, 6))
def test_never_keeps_a_dominated_or_repeated_point_nor_more_than_its_capacity(reported, capacity):
    archive = archive_of(capacity)
    observed = []
    for batch in reported:
        archive = archive.with_evaluated(batch)
        observed += zip(batch.objectives.tolist(), batch.total_violation.tolist(), strict=True)
        kept = list(zip(archive.solutions.objectives.tolist(), archive.solutions.total_violation.tolist(), strict=True))
        assert 1 <= len(kept) <= capacity
        assert not any(dominates(*p, *q) for p in kept for q in kept)
        rows = np.hstack([archive.solutions.x, archive.solutions.objectives]).tolist()
        assert len(rows) == len({tuple(row) for row in rows})
        assert len({violation for _, violation in kept}) == 1
    if len(reported) == 1:  # without earlier thinning nothing that was ever told dominates what is kept
        assert not any(dominates(*p, *q) for p in observed for q in kept)


def test_equal_objectives_with_different_x_are_different_answers():
    archive = archive_of(5).with_evaluated(solutions([[1, 1], [1, 1], [1, 1]], x=[[0], [7], [0]]))
    assert archive.solutions.x.ravel().tolist() == [0, 7]


def test_thinning_keeps_the_ends_and_the_spread():
    first = np.array([0.0, 0.01, 0.02, 0.5, 0.98, 0.99, 1.0])
    archive = archive_of(3).with_evaluated(solutions(np.column_stack([first, 1 - first])))
    assert archive.solutions.objectives[:, 0].tolist() == [0.0, 0.5, 1.0]


def test_one_feasible_point_drives_out_all_infeasible_ones():
    archive = archive_of(5).with_evaluated(solutions([[0, 0], [9, 9]], violations=[[1], [2]]))
    assert archive.solutions.violations.tolist() == [[1]]
    assert not archive.pareto_set().feasible
    archive = archive.with_evaluated(solutions([[50, 50]], violations=[[-4]]))
    assert archive.solutions.objectives.tolist() == [[50, 50]]
    assert archive.pareto_set().feasible


def test_leaders_are_mostly_the_less_crowded():
    first = np.array([0.0, 0.45, 0.5, 0.55, 1.0])
    archive = archive_of(5).with_evaluated(solutions(np.column_stack([first, 1 - first])))
    leaders = archive.leaders(2000, np.random.default_rng(1)).ravel()
    counts = np.bincount(leaders.astype(int), minlength=5)
    # Row 2 has the least room: it leads only when drawn twice, 1 time in 25.
    assert counts[2] == counts.min()
    assert abs(counts[2] / 2000 - 1 / 25) < 0.02
    assert counts[0] > 3 * counts[2]
