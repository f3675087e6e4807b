"""How fast the vehicle was, and how far from the planned route."""

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.polyline import distances_to_polyline
from uavcover.model.track import Track
from uavcover.model.vehicle import Vehicle
from uavcover.verification.phases import PlannedRoute, observed_stretches

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SPEED_WINDOW_S = 1.0
"""Speed is the way over ground flown in a second: between two samples alone the rounding of a log's times counts too much."""

_SUSTAINED_S = 5.0
_UNDER_WAY = 0.5
"""Above this share of the cruise speed a vehicle is under way, not turning or landing."""
_TOO_SLOW = 0.4


def ground_speeds_m_s(track: Track, enu_m: FloatArray, joined: BoolArray) -> FloatArray:
    """(n,) speed over ground around each sample: the way flown in the second around it, over that time.

    At the ends of what was observed the window is the part of that second that was; NaN where nothing is left of it.
    """
    speeds = np.full(len(track), np.nan)
    for run in observed_stretches(np.ones(len(track), dtype=bool), joined):
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


def commanded_pace_doubt(
    track: Track, enu_m: FloatArray, joined: BoolArray, vehicle: Vehicle, planned: PlannedRoute | None
) -> str | None:
    """Why the pace of a track cannot be that of its mission, for people; none when it can.

    Ways of 5 s are looked at. A vehicle that is sustained faster than its mission commands has a wrong clock, wrong positions,
    or was flown otherwise; likewise one that never comes near the commanded speed though a leg is long enough for it.
    """
    time = track.time_s
    last = np.searchsorted(time, time + _SUSTAINED_S)
    gaps = np.concatenate([[0], np.cumsum(~joined)])
    first = np.flatnonzero(last < len(time))
    first = first[gaps[last[first]] == gaps[first]]
    if first.size == 0:
        return None
    seconds = time[last[first]] - time[first]
    way = enu_m[last[first]] - enu_m[first]
    level, vertical = np.hypot(way[:, 0], way[:, 1]) / seconds, way[:, 2] / seconds
    under_way = level > _UNDER_WAY * vehicle.cruise_speed_m_s
    cruise = vehicle.cruise_speed_m_s
    tell = "; the clock or the positions are scaled, or it was flown otherwise than planned"
    for what, sustained, wanted, most in (
        (
            "flies",
            float(np.percentile(level[under_way], 95.0)) if under_way.any() else 0.0,
            cruise,
            1.25 * cruise + 2.0,
        ),
        ("climbs", float(vertical.max()), vehicle.max_climb_m_s, 1.25 * vehicle.max_climb_m_s + 1.0),
        ("descends", float(-vertical.min()), vehicle.max_descent_m_s, 1.25 * vehicle.max_descent_m_s + 1.0),
    ):
        if sustained > most:
            return f"the vehicle {what} at {sustained:.1f} m/s for seconds, where {wanted:g} m/s are planned{tell}"
    if planned is None or len(planned.waypoints_m) < 2:
        return None
    legs = np.diff(planned.waypoints_m, axis=0)
    ways = np.hypot(legs[:, 0], legs[:, 1])
    steep = np.maximum(legs[:, 2] / vehicle.max_climb_m_s, -legs[:, 2] / vehicle.max_descent_m_s)
    pace = ways / np.maximum(np.maximum(ways / cruise, steep), 1e-9)
    long_enough = ways >= 2.0 * _SUSTAINED_S * cruise
    if not long_enough.any():
        return None
    expected, fastest = float(pace[long_enough].max()), float(level.max())
    if fastest < _TOO_SLOW * expected:
        return f"the vehicle never flies faster than {fastest:.1f} m/s, where {expected:.1f} m/s are planned{tell}"
    return None
