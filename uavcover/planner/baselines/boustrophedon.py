"""Boustrophedon routes, plain and tuned: the baselines for every planner.

For sensors that observe from waypoints the boustrophedon is rows of nodes, flown back and forth.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from uavcover.missions.objectives import Evaluation, evaluate_routes
from uavcover.model.route import Route
from uavcover.planner.baselines.swaths import (
    SwathLayout,
    edge_angles_rad,
    fly_layout,
    is_same_direction,
    long_side_angle_rad,
    regular_layout,
    width_across_m,
)
from uavcover.planner.encodings import allowed_band_m
from uavcover.planner.terrain_following import finite_heights, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap


@dataclass(frozen=True, slots=True)
class NodeRows:
    """A regular lattice of nodes over the box around the area, in rows from south to north."""

    rows: int  # how many
    columns: int  # nodes of a row
    # by how much of the distance between nodes every other row is shifted: 0, or 0.5 for a triangular lattice
    stagger: float
    height_share: float  # of the allowed height band at each node, 0..1


def fly_rows(site: Site, layout: NodeRows) -> Route:
    """The route over a lattice; nodes outside the fence are left out."""
    west, south, east, north = site.area.bounds
    dx, dy = (east - west) / layout.columns, (north - south) / layout.rows
    places = []
    for row in range(layout.rows):
        shift = layout.stagger * (0.5 if row % 2 else -0.5)
        x = west + dx * (np.arange(layout.columns) + 0.5 + shift)
        y = np.full(layout.columns, south + dy * (row + 0.5))
        places.append(np.column_stack([x, y])[:: -1 if row % 2 else 1])
    nodes = np.vstack(places)
    low, high = allowed_band_m(site, nodes)
    points = finite_heights(np.column_stack([nodes, low + layout.height_share * (high - low)]))
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        points = lay_over_terrain(site, points[:, :2], site.ground.heights_agl_m(points), tolerance_m=0.0)
    return Route(points)


def plain_rows(site: Site) -> NodeRows:
    """Adjacent squares, each seen whole from its centre, at the middle of the height band."""
    limits = site.scenario.limits
    height = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    side = math.sqrt(2.0) * max(site.scenario.sensor.half_width_m(height), site.scenario.area.cell_size_m)
    west, south, east, north = site.area.bounds
    rows, columns = (max(1, math.ceil(width / side - 1e-9)) for width in (north - south, east - west))
    return NodeRows(rows, columns, 0.0, 0.5)


def scanned_rows(site: Site, *, most_nodes: int) -> Iterator[NodeRows]:
    """Every rectangular and triangular lattice up to a number of nodes, at five heights.

    Cells are at most twice as long as wide.
    """
    west, south, east, north = site.area.bounds
    aspect = (east - west) / (north - south)
    for rows in range(1, most_nodes + 1):
        for columns in range(1, most_nodes // rows + 1):
            if 0.5 <= columns / (rows * aspect) <= 2.0:
                for stagger in (0.0, 0.5):
                    for height_share in (0.0, 0.25, 0.5, 0.75, 1.0):
                        yield NodeRows(rows, columns, stagger, height_share)


BOUSTROPHEDON = "boustrophedon"
TUNED = "boustrophedon-tuned"
PLAIN_TOLERANCE_M = 10.0
_TUNED_ANGLES = 6
_TUNED_EDGES = 4
"""Directions of edges that are tried besides, those with the most metres of border: lines along it leave no wedge beside it."""
_TUNED_INSETS = (0.0, 0.5)
_TUNED_LINES = (0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.75)


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """A route by a known method."""

    name: str  # the method
    route: Route  # its waypoints
    layout: SwathLayout | None  # the lines it is made of, if it is made of lines
    objectives: np.ndarray[tuple[int], np.dtype[np.float64]]  # (3,) values on the planner's cells
    violation: float  # total violation of the hard limits


def best_height_agl_m(site: Site, *, tolerance_m: float = PLAIN_TOLERANCE_M) -> float:
    """Height from which the sensor sees the widest strip of flat ground.

    It stays inside the planner's band by the tolerance of the straight legs: a leg that may leave its height both ways
    needs far fewer waypoints than one that is pressed against the ceiling.
    """
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    inner = min(tolerance_m, 0.5 * (high - low))
    heights = np.linspace(low + inner, high - inner, 41)
    reach = [site.scenario.sensor.half_width_m(float(height)) for height in heights]
    return float(heights[int(np.argmax(reach))])


def plain_boustrophedon(site: Site, *, angle_rad: float | None = None) -> SwathLayout:
    """Lines along the long side, or in a direction, at the height of the widest strip. On flat ground they do not overlap."""
    angle = long_side_angle_rad(site.area) if angle_rad is None else angle_rad
    height = best_height_agl_m(site)
    return regular_layout(
        angle_rad=angle,
        lines=_lines(site, angle, height, 1.0),
        height_agl_m=height,
        inset=0.0,
        tolerance_m=PLAIN_TOLERANCE_M,
    )


def boustrophedons(
    coverage: CoverageMap,  # on the planner's cells
    executor: Executor | None = None,  # evaluates routes side by side
    should_stop: Callable[[], bool] = lambda: False,  # asked between batches; the plain one is always there
    # taken from one after the other in place of the scan; what is left in it may be taken later
    tuned: Iterator[Baseline] | None = None,
) -> list[Baseline]:
    """The plain boustrophedon and a scan over direction, height, spacing and inset; the plain one first."""
    site = coverage.site
    found = _evaluate(coverage, BOUSTROPHEDON, [plain_boustrophedon(site)], executor)
    if tuned is not None:
        return found + taken(tuned, should_stop)
    for batch in _scan(site):
        if should_stop():
            break
        found += _evaluate(coverage, TUNED, batch, executor)
    return found


def taken(tuned: Iterator[Baseline], should_stop: Callable[[], bool]) -> list[Baseline]:
    """Routes until it is time to stop; asked before each."""
    found: list[Baseline] = []
    while not should_stop() and (each := next(tuned, None)) is not None:
        found.append(each)
    return found


def fewest_lines(
    coverage: CoverageMap, goal: float, *, turns: int = _TUNED_ANGLES + _TUNED_EDGES
) -> Iterator[Baseline]:
    """The tuned boustrophedon for one coverage: of every direction, height and inset the fewest lines that reach it.

    What cannot cost less than the best so far is left early, so the scan takes a fifth of what all spacings take, and single
    lines more or fewer are tried. The first ones are the most useful.

    Args:
        coverage: on the planner's cells.
        goal: share of the area, 0..1.
        turns: of how many directions, the one along the long side first; 1: along it alone.
    """
    site = coverage.site
    least, per_strip = math.inf, 1.0
    for height, inset, angle in _ways(site, turns):
        fewest, most = (_lines(site, angle, height, factor) for factor in (_TUNED_LINES[0], _TUNED_LINES[-1]))
        below, above, step = fewest - 1, most + 1, 1
        lines = min(max(_lines(site, angle, height, per_strip), fewest), most)
        while below < lines < above:
            layout = regular_layout(
                angle_rad=angle, lines=lines, height_agl_m=height, inset=inset, tolerance_m=PLAIN_TOLERANCE_M
            )
            each = _evaluate(coverage, TUNED, [layout], None)[0]
            yield each
            cost = float(each.objectives[2])
            if -float(each.objectives[0]) < goal:
                below = lines
                if cost >= least:
                    break
            else:
                above = lines
                if each.violation <= 0.0 and cost < least:
                    least, per_strip = cost, lines / _lines(site, angle, height, 1.0)
            if above > most:
                lines, step = min(below + step, most), 2 * step
            elif below < fewest:
                # Fewer lines cost less in proportion: only so few can be the best.
                cheaper = math.floor(lines * least / cost) if cost > least else above - step
                lines, step = max(min(cheaper, above - 1), fewest), 2 * step
            else:
                lines = (below + above) // 2


def _ways(site: Site, most: int) -> Iterator[tuple[float, float, float]]:
    """Heights above ground, insets and directions of tuned lines: along the long side and across it first."""
    for height, inset in itertools.product(_tuned_heights(site), reversed(_TUNED_INSETS)):
        for angle in directions_rad(site)[:most]:
            yield height, inset, angle


def directions_rad(site: Site) -> list[float]:
    """Directions of tuned lines: along the long side and across it first, then along edges, then the turns between."""
    base, half = long_side_angle_rad(site.area), _TUNED_ANGLES // 2
    along, across, *between = (
        base + k * math.pi / _TUNED_ANGLES for first in range(half) for k in (first, first + half)
    )
    edges = [
        each
        for each in edge_angles_rad(site.area)
        if not any(is_same_direction(each, other) for other in (along, across, *between))
    ]
    return [along, across, *edges[:_TUNED_EDGES], *between]


def _tuned_heights(site: Site) -> list[float]:
    """Heights above ground of tuned lines: the one of the widest strip and one between it and the middle of the band."""
    limits = site.scenario.limits
    best = best_height_agl_m(site)
    middle = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    return sorted({best, 0.5 * (best + middle)}, reverse=True)


def _scan(site: Site) -> Iterator[list[SwathLayout]]:
    heights = _tuned_heights(site)
    for angle in directions_rad(site):
        layouts: dict[tuple[int, float, float], SwathLayout] = {}
        for height in heights:
            for factor in _TUNED_LINES:
                for inset in _TUNED_INSETS:
                    lines = _lines(site, angle, height, factor)
                    layouts[lines, height, inset] = regular_layout(
                        angle_rad=angle, lines=lines, height_agl_m=height, inset=inset, tolerance_m=PLAIN_TOLERANCE_M
                    )
        yield list(layouts.values())


def _lines(site: Site, angle_rad: float, height_agl_m: float, factor: float) -> int:
    strip = 2.0 * max(site.scenario.sensor.half_width_m(height_agl_m), site.scenario.area.cell_size_m)
    return max(1, math.ceil(factor * width_across_m(site, angle_rad) / strip - 1e-9))


def _evaluate(
    coverage: CoverageMap, name: str, layouts: list[SwathLayout], executor: Executor | None
) -> list[Baseline]:
    found = evaluated(coverage, name, [fly_layout(coverage.site, layout) for layout in layouts], executor)
    return [dataclasses.replace(each, layout=layout) for each, layout in zip(found, layouts, strict=True)]


def evaluated(coverage: CoverageMap, name: str, routes: Sequence[Route], executor: Executor | None) -> list[Baseline]:
    """Evaluate routes made by a known method."""
    values: Evaluation = evaluate_routes(coverage, routes, executor)
    return [
        Baseline(name, route, None, values.objectives[i], float(values.violations[i].sum()))
        for i, route in enumerate(routes)
    ]
