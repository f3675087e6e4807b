"""Assembles one track from the positions and attitudes of a log, each with its own times."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.plain_text import counted
from uavcover.errors import TrackError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.model.active_times import is_flight_time
from uavcover.model.track import VELOCITY_COLUMNS, ReadTrack, Track
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class _Clock:
    disagrees_s: float
    jump_s: float
    clock_step_s: float
    clocks_compared_s: float
    alike_s: float
    window_s: float
    head_bytes: int
    unreleased_versions: int


CLOCK = data_table(_Clock, "uavcover/data/verification.toml", "clock")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Logs:
    picture_place_error_m: float
    picture_time_error_s: float
    clock_spread_s: float
    most_lean_cos: float
    max_attitude_gap_s: float
    max_velocity_gap_s: float


LOGS = data_table(_Logs, "uavcover/data/verification.toml", "logs")


@dataclass(frozen=True, slots=True, eq=False)
class LoggedRows:
    """Positions and attitudes of a log."""

    positions: FloatArray  # (n, 4) time in seconds, latitude and longitude in degrees, height above sea level in metres
    attitudes: FloatArray  # (k, 4) time in seconds, roll, pitch and yaw in degrees; may be empty
    # (p, 3) time in seconds, latitude and longitude in degrees of every photo that was taken, NaN or 0 where its
    # position is not reported; none in a log without camera messages
    pictures: FloatArray | None = None
    warnings: tuple[str, ...] = ()  # what was dropped or assumed so far
    # (c, 2) times in seconds and the same moments in seconds since 1970 (UTC), where the log tells them
    clock: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    # (r, 2) time in seconds and distance in metres of every valid reading of a rangefinder that looks down
    ranges: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    # (s, 3) latitude, longitude and height above sea level of the ground in the vehicle's own terrain data
    stored: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    # (p,) number of photos before each photo that the camera counted and whose message is missing; empty: none
    lost: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    # (v, 4) time in seconds, reported velocity over ground north, east and down in m/s; empty: not reported
    velocities: FloatArray = field(default_factory=lambda: np.empty((0, 4)))


def assemble_track(path: Path, rows: LoggedRows, frame: LocalFrame) -> ReadTrack:
    """Make one sample for each position, with its attitude interpolated, or NaN where no rows are near.

    Positions at latitude and longitude 0 (no fix yet) and repeated times are dropped, with a warning. Such a log does not
    know the plan's waypoints: ``current_waypoint`` is -1 throughout.

    Raises:
        TrackError: no position, one that is not a position on Earth, or time that goes back.
    """
    warnings = list(rows.warnings)
    positions = rows.positions.reshape(-1, 4)
    has_fix = (positions[:, 1] != 0.0) | (positions[:, 2] != 0.0)
    if not has_fix.all():
        before_fix = "(0, 0) before the first fix"
        early = counted(int((~has_fix).sum()), f"position {before_fix} was", f"positions {before_fix} were")
        warnings.append(f"{path}: {early} ignored")
        positions = positions[has_fix]
    if len(positions) == 0:
        raise TrackError(f"{path}: the log contains no positions")
    # The largest time so far: any row not later than that repeats or goes back.
    before = np.concatenate([[-np.inf], np.maximum.accumulate(positions[:, 0])[:-1]])
    back = positions[:, 0] < before
    if back.any():
        at = int(np.argmax(back))
        raise TrackError(
            f"{path}: time goes back from {before[at]:.3f} s to {positions[at, 0]:.3f} s at position {at}; the "
            "vehicle restarted, or two logs were joined; use the log of a single flight"
        )
    repeated = positions[:, 0] == before
    if repeated.any():
        again = counted(int(repeated.sum()), "position with a repeated time was", "positions with a repeated time were")
        warnings.append(f"{path}: {again} ignored")
        positions = positions[~repeated]
    bad = ~(np.isfinite(positions).all(axis=1) & (np.abs(positions[:, 1]) <= 90.0) & (np.abs(positions[:, 2]) <= 180.0))
    if bad.any():
        at = int(np.argmax(bad))
        raise TrackError(
            f"{path}: position {at}, at {positions[at, 0]:.3f} s: {positions[at, 1]}, {positions[at, 2]}, "
            f"{positions[at, 3]} m is not a position on Earth"
        )
    attitude = attitudes_at(positions[:, 0], rows.attitudes.reshape(-1, 4))
    unknown = int(np.isnan(attitude[:, 0]).sum())
    if unknown:
        warnings.append(
            f"{path}: {unknown} of {len(positions)} positions have no attitude, so a fixed camera's view is unknown"
        )
    velocity = _velocities_at(positions[:, 0], rows.velocities.reshape(-1, 4))
    pictures_taken = np.full(len(positions), np.nan)
    if rows.pictures is not None:
        pictures_taken, doubted = _pictures_taken(frame, positions, rows.pictures.reshape(-1, 3), rows.lost)
        warnings += [f"{path}: {words}" for words in doubted]
    return ReadTrack(
        Track(
            time_s=positions[:, 0].copy(),
            geodetic=positions[:, 1:].copy(),
            enu_m=frame.enu_from_geodetic(*positions[:, 1:].T),
            attitude_deg=attitude,
            current_waypoint=np.full(len(positions), -1, dtype=np.int64),
            pictures_taken=pictures_taken,
            unix_time_s=positions[:, 0] + _unix_offsets_s(rows.clock, positions[:, 0]),
            ranged=_ranged(frame, positions, rows.attitudes.reshape(-1, 4), rows.ranges.reshape(-1, 2)),
            stored=rows.stored.reshape(-1, 3).copy(),
            **dict(zip(VELOCITY_COLUMNS, velocity.T.copy(), strict=True)),
        ),
        tuple(warnings),
    )


def _ranged(frame: LocalFrame, positions: FloatArray, attitudes: FloatArray, ranges: FloatArray) -> FloatArray:
    """(r, 3) ground positions that a rangefinder hit along the vehicle's down axis, where position and attitude are known."""
    times = ranges[:, 0]
    after = np.clip(np.searchsorted(positions[:, 0], times), 1, max(len(positions) - 1, 1))
    if len(positions) < 2 or not len(ranges):
        return np.empty((0, 3))
    gaps = positions[after, 0] - positions[after - 1, 0]
    inside = (times >= positions[0, 0]) & (times <= positions[-1, 0]) & (gaps <= LOGS.max_attitude_gap_s)
    roll, pitch, yaw = np.radians(attitudes_at(times, attitudes)).T
    known = inside & np.isfinite(roll + pitch + yaw) & (np.cos(roll) * np.cos(pitch) > LOGS.most_lean_cos)
    if not known.any():
        return np.empty((0, 3))
    roll, pitch, yaw, times, distance = roll[known], pitch[known], yaw[known], times[known], ranges[known, 1]
    enu = frame.enu_from_geodetic(*positions[:, 1:].T)
    at = np.column_stack([np.interp(times, positions[:, 0], enu[:, axis]) for axis in range(3)])
    # The third column of the rotation from forward-right-down to north-east-down, yaw-pitch-roll order.
    north = np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw)
    east = np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw)
    at += distance[:, None] * np.column_stack([east, north, -np.cos(roll) * np.cos(pitch)])
    return np.column_stack(frame.geodetic_from_enu(at))


