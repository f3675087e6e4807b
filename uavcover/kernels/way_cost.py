"""What a way costs: metres or seconds, with wind, climbs and turns, and how far its waypoints are from the middle of the band."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.jit import kernel
from uavcover.kernels.surface import Surface, height_above

LENGTH = 0
TIME = 1


class Pace(NamedTuple):
    """How fast a vehicle gets along.

    Attributes:
        cruise_m_s: over ground, where wind and climb allow it.
        climb_m_s: largest speed up.
        descent_m_s: largest speed down.
        airspeed_m_s: largest speed through the air, above that of the wind; infinite: the wind is no matter.
        wind_east_m_s: where the wind blows to.
        wind_north_m_s: likewise.
        acceleration_m_s2: with which the velocity over ground changes at a waypoint; infinite: turns take no time.
    """

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float
    airspeed_m_s: float = math.inf
    wind_east_m_s: float = 0.0
    wind_north_m_s: float = 0.0
    acceleration_m_s2: float = math.inf


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
def speed_over_ground(pace: Pace, east: float, north: float) -> float:
    """Speed along a direction (unit vector): cruise speed, or what the wind leaves of the airspeed."""
    if pace.airspeed_m_s == math.inf:
        return pace.cruise_m_s
    along = pace.wind_east_m_s * east + pace.wind_north_m_s * north
    across = pace.wind_north_m_s * east - pace.wind_east_m_s * north
    return min(pace.cruise_m_s, along + math.sqrt(pace.airspeed_m_s**2 - across**2))


@kernel
def leg_time(pace: Pace, p: tuple[float, float, float], q: tuple[float, float, float]) -> float:
    """Seconds from p to q, without the turns at its ends: over ground, or longer where climbing limits it."""
    de, dn, du = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    horizontal = math.hypot(de, dn)
    vertical = du / pace.climb_m_s if du > 0.0 else -du / pace.descent_m_s
    if horizontal == 0.0:
        return vertical
    return max(horizontal / speed_over_ground(pace, de / horizontal, dn / horizontal), vertical)


@kernel
def turn_time(
    pace: Pace, p: tuple[float, float, float], q: tuple[float, float, float], r: tuple[float, float, float]
) -> float:
    """Seconds that the change of velocity over ground at q takes, more than flying on would: |change| / (2 acceleration).

    From v to a stop takes v / a for a way of v^2 / (2 a), which at full speed takes half of that.
    """
    if pace.acceleration_m_s2 == math.inf:
        return 0.0
    before, behind = leg_time(pace, p, q), leg_time(pace, q, r)
    east0, north0, east1, north1 = 0.0, 0.0, 0.0, 0.0
    if before > 0.0:
        east0, north0 = (q[0] - p[0]) / before, (q[1] - p[1]) / before
    if behind > 0.0:
        east1, north1 = (r[0] - q[0]) / behind, (r[1] - q[1]) / behind
    return math.hypot(east1 - east0, north1 - north0) / (2.0 * pace.acceleration_m_s2)


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


@kernel
def leg_times(pace: Pace, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n - 1,) seconds on each leg of an (n, 3) route, without turns."""
    out = np.zeros(max(route.shape[0] - 1, 0))
    for k in range(out.size):
        out[k] = leg_time(
            pace, (route[k, 0], route[k, 1], route[k, 2]), (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2])
        )
    return out


@kernel
def turn_times(pace: Pace, route: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) seconds that the turn at each waypoint of an (n, 3) route takes, 0 at its ends."""
    out = np.zeros(route.shape[0])
    for k in range(1, route.shape[0] - 1):
        out[k] = turn_time(
            pace,
            (route[k - 1, 0], route[k - 1, 1], route[k - 1, 2]),
            (route[k, 0], route[k, 1], route[k, 2]),
            (route[k + 1, 0], route[k + 1, 1], route[k + 1, 2]),
        )
    return out


@kernel
def flight_time(pace: Pace, route: NDArray[np.float64]) -> float:
    """Seconds along an (n, 3) route, turns included."""
    return float(leg_times(pace, route).sum() + turn_times(pace, route).sum())
