"""Order and length of routes, and distance from them."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel


@allocating_kernel
def distances_to_polyline(points: NDArray[np.float64], polyline: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) distance of each of (n, 3) points from the (m, 3) polyline, metres. O(n m).

    Infinite where a point is not finite, and when there is no polyline.
    """
    out = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        best = math.inf
        for j in range(polyline.shape[0] - 1 if polyline.shape[0] > 1 else polyline.shape[0]):
            a = polyline[j]
            b = polyline[min(j + 1, polyline.shape[0] - 1)]
            de, dn, du = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            pe, pn, pu = points[i, 0] - a[0], points[i, 1] - a[1], points[i, 2] - a[2]
            length2 = de * de + dn * dn + du * du
            t = 0.0
            if length2 > 0.0:
                t = min(1.0, max(0.0, (pe * de + pn * dn + pu * du) / length2))
            d2 = (pe - t * de) ** 2 + (pn - t * dn) ** 2 + (pu - t * du) ** 2
            if d2 < best:
                best = d2
        out[i] = math.sqrt(best)
    return out


@allocating_kernel
def nearest_neighbour_order(points: NDArray[np.float64], reference: NDArray[np.float64]) -> NDArray[np.int64]:
    """Order of (n, 3) points: first the one nearest to ``reference`` (3,), then always the nearest one left.

    The paper's decoding (section 2.1). Ties go to the lower index. O(n^2).
    """
    n = points.shape[0]
    order = np.empty(n, dtype=np.int64)
    used = np.zeros(n, dtype=np.bool_)
    at = reference
    for k in range(n):
        best = -1
        best2 = math.inf
        for i in range(n):
            if not used[i]:
                d2 = (points[i, 0] - at[0]) ** 2 + (points[i, 1] - at[1]) ** 2 + (points[i, 2] - at[2]) ** 2
                if d2 < best2:
                    best, best2 = i, d2
        order[k] = best
        used[best] = True
        at = points[best]
    return order


@allocating_kernel
def two_opt(points: NDArray[np.float64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Shorten an open tour by 2-opt and Or-opt moves until none helps; its first point stays first.

    2-opt reverses a stretch of the tour; Or-opt moves a stretch of up to three points elsewhere. O(n^2) a sweep.

    Args:
        points: (m, 3) metres.
        order: (n,) which of them, in the order to start from.

    Returns:
        (n,) the same numbers in an order that is not longer.
    """
    n = order.size
    tour = np.arange(n)
    if n < 3:
        return order.copy()
    distance = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            a, b = points[order[i]], points[order[j]]
            distance[i, j] = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    improved = True
    while improved:
        improved = False
        for i in range(n - 2):
            for j in range(i + 2, n):
                # Reverse tour[i + 1 .. j]; the tour is open, so the last edge may be missing.
                gain = distance[tour[i], tour[i + 1]] - distance[tour[i], tour[j]]
                if j + 1 < n:
                    gain += distance[tour[j], tour[j + 1]] - distance[tour[i + 1], tour[j + 1]]
                if gain > 1e-9:
                    tour[i + 1 : j + 1] = tour[i + 1 : j + 1][::-1].copy()
                    improved = True
        if _or_opt_sweep(distance, tour):
            improved = True
    return order[tour]


@allocating_kernel
def _or_opt_sweep(distance: NDArray[np.float64], tour: NDArray[np.int64]) -> bool:
    """Move stretches of one to three points to where the tour gets shorter; True when any was moved."""
    n = tour.size
    moved = False
    for length in range(1, 4):
        first = 1
        while first + length <= n:
            last = first + length - 1
            before = tour[first - 1]
            out = distance[before, tour[first]]
            if last + 1 < n:
                out += distance[tour[last], tour[last + 1]] - distance[before, tour[last + 1]]
            best_gain = 1e-9
            best_at = -1
            for k in range(n):
                # Between tour[k] and tour[k + 1], neither of which is in the stretch.
                if first - 1 <= k <= last:
                    continue
                into = distance[tour[k], tour[first]]
                if k + 1 < n:
                    into += distance[tour[last], tour[k + 1]] - distance[tour[k], tour[k + 1]]
                if out - into > best_gain:
                    best_gain, best_at = out - into, k
            if best_at >= 0:
                stretch = tour[first : last + 1].copy()
                if best_at < first:
                    tour[best_at + 1 + length : last + 1] = tour[best_at + 1 : first].copy()
                    tour[best_at + 1 : best_at + 1 + length] = stretch
                else:
                    tour[first : best_at + 1 - length] = tour[last + 1 : best_at + 1].copy()
                    tour[best_at + 1 - length : best_at + 1] = stretch
                moved = True
            first += 1
    return moved


@kernel
def path_length(route: NDArray[np.float64]) -> float:
    """Length of the open path through (n, 3) points (Eq. 6)."""
    total = 0.0
    for i in range(route.shape[0] - 1):
        de = route[i + 1, 0] - route[i, 0]
        dn = route[i + 1, 1] - route[i, 1]
        du = route[i + 1, 2] - route[i, 2]
        total += math.sqrt(de * de + dn * dn + du * du)
    return total
