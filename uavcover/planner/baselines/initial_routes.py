"""Constructed routes by name: starting points of the search, and baselines for its result."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.sight import horizontal_reach
from uavcover.model.route import Route
from uavcover.model.scenario import InitialRoute, PlannerSettings
from uavcover.planner.baselines.boustrophedon import (
    TUNED,
    Baseline,
    angle_of_heading_rad,
    best_height_agl_m,
    boustrophedons,
    directions_rad,
    evaluated,
    to_lines_frame,
)
from uavcover.planner.baselines.contour_lines import contour_lines
from uavcover.planner.set_cover import (
    Candidates,
    Reduced,
    cut_down,
    finest_lattice_candidates,
    greedy_cover,
    level_candidates,
    reduce,
    searched_cover,
    thinned,
    tour_route,
)
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, allowed_band_m, finite_heights, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

_SPACING_CELLS = 0.25
_MOST_POSITIONS = 60_000
"""Lattice points for sensing at waypoints: a finer lattice needs fewer waypoints for full coverage (docs/results/coverage.md)."""

_MOST_PAIRS = 30e6
"""Places by the cells in their reach: about 20 s of processor time. Where that is more there are no more places than cells."""

_FIRST_POSITIONS, _FINER, _LONGER = 1_000, 8, 5.0
"""Under a time budget so few places come first, then lattices of half the spacing, while there is time for them."""

_SPACING_REACHES = 0.4
"""Lattice spacing for sensing along the path, which covers more than its waypoints do."""

NODE_LINES = "node-lines"
_THINNER, _DIRECTIONS = (1.0, 1.07, 1.15, 1.25, 1.4), 2
"""Multiples of the distances of nodes that leave no gap on flat ground, and directions of lines."""

_STEPS, _FEW_STEPS = 20_000, 1_000
"""Exchanges of a searched cover; few where no time is left."""
_ROWS_AT_ONCE = 50
_STREAM = 2


def constructed_routes(
    coverage: CoverageMap,  # on the planner's cells
    settings: PlannerSettings,  # which, and the seed
    *,
    required: float | None,  # required coverage of the visible ground, if any
    executor: Executor | None,  # evaluates routes in parallel
    # time left, called before each; the plain lines of each kind are always made, and coarse covers. Infinite: no limit.
    left_s: Callable[[], float],
    # lines in swaths that are taken in place of a scan, until it is time to stop
    tuned: Iterator[Baseline] | None = None,
) -> list[Baseline]:
    """The routes that ``settings.initial`` names, the plain boustrophedon first.

    With the encoding "swaths", lines are always included, because the encoding is centred on the best of them.
    """
    names, sensor = initial_names(coverage, settings), coverage.site.scenario.sensor
    found: list[Baseline] = []

    def should_stop() -> bool:
        return left_s() <= 0.0

    if "boustrophedon" in names:
        if settings.encoding == "swaths":
            found += boustrophedons(coverage, executor, should_stop, tuned)
            if not sensor.looks_along_path and coverage.site.scenario.limits.applies_to == "legs":
                found += _node_lines(coverage, should_stop)
        else:
            found += _rows(coverage, settings, executor, should_stop)
    if "contour-lines" in names:
        found += contour_lines(coverage, executor, should_stop)
    covers: list[InitialRoute] = [name for name in names if name not in {"boustrophedon", "contour-lines"}]
    if covers:
        for name, route in _cover_routes(coverage, covers, settings, 1.0 if required is None else required, left_s):
            found += evaluated(coverage, name, [route], executor)
    return found


def _cover_routes(
    coverage: CoverageMap,
    names: Sequence[InitialRoute],
    settings: PlannerSettings,
    required: float,
    left_s: Callable[[], float],
) -> list[tuple[InitialRoute, Route]]:
    """Routes of set covers on the finest lattice for which there is time, at least on a coarse one.

    Lines suit a sensor that observes at waypoints badly: they observe 81 % of a canyon, a coarse cover all of it.
    """
    most = _most_positions(coverage)
    count = most if math.isinf(left_s()) else min(_FIRST_POSITIONS, most)
    while True:
        before_s = left_s()
        candidates = _candidates(coverage, count)
        reduced = reduce(candidates)
        steps = _STEPS if before_s > 0.0 else _FEW_STEPS
        made = [
            (name, route)
            for name in names
            for route in _cover_routes_on(coverage, candidates, reduced, name, settings, required, steps)
        ]
        used_s = before_s - left_s()
        if count >= most or (made and _LONGER * used_s > left_s()):
            return made
        count = min(most, _FINER * count)


def _rows(
    coverage: CoverageMap, settings: PlannerSettings, executor: Executor | None, should_stop: Callable[[], bool]
) -> list[Baseline]:
    """The boustrophedon of free waypoints: rows of nodes, the plain ones first, then all within the encoding's capacity."""
    site = coverage.site
    found = evaluated(coverage, "boustrophedon", [fly_rows(site, plain_rows(site))], executor)
    scan = scanned_rows(site, most_nodes=settings.capacity)
    while (batch := [fly_rows(site, rows) for rows in islice(scan, _ROWS_AT_ONCE)]) and not should_stop():
        found += evaluated(coverage, TUNED, batch, executor)
    return found


