"""Telemetry logs of ground stations (``.tlog``): MAVLink packets with their times of arrival, read by pymavlink."""

from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission_io.model.enums import VehicleKind, kind_of
from uavcover.errors import TrackError
from uavcover.verification.track_logs.assembly import LoggedRows

_Source = tuple[int, int]
_TYPES = (
    "GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME", "HEARTBEAT", "CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED",
    "DISTANCE_SENSOR", "RANGEFINDER", "TERRAIN_REPORT",
)  # fmt: skip
_TRACKERS = (5,)
"""MAV_TYPE of antenna trackers, which fly an autopilot's firmware and nothing else."""
_LOOKS_DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270."""
_Pictures = dict[tuple[int, int, int], tuple[float, ...] | None]
"""Time, latitude and longitude of a photo, none of one that failed; by system, camera and number."""
_NOT_PICTURES = (1, 2)
"""CAMERA_FEEDBACK_VIDEO and CAMERA_FEEDBACK_BADEXPOSURE."""

_Rows = dict[_Source, list[tuple[float, ...]]]


def read_telemetry(path: Path, *, system: int | None = None) -> LoggedRows:
    """Read positions and velocities (GLOBAL_POSITION_INT), attitudes (ATTITUDE) and photos of one vehicle, on its own clock.

    Where any autopilot sends heartbeats, only autopilots are vehicles: ground stations and trackers send positions of their own.
    Ranges are DISTANCE_SENSOR, otherwise RANGEFINDER, of sensors that look down. Photos are CAMERA_FEEDBACK, otherwise
    CAMERA_IMAGE_CAPTURED; each number counts once. A feedback's own time may be of the GPS, so a photo has the time of the
    position that came before it, and so has a range.

    Args:
        path: the log.
        system: of the vehicle; none: the only one.

    Raises:
        TrackError: not such a log, without positions, or with positions of several vehicles of which none was chosen.
    """
    # Importing pymavlink takes a moment; other kinds of logs do not need it.
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import common as mavlink

    positions: _Rows = defaultdict(list)
    velocities: _Rows = defaultdict(list)
    attitudes: _Rows = defaultdict(list)
    clocks: _Rows = defaultdict(list)
    autopilots: set[_Source] = set()
    cameras: dict[str, _Pictures] = {"CAMERA_FEEDBACK": {}, "CAMERA_IMAGE_CAPTURED": {}}
    now_s: dict[int, float] = {}
    ranges: dict[str, _Rows] = {"DISTANCE_SENSOR": defaultdict(list), "RANGEFINDER": defaultdict(list)}
    stored: _Rows = defaultdict(list)
    log = mavutil.mavlogfile(str(path), robust_parsing=True)
    try:
        while (message := log.recv_match(type=[*_TYPES])) is not None:
            source = (message.get_srcSystem(), message.get_srcComponent())
            kind = message.get_type()
            if kind in cameras:
                # A photo before the first position has no place in the track.
                _note_picture(cameras[kind], message, source, now_s.get(source[0], 0.0))
                continue
            if kind == "HEARTBEAT":
                is_vehicle = kind_of(message.type) is not VehicleKind.NO_VEHICLE and message.type not in _TRACKERS
                if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID and is_vehicle:
                    autopilots.add(source)
                continue
            if kind in ranges:
                ranges[kind][source] += _range(message, now_s.get(source[0]))
                continue
            if kind == "TERRAIN_REPORT":
                if message.spacing > 0:
                    stored[source].append((message.lat * 1e-7, message.lon * 1e-7, message.terrain_height))
                continue
            time_s = message.time_boot_ms * 1e-3
            if kind == "SYSTEM_TIME":
                clocks[source].append((time_s, message.time_unix_usec * 1e-6))
            elif kind == "ATTITUDE":
                angles = np.degrees([message.roll, message.pitch, message.yaw])
                attitudes[source].append((time_s, *map(float, angles)))
            else:
                now_s[source[0]] = time_s
                positions[source].append((time_s, message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3))
                velocities[source].append((time_s, message.vx * 1e-2, message.vy * 1e-2, message.vz * 1e-2))
    finally:
        log.close()
    if not positions:
        raise TrackError(f"{path}: the log has no GLOBAL_POSITION_INT messages (positions); is this a telemetry log?")
    # Only the autopilot's positions count; in a log without heartbeats it is the component that sends most.
    speaking = {key: len(rows) for key, rows in positions.items() if key in autopilots} or {
        key: len(rows) for key, rows in positions.items()
    }
    systems = sorted({number for number, _ in speaking})
    if system is not None:
        if system not in systems:
            raise TrackError(
                f"{path}: the log has no vehicle with system ID {system}; set --system to one of {', '.join(map(str, systems))}"
            )
        speaking = {key: count for key, count in speaking.items() if key[0] == system}
    elif len(systems) > 1:
        raise TrackError(
            f"{path}: the log has positions of {len(systems)} vehicles (system IDs {', '.join(map(str, systems))}); "
            "choose one with --system"
        )
    source = Counter(speaking).most_common(1)[0][0]
    of_vehicle = [{key: row for key, row in found.items() if key[0] == source[0]} for found in cameras.values()]
    counted = of_vehicle[0] or of_vehicle[1]
    reports = list(counted.values())
    pictures = np.array([row for row in reports if row is not None]).reshape(-1, 3) if reports else None
    warnings: tuple[str, ...] = ()
    if failed := sum(row is None for row in reports):
        warnings = (f"{path}: the camera failed to take {failed} of {len(reports)} photos",)
    measured = ranges["DISTANCE_SENSOR"][source] or ranges["RANGEFINDER"][source]
    return LoggedRows(
        np.array(positions[source]), np.array(attitudes[source]).reshape(-1, 4), pictures, warnings,
        np.array(clocks[source]).reshape(-1, 2), np.array(measured).reshape(-1, 2), np.array(stored[source]).reshape(-1, 3),
        _lost(counted), np.array(velocities[source]),
    )  # fmt: skip


def _range(message: Any, now_s: float | None) -> list[tuple[float, ...]]:
    """Time, that of the position before, and distance of a reading that looks down and is in range."""
    if now_s is None:
        return []
    if message.get_type() == "RANGEFINDER":
        return [(now_s, float(message.distance))] if message.distance > 0.0 else []
    in_range = max(message.min_distance, 1) <= message.current_distance <= message.max_distance
    # A signal quality of 1 is an invalid reading; 0 says nothing.
    looks_down = message.orientation == _LOOKS_DOWN and getattr(message, "signal_quality", 0) != 1
    return [(now_s, 0.01 * message.current_distance)] if in_range and looks_down else []


def _lost(counted: _Pictures) -> NDArray[np.int64]:
    """The number of photos that each camera counted since the message before, and that no message reports."""
    lost: list[int] = []
    before: dict[int, int] = {}
    for (_, camera, number), row in counted.items():
        missing = max(0, number - before.get(camera, number) - 1)
        before[camera] = number
        if row is not None:
            lost.append(missing)
    return np.array(lost, dtype=np.int64)


def _note_picture(found: _Pictures, message: Any, source: _Source, now_s: float) -> None:
    """Note a photo that a camera reports, unless it was noted before."""
    if message.get_type() == "CAMERA_FEEDBACK":
        camera, number, good = message.cam_idx, message.img_idx, message.flags not in _NOT_PICTURES
        place = (message.lat * 1e-7, message.lng * 1e-7)
    else:
        camera, number, good = message.camera_id, message.image_index, message.capture_result == 1
        place = (message.lat * 1e-7, message.lon * 1e-7)
    found.setdefault((source[0], camera, number), (now_s, *place) if good else None)
