"""Weight vectors that split a problem of several objectives into many of one."""

from itertools import combinations
from math import comb

import numpy as np

from uavcover.optimizers.interface import FloatArray


def spread_weights(n: int, m: int) -> FloatArray:
    """Weight vectors ``(n, m)`` spread over the simplex, for any n: rows sum to 1, the corners come first.

    Two objectives: evenly spaced. More: from a Das-Dennis lattice of at least 20 n points (n <= 20 n always leaves a choice)
    the corners, then always the point farthest from all chosen ones.

    >>> spread_weights(3, 2).tolist()
    [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    """
    if m == 1:
        return np.ones((n, 1))
    if m == 2:
        share = np.linspace(1.0, 0.0, n)
        return np.column_stack([share, 1.0 - share])
    divisions = 1
    while comb(divisions + m - 1, m - 1) < 20 * n:
        divisions += 1
    # stars and bars: the gaps between m - 1 bars are the parts of a sum
    bars = np.array(list(combinations(range(divisions + m - 1), m - 1)))
    ends = np.column_stack([np.full(len(bars), -1), bars, np.full(len(bars), divisions + m - 1)])
    lattice = (np.diff(ends, axis=1) - 1) / divisions
    chosen = np.flatnonzero(lattice.max(axis=1) == 1.0)[:n].tolist()
    nearest = np.min([np.linalg.norm(lattice - lattice[i], axis=1) for i in chosen], axis=0)
    while len(chosen) < n:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(lattice - lattice[chosen[-1]], axis=1))
    picked: FloatArray = lattice[chosen]
    return picked
