"""Rows of positions, attitudes and photos in ArduPilot's dataflash logs, telemetry logs (both by pymavlink) and GPX files."""

import contextlib
import datetime
import io
import math
import struct
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from mission_io.data_tables import data_table
from mission_io.formats.text import plain_float
from mission_io.model.enums import VehicleKind, kind_of
from uavcover.errors import TrackError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.run.user import compiled_code_silenced


@dataclass(frozen=True, slots=True, eq=False)
class LoggedRows:
    """Positions and attitudes of a log."""

    positions: FloatArray  # (n, 4) time in seconds, latitude and longitude in degrees, height above sea level in metres
    attitudes: FloatArray  # (k, 4) time in seconds, roll, pitch and yaw in degrees; may be empty
    # (p, 3) time in seconds, latitude and longitude in degrees of every photo that was taken, NaN or 0 where its
    # position is not reported; none in a log without camera messages
    photos: FloatArray | None = None
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
    # (f, 5) time in seconds of a receiver's report, number of the receiver, 1 if it has a fix in space, otherwise 0, and its
    # latitude and longitude, 0 or NaN where unknown; empty: not reported
    fixes: FloatArray = field(default_factory=lambda: np.empty((0, 5)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Logs:
    photo_position_error_m: float
    photo_time_error_s: float
    clock_spread_s: float
    most_lean_cos: float
    max_attitude_gap_s: float
    max_velocity_gap_s: float
    max_fix_age_s: float
    max_late_s: float
    steady_reports: int
    receiver_error_m: float
    receiver_late_s: float
    receiver_early_s: float


LOGS = data_table(_Logs, "uavcover/data/verification.toml", "logs")


_MAGIC = b"\xa3\x95"
_ESTIMATOR = ("XKF1", "XKF4", "NKF1")
_DATAFLASH_TYPES = ("POS", "GPS", "ATT", "CAM", "TRIG", "RFND", "TERR", *_ESTIMATOR)
_FIX_3D = 3
_RANGE_GOOD, _TERRAIN_OK, _DOWN = 4, 2, 25
"""RFND.Stat of a reading in range, TERR.Status of known ground, RFND.Orient of a sensor that looks down."""
_GPS_EPOCH_UNIX_S, _WEEK_S, _LEAP_S = 315_964_800.0, 604_800.0, 18.0
"""GPS time began in 1980 and has no leap seconds; UTC has had 18 of them since, the last one in 2017."""


def read_dataflash(path: Path) -> LoggedRows:
    """Read positions (POS of the estimator, otherwise the first GPS), attitudes (ATT) and photos (CAM, otherwise TRIG).

    Velocities are those of the estimator's primary core (XKF1, otherwise NKF1), or of the first GPS where positions are its own
    or no core is logged.

    CAM is a photo that the camera took, or was commanded to take where no feedback is wired; TRIG is the trigger alone, of a
    camera with feedback, whose photos are its CAM messages.

    Raises:
        TrackError: not such a log, or without positions.
    """
    content = path.read_bytes()
    if content[:2] != _MAGIC:
        raise TrackError(f"{path}: this is not an ArduPilot dataflash log; it must start with the bytes a3 95")
    # Importing pymavlink takes a moment; other kinds of logs do not need it.
    from pymavlink import DFReader

    estimated: list[tuple[float, ...]] = []
    measured: list[tuple[float, ...]] = []
    attitudes: list[tuple[float, ...]] = []
    velocities: dict[str, list[tuple[float, ...]]] = {"XKF1": [], "NKF1": [], "GPS": []}
    primary = 0
    clock: list[tuple[float, float]] = []
    cameras: dict[str, list[tuple[float, ...]]] = {"CAM": [], "TRIG": []}
    ranges: list[tuple[float, ...]] = []
    stored: list[tuple[float, ...]] = []
    fixes: list[tuple[float, ...]] = []
    complaints = io.StringIO()
    # The reader prints a line for each damaged byte.
    with contextlib.redirect_stderr(complaints), contextlib.redirect_stdout(complaints):
        try:
            with _opened(DFReader.DFReader_binary, path) as reader:
                left_out = _bytes_left_out(reader, content)
                while (message := reader.recv_match(type=[*_DATAFLASH_TYPES])) is not None:
                    kind = message.get_type()
                    if kind == "POS":
                        estimated.append(_row(message, "Lat", "Lng", "Alt"))
                    elif kind in cameras:
                        cameras[kind].append(_row(message, "Lat", "Lng"))
                    elif kind == "RFND":
                        ranges += _down(message)
                    elif kind == "TERR":
                        if message.Status == _TERRAIN_OK:
                            stored.append((message.Lat, message.Lng, float(message.TerrH)))
                    elif kind in _ESTIMATOR:
                        primary = _note_estimate(velocities, message, primary)
                    elif kind == "ATT":
                        attitudes.append(_row(message, "Roll", "Pitch", "Yaw"))
                    else:
                        number, has_fix = getattr(message, "I", 0), message.Status >= _FIX_3D
                        fixes.append((message.TimeUS * 1e-6, number, has_fix, message.Lat, message.Lng))
                        if number != 0 or not has_fix:
                            continue
                        measured.append(_row(message, "Lat", "Lng", "Alt"))
                        clock.append(_clock_row(message))
                        velocities["GPS"] += _gps_velocity(message)
        except (AttributeError, ValueError, IndexError, KeyError, TypeError, struct.error) as error:
            raise TrackError(f"{path}: the dataflash log is damaged ({type(error).__name__}: {error})") from error
    warnings = []
    if complaints.getvalue() or left_out > 0:
        warnings.append(f"{path}: parts of the log are damaged and were ignored")
    if not estimated and measured:
        warnings.append(f"{path}: the log has no POS messages; uavcover uses the positions of the first GPS")
    positions = estimated or measured
    if not positions:
        raise TrackError(f"{path}: the log has no POS or GPS messages; to log them, set bits 1 and 2 of LOG_BITMASK")
    photos = cameras["CAM"] or cameras["TRIG"]
    if photos and not cameras["CAM"]:
        warnings.append(f"{path}: without CAM messages, triggers (TRIG) count as photos even if no photo was taken")
    return LoggedRows(
        np.array(positions),
        np.array(attitudes).reshape(-1, 4),
        np.array(photos) if photos else None,
        tuple(warnings),
        np.array(clock).reshape(-1, 2),
        np.array(ranges).reshape(-1, 2),
        np.array(stored).reshape(-1, 3),
        velocities=np.array(
            (velocities["XKF1"] or velocities["NKF1"] if estimated else []) or velocities["GPS"]
        ).reshape(-1, 4),
        fixes=np.array(fixes).reshape(-1, 5),
    )


def _note_estimate(velocities: dict[str, list[tuple[float, ...]]], message: Any, primary: int) -> int:
    """Note a velocity of the primary core, which XKF4 names; returns the primary core."""
    kind = message.get_type()
    if kind == "XKF4":
        return int(getattr(message, "PI", primary))
    # NKF1 of old versions is of the first core alone and has no number.
    if kind == "NKF1" or getattr(message, "C", primary) == primary:
        velocities[kind].append(_row(message, "VN", "VE", "VD"))
    return primary


def _gps_velocity(message: Any) -> list[tuple[float, ...]]:
    """Time and velocity north, east, down of speed, course over ground and vertical speed, which is positive downwards."""
    if not (hasattr(message, "Spd") and hasattr(message, "GCrs") and hasattr(message, "VZ")):
        return []
    course = math.radians(message.GCrs)
    north, east = message.Spd * math.cos(course), message.Spd * math.sin(course)
    return [(message.TimeUS * 1e-6, north, east, float(message.VZ))]


def _down(message: Any) -> list[tuple[float, float]]:
    """Time and distance of a reading that looks down and is in range. Logs before version 4.0 have two sensors in a message."""
    if hasattr(message, "Dist"):
        good = getattr(message, "Stat", _RANGE_GOOD) == _RANGE_GOOD and getattr(message, "Orient", _DOWN) == _DOWN
        return [(message.TimeUS * 1e-6, float(message.Dist))] if good and message.Dist > 0.0 else []
    if getattr(message, "Orient1", _DOWN) == _DOWN and getattr(message, "Dist1", 0.0) > 0.0:
        return [(message.TimeUS * 1e-6, float(message.Dist1))]
    return []


@contextlib.contextmanager
def _opened(kind: Any, path: Path) -> Iterator[Any]:
    """A reader that closes its file even when its construction fails, which reads the whole log."""
    reader = kind.__new__(kind)
    try:
        with compiled_code_silenced():  # its index prints such lines, too
            reader.__init__(str(path), zero_time_base=False)
        yield reader
    finally:
        for file in (getattr(reader, "data_map", None), getattr(reader, "filehandle", None)):
            if file is not None:
                file.close()


def _bytes_left_out(reader: Any, content: bytes) -> int:
    """Number of bytes that belong to no message that the reader has indexed, without zeros at the end of a file."""
    indexed = sum(int(reader.counts[number]) * one.len for number, one in reader.formats.items())
    return len(content.rstrip(b"\0")) - int(indexed)


def _clock_row(message: Any) -> tuple[float, float]:
    """Time of the log and UTC in seconds since 1970, from week and milliseconds of the receiver."""
    week, millis = getattr(message, "GWk", 0), getattr(message, "GMS", 0)
    return message.TimeUS * 1e-6, _GPS_EPOCH_UNIX_S + week * _WEEK_S + millis * 1e-3 - _LEAP_S


def _row(message: Any, *names: str) -> tuple[float, ...]:
    return (message.TimeUS * 1e-6, *(float(getattr(message, name)) for name in names))


_Source = tuple[int, int]
_TELEMETRY_TYPES = (
    "GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME", "HEARTBEAT", "CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED",
    "DISTANCE_SENSOR", "RANGEFINDER", "TERRAIN_REPORT", "GPS_RAW_INT", "GPS2_RAW",
)  # fmt: skip
_TRACKERS = (5,)
"""MAV_TYPE of antenna trackers, which fly an autopilot's firmware and nothing else."""
_LOOKS_DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270."""
_Photos = dict[tuple[int, int, int], tuple[float, ...] | None]
"""Time, latitude and longitude of a photo, none of one that failed; by system, camera and number."""
_NOT_PHOTOS = (1, 2)
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
        system: of the vehicle; None: the only one.

    Raises:
        TrackError: not such a log, without positions, or with positions of several vehicles of which none was chosen.
    """
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import common as mavlink

    positions: _Rows = defaultdict(list)
    velocities: _Rows = defaultdict(list)
    attitudes: _Rows = defaultdict(list)
    clocks: _Rows = defaultdict(list)
    autopilots: set[_Source] = set()
    cameras: dict[str, _Photos] = {"CAMERA_FEEDBACK": {}, "CAMERA_IMAGE_CAPTURED": {}}
    now_s: dict[int, float] = {}
    ranges: dict[str, _Rows] = {"DISTANCE_SENSOR": defaultdict(list), "RANGEFINDER": defaultdict(list)}
    stored: _Rows = defaultdict(list)
    fixes: _Rows = defaultdict(list)
    log = mavutil.mavlogfile(str(path), robust_parsing=True)
    try:
        while (message := log.recv_match(type=[*_TELEMETRY_TYPES])) is not None:
            source = (message.get_srcSystem(), message.get_srcComponent())
            kind = message.get_type()
            if kind in cameras:
                # A photo before the first position has no place in the track.
                _note_photo(cameras[kind], message, source, now_s.get(source[0], 0.0))
                continue
            if kind == "HEARTBEAT":
                is_vehicle = kind_of(message.type) is not VehicleKind.NO_VEHICLE and message.type not in _TRACKERS
                if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID and is_vehicle:
                    autopilots.add(source)
                continue
            if kind in ranges:
                ranges[kind][source] += _range(message, now_s.get(source[0]))
                continue
            if kind.startswith("GPS"):
                if source[0] in now_s:
                    at = message.lat * 1e-7, message.lon * 1e-7
                    fixes[source].append((now_s[source[0]], kind == "GPS2_RAW", message.fix_type >= _FIX_3D, *at))
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
    photos = np.array([row for row in reports if row is not None]).reshape(-1, 3) if reports else None
    warnings: tuple[str, ...] = ()
    if failed := sum(row is None for row in reports):
        warnings = (f"{path}: the camera failed to take {failed} of {len(reports)} photos",)
    measured = ranges["DISTANCE_SENSOR"][source] or ranges["RANGEFINDER"][source]
    return LoggedRows(
        np.array(positions[source]), np.array(attitudes[source]).reshape(-1, 4), photos, warnings,
        np.array(clocks[source]).reshape(-1, 2), np.array(measured).reshape(-1, 2), np.array(stored[source]).reshape(-1, 3),
        _lost(counted), np.array(velocities[source]),
        np.array(fixes[source]).reshape(-1, 5),
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


def _lost(counted: _Photos) -> NDArray[np.int64]:
    """The number of photos that each camera counted since the message before, and that no message reports."""
    lost: list[int] = []
    before: dict[int, int] = {}
    for (_, camera, number), row in counted.items():
        missing = max(0, number - before.get(camera, number) - 1)
        before[camera] = number
        if row is not None:
            lost.append(missing)
    return np.array(lost, dtype=np.int64)


def _note_photo(found: _Photos, message: Any, source: _Source, now_s: float) -> None:
    """Note a photo that a camera reports, unless it was noted before."""
    if message.get_type() == "CAMERA_FEEDBACK":
        camera, number, good = message.cam_idx, message.img_idx, message.flags not in _NOT_PHOTOS
        position = (message.lat * 1e-7, message.lng * 1e-7)
    else:
        camera, number, good = message.camera_id, message.image_index, message.capture_result == 1
        position = (message.lat * 1e-7, message.lon * 1e-7)
    found.setdefault((source[0], camera, number), (now_s, *position) if good else None)


def read_gpx(path: Path) -> LoggedRows:
    """Read the points of all tracks and segments of a GPX 1.0 or 1.1 file.

    Time counts from the first one.

    ``ele`` is a height above sea level by the standard; a warning says that this is assumed.

    Raises:
        TrackError: not such a file; a point has no height or time, or one that is not a number.
    """
    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise TrackError(f"{path}: a GPX file must not contain a document type or entities; remove them")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise TrackError(f"{path}: cannot read the file as GPX: {error}") from None
    if _name(root) != "gpx":
        raise TrackError(f"{path}: this is not a GPX file, because its root element is <{_name(root)}>")
    points = list(_points(path, root))
    if not points:
        raise TrackError(f"{path}: the file contains no track points")
    positions = np.array(points)
    clock = np.array([[0.0, positions[0, 0]]])
    positions[:, 0] -= positions[0, 0]
    warning = (
        f"{path}: uavcover interprets the heights as above sea level, as the GPX standard requires; some loggers "
        "write ellipsoid heights"
    )
    return LoggedRows(positions, np.empty((0, 4)), warnings=(warning,), clock=clock)


def _points(path: Path, root: ElementTree.Element) -> Iterator[tuple[float, float, float, float]]:
    number = 0
    for element in root.iter():
        if _name(element) != "trkpt":
            continue
        children = {_name(child): (child.text or "").strip() for child in element}
        values = {"lat": element.get("lat"), "lon": element.get("lon"), **children}
        lat, lon, alt = (_number(path, number, name, values.get(name)) for name in ("lat", "lon", "ele"))
        yield _time_s(path, number, values.get("time")), lat, lon, alt
        number += 1


def _name(element: ElementTree.Element) -> str:
    """The element's name without its namespace."""
    return element.tag.rpartition("}")[2]


def _number(path: Path, point: int, name: str, text: str | None) -> float:
    if not text:
        raise TrackError(f"{path}: track point {point}: {name} is missing; export the track with time and height")
    try:
        value = plain_float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TrackError(f"{path}: track point {point}: {name} must be a number, not {text!r}")
    return value


def _time_s(path: Path, point: int, text: str | None) -> float:
    if not text:
        raise TrackError(f"{path}: track point {point}: time is missing; export the track with time and height")
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        raise TrackError(f"{path}: track point {point}: time must be a date and time, not {text!r}") from None
    # GPX times are UTC, also those without a zone.
    return (moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)).timestamp()
