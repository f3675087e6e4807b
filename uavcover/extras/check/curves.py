"""The shapes that a flown path is made of, as points (n, 3) of east, north and height; the height's reference is the caller's."""

import math

import numpy as np

from uavcover.kernels.arrays import FloatArray

SPLINE_FACTOR = 4.0
"""Of ArduPilot: the vectors at both ends of a spline are together at most this many times its chord."""


def straight(begin_m: FloatArray, end_m: FloatArray, *, step_m: float) -> FloatArray:
    """Points on a straight line, ``step_m`` apart or nearer, both ends included."""
    pieces = max(1, math.ceil(math.hypot(*(end_m - begin_m)[:2]) / step_m))
    return np.asarray(begin_m + np.linspace(0.0, 1.0, pieces + 1)[:, None] * (end_m - begin_m))


def spline(
    begin_m: FloatArray, end_m: FloatArray, begin_vector_m: FloatArray, end_vector_m: FloatArray, *, step_m: float
) -> FloatArray:
    """Points on the curve that ArduPilot flies to a spline waypoint: a cubic Hermite polynomial.

    Source: ArduPilot, libraries/AP_Math/SplineCurve.cpp, set_origin_and_destination and update_solution: the two vectors are
    scaled down together where their lengths sum to more than ``SPLINE_FACTOR`` chords.
    """
    chord_m = float(np.linalg.norm(end_m - begin_m))
    if chord_m == 0.0:
        return np.array([begin_m, end_m])
    vectors_m = float(np.linalg.norm(begin_vector_m) + np.linalg.norm(end_vector_m))
    scale = min(1.0, SPLINE_FACTOR * chord_m / vectors_m) if vectors_m > 0.0 else 1.0
    v0, v1 = begin_vector_m * scale, end_vector_m * scale
    longest_m = chord_m + float(np.linalg.norm(v0) + np.linalg.norm(v1))  # no shorter than the curve
    t = np.linspace(0.0, 1.0, max(8, math.ceil(longest_m / step_m)) + 1)[:, None]
    square = -3.0 * begin_m - 2.0 * v0 + 3.0 * end_m - v1
    cube = 2.0 * begin_m + v0 - 2.0 * end_m + v1
    return np.asarray(begin_m + v0 * t + square * t**2 + cube * t**3)


def circle(
    center_m: FloatArray, radius_m: float, begin_m: FloatArray, *, turns: float, end_height_m: float, clockwise: bool
) -> FloatArray:
    """Points on a circle from ``begin_m``, outside by no more than 0.1 % of the radius, the height changing evenly.

    Args:
        center_m: (3,) or (2,) its centre.
        radius_m: its radius.
        begin_m: (3,) a place; the circle begins nearest to it, at its height.
        turns: how often.
        end_height_m: height at the end.
        clockwise: seen from above.
    """
    away = begin_m[:2] - center_m[:2]
    first = math.atan2(away[0], away[1]) if np.hypot(*away) > 0.0 else 0.0  # from north, clockwise
    sweep = 2.0 * math.pi * turns * (1.0 if clockwise else -1.0)
    corners = max(2, math.ceil(72 * turns) + 1)
    angles = first + np.linspace(0.0, sweep, corners)
    reach = radius_m * 1.0004  # chords of five degrees come nowhere nearer than the radius less half a thousandth
    heights = np.linspace(begin_m[2], end_height_m, corners)
    return np.column_stack([center_m[0] + reach * np.sin(angles), center_m[1] + reach * np.cos(angles), heights])
