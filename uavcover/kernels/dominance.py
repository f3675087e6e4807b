"""Dominance, non-dominated fronts and crowding distance.

All objectives are minimised. Constraints enter as one number per row, the total violation (0 when feasible), by the
feasibility rules: of two rows with different totals the smaller total dominates; at equal totals Pareto dominance
decides. With all totals zero this is plain Pareto dominance.
"""

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.jit import allocating_kernel, kernel


@kernel
def dominates(objectives: FloatArray, total_violation: FloatArray, p: int, q: int) -> bool:
    """Whether row ``p`` of ``objectives`` ``(n, m)`` dominates row ``q``, given ``total_violation`` ``(n,)``."""
    if total_violation[p] != total_violation[q]:
        return bool(total_violation[p] < total_violation[q])
    better = False
    for j in range(objectives.shape[1]):
        if objectives[p, j] > objectives[q, j]:
            return False
        if objectives[p, j] < objectives[q, j]:
            better = True
    return better


def non_dominated_ranks(objectives: FloatArray, total_violation: FloatArray) -> IntArray:
    """The number of the front each row belongs to, 0 for rows that nothing dominates.

    Efficient non-dominated sort with sequential search (Zhang, Tian, Cheng and Jin 2015): O(m n^2) at worst,
    O(m n sqrt(n)) at best, O(n) memory. With two objectives O(n f) comparisons, f = fronts.

    Args:
        objectives: ``(n, m)``, minimised, no NaN; n = solutions, m = objectives.
        total_violation: ``(n,)``, >= 0, 0 for feasible rows.

    Returns:
        ``(n,)`` int64.

    >>> non_dominated_ranks(np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]), np.zeros(3)).tolist()
    [0, 0, 1]
    """
    return _ranks_up_to(objectives, total_violation, len(objectives))


def non_dominated_mask(objectives: FloatArray, total_violation: FloatArray) -> BoolArray:
    """Which rows nothing dominates: ``non_dominated_ranks(...) == 0`` without the work on the other fronts.

    Args:
        objectives: ``(n, m)``, minimised, no NaN.
        total_violation: ``(n,)``, >= 0, 0 for feasible rows.

    Returns:
        ``(n,)`` bool.
    """
    ranks = _ranks_up_to(objectives, total_violation, 1)
    return np.equal(ranks, 0)


def _ranks_up_to(objectives: FloatArray, total_violation: FloatArray, deepest: int) -> IntArray:
    # In this order no row can be dominated by a later one.
    order = np.lexsort((*objectives.T[::-1], total_violation))
    ranks = np.empty(len(objectives), np.int64)
    ordered = np.ascontiguousarray(objectives[order])
    ranks[order] = _sorted_ranks(ordered, total_violation[order], deepest)
    return ranks


@allocating_kernel
def _sorted_ranks(objectives: FloatArray, total_violation: FloatArray, deepest: int) -> IntArray:
    """Ranks of rows in which dominators come first; rows of front ``deepest`` and beyond all get rank ``deepest``."""
    n, m = objectives.shape
    ranks = np.empty(n, np.int64)
    newest = np.full(n, -1, np.int64)  # of each front, the member placed last
    older = np.empty(n, np.int64)  # of each row, the member of its front placed before it
    for p in range(n):
        front = 0
        while front < deepest:
            member = newest[front]
            while member != -1 and not dominates(objectives, total_violation, member, p):
                # Along a front of two objectives the second one falls: the newest member speaks for all.
                member = older[member] if m > 2 else -1
            if member == -1:
                older[p] = newest[front]
                newest[front] = p
                break
            front += 1
        ranks[p] = front
    return ranks


def crowding_distance(objectives: FloatArray) -> FloatArray:
    """Free space around each row: the sum over objectives of the gap between its neighbours (Deb et al. 2002).

    Gaps are divided by the span of the objective, so positive scaling and shifts of an objective change nothing. The
    ends of every objective get infinity; an objective that is the same everywhere counts for nothing.

    Args:
        objectives: ``(n, m)``, finite; usually one front.

    Returns:
        ``(n,)``, >= 0.

    >>> crowding_distance(np.array([[0.0, 4.0], [1.0, 1.0], [4.0, 0.0]])).tolist()
    [inf, 2.0, inf]
    """
    columns, orders = _columns_and_orders(objectives)
    return _crowding(columns, orders)


