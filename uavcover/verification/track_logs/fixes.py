"""Satellite fixes that a log's receivers report, and whether they confirm the positions of its estimator."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mission_io.model.items import MEAN_RADIUS_M
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.verification.track_logs.logged_rows import LOGS


def fixes_at(time_s: FloatArray, fixes: FloatArray) -> FloatArray:
    """(n,) the latest of (f, 2) reports of a fix at each of (n,) times; NaN where it is old, or there is none.

    There is no fix after a report of none, and where a receiver falls silent that had reported at a steady rate.
    """
    before = np.searchsorted(fixes[:, 0], time_s, side="right")
    known = np.vstack([[-np.inf, np.nan], fixes])[before]
    age_s, old_s = time_s - known[:, 0], np.inf
    if len(fixes) >= LOGS.steady_reports:
        old_s = max(LOGS.max_fix_age_s, 3.0 * float(np.median(np.diff(fixes[:, 0]))))
    lost = (known[:, 1] == 0.0) | ((age_s > old_s) & np.isfinite(age_s))
    return np.where(lost, 0.0, np.where(age_s <= LOGS.max_fix_age_s, known[:, 1], np.nan))


def confirmed(reports: ArrayLike, positions: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """(f, 2) time, and whether any receiver has a fix at the position of the log; and a warning where none has.

    Args:
        reports: (f, 5) time, number of the receiver, whether it has a fix in space, latitude and longitude.
        positions: (n, 4) time, latitude, longitude and height of the log.
    """
    rows = np.asarray(reports, float).reshape(-1, 5)
    has_fix = rows[:, 2] != 0.0
    off_m = _off_m(rows, positions)
    elsewhere = has_fix & (off_m > LOGS.receiver_error_m)
    latest: dict[float, float] = {}
    fixes = np.column_stack([rows[:, 0], np.zeros(len(rows))])
    for k, (time_s, receiver) in enumerate(rows[:, :2]):
        latest[receiver] = time_s if has_fix[k] and not elsewhere[k] else -math.inf
        fixes[k, 1] = time_s - max(latest.values()) <= LOGS.max_fix_age_s
    alone: BoolArray = elsewhere & (fixes[:, 1] == 0.0)
    if not alone.any():
        return fixes, ()
    return fixes, (
        f"{int(alone.sum())} of {len(rows)} receiver fixes are more than {LOGS.receiver_error_m:g} m from the position of the "
        f"estimator (up to {off_m[alone].max():.0f} m); the position there counts as one without a fix",
    )


def _off_m(rows: FloatArray, positions: FloatArray) -> FloatArray:
    """(f,) horizontal distance of receiver reports from the path about then; NaN where either is unknown, or samples are rare."""
    times = positions[:, 0]
    off_m = np.full(len(rows), np.nan)
    after = np.clip(np.searchsorted(times, rows[:, 0]), 1, max(len(times) - 1, 1))
    if len(times) < 2:
        return off_m
    near = (rows[:, 0] >= times[0]) & (rows[:, 0] <= times[-1]) & (rows[:, 3:] != 0.0).any(axis=1)
    near &= times[after] - times[after - 1] <= LOGS.max_attitude_gap_s
    lat, lon = np.radians(rows[near, 3]), np.radians(rows[near, 4])
    least = np.full(len(lat), np.inf)
    for shift_s in np.linspace(-LOGS.receiver_late_s, LOGS.receiver_early_s, 16):
        at = rows[near, 0] + shift_s
        north = np.radians(np.interp(at, times, positions[:, 1])) - lat
        east = (np.radians(np.interp(at, times, positions[:, 2])) - lon) * np.cos(lat)
        least = np.fmin(least, MEAN_RADIUS_M * np.hypot(north, east))
    off_m[near] = least
    return off_m


def receiver_rows(topic: dict[str, Any]) -> FloatArray | None:
    """(n, 4) time, latitude, longitude and height above sea level of a receiver in a ULog; None without them."""
    # 1e-7 degrees and millimetres until PX4 1.14, degrees and metres since.
    for keys, (degrees, metres) in (
        (("latitude_deg", "longitude_deg", "altitude_msl_m"), (1.0, 1.0)),
        (("lat", "lon", "alt"), (1e-7, 1e-3)),
    ):
        if set(keys) <= set(topic):
            lat, lon, alt = (np.asarray(topic[key], float) for key in keys)
            return np.column_stack([np.asarray(topic["timestamp"]) * 1e-6, degrees * lat, degrees * lon, metres * alt])
    return None
