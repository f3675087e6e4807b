"""The lower bound on path length by prices on the ground: prices from a linear program, then proved whatever it returned.

The program interpolates prices among the corners of blocks of cells, for moves from a sample of places. The proof looks at all
places and all headings
(:mod:`uavcover.kernels.ground_prices`), divides each cell's price by the largest rate of the tiles that it matters to, and
only then adds up; prices that the program got wrong make the bound lower, never wrong.
"""

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.ground_prices import (
    HEADINGS,
    Places,
    largest_first_look,
    largest_rates_of_cells,
    rates_by_node,
    rates_in_tiles,
)
from uavcover.kernels.sight import CONE, highest_in_squares, horizontal_reach
from uavcover.kernels.surface import GRID
from uavcover.planning.interior_point import most_worth
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import whatever_heading

_STEPS_A_CELL = (8.0, 6.0, 4.0, 3.0, 2.0)
"""Squares of the lattice along the side of a cell: the finer, the higher the bound, and the longer the proof takes."""

_WORK_A_SECOND = 1e7
"""Nodes times cells at the edge of what is seen there: of the whole proof, on one core."""

_BLOCKS_ACROSS = 32
_FEWEST_CELLS = 3
"""Along the side of a block."""
_SAMPLES_ACROSS = 56
_LOOKS = 3
_ROUNDS = 8
_TILE = 8
_STRIDE = 4
_NEARLY = 1.01
"""A rate that is not worth another round of the program."""

Rows: TypeAlias = Any
"""Compressed rows (scipy.sparse.csr_array), whose stubs know no stacking of them."""

_LEEWAY_M = 0.01
"""Against rounding in the tests of sensor and height band."""


@dataclass(frozen=True, slots=True, eq=False)
class PricedGround:
    """Prices that no path gains faster than it flies.

    Attributes:
        prices_m: (cells,) metres, at least 0; 0 for cells that cannot be covered.
        first_look_m: what is seen at any one place is worth at most this.
        rates: (rows, columns) what a metre gained at most in each tile of the map before the prices were divided; near 1 where
            ground is seen as fast as anywhere, near 0 where length is wasted.
        tile_m: side of a tile.
        corner_m: (2,) south-west corner of the first tile, ENU.
    """

    prices_m: FloatArray
    first_look_m: float
    rates: FloatArray
    tile_m: float
    corner_m: tuple[float, float]

    def least_length_m(self, weight: FloatArray, share: float) -> float:
        """No path that sees a share of the weight (cells,) is shorter, metres: what it sees is worth its length and one look.

        What may stay unseen is what saves most for its weight, part of a cell included.
        """
        order = np.argsort(-self.prices_m / np.where(weight > 0.0, weight, np.inf), kind="stable")
        before = np.cumsum(weight[order]) - weight[order]
        unseen = np.clip((1.0 - share) * float(weight.sum()) - before, 0.0, weight[order])
        part = np.divide(unseen, weight[order], out=np.zeros_like(unseen), where=weight[order] > 0.0)
        worth_m = float((self.prices_m[order] * (1.0 - part)).sum())
        return max(0.0, worth_m - self.first_look_m)


def lattice_step_m(coverage: CoverageMap, time_s: float) -> float | None:
    """Of the finest lattice on which a proof takes about so long; none where it takes longer on every one."""
    size_m, reach = coverage.grid.size_m, horizontal_reach(whatever_heading(coverage.sight))
    west, south, east, north = coverage.site.area.bounds
    for steps in _STEPS_A_CELL:
        step = size_m / steps
        nodes = (east - west + 2.0 * reach) * (north - south + 2.0 * reach) / step**2
        edge_cells = 2.0 * math.pi * reach * (1.3 * size_m + (_TILE + 3) * step) / size_m**2
        if nodes * edge_cells <= _WORK_A_SECOND * time_s:
            return step
    return None


def price_ground(coverage: CoverageMap, share: float, *, step_m: float) -> PricedGround | None:
    """Prices for paths that see a share of what can be covered; none where nothing can be.

    Args:
        coverage: on the cells by which routes are judged.
        share: of what can be covered, 0..1.
        step_m: side of the squares of the lattice of places.
    """
    weight = coverable_weight_m2(coverage)
    if not weight.any():
        return None
    cells = coverage.grid.cells
    places = places_over(coverage, step_m)
    program = _Program(coverage, weight, places, share)
    # The tiles at which a rate is too large, of those that are looked at in passing, are where prices are tried next.
    price = program.solve()
    for _ in range(_LOOKS):
        rates, worst = _rates(places, coverage, price, stride=_STRIDE)
        where = worst[rates > _NEARLY]
        if not len(where):
            break
        program.look_at(where[:, :3])
        price = program.solve()
    rates, _ = _rates(places, coverage, price, stride=1)
    divisor = largest_rates_of_cells(places, cells, _TILE, rates)
    # A cell that no place sees has no price; nor does any gain come from a cell that changes nowhere.
    prices = np.divide(price, divisor, out=np.zeros_like(price), where=divisor > 0.0) / (1.0 + 1e-9)
    first_look_m = float(largest_first_look(places, cells, prices, _TILE))
    return PricedGround(prices, first_look_m, rates, _TILE * places.step, (places.east0, places.north0))


