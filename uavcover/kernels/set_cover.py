"""Set cover: greedy choice, reductions, and local search with weights on items that are hard to cover.

Sets are rows of a compressed table: set k has the numbers ``items[start[k] : start[k + 1]]``, in rising order. Reductions
remove sets that no exact answer needs. The local search is RWLS: Gao, Weise and Li, "An efficient local search heuristic with
row weighting for the unicost set covering problem", European Journal of Operational Research 246 (2015).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel

_NOTHING = 1e-12
"""A gain that rounding may have left over."""


@allocating_kernel
def transposed(
    start: NDArray[np.int64], items: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Transposed table: for each of ``count`` items, the sets that contain it, in rising order."""
    back = np.zeros(count + 1, dtype=np.int64)
    for item in items:
        back[item + 1] += 1
    for item in range(count):
        back[item + 1] += back[item]
    filled = back[:-1].copy()
    sets = np.empty(items.size, dtype=np.int32)
    for k in range(start.size - 1):
        for i in range(start[k], start[k + 1]):
            sets[filled[items[i]]] = k
            filled[items[i]] += 1
    return back, sets


@allocating_kernel
def choose_greedily(
    start: NDArray[np.int64], items: NDArray[np.int32], weight: NDArray[np.float64], enough: float, most: int
) -> NDArray[np.int64]:
    """Sets chosen greedily, each adding the most to those before it; ties go to the lower number.

    It covers at least a fraction 1 - 1/e of the most that any ``most`` sets cover, and uses at most H(largest set) times the
    necessary number of sets (Nemhauser, Wolsey and Fisher 1978; Chvatal 1979).

    Args:
        start: (p + 1,).
        items: numbers 0..n - 1.
        weight: (n,) value of an item, not negative.
        enough: ends the choice when this weight is covered.
        most: largest number of sets.
    """
    p = start.size - 1
    back, sets = transposed(start, items, weight.size)
    gain = np.zeros(p)
    for k in range(p):
        for i in range(start[k], start[k + 1]):
            gain[k] += weight[items[i]]
    covered = np.zeros(weight.size, dtype=np.bool_)
    chosen = np.empty(min(most, p), dtype=np.int64)
    count, total = 0, 0.0
    while count < chosen.size and total < enough:
        best = int(np.argmax(gain))
        if gain[best] <= _NOTHING:
            break
        chosen[count] = best
        count += 1
        for i in range(start[best], start[best + 1]):
            item = items[i]
            if not covered[item]:
                covered[item] = True
                total += weight[item]
                for j in range(back[item], back[item + 1]):
                    gain[sets[j]] -= weight[item]
        gain[best] = 0.0
    return chosen[:count]


@allocating_kernel
def drop_needless(
    start: NDArray[np.int64],
    items: NDArray[np.int32],
    weight: NDArray[np.float64],
    chosen: NDArray[np.int64],
    enough: float,
    most: int,
) -> NDArray[np.int64]:
    """Remove redundant sets, the one with the least unique cover first.

    As long as at least ``enough`` stays covered, and as long as there are more than ``most``.
    """
    times = np.zeros(weight.size, dtype=np.int64)
    total = 0.0
    for k in chosen:
        for i in range(start[k], start[k + 1]):
            total += weight[items[i]] if times[items[i]] == 0 else 0.0
            times[items[i]] += 1
    keep = np.ones(chosen.size, dtype=np.bool_)
    left = chosen.size
    while True:
        least, loss = -1, 0.0
        for number in range(chosen.size):
            if not keep[number]:
                continue
            alone = 0.0
            for i in range(start[chosen[number]], start[chosen[number] + 1]):
                if times[items[i]] == 1:
                    alone += weight[items[i]]
            if least < 0 or alone < loss:
                least, loss = number, alone
        if least < 0 or (left <= most and total - loss < enough - _NOTHING):
            return chosen[keep]
        left -= 1
        keep[least] = False
        total -= loss
        for i in range(start[chosen[least]], start[chosen[least] + 1]):
            times[items[i]] -= 1


