"""Constructed routes by name: starting points of the search, and baselines for its result."""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import islice

import numpy as np

from uavcover.kernels.sight import horizontal_reach
from uavcover.model.route import Route
from uavcover.model.scenario import InitialRoute, PlannerSettings
from uavcover.planner.baselines.boustrophedon import (
    TUNED,
    Baseline,
    best_height_agl_m,
    boustrophedons,
    evaluated,
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
    tour_route,
)
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, allowed_band_m, finite_heights, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

_SPACING_CELLS = 0.25
_MOST_PLACES = 60_000
"""Lattice points for sensing at waypoints: a finer lattice needs fewer waypoints for full coverage (docs/results/coverage.md)."""

_MOST_PAIRS = 30e6
"""Places by the cells in their reach: about 20 s of processor time. Where that is more there are no more places than cells."""

_FIRST_PLACES, _FINER, _LONGER = 1_000, 8, 5.0
"""Under a time budget so few places come first, then lattices of half the spacing, while there is time for them."""

_SPACING_REACHES = 0.4
"""Lattice spacing for sensing along the path, which covers more than its waypoints do."""

_STEPS, _FEW_STEPS = 20_000, 1_000
"""Exchanges of a searched cover; few where no time is left."""
_ROWS_AT_ONCE = 50
_STREAM = 2


def constructed_routes(
    coverage: CoverageMap,  # on the planner's cells
    settings: PlannerSettings,  # which, and the seed
    *,
    asked: float | None,  # share of what can be covered that the selection rule asks for, if it does
    executor: Executor | None,  # evaluates routes side by side
    # time left, asked before each; the plain lines of each kind are always made, and coarse covers. Infinite: no limit.
    left_s: Callable[[], float],
    # lines in swaths that are taken in place of a scan, until it is time to stop
    tuned: Iterator[Baseline] | None = None,
) -> list[Baseline]:
    """The routes that ``settings.initial`` names, the plain boustrophedon first.

    Lines in swaths are always there where these are the encoding: it is counted from the best of them.
    """
    names = initial_names(coverage, settings)
    found: list[Baseline] = []

    def should_stop() -> bool:
        return left_s() <= 0.0

    if "boustrophedon" in names:
        if settings.encoding == "swaths":
            found += boustrophedons(coverage, executor, should_stop, tuned)
        else:
            found += _rows(coverage, settings, executor, should_stop)
    if "contour-lines" in names:
        found += contour_lines(coverage, executor, should_stop)
    covers: list[InitialRoute] = [name for name in names if name not in {"boustrophedon", "contour-lines"}]
    if covers:
        for name, route in _cover_routes(coverage, covers, settings, 1.0 if asked is None else asked, left_s):
            found += evaluated(coverage, name, [route], executor)
    return found


def _cover_routes(
    coverage: CoverageMap,
    names: Sequence[InitialRoute],
    settings: PlannerSettings,
    asked: float,
    left_s: Callable[[], float],
) -> list[tuple[InitialRoute, Route]]:
    """The routes of set covers on the finest lattice there is time for, at least on a coarse one.

    A sensor that observes at waypoints sees little from lines: of a canyon 81 %, where a coarse cover sees all.
    """
    most = _most_places(coverage)
    count = most if math.isinf(left_s()) else min(_FIRST_PLACES, most)
    while True:
        before_s = left_s()
        candidates = _candidates(coverage, count)
        reduced = reduce(candidates)
        steps = _STEPS if before_s > 0.0 else _FEW_STEPS
        routes = [(name, _cover_route(coverage, candidates, reduced, name, settings, asked, steps)) for name in names]
        used_s = before_s - left_s()
        made = [(name, route) for name, route in routes if route is not None]
        if count >= most or (made and _LONGER * used_s > left_s()):
            return made
        count = min(most, _FINER * count)


def _rows(
    coverage: CoverageMap, settings: PlannerSettings, executor: Executor | None, should_stop: Callable[[], bool]
) -> list[Baseline]:
    """The boustrophedon of free waypoints: rows of nodes, the plain ones first, then all that the encoding has room for."""
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


def _most_places(coverage: CoverageMap) -> int:
    if coverage.site.scenario.sensor.looks_along_path:
        return 1  # of any number there is one lattice
    cells_each = math.pi * (horizontal_reach(coverage.sight) / coverage.grid.cells.size_m) ** 2
    return int(min(_MOST_PLACES, max(_MOST_PAIRS / max(cells_each, 1.0), coverage.grid.count)))


def _candidates(coverage: CoverageMap, most: int) -> Candidates:
    site = coverage.site
    if not site.scenario.sensor.looks_along_path:
        spacing_m = _SPACING_CELLS * coverage.grid.cells.size_m
        return finest_lattice_candidates(coverage, spacing_m=spacing_m, most=most)
    height_agl_m = best_height_agl_m(site)
    reach_m = max(site.scenario.sensor.half_width_m(height_agl_m), coverage.grid.cells.size_m)
    return level_candidates(coverage, spacing_m=_SPACING_REACHES * reach_m, height_agl_m=height_agl_m)


def _cover_route(
    coverage: CoverageMap,
    candidates: Candidates,
    reduced: Reduced,
    name: InitialRoute,
    settings: PlannerSettings,
    asked: float,
    steps: int,
) -> Route | None:
    """The route of one set cover; None if no place sees anything."""
    if name == "greedy-set-cover":
        chosen = greedy_cover(reduced, asked)
    else:
        chosen = searched_cover(reduced, steps=steps, rng=np.random.default_rng([settings.seed, _STREAM]))
    if settings.encoding == "waypoints":
        chosen = cut_down(candidates, chosen, settings.capacity)
    if chosen.size == 0:
        return None
    return tour_route(coverage.site, candidates.places_m[chosen], tolerance_m=PLAIN_TOLERANCE_M)


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
