"""The order of points on a way whose two ends are given."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels._jit import kernel


@kernel
def order_between_ends(distance: NDArray[np.float64]) -> NDArray[np.int64]:
    """A short order of all points from the first to the last: nearest neighbour, then 2-opt and Or-opt until none helps.

    Args:
        distance: (n, n) symmetric; point 0 stays first, point n - 1 last.

    Returns:
        (n,) numbers of the points. O(n^2) a sweep.
    """
    n = distance.shape[0]
    tour = _nearest_neighbour(distance)
    improved = n > 3
    while improved:
        improved = False
        for i in range(1, n - 2):
            for j in range(i + 1, n - 1):
                # Reverse tour[i .. j].
                before, first, last, after = tour[i - 1], tour[i], tour[j], tour[j + 1]
                change = distance[before, last] + distance[first, after]
                if change < distance[before, first] + distance[last, after] - 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                    improved = True
        for length in range(1, min(3, n - 3) + 1):
            for i in range(1, n - length):
                if _move_stretch(distance, tour, i, length):
                    improved = True
    return tour


@kernel
def _nearest_neighbour(distance: NDArray[np.float64]) -> NDArray[np.int64]:
    n = distance.shape[0]
    tour = np.empty(n, dtype=np.int64)
    used = np.zeros(n, dtype=np.bool_)
    at = 0
    for k in range(n):
        if k == 0:
            best = 0
        elif k == n - 1:
            best = n - 1
        else:
            best = -1
            for i in range(1, n - 1):
                if not used[i] and (best < 0 or distance[at, i] < distance[at, best]):
                    best = i
        tour[k] = best
        used[best] = True
        at = best
    return tour


@kernel
def _move_stretch(distance: NDArray[np.float64], tour: NDArray[np.int64], first: int, length: int) -> bool:
    """Move tour[first .. first + length - 1] to where the way gets shortest, either way round; whether it was moved."""
    n = tour.size
    last = first + length - 1
    before, after = tour[first - 1], tour[last + 1]
    saved = distance[before, tour[first]] + distance[tour[last], after] - distance[before, after]
    best, best_at, best_turned = 1e-9, -1, False
    for k in range(n - 1):
        if first - 1 <= k <= last:
            continue
        gap = distance[tour[k], tour[k + 1]]
        straight = distance[tour[k], tour[first]] + distance[tour[last], tour[k + 1]] - gap
        turned = distance[tour[k], tour[last]] + distance[tour[first], tour[k + 1]] - gap
        if saved - straight > best:
            best, best_at, best_turned = saved - straight, k, False
        if saved - turned > best:
            best, best_at, best_turned = saved - turned, k, True
    if best_at < 0:
        return False
    stretch = tour[first : last + 1].copy()
    if best_turned:
        stretch = stretch[::-1].copy()
    if best_at < first:
        tour[best_at + 1 + length : last + 1] = tour[best_at + 1 : first].copy()
        tour[best_at + 1 : best_at + 1 + length] = stretch
    else:
        tour[first : best_at + 1 - length] = tour[last + 1 : best_at + 1].copy()
        tour[best_at + 1 - length : best_at + 1] = stretch
    return True
