"""Swath of a moving sensor, and lines bent so that their swaths share the ground evenly."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import allocating_kernel, kernel
from uavcover.kernels.sight import CONE, Sight, horizontal_reach
from uavcover.kernels.surface import Surface, height, up_above

_STEPS = 32
_DAMPING = 0.7
_STEEPEST_GROWTH2 = 0.75
"""Upper limit of the widening factor, for paths that climb nearly as fast as the cone widens."""


@kernel
def side_reach(
    surface: Surface, sight: Sight, east: float, north: float, up: float, ce: float, cn: float, slope: float
) -> float:
    """Distance to the side, without gaps, that a moving ball or cone observes; metres on the map.

    What moves uphill or downhill observes farther beside it from a little farther up: a cone is 1 / sqrt(1 - tan^2 slope^2) as
    wide, a ball has only the distance to its path to overcome. The first place that is out of view is looked for in steps of a
    thirty-second of the reach, then where the sensor's edge crosses the ground between two steps, both taken as straight.
    Nothing hides anything.

    Args:
        surface: the ground.
        sight: a ball or a cone.
        east: of the place.
        north: of the place.
        up: of the place.
        ce: east of a unit vector on the map, at right angles to the way.
        cn: north of it.
        slope: tangent of the way's climb; 0 for a sensor that hangs there.
    """
    step = horizontal_reach(sight) / _STEPS
    growth2 = min((sight.tan_half_fov * slope) ** 2, _STEEPEST_GROWTH2)
    tan = sight.tan_half_fov / math.sqrt(1.0 - growth2)
    nearer = 1.0 / math.sqrt(1.0 + slope * slope)
    before = 1.0
    for k in range(1, _STEPS + 1):
        away = k * step
        drop = up - height(surface, east + away * ce, north + away * cn)
        # Positive in view, rising with the distance to the sensor's edge.
        inside = sight.reach_m - math.sqrt(away * away + drop * drop * nearer * nearer)
        if sight.kind == CONE:
            inside = min(inside, drop * tan - away)
        if not inside > 0.0:
            if k == 1 or math.isnan(inside):
                return away - step
            return away - step + step * before / (before - inside)
        before = inside
    return horizontal_reach(sight)


@allocating_kernel
def balance_lines(
    surface: Surface,
    sight: Sight,
    angle: float,
    along: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    heights: NDArray[np.float64],
    across: NDArray[np.float64],
    there: NDArray[np.bool_],
    rounds: int,
    smoothing: int,
) -> NDArray[np.float64]:
    """Bend lines until the gaps or overlaps between their strips are equal at every station.

    Each round measures what every line observes to both sides, finds the places at which all gaps would be the same, moves the
    lines most of the way there and smooths them.

    Args:
        surface: the ground.
        sight: a ball or a cone.
        angle: direction of the lines, radians, counter-clockwise from east.
        along: (s,) stations along that direction, metres from the origin.
        low: (s,) where the area begins at each station, metres across.
        high: (s,) where it ends.
        heights: (n,) height above ground of each line.
        across: (n, s) where the lines are, rising with n.
        there: (n, s) whether a line passes a station; others are left where they are.
        rounds: how often.
        smoothing: how often a round replaces a place by half of itself and a quarter of each neighbour along the line.

    Returns:
        (n, s) where the lines should be.
    """
    lines, stations = across.shape
    c, s = math.cos(angle), math.sin(angle)
    out = across.copy()
    below, above = np.zeros(lines), np.zeros(lines)
    for _ in range(rounds):
        for i in range(stations):
            wide, count = 0.0, 0
            for k in range(lines):
                if there[k, i]:
                    east, north = along[i] * c - out[k, i] * s, along[i] * s + out[k, i] * c
                    up = up_above(surface, east, north, heights[k])
                    slope = _slope_along(surface, along, out[k], i, c, s)
                    below[k] = side_reach(surface, sight, east, north, up, s, -c, slope)
                    above[k] = side_reach(surface, sight, east, north, up, -s, c, slope)
                    wide += below[k] + above[k]
                    count += 1
            gap = (high[i] - low[i] - wide) / (count + 1)
            edge = low[i]
            for k in range(lines):
                if there[k, i]:
                    out[k, i] += _DAMPING * (edge + gap + below[k] - out[k, i])
                    edge += gap + below[k] + above[k]
        for _ in range(smoothing):
            for k in range(lines):
                before = out[k, 0]
                for i in range(1, stations - 1):
                    here = out[k, i]
                    if there[k, i - 1] and there[k, i] and there[k, i + 1]:
                        out[k, i] = 0.25 * (before + out[k, i + 1]) + 0.5 * here
                    before = here
    return out


@kernel
def _slope_along(
    surface: Surface, along: NDArray[np.float64], line: NDArray[np.float64], i: int, c: float, s: float
) -> float:
    """Tangent of the ground's climb along a line, between the stations beside station i."""
    first, last = max(i - 1, 0), min(i + 1, along.size - 1)
    rise = height(surface, along[last] * c - line[last] * s, along[last] * s + line[last] * c) - height(
        surface, along[first] * c - line[first] * s, along[first] * s + line[first] * c
    )
    slope = rise / (along[last] - along[first])
    return slope if math.isfinite(slope) else 0.0
