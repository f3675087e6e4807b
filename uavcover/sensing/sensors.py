"""Sensors of a scenario as plain numbers for the kernels, and their view of flat ground.

A new kind of sensor has its data in ``model/sensor.py``, its view in ``kernels/sight.py`` and its row here.

Also the direction of the camera for a flown attitude: gimbal, roll, pitch and yaw.
"""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.errors import ScenarioError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import CONE, DISC, FRUSTUM, MIDPOINT, NO_LINE_OF_SIGHT, RAY, SPHERE, Sight, horizontal_reach
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import Camera, DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor

_LINE_OF_SIGHT = {"ray": RAY, "midpoint": MIDPOINT}
_PICTURE_STEPS = 41
LONGEST_SPACING_M = 10.0
"""Spacing of observations along the path without a spacing in the scenario."""


def sight_of(sensor: Sensor) -> Sight:
    """The kernel's description of a sensor."""
    match sensor:
        case SphereSensor():
            return Sight(SPHERE, sensor.range_m, 0.0, -1.0, _LINE_OF_SIGHT[sensor.line_of_sight])
        case DiscSensor():
            return Sight(DISC, sensor.radius_m, 0.0, -1.0, NO_LINE_OF_SIGHT)
        case NadirCamera():
            return Sight(
                CONE,
                sensor.range_m,
                _tan_half(sensor.fov_deg),
                math.cos(math.radians(sensor.max_incidence_deg)),
                _LINE_OF_SIGHT[sensor.line_of_sight],
                sample_focal_m=_sample_focal_m(sensor),
            )
        case FrameCamera():
            off_nadir = math.radians(90.0 + sensor.pitch_deg)
            heading = math.nan if sensor.heading_deg is None else math.radians(sensor.heading_deg)
            return Sight(
                FRUSTUM,
                sensor.range_m,
                _tan_half(sensor.fov_across_deg) * (1.0 - sensor.side_overlap),
                math.cos(math.radians(sensor.max_incidence_deg)),
                _LINE_OF_SIGHT[sensor.line_of_sight],
                tan_half_along=_tan_half(sensor.fov_along_deg),
                cos_pitch=math.sin(off_nadir),
                sin_pitch=-math.cos(off_nadir),
                heading_e=math.sin(heading),
                heading_n=math.cos(heading),
                sample_focal_m=_sample_focal_m(sensor),
            )


def farthest_m(sensor: Sensor) -> float:
    """Upper bound on the horizontal distance of a visible cell, metres."""
    return sensor.radius_m if isinstance(sensor, DiscSensor) else sensor.range_m


def turns_with_legs(sight: Sight) -> bool:
    """Whether a sensor's view depends on the direction of the leg."""
    return sight.kind == FRUSTUM and math.isnan(sight.heading_e)


def whatever_heading(sight: Sight) -> Sight:
    """A sensor whose view contains this one's for every heading, used as a bound; itself if heading has no effect."""
    if not turns_with_legs(sight):
        return sight
    reach = horizontal_reach(sight)
    if reach >= sight.reach_m:
        return sight._replace(kind=SPHERE)
    return sight._replace(
        kind=CONE, tan_half_fov=reach / math.sqrt(sight.reach_m**2 - reach**2), sample_focal_m=math.inf
    )


def focal_px(sensor: Sensor) -> float:
    """Focal length of a camera in pixels; NaN when it is not known, or the sensor has none."""
    if not isinstance(sensor, Camera) or sensor.pixels_across is None:
        return math.nan
    across_deg = sensor.fov_deg if isinstance(sensor, NadirCamera) else sensor.fov_across_deg
    return sensor.pixels_across / (2.0 * _tan_half(across_deg))


def _tan_half(angle_deg: float) -> float:
    return math.tan(math.radians(angle_deg) / 2.0)


def _sample_focal_m(sensor: Camera) -> float:
    return math.inf if sensor.max_ground_sample_m is None else sensor.max_ground_sample_m * focal_px(sensor)


@dataclass(frozen=True, slots=True)
class FlatPicture:
    """Flat ground in view of a frame camera on a level vehicle: ``near_m`` to ``far_m`` ahead, negative is behind.

    Attributes:
        near_m: near end of the photo's middle line, ahead of the vehicle.
        far_m: far end of it.
        half_width_m: half the photo's width where it is widest, what an overlap leaves of it.
    """

    near_m: float
    far_m: float
    half_width_m: float


def flat_picture(sensor: FrameCamera, height_agl_m: float) -> FlatPicture | None:
    """Flat ground in view of a frame camera from a height; none when there is none."""
    sight = sight_of(sensor)
    off_nadir, half = math.radians(90.0 + sensor.pitch_deg), math.radians(0.5 * sensor.fov_along_deg)
    # On flat ground the incidence angle is the angle off the vertical, and "facing" the height.
    slant = min(sensor.range_m, height_agl_m / max(sight.cos_max_incidence, 1e-12))
    if slant <= height_agl_m:
        return None
    farthest = math.sqrt(slant**2 - height_agl_m**2)
    near = max(height_agl_m * math.tan(off_nadir - half), -farthest)
    far = farthest if off_nadir + half >= 0.5 * math.pi else min(height_agl_m * math.tan(off_nadir + half), farthest)
    deepest = (sight.sample_focal_m**2 * height_agl_m) ** (1.0 / 3.0)
    # Depth of a place x ahead: height cos(off nadir) + x sin(off nadir).
    if -sight.sin_pitch * height_agl_m + near * sight.cos_pitch > deepest:
        return None
    if sight.cos_pitch > 0.0:
        far = min(far, (deepest + sight.sin_pitch * height_agl_m) / sight.cos_pitch)
    if far <= near:
        return None
    ahead = np.linspace(near, far, _PICTURE_STEPS)
    depth = -sight.sin_pitch * height_agl_m + ahead * sight.cos_pitch
    width = np.minimum(sight.tan_half_fov * depth, np.sqrt(np.maximum(farthest**2 - ahead**2, 0.0)))
    return FlatPicture(near, far, float(width.max()))