def initial_names(coverage: CoverageMap, settings: PlannerSettings) -> Sequence[InitialRoute]:
    """The names in ``settings.initial``, or the defaults.

    Lines for swaths. A local search begins with lines too where it senses along the path (where energy is minimised, with lines
    along contours as well), and with a set cover where it senses at waypoints. A plain optimizer of waypoints samples all of its
    first population, as the paper's does.
    """
    lines: tuple[InitialRoute, ...] = ("boustrophedon",) if settings.encoding == "swaths" else ()
    if settings.initial is not None:
        return tuple(dict.fromkeys((*lines, *settings.initial)))
    if settings.algorithm not in {"memetic", "local-search"}:
        return lines
    if not coverage.site.scenario.sensor.looks_along_path:
        return (*lines, "set-cover")
    if coverage.site.scenario.objective == "energy":
        return ("boustrophedon", "contour-lines")
    return ("boustrophedon",)


def _most_positions(coverage: CoverageMap) -> int:
    if coverage.site.scenario.sensor.looks_along_path:
        return 1  # of any number there is one lattice
    cells_each = math.pi * (horizontal_reach(coverage.sight) / coverage.grid.cells.size_m) ** 2
    return int(min(_MOST_POSITIONS, max(_MOST_PAIRS / max(cells_each, 1.0), coverage.grid.count)))


def _candidates(coverage: CoverageMap, most: int) -> Candidates:
    site = coverage.site
    if not site.scenario.sensor.looks_along_path:
        spacing_m = _SPACING_CELLS * coverage.grid.cells.size_m
        return finest_lattice_candidates(coverage, spacing_m=spacing_m, most=most)
    height_agl_m = best_height_agl_m(site)
    reach_m = max(site.scenario.sensor.half_width_m(height_agl_m), coverage.grid.cells.size_m)
    return level_candidates(coverage, spacing_m=_SPACING_REACHES * reach_m, height_agl_m=height_agl_m)


def _cover_routes_on(
    coverage: CoverageMap,
    candidates: Candidates,
    reduced: Reduced,
    name: InitialRoute,
    settings: PlannerSettings,
    required: float,
    steps: int,
) -> list[Route]:
    """The route of one set cover, and that of the part of it which reaches the required coverage."""
    if name == "greedy-set-cover":
        chosen = greedy_cover(reduced, required)
    else:
        chosen = searched_cover(reduced, steps=steps, rng=np.random.default_rng([settings.seed, _STREAM]))
    if settings.encoding == "waypoints":
        chosen = cut_down(candidates, chosen, settings.capacity)
    kinds = {each.size: each for each in (chosen, thinned(candidates, chosen, required)) if each.size > 0}
    return [
        tour_route(coverage.site, candidates.positions_m[each], tolerance_m=PLAIN_TOLERANCE_M)
        for each in kinds.values()
    ]


def _node_lines(coverage: CoverageMap, should_stop: Callable[[], bool]) -> list[Baseline]:
    """The lines of nodes evaluated, the closest ones first; the first one in any time."""
    found: list[Baseline] = []
    for route in node_lines(coverage.site):
        found += evaluated(coverage, NODE_LINES, [route], None)
        if should_stop():
            break
    return found


def node_lines(site: Site) -> Iterator[Route]:
    """Routes of nodes in lines over the area: first those that observe all of flat ground, then sparser ones.

    Each is flown line by line, begun near home, and as a short tour. Lines of photos with a fixed heading run along the sides of
    the photos, one photo width apart.
    """
    height_agl_m, known = best_height_agl_m(site), set[bytes]()
    for thinner in _THINNER:
        for lattice in _lattices(site, height_agl_m):
            lines = _nodes(site, lattice, thinner)
            nodes = np.vstack(lines)
            if nodes.tobytes() in known:
                continue
            known.add(nodes.tobytes())
            by_line = _line_by_line(site, lines)
            heights = np.full(len(by_line), height_agl_m)
            yield Route(lay_over_terrain(site, by_line, heights, tolerance_m=PLAIN_TOLERANCE_M))
            positions = finite_heights(np.column_stack([nodes, site.ground.ups_m(nodes, height_agl_m)]))
            yield tour_route(site, positions, tolerance_m=PLAIN_TOLERANCE_M)


@dataclass(frozen=True, slots=True)
class _Lattice:
    """Distances of nodes that observe all of flat ground."""

    angle_rad: float  # direction of the lines, counter-clockwise from east
    apart_m: float  # of the lines
    spacing_m: float  # of the nodes on a line
    staggered: bool = False  # whether every other line is shifted by half of that
    shift_m: tuple[float, float] = (0.0, 0.0)  # east and north, for a camera that looks at the ground beside them


