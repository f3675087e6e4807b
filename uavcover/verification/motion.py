"""How fast the vehicle was, and how far from the planned route."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.polyline import distances_to_polyline
from uavcover.model.track import Track
from uavcover.verification.phases import PlannedRoute, observed_stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SPEED_WINDOW_S = 1.0
"""Speed is the way over ground flown in a second: between two samples alone the rounding of a log's times counts too much."""


def ground_speeds_m_s(track: Track, enu_m: FloatArray, *, max_gap_s: float) -> FloatArray:
    """(n,) speed over ground around each sample: the way flown in the second around it, over that time.

    At the ends of what was observed the window is the part of that second that was; NaN where nothing is left of it.
    """
    speeds = np.full(len(track), np.nan)
    for run in observed_stretches(track, np.ones(len(track), dtype=bool), max_gap_s=max_gap_s):
        if len(run) < 2:
            continue
        time = track.time_s[run]
        legs = np.hypot(*np.diff(enu_m[run, :2], axis=0).T)
        flown = np.concatenate([[0.0], np.cumsum(legs)])
        begin = np.maximum(time - 0.5 * SPEED_WINDOW_S, time[0])
        end = np.minimum(time + 0.5 * SPEED_WINDOW_S, time[-1])
        speeds[run] = (np.interp(end, time, flown) - np.interp(begin, time, flown)) / (end - begin)
    return speeds


def deviations_m(enu_m: FloatArray, route: BoolArray, planned: PlannedRoute | None) -> FloatArray | None:
    """(n,) distance of each sample on the route from the planned route, NaN elsewhere; none without a plan or a route."""
    if planned is None or len(planned.waypoints_m) == 0 or not route.any():
        return None
    distances = np.full(len(enu_m), np.nan)
    distances[route] = distances_to_polyline(
        np.ascontiguousarray(enu_m[route]), np.ascontiguousarray(planned.waypoints_m)
    )
    return distances
