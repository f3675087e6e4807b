"""PX4's logs (``.ulg``), read by pyulog, an optional dependency."""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import TrackError
from uavcover.judging.track_logs.assembly import LoggedRows
from uavcover.kernels.arrays import FloatArray

_MAGIC = b"ULog\x01\x12\x35"


def read_ulog(path: Path) -> LoggedRows:
    """Read positions (vehicle_global_position) and attitudes (vehicle_attitude).

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
        log = ULog(str(path), message_name_filter_list=["vehicle_global_position", "vehicle_attitude"])
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
    warnings = (f"{path}: parts of the log are damaged and were left out",) if log.file_corruption else ()
    return LoggedRows(positions.astype(float), attitudes, warnings)


def _euler_deg(attitude: dict[str, Any]) -> FloatArray:
    """(n, 3) roll, pitch, yaw of quaternions (w, x, y, z) from forward-right-down to north-east-down."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = (np.asarray(attitude[f"q[{k}]"], float) for k in range(4))
    return np.asarray(Rotation.from_quat(np.column_stack([x, y, z, w])).as_euler("ZYX", degrees=True))[:, ::-1]