def _lattices(site: Site, height_agl_m: float) -> list[_Lattice]:
    """Lattices for flat ground; where several looks are required, the nodes of a line are closer together, or the lines."""
    required = site.scenario.requirements
    found = _lattices_for_one_look(site, height_agl_m)
    if required.looks == 1:
        return found
    apart_m = required.look_distance_m or 0.0
    return [
        replace(each, spacing_m=each.spacing_m / required.looks)
        if each.spacing_m >= required.looks * apart_m
        else replace(each, apart_m=each.apart_m / required.looks)
        for each in found
    ]


def _lattices_for_one_look(site: Site, height_agl_m: float) -> list[_Lattice]:
    sensor = site.scenario.sensor
    photo = sensor.flat_photo(height_agl_m)
    if photo is None or sensor.heading_deg is None:
        reach_m = max(sensor.half_width_m(height_agl_m), site.scenario.area.cell_size_m)
        square_m, triangle_m = math.sqrt(2.0) * reach_m, math.sqrt(3.0) * reach_m
        kinds = ((square_m, square_m, False), (1.5 * reach_m, triangle_m, True))
        return [_Lattice(angle, *kind) for angle in directions_rad(site)[:_DIRECTIONS] for kind in kinds]
    width_m, length_m = 2.0 * photo.half_width_m, photo.length_m
    along, ahead_m = angle_of_heading_rad(sensor.heading_deg), 0.5 * (photo.near_m + photo.far_m)
    heading = math.radians(sensor.heading_deg)
    shift_m = (-ahead_m * math.sin(heading), -ahead_m * math.cos(heading))
    return [
        _Lattice(along, width_m, length_m, shift_m=shift_m),
        _Lattice(along + 0.5 * math.pi, length_m, width_m, shift_m=shift_m),
    ]


def _nodes(site: Site, lattice: _Lattice, thinner: float) -> list[FloatArray]:
    """(k, 2) nodes of each line, evenly spaced over the part of the area in its strip."""
    turn = to_lines_frame(lattice.angle_rad)
    area = shapely.transform(site.area, lambda positions: positions @ turn.T)
    west, south, east, north = area.bounds
    borders = np.linspace(south, north, math.ceil((north - south) / (thinner * lattice.apart_m) - 1e-9) + 1)
    lines = []
    for number, (low, high) in enumerate(pairwise(borders.tolist())):
        parts = shapely.get_parts(shapely.intersection(area, shapely.box(west, low, east, high)))
        along = []
        for begin, _, end, _ in sorted(shapely.bounds(parts[shapely.area(parts) > 0.0]).tolist()):
            count = max(1, math.ceil((end - begin) / (thinner * lattice.spacing_m) - 1e-9))
            fractions = (np.arange(count) + 0.5) / count
            if lattice.staggered and number % 2 == 1:
                fractions = np.arange(count + 1) / count
            along.append(begin + (end - begin) * fractions)
        if along:
            positions = np.concatenate(along)
            lines.append(
                np.column_stack([positions, np.full(len(positions), 0.5 * (low + high))]) @ turn + lattice.shift_m
            )
    return lines


def _line_by_line(site: Site, lines: Sequence[FloatArray]) -> FloatArray:
    """(n, 2) nodes back and forth, begun at the corner whose ends are nearest to home, or to the origin without a home."""
    home_m = np.zeros(2) if site.home_m is None else site.home_m[:2]
    paths = [
        np.vstack([line[:: -1 if (k + first) % 2 else 1] for k, line in enumerate(lines[::order])])
        for order in (1, -1)
        for first in (0, 1)
    ]
    # Of two ways that are as long, rounding must not choose.
    return min(paths, key=lambda path_m: round(float(np.hypot(*(path_m[[0, -1]] - home_m).T).sum()), 3))


@dataclass(frozen=True, slots=True)
class NodeRows:
    """A regular lattice of nodes over the box around the area, in rows from south to north."""

    rows: int  # how many
    columns: int  # nodes of a row
    # by how much of the distance between nodes every other row is shifted: 0, or 0.5 for a triangular lattice
    stagger: float
    height_fraction: float  # of the allowed height band at each node, 0..1


def fly_rows(site: Site, layout: NodeRows) -> Route:
    """The route over a lattice; nodes outside the fence are omitted."""
    west, south, east, north = site.area.bounds
    dx, dy = (east - west) / layout.columns, (north - south) / layout.rows
    positions = []
    for row in range(layout.rows):
        shift = layout.stagger * (0.5 if row % 2 else -0.5)
        x = west + dx * (np.arange(layout.columns) + 0.5 + shift)
        y = np.full(layout.columns, south + dy * (row + 0.5))
        positions.append(np.column_stack([x, y])[:: -1 if row % 2 else 1])
    nodes = np.vstack(positions)
    low, high = allowed_band_m(site, nodes)
    points = finite_heights(np.column_stack([nodes, low + layout.height_fraction * (high - low)]))
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        points = lay_over_terrain(site, points[:, :2], site.ground.heights_agl_m(points), tolerance_m=0.0)
    return Route(points)


def plain_rows(site: Site) -> NodeRows:
    """Adjacent squares, each observed whole from its centre, at the middle of the height band."""
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
                    for height_fraction in (0.0, 0.25, 0.5, 0.75, 1.0):
                        yield NodeRows(rows, columns, stagger, height_fraction)
