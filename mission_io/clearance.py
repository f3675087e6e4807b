"""How high a leg is above the ground at its full length: bounded where the ground's slope is, sampled where not."""

import math
from dataclasses import dataclass

import numpy as np

from mission_io.errors import MisuseError
from mission_io.legs import Leg
from mission_io.surface import FloatArray, Surface, steepest_slope_of

_MOST_SAMPLES = 2_000_000
_UNEVEN = 1.01
"""A fraction of the great circle is, on the ellipsoid, up to 0.7 % more of the way in one place than in another."""


@dataclass(frozen=True, slots=True)
class HeightsAlong:
    """The lowest and the highest point of a leg above the ground.

    Attributes:
        lowest_agl_m: The lowest height that was found.
        lowest_at: Where, as a fraction of the leg.
        highest_agl_m: The highest height that was found.
        highest_at: Where.
        error_m: The true lowest point is at most this much lower, and the true highest this much higher. None when the
            surface does not bound its slope: then nothing is known of the ground between two samples.
        unknown_at: Where the first sample without a known ground is, as a fraction; None when all are known. The
            heights are those of the known ground, NaN when there is none.
    """

    lowest_agl_m: float
    lowest_at: float
    highest_agl_m: float
    highest_at: float
    error_m: float | None
    unknown_at: float | None


def heights_along(leg: Leg, surface: Surface, *, step_m: float = 10.0, tolerance_m: float = 0.1) -> HeightsAlong:
    """The extreme heights of a leg above the ground.

    Samples are ``step_m`` apart. With a bounded surface (``BoundedSurface``) the height cannot change faster along the
    leg than the steepest slope and the leg's own together (a Lipschitz constant), so each stretch between two samples
    has a lowest and a highest possible height; the stretches that could hold a new extreme are halved until none could
    change the answer by more than ``tolerance_m``. A leg that follows terrain has the heights that it was given.

    Raises:
        MisuseError: a step or tolerance that is not above 0, or a leg of more than two million steps.
    """
    if not (step_m > 0.0 and tolerance_m > 0.0):
        raise MisuseError(f"step_m {step_m} and tolerance_m {tolerance_m} have to be above 0")
    length_m = leg.ground_m
    if length_m / step_m > _MOST_SAMPLES:
        raise MisuseError(
            f"item {leg.item}: a leg of {length_m / 1000.0:.0f} km in steps of {step_m} m; take longer ones"
        )
    t = np.linspace(0.0, 1.0, max(2, math.ceil(length_m / step_m) + 1))
    heights = _heights_agl_m(leg, surface, t)
    error_m: float | None = None
    slope = steepest_slope_of(surface)
    if leg.follows_terrain or length_m == 0.0:
        error_m = 0.0
    elif slope is not None and not np.isnan(heights).any():
        steepest_m = _UNEVEN * slope * length_m + abs(leg.climb_m)
        t, heights, error_m = _refined(leg, surface, t, heights, steepest_m, tolerance_m)
    unknown = np.isnan(heights)
    unknown_at = float(t[np.argmax(unknown)]) if unknown.any() else None
    if unknown.all():
        return HeightsAlong(math.nan, 0.0, math.nan, 0.0, None, unknown_at)
    lowest, highest = int(np.nanargmin(heights)), int(np.nanargmax(heights))
    return HeightsAlong(
        float(heights[lowest]), float(t[lowest]), float(heights[highest]), float(t[highest]), error_m, unknown_at
    )


def _heights_agl_m(leg: Leg, surface: Surface, t: FloatArray) -> FloatArray:
    lat_deg, lon_deg = leg.places(t)
    ground_m = np.asarray(surface.heights_amsl_m(lat_deg, lon_deg), dtype=np.float64)
    if leg.follows_terrain:
        even = leg.start_height_agl_m + t * (leg.end_height_agl_m - leg.start_height_agl_m)
        return np.where(np.isnan(ground_m), np.nan, even)
    return leg.altitudes_amsl_m(t) - ground_m


def _refined(
    leg: Leg, surface: Surface, t: FloatArray, heights: FloatArray, steepest_m: float, tolerance_m: float
) -> tuple[FloatArray, FloatArray, float | None]:
    """More samples where an extreme may hide (Piyavskii's method), and how far off the extremes may still be.

    ``steepest_m`` is how much the height can change over the whole leg at most. A hole in the ground that is smaller than
    a step ends the search, with its samples and without a bound.
    """
    while True:
        half_change_m = 0.5 * steepest_m * np.diff(t)
        middle_m = 0.5 * (heights[:-1] + heights[1:])
        lower = float(heights.min()) - (middle_m - half_change_m)
        higher = (middle_m + half_change_m) - float(heights.max())
        missed_m = np.maximum(lower, higher)
        error_m = max(0.0, float(missed_m.max()))
        open_stretches = np.flatnonzero(missed_m > tolerance_m)
        if not open_stretches.size or t.size + open_stretches.size > _MOST_SAMPLES:
            return t, heights, error_m
        new_t = 0.5 * (t[open_stretches] + t[open_stretches + 1])
        new_heights = _heights_agl_m(leg, surface, new_t)
        t = np.insert(t, open_stretches + 1, new_t)
        heights = np.insert(heights, open_stretches + 1, new_heights)
        if np.isnan(new_heights).any():
            return t, heights, None
