"""Lines from many places of a path, and their least height above ground."""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.extras.check.segments import Segment
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray, IntArray


def places_along(segment: Segment) -> FloatArray:
    """(n, 3) places of a segment, ``CHECKS.return_line_step_m`` apart or nearer."""
    line = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
    if len(line) < 2:
        return line
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(1, math.ceil(reached[-1] / CHECKS.return_line_step_m))
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
    """For lines of ``pieces`` (n,) pieces: the line number and the fraction 0..1 of each of their points, ends included."""
    ends = np.repeat(pieces, pieces + 1)
    owner = np.repeat(np.arange(len(pieces)), pieces + 1)
    begins = np.cumsum(pieces + 1) - (pieces + 1)
    k = np.arange(len(owner)) - begins[owner]
    return owner, np.where(k == ends, 1.0, k * (1.0 / ends))


def with_gaps(points_m: FloatArray, owner: IntArray) -> Lines:
    """Points (m, 3) of lines, by their numbers (m,) in order, as lines."""
    last = np.flatnonzero(np.diff(owner, append=-1)) + 1
    return Lines(np.insert(points_m, last, np.nan, axis=0), np.insert(owner, last, owner[last - 1]))


def lowest_of(world: World, lines: Lines) -> tuple[float, FloatArray, int]:
    """Least height above ground of some lines, its position, and the line number; infinite if no height is known."""
    points = lines.points_m
    if len(points) < 2:
        return math.inf, np.zeros(3), 0
    ranges = world.leg_height_ranges_m(points)
    if not np.isfinite(ranges[:, 0]).any():
        return math.inf, np.zeros(3), 0
    k = int(np.nanargmin(ranges[:, 0]))
    place = points[k] + ranges[k, 1] * (points[k + 1] - points[k])
    return float(ranges[k, 0]), place, int(lines.owner[k])