def least_crowded(objectives: FloatArray, keep: int) -> IntArray:
    """Rows that remain when the most crowded one is removed, one at a time, until ``keep`` are left.

    Distances are updated after each removal, so a dense cluster is thinned instead of wiped out. Among equals the row
    with the highest index goes. O(m n log n + n (n - keep)).

    Args:
        objectives: ``(n, m)``, finite.
        keep: how many to keep, >= 0; everything is kept when n <= keep.

    Returns:
        ``(min(n, keep),)`` int64 row numbers, ascending.
    """
    if len(objectives) <= keep:
        return np.arange(len(objectives), dtype=np.int64)
    columns, orders = _columns_and_orders(objectives)
    return np.flatnonzero(_thinned(columns, orders, keep)).astype(np.int64, copy=False)


def _columns_and_orders(objectives: FloatArray) -> tuple[FloatArray, IntArray]:
    columns = np.array(objectives.T, dtype=np.float64, order="C")  # a writable copy: one compiled signature
    orders = np.argsort(columns, axis=1, kind="stable").astype(np.int64, copy=False)
    return columns, orders


@allocating_kernel
def _linked(orders: IntArray) -> tuple[IntArray, IntArray]:
    """``(m, n)`` row before and row after each row along each objective, -1 past the ends."""
    m, n = orders.shape
    before = np.full((m, n), -1, np.int64)
    after = np.full((m, n), -1, np.int64)
    for j in range(m):
        for position in range(1, n):
            before[j, orders[j, position]] = orders[j, position - 1]
            after[j, orders[j, position - 1]] = orders[j, position]
    return before, after


@allocating_kernel
def _half_spans(columns: FloatArray, orders: IntArray) -> FloatArray:
    """``(m,)`` half the range of each objective; halves, because the difference of two large values can overflow."""
    m, n = orders.shape
    spans = np.zeros(m)
    if n > 0:
        for j in range(m):
            spans[j] = columns[j, orders[j, n - 1]] / 2 - columns[j, orders[j, 0]] / 2
    return spans


@kernel
def _space_around(columns: FloatArray, before: IntArray, after: IntArray, half_spans: FloatArray, i: int) -> float:
    space = 0.0
    for j in range(columns.shape[0]):
        if half_spans[j] > 0:
            if before[j, i] == -1 or after[j, i] == -1:
                return np.inf
            space += (columns[j, after[j, i]] / 2 - columns[j, before[j, i]] / 2) / half_spans[j]
    return space


@allocating_kernel
def _crowding(columns: FloatArray, orders: IntArray) -> FloatArray:
    before, after = _linked(orders)
    half_spans = _half_spans(columns, orders)
    n = columns.shape[1]
    distance = np.empty(n)
    for i in range(n):
        distance[i] = _space_around(columns, before, after, half_spans, i)
    return distance


@allocating_kernel
def _thinned(columns: FloatArray, orders: IntArray, keep: int) -> BoolArray:
    m, n = columns.shape
    before, after = _linked(orders)
    half_spans = _half_spans(columns, orders)
    distance = _crowding(columns, orders)
    kept = np.ones(n, np.bool_)
    for _ in range(n - keep):
        crowded = -1
        for i in range(n):
            if kept[i] and (crowded == -1 or distance[i] <= distance[crowded]):
                crowded = i
        kept[crowded] = False
        for j in range(m):
            left, right = before[j, crowded], after[j, crowded]
            if left != -1:
                after[j, left] = right
            if right != -1:
                before[j, right] = left
        for j in range(m):
            for neighbour in (before[j, crowded], after[j, crowded]):
                if neighbour != -1:
                    distance[neighbour] = _space_around(columns, before, after, half_spans, neighbour)
    return kept


def first_occurrences(rows: FloatArray) -> BoolArray:
    """Which of ``rows`` ``(n, w)`` do not exactly repeat an earlier one: ``(n,)`` bool; O(n^2) comparisons."""
    return _first_occurrences(np.array(rows, dtype=np.float64, order="C"))


@allocating_kernel
def _first_occurrences(rows: FloatArray) -> BoolArray:
    n, width = rows.shape
    first = np.ones(n, np.bool_)
    for p in range(n):
        for q in range(p):
            if first[q]:
                j = 0
                while j < width and rows[p, j] == rows[q, j]:
                    j += 1
                if j == width:
                    first[p] = False
                    break
    return first