def undominated(start: NDArray[np.int64], items: NDArray[np.int32], count: int) -> NDArray[np.bool_]:
    """(p,) which sets are not subsets of another one; the first of equal sets stays, empty sets never do.

    Args:
        start: (p + 1,).
        items: in rising order within a set.
        count: of items in all.
    """
    # Larger sets first, so that a set is only part of one that was looked at before.
    return _undominated(start, items, count, np.argsort(-np.diff(start), kind="stable"))


@allocating_kernel
def _undominated(
    start: NDArray[np.int64], items: NDArray[np.int32], count: int, by_size: NDArray[np.int64]
) -> NDArray[np.bool_]:
    p = start.size - 1
    keep = np.zeros(p, dtype=np.bool_)
    # For every item a chain of the kept sets that have it, through their places in ``items``.
    head = np.full(count, -1, dtype=np.int64)
    chain = np.full(items.size, -1, dtype=np.int64)
    length = np.zeros(count, dtype=np.int64)
    owner = np.empty(items.size, dtype=np.int64)
    for k in range(p):
        owner[start[k] : start[k + 1]] = k
    for k in by_size:
        if start[k] == start[k + 1]:
            continue
        rarest = items[start[k]]
        for i in range(start[k], start[k + 1]):
            if length[items[i]] < length[rarest]:
                rarest = items[i]
        at = head[rarest]
        while at >= 0 and not _is_part(start, items, k, owner[at]):
            at = chain[at]
        if at >= 0:
            continue
        keep[k] = True
        for i in range(start[k], start[k + 1]):
            chain[i] = head[items[i]]
            head[items[i]] = i
            length[items[i]] += 1
    return keep


@kernel
def _is_part(start: NDArray[np.int64], items: NDArray[np.int32], small: int, large: int) -> bool:
    j = start[large]
    for i in range(start[small], start[small + 1]):
        while j < start[large + 1] and items[j] < items[i]:
            j += 1
        if j == start[large + 1] or items[j] != items[i]:
            return False
    return True


class _State(NamedTuple):
    """State of the search: the chosen sets, and the score of each.

    Attributes:
        start: (p + 1,).
        items: of the sets.
        back: (n + 1,).
        sets: of the items.
        weight: (n,) of the items.
        times: (n,) how many chosen sets have an item.
        chosen: (p,).
        score: (p,) weight that a set would newly cover, or, when it is chosen, covers alone.
        moved: (p,) step at which a set went in or out.
        changed: (p,) whether anything near a set has changed since it went out.
        items_open: (n,) the first ``open`` are the items that no chosen set has.
        position: (n,) of each item in ``items_open``.
        open: (1,) how many.
    """

    start: NDArray[np.int64]
    items: NDArray[np.int32]
    back: NDArray[np.int64]
    sets: NDArray[np.int32]
    weight: NDArray[np.int64]
    times: NDArray[np.int64]
    chosen: NDArray[np.bool_]
    score: NDArray[np.int64]
    moved: NDArray[np.int64]
    changed: NDArray[np.bool_]
    items_open: NDArray[np.int64]
    position: NDArray[np.int64]
    open: NDArray[np.int64]


