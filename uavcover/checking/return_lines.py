"""Lines from many places of a path: the ways on which an autopilot returns, and the least height above ground of lines."""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.checking.aircraft import Aircraft, return_height_m
from uavcover.checking.segments import Segment
from uavcover.checking.world import World
from uavcover.kernels.arrays import FloatArray, IntArray

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
class Lines:
    """Many lines in one array, so that each question about them is asked once.

    Attributes:
        points_m: (m, 3) ENU; a row of NaN ends each line.
        owner: (m,) number of the line that a row belongs to.
    """

    points_m: FloatArray
    owner: IntArray

    def __add__(self, other: "Lines") -> "Lines":
        """Lines of both, those of the same number beside each other."""
        owner = np.concatenate([self.owner, other.owner])
        order = np.argsort(owner, kind="stable")
        return Lines(np.vstack([self.points_m, other.points_m])[order], owner[order])


def cut(pieces: IntArray) -> tuple[IntArray, FloatArray]:
    """For lines of so many pieces (n,): the number of the line and the share 0..1 of each of their points, ends included."""
    ends = np.repeat(pieces, pieces + 1)
    owner = np.repeat(np.arange(len(pieces)), pieces + 1)
    begins = np.cumsum(pieces + 1) - (pieces + 1)
    k = np.arange(len(owner)) - begins[owner]
    return owner, np.where(k == ends, 1.0, k * (1.0 / ends))


def with_gaps(points_m: FloatArray, owner: IntArray) -> Lines:
    """Points (m, 3) of lines, by their numbers (m,) in order, as lines."""
    last = np.flatnonzero(np.diff(owner, append=-1)) + 1
    return Lines(np.insert(points_m, last, np.nan, axis=0), np.insert(owner, last, owner[last - 1]))


@dataclass(frozen=True, eq=False, slots=True)
class ReturnWays:
    """The autopilot's own return from n places.

    Attributes:
        places_m: (n, 3) ENU.
        heights_m: (n,) above home, at which each ends.
        home: from above each place, or from the place for wings, to above home.
        columns: straight up at the place, straight down at home; empty for wings.
    """

    places_m: FloatArray
    heights_m: FloatArray
    home: Lines
    columns: Lines


def return_ways(world: World, places_m: FloatArray, alts_amsl_m: FloatArray, aircraft: Aircraft) -> ReturnWays:
    """What the autopilot flies when it is told to return: a multirotor straight up first, wings climb or descend on the way.

    Args:
        world: where home is.
        places_m: (n, 3) ENU, from where.
        alts_amsl_m: (n,) their heights above sea level.
        aircraft: who returns.
    """
    n, home_alt_m = len(places_m), world.home_alt_amsl_m
    distances_m = np.array([math.hypot(*place) for place in places_m[:, :2].tolist()])
    above_home_m = np.array([
        return_height_m(alt - home_alt_m, distance, aircraft)
        for alt, distance in zip(alts_amsl_m.tolist(), distances_m.tolist(), strict=True)
    ])  # fmt: skip
    heights_m = home_alt_m + above_home_m
    owner, t = cut(np.maximum(1, np.ceil(distances_m / PIECE_M)).astype(np.int64))
    line_alts_m = heights_m[owner]
    if aircraft.has_wings:  # climbs, or descends, on the way
        climbs = heights_m > alts_amsl_m
        slopes = np.where(climbs, aircraft.max_climb_m_s, aircraft.max_descent_m_s) / aircraft.cruise_speed_m_s
        change_m = np.minimum(slopes[owner] * (t * distances_m[owner]), np.abs(heights_m - alts_amsl_m)[owner])
        line_alts_m = alts_amsl_m[owner] + np.copysign(1.0, heights_m - alts_amsl_m)[owner] * change_m
    line_m = world.at_alts((1.0 - t)[:, None] * places_m[owner, :2], line_alts_m)
    home = with_gaps(line_m, owner)
    if aircraft.has_wings:
        return ReturnWays(places_m, above_home_m, home, Lines(np.empty((0, 3)), np.empty(0, dtype=np.int64)))
    last = np.cumsum(np.bincount(owner, minlength=n)) - 1
    first = np.concatenate([[0], last[:-1] + 1])
    columns = np.full((n, 6, 3), np.nan)  # up, a gap, down, a gap
    columns[:, 0], columns[:, 1] = places_m, line_m[first]
    columns[:, 3], columns[:, 4] = line_m[last], 0.0
    return ReturnWays(places_m, above_home_m, home, Lines(columns.reshape(-1, 3), np.repeat(np.arange(n), 6)))


def lowest_of(world: World, lines: Lines) -> tuple[float, FloatArray, int]:
    """The least height above ground of some lines, its place, and the number of the line; infinite where nothing is known."""
    points = lines.points_m
    if len(points) < 2:
        return math.inf, np.zeros(3), 0
    ranges = world.leg_height_ranges_m(points)
    if not np.isfinite(ranges[:, 0]).any():
        return math.inf, np.zeros(3), 0
    k = int(np.nanargmin(ranges[:, 0]))
    place = points[k] + ranges[k, 1] * (points[k + 1] - points[k])
    return float(ranges[k, 0]), place, int(lines.owner[k])
