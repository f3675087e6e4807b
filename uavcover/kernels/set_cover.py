"""Choosing few of many sets that cover much: greedily, and which sets no exact answer needs.

Sets are rows of a compressed table: set k has the numbers ``items[start[k] : start[k + 1]]``, in rising order.
"""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel

_NOTHING = 1e-12
"""A gain that rounding may have left over."""


@kernel
def transposed(
    start: NDArray[np.int64], items: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The table the other way round: for each of ``count`` items the sets that have it, in rising order."""
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


@kernel
def choose_greedily(
    start: NDArray[np.int64], items: NDArray[np.int32], weight: NDArray[np.float64], enough: float, most: int
) -> NDArray[np.int64]:
    """Numbers of sets, each the one that adds most to what those before it cover; of equals the lower number.

    At least a share 1 - 1/e of the most that any ``most`` sets cover, and at most H(largest set) times as many sets as are
    needed (Nemhauser, Wolsey and Fisher 1978; Chvatal 1979).

    Args:
        start: (p + 1,).
        items: numbers 0..n - 1.
        weight: (n,) what an item is worth, none negative.
        enough: ends the choice when so much is covered.
        most: most sets.
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


@kernel
def drop_needless(
    start: NDArray[np.int64],
    items: NDArray[np.int32],
    weight: NDArray[np.float64],
    chosen: NDArray[np.int64],
    enough: float,
    most: int,
) -> NDArray[np.int64]:
    """Leave out chosen sets, the one that alone covers least first.

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
    """(p,) which sets are not part of another one; of equal sets the first counts. Empty sets never do.

    Args:
        start: (p + 1,).
        items: in rising order within a set.
        count: of items in all.
    """
    # Larger sets first, so that a set is only part of one that was looked at before.
    return _undominated(start, items, count, np.argsort(-np.diff(start), kind="stable"))


@kernel
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
