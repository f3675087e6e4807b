"""Sensors of a scenario as the plain numbers that kernels take."""

import math

from uavcover.kernels.coverage import CONE, DISC, MIDPOINT, NO_LINE_OF_SIGHT, RAY, SPHERE, Sight
from uavcover.model.sensor import DiscSensor, NadirCamera, Sensor, SphereSensor

_LINE_OF_SIGHT = {"ray": RAY, "midpoint": MIDPOINT}


def sight_of(sensor: Sensor) -> Sight:
    """What a sensor can see, for kernels."""
    match sensor:
        case SphereSensor():
            return Sight(SPHERE, sensor.range_m, 0.0, -1.0, _LINE_OF_SIGHT[sensor.line_of_sight])
        case DiscSensor():
            return Sight(DISC, sensor.radius_m, 0.0, -1.0, NO_LINE_OF_SIGHT)
        case NadirCamera():
            return Sight(
                CONE,
                sensor.range_m,
                math.tan(math.radians(sensor.fov_deg) / 2.0),
                math.cos(math.radians(sensor.max_incidence_deg)),
                _LINE_OF_SIGHT[sensor.line_of_sight],
            )


def farthest_m(sensor: Sensor) -> float:
    """No sensor sees a cell farther away than this, metres on the map."""
    return sensor.radius_m if isinstance(sensor, DiscSensor) else sensor.range_m


def reach_at_height_m(sensor: Sensor, height_agl_m: float) -> float:
    """Horizontal radius of flat ground that a sensor sees from a height; 0 when it does not reach the ground."""
    match sensor:
        case DiscSensor():
            return sensor.radius_m
        case SphereSensor():
            return math.sqrt(max(0.0, sensor.range_m**2 - height_agl_m**2))
        case NadirCamera():
            slant = math.sqrt(max(0.0, sensor.range_m**2 - height_agl_m**2))
            # On flat ground the incidence angle is the angle off the vertical.
            half_angle_deg = min(0.5 * sensor.fov_deg, sensor.max_incidence_deg)
            return min(slant, height_agl_m * math.tan(math.radians(half_angle_deg)))
