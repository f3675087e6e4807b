"""ArduPilot's dataflash logs (``.bin``), read by pymavlink."""

import contextlib
import io
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import TrackError
from uavcover.verification.track_logs.assembly import LoggedRows

_MAGIC = b"\xa3\x95"
_ESTIMATOR = ("XKF1", "XKF4", "NKF1")
_TYPES = ("POS", "GPS", "ATT", "CAM", "TRIG", "RFND", "TERR", *_ESTIMATOR)
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
    complaints = io.StringIO()
    # The reader prints a line for each damaged byte (its compiled index writes to stderr directly, out of reach here).
    with contextlib.redirect_stderr(complaints), contextlib.redirect_stdout(complaints):
        try:
            with _opened(DFReader.DFReader_binary, path) as reader:
                left_out = _bytes_left_out(reader, content)
                while (message := reader.recv_match(type=[*_TYPES])) is not None:
                    kind = message.get_type()
                    if kind == "POS":
                        estimated.append(_row(message, "Lat", "Lng", "Alt"))
                    elif kind in cameras:
                        cameras[kind].append(_row(message, "Lat", "Lng"))
                    elif kind == "RFND":
                        ranges += _down(message)
                    elif kind == "TERR":
                        stored += _stored(message)
                    elif kind in _ESTIMATOR:
                        primary = _note_estimate(velocities, message, primary)
                    elif kind == "ATT":
                        attitudes.append(_row(message, "Roll", "Pitch", "Yaw"))
                    elif getattr(message, "I", 0) == 0 and message.Status >= _FIX_3D:
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
    pictures = cameras["CAM"] or cameras["TRIG"]
    if pictures and not cameras["CAM"]:
        warnings.append(f"{path}: without CAM messages, triggers (TRIG) count as photos even if no photo was taken")
    return LoggedRows(
        np.array(positions),
        np.array(attitudes).reshape(-1, 4),
        np.array(pictures) if pictures else None,
        tuple(warnings),
        np.array(clock).reshape(-1, 2),
        np.array(ranges).reshape(-1, 2),
        np.array(stored).reshape(-1, 3),
        velocities=np.array(
            (velocities["XKF1"] or velocities["NKF1"] if estimated else []) or velocities["GPS"]
        ).reshape(-1, 4),
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


def _stored(message: Any) -> list[tuple[float, float, float]]:
    """Latitude, longitude and height of known ground in the vehicle's terrain data."""
    return [(message.Lat, message.Lng, float(message.TerrH))] if message.Status == _TERRAIN_OK else []


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
