"""Boustrophedon routes, plain and tuned: the baselines for every planner, of parallel lines over an area.

For sensors that observe from waypoints the boustrophedon is rows of nodes, flown back and forth.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.objectives import Evaluation, evaluate_routes
from uavcover.model.route import Route
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, allowed_band_m, finite_heights, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

SAME_DIRECTION_RAD = math.radians(3.0)
"""Lines that differ by less are tried once."""


@dataclass(frozen=True, slots=True, eq=False)
class SwathLayout:
    """A boustrophedon over the area with its own gaps and heights."""

    angle_rad: float  # direction of the lines, counter-clockwise from east
    # (k + 1,) relative widths: before the first line, between lines, after the last. Half a gap at both ends.
    gaps: FloatArray
    heights_agl_m: FloatArray  # (k,) wanted height above ground of each line
    # how far the lines stop before the border of the area, as a share of the sensor's reach on flat ground
    inset: float
    tolerance_m: float  # how far the straight legs may leave the wanted height
    # which of the four ways to fly it: bit 0 begins at the other end of the first line, bit 1 with the last line
    start: int = 0
    # how far east and north all lines are moved, for a camera that looks at the ground beside them
    shift_m: tuple[float, float] = (0.0, 0.0)


def regular_layout(
    *, angle_rad: float, lines: int, height_agl_m: float, inset: float, tolerance_m: float, start: int = 0
) -> SwathLayout:
    """Equal gaps, half of one at both borders, and one height: the plain boustrophedon."""
    gaps = np.ones(lines + 1)
    gaps[[0, -1]] = 0.5
    return SwathLayout(angle_rad, gaps, np.full(lines, height_agl_m), inset, tolerance_m, start)


def angle_of_heading_rad(heading_deg: float) -> float:
    """Direction of lines counter-clockwise from east, -pi/2..pi/2, from a heading clockwise from north."""
    return math.remainder(math.radians(90.0 - heading_deg), math.pi)


def heading_of_angle_deg(angle_rad: float) -> float:
    """Heading of lines clockwise from north, 0 to below 180, from their direction counter-clockwise from east."""
    return (90.0 - math.degrees(angle_rad)) % 180.0


def long_side_angle_rad(area: shapely.Polygon | shapely.MultiPolygon) -> float:
    """Direction of the longer side of the smallest rectangle around an area, -pi/2..pi/2."""
    rectangle = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    sides = np.diff(rectangle, axis=0)[:2]
    east, north = sides[int(np.argmax(np.hypot(sides[:, 0], sides[:, 1])))]
    return math.remainder(math.atan2(north, east), math.pi)


def edge_angles_rad(area: shapely.Polygon | shapely.MultiPolygon) -> list[float]:
    """Directions of the edges of an area, -pi/2..pi/2, those with the most metres of border first.

    Edges whose directions differ by less than :data:`SAME_DIRECTION_RAD` count together, as the longest of them.
    """
    rings = [
        shapely.get_coordinates(ring) for part in shapely.get_parts(area) for ring in (part.exterior, *part.interiors)
    ]
    sides = np.vstack([np.diff(ring, axis=0) for ring in rings])
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    angles: list[float] = []
    metres: list[float] = []
    for side in np.argsort(-lengths, kind="stable").tolist():
        angle = math.remainder(math.atan2(sides[side, 1], sides[side, 0]), math.pi)
        near = [k for k, each in enumerate(angles) if is_same_direction(each, angle)]
        if near:
            metres[near[0]] += float(lengths[side])
        else:
            angles.append(angle)
            metres.append(float(lengths[side]))
    return [angles[k] for k in np.argsort(-np.array(metres), kind="stable").tolist()]


def is_same_direction(one_rad: float, other_rad: float) -> bool:
    """Whether two directions of lines, which have no front and back, nearly agree."""
    return abs(math.remainder(one_rad - other_rad, math.pi)) < SAME_DIRECTION_RAD


def width_across_m(site: Site, angle_rad: float) -> float:
    """Width of the area perpendicular to a direction, metres."""
    corners = shapely.get_coordinates(site.area.convex_hull)
    return float(np.ptp(corners @ np.array([-math.sin(angle_rad), math.cos(angle_rad)])))


def fly_layout(site: Site, layout: SwathLayout) -> Route:
    """The route of a layout, laid over the terrain.

    Each line runs over the whole extent of the area inside its strip. Concave areas and holes are flown across; a strip
    between two parts of an area that nothing lies in has no line.
    """
    to_lines = to_lines_frame(layout.angle_rad)
    borders, west_ends, east_ends = line_extents(site, layout)
    polyline: list[tuple[float, float]] = []
    wanted: list[float] = []
    for west, east, across, height_agl_m in zip(
        west_ends.tolist(), east_ends.tolist(), borders.tolist(), layout.heights_agl_m.tolist(), strict=True
    ):
        if west > east:
            continue
        inset = layout.inset * site.scenario.sensor.half_width_m(height_agl_m)
        # Never past the middle of the line.
        inset = min(inset, 0.5 * (east - west) - 0.5) if east - west > 1.0 else 0.0
        ends = [(west + inset, across), (east - inset, across)]
        polyline.extend(ends if len(polyline) % 4 == 0 else ends[::-1])
        wanted.extend([height_agl_m] * 2)
    points = np.array(polyline)
    heights = np.array(wanted)
    if layout.start & 1:
        # The other end of every line first.
        points = points.reshape(-1, 2, 2)[:, ::-1].reshape(-1, 2)
    if layout.start & 2:
        points, heights = points[::-1], heights[::-1]
    return Route(lay_over_terrain(site, points @ to_lines + layout.shift_m, heights, tolerance_m=layout.tolerance_m))


def to_lines_frame(angle_rad: float) -> FloatArray:
    """(2, 2) matrix M: M p is a point p along and across a direction, q M is a point q on the map."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, s], [-s, c]])


