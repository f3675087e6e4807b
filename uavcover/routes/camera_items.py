"""Camera items of a mission, gimbal angles and distance triggers, as each autopilot needs them.

ArduPilot takes gimbal angles as DO_GIMBAL_MANAGER_PITCHYAW, in whole degrees, and can hold a heading; its DO_MOUNT_CONTROL
would turn a vehicle whose gimbal has no yaw axis. PX4 refuses DO_GIMBAL_MANAGER_PITCHYAW in a mission unless the mission has
taken control of the gimbal, so it gets DO_MOUNT_CONTROL, as ground stations send it, and holds a heading by its waypoints.
"""

from dataclasses import replace

from mission_io.model.actions import PointGimbal, PointMount, item_of
from mission_io.model.items import MissionItem, trigger_camera_every
from uavcover.errors import InfeasibleError
from uavcover.model.sensor import Camera, FrameCamera, Sensor
from uavcover.model.vehicle import AutopilotName

_YAW_LOCK = 16
"""GIMBAL_MANAGER_FLAGS: yaw is a heading, not an angle relative to the vehicle's nose."""


def pointing_items(sensor: Sensor, autopilot: AutopilotName) -> list[MissionItem]:
    """Items that point a stabilised camera as the scenario requires; empty for other sensors.

    Raises:
        InfeasibleError: the autopilot cannot keep the angle.
    """
    if not isinstance(sensor, Camera) or sensor.mount != "stabilised":
        return []
    pitch_deg, heading_deg = (
        (sensor.pitch_deg, sensor.heading_deg) if isinstance(sensor, FrameCamera) else (-90.0, None)
    )
    if autopilot == "px4":
        return [item_of(PointMount(pitch_deg))]
    for key, angle in (("pitch_deg", pitch_deg), ("heading_deg", heading_deg)):
        if angle is not None and not angle.is_integer():
            raise InfeasibleError(
                f"sensor.{key}: ArduPilot stores gimbal angles in whole degrees and would change {angle:g}; "
                f"give {round(angle)}"
            )
    flags = 0 if heading_deg is None else _YAW_LOCK
    yaw_deg = 0.0 if heading_deg is None else heading_deg
    return [item_of(PointGimbal(pitch_deg, yaw_deg, 0.0, 0.0, flags=flags))]


def headed(item: MissionItem, sensor: Sensor, autopilot: AutopilotName) -> MissionItem:
    """The waypoint, for PX4 with the heading to hold on the way to it if the scenario sets one."""
    if autopilot != "px4" or not isinstance(sensor, FrameCamera) or sensor.heading_deg is None:
        return item
    return replace(item, params=(*item.params[:3], sensor.heading_deg))


def start_pictures(distance_m: float) -> MissionItem:
    """Take a picture now and after every ``distance_m`` metres over ground."""
    return trigger_camera_every(distance_m)


def stop_pictures() -> MissionItem:
    """Stop taking pictures by distance."""
    return trigger_camera_every(0.0)