@allocating_kernel
def search_cover(
    start: NDArray[np.int64],
    items: NDArray[np.int32],
    count: int,
    first: NDArray[np.int64],
    steps: int,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Search for the fewest sets that cover all ``count`` items.

    Each step takes out the set whose loss weighs least, and puts in one with a random item that is open then; what stays open
    gets heavier. Whenever nothing is open, the search goes on with a set less.

    Args:
        start: (p + 1,).
        items: numbers 0..count - 1; each is in some set.
        count: of items.
        first: sets that have all items, as the start.
        steps: how many exchanges.
        rng: draws the items.

    Returns:
        (k,) rising numbers of sets, at most as many as ``first``.
    """
    state = _begin(start, items, count)
    for k in first:
        if not state.chosen[k]:
            _put_in(state, k)
    best = np.flatnonzero(state.chosen)
    last = -1
    for step in range(1, steps + 1):
        while state.open[0] == 0:
            best = np.flatnonzero(state.chosen)
            if best.size <= 1:
                return best
            _take_out(state, _least(state, -1), step)
        out = _least(state, last)
        if out >= 0:
            _take_out(state, out, step)
        last = _most(state, state.items_open[int(rng.random() * state.open[0])])
        _put_in(state, last)
        state.moved[last] = step
        for i in range(state.open[0]):
            item = state.items_open[i]
            state.weight[item] += 1
            for j in range(state.back[item], state.back[item + 1]):
                state.score[state.sets[j]] += 1
    return np.flatnonzero(state.chosen) if state.open[0] == 0 else best


@allocating_kernel
def _begin(start: NDArray[np.int64], items: NDArray[np.int32], count: int) -> _State:
    p = start.size - 1
    back, sets = transposed(start, items, count)
    return _State(
        start, items, back, sets, np.ones(count, dtype=np.int64), np.zeros(count, dtype=np.int64),
        np.zeros(p, dtype=np.bool_), start[1:] - start[:-1], np.zeros(p, dtype=np.int64), np.ones(p, dtype=np.bool_),
        np.arange(count), np.arange(count), np.array([count]),
    )  # fmt: skip


@kernel
def _least(state: _State, last: int) -> int:
    """The chosen set with the least score, except ``last``; of equal ones the longest rested; -1 without one."""
    best = -1
    for k in range(state.chosen.size):
        if (
            state.chosen[k]
            and k != last
            and (best < 0 or _is_before(state, state.score[k] - state.score[best], k, best))
        ):
            best = k
    return best


@kernel
def _most(state: _State, item: int) -> int:
    """The set with an item that scores most, of equal ones the longest rested; one that just left only if necessary."""
    best = -1
    for j in range(state.back[item], state.back[item + 1]):
        k = state.sets[j]
        if state.changed[k] and (best < 0 or _is_before(state, state.score[best] - state.score[k], k, best)):
            best = k
    return best if best >= 0 else int(state.sets[state.back[item]])


@kernel
def _is_before(state: _State, difference: int, k: int, other: int) -> bool:
    return bool(difference < 0 or (difference == 0 and state.moved[k] < state.moved[other]))


@kernel
def _put_in(state: _State, k: int) -> None:
    """Choose set k. Its score is unchanged: what it newly covers it then covers alone."""
    state.chosen[k] = True
    for i in range(state.start[k], state.start[k + 1]):
        item = state.items[i]
        state.times[item] += 1
        if state.times[item] == 1:
            _swap(state, item, state.open[0] - 1)
            state.open[0] -= 1
        for j in range(state.back[item], state.back[item + 1]):
            other = state.sets[j]
            state.changed[other] = True
            if other != k and (state.times[item] == 1 or (state.times[item] == 2 and state.chosen[other])):
                state.score[other] -= state.weight[item]


@kernel
def _take_out(state: _State, k: int, step: int) -> None:
    """Remove set k from the chosen ones."""
    state.chosen[k] = False
    for i in range(state.start[k], state.start[k + 1]):
        item = state.items[i]
        state.times[item] -= 1
        if state.times[item] == 0:
            _swap(state, item, state.open[0])
            state.open[0] += 1
        for j in range(state.back[item], state.back[item + 1]):
            other = state.sets[j]
            state.changed[other] = True
            if other != k and (state.times[item] == 0 or (state.times[item] == 1 and state.chosen[other])):
                state.score[other] += state.weight[item]
    state.changed[k] = False
    state.moved[k] = step


@kernel
def _swap(state: _State, item: int, position: int) -> None:
    """Move an item to a position in the list of open items."""
    there, before = state.items_open[position], state.position[item]
    state.items_open[position], state.items_open[before] = item, there
    state.position[item], state.position[there] = position, before
