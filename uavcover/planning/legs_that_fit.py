"""Routes whose legs fit into one flight each: a leg that is too long for a battery, with the ways there and home, is halved."""

import numpy as np

from uavcover.kernels.arrays import IntArray
from uavcover.kernels.way_cost import FlightCosts, battery_s
from uavcover.model.route import Route
from uavcover.routes.flight_costs import flight_costs_along_transits
from uavcover.scenario.site import Site

_MOST_HALVINGS = 6
_SHORTEST_M = 20.0
"""A leg of less is not halved: what is too far away is not reached by shorter legs."""


def with_legs_that_fit(site: Site, route: Route) -> Route:
    """The route, or in its place the same line with waypoints on legs that no flight takes as a whole.

    Sorties are cut at waypoints. Where legs do not fit however short they are, and where a sensor looks from waypoints alone,
    the route as it is.

    Args:
        site: the scenario on its ground; of one vehicle, or of several that are alike.
        route: keeps the limits.
    """
    vehicle = site.scenario.vehicle
    looks_along = site.scenario.sensor.sensing == "along-path"
    if vehicle.endurance_s is None or site.home_m is None or site.frame is None or not looks_along:
        return route
    if site.scenario.vehicles or route.begins or len(route) < 2:
        return route
    points = route.waypoints_m
    for _ in range(_MOST_HALVINGS):
        long = _too_long(flight_costs_along_transits(site, Route(points), vehicle.autopilot, None))
        if long.size == 0:
            return route if len(points) == len(route) else Route(points)
        if (np.linalg.norm(points[long + 1] - points[long], axis=1) < _SHORTEST_M).any():
            return route
        points = np.insert(points, long + 1, 0.5 * (points[long] + points[long + 1]), axis=0)
    return route


def _too_long(costs: FlightCosts) -> IntArray:
    """Numbers of the waypoints at the beginnings of legs that take too long, or too much of a battery, to be flown alone."""
    legs = np.arange(len(costs.so_far_s) - 1)
    alone_s = costs.there_s[:-1] + np.diff(costs.so_far_s) + costs.back_s[1:]
    used_s = np.array([battery_s(costs.energies, int(leg), int(leg) + 1) for leg in legs])
    return np.flatnonzero((alone_s > costs.endurance_s) | (used_s > costs.energies.usable_s))
