"""How the camera of a vehicle is turned that has a flown attitude: gimbal, roll, pitch and yaw."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.model.sensor import Camera, FrameCamera, Sensor

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class CameraTurn:
    """Directions of a camera, one row a look.

    Attributes:
        axes: (k, 3) unit vectors in ENU: where it looks.
        tops: (k, 3) unit vectors at right angles to them: the top of its picture.
        known: (k,) whether the attitude that it takes is known; the others were taken as level, nose ahead.
    """

    axes: FloatArray
    tops: FloatArray
    known: BoolArray


def camera_turn(sensor: Sensor, attitude_deg: FloatArray, courses_deg: FloatArray | None = None) -> CameraTurn:
    """How a camera is turned whose vehicle has these attitudes.

    A camera that is fixed to the vehicle shares its roll, pitch and yaw. A stabilised one is level; its picture's top keeps
    the heading of the scenario, or follows the vehicle's yaw. Sensors that are no camera look straight down.

    Args:
        sensor: of the scenario.
        attitude_deg: (k, 3) roll, pitch and yaw; a row that a fixed camera needs and that is not finite is taken as level.
        courses_deg: (k,) yaws to take where the vehicle's is not known; default: north.
    """
    count = len(attitude_deg)
    if not isinstance(sensor, Camera):
        return CameraTurn(
            np.tile([0.0, 0.0, -1.0], (count, 1)), np.tile([0.0, 1.0, 0.0], (count, 1)), np.ones(count, bool)
        )
    north_up = np.zeros(count) if courses_deg is None else courses_deg
    picture = isinstance(sensor, FrameCamera)
    heading_deg = sensor.heading_deg if isinstance(sensor, FrameCamera) else None
    if sensor.mount == "fixed":
        known = np.asarray(np.isfinite(attitude_deg).all(axis=1))
        angles = np.where(known[:, None], attitude_deg, np.column_stack([np.zeros((count, 2)), north_up]))
    else:
        yaw = np.full(count, heading_deg) if heading_deg is not None else attitude_deg[:, 2]
        known = np.isfinite(yaw)
        angles = np.column_stack([np.zeros((count, 2)), np.where(known, yaw, north_up)])
        # A round view straight down has no direction that could be missing.
        known = known if picture else np.ones(count, dtype=bool)
    roll, pitch, yaw = np.radians(angles).T
    # The first and third column of the rotation from body (forward, right, down) to north-east-down, yaw-pitch-roll order.
    forward = (np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch))
    down = (
        np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw),
        np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw),
        np.cos(roll) * np.cos(pitch),
    )
    off_nadir = np.radians(90.0 + sensor.pitch_deg) if isinstance(sensor, FrameCamera) else 0.0
    s, c = np.sin(off_nadir), np.cos(off_nadir)
    axes = _enu([s * f + c * d for f, d in zip(forward, down, strict=True)])
    tops = _enu([c * f - s * d for f, d in zip(forward, down, strict=True)])
    return CameraTurn(axes, tops, known)


def _enu(north_east_down: list[FloatArray]) -> FloatArray:
    north, east, down = north_east_down
    return np.ascontiguousarray(np.column_stack([east, north, -down]))
