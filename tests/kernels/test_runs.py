"""Runs and their comparison against plain sets."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.naive import runs as naive
from uavcover.kernels.nadir_visibility import compare, make_changes, runs_of, weigh_changes

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=60, interpreted=15))
sets_of_squares = st.lists(st.sets(st.integers(0, 29), max_size=20), max_size=3)


def written(squares, room=60):
    out = np.full(room, -7, dtype=np.int32)
    rising = np.array(sorted(squares), dtype=np.int32)
    return runs_of(rising, len(rising), out), out


@deterministic
@given(st.sets(st.integers(0, 40), max_size=30))
def test_runs_hold_what_was_written(squares):
    size, out = written(squares, 90)
    assert naive.squares_of(out[:size].tolist()) == squares
    assert (np.diff(out[:size]) > 0).all()
    assert (out[size:] == -7).all()


def test_runs_that_do_not_fit_say_so():
    assert written({1, 3, 5}, 6)[0] == 6
    assert written({1, 3, 5, 7}, 7)[0] == -1


@deterministic
@given(sets_of_squares, sets_of_squares, st.integers(0, 10**6))
def test_changes_are_those_of_plain_sets(olds, news, seed):
    both = [*olds, *news]
    runs = np.zeros((len(both) + 1, 60), dtype=np.int32)
    sizes = np.zeros(len(both) + 1, dtype=np.int64)
    for k, squares in enumerate(both):
        sizes[k], runs[k] = written(squares)
    sets = np.zeros((len(both) + 1, 3), dtype=np.int64)
    sets[:, 0] = np.arange(len(both) + 1)
    changes = np.zeros((400, 3), dtype=np.int32)
    count = compare(runs, sizes, sets, len(olds), len(news), changes)
    expected = naive.changes(olds, news)
    found = {square: by for first, last, by in changes[:count].tolist() for square in range(first, last)}
    assert found == expected
    rng = np.random.default_rng(seed)
    weight = rng.random(30)
    before = rng.integers(0, 2, 30) + sum((np.isin(np.arange(30), list(s)) for s in olds), np.zeros(30, dtype=int))
    after = before + [expected.get(square, 0) for square in range(30)]
    counts = before.astype(np.uint16)
    gained = float(weight[after > 0].sum() - weight[before > 0].sum())
    assert np.isclose(weigh_changes(changes, count, counts, weight), gained, atol=1e-12)
    assert (counts == before).all()
    make_changes(changes, count, counts)
    assert (counts == after).all()