def coverable_weight_m2(coverage: CoverageMap) -> FloatArray:
    """(cells,) ground in each cell, 0 where it cannot be covered."""
    weight: FloatArray = np.where(coverage.coverable, coverage.grid.weight_m2, 0.0)
    return weight


def places_over(coverage: CoverageMap, step_m: float) -> Places:
    """The lattice of places around the area from which anything can be seen."""
    site, cells = coverage.site, coverage.grid.cells
    sight, limits = whatever_heading(coverage.sight), site.scenario.limits
    reach = horizontal_reach(sight) + _LEEWAY_M
    west, south, east, north = site.area.bounds
    margin = reach + 1.5 * cells.size_m + cells.scatter_m + 3.0 * step_m
    east0, north0 = west - margin, south - margin
    columns = math.ceil((east + margin - east0) / step_m) + 1
    rows = math.ceil((north + margin - north0) / step_m) + 1
    e = east0 + (np.arange(columns - 1) + 0.5) * step_m
    n = north0 + (np.arange(rows - 1) + 0.5) * step_m
    if limits.applies_to == "legs":
        # A square that touches the fence has its centre within 0.71 sides of it; mitred corners reach further.
        near = site.fence.buffer(0.75 * step_m, join_style="mitre")
        shapely.prepare(near)
        allowed: BoolArray = np.asarray(shapely.contains_xy(near, *np.meshgrid(e, n)), dtype=bool)
        up = _highest_m(coverage, east0, north0, step_m, max(rows, columns) - 1)[: rows - 1, : columns - 1]
        allowed &= np.isfinite(up)
        highest_agl_m = limits.max_height_agl_m - limits.height_margin_m
        up = np.where(allowed, up + highest_agl_m + site.ground.cut_error_m + _LEEWAY_M, -np.inf)
    else:
        # Between waypoints there are no limits: legs may be anywhere, at any height.
        allowed = np.ones((rows - 1, columns - 1), dtype=bool)
        up = np.full(allowed.shape, np.inf)
    if sight.kind != CONE:
        up = np.where(allowed, np.inf, -np.inf)
    tops = np.full((rows, columns), -np.inf)
    for i in (0, 1):
        for j in (0, 1):
            part = tops[i : rows - 1 + i, j : columns - 1 + j]
            np.maximum(part, up, out=part)
    tangent = sight.tan_half_fov if sight.kind == CONE else 1.0
    return Places(tops, allowed, east0, north0, step_m, tangent, reach)


def _highest_m(coverage: CoverageMap, east0: float, north0: float, side: float, count: int) -> FloatArray:
    """(count, count) up that the ground nowhere exceeds in squares of the map; NaN where there is none."""
    surface, limits = coverage.site.ground.surface, coverage.site.scenario.limits
    if surface.kind == GRID:
        # Plumb lines lean: above its ground a place of the band may stand a little aside of it, and so a little higher.
        return highest_in_squares(surface, east0, north0, side, count, surface.grid.lean * limits.max_height_agl_m)
    steps = side * np.arange(count + 1)
    grid_e, grid_n = np.meshgrid(east0 + steps, north0 + steps)
    nodes = coverage.site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()])).reshape(grid_e.shape)
    corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]])
    highest: FloatArray = corners.max(axis=0) + surface.steepest * side * math.sqrt(0.5)
    return highest