def reach_at_height_m(sensor: Sensor, height_agl_m: float) -> float:
    """Half the swath width on flat ground from a height; 0 when the sensor does not reach the ground.

    A photo with a fixed heading is crossed in any direction, so half of its shorter side counts.
    """
    match sensor:
        case DiscSensor():
            return sensor.radius_m
        case SphereSensor():
            return math.sqrt(max(0.0, sensor.range_m**2 - height_agl_m**2))
        case NadirCamera():
            slant = math.sqrt(max(0.0, sensor.range_m**2 - height_agl_m**2))
            # On flat ground the incidence angle is the angle off the vertical.
            half_angle_deg = min(0.5 * sensor.fov_deg, sensor.max_incidence_deg)
            deepest = (sight_of(sensor).sample_focal_m ** 2 * height_agl_m) ** (1.0 / 3.0)
            radius = min(slant, height_agl_m * math.tan(math.radians(half_angle_deg)))
            return radius if height_agl_m <= deepest else 0.0
        case FrameCamera():
            picture = flat_picture(sensor, height_agl_m)
            if picture is None:
                return 0.0
            if sensor.heading_deg is None:
                return picture.half_width_m
            return min(picture.half_width_m, 0.5 * (picture.far_m - picture.near_m))


def sample_spacing_m(scenario: Scenario) -> float:
    """Distance between two observations along the path: the stated one, or one that suits the sensor's footprint.

    Between two circles of a swath a strip of its edge is not seen. Spaced by a third of the radius, they lose 1.4 % of its width
    at the worst place and 0.5 % on average.

    Raises:
        ScenarioError: the stated distance is larger than the radius, which loses 13 % and more.
    """
    sensor = scenario.sensor
    low, high = scenario.limits.min_height_agl_m, scenario.limits.max_height_agl_m
    # A camera sees least from the lowest height of the band, a sphere from the highest, which it need not reach.
    reaches = [_half_footprint_m(sensor, height) for height in (low, 0.5 * (low + high))]
    seeing = [reach for reach in reaches if reach > 0.0]
    stated = sensor.sample_spacing_m
    if not seeing:
        return LONGEST_SPACING_M if stated is None else stated
    reach_m = min(seeing)
    if stated is None:
        return min(LONGEST_SPACING_M, reach_m / 3.0)
    if stated > reach_m and sensor.sensing == "along-path" and trigger_distance_m(scenario) is None:
        raise ScenarioError(
            f"sensor.sample_spacing_m: {stated:g} m between observations leaves gaps where {reach_m:.3g} m are observed to each "
            f"side; omit it, or give at most {math.floor(100.0 * reach_m) / 100.0:g}"
        )
    return stated


def _half_footprint_m(sensor: Sensor, height_agl_m: float) -> float:
    """Half the swath width on flat ground, or half a photo's length along the path if that is shorter."""
    reach_m = reach_at_height_m(sensor, height_agl_m)
    picture = flat_picture(sensor, height_agl_m) if isinstance(sensor, FrameCamera) else None
    return reach_m if picture is None else min(reach_m, 0.5 * (picture.far_m - picture.near_m))


def trigger_distance_m(scenario: Scenario) -> float | None:
    """Distance between two photos; none when the scenario does not take photos by distance.

    With a forward overlap it is computed at the lowest height of the band, where a photo shows least.

    Raises:
        ScenarioError: from there it shows nothing.
    """
    sensor = scenario.sensor
    if not isinstance(sensor, FrameCamera):
        return None
    if sensor.forward_overlap is None:
        return sensor.trigger_distance_m
    lowest_m = scenario.limits.min_height_agl_m
    picture = flat_picture(sensor, lowest_m)
    if picture is None:
        raise ScenarioError(
            f"sensor.forward_overlap: from limits.min_height_agl_m = {lowest_m:g} m no flat ground is in the photo, close and "
            "steep enough; give another pitch_deg, range_m or max_ground_sample_m"
        )
    return (1.0 - sensor.forward_overlap) * (picture.far_m - picture.near_m)


@dataclass(frozen=True, slots=True, eq=False)
class CameraTurn:
    """Directions of a camera, one row for each observation.

    Attributes:
        axes: (k, 3) unit vectors in ENU along the viewing direction.
        tops: (k, 3) unit vectors perpendicular to them, towards the top of the photo.
        known: (k,) whether the required attitude is known; otherwise level and nose ahead are assumed.
    """

    axes: FloatArray
    tops: FloatArray
    known: BoolArray


def camera_turn(sensor: Sensor, attitude_deg: FloatArray, courses_deg: FloatArray | None = None) -> CameraTurn:
    """Camera directions for the attitudes of its vehicle.

    A fixed camera shares the vehicle's roll, pitch and yaw. A stabilised one is level; the top of its photo keeps the
    scenario's heading, or follows the vehicle's yaw. Other sensors point straight down.

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
        # A circular nadir view needs no heading.
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
