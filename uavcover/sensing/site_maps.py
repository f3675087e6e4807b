"""The maps of a site, for the search and the evaluation, each built once; for a large area in blocks.

A cell is the same in a block of rows as among all. A plan needs the ground area of each cell of a large area, whether it is
visible, and whether a route observes it: 9 bytes and a few bits per cell instead of 70 and more, because positions and slopes are
never all in memory. A block is an independent task for any worker.
"""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.cells import Cells
from uavcover.scenario.site import Site, keep_computed, once
from uavcover.scenario.vehicles import own_sensors, vehicle_sites
from uavcover.sensing.cells import (
    MAX_CELLS,
    CellGrid,
    cut_for,
    is_judged_on_smaller_cells,
    judged_cell_size_m,
    lattice_shape,
    make_other_cells,
    make_refined_cells,
)
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations, RecentlyObserved


@once
def judging_map(site: Site) -> CoverageMap:
    """The evaluation grid, in one piece or in blocks."""
    if site.block_cells is not None:
        return BlockMap(site, site.block_cells)
    return CoverageMap(site, cell_size_m=judged_cell_size_m(site), cut=cut_for(site))


def judging_maps(site: Site) -> list[CoverageMap]:
    """Maps on which a search evaluates a route: :func:`judging_map`, and finer ones for cells of the scenario's size.

    The latter only for a sensor that observes along the path, and if memory allows. Built once for a site.
    """
    if not site.scenario.sensor.looks_along_path or is_judged_on_smaller_cells(site):
        return [judging_map(site)]
    finer = finer_map(site)
    return [judging_map(site)] if finer is None else [judging_map(site), finer]


def planning_map(site: Site) -> CoverageMap:
    """The cells that a planner uses, the area's own if they are of the same size. Built once for a site."""
    return _map_of(site, site.scenario.planning_cell_size_m)


def sampling_map(site: Site, *, most_cells: int) -> CoverageMap:
    """:func:`planning_map`, or one of larger cells if it has more than ``most_cells``; the latter is not kept.

    Each cell is observed at one position, so larger cells are a sparser sample of the ground.
    """
    cell_size_m = (site.area.area / most_cells) ** 0.5
    if cell_size_m <= site.scenario.planning_cell_size_m:
        return planning_map(site)
    return CoverageMap(site, cell_size_m=cell_size_m, cut=cut_for(site))


_MOST_FINER_CELLS = 600_000
"""Above this number, the scenario's cells are enough against overfitting.

On 25 km² finer ones took 4 s before a search could begin.
"""


def finer_map(site: Site) -> CoverageMap | None:
    """Other positions for a final test of routes; None if memory, or limits of waypoints, forbid it.

    Cells of half the size, including the positions of the evaluation grid; or other positions, if the evaluation grid is already
    smaller than the scenario's cells.
    """
    if site.scenario.limits.applies_to == "waypoints":
        return None
    if is_judged_on_smaller_cells(site):
        return _other_positions(site)
    if judging_map(site).grid.count * 4 > _MOST_FINER_CELLS:
        return None
    return _refined(site)


@once
def _refined(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=0.5 * judged_cell_size_m(site), cut=make_refined_cells)


@once
def _other_positions(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=judged_cell_size_m(site), cut=make_other_cells)


@once
def _maps(_site: Site) -> dict[float, CoverageMap]:
    """Maps that were built before, by the size of their cells."""
    return {}


def _map_of(site: Site, cell_size_m: float) -> CoverageMap:
    maps = _maps(site)
    if cell_size_m == judged_cell_size_m(site):
        return judging_map(site)
    if cell_size_m not in maps:
        maps[cell_size_m] = CoverageMap(site, cell_size_m=cell_size_m, cut=cut_for(site))
    return maps[cell_size_m]


def with_maps_of(prepared: Site, site: Site) -> Site:
    """A site with the maps of another one that differs only in its vehicles and homes, if that one is not large.

    Args:
        prepared: the site with maps.
        site: the other one; returned.
    """
    if site is not prepared and not is_large(prepared):
        maps = {size: each.flown_from(site) for size, each in _maps(prepared).items()}
        keep_computed(site, judging_map, judging_map(prepared).flown_from(site))
        keep_computed(site, _maps, maps)
    return site


def map_for(site: Site, own: Site) -> CoverageMap:
    """The cells of a site as the sensor of one of its vehicles observes them.

    Args:
        site: of all vehicles.
        own: of the vehicle: the same ground and area.
    """
    if own.scenario.sensor != site.scenario.sensor:
        return judging_map(own)
    whole = judging_map(site)
    _ = whole.coverable  # computed once, not by each vehicle
    return whole.flown_from(own)


@once
def fleet_map(site: Site) -> CoverageMap:
    """The evaluation grid; cells that the sensor of any vehicle can observe are visible."""
    if not own_sensors(site.scenario):
        return judging_map(site)
    maps = [map_for(site, own) for own in vehicle_sites(site)]
    return judging_map(site).flown_from(site, np.logical_or.reduce([each.coverable for each in maps], axis=0))


