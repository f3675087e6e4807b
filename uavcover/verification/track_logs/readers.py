"""Read logs of other software, chosen by file suffix: PX4's (by pyulog, an optional dependency), GPX, and those of MAVLink.

A format is a function and a row of ``READERS``. Our own ``.csv`` and ``.rrd`` are read by
:func:`uavcover.verification.run_logs.read_log`.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.plain_text import counted
from uavcover.errors import InputError, TrackError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.model.limits import is_flight_time
from uavcover.model.track import VELOCITY_COLUMNS, ReadTrack, Track
from uavcover.plugins import load, registered
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.track_logs.fixes import confirmed, fixes_at, receiver_rows
from uavcover.verification.track_logs.logged_rows import LOGS, LoggedRows, read_dataflash, read_gpx, read_telemetry

_Velocity = tuple[str, tuple[str, str, str], tuple[str, ...]]
_RECEIVERS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = (
    "vehicle_global_position", "vehicle_local_position", "vehicle_attitude",
    "camera_capture", "camera_trigger", "distance_sensor", *_RECEIVERS,
)  # fmt: skip
_VELOCITIES: tuple[_Velocity, ...] = (
    # In vehicle_global_position until PX4 1.11.
    ("vehicle_global_position", ("vel_n", "vel_e", "vel_d"), ()),
    ("vehicle_local_position", ("vx", "vy", "vz"), ("v_xy_valid", "v_z_valid")),
    *((name, ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), ("vel_ned_valid",)) for name in _RECEIVERS),
)
"""Topics with velocities in order of preference, with their fields and what has to be true for them to count."""
_LOOKS_DOWN = 25
_FIX_3D = 3

_MAGIC = b"ULog\x01\x12\x35"


def read_ulog(path: Path) -> LoggedRows:
    """Read positions, velocities, attitudes (vehicle_attitude) and photos (camera_capture, or camera_trigger).

    Positions are the estimator's (vehicle_global_position), otherwise the receiver's (vehicle_gps_position, sensor_gps).
    Velocities are those of the same source.

    Raises:
        TrackError: no such log, no positions, or pyulog is not installed.
    """
    if path.read_bytes()[: len(_MAGIC)] != _MAGIC:
        raise TrackError(f"{path}: this is not a PX4 ULog, because it does not start with the ULog signature")
    try:
        from pyulog import ULog
    except ImportError:
        raise TrackError(f"{path}: .ulg files require pyulog; install it with: pip install pyulog") from None
    try:
        log = ULog(str(path), message_name_filter_list=[*_TOPICS])
    except (ValueError, IndexError, KeyError, TypeError, struct.error, UnicodeDecodeError) as error:
        raise TrackError(f"{path}: the ULog is damaged ({type(error).__name__}: {error})") from error
    except Exception as error:  # pyulog raises bare Exceptions for wrong headers and flags
        raise TrackError(f"{path}: pyulog cannot read this ULog ({error})") from error
    datasets = {data.name: data.data for data in log.data_list if data.multi_id == 0}
    warnings = [f"{path}: parts of the log are damaged and were ignored"] if log.file_corruption else []
    position = datasets.get("vehicle_global_position")
    if position:
        positions = np.column_stack([position["timestamp"] * 1e-6, position["lat"], position["lon"], position["alt"]])
    else:
        positions = _received(path, datasets)
        warnings.append(f"{path}: the log has no vehicle_global_position messages; using its receiver's positions")
    attitudes = np.empty((0, 4))
    if "vehicle_attitude" in datasets:
        attitude = datasets["vehicle_attitude"]
        attitudes = np.column_stack([attitude["timestamp"] * 1e-6, _euler_deg(attitude)])
    photos, more = _photos(path, datasets)
    warnings += more
    ranges = _ranges(datasets.get("distance_sensor"))
    return LoggedRows(
        positions.astype(float), attitudes, photos, tuple(warnings), _clock(datasets), ranges,
        velocities=_velocities(datasets, _VELOCITIES if position else _VELOCITIES[2:]), fixes=_fixes(datasets),
    )  # fmt: skip


def _received(path: Path, datasets: dict[str, dict[str, Any]]) -> FloatArray:
    """(n, 4) time, latitude, longitude and height above sea level of the receiver, where it has a fix in space.

    Raises:
        TrackError: it has none.
    """
    for name in _RECEIVERS:
        fix = datasets.get(name, {})
        rows = receiver_rows(fix)
        if rows is not None:
            good = np.asarray(fix.get("fix_type", np.full(len(rows), _FIX_3D))) >= _FIX_3D
            if good.any():
                return np.asarray(rows[good])
    raise TrackError(
        f"{path}: the log has no vehicle_global_position messages and no receiver fix (vehicle_gps_position), and "
        "therefore no positions"
    )


def _velocities(datasets: dict[str, dict[str, Any]], topics: Sequence[_Velocity]) -> FloatArray:
    """(v, 4) time and velocity north, east, down of the first of these topics that the log has."""
    for name, keys, valid in topics:
        topic = datasets.get(name, {})
        if set(keys) <= set(topic):
            rows = np.column_stack(
                [np.asarray(topic["timestamp"]) * 1e-6, *(np.asarray(topic[k], float) for k in keys)]
            )
            counts = np.ones(len(rows), dtype=bool)
            for key in set(valid) & set(topic):
                counts &= np.asarray(topic[key]) != 0
            return np.asarray(rows[counts])
    return np.empty((0, 4))


def _fixes(datasets: dict[str, dict[str, Any]]) -> FloatArray:
    """(f, 5) reports of the receiver, without a fix while the estimator extrapolates its position (dead_reckoning)."""
    position = datasets.get("vehicle_global_position", {})
    reports = np.empty((0, 5))
    for name in _RECEIVERS:
        if "fix_type" in (topic := datasets.get(name, {})):
            has_fix = np.asarray(topic["fix_type"]) >= _FIX_3D
            at = receiver_rows(topic)
            at = np.zeros((len(has_fix), 4)) if at is None else at
            reports = np.column_stack([topic["timestamp"] * 1e-6, np.zeros(len(has_fix)), has_fix, at[:, 1:3]])
            break
    if "dead_reckoning" not in position:
        return reports
    times, knows = position["timestamp"] * 1e-6, np.asarray(position["dead_reckoning"]) == 0
    if not len(reports):
        return np.column_stack([times, np.zeros(len(times)), knows, np.zeros((len(times), 2))])
    reports[:, 2] *= knows[np.maximum(np.searchsorted(times, reports[:, 0], side="right") - 1, 0)]
    return reports


def _ranges(sensor: dict[str, Any] | None) -> FloatArray:
    """(r, 2) time and distance of valid readings of a sensor that looks down."""
    if not sensor or "current_distance" not in sensor:
        return np.empty((0, 2))
    distance = np.asarray(sensor["current_distance"], float)
    good = np.isfinite(distance) & (distance > 0.0)
    good &= np.asarray(sensor.get("orientation", np.full(len(distance), _LOOKS_DOWN))) == _LOOKS_DOWN
    good &= np.asarray(sensor.get("signal_quality", np.full(len(distance), -1))) != 0
    if {"min_distance", "max_distance"} <= set(sensor):
        good &= (distance >= sensor["min_distance"]) & (distance <= sensor["max_distance"])
    rows: FloatArray = np.column_stack([np.asarray(sensor["timestamp"], float) * 1e-6, distance])[good]
    return rows


def _clock(datasets: dict[str, dict[str, Any]]) -> FloatArray:
    """(c, 2) time of the log and UTC since 1970, as the receiver tells them."""
    for name in _RECEIVERS:
        receiver = datasets.get(name, {})
        if "time_utc_usec" in receiver and "timestamp" in receiver:
            return np.column_stack([receiver["timestamp"], receiver["time_utc_usec"]]) * 1e-6
    return np.empty((0, 2))


def _photos(path: Path, datasets: dict[str, dict[str, Any]]) -> tuple[FloatArray | None, list[str]]:
    """(p, 3) time, latitude and longitude of the photos, none in a log without a camera; and warnings about them."""
    if capture := datasets.get("camera_capture"):
        if lacking := {"timestamp", "seq", "lat", "lon", "result"} - set(capture):
            raise TrackError(f"{path}: its camera_capture messages have no {', '.join(sorted(lacking))}")
        # ``camera_capture.result`` of a photo that was not taken; -1 is a camera that does not answer
        taken = np.asarray(capture["result"]) != 0
        rows = np.column_stack([np.asarray(capture["timestamp"], float) * 1e-6, capture["lat"], capture["lon"]])
        # A log may report one capture twice.
        _, first = np.unique(np.asarray(capture["seq"])[taken], return_index=True)
        failed = int((~taken).sum())
        words = [f"{path}: the camera failed to take {failed} of {len(taken)} photos"] if failed else []
        return rows[taken][first], words
    if trigger := datasets.get("camera_trigger"):
        times = np.asarray(trigger["timestamp"], float) * 1e-6
        words = [
            f"{path}: the log has no camera_capture messages, so triggers count as photos even if no photo was taken"
        ]
        return np.column_stack([times, np.full((len(times), 2), np.nan)]), words
    return None, []


def _euler_deg(attitude: dict[str, Any]) -> FloatArray:
    """(n, 3) roll, pitch, yaw of quaternions (w, x, y, z) from forward-right-down to north-east-down."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = (np.asarray(attitude[f"q[{k}]"], float) for k in range(4))
    return np.asarray(Rotation.from_quat(np.column_stack([x, y, z, w])).as_euler("ZYX", degrees=True))[:, ::-1]


