"""Set covers on lattice points inside the limits, and the routes through them.

Positions that another one dominates, and cells that do not affect the optimum, are removed first. Covers are greedy or found by
local search. A cover becomes a route in the order of a short tour, laid over the terrain if the limits apply to legs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.kernels import set_cover as kernels
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.set_cover import search_cover
from uavcover.kernels.sight import Sight, horizontal_reach
from uavcover.kernels.tours import FREE_ENDS, short_tour
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Route
from uavcover.planner.terrain_following import allowed_band_m, lay_over_terrain
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations, observes_each
from uavcover.sensing.sensors import any_heading

_POSITIONS_AT_ONCE = 100
_ROUNDING_M = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Positions and the cells they observe: set k of :mod:`uavcover.kernels.set_cover` has the cells of position k."""

    positions_m: FloatArray  # (p, 3) ENU
    spacing_m: float  # of the lattice
    start: NDArray[np.int64]  # (p + 1,) where the cells of each place begin in ``cells``
    cells: NDArray[np.int32]  # numbers of the cells that are observed, rising for each place
    weight: FloatArray  # (n,) fraction of each cell in what can be covered at all; 0 for one that cannot

    @property
    def text(self) -> str:
        """Description of the candidates."""
        return f"lattice of {self.spacing_m:g} m, {len(self.positions_m):,} places"

    @property
    def reachable(self) -> float:
        """Fraction of the visible ground that all positions together observe, 0..1."""
        return float(self.weight[np.unique(self.cells)].sum())

    def coverage_of(self, chosen: NDArray[np.int64]) -> float:
        """Fraction of the visible ground that some of the positions observe, 0..1."""
        observed = [self.cells[self.start[k] : self.start[k + 1]] for k in chosen]
        return float(self.weight[np.unique(np.concatenate(observed))].sum()) if observed else 0.0


def finest_lattice_candidates(coverage: CoverageMap, *, spacing_m: float, most: int) -> Candidates:
    """The positions of a cubic lattice whose spacing is doubled until at most ``most`` positions remain."""
    reach = horizontal_reach(coverage.sight)
    around, limits = _around(coverage.site, reach), coverage.site.scenario.limits
    band_m = limits.max_height_agl_m - limits.min_height_agl_m
    # Do not lay out a lattice that is far too fine.
    while float(shapely.area(around)) * max(band_m / spacing_m, 1.0) / spacing_m**2 > 8.0 * most:
        spacing_m *= 2.0
    while len(positions := _lattice(coverage, spacing_m)) > most:
        spacing_m *= 2.0
    return candidates_at(coverage, positions, spacing_m=spacing_m)


def level_candidates(coverage: CoverageMap, *, spacing_m: float, height_agl_m: float) -> Candidates:
    """The positions of a square lattice at one height above ground, counted from the south-west corner of the area."""
    positions = _lattice_2d(coverage.site, horizontal_reach(coverage.sight), spacing_m)
    up = coverage.site.ground.ups_m(positions, height_agl_m)
    known = np.isfinite(up)
    return candidates_at(coverage, np.column_stack([positions, up])[known], spacing_m=spacing_m)


def candidates_at(coverage: CoverageMap, positions_m: FloatArray, *, spacing_m: float) -> Candidates:
    """(p, 3) ENU positions with the cells that each observes; for a camera that turns with the legs, at least these."""
    every = np.arange(coverage.grid.count)
    start, cells = observed_from_each(coverage, positions_m, every, any_heading(coverage.sight))
    weight = np.where(coverage.coverable, coverage.grid.weight_m2, 0.0)
    return Candidates(
        positions_m=positions_m, spacing_m=spacing_m, start=start, cells=cells, weight=weight / max(float(weight.sum()), 1e-300)
    )  # fmt: skip