_MOST_AT_ONCE = 2_000_000
"""A map with more lattice points is made of blocks. Below, all cells take less memory than the program itself."""
_BLOCK_CELLS = 250_000

Bits = np.ndarray[tuple[int], np.dtype[np.uint8]]


@dataclass(frozen=True, slots=True, eq=False)
class BlockTask:
    """Questions about a block of cells.

    Attributes:
        rows: of the lattice, from the first to before the last.
        about_cells: whether to compute their ground, and which are visible.
        routes_m: each (n, 3) ENU; compute which cells they observe.
    """

    rows: tuple[int, int]
    about_cells: bool
    routes_m: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class BlockLook:
    """Answers about a block of cells.

    Attributes:
        count: of cells.
        weight_m2: (count,) as in :class:`CellGrid`; empty if not requested.
        hidden_m2: as in :class:`CellGrid`; 0 where it was not requested.
        coverable: (count,) packed; empty where it was not requested.
        observed: for each route (count,) packed.
    """

    count: int
    weight_m2: FloatArray
    hidden_m2: float
    coverable: Bits
    observed: tuple[Bits, ...]


RunBlocks = Callable[[Site, Sequence[BlockTask]], Iterator[tuple[BlockTask, BlockLook]]]
"""Look at blocks of a site: each task with what was found, in any order."""


def look_at_block(site: Site, task: BlockTask) -> BlockLook:
    """Evaluate a block: a function of its arguments alone."""
    block = judging_block(site, range(*task.rows))
    grid, nothing = block.grid, np.zeros(0)
    observed = tuple(np.packbits(observed_nearby(block, route)) for route in task.routes_m)
    if not task.about_cells:
        return BlockLook(grid.count, nothing, 0.0, nothing.astype(np.uint8), observed)
    return BlockLook(grid.count, grid.weight_m2, grid.hidden_m2, np.packbits(block.coverable), observed)


def observed_nearby(block: CoverageMap, route_m: FloatArray) -> BoolArray:
    """As :meth:`CoverageMap.observed`, for a route that is mostly too far away to observe any of the cells."""
    looks = block.flown_observations(route_m)
    near = np.zeros(len(looks), dtype=bool)
    if block.grid.count:
        centre_m, halo_m = block.grid.cells.centre_m, block.site.scenario.sensor.reach_m + 1.0
        near = np.all(
            (looks.positions_m[:, :2] >= centre_m[:, :2].min(axis=0) - halo_m)
            & (looks.positions_m[:, :2] <= centre_m[:, :2].max(axis=0) + halo_m),
            axis=1,
        )
    if not near.any():
        return np.zeros(block.grid.count, dtype=bool)
    return block.observed_by(LevelObservations(looks.positions_m[near], looks.headings[near]))


def one_after_the_other(site: Site, tasks: Sequence[BlockTask]) -> Iterator[tuple[BlockTask, BlockLook]]:
    """Evaluate blocks in this process, one after the other."""
    for task in tasks:
        yield task, look_at_block(site, task)


class _GridOfBlocks(CellGrid):
    """The ground of the cells; the cells themselves are made on demand."""

    _site: Site

    def __init__(self, site: Site, weight_m2: FloatArray, hidden_m2: float) -> None:
        for name, value in (("weight_m2", weight_m2), ("hidden_m2", hidden_m2), ("_site", site)):
            object.__setattr__(self, name, value)

    @cached_property
    def cells(self) -> Cells:
        rows, _ = lattice_shape(self._site, judged_cell_size_m(self._site))
        return judging_block(self._site, range(rows)).grid.cells

    @property
    def size_m(self) -> float:
        return judged_cell_size_m(self._site)


def judging_block(site: Site, rows: range) -> CoverageMap:
    """Some rows of the lattice of an evaluation grid, which observe the same as among all; not kept."""
    return CoverageMap(site, cell_size_m=judged_cell_size_m(site), cut=functools.partial(cut_for(site), rows=rows))