def _unix_offsets_s(clock: FloatArray, time_s: FloatArray) -> FloatArray:
    """(n,) offsets from the log's times to seconds since 1970.

    NaN where unknown, or drifting in the course of the log.

    A clock that jumps by hours is kept as it is: verification reports it.
    """
    plausible = clock[[is_flight_time(float(unix_s)) for _, unix_s in clock]] if len(clock) else clock
    offsets = plausible[:, 1] - plausible[:, 0]
    if offsets.size == 0:
        return np.full(len(time_s), np.nan)
    if np.abs(np.diff(offsets)).max(initial=0.0) > CLOCK.jump_s:
        return np.asarray(offsets[np.maximum(np.searchsorted(plausible[:, 0], time_s, side="right") - 1, 0)])
    if np.ptp(np.percentile(offsets, (5.0, 95.0))) > LOGS.clock_spread_s:
        return np.full(len(time_s), np.nan)
    return np.full(len(time_s), float(np.median(offsets)))


def _pictures_taken(
    frame: LocalFrame, positions: FloatArray, pictures: FloatArray, lost: IntArray
) -> tuple[FloatArray, list[str]]:
    """Photos taken up to each of (n, 4) positions, and which of (p, 3) photos the positions contradict.

    A photo that was taken when nothing was recorded, or that names a place where the vehicle was not, is no photo. Every
    photo has a row of its own, so of several between two positions one counts: what they would show is the same.
    """
    times, doubted = positions[:, 0], []
    inside = (pictures[:, 0] > times[0]) & (pictures[:, 0] <= times[-1])
    if not inside.all():
        doubted.append(
            f"{int((~inside).sum())} of {len(pictures)} photos were taken outside the time of the track; they do not "
            "count as evidence"
        )
    lost = lost[inside] if lost.size else np.zeros(int(inside.sum()), dtype=np.int64)
    pictures = pictures[inside]
    placed = np.isfinite(pictures[:, 1:]).all(axis=1) & (pictures[:, 1:] != 0.0).any(axis=1)
    enu = frame.enu_from_geodetic(*positions[:, 1:].T)
    heights = np.interp(pictures[placed, 0], times, positions[:, 3])
    reported_m = frame.enu_from_geodetic(pictures[placed, 1], pictures[placed, 2], heights)
    off_m = np.full(int(placed.sum()), np.inf)
    for shift_s in (-LOGS.picture_time_error_s, 0.0, LOGS.picture_time_error_s):
        flown = np.column_stack([np.interp(pictures[placed, 0] + shift_s, times, enu[:, axis]) for axis in range(2)])
        off_m = np.minimum(off_m, np.hypot(*(reported_m[:, :2] - flown).T))
    elsewhere = np.zeros(len(pictures), dtype=bool)
    elsewhere[placed] = ~(off_m <= LOGS.picture_place_error_m)
    if elsewhere.any():
        doubted.append(
            f"{int(elsewhere.sum())} of {len(pictures)} photos state a position far from the vehicle (up to "
            f"{float(off_m.max()):.0f} m away); they do not count as evidence"
        )
    at = np.searchsorted(times, pictures[~elsewhere, 0])
    taken = np.zeros(len(times))
    taken[np.unique(at)] = 1.0
    np.add.at(taken, at, lost[~elsewhere])
    return np.cumsum(taken), doubted


