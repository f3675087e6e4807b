"""Parts as a chain: which way lines run in each, and where they begin, so that the ways between parts are short.

Lines that begin at any corner end at any other, and the way from one part to the next is then as long as a part. Lines
across a part end beside where they begin, or at the opposite corner, as their number is even or odd; with two directions and four
corners to begin at there nearly always is one that ends where the next part begins.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.tours import short_tour
from uavcover.model.route import Route
from uavcover.planning.baselines.adaptive_swaths import enough_lines
from uavcover.planning.baselines.swaths import line_corners, long_side_angle_rad
from uavcover.scenario.site import Site

_STARTS = range(4)
_CORNER = 0.3
"""A route ends at a corner where it ends so near to it, as a share of the diagonal of what it covers."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainedLines:
    """Lines over a part, by where they begin and end on the map.

    Attributes:
        angle_rad: their direction, counter-clockwise from east.
        start: which of the four ways to fly them, as in a layout of swaths.
        first_en: (2,) where they begin, east and north metres.
        last_en: (2,) where they end.
        length_m: of the lines and the ways from one to the next.
    """

    angle_rad: float
    start: int
    first_en: FloatArray
    last_en: FloatArray
    length_m: float

    def ends_alike(self, route: Route) -> bool:
        """Whether a route begins and ends at these corners of its part, and not at others."""
        ends_en = route.waypoints_m[[0, -1], :2]
        away_m = np.hypot(*(ends_en - [self.first_en, self.last_en]).T)
        across_m = float(np.hypot(*np.ptp(route.waypoints_m[:, :2], axis=0)))
        return bool(away_m.max() < _CORNER * across_m)


def chained(parts: Sequence[Site], goal: float) -> list[ChainedLines]:
    """For each part the lines that make the whole route short: lines and ways between parts, by dynamic programming.

    The order of the parts is that of a short tour through their middles.

    Args:
        parts: the site with the area of each.
        goal: share of the ground that is to be seen.
    """
    choices = [list(_lines_of(part, goal)) for part in parts]
    middles = np.array([[part.area.centroid.x, part.area.centroid.y, 0.0] for part in parts])
    order = short_tour(middles).tolist()
    costs = [each.length_m for each in choices[order[0]]]
    behind: list[list[int]] = []
    for before, part in itertools.pairwise(order):
        best: list[float] = []
        came: list[int] = []
        for each in choices[part]:
            ways = [cost + _way_m(earlier, each) for cost, earlier in zip(costs, choices[before], strict=True)]
            came.append(int(np.argmin(ways)))
            best.append(min(ways) + each.length_m)
        costs = best
        behind.append(came)
    picked = [int(np.argmin(costs))]
    for came in reversed(behind):
        picked.append(came[picked[-1]])
    chosen = dict(zip(order, reversed(picked), strict=True))
    return [each[chosen[number]] for number, each in enumerate(choices)]


def _way_m(one: ChainedLines, other: ChainedLines) -> float:
    return math.dist(one.last_en, other.first_en)


def _lines_of(part: Site, goal: float) -> Iterator[ChainedLines]:
    """As many lines as it takes, in two directions, begun at each of four corners."""
    first = long_side_angle_rad(part.area)
    for angle_rad in (first, first + 0.5 * math.pi):
        for start in _STARTS:
            corners_en = line_corners(part, enough_lines(part, angle_rad, goal, start=start))
            length_m = float(np.linalg.norm(np.diff(corners_en, axis=0), axis=1).sum())
            yield ChainedLines(angle_rad, start, corners_en[0], corners_en[-1], length_m)