def observed_from_each(
    coverage: CoverageMap,
    positions_m: FloatArray,
    among: IntArray,
    sight: Sight,
    is_over: Callable[[], bool] = lambda: False,
) -> tuple[IntArray, NDArray[np.int32]]:
    """Cells that each of several points observes.

    Args:
        coverage: the map.
        positions_m: (p, 3) ENU, of a vehicle that heads north.
        among: (k,) numbers of the cells to consider, rising.
        sight: the sensor.
        is_over: whether the time is over. From then on, positions observe nothing, except the first ones.

    Returns:
        (p + 1,) begin of each position's cells, and the numbers of the cells, rising for each position.
    """
    # Importing scipy.spatial takes a while, which other commands need not wait for.
    from scipy.spatial import cKDTree

    tree = cKDTree(coverage.grid.cells.centre_m[among, :2])
    reach = horizontal_reach(sight) * (1.0 + 1e-9)
    counts = np.zeros(len(positions_m), dtype=np.int64)
    observed: list[NDArray[np.int32]] = []
    for first in range(0, len(positions_m), _POSITIONS_AT_ONCE):
        if first > 0 and is_over():
            break
        some = positions_m[first : first + _POSITIONS_AT_ONCE]
        near: Sequence[list[int]] = tree.query_ball_point(some[:, :2], reach, return_sorted=True)  # type: ignore[assignment]
        sizes = np.array([len(row) for row in near], dtype=np.int64)
        if not sizes.sum():
            continue
        numbers = among[np.concatenate([np.asarray(row, dtype=np.int64) for row in near])]
        rows = np.repeat(np.arange(len(some)), sizes)
        observes = observes_each(coverage, LevelObservations.towards_north(some[rows]), numbers, sight)
        counts[first : first + len(some)] = np.bincount(rows[observes], minlength=len(some))
        observed.append(numbers[observes].astype(np.int32))
    return np.concatenate([[0], np.cumsum(counts)]), np.concatenate(observed) if observed else np.empty(
        0, dtype=np.int32
    )


def _lattice(coverage: CoverageMap, spacing_m: float) -> FloatArray:
    """(p, 3) positions of a cubic lattice inside fence and height band; mid-band if the band contains no level."""
    positions = _lattice_2d(coverage.site, horizontal_reach(coverage.sight), spacing_m)
    low, high = allowed_band_m(coverage.site, positions)
    lowest = np.ceil((low - _ROUNDING_M) / spacing_m)
    levels = np.where(np.isfinite(low + high), np.floor((high + _ROUNDING_M) / spacing_m) - lowest + 1.0, 0.0)
    between = (levels < 1.0) & (low <= high)
    counts = np.where(between, 1.0, np.maximum(levels, 0.0)).astype(np.int64)
    rows = np.repeat(np.arange(len(positions)), counts)
    level = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    ups = np.where(between, 0.5 * (low + high), lowest * spacing_m)
    return np.column_stack([positions[rows], ups[rows] + level * spacing_m])


def _lattice_2d(site: Site, reach_m: float, spacing_m: float) -> FloatArray:
    """(k, 2) positions of a square lattice inside the fence that may observe some of the area."""
    around = _around(site, reach_m)
    west, south, east, north = shapely.bounds(around)
    corner_e, corner_n = site.area.bounds[:2]
    axes = [
        np.arange(np.ceil((low - _ROUNDING_M) / spacing_m), np.floor((high + _ROUNDING_M) / spacing_m) + 1.0)
        for low, high in ((west - corner_e, east - corner_e), (south - corner_n, north - corner_n))
    ]
    positions = spacing_m * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2) + (corner_e, corner_n)
    return positions[shapely.intersects_xy(shapely.buffer(around, _ROUNDING_M), positions[:, 0], positions[:, 1])]


def _around(site: Site, reach_m: float) -> shapely.Geometry:
    """Positions that may observe some of the area."""
    return flyable_area(site).polygon.intersection(site.area.buffer(reach_m))


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """A table of :mod:`uavcover.kernels.set_cover`: sets of classes of cells that the same positions observe."""

    numbers: NDArray[np.int64]  # (c,) the places that are left, as numbers of the candidates
    start: NDArray[np.int64]  # (c + 1,)
    classes: NDArray[np.int32]  # numbers of classes, rising for each place
    weight: (
        FloatArray  # (m,) fraction of each class in what can be covered at all, above 0; each is observed by some place
    )

    @property
    def reachable(self) -> float:
        """Fraction of the visible ground that all positions together observe, 0..1."""
        return float(self.weight.sum())


