"""Kinematic limits of the vehicle, as numbers for the kernels."""

import math

from uavcover.kernels.flight_time import BLENDED, BRAKED, Pace
from uavcover.model.vehicle import AutopilotMotion, AutopilotName
from uavcover.scenario.site import Site


def pace_of(site: Site, autopilot: AutopilotName | None = None) -> Pace:
    """Speeds and motion of a site's vehicle in its wind, flown by this autopilot; default: the scenario's own."""
    vehicle, wind = site.scenario.vehicle, site.scenario.wind
    to_rad = math.radians(wind.from_deg + 180.0)
    return moving_pace(
        vehicle.motion(autopilot),
        cruise_m_s=vehicle.cruise_speed_m_s,
        climb_m_s=vehicle.max_climb_m_s,
        descent_m_s=vehicle.max_descent_m_s,
        airspeed_m_s=vehicle.max_airspeed_m_s,
        wind_m_s=(wind.speed_m_s * math.sin(to_rad), wind.speed_m_s * math.cos(to_rad)),
    )


def moving_pace(
    motion: AutopilotMotion,
    *,
    cruise_m_s: float,
    climb_m_s: float,
    descent_m_s: float,
    airspeed_m_s: float | None,
    wind_m_s: tuple[float, float],
) -> Pace:
    """Inputs of the flight time: the autopilot's motion, the speeds, and the wind towards east and north."""
    return Pace(
        cruise_m_s=cruise_m_s,
        climb_m_s=climb_m_s,
        descent_m_s=descent_m_s,
        airspeed_m_s=math.inf if airspeed_m_s is None else airspeed_m_s,
        wind_east_m_s=wind_m_s[0],
        wind_north_m_s=wind_m_s[1],
        acceleration_m_s2=motion.acceleration_m_s2,
        vertical_acceleration_m_s2=motion.vertical_acceleration_m_s2,
        jerk_m_s3=motion.jerk_m_s3,
        corner=BLENDED if motion.corner == "blended" else BRAKED,
        corner_radius_m=motion.corner_radius_m,
        smoothing_s=motion.smoothing_s,
        settling_s=motion.settling_s,
        settling_tc_s=motion.settling_tc_s,
        vertical_change_m_s=math.inf if motion.vertical_change_m_s is None else motion.vertical_change_m_s,
        takeoff_m_s=math.inf if motion.takeoff_m_s is None else motion.takeoff_m_s,
        takeoff_slow_m=motion.takeoff_slow_m,
        land_m_s=motion.land_m_s,
        land_slow_m=motion.land_slow_m,
        land_band_m=motion.land_band_m,
        yaw_rate_deg_s=motion.yaw_rate_deg_s,
        yaw_acceleration_deg_s2=math.inf if motion.yaw_acceleration_deg_s2 is None else motion.yaw_acceleration_deg_s2,
    )