def attitudes_at(time_s: FloatArray, attitudes: FloatArray) -> FloatArray:
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
    near = np.maximum(np.where(off_end > 0.0, 0.0, gap), off_end) <= LOGS.max_attitude_gap_s
    turned = np.unwrap(known[:, 1:], axis=0, period=360.0)
    for axis in range(3):
        out[near, axis] = np.interp(time_s[near], known[:, 0], turned[:, axis])
    out[near, 0] = (out[near, 0] + 180.0) % 360.0 - 180.0
    out[near, 2] %= 360.0
    return out


def _velocities_at(time_s: FloatArray, velocities: FloatArray) -> FloatArray:
    """(n, 3) velocity north, east, down at (n,) times from (v, 4) rows.

    NaN without a near row, or if all are 0.

    Zeros throughout are what messages hold whose sender reports no velocity.
    """
    out = np.full((len(time_s), 3), np.nan)
    known = velocities[np.isfinite(velocities).all(axis=1)]
    if not known[:, 1:].any():
        return out
    known = known[np.argsort(known[:, 0], kind="stable")]
    after = np.minimum(np.searchsorted(known[:, 0], time_s), len(known) - 1)
    gap_s = known[after, 0] - known[np.maximum(after - 1, 0), 0]
    inside = (time_s > known[0, 0]) & (time_s < known[-1, 0]) & (gap_s <= LOGS.max_velocity_gap_s)
    near = inside | (known[after, 0] == time_s)
    out[near] = np.column_stack([np.interp(time_s[near], known[:, 0], known[:, axis]) for axis in (1, 2, 3)])
    return out