def _rates(places: Places, coverage: CoverageMap, price: FloatArray, *, stride: int) -> tuple[FloatArray, IntArray]:
    shape = tuple((count - 2) // _TILE + 1 for count in places.tops.shape)
    rates, worst = np.zeros(shape), np.zeros((*shape, 4), dtype=np.int64)
    rates_in_tiles(places, coverage.grid.cells, price, _TILE, stride, rates, worst)
    return rates, worst


class _Program:
    """Prices of blocks such that no sampled move gains more than its length: most for what must be seen, less one look.

    Variables: price of a square metre at each corner of the blocks, price of what may stay unseen, and that of the first look.
    """

    def __init__(self, coverage: CoverageMap, weight: FloatArray, places: Places, share: float) -> None:
        cells = coverage.grid.cells
        west, south, east, north = coverage.site.area.bounds
        side = max((east - west) / _BLOCKS_ACROSS, (north - south) / _BLOCKS_ACROSS, _FEWEST_CELLS * cells.size_m)
        # Interpolated among the corners of blocks: a price that jumps would be gained too fast along the jump.
        along = (cells.centre_m[:, :2] - (west, south)) / side
        first = np.floor(along).astype(np.int64)
        part = along - first
        corners = [(i, j) for i in (0, 1) for j in (0, 1)]
        names = np.column_stack([(first[:, 1] + i) * (2 * _BLOCKS_ACROSS) + first[:, 0] + j for i, j in corners])
        self._parts = np.column_stack(
            [np.where(i, part[:, 1], 1.0 - part[:, 1]) * np.where(j, part[:, 0], 1.0 - part[:, 0]) for i, j in corners]
        )
        known, nodes = np.unique(names, return_inverse=True)
        self._nodes = nodes.reshape(names.shape)
        self._count = len(known)
        self._places, self._coverage, self._weight = places, coverage, weight
        of_node = np.bincount(
            self._nodes.ravel(), weights=(self._parts * weight[:, None]).ravel(), minlength=self._count
        )
        self._worth = np.concatenate([of_node, [-(1.0 - share) * weight.sum(), -1.0]])
        step = max(1, max(places.allowed.shape) // _SAMPLES_ACROSS)
        where = np.argwhere(places.allowed[step // 2 :: step, step // 2 :: step]) * step + step // 2
        self._rows: list[Rows] = []
        self._looks: Rows = scipy.sparse.csr_array((0, self._count))
        self._chosen: list[Rows] = []
        self.look_at(np.column_stack([where, np.arange(len(where)) % 2]))
        self._chosen = [scipy.sparse.csr_array(self._rows[k]) for k in range(0, HEADINGS, 8)]

    def look_at(self, where: IntArray) -> None:
        """Add places (p, 3): row and column of a square, and which of its triangles."""
        room = 64 * len(where)
        while True:
            starts, columns, data = rates_by_node(
                self._places, self._coverage.grid.cells, self._weight, self._nodes, self._parts,
                np.ascontiguousarray(where), room,
            )  # fmt: skip
            if starts[0] == 0:
                break
            room *= 4
        shape = (len(where), self._count)
        new = [scipy.sparse.csr_array((data[:, k], columns, starts), shape=shape) for k in range(HEADINGS + 1)]
        if self._rows:
            new = [scipy.sparse.vstack([old, more], format="csr") for old, more in zip(self._rows, new, strict=True)]
        self._rows = new

    def solve(self) -> FloatArray:
        """(cells,) prices: a start with few of the moves, and those added that gain too much, until none does."""
        density = np.zeros(self._count)
        for _ in range(_ROUNDS):
            found = self._solve_chosen()
            density, first_look_m = found[:-2], found[-1]
            gains = np.stack([rows @ density for rows in self._rows[:-1]])
            heading = gains.argmax(axis=0)
            too_much = gains.max(axis=0) > _NEARLY
            looks = self._rows[-1] @ density
            too_much_seen = np.flatnonzero(looks > _NEARLY * first_look_m)
            if not too_much.any() and not len(too_much_seen):
                break
            for k in np.unique(heading[too_much]):
                self._chosen.append(self._rows[k][np.flatnonzero(too_much & (heading == k))])
            most = too_much_seen[np.argsort(-looks[too_much_seen])[:200]]
            self._looks = scipy.sparse.vstack([self._looks, self._rows[-1][most]], format="csr")
        price: FloatArray = (density[self._nodes] * self._parts).sum(axis=1) * self._weight
        return price

    def _solve_chosen(self) -> FloatArray:
        moves = scipy.sparse.vstack(self._chosen, format="csr")
        moves = moves[np.flatnonzero(np.diff(moves.indptr))]
        one_look = self._rows[-1][np.argsort(-self._rows[-1].sum(axis=1))[:50]]
        looks = scipy.sparse.vstack([self._looks, one_look], format="csr")
        prices = scipy.sparse.identity(self._count, format="csr")

        def with_two_more(rows: Rows, unseen: float, look: float) -> Rows:
            return scipy.sparse.hstack(
                [rows, scipy.sparse.csr_array(np.tile([unseen, look], (rows.shape[0], 1)))], "csr"
            )

        matrix = scipy.sparse.vstack(
            [with_two_more(moves, 0.0, 0.0), with_two_more(looks, 0.0, -1.0), with_two_more(prices, -1.0, 0.0)],
            format="csr",
        )
        limits = np.zeros(matrix.shape[0])
        limits[: moves.shape[0]] = 1.0
        # In units in which all numbers are about 1: a square metre's price is one over the width of what is seen.
        width_m = 2.0 * self._places.reach
        unit = np.full(self._count + 2, 1.0 / width_m)
        unit[-1] = width_m
        scale = float(self._worth[:-2].sum()) / width_m
        scaled = scipy.sparse.csr_array(matrix @ scipy.sparse.diags_array(unit))
        looks_at = slice(moves.shape[0], moves.shape[0] + looks.shape[0])
        by = np.ones(matrix.shape[0])
        by[looks_at] = 1.0 / width_m
        scaled = scipy.sparse.csr_array(scipy.sparse.diags_array(by) @ scaled)
        found: FloatArray = most_worth(self._worth * unit / scale, scaled, limits) * unit
        return found