def _of_plugin(name: str) -> Callable[[Path], LoggedRows]:
    """The reader of an installed package, loaded when its first log is read."""

    def read(path: Path) -> LoggedRows:
        try:
            rows: LoggedRows = load("uavcover.log_readers", name)(path)
        except InputError as error:
            raise TrackError(f"{path}: {error}") from error
        return rows

    return read


READERS: dict[str, Callable[[Path], LoggedRows]] = {
    **{f".{name}": _of_plugin(name) for name in registered("uavcover.log_readers")},
    ".bin": read_dataflash,
    ".tlog": read_telemetry,
    ".ulg": read_ulog,
    ".gpx": read_gpx,
}
"""By suffix; a package of a third party cannot replace a reader of ours."""


def read_foreign_log(path: Path, frame: LocalFrame, *, system: int | None = None) -> ReadTrack:
    """Read the track of a log in the local frame.

    The suffix, in upper or lower case, is one of READERS.

    Args:
        path: the log.
        frame: the local frame.
        system: whose track it is, where a telemetry log has several vehicles; None: the only one's.

    Raises:
        TrackError: another suffix, or a file that cannot be read, is no such log or has no positions.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise TrackError(
            f"{path}: {path.suffix or 'no ending'} is not a supported log format; use {', '.join(READERS)}"
        )
    try:
        rows = read_telemetry(path, system=system) if reader is read_telemetry else reader(path)
    except OSError as error:
        raise TrackError(f"{path}: the file cannot be read: {error.strerror}") from None
    return assemble_track(path, rows, frame)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Clock:
    disagrees_s: float
    jump_s: float
    longest_s: float
    clock_step_s: float
    clocks_compared_s: float
    alike_s: float
    window_s: float
    head_bytes: int
    unreleased_versions: int


CLOCK = data_table(_Clock, "uavcover/data/verification.toml", "clock")


def assemble_track(path: Path, rows: LoggedRows, frame: LocalFrame) -> ReadTrack:
    """Make one sample for each position, with its attitude interpolated, or NaN where no rows are near.

    Positions at latitude and longitude 0 (no fix yet), repeated times and positions that came late are dropped, with a warning.
    Such a log does not know the plan's waypoints: ``current_waypoint`` is -1 throughout.

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
    back = before - positions[:, 0] > LOGS.max_late_s
    if back.any():
        at = int(np.argmax(back))
        raise TrackError(
            f"{path}: time goes back from {before[at]:.3f} s to {positions[at, 0]:.3f} s at position {at}; the "
            "vehicle restarted, or two logs were joined; use the log of a single flight"
        )
    repeated = positions[:, 0] <= before
    if repeated.any():
        again = counted(int(repeated.sum()), "repeated or late position was", "repeated or late positions were")
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
    fixes, contradicted = confirmed(rows.fixes, positions)
    warnings += [f"{path}: {words}" for words in contradicted]
    pictures_taken = np.full(len(positions), np.nan)
    if rows.photos is not None:
        pictures_taken, doubted = _photos_taken(frame, positions, rows.photos.reshape(-1, 3), rows.lost)
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
            has_fix=fixes_at(positions[:, 0], fixes),
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


