"""Read logs of other software, chosen by file suffix: PX4's (by pyulog, an optional dependency), GPX, and those of MAVLink.

A format is a function and a row of ``READERS``. Our own ``.csv`` and ``.rrd`` are read by
:func:`uavcover.verification.run_logs.read_log`.
"""

import datetime
import math
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from uavcover.errors import InputError, TrackError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import ReadTrack
from uavcover.plugins import load, registered
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.track_logs.assembly import LoggedRows, assemble_track
from uavcover.verification.track_logs.mavlink_logs import read_dataflash, read_telemetry

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
    pictures, more = _pictures(path, datasets)
    warnings += more
    ranges = _ranges(datasets.get("distance_sensor"))
    return LoggedRows(
        positions.astype(float), attitudes, pictures, tuple(warnings), _clock(datasets), ranges,
        velocities=_velocities(datasets, _VELOCITIES if position else _VELOCITIES[2:]),
    )  # fmt: skip


def _received(path: Path, datasets: dict[str, dict[str, Any]]) -> FloatArray:
    """(n, 4) time, latitude, longitude and height above sea level of the receiver, where it has a fix in space.

    Raises:
        TrackError: it has none.
    """
    for name in _RECEIVERS:
        fix = datasets.get(name, {})
        # 1e-7 degrees and millimetres until PX4 1.14, degrees and metres since.
        for keys, (degrees, metres) in (
            (("latitude_deg", "longitude_deg", "altitude_msl_m"), (1.0, 1.0)),
            (("lat", "lon", "alt"), (1e-7, 1e-3)),
        ):
            if set(keys) <= set(fix):
                lat, lon, alt = (np.asarray(fix[key], float) for key in keys)
                rows = np.column_stack(
                    [np.asarray(fix["timestamp"]) * 1e-6, degrees * lat, degrees * lon, metres * alt]
                )
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


def _pictures(path: Path, datasets: dict[str, dict[str, Any]]) -> tuple[FloatArray | None, list[str]]:
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
    try:
        value = float(text) if text is not None else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TrackError(f"{path}: track point {point}: {name} must be a number, not {text!r}")
    return value


def _time_s(path: Path, point: int, text: str | None) -> float:
    try:
        moment = datetime.datetime.fromisoformat(text or "")
    except ValueError:
        raise TrackError(f"{path}: track point {point}: time must be a date and time, not {text!r}") from None
    # GPX times are UTC, also those without a zone.
    return (moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)).timestamp()


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
        system: whose track it is, where a telemetry log has several vehicles; none: the only one's.

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
