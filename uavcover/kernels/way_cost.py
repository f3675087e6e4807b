"""What a way costs: metres or seconds, with wind, climbs and turns, and how far its waypoints are from the middle of the band."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.flight_time import Pace, leg_time, turn_time
from uavcover.kernels.jit import kernel
from uavcover.kernels.surface import Surface, height_above

LENGTH = 0
TIME = 1


class WayCost(NamedTuple):
    """What is to be made small.

    Attributes:
        unit: LENGTH, metres of the path, or TIME, seconds of flight.
        pace: of the vehicle.
        deviation_price: of a metre that a waypoint is above or below the middle of the band (Eq. 7), in that unit.
        middle_agl_m: the middle of the band.
    """

    unit: int
    pace: Pace
    deviation_price: float
    middle_agl_m: float


SHORTEST = WayCost(LENGTH, Pace(1.0, 1.0, 1.0), 0.0, 0.0)
"""Nothing but the length counts."""


@kernel
def leg_cost(way: WayCost, p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """Of the leg from p to q, without its ends."""
    if way.unit == TIME:
        return leg_time(way.pace, p, q)
    return math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@kernel
def turn_cost(
    way: WayCost, p: tuple[float, float, float], q: tuple[float, float, float], r: tuple[float, float, float]
) -> float:
    """Of the turn at q."""
    return turn_time(way.pace, p, q, r) if way.unit == TIME else 0.0


@kernel
def place_cost(surface: Surface, way: WayCost, p: tuple[float, float, float]) -> float:
    """Of a waypoint by itself."""
    if way.deviation_price == 0.0:
        return 0.0
    return way.deviation_price * abs(height_above(surface, p[0], p[1], p[2]) - way.middle_agl_m)


@kernel
def route_cost(surface: Surface, way: WayCost, route: NDArray[np.float64]) -> float:
    """Of an (n, 3) route: its legs, its turns and its waypoints."""
    total = 0.0
    for k in range(route.shape[0]):
        q = (route[k, 0], route[k, 1], route[k, 2])
        total += place_cost(surface, way, q)
        if k > 0:
            p = (route[k - 1, 0], route[k - 1, 1], route[k - 1, 2])
            total += leg_cost(way, p, q)
            if k < route.shape[0] - 1:
                total += turn_cost(way, p, q, (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2]))
    return total
