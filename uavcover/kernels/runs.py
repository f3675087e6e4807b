"""Sets of squares as runs, and what changes in the counts when some sets give way to others.

A set is a rising row of numbers: the first square of a run, the first square behind it, the first of the next run, and so on.
Squares are the places of a lattice, row * columns + column, so what a camera sees of a row of cells is one run or few.
"""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel


@kernel
def runs_of(squares: NDArray[np.int32], count: int, out: NDArray[np.int32]) -> int:
    """Write the runs of the first ``count`` of rising squares into ``out``; returns how many numbers, -1 when it is too short."""
    written = 0
    for k in range(count):
        square = squares[k]
        if written > 0 and out[written - 1] == square:
            out[written - 1] = square + 1
            continue
        if written + 2 > out.size:
            return -1
        out[written] = square
        out[written + 1] = square + 1
        written += 2
    return written


@kernel
def compare(
    runs: NDArray[np.int32],
    sizes: NDArray[np.int64],
    sets: NDArray[np.int64],
    olds: int,
    news: int,
    changes: NDArray[np.int32],
) -> int:
    """By how much the count of each square changes when some sets give way to others.

    Args:
        runs: (sets, stride) a set in each row.
        sizes: (sets,) how many numbers of each.
        sets: (olds + news, 3) in column 0 the rows of the old sets, then of the new ones; the rest is working memory.
        olds: how many old sets.
        news: how many new ones.
        changes: (m, 3) is written: first square, first square behind, change of the count; m as large as all sets together.

    Returns:
        How many stretches have changed. Squares that all sets see alike are in none of them.
    """
    left = 0
    for k in range(olds + news):
        if sizes[sets[k, 0]] > 0:
            sets[left, 0] = sets[k, 0]
            sets[left, 1] = 0
            sets[left, 2] = -1 if k < olds else 1
            left += 1
    count = 0
    level, at = 0, 0
    while left > 0:
        nearest = runs[sets[0, 0], sets[0, 1]]
        for k in range(1, left):
            nearest = min(nearest, runs[sets[k, 0], sets[k, 1]])
        if level != 0 and nearest > at:
            if count > 0 and changes[count - 1, 1] == at and changes[count - 1, 2] == level:
                changes[count - 1, 1] = nearest
            else:
                changes[count, 0], changes[count, 1], changes[count, 2] = at, nearest, level
                count += 1
        k = 0
        while k < left:
            number, position = sets[k, 0], sets[k, 1]
            if runs[number, position] == nearest:
                level += sets[k, 2] if position % 2 == 0 else -sets[k, 2]
                sets[k, 1] = position + 1
                if position + 1 == sizes[number]:
                    left -= 1
                    sets[k, 0], sets[k, 1], sets[k, 2] = sets[left, 0], sets[left, 1], sets[left, 2]
                    continue
                if runs[number, position + 1] == nearest:
                    continue
            k += 1
        at = nearest
    return count


@kernel
def weigh_changes(
    changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16], weight: NDArray[np.float64]
) -> float:
    """Change of the weight (squares,) that is counted at least once, if the changes were made."""
    gained = 0.0
    for k in range(count):
        by = changes[k, 2]
        if by > 0:
            for square in range(changes[k, 0], changes[k, 1]):
                if counts[square] == 0:
                    gained += weight[square]
        else:
            for square in range(changes[k, 0], changes[k, 1]):
                if counts[square] == -by:
                    gained -= weight[square]
    return gained


@kernel
def weigh_often(
    changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16], weight: NDArray[np.float64], times: int
) -> float:
    """Change of the weight (squares,) that is counted at least ``times`` times; :func:`weigh_changes` is the quick way for 1."""
    gained = 0.0
    for k in range(count):
        by = changes[k, 2]
        for square in range(changes[k, 0], changes[k, 1]):
            before = int(counts[square])
            if before < times <= before + by:
                gained += weight[square]
            elif before >= times > before + by:
                gained -= weight[square]
    return gained


@kernel
def make_changes(changes: NDArray[np.int32], count: int, counts: NDArray[np.uint16]) -> None:
    """Change the counts."""
    for k in range(count):
        by = changes[k, 2]
        for square in range(changes[k, 0], changes[k, 1]):
            counts[square] = counts[square] + by
