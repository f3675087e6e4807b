"""PX4's logs (``.ulg``), read by pyulog, an optional dependency."""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import TrackError
from uavcover.judging.track_logs.assembly import LoggedRows
from uavcover.kernels.arrays import FloatArray

_RECEIVERS = ("vehicle_gps_position", "sensor_gps")
_TOPICS = ("vehicle_global_position", "vehicle_attitude", "camera_capture", "camera_trigger", *_RECEIVERS)
_FAILED = 0
"""``camera_capture.result`` of a picture that was not taken; -1 is a camera that does not answer."""

_MAGIC = b"ULog\x01\x12\x35"


def read_ulog(path: Path) -> LoggedRows:
    """Read positions (vehicle_global_position), attitudes (vehicle_attitude) and pictures (camera_capture, or camera_trigger).

    Raises:
        TrackError: no such log, no positions, or pyulog is not installed.
    """
    if path.read_bytes()[: len(_MAGIC)] != _MAGIC:
        raise TrackError(f"{path}: is no ULog of PX4; it does not begin with its mark")
    try:
        from pyulog import ULog
    except ImportError:
        raise TrackError(f"{path}: reading .ulg needs pyulog: pip install pyulog") from None
    try:
        log = ULog(str(path), message_name_filter_list=[*_TOPICS])
    except (ValueError, IndexError, KeyError, TypeError, struct.error, UnicodeDecodeError) as error:
        raise TrackError(f"{path}: a damaged ULog ({type(error).__name__}: {error})") from error
    except Exception as error:  # pyulog raises bare Exceptions for wrong headers and flags
        raise TrackError(f"{path}: not a ULog that pyulog can read ({error})") from error
    datasets = {data.name: data.data for data in log.data_list if data.multi_id == 0}
    if "vehicle_global_position" not in datasets:
        raise TrackError(f"{path}: has no vehicle_global_position messages, so no positions")
    position = datasets["vehicle_global_position"]
    positions = np.column_stack([position["timestamp"] * 1e-6, position["lat"], position["lon"], position["alt"]])
    attitudes = np.empty((0, 4))
    if "vehicle_attitude" in datasets:
        attitude = datasets["vehicle_attitude"]
        attitudes = np.column_stack([attitude["timestamp"] * 1e-6, _euler_deg(attitude)])
    warnings = [f"{path}: parts of the log are damaged and were left out"] if log.file_corruption else []
    pictures, more = _pictures(path, datasets)
    warnings += more
    return LoggedRows(positions.astype(float), attitudes, pictures, tuple(warnings), _clock(datasets))


def _clock(datasets: dict[str, dict[str, Any]]) -> FloatArray:
    """(c, 2) time of the log and UTC since 1970, as the receiver tells them."""
    for name in _RECEIVERS:
        receiver = datasets.get(name, {})
        if "time_utc_usec" in receiver and "timestamp" in receiver:
            return np.column_stack([receiver["timestamp"], receiver["time_utc_usec"]]) * 1e-6
    return np.empty((0, 2))


def _pictures(path: Path, datasets: dict[str, dict[str, Any]]) -> tuple[FloatArray | None, list[str]]:
    """(p, 3) time, latitude and longitude of the pictures, none where the log has no camera; and what to tell of them."""
    if capture := datasets.get("camera_capture"):
        if lacking := {"timestamp", "seq", "lat", "lon", "result"} - set(capture):
            raise TrackError(f"{path}: its camera_capture messages have no {', '.join(sorted(lacking))}")
        taken = np.asarray(capture["result"]) != _FAILED
        rows = np.column_stack([np.asarray(capture["timestamp"], float) * 1e-6, capture["lat"], capture["lon"]])
        # One capture may be told of twice.
        _, first = np.unique(np.asarray(capture["seq"])[taken], return_index=True)
        failed = int((~taken).sum())
        words = [f"{path}: the camera failed to take {failed} of {len(taken)} pictures"] if failed else []
        return rows[taken][first], words
    if trigger := datasets.get("camera_trigger"):
        times = np.asarray(trigger["timestamp"], float) * 1e-6
        words = [
            f"{path}: has no camera_capture messages; the triggers count as pictures, whether or not any was taken"
        ]
        return np.column_stack([times, np.full((len(times), 2), np.nan)]), words
    return None, []


def _euler_deg(attitude: dict[str, Any]) -> FloatArray:
    """(n, 3) roll, pitch, yaw of quaternions (w, x, y, z) from forward-right-down to north-east-down."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = (np.asarray(attitude[f"q[{k}]"], float) for k in range(4))
    return np.asarray(Rotation.from_quat(np.column_stack([x, y, z, w])).as_euler("ZYX", degrees=True))[:, ::-1]
