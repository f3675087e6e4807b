"""Boustrophedon routes, plain and tuned: parallel lines over an area, the baselines of every planner.

For sensors that observe from waypoints, a boustrophedon consists of rows of nodes.
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
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, lay_over_terrain
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
    # how far the lines stop before the border of the area, as a fraction of the sensor's reach on flat ground
    inset: float
    tolerance_m: float  # how far the straight legs may leave the wanted height
    # which of the four ways to fly it: bit 0 begins at the other end of the first line, bit 1 with the last line
    start: int = 0
    # how far east and north all lines are moved, for a camera that looks at the ground beside them
    shift_m: tuple[float, float] = (0.0, 0.0)
    # whether a last line leads back to the first one across the ends of the others, which stop before it; four lines or any
    # other even number have one, odd numbers end on the other side
    returns: bool = False


def regular_layout(
    *, angle_rad: float, lines: int, height_agl_m: float, inset: float, tolerance_m: float, returns: bool = False
) -> SwathLayout:
    """Equal gaps, half of one at both borders, and one height: the plain boustrophedon."""
    gaps = np.ones(lines + 1)
    gaps[[0, -1]] = 0.5
    return SwathLayout(angle_rad, gaps, np.full(lines, height_agl_m), inset, tolerance_m, returns=returns)


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

    Each line covers the full extent of the area inside its strip. It crosses concave parts and holes. A strip without ground
    between two parts of an area has no line.
    """
    points_m, heights_m = join_lines(*_straight_lines(site, layout), layout)
    points_m = points_m @ to_lines_frame(layout.angle_rad) + layout.shift_m
    return Route(lay_over_terrain(site, points_m, heights_m, tolerance_m=layout.tolerance_m))


def begun_near_home(site: Site, layout: SwathLayout) -> SwathLayout:
    """The layout with the corner to begin at that gives the shortest transit on the map."""
    if site.home_m is None:
        return layout
    home_m, lines = site.home_m[:2], _straight_lines(site, layout)

    def length_m(start: int) -> float:
        points_m, _ = join_lines(*lines, dataclasses.replace(layout, start=start))
        ends_m = points_m[[0, -1]] @ to_lines_frame(layout.angle_rad) + layout.shift_m
        # Of two ways that are as long, rounding must not choose.
        return round(float(np.hypot(*(ends_m - home_m).T).sum()), 3)

    return dataclasses.replace(layout, start=min(range(4), key=length_m))


def with_return_line(site: Site, layout: SwathLayout) -> SwathLayout | None:
    """The layout with a return line; None without a home, or if its number of lines has none."""
    has_one = site.home_m is not None and _has_return_line(len(layout.heights_agl_m))
    return dataclasses.replace(layout, returns=True) if has_one else None


def _has_return_line(lines: int) -> bool:
    """Whether lines can return to their first one. Odd numbers end on the other side, and two lines return anyway."""
    return lines % 2 == 0 and lines >= _FEWEST_THAT_RETURN


def _straight_lines(site: Site, layout: SwathLayout) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """For :func:`join_lines`: straight lines, their heights above ground, and how far they stop before the borders."""
    across, west, east = line_extents(site, layout)
    flown = west <= east
    lines_m = np.stack([np.column_stack([ends, across])[flown] for ends in (west, east)], axis=1)
    heights_agl_m = layout.heights_agl_m[flown]
    reaches_m = [site.scenario.sensor.half_width_m(float(height)) for height in heights_agl_m]
    return list(lines_m), heights_agl_m, layout.inset * np.array(reaches_m)


def join_lines(
    lines_m: Sequence[FloatArray],  # each (n, 2) along and across, from one border of the area to the other
    heights_agl_m: FloatArray,  # (k,) of the lines
    insets_m: FloatArray,  # (k,) how far they stop before the borders
    layout: SwathLayout,  # where they begin, and whether they return
    *,
    straight_m: float = 0.0,  # how far lines may leave their places on the map to have fewer of them
) -> tuple[FloatArray, FloatArray]:
    """Lines flown one after the other: (m, 2) positions along and across, and (m,) heights above ground."""
    count = len(lines_m)
    returns = layout.returns and _has_return_line(count)
    apart_m = abs(lines_m[-1][0, 1] - lines_m[0][0, 1]) / max(count - 1, 1)
    order = range(count)[:: -1 if layout.start & 2 else 1]
    flown: list[FloatArray] = []
    return_lines: list[FloatArray] = []
    for position, k in enumerate(order):
        eastward = ((k + layout.start) % 2 == 0) != bool(layout.start & 2)
        begin_m = end_m = insets_m[k]
        if returns:
            # The return line lies half a gap from the border. It starts where the last line ends.
            inner = 0 < position < count - 1
            near_m = insets_m[k] + apart_m if inner else 0.5 * apart_m
            begin_m, end_m = (near_m, end_m) if position % 2 == 0 else (begin_m, near_m)
            if inner:
                line_m = _stopped(lines_m[k], 0.5 * apart_m, 0.5 * apart_m)
                return_lines.append(line_m[0 if eastward == (position % 2 == 0) else -1])
        line_m = _stopped(lines_m[k], *((begin_m, end_m) if eastward else (end_m, begin_m)))
        if straight_m > 0.0:
            line_m = shapely.get_coordinates(shapely.LineString(line_m).simplify(straight_m))
        flown.append(line_m if eastward else line_m[::-1])
    heights_m = np.repeat(heights_agl_m[list(order)], [len(line_m) for line_m in flown])
    if returns:
        last_m = shapely.LineString([flown[-1][-1], *return_lines[::-1]]).simplify(_BACK_STRAIGHT * apart_m)
        flown.append(shapely.get_coordinates(last_m)[1:])
        heights_m = np.append(heights_m, np.full(len(flown[-1]), heights_agl_m.mean()))
    return np.vstack(flown), heights_m


