"""The cost model of a site, as numbers for the kernels."""

from uavcover.errors import InputError
from uavcover.kernels.energy import Power
from uavcover.kernels.way_cost import ENERGY, LENGTH, TIME, WayCost
from uavcover.model.vehicle import Vehicle
from uavcover.scenario.pace import pace_of
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m


def power_of(vehicle: Vehicle, *, gust_m_s: float = 0.0) -> Power:
    """A vehicle's power, as numbers for the kernels, in gusts of this standard deviation."""
    model = vehicle.power
    return Power(
        induced_m_s=model.induced_m_s,
        profile_share=model.profile_share,
        tip_m_s=model.tip_speed_m_s,
        drag_1_s=model.rotor_drag_1_s,
        drag_1_m=model.body_drag_1_m,
        idle_share=model.idle_share,
        descent_gain=model.descent_gain,
        gust_m_s=gust_m_s,
    )


_WAYPOINT_PRICE = 0.01
"""Default price of a waypoint, in radii of the sensor: of path, or of flight at cruise speed (docs/results/coverage.md)."""


def waypoint_price_of(site: Site) -> float:
    """Cost of a waypoint, in metres of path or in seconds, as the objective is: ``planner.waypoint_price`` or its default.

    The default grows with the sensor's footprint: a waypoint that a small sensor needs for its ground must not cost more than
    the path to it. A sensor that looks from the waypoints needs each, and every number of them is searched for by itself.
    """
    scenario = site.scenario
    if scenario.planner.waypoint_price is not None:
        return scenario.planner.waypoint_price
    if not scenario.sensor.looks_along_path:
        return 0.0
    middle_agl_m = 0.5 * (scenario.limits.min_height_agl_m + scenario.limits.max_height_agl_m)
    price_m = _WAYPOINT_PRICE * scenario.sensor.half_width_m(middle_agl_m)
    return price_m if scenario.objective == "length" else price_m / scenario.vehicle.cruise_speed_m_s


def way_cost_of(site: Site) -> WayCost:
    """The cost that the planner minimises beside coverage and the number of waypoints."""
    planner, limits = site.scenario.planner, site.scenario.limits
    objective = site.scenario.objective
    whole = objective in {"mission-time", "energy"}
    way = mission_cost_of(site) if whole else WayCost(LENGTH, pace_of(site), 0.0, 0.0)
    return way._replace(
        unit={"length": LENGTH, "energy": ENERGY}.get(objective, TIME),
        deviation_price=planner.band_deviation_price,
        middle_agl_m=0.5 * (limits.min_height_agl_m + limits.max_height_agl_m),
        waypoint_price=waypoint_price_of(site),
    )


def mission_cost_of(site: Site) -> WayCost:
    """Time and energy of the whole mission of a site with a home, by straight transits."""
    vehicle, home = site.scenario.vehicle, site.home_m
    if home is None:
        raise InputError(f"scenario {site.scenario.name} has no [home], so the flight time of a mission is unknown")
    return WayCost(
        unit=TIME,
        pace=pace_of(site),
        deviation_price=0.0,
        middle_agl_m=0.0,
        mission=1,
        column_top=(float(home[0]), float(home[1]), float(home[2]) + vehicle.takeoff_height_m),
        column_m=vehicle.takeoff_height_m,
        power=power_of(vehicle, gust_m_s=site.scenario.wind.gust_m_s),
        stop_at_first=0 if trigger_distance_m(site.scenario) is None else 1,
    )
