"""The cost model of a site, as numbers for the kernels."""

import math

from uavcover.kernels.way_cost import LENGTH, TIME, Pace, WayCost
from uavcover.scenario.site import Site


def pace_of(site: Site) -> Pace:
    """Speeds and acceleration of a site's vehicle in its wind."""
    vehicle, wind = site.scenario.vehicle, site.scenario.wind
    to_rad = math.radians(wind.from_deg + 180.0)
    return Pace(
        cruise_m_s=vehicle.cruise_speed_m_s,
        climb_m_s=vehicle.max_climb_m_s,
        descent_m_s=vehicle.max_descent_m_s,
        airspeed_m_s=math.inf if vehicle.max_airspeed_m_s is None else vehicle.max_airspeed_m_s,
        wind_east_m_s=wind.speed_m_s * math.sin(to_rad),
        wind_north_m_s=wind.speed_m_s * math.cos(to_rad),
        acceleration_m_s2=math.inf if vehicle.acceleration_m_s2 is None else vehicle.acceleration_m_s2,
    )


def way_cost_of(site: Site) -> WayCost:
    """The cost that the planner minimises beside coverage and waypoint count."""
    planner, limits = site.scenario.planner, site.scenario.limits
    return WayCost(
        unit=TIME if planner.objective == "flight-time" else LENGTH,
        pace=pace_of(site),
        deviation_price=planner.band_deviation_price,
        middle_agl_m=0.5 * (limits.min_height_agl_m + limits.max_height_agl_m),
    )