def _stopped(line_m: FloatArray, west_m: float, east_m: float) -> FloatArray:
    """A line that stops before its western and its eastern end, at most half a metre before its middle."""
    west, east = line_m[0, 0], line_m[-1, 0]
    most_m = max(0.0, 0.5 * (east - west) - 0.5)
    west, east = west + min(west_m, most_m), east - min(east_m, most_m)
    inner = line_m[(line_m[:, 0] > west) & (line_m[:, 0] < east), 0]
    along = np.concatenate([[west], inner, [east]])
    return np.column_stack([along, np.interp(along, line_m[:, 0], line_m[:, 1])])


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


BOUSTROPHEDON = "boustrophedon"
RETURNING = "boustrophedon-return"
_FEWEST_THAT_RETURN = 4
_BACK_STRAIGHT = 0.25
"""Of the distance between lines: a return line may pass beside their ends by this share."""

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
    """Height from which the sensor observes the widest strip of flat ground.

    It keeps the tolerance of the straight legs from both ends of the planner's band. A leg that may deviate upwards and downwards
    needs far fewer waypoints than one at the upper limit.
    """
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    inner = min(tolerance_m, 0.5 * (high - low))
    heights = np.linspace(low + inner, high - inner, 41)
    reach = [site.scenario.sensor.half_width_m(float(height)) for height in heights]
    return float(heights[int(np.argmax(reach))])


def plain_boustrophedon(site: Site, *, angle_rad: float | None = None) -> SwathLayout:
    """Lines at the height of the widest strip, along the long side or in a direction, begun near home.

    On flat ground they do not overlap.
    """
    angle = long_side_angle_rad(site.area) if angle_rad is None else angle_rad
    height = best_height_agl_m(site)
    lines = _lines(site, angle, height, 1.0)
    layout = regular_layout(
        angle_rad=angle, lines=lines, height_agl_m=height, inset=0.0, tolerance_m=PLAIN_TOLERANCE_M
    )  # fmt: skip
    return begun_near_home(site, layout)


