"""Slices: parts that hold neighbouring lines of one route over the whole area, so that at first no seam costs anything.

Parts with lines of their own turn or overlap along every seam, and the ways from one part to the next are flown besides. A slice
has a few lines of a route that bends over the whole area; one behind the other the slices are that route.
"""

import dataclasses
import itertools
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.way_cost import route_cost
from uavcover.planning.baselines.adaptive_swaths import (
    BentLines,
    bend_lines,
    can_be_adapted,
    fly_tight,
    tight_layouts,
)
from uavcover.planning.baselines.swaths import SwathLayout, long_side_angle_rad, to_lines_frame
from uavcover.planning.search.tuning import TUNED
from uavcover.routes.leg_checks import measure_violations
from uavcover.routes.way_cost import way_cost_of
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_parts import Piece, polygons_of
from uavcover.sensing.coverage_map import CoverageMap

_FEWEST_LINES = 2
"""Of a slice: the search moves lines, and those of other slices stay."""
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
    """Slices of lines along the long side, in the order of the route.

    Args:
        site: the scenario on its ground.
        coarse: cells to find out what the routes see.
        goal: share of what can be covered that is asked for.
        count: how many.

    Returns:
        ``count`` slices; none where no lines keep the limits, or are enough for so many, or are over the area.
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
    """Of least cost among lines that keep the limits, with what they miss at its price; none where none does."""
    way, surface, margin_m = way_cost_of(site), site.ground.surface, site.scenario.limits.height_margin_m
    best: tuple[float, SwathLayout, BentLines] | None = None
    bent_as: dict[tuple[int, float], BentLines] = {}
    for layout in tight_layouts(site, long_side_angle_rad(site.area)):
        key = layout.heights_agl_m.size, layout.tolerance_m
        if key not in bent_as:
            bent_as[key] = bend_lines(site, layout)
        route_m = fly_tight(site, layout, bent_as[key]).waypoints_m
        if measure_violations(site, route_m, margin_m=margin_m).total > 0.0:
            continue
        missing = max(0.0, goal - coarse.share_of_coverable(coarse.seen(route_m)))
        merit = float(route_cost(surface, way, route_m)) * (1.0 + TUNED.goal.start_price * missing)
        if best is None or merit < best[0]:
            best = merit, layout, bent_as[key]
    return None if best is None else best[1:]


def _cuts(long_m: FloatArray, count: int) -> IntArray:
    """(count + 1,) numbers of the lines with which slices begin, and the end: as many metres in each, and enough lines.

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