def area_edges(site: Site, angle_rad: float) -> FloatArray:
    """(n, 4) edges of the area, x1 y1 x2 y2 along and across a direction."""
    to_lines = to_lines_frame(angle_rad)
    rings = [shapely.get_coordinates(shapely.get_exterior_ring(part)) for part in shapely.get_parts(site.area)]
    return np.vstack([np.hstack([ring[:-1], ring[1:]]) for ring in (ring @ to_lines.T for ring in rings)])


def line_extents(site: Site, layout: SwathLayout) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Extents of lines: (k,) across, and (k,) first and last point of the area along each strip. Inf, -inf if empty."""
    edges = area_edges(site, layout.angle_rad)
    first, last = edges[:, 1].min(), edges[:, 1].max()
    borders = first + (last - first) * np.cumsum(layout.gaps)[:-1] / layout.gaps.sum()
    strips = np.concatenate([[first], 0.5 * (borders[1:] + borders[:-1]), [last]])
    extents = extents_between(edges, strips)
    return borders, extents[:, 0], extents[:, 1]


def extents_between(edges: FloatArray, strips: FloatArray) -> FloatArray:
    """Smallest and largest x (k, 2) of (n, 4) edges x1 y1 x2 y2 between (k + 1,) rising y. Inf, -inf for nothing."""
    x1, y1, x2, y2 = edges.T
    low, high = strips[:-1, None], strips[1:, None]
    dy = y2 - y1
    slanted = dy != 0.0
    run = np.where(slanted, dy, 1.0)
    t_low, t_high = (low - y1) / run, (high - y1) / run
    start = np.where(slanted, np.clip(np.minimum(t_low, t_high), 0.0, 1.0), 0.0)
    end = np.where(slanted, np.clip(np.maximum(t_low, t_high), 0.0, 1.0), 1.0)
    inside = np.where(slanted, start < end, (y1 >= low) & (y1 <= high))
    ends = np.stack([x1 + start * (x2 - x1), x1 + end * (x2 - x1)])
    west = np.where(inside, ends, np.inf).min(axis=(0, 2))
    east = np.where(inside, ends, -np.inf).max(axis=(0, 2))
    return np.column_stack([west, east])


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
