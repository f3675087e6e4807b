"""Height profiles of lines over terrain: terrain following, and the least climb within a band."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.obstacles import top_within_m
from uavcover.kernels.surface import GRID, Surface, height_range_between, up_above

_ROUNDING_M = 1e-6


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
    band = _band(surface, polyline, wanted, low, high, max_slope, spacing, beside, above)
    reference = np.empty(band.along.size)
    for i in range(reference.size):
        reference[i] = up_above(surface, band.east[i], band.north[i], band.wanted[i])
    _widen(band.along, reference, max_slope)
    for i in range(reference.size):
        if not math.isnan(reference[i]):
            reference[i] = max(band.lowest[i], min(band.highest[i], reference[i]))
    return _chords(band, reference, tolerance)


@allocating_kernel
def shortest_profile(
    surface: Surface,
    polyline: NDArray[np.float64],
    ups: tuple[float, float],
    low: float,
    high: float,
    max_slope: float,
    slack: float,
    spacing: float,
    beside: float,
    above: float,
) -> NDArray[np.float64]:
    """Draw a polyline tight between the ends of a band above ground: the least climb, by few waypoints.

    The tight string between two bounds has the least length, and of all lines between them the least of every cost that is
    convex in the slope, as time and energy of a leg are. Chords between its points replace it where the band has room for them.

    Args:
        surface: the ground.
        polyline: (n, 2) east, north in metres, n >= 2.
        ups: up coordinates wanted at both ends; the first is raised, the last moved, into the band.
        low: lowest height above ground, metres.
        high: largest height above ground, metres; where both limits cannot be kept, the lower wins.
        max_slope: tangent of the steepest climb.
        slack: room for chords that the string leaves at both ends of the band where it can, metres.
        spacing: largest distance between samples, metres.
        beside: clearance beside obstacles, metres.
        above: clearance above their tops, metres.

    Returns:
        (m, 3) east, north, up. Ground without data is not in its way.
    """
    band = _band(surface, polyline, np.zeros(polyline.shape[0]), low, high, max_slope, spacing, beside, above)
    along, end = band.along, band.along.size - 1
    first, last = ups
    first = max(first, band.lowest[0])
    reach = max_slope * along[end]
    last = max(min(last, band.highest[end]), band.lowest[end])
    first = max(first, min(last - reach, band.highest[0]))
    last = max(min(last, first + reach), first - reach)
    lower, upper = np.empty(along.size), np.empty(along.size)
    for i in range(along.size):
        from_first, from_last = max_slope * (along[i] - along[0]), max_slope * (along[end] - along[i])
        lowest = band.lowest[i]
        highest = max(lowest, band.highest[i], first - from_first)
        middle = 0.5 * (lowest + highest)
        # Rounding must not separate the points of a straight line.
        band.lowest[i], band.highest[i] = lowest - _ROUNDING_M, highest + _ROUNDING_M
        lower[i] = max(lowest, min(lowest + slack, middle, first + from_first, last + from_last))
        upper[i] = min(highest, max(highest - slack, middle, first - from_first, last - from_last))
    lower[end] = upper[end] = last
    return _chords(band, _tight(along, lower, upper, first), math.inf)


@allocating_kernel
def _tight(
    along: NDArray[np.float64], lower: NDArray[np.float64], upper: NDArray[np.float64], first: float
) -> NDArray[np.float64]:
    """(n,) heights of the shortest line from ``first`` between two (n,) bounds, which meet at the end; NaN bounds nothing."""
    line = np.full(along.size, first)
    at = 0
    while at < along.size - 1:
        # Slopes from here that pass between the bounds so far; the line bends where the one that ends them is reached.
        shallowest, steepest = -math.inf, math.inf
        low_at = high_at = bend = at
        height = line[at]
        for j in range(at + 1, along.size):
            run = along[j] - along[at]
            if run <= 0.0:
                continue
            least, most = (lower[j] - height) / run, (upper[j] - height) / run
            if least > steepest:
                bend, height = high_at, upper[high_at]
                break
            if most < shallowest:
                bend, height = low_at, lower[low_at]
                break
            if least >= shallowest:
                shallowest, low_at = least, j
            if most <= steepest:
                steepest, high_at = most, j
        if bend == at:
            bend, height = along.size - 1, lower[along.size - 1]
        for j in range(at + 1, bend + 1):
            run = along[bend] - along[at]
            line[j] = height if run <= 0.0 else line[at] + (along[j] - along[at]) / run * (height - line[at])
        at = bend
    return line


class _Band(NamedTuple):
    """(n,) samples of a polyline, and the band above the ground there that no slope is too steep for."""

    along: NDArray[np.float64]
    east: NDArray[np.float64]
    north: NDArray[np.float64]
    wanted: NDArray[np.float64]
    lowest: NDArray[np.float64]
    highest: NDArray[np.float64]
    corner: NDArray[np.bool_]


@allocating_kernel
def _band(
    surface: Surface,
    polyline: NDArray[np.float64],
    wanted: NDArray[np.float64],
    low: float,
    high: float,
    max_slope: float,
    spacing: float,
    beside: float,
    above: float,
) -> _Band:
    """Samples of an (n, 2) polyline, with the heights above ground wanted there and the band; as of follow_terrain()."""
    count = _sample_count(polyline, spacing)
    along = np.empty(count)
    east = np.empty(count)
    north = np.empty(count)
    agl = np.empty(count)
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
            agl[k] = wanted[i] + t * (wanted[i + 1] - wanted[i])
            lowest[k] = up_above(surface, east[k], north[k], low)
            highest[k] = up_above(surface, east[k], north[k], high)
        corner[k] = True
    corner[0] = True
    _narrow(surface, east, north, lowest, low, highest, high)
    for i in range(count):
        # Both samples around a place that is near an obstacle are as high as it asks for, and so is the chord between.
        lowest[i] = max(lowest[i], top_within_m(surface.obstacles, east[i], north[i], beside + spacing) + above)
    _widen(along, lowest, max_slope)
    for i in range(count):
        highest[i] = -highest[i]
    _widen(along, highest, max_slope)
    for i in range(count):
        highest[i] = -highest[i]
    return _Band(along, east, north, agl, lowest, highest, corner)


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
    """Narrow the band in place, at both samples, by the excess of the straight line between its ends.

    Args:
        surface: the ground.
        east: (n,) of the samples.
        north: (n,) of the samples.
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
def _chords(band: _Band, reference: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Fewest straight chords between points of the reference, greedily: each as long as the samples beneath it allow."""
    along, lowest, highest, corner = band.along, band.lowest, band.highest, band.corner
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
            out[k, 0], out[k, 1], out[k, 2] = band.east[i], band.north[i], reference[i]
            k += 1
    return out
