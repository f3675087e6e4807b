"""Order and length of routes, distance from them, and terrain following."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import top_within_m
from uavcover.kernels.surface import GRID, Surface, height_range_between, up_above


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


@kernel
def _sample_count(polyline: NDArray[np.float64], spacing: float) -> int:
    count = 1
    for i in range(polyline.shape[0] - 1):
        length = math.hypot(polyline[i + 1, 0] - polyline[i, 0], polyline[i + 1, 1] - polyline[i, 1])
        count += max(1, math.ceil(length / spacing))
    return count


@allocating_kernel
def follow_terrain(
    surface: Surface,
    polyline: NDArray[np.float64],
    wanted: NDArray[np.float64],
    low: float,
    high: float,
    max_slope: float,
    tolerance: float,
    spacing: float,
    beside: float,
    above: float,
) -> NDArray[np.float64]:
    """Drape a polyline over the terrain: heights inside a band above ground, slopes inside a limit, few waypoints.

    1. Sample the ground along the line. What rises above the straight line between two samples of it, or sinks below, narrows
       the band at both of them by as much: chords that keep the band at the samples keep it everywhere.
    2. The lowest and highest allowed profiles are widened until no slope is steeper than ``max_slope``: where the ground
       rises faster, the climb starts earlier. Where both cannot be had, the lower limit wins. Near an obstacle the lowest
       profile is that far above its top.
    3. The wanted height above ground, made no steeper than that, is the reference.
    4. Straight chords, as long as they stay within ``tolerance`` of the reference and inside the band at every sample,
       replace it. Corners of the polyline stay waypoints.

    Args:
        surface: the ground.
        polyline: (n, 2) east, north in metres, n >= 2.
        wanted: (n,) wanted height above ground at the corners, metres, linear between them.
        low: lowest height above ground, metres.
        high: largest height above ground, metres.
        max_slope: tangent of the steepest climb.
        tolerance: how far a chord may leave the reference, metres.
        spacing: largest distance between samples, metres.
        beside: clearance beside obstacles, metres.
        above: clearance above their tops, metres.

    Returns:
        (m, 3) east, north, up; NaN ups where the ground has no data.
    """
    count = _sample_count(polyline, spacing)
    along = np.empty(count)
    east = np.empty(count)
    north = np.empty(count)
    reference = np.empty(count)
    lowest = np.empty(count)
    highest = np.empty(count)
    corner = np.zeros(count, dtype=np.bool_)
    along[0] = 0.0
    k = 0
    for i in range(polyline.shape[0] - 1):
        length = math.hypot(polyline[i + 1, 0] - polyline[i, 0], polyline[i + 1, 1] - polyline[i, 1])
        pieces = max(1, math.ceil(length / spacing))
        start = along[k]
        for piece in range(0 if i == 0 else 1, pieces + 1):
            t = piece / pieces
            k = k + 1 if piece > 0 else k
            along[k] = start + t * length
            # The corner itself at the end, not a sum that rounds beside it.
            east[k] = polyline[i, 0] + t * (polyline[i + 1, 0] - polyline[i, 0]) if t < 1.0 else polyline[i + 1, 0]
            north[k] = polyline[i, 1] + t * (polyline[i + 1, 1] - polyline[i, 1]) if t < 1.0 else polyline[i + 1, 1]
            reference[k] = up_above(surface, east[k], north[k], wanted[i] + t * (wanted[i + 1] - wanted[i]))
            lowest[k] = up_above(surface, east[k], north[k], low)
            highest[k] = up_above(surface, east[k], north[k], high)
        corner[k] = True
    corner[0] = True
    _narrow(surface, east, north, lowest, low, highest, high)
    for i in range(count):
        # Both samples around a place that is near an obstacle are as high as it asks for, and so is the chord between.
        lowest[i] = max(lowest[i], top_within_m(surface.obstacles, east[i], north[i], beside + spacing) + above)
    _widen(along, lowest, max_slope)
    _widen(along, reference, max_slope)
    for i in range(count):
        highest[i] = -highest[i]
    _widen(along, highest, max_slope)
    for i in range(count):
        highest[i] = -highest[i]
        if not math.isnan(reference[i]):
            reference[i] = max(lowest[i], min(highest[i], reference[i]))
    return _chords(along, east, north, reference, lowest, highest, corner, tolerance)


@allocating_kernel
def _narrow(
    surface: Surface,
    east: NDArray[np.float64],
    north: NDArray[np.float64],
    lowest: NDArray[np.float64],
    low: float,
    highest: NDArray[np.float64],
    high: float,
) -> None:
    """Narrow the band in place, at both samples, by how far the straight line between its ends leaves it.

    Args:
        surface: the ground.
        east: (n,) of the samples.
        north: (n,) likewise.
        lowest: (n,) up coordinates of the lower end of the band.
        low: its height above ground.
        highest: (n,) up coordinates of the upper end.
        high: its height above ground.
    """
    rise = np.zeros(east.size)
    fall = np.zeros(east.size)
    for k in range(1, east.size):
        below, _, above, _ = height_range_between(
            surface, east[k - 1], north[k - 1], lowest[k - 1], east[k], north[k], lowest[k], -math.inf
        )
        if surface.kind == GRID and surface.grid.lean_per_m != 0.0:
            # Where plumb lines lean the ground under the upper end of the band is not quite that under the lower one.
            _, _, above, _ = height_range_between(
                surface, east[k - 1], north[k - 1], highest[k - 1], east[k], north[k], highest[k], -math.inf
            )
            above += low - high
        if below < low:
            rise[k - 1], rise[k] = max(rise[k - 1], low - below), max(rise[k], low - below)
        if above > low:
            fall[k - 1], fall[k] = max(fall[k - 1], above - low), max(fall[k], above - low)
    for k in range(east.size):
        lowest[k] += rise[k]
        highest[k] -= fall[k]


@kernel
def _widen(along: NDArray[np.float64], profile: NDArray[np.float64], max_slope: float) -> None:
    """Raise ``profile`` in place until it is nowhere steeper than ``max_slope``; NaN stays, and reaches no neighbour."""
    for i in range(1, profile.size):
        least = profile[i - 1] - max_slope * (along[i] - along[i - 1])
        if profile[i] < least:
            profile[i] = least
    for i in range(profile.size - 2, -1, -1):
        least = profile[i + 1] - max_slope * (along[i + 1] - along[i])
        if profile[i] < least:
            profile[i] = least


@allocating_kernel
def _chords(
    along: NDArray[np.float64],
    east: NDArray[np.float64],
    north: NDArray[np.float64],
    reference: NDArray[np.float64],
    lowest: NDArray[np.float64],
    highest: NDArray[np.float64],
    corner: NDArray[np.bool_],
    tolerance: float,
) -> NDArray[np.float64]:
    """Fewest straight chords between points of the reference, greedily: each as long as the samples beneath it allow."""
    keep = np.zeros(along.size, dtype=np.bool_)
    keep[0] = True
    at = 0
    while at < along.size - 1:
        furthest = at + 1
        # Slopes from here that pass between floor and ceiling at every sample so far.
        shallowest, steepest = -math.inf, math.inf
        for j in range(at + 1, along.size):
            if math.isnan(reference[j]):
                # No chord over ground that is not known: each sample without data stays, as NaN.
                break
            run = along[j] - along[at]
            if run > 0.0:
                slope = (reference[j] - reference[at]) / run
                if shallowest <= slope <= steepest:
                    furthest = j
                floor = max(lowest[j], reference[j] - tolerance)
                ceiling = max(floor, min(highest[j], reference[j] + tolerance))
                shallowest = max(shallowest, (floor - reference[at]) / run)
                steepest = min(steepest, (ceiling - reference[at]) / run)
            if corner[j] or shallowest > steepest:
                if corner[j] and run == 0.0:
                    furthest = j
                break
        keep[furthest] = True
        at = furthest
    out = np.empty((int(keep.sum()), 3))
    k = 0
    for i in range(along.size):
        if keep[i]:
            out[k, 0], out[k, 1], out[k, 2] = east[i], north[i], reference[i]
            k += 1
    return out