def reduce(candidates: Candidates) -> Reduced:
    """The candidates without those that no optimal cover needs.

    A position is removed if another one observes all its cells. Cells that the same positions observe become one class.
    """
    count = candidates.weight.size
    start, cells = _with_cells(candidates.start, candidates.cells, candidates.weight > 0.0)
    numbers = np.flatnonzero(kernels.undominated(start, cells, count))
    start, cells = _some_sets(start, cells, numbers)
    back, positions = kernels.transposed(start, cells, count)
    classes: dict[bytes, int] = {}
    class_of = np.full(count, -1, dtype=np.int32)
    # The first cell represents its class, so that classes rise with cells.
    stands = np.zeros(count, dtype=bool)
    weight: list[float] = []
    for cell in np.flatnonzero(np.diff(back)):
        number = classes.setdefault(positions[back[cell] : back[cell + 1]].tobytes(), len(weight))
        if number == len(weight):
            weight.append(0.0)
            stands[cell] = True
        class_of[cell] = number
        weight[number] += float(candidates.weight[cell])
    start, cells = _with_cells(start, cells, stands)
    return Reduced(numbers, start, class_of[cells], np.array(weight))


def _with_cells(
    start: NDArray[np.int64], cells: NDArray[np.int32], keep: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The table with only the cells marked in ``keep`` (n,)."""
    kept = keep[cells]
    before = np.concatenate([[0], np.cumsum(kept)])
    return before[start], cells[kept]


def _some_sets(
    start: NDArray[np.int64], cells: NDArray[np.int32], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The table of some of the sets, rising numbers."""
    sizes = np.diff(start)
    keep = np.zeros(sizes.size, dtype=bool)
    keep[numbers] = True
    return np.concatenate([[0], np.cumsum(sizes[numbers])]), cells[np.repeat(keep, sizes)]


_ROUNDING = 1e-9


def greedy_cover(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    """Numbers of candidates that reach a fraction of the visible ground, or all that is reachable, chosen greedily."""
    return reduced.numbers[_greedy(reduced, coverage)]


def searched_cover(reduced: Reduced, *, steps: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers of few candidates that observe everything reachable: greedily, then by local search.

    Args:
        reduced: the positions.
        steps: exchanges; 20,000 take about half a second on the paper's scenarios.
        rng: draws them.
    """
    first = _greedy(reduced, 1.0)
    return reduced.numbers[search_cover(reduced.start, reduced.classes, reduced.weight.size, first, steps, rng)]


def cut_down(candidates: Candidates, chosen: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """The chosen candidates, reduced to a maximum number by removing the one with the least coverage of its own."""
    return kernels.drop_needless(candidates.start, candidates.cells, candidates.weight, chosen, np.inf, most)


def thinned(candidates: Candidates, chosen: NDArray[np.int64], coverage: float) -> NDArray[np.int64]:
    """The chosen candidates without those that contribute least, while the others reach a fraction."""
    table = (candidates.start, candidates.cells, candidates.weight)
    return kernels.drop_needless(*table, chosen, coverage, chosen.size)


def _greedy(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    enough = min(coverage, reduced.reachable) - _ROUNDING
    positions = reduced.numbers.size
    table = (reduced.start, reduced.classes, reduced.weight)
    return kernels.drop_needless(*table, kernels.choose_greedily(*table, enough, positions), enough, positions)


def tour_route(site: Site, positions_m: FloatArray, *, tolerance_m: float) -> Route:
    """A short route through all of (k, 3) points, begun at the end nearer to home, or to the origin without a home.

    If the mission counts, transit counts as well.

    Args:
        site: the scenario on its ground.
        positions_m: ENU.
        tolerance_m: permitted deviation of the straight legs from the wanted height above ground.
    """
    home_m = FREE_ENDS if site.home_m is None or path_cost_of(site).mission == 0 else site.home_m
    points = positions_m[short_tour(positions_m, home_m)]
    reference = np.zeros(3) if site.home_m is None else site.home_m
    if len(points) and np.linalg.norm(points[-1] - reference) < np.linalg.norm(points[0] - reference):
        points = points[::-1]
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        wanted_agl_m = site.ground.heights_agl_m(points)
        points = lay_over_terrain(site, points[:, :2], wanted_agl_m, tolerance_m=tolerance_m)
    return Route(points)