def row_blocks(site: Site, *, cells: int) -> list[range]:
    """The rows of the lattice of an evaluation grid, in blocks of at most ``cells`` points, or of one row."""
    rows, columns = lattice_shape(site, judged_cell_size_m(site))
    step = max(1, cells // columns)
    return [range(first, min(first + step, rows)) for first in range(0, rows, step)]


@dataclass(frozen=True, slots=True, eq=False)
class _Ground:
    """All cells of a map of blocks: their ground, which are visible, and the number in each block."""

    grid: _GridOfBlocks
    coverable: BoolArray
    counts: tuple[int, ...]


class BlockMap(CoverageMap):
    """The evaluation grid, made of blocks of at most ``block_cells``, or of one row."""

    def __init__(self, site: Site, block_cells: int) -> None:
        self.site = site
        self.sight = site.scenario.sensor.sight
        self._recent = RecentlyObserved()
        self._ground: _Ground | None = None
        self._rows = [(rows.start, rows.stop) for rows in row_blocks(site, cells=block_cells)]

    @property
    def grid(self) -> CellGrid:  # type: ignore[override]
        """Its cells."""
        return self._known_ground().grid

    @property
    def coverable(self) -> BoolArray:
        """See :class:`CoverageMap`."""
        return self._known_ground().coverable

    def knows_coverable(self, is_over: Callable[[], bool]) -> bool:  # noqa: ARG002
        """Find ``coverable``, also when the time is over: workers may do it."""
        _ = self.coverable
        return True

    def _known_ground(self) -> _Ground:
        return self._ground or self._found((), one_after_the_other)[0]

    def blocks(self) -> Iterator[CoverageMap]:
        """Its blocks, one after the other."""
        for rows in self._rows:
            yield judging_block(self.site, range(*rows))

    def observed(self, route_m: FloatArray) -> BoolArray:
        """See :class:`CoverageMap`; immediate for known routes."""
        packed = self._recent.get(route_m, lambda: self._found((route_m,), one_after_the_other)[1][0])
        observed = _unpacked(packed, self.grid.count)
        observed.flags.writeable = False
        return observed

    def observed_by(self, observations: LevelObservations) -> BoolArray:
        """See :class:`CoverageMap`."""
        return np.concatenate([block.observed_by(observations) for block in self.blocks()])

    def first_observed(self, observations: LevelObservations) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """See :class:`CoverageMap`."""
        return np.concatenate([block.first_observed(observations) for block in self.blocks()])

    def look_at(self, routes_m: Sequence[FloatArray], by: RunBlocks) -> None:
        """Compute the observations of routes, and the visible cells, once; kept for :meth:`observed`.

        Args:
            routes_m: each (n, 3) ENU.
            by: the workers.
        """
        new = [route for route in routes_m if not self._recent.knows(route)]
        if new or self._ground is None:
            for route, packed in zip(new, self._found(tuple(new), by)[1], strict=True):
                self._recent.keep(route, packed)

    def _found(self, routes_m: tuple[FloatArray, ...], by: RunBlocks) -> tuple[_Ground, list[Bits]]:
        """All cells; and for each route (cells,) whether it observes them, packed."""
        ground = self._ground
        about_cells = ground is None
        near = {rows: tuple(k for k, route in enumerate(routes_m) if self._may_see(route, rows)) for rows in self._rows}
        tasks = [
            BlockTask(rows, about_cells, tuple(routes_m[k] for k in numbers))
            for rows, numbers in near.items()
            if numbers or about_cells
        ]
        found = {task.rows: look for task, look in by(self.site, tasks)}
        if ground is None:
            looks = [found[rows] for rows in self._rows]
            weight_m2 = np.concatenate([look.weight_m2 for look in looks])
            if not weight_m2.size:
                # There is nothing to observe: making the map in one piece raises the reason.
                CoverageMap(self.site, cell_size_m=judged_cell_size_m(self.site))
            weight_m2.flags.writeable = False
            hidden_m2 = math.fsum(look.hidden_m2 for look in looks)
            coverable = np.concatenate([_unpacked(look.coverable, look.count) for look in looks])
            grid = _GridOfBlocks(self.site, weight_m2, hidden_m2)
            ground = self._ground = _Ground(grid, coverable, tuple(look.count for look in looks))
        return ground, [
            np.packbits(np.concatenate([
                _unpacked(found[rows].observed[numbers.index(k)], count) if k in numbers else np.zeros(count, dtype=bool)
                for (rows, numbers), count in zip(near.items(), ground.counts, strict=True)
            ]))
            for k in range(len(routes_m))
        ]  # fmt: skip

    def _may_see(self, route_m: FloatArray, rows: tuple[int, int]) -> bool:
        """Whether a route comes within sensor range of a block. A row of cells is as wide as the area."""
        south, side_m = self.site.area.bounds[1], judged_cell_size_m(self.site)
        halo_m = self.site.scenario.sensor.reach_m + self.site.scenario.vehicle.motion().corner_radius_m + 1.0
        norths = np.asarray(route_m, dtype=float).reshape(-1, 3)[:, 1]
        return bool(
            norths.max() >= south + rows[0] * side_m - halo_m and norths.min() <= south + rows[1] * side_m + halo_m
        )


def _unpacked(bits: Bits, count: int) -> BoolArray:
    return np.unpackbits(bits, count=count).view(bool)


def is_large(site: Site) -> bool:
    """Whether the area is large enough to be evaluated block by block."""
    rows, columns = lattice_shape(site, judged_cell_size_m(site))
    return _MOST_AT_ONCE < rows * columns <= MAX_CELLS


def in_blocks(site: Site) -> Site:
    """The site, judged in blocks if its area is large."""
    return site if not is_large(site) else replace(site, block_cells=_BLOCK_CELLS)


def look_at_all(coverage: CoverageMap, routes_m: Sequence[FloatArray], by: RunBlocks) -> None:
    """Let workers compute the observations of routes, where a map is made of blocks. Other maps compute them on demand."""
    if isinstance(coverage, BlockMap):
        coverage.look_at(routes_m, by)
