"""Slices: parts that hold neighbouring lines of one route over the whole area, so that at first no seam costs anything.

Parts with lines of their own turn or overlap along every seam, and the ways from one part to the next are flown besides. A slice
has a few lines of a route that bends over the whole area; one behind the other the slices are that route.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.way_cost import route_cost
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.way_cost import way_cost_of
from uavcover.planner.baselines.adaptive_swaths import (
    TIGHT,
    BentLines,
    bend_lines,
    can_be_adapted,
    fly_tight,
    tight_layouts,
)
from uavcover.planner.baselines.swaths import SwathLayout, long_side_angle_rad, to_lines_frame
from uavcover.planner.search.tuning import TUNED
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_areas import Piece, polygons_of
from uavcover.sensing.coverage_map import CoverageMap

_SHARES = (1 / 32, *TIGHT)
"""Tolerances of legs to their height, as shares of the band.

On 10,000 km² with relief of 900 m the least is best: 119 lines in 11,875 km, where 1/16 takes 121 in 12,075.
"""
_FEWEST_LINES = 2
"""Fewest lines of a slice: the search moves lines, and those of other slices stay."""
_OVER_AREA = 0.8
"""Lines over the whole area cross what is between its parts; where they see less of the area than so much of what they could,
parts with lines of their own are better."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """A part with its lines.

    Attributes:
        area: of the part.
        begin_m: (n, 3) ENU along its lines.
    """

    area: Piece
    begin_m: FloatArray


def sliced(site: Site, coarse: CoverageMap, goal: float, count: int) -> list[Slice]:
    """Slices of lines along or across the long side, in the order of the route.

    Args:
        site: the scenario on its ground.
        coarse: cells to find out what the routes see.
        goal: required share of the coverable ground.
        count: how many.

    Returns:
        ``count`` slices; none where no lines keep the limits, or are enough for ``count``, or are over the area.
    """
    if not can_be_adapted(site):
        return []
    found = _best_lines(site, coarse, goal)
    if found is None:
        return []
    layout, bent = found
    long_m = bent.east_m - bent.west_m
    if len(long_m) < _FEWEST_LINES * count or site.area.area < _OVER_AREA * 2.0 * bent.reach_m * long_m.sum():
        return []
    cuts = _cuts(long_m, count)
    areas = _between_lines(site.area, layout.angle_rad, bent, cuts)
    if any(area.is_empty for area in areas):
        return []
    return [
        Slice(area, _fly(site, layout, bent, first, end))
        for area, first, end in zip(areas, cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)
    ]


def _best_lines(site: Site, coarse: CoverageMap, goal: float) -> tuple[SwathLayout, BentLines] | None:
    """Feasible lines of least cost, with their missing coverage at its price; None where none is feasible."""
    along_rad = long_side_angle_rad(site.area)
    found: list[_Lines] = []
    for angle_rad, share in itertools.product((along_rad, along_rad + 0.5 * math.pi), _SHARES):
        fitting = _lines(site, coarse, goal, tight_layouts(site, angle_rad, share=share, more=0))
        enough = max(each.seen for each in fitting) >= goal
        others = tight_layouts(site, angle_rad, share=share, more=-1 if enough else 1)
        found += fitting + _lines(site, coarse, goal, others)
    best = min(found, key=lambda each: each.merit)
    return None if math.isinf(best.merit) else (best.layout, best.bent)


class _Lines(NamedTuple):
    """Lines over the whole area, their coverage of the visible ground, and their cost; infinite outside limits."""

    layout: SwathLayout
    bent: BentLines
    seen: float
    merit: float


def _lines(site: Site, coarse: CoverageMap, goal: float, layouts: Sequence[SwathLayout]) -> list[_Lines]:
    """Lines of layouts that differ by their inset."""
    way, surface, margin_m = way_cost_of(site), site.ground.surface, site.scenario.limits.height_margin_m
    bent = bend_lines(site, layouts[0])
    found = []
    for layout in layouts:
        route_m = fly_tight(site, layout, bent).waypoints_m
        seen = coarse.share_of_coverable(coarse.seen(route_m))
        merit = TUNED.goal.start_cost(float(route_cost(surface, way, route_m)), goal - seen)
        broken = measure_violations(site, route_m, margin_m=margin_m).total > 0.0
        found.append(_Lines(layout, bent, seen, math.inf if broken else merit))
    return found


def _cuts(long_m: FloatArray, count: int) -> IntArray:
    """(count + 1,) numbers of the lines at which slices begin, and the end: equal metres in each, and enough lines.

    Args:
        long_m: (n,) of each line, in their order.
        count: of slices; n / _FEWEST_LINES at most.
    """
    so_far = np.concatenate([[0.0], np.cumsum(long_m)])
    cuts = np.searchsorted(so_far, so_far[-1] * np.arange(count + 1) / count - 1e-9 * so_far[-1])
    cuts[0], cuts[-1] = 0, len(long_m)
    for k in range(1, count):
        cuts[k] = max(cuts[k], cuts[k - 1] + _FEWEST_LINES)
    for k in range(count - 1, 0, -1):
        cuts[k] = min(cuts[k], cuts[k + 1] - _FEWEST_LINES)
    return np.asarray(cuts)


def _between_lines(area: Piece, angle_rad: float, bent: BentLines, cuts: IntArray) -> list[Piece]:
    """The area cut in the middle between the last line of a slice and the first one of the next."""
    corners = shapely.get_coordinates(area) @ to_lines_frame(angle_rad).T
    (west, south), (east, north) = corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0
    middles = bent.across_m.mean(axis=1)
    borders = [south, *(0.5 * (middles[cuts[1:-1] - 1] + middles[cuts[1:-1]])).tolist(), north]
    bands = [
        shapely.Polygon(np.array([(west, low), (east, low), (east, high), (west, high)]) @ to_lines_frame(angle_rad))
        for low, high in itertools.pairwise(borders)
    ]
    return [polygons_of(area.intersection(band)) for band in bands]


def _fly(site: Site, layout: SwathLayout, bent: BentLines, first: int, end: int) -> FloatArray:
    """(n, 3) along some of the lines, in the direction in which the whole route flies them."""
    own = dataclasses.replace(layout, start=layout.start ^ (first % 2))
    return fly_tight(site, own, bent.between(first, end)).waypoints_m
