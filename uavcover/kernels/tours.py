"""Short tours: closed ones, open ones with free ends, and paths between two given ends.

Closed tours: 2-opt and Or-opt among near neighbours, then kicks that are kept where they help. Open tours with free ends are
closed tours through one more point that is near to all others.
"""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import read_only
from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.route import nearest_neighbour_order

_LONGEST_STRETCH = 3
_WIDEST_KICK = 30
_LEAST_GAIN = 1e-9

FREE_ENDS = np.full(3, np.nan)
"""Used as home if both ends of a tour are free."""


@allocating_kernel
def nearest(distance: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """(n, count) numbers of the points nearest to each of n points; of equal ones the lower number first.

    Args:
        distance: (n, n).
        count: at most n - 1.
    """
    n = distance.shape[0]
    out = np.empty((n, count), dtype=np.int64)
    for i in range(n):
        filled = 0
        for j in range(n):
            if j == i or (filled == count and distance[i, j] >= distance[i, out[i, count - 1]]):
                continue
            k = min(filled, count - 1)
            while k > 0 and distance[i, out[i, k - 1]] > distance[i, j]:
                out[i, k] = out[i, k - 1]
                k -= 1
            out[i, k] = j
            filled = min(filled + 1, count)
    return out


@allocating_kernel
def shorten(
    distance: NDArray[np.float64],
    near: NDArray[np.int64],
    tour: NDArray[np.int64],
    kicks: int,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Shorten a closed tour: iterated local search (Johnson and McGeoch 1997) with 2-opt and Or-opt.

    A kick exchanges two neighbouring stretches (the double bridge, which 2-opt cannot undo) at a random place; what it and
    the local search around it make longer is taken back. No kick breaks a link that must stay.

    Args:
        distance: (n, n) symmetric; a link that must stay has a large negative one.
        near: (n, k) points that a point may get as a new neighbour in the tour, nearest first.
        tour: (n,) numbers of the points in order.
        kicks: how many.
        rng: draws them.

    Returns:
        (n,) a tour that is not longer.
    """
    n = tour.size
    now = tour.copy()
    if n < 4:
        return now
    waiting = np.ones(n, dtype=np.bool_)
    queue = now.copy()
    gained = _settle(distance, near, now, queue, waiting)
    if n < 8:
        return now
    before = np.empty_like(now)
    widest = max(1, min(_WIDEST_KICK, n // 3 - 1))
    for _ in range(kicks):
        before[:] = now
        first, second = 1 + int(rng.random() * widest), 1 + int(rng.random() * widest)
        start = int(rng.random() * n)
        if _is_fixed(distance, now, start, first, second):
            continue
        ends, gained = _exchange(distance, now, start, first, second)
        for point in ends:
            waiting[point] = True
        gained += _settle(distance, near, now, ends, waiting)
        if gained < -_LEAST_GAIN:
            now[:] = before
    return now


@kernel
def _is_fixed(distance: NDArray[np.float64], tour: NDArray[np.int64], start: int, first: int, second: int) -> bool:
    """Whether one of the three links that an exchange breaks must stay."""
    n, fixed = tour.size, False
    for at in (start, start + first, start + first + second):
        fixed = fixed or distance[tour[at % n], tour[(at + 1) % n]] < 0.0
    return fixed


@allocating_kernel
def _exchange(
    distance: NDArray[np.float64], tour: NDArray[np.int64], start: int, first: int, second: int
) -> tuple[NDArray[np.int64], float]:
    """Exchange the stretches of ``first`` and ``second`` points after ``start`` in place: the six ends, and what it gains."""
    n = tour.size
    stretch = np.empty(first + second, dtype=np.int64)
    for k in range(first + second):
        stretch[k] = tour[(start + 1 + k) % n]
    before, after = tour[start], tour[(start + 1 + first + second) % n]
    ends = np.array([before, stretch[0], stretch[first - 1], stretch[first], stretch[-1], after])
    gained = distance[before, ends[1]] + distance[ends[2], ends[3]] + distance[ends[4], after]
    gained -= distance[before, ends[3]] + distance[ends[4], ends[1]] + distance[ends[2], after]
    for k in range(first + second):
        tour[(start + 1 + k) % n] = stretch[(first + k) % (first + second)]
    return ends, gained


@allocating_kernel
def _settle(
    distance: NDArray[np.float64],
    near: NDArray[np.int64],
    tour: NDArray[np.int64],
    points: NDArray[np.int64],
    waiting: NDArray[np.bool_],
) -> float:
    """2-opt and Or-opt in place until no move at a waiting point helps; what was gained.

    Args:
        distance: (n, n).
        near: (n, k).
        tour: (n,).
        points: the points that wait, in the order in which they are looked at; marked in ``waiting``, some may be there twice.
        waiting: (n,), none is left.
    """
    n = tour.size
    position = np.empty(n, dtype=np.int64)
    for i in range(n):
        position[tour[i]] = i
    # A ring: no point waits twice, so n + len(points) positions are enough.
    queue = np.empty(n + points.size, dtype=np.int64)
    head, size = 0, points.size
    queue[:size] = points
    gained = 0.0
    touched = np.empty(8, dtype=np.int64)
    while size > 0:
        point = queue[head]
        head = (head + 1) % queue.size
        size -= 1
        if not waiting[point]:
            continue
        waiting[point] = False
        while True:
            gain = _turn_stretch(distance, near, tour, position, point, touched)
            if gain == 0.0:
                gain = _move_stretch(distance, near, tour, position, point, touched)
            if gain == 0.0:
                break
            gained += gain
            for other in touched:
                if other != point and not waiting[other]:
                    waiting[other] = True
                    queue[(head + size) % queue.size] = other
                    size += 1
    return gained


@allocating_kernel
def _turn_stretch(
    distance: NDArray[np.float64],
    near: NDArray[np.int64],
    tour: NDArray[np.int64],
    position: NDArray[np.int64],
    a: int,
    touched: NDArray[np.int64],
) -> float:
    """2-opt: make the first move that helps and links ``a`` to a near point; its gain, 0 for none."""
    n = tour.size
    for step in (1, -1):
        b = tour[(position[a] + step) % n]
        for c in near[a]:
            gain = distance[a, b] - distance[a, c]
            if gain <= _LEAST_GAIN:
                break
            d = tour[(position[c] + step) % n]
            gain += distance[c, d] - distance[b, d]
            if gain > _LEAST_GAIN and c != b and d != a:
                if step == 1:
                    _reverse(tour, position, position[b], position[c])
                else:
                    _reverse(tour, position, position[c], position[b])
                touched[:4] = np.array([a, b, c, d])
                touched[4:] = a
                return float(gain)
    return 0.0


@kernel
def _reverse(tour: NDArray[np.int64], position: NDArray[np.int64], first: int, last: int) -> None:
    """Reverse the stretch first..last, or all the rest, which is equivalent for a closed tour."""
    n = tour.size
    inside = (last - first) % n + 1
    if 2 * inside > n:
        first, last, inside = (last + 1) % n, (first - 1) % n, n - inside
    for _ in range(inside // 2):
        x, y = tour[first], tour[last]
        tour[first], tour[last] = y, x
        position[y], position[x] = first, last
        first = first + 1 if first + 1 < n else 0
        last = last - 1 if last > 0 else n - 1


@allocating_kernel
def _move_stretch(
    distance: NDArray[np.float64],
    near: NDArray[np.int64],
    tour: NDArray[np.int64],
    position: NDArray[np.int64],
    a: int,
    touched: NDArray[np.int64],
) -> float:
    """Or-opt: move one to three points that end at ``a`` beside a near point; its gain, 0 for none."""
    n = tour.size
    for step in (1, -1):
        for length in range(1, min(_LONGEST_STRETCH, n - 3) + 1):
            # a .. y along ``step``; outside are p beside a and q beside y.
            y = tour[(position[a] + step * (length - 1)) % n]
            p, q = tour[(position[a] - step) % n], tour[(position[a] + step * length) % n]
            freed = distance[p, a] + distance[y, q] - distance[p, q]
            for c in near[a]:
                if freed - distance[a, c] <= _LEAST_GAIN:
                    break
                if (position[c] - position[a]) * step % n < length:
                    continue
                for side in (1, -1):
                    e = tour[(position[c] + side) % n]
                    if (position[e] - position[a]) * step % n < length:
                        continue
                    gain = freed - distance[a, c] + distance[c, e] - distance[y, e]
                    if gain > _LEAST_GAIN:
                        _insert(tour, position, a, step, length, c, side)
                        touched[:] = np.array([a, y, p, q, c, e, a, a])
                        return float(gain)
    return 0.0


@allocating_kernel
def _insert(
    tour: NDArray[np.int64], position: NDArray[np.int64], a: int, step: int, length: int, c: int, side: int
) -> None:
    """Remove the stretch from ``a`` along ``step`` and insert it beside ``c`` on the given side, ``a`` next to ``c``."""
    n = tour.size
    stretch = np.empty(length, dtype=np.int64)
    for k in range(length):
        stretch[k] = tour[(position[a] + step * k) % n]
    rest = np.empty(n, dtype=np.int64)
    k = 0
    for point in tour:
        if (position[point] - position[a]) * step % n < length:
            continue
        if point == c and side == -1:
            rest[k : k + length] = stretch[::-1]
            k += length
        rest[k] = point
        k += 1
        if point == c and side == 1:
            rest[k : k + length] = stretch
            k += length
    for i in range(n):
        tour[i] = rest[i]
        position[rest[i]] = i


_NEAR = 10

_KICKS_PER_POINT = 20
"""Shortest tours of up to 60 points in every trial, within 0.6 % of LKH for 1,000 points (docs/results/bounds.md)."""


def short_tour(points_m: NDArray[np.float64], home_m: NDArray[np.float64] = FREE_ENDS) -> NDArray[np.int64]:
    """A short order (n,) of (n, 3) points, from a home (3,) and back, or with free ends; deterministic.

    About 2 ms for 50 points and 0.4 s for 1,000; 8 n^2 bytes.
    """
    points = read_only(points_m)
    order = nearest_neighbour_order(points, points[0]) if len(points) else np.empty(0, dtype=np.int64)
    return shorten_open(points, order, _KICKS_PER_POINT * len(points), np.random.default_rng(0), read_only(home_m))


@allocating_kernel
def shorten_open(
    points: NDArray[np.float64],
    order: NDArray[np.int64],
    kicks: int,
    rng: np.random.Generator,
    home: NDArray[np.float64] = FREE_ENDS,
) -> NDArray[np.int64]:
    """Shorten an open tour, by 2-opt, Or-opt and kicks (:func:`closed_tour.shorten`).

    Args:
        points: (m, 3) metres.
        order: (n,) which of them, in the order to start from.
        kicks: how many; each is kept where it helps.
        rng: draws the kicks.
        home: (3,) from where the way to the first point and back from the last one counts, over the map; NaN: both ends are free.

    Returns:
        (n,) the same numbers in an order that is not longer.
    """
    n = order.size
    if n < 3:
        return order.copy()
    # Number n is home, or no place: free to reach from everywhere, so the closed tour through it is an open one without it.
    distance = np.zeros((n + 1, n + 1))
    for i in range(n):
        for j in range(n):
            a, b = points[order[i]], points[order[j]]
            distance[i, j] = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
        if math.isfinite(home[0]):
            distance[i, n] = distance[n, i] = math.hypot(points[order[i], 0] - home[0], points[order[i], 1] - home[1])
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


@allocating_kernel
def order_between_ends(distance: NDArray[np.float64]) -> NDArray[np.int64]:
    """A short order of all points from the first to the last: nearest neighbour, 2-opt and Or-opt.

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
                if _move_stretch_between(distance, tour, i, length):
                    improved = True
    return tour


@allocating_kernel
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


@allocating_kernel
def _move_stretch_between(distance: NDArray[np.float64], tour: NDArray[np.int64], first: int, length: int) -> bool:
    """Move tour[first .. first + length - 1] to its cheapest position, in either direction; whether it was moved."""
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
