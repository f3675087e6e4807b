"""Assembles one track from the positions and attitudes of a log, each with its own times."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uavcover.errors import TrackError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import ReadTrack, Track
from uavcover.scenario.frames import LocalFrame

MAX_ATTITUDE_GAP_S = 1.0
"""Largest time between the two rows around a position from which its attitude is interpolated."""


@dataclass(frozen=True, slots=True, eq=False)
class LoggedRows:
    """Positions and attitudes of a log.

    Attributes:
        positions: (n, 4) time in seconds, latitude and longitude in degrees, height above sea level in metres.
        attitudes: (k, 4) time in seconds, roll, pitch and yaw in degrees; may be empty.
        warnings: what was dropped or assumed so far.
    """

    positions: FloatArray
    attitudes: FloatArray
    warnings: tuple[str, ...] = ()


def assemble_track(path: Path, rows: LoggedRows, frame: LocalFrame) -> ReadTrack:
    """Make one sample for each position, with its attitude interpolated, or NaN where no rows are near.

    Positions at latitude and longitude 0 (no fix yet) and repeated times are dropped, with a warning. Such a log does not
    know the plan's waypoints: ``current_waypoint`` is -1 throughout.

    Raises:
        TrackError: no position, one that is not a place on Earth, or time that goes back.
    """
    warnings = list(rows.warnings)
    positions = rows.positions.reshape(-1, 4)
    has_fix = (positions[:, 1] != 0.0) | (positions[:, 2] != 0.0)
    if not has_fix.all():
        warnings.append(f"{path}: {int((~has_fix).sum())} positions before the first fix (0, 0) are left out")
        positions = positions[has_fix]
    if len(positions) == 0:
        raise TrackError(f"{path}: there are no positions in it")
    # The largest time so far: any row not later than that repeats or goes back.
    before = np.concatenate([[-np.inf], np.maximum.accumulate(positions[:, 0])[:-1]])
    back = positions[:, 0] < before
    if back.any():
        at = int(np.argmax(back))
        raise TrackError(
            f"{path}: time goes back from {before[at]:.3f} s to {positions[at, 0]:.3f} s at position {at}: the vehicle was "
            "restarted, or two logs were joined; give one flight"
        )
    repeated = positions[:, 0] == before
    if repeated.any():
        warnings.append(f"{path}: {int(repeated.sum())} positions at a time that was there already are left out")
        positions = positions[~repeated]
    bad = ~(np.isfinite(positions).all(axis=1) & (np.abs(positions[:, 1]) <= 90.0) & (np.abs(positions[:, 2]) <= 180.0))
    if bad.any():
        at = int(np.argmax(bad))
        raise TrackError(
            f"{path}: position {at}, at {positions[at, 0]:.3f} s: {positions[at, 1]}, {positions[at, 2]}, "
            f"{positions[at, 3]} m is not a place on Earth"
        )
    attitude = _attitudes_at(positions[:, 0], rows.attitudes.reshape(-1, 4))
    unknown = int(np.isnan(attitude[:, 0]).sum())
    if unknown:
        warnings.append(
            f"{path}: {unknown} of {len(positions)} positions have no attitude; what a fixed camera saw from there is not known"
        )
    return ReadTrack(
        Track(
            time_s=positions[:, 0].copy(),
            geodetic=positions[:, 1:].copy(),
            enu_m=frame.enu_from_geodetic(*positions[:, 1:].T),
            attitude_deg=attitude,
            current_waypoint=np.full(len(positions), -1, dtype=np.int64),
        ),
        tuple(warnings),
    )


def _attitudes_at(time_s: FloatArray, attitudes: FloatArray) -> FloatArray:
    """(n, 3) roll, pitch, yaw at (n,) times; yaw 0..360."""
    out = np.full((len(time_s), 3), np.nan)
    known = attitudes[np.isfinite(attitudes).all(axis=1)]
    known = known[np.argsort(known[:, 0], kind="stable")]
    if len(known) == 0:
        return out
    after = np.searchsorted(known[:, 0], time_s)
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, len(known) - 1)
    # At the ends of the log the same row serves as the one before and the one after.
    gap = np.where(before == after, np.abs(known[after, 0] - time_s), known[after, 0] - known[before, 0])
    off_end = np.maximum(known[0, 0] - time_s, time_s - known[-1, 0])
    near = np.maximum(np.where(off_end > 0.0, 0.0, gap), off_end) <= MAX_ATTITUDE_GAP_S
    turned = np.unwrap(known[:, 1:], axis=0, period=360.0)
    for axis in range(3):
        out[near, axis] = np.interp(time_s[near], known[:, 0], turned[:, axis])
    out[near, 0] = (out[near, 0] + 180.0) % 360.0 - 180.0
    out[near, 2] %= 360.0
    return out
