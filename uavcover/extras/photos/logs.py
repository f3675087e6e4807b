"""Photos in a flight log: ArduPilot's CAM and TRIG, CAMERA_FEEDBACK, PX4's camera_capture."""

from pathlib import Path

import numpy as np

from uavcover.errors import TrackError
from uavcover.extras.photos.picture import Picture, finite
from uavcover.kernels.arrays import FloatArray
from uavcover.verification.track_logs.assembly import LoggedRows, attitudes_at
from uavcover.verification.track_logs.readers import READERS

ENDINGS = (".bin", ".tlog", ".ulg")


def read_log(path: Path) -> tuple[list[Picture], tuple[str, ...]]:
    """The photos of a log, numbered in order of time, and what is to be said of it.

    A photo is where the log says that it was taken, or else where the vehicle was then; its height and the vehicle's attitude
    are those of the vehicle at that time.

    Raises:
        TrackError: no such log, without positions, or it reports no photo.
    """
    rows = READERS[path.suffix.lower()](path)
    if rows.pictures is None or not len(rows.pictures):
        raise TrackError(
            f"{path}: the log reports no photo (CAM, TRIG, CAMERA_FEEDBACK, camera_capture); verify --log judges its track"
        )
    pictures = _pictures(path, rows)
    outside = len(rows.pictures) - len(pictures)
    words = (f"{path.name}: {outside} photos have a time outside the track and therefore no height: they do not count",)
    return pictures, (*rows.warnings, *(words if outside else ()))


def reports_pictures(path: Path) -> bool:
    """Whether a log reports any photo.

    Raises:
        TrackError: it cannot be read.
    """
    pictures = READERS[path.suffix.lower()](path).pictures
    return pictures is not None and len(pictures) > 0


def _pictures(path: Path, rows: LoggedRows) -> list[Picture]:
    has_fix = np.isfinite(rows.positions).all(axis=1) & (rows.positions[:, 1:3] != 0.0).any(axis=1)
    positions = rows.positions[has_fix]
    positions = positions[np.argsort(positions[:, 0], kind="stable")]
    reports: FloatArray = np.asarray(rows.pictures).reshape(-1, 3)
    reports = reports[np.argsort(reports[:, 0], kind="stable")]
    inside = (
        (reports[:, 0] >= positions[0, 0]) & (reports[:, 0] <= positions[-1, 0])
        if len(positions)
        else np.zeros(len(reports), bool)
    )
    reports = reports[inside]
    if not len(reports):
        raise TrackError(f"{path}: all photos have a time outside the track and therefore no height")
    lat, lon, alt = (np.interp(reports[:, 0], positions[:, 0], positions[:, k]) for k in (1, 2, 3))
    placed = np.isfinite(reports[:, 1:]).all(axis=1) & (reports[:, 1:] != 0.0).any(axis=1)
    lat, lon = np.where(placed, reports[:, 1], lat), np.where(placed, reports[:, 2], lon)
    attitude = attitudes_at(reports[:, 0], rows.attitudes.reshape(-1, 4))
    return [
        Picture(
            name=f"{path.stem}-{k + 1:04d}", lat_deg=float(lat[k]), lon_deg=float(lon[k]), alt_m=float(alt[k]),
            time_s=float(reports[k, 0]), clock=path.name, vehicle_roll_deg=finite(attitude[k, 0]),
            vehicle_pitch_deg=finite(attitude[k, 1]), vehicle_yaw_deg=finite(attitude[k, 2]),
        )
        for k in range(len(reports))
    ]  # fmt: skip