def boustrophedons(
    coverage: CoverageMap,  # on the planner's cells
    executor: Executor | None = None,  # evaluates routes in parallel
    should_stop: Callable[[], bool] = lambda: False,  # called between batches; the plain one is always there
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
    """Routes until it is time to stop; called before each."""
    found: list[Baseline] = []
    while not should_stop() and (each := next(tuned, None)) is not None:
        found.append(each)
    return found


def fewest_lines(
    coverage: CoverageMap, goal: float, *, turns: int = _TUNED_ANGLES + _TUNED_EDGES
) -> Iterator[Baseline]:
    """The tuned boustrophedon for one coverage: the fewest lines that reach it, for every direction, height and inset.

    The scan stops early at lines that cannot cost less than the best so far, so it takes a fifth of a full scan and can try
    single lines more or fewer. The most useful lines come first.

    Args:
        coverage: on the planner's cells.
        goal: fraction of the area, 0..1.
        turns: number of directions, beginning with the long side; 1: only the long side.
    """
    site = coverage.site
    least, per_strip = math.inf, 1.0
    for height, inset, angle, returns in _variants(site, turns):
        unit = 2 if returns else 1
        fewest, most = (
            math.ceil(_lines(site, angle, height, factor) / unit) for factor in (_TUNED_LINES[0], _TUNED_LINES[-1])
        )
        fewest = max(fewest, _FEWEST_THAT_RETURN // 2) if returns else fewest
        below, above, step = fewest - 1, most + 1, 1
        count = min(max(math.ceil(_lines(site, angle, height, per_strip) / unit), fewest), most)
        while below < count < above:
            layout = regular_layout(
                angle_rad=angle, lines=unit * count, height_agl_m=height, inset=inset, tolerance_m=PLAIN_TOLERANCE_M,
                returns=returns,
            )  # fmt: skip
            each = _evaluate(coverage, TUNED, [layout], None)[0]
            yield each
            cost = float(each.objectives[2])
            if -float(each.objectives[0]) < goal:
                below = count
                if cost >= least:
                    break
            else:
                above = count
                if each.violation <= 0.0 and cost < least:
                    least, per_strip = cost, unit * count / _lines(site, angle, height, 1.0)
            if above > most:
                count, step = min(below + step, most), 2 * step
            elif below < fewest:
                # Fewer lines cost less in proportion: only so few can be the best.
                cheaper = math.floor(count * least / cost) if cost > least else above - step
                count, step = max(min(cheaper, above - 1), fewest), 2 * step
            else:
                count = (below + above) // 2


def _variants(site: Site, most: int) -> Iterator[tuple[float, float, float, bool]]:
    """Heights above ground, insets and directions of tuned lines: along the long side and across it first.

    With a home, lines with a return line follow those without one.
    """
    kinds = (False,) if site.home_m is None else (False, True)
    for height, inset in itertools.product(_tuned_heights(site), reversed(_TUNED_INSETS)):
        for angle, returns in itertools.product(directions_rad(site)[:most], kinds):
            yield height, inset, angle, returns


def directions_rad(site: Site) -> list[float]:
    """Directions of tuned lines: the long side, across it, the sides of photos and edges, then those in between."""
    base, half = long_side_angle_rad(site.area), _TUNED_ANGLES // 2
    along, across, *between = (
        base + k * math.pi / _TUNED_ANGLES for first in range(half) for k in (first, first + half)
    )
    heading_deg = site.scenario.sensor.heading_deg
    photo = [] if heading_deg is None else [angle_of_heading_rad(heading_deg + turn) for turn in (0.0, 90.0)]
    photo, edges = (
        [each for each in some if not any(is_same_direction(each, other) for other in (along, across, *between))]
        for some in (photo, edge_angles_rad(site.area))
    )
    return [along, across, *photo, *edges[:_TUNED_EDGES], *between]


def _tuned_heights(site: Site) -> list[float]:
    """Heights above ground of tuned lines: that of the widest strip, and one towards the middle of the band."""
    limits = site.scenario.limits
    best = best_height_agl_m(site)
    middle = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    return sorted({best, 0.5 * (best + middle)}, reverse=True)


def _scan(site: Site) -> Iterator[list[SwathLayout]]:
    heights = _tuned_heights(site)
    for angle in directions_rad(site):
        layouts: dict[tuple[int, float, float, bool], SwathLayout] = {}
        for height, factor, inset in itertools.product(heights, _TUNED_LINES, _TUNED_INSETS):
            fitting = _lines(site, angle, height, factor)
            for returns in (False,) if site.home_m is None else (False, True):
                lines = max(fitting + fitting % 2, _FEWEST_THAT_RETURN) if returns else fitting
                layouts[lines, height, inset, returns] = regular_layout(
                    angle_rad=angle, lines=lines, height_agl_m=height, inset=inset, tolerance_m=PLAIN_TOLERANCE_M,
                    returns=returns,
                )  # fmt: skip
        yield list(layouts.values())


def _lines(site: Site, angle_rad: float, height_agl_m: float, factor: float) -> int:
    strip = 2.0 * strip_half_width_m(site, angle_rad, height_agl_m)
    return max(1, math.ceil(factor * width_across_m(site, angle_rad) / strip - 1e-9))


def strip_half_width_m(site: Site, angle_rad: float, height_agl_m: float) -> float:
    """Half the swath width on flat ground along lines in a direction, a planning cell at least."""
    half_m = site.scenario.sensor.strip_half_width_m(height_agl_m, heading_of_angle_deg(angle_rad))
    return max(half_m, site.scenario.area.cell_size_m)


def _evaluate(
    coverage: CoverageMap, name: str, layouts: list[SwathLayout], executor: Executor | None
) -> list[Baseline]:
    begun = [begun_near_home(coverage.site, layout) for layout in layouts]
    found = evaluated(coverage, name, [fly_layout(coverage.site, layout) for layout in begun], executor)
    return [
        dataclasses.replace(each, layout=layout, name=RETURNING if layout.returns else name)
        for each, layout in zip(found, begun, strict=True)
    ]


def evaluated(coverage: CoverageMap, name: str, routes: Sequence[Route], executor: Executor | None) -> list[Baseline]:
    """Evaluate routes made by a known method."""
    values: Evaluation = evaluate_routes(coverage, routes, executor)
    return [
        Baseline(name, route, None, values.objectives[i], float(values.violations[i].sum()))
        for i, route in enumerate(routes)
    ]
