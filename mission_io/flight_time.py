"""How long a mission takes."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mission_io.errors import MisuseError
from mission_io.items import Command, Mission, MissionItem, SpeedType
from mission_io.legs import Leg, items_in_flying_order


@dataclass(frozen=True, slots=True)
class Performance:
    """How fast a vehicle flies when the mission says nothing else, in metres per second."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float

    def __post_init__(self) -> None:
        if not min(self.speed_m_s, self.climb_m_s, self.descent_m_s) > 0.0:
            raise MisuseError("speeds have to be above 0 m/s")


def flight_time_s(mission: Mission, legs: Iterable[Leg], performance: Performance) -> float:
    """The time of a mission's legs, holds, delays and loiters; infinite when it loiters or jumps for ever.

    Every leg takes what the slower of its way over ground and its climb takes: no acceleration, no wind, no turns, so
    it is less than a real flight takes. Speed changes count from the item after them, in jumps as they come.
    """
    ground_m_s, climb_m_s, descent_m_s = performance.speed_m_s, performance.climb_m_s, performance.descent_m_s
    todo = list(legs)[::-1]
    total_s = 0.0
    for number, item in items_in_flying_order(mission):
        while todo and todo[-1].item == number:
            leg = todo.pop()
            vertical_m_s = climb_m_s if leg.climb_m > 0.0 else descent_m_s
            total_s += max(leg.ground_m / ground_m_s, abs(leg.climb_m) / vertical_m_s)
        if item.command == Command.DO_CHANGE_SPEED and item.params[1] > 0.0:
            match item.params[0]:
                case SpeedType.CLIMB.value:
                    climb_m_s = item.params[1]
                case SpeedType.DESCENT.value:
                    descent_m_s = item.params[1]
                case _:
                    ground_m_s = item.params[1]
        total_s += _waiting_s(item, ground_m_s)
    return total_s


def bearing_deg(leg: Leg, fraction: float) -> float:
    """The course of a leg, clockwise from north, at its beginning (0) or its end (1)."""
    a, b = (0.0, 1e-4) if fraction < 0.5 else (1.0 - 1e-4, 1.0)
    (lat_a, lat_b), (lon_a, lon_b) = leg.places(np.array([a, b]))
    east = (lon_b - lon_a + 180.0) % 360.0 - 180.0
    return math.degrees(math.atan2(east * math.cos(math.radians(lat_a)), lat_b - lat_a)) % 360.0


def _waiting_s(item: MissionItem, speed_m_s: float) -> float:
    first, _, radius_m, _ = item.params
    if item.command == Command.NAV_LOITER_UNLIM or (item.command == Command.DO_JUMP and item.params[1] < 0):
        return math.inf
    if item.command == Command.NAV_LOITER_TURNS:
        return max(0.0, first) * 2.0 * math.pi * abs(radius_m) / speed_m_s
    if item.command in (Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_DELAY):
        return max(0.0, first) if math.isfinite(first) else 0.0
    return 0.0
