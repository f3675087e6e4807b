"""Lines from many places of a path: the ways on which an autopilot returns, and the least height above ground of lines."""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.checking.aircraft import Aircraft, return_height_m
from uavcover.checking.segments import Segment
from uavcover.checking.world import World
from uavcover.kernels.arrays import FloatArray

STEP_M = 20.0
"""Lines begin at least this often along the path, and at every item."""
PIECE_M = 400.0
"""Longer lines are cut into such pieces, because the Earth is not flat."""


def places_along(segment: Segment) -> FloatArray:
    """(n, 3) places of a segment, ``STEP_M`` apart or nearer."""
    line = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
    if len(line) < 2:
        return line
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, math.ceil(reached[-1] / STEP_M))
    at = np.union1d(np.linspace(0.0, reached[-1], count + 1), reached if len(line) <= 3 else reached[[0, -1]])
    return np.column_stack([np.interp(at, reached, line[:, axis]) for axis in range(3)])


@dataclass(frozen=True, eq=False, slots=True)
class ReturnWay:
    """The autopilot's own return from a place.

    Attributes:
        place_m: (3,) ENU.
        height_m: above home, at which it ends.
        home_m: (n, 3) ENU from above the place, or from the place for wings, to above home.
        columns_m: (m, 3) ENU with a row of NaN between them: straight up at the place, straight down at home; empty for wings.
    """

    place_m: FloatArray
    height_m: float
    home_m: FloatArray
    columns_m: FloatArray


def return_way(world: World, place: FloatArray, alt_amsl_m: float, aircraft: Aircraft) -> ReturnWay:
    """What the autopilot flies when it is told to return: a multirotor straight up first, wings climb or descend on the way."""
    distance_m = math.hypot(place[0], place[1])
    home_m = world.home_alt_amsl_m
    above_home_m = return_height_m(alt_amsl_m - home_m, distance_m, aircraft)
    height_m = home_m + above_home_m
    pieces = max(1, math.ceil(distance_m / PIECE_M))
    t = np.linspace(0.0, 1.0, pieces + 1)
    heights = np.full(pieces + 1, height_m)
    if aircraft.has_wings:  # climbs, or descends, on the way
        reach = t * distance_m
        slope = (
            aircraft.max_climb_m_s if height_m > alt_amsl_m else aircraft.max_descent_m_s
        ) / aircraft.cruise_speed_m_s
        change = np.minimum(slope * reach, abs(height_m - alt_amsl_m))
        heights = alt_amsl_m + math.copysign(1.0, height_m - alt_amsl_m) * change
    line = world.at_alts((1.0 - t)[:, None] * place[:2], heights)
    if aircraft.has_wings:
        return ReturnWay(place, above_home_m, line, np.empty((0, 3)))
    columns = np.vstack([place, line[0], np.full(3, np.nan), line[-1], np.zeros(3)])
    return ReturnWay(place, above_home_m, line, columns)


def lowest_of(world: World, lines: list[FloatArray]) -> tuple[float, FloatArray, int]:
    """The least height above ground of some lines, its place, and the number of the line; infinite where nothing is known."""
    if not lines:
        return math.inf, np.zeros(3), 0
    gap = np.full((1, 3), np.nan)
    points = np.vstack([part for line in lines for part in (line, gap)])
    ranges = world.ground.leg_height_ranges_m(points)
    if not np.isfinite(ranges[:, 0]).any():
        return math.inf, np.zeros(3), 0
    k = int(np.nanargmin(ranges[:, 0]))
    begins = np.cumsum([0, *(len(line) + 1 for line in lines)])
    place = points[k] + ranges[k, 1] * (points[k + 1] - points[k])
    return float(ranges[k, 0]), place, int(np.searchsorted(begins, k, side="right")) - 1
