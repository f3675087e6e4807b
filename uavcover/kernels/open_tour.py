"""Short open tours with free ends, as closed tours through one point more that is near to all others."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel
from uavcover.kernels.closed_tour import nearest, shorten
from uavcover.kernels.route import nearest_neighbour_order

_NEAR = 10

_KICKS_PER_POINT = 20
"""Shortest tours of up to 60 points in every trial, within 0.6 % of LKH for 1,000 points (docs/results/bounds.md)."""


def short_tour(points_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """A short order (n,) of (n, 3) points, both ends free; the same whenever it is asked for.

    About 2 ms for 50 points and 0.4 s for 1,000; 8 n^2 bytes.
    """
    points = np.ascontiguousarray(points_m, dtype=float)
    order = nearest_neighbour_order(points, points[0]) if len(points) else np.empty(0, dtype=np.int64)
    return shorten_open(points, order, _KICKS_PER_POINT * len(points), np.random.default_rng(0))


@kernel
def shorten_open(
    points: NDArray[np.float64], order: NDArray[np.int64], kicks: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Shorten an open tour whose two ends are free, by 2-opt, Or-opt and kicks (:func:`closed_tour.shorten`).

    Args:
        points: (m, 3) metres.
        order: (n,) which of them, in the order to start from.
        kicks: how many; each is kept where it helps.
        rng: draws the kicks.

    Returns:
        (n,) the same numbers in an order that is not longer.
    """
    n = order.size
    if n < 3:
        return order.copy()
    # Number n is no place: free to reach from everywhere, so the closed tour through it is an open one without it.
    distance = np.zeros((n + 1, n + 1))
    for i in range(n):
        for j in range(n):
            a, b = points[order[i]], points[order[j]]
            distance[i, j] = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    near = np.zeros((n + 1, min(_NEAR, n - 1)), dtype=np.int64)
    near[:n] = nearest(np.ascontiguousarray(distance[:n, :n]), near.shape[1])
    tour = shorten(distance, near, np.arange(n + 1), kicks, rng)
    at = 0
    while tour[at] != n:
        at += 1
    out = np.empty(n, dtype=np.int64)
    for k in range(n):
        out[k] = order[tour[(at + 1 + k) % (n + 1)]]
    return out