def _photos_taken(
    frame: LocalFrame, positions: FloatArray, photos: FloatArray, lost: IntArray
) -> tuple[FloatArray, list[str]]:
    """Photos taken up to each of (n, 4) positions, and which of (p, 3) photos the positions contradict.

    A photo that was taken when nothing was recorded, or that names a place where the vehicle was not, is no photo. Every
    photo has a row of its own, so of several between two positions one counts: what they would show is the same.
    """
    times, doubted = positions[:, 0], []
    inside = (photos[:, 0] > times[0]) & (photos[:, 0] <= times[-1])
    if not inside.all():
        doubted.append(
            f"{int((~inside).sum())} of {len(photos)} photos were taken outside the time of the track; they do not "
            "count as evidence"
        )
    lost = lost[inside] if lost.size else np.zeros(int(inside.sum()), dtype=np.int64)
    photos = photos[inside]
    placed = np.isfinite(photos[:, 1:]).all(axis=1) & (photos[:, 1:] != 0.0).any(axis=1)
    enu = frame.enu_from_geodetic(*positions[:, 1:].T)
    heights = np.interp(photos[placed, 0], times, positions[:, 3])
    reported_m = frame.enu_from_geodetic(photos[placed, 1], photos[placed, 2], heights)
    off_m = np.full(int(placed.sum()), np.inf)
    for shift_s in (-LOGS.photo_time_error_s, 0.0, LOGS.photo_time_error_s):
        flown = np.column_stack([np.interp(photos[placed, 0] + shift_s, times, enu[:, axis]) for axis in range(2)])
        off_m = np.minimum(off_m, np.hypot(*(reported_m[:, :2] - flown).T))
    elsewhere = np.zeros(len(photos), dtype=bool)
    elsewhere[placed] = ~(off_m <= LOGS.photo_position_error_m)
    if elsewhere.any():
        doubted.append(
            f"{int(elsewhere.sum())} of {len(photos)} photos state a position far from the vehicle (up to "
            f"{float(off_m.max()):.0f} m away); they do not count as evidence"
        )
    at = np.searchsorted(times, photos[~elsewhere, 0])
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
