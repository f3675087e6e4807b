"""Proved bounds of a plan, beside its figures: fewest waypoints, most coverage, shortest path.

There are two lower bounds on path length. The tighter one prices the ground (``ground_prices.py``) and takes a while. The quick
one: a curve of length L has at most the area 2 r L + pi r^2 within r of it. Every cell has a largest distance on the map from
which any allowed position observes it. Of the cells for which that is at most r the path must observe all but what may stay
unseen, so it comes within r, and half a cell's diagonal, of their area. The best r is taken. The bound depends on no lattice of
places, so no route inside the height band beats it; it is far below the shortest path, because a path also has to turn.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from uavcover.extras.bounds.bound_heights import relief_over
from uavcover.extras.bounds.ground_prices import WINDOW_FIELDS, NodePrices, rates_in_squares
from uavcover.extras.bounds.programs import (
    CoverProgram,
    PriceProgram,
    SolverEffort,
    headings_over_half_a_turn,
    middles_of_bins,
)
from uavcover.extras.bounds.relief import Relief, farthest_looks, looks_from_tiles
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.sight import CONE, highest_in_squares, horizontal_reach
from uavcover.kernels.surface import GRID
from uavcover.model.route import Bound, Plan, RouteMember
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.set_cover import finest_lattice_candidates, reduce
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import any_heading

# Lower bound on path length by prices on the ground: prices of a linear program, proved for any result of it.
#
# The proof looks at all places and all headings (:mod:`uavcover.extras.bounds.ground_prices`) and divides the price of each
# cell by the largest rate of the places to whose gain it may add; prices that the program got wrong make the bound
# lower, never wrong.

_SQUARES_A_CELL = (8, 6, 4, 3, 2, 1)
"""Squares of the lattice along the side of a cell: the finer, the higher the bound, and the longer the proof takes."""
_BINS_A_SECOND = 1.28e6
"""Direction bins a second of the whole proof, from all squares together, on one core."""
_BINS_A_SIDE = 1.6
"""Direction bins a square's side at the end of view."""
_SLACK = 0.19
"""Fraction of a square's side by which distances may change without another look. With this number a window has three squares."""
_OFFSETS = ((0, 0), (1, 1), (0, 1), (1, 0))
"""Offsets of these positions, in halves of their distance: other ones each time."""
_NEARLY = 1.005
"""A rate that is not worth another look."""
_TILES = (16, 4, 1, 0)


@dataclass(frozen=True, slots=True, eq=False)
class PricedGround:
    """Prices that no path gains faster than it flies."""

    prices_m: FloatArray  # (cells,) of the visible ground, metres, at least 0
    highest_m: FloatArray  # (cells,) the price if all of a cell cost as much as its most expensive point
    weight_m2: FloatArray  # (cells,) ground in each of them
    first_look_m: float  # what is observed at any one place is worth at most this

    def least_length_m(self, fraction: float) -> float:
        """Lower bound in metres on paths that cover a fraction of the ground: the view is worth its length and one look.

        What may stay unseen is what saves most for its weight, part of a cell included.
        """
        order = np.argsort(-self.highest_m / self.weight_m2, kind="stable")
        weight = self.weight_m2[order]
        before = np.cumsum(weight) - weight
        unobserved = np.clip((1.0 - fraction) * float(weight.sum()) - before, 0.0, weight) / weight
        saved_m = np.minimum(self.highest_m[order] * unobserved, self.prices_m[order])
        return max(0.0, float(self.prices_m.sum() - saved_m.sum()) - self.first_look_m)


def lattice_parts(coverage: CoverageMap, time_s: float) -> int | None:
    """Squares a cell of the finest lattice whose proof takes about ``time_s``; None where every lattice takes longer."""
    size_m, reach = coverage.grid.size_m, horizontal_reach(any_heading(coverage.sight))
    west, south, east, north = coverage.site.area.bounds
    for parts in _SQUARES_A_CELL:
        squares = (east - west + 2.0 * reach) * (north - south + 2.0 * reach) * (parts / size_m) ** 2
        if squares * _bins(reach, size_m / parts) <= _BINS_A_SECOND * time_s:
            return parts
    return None


def _bins(reach: float, side: float) -> int:
    """Direction bins: at the end of view somewhat narrower than a square."""
    return 8 * max(8, math.ceil(2.0 * math.pi * reach * _BINS_A_SIDE / (8.0 * side)))


def price_ground(coverage: CoverageMap, fraction: float, *, parts: int) -> PricedGround | None:
    """Prices for paths that cover a fraction of the visible ground of the cells; None without visible ground.

    Args:
        coverage: on the evaluation grid.
        fraction: of the visible ground, 0..1.
        parts: squares of the lattice of places along the side of a cell.
    """
    weight_m2 = coverable_weight_m2(coverage)
    if not weight_m2.any():
        return None
    relief = relief_over(coverage, parts)
    program = PriceProgram(coverage, weight_m2, relief, fraction)
    near = scipy.ndimage.distance_transform_edt(~program.priced) * relief.side < relief.reach
    step = max(1, max(relief.allowed.shape) // 120)
    where = np.argwhere((relief.allowed & near)[step // 2 :: step, step // 2 :: step]) * step + step // 2
    program.look_at(where, np.ones(len(where)))
    program.solve()
    stride = 2 * parts  # between places that are looked at in passing
    for look in range(6):
        # Where rates come out largest, of places that are looked at in passing, prices are tried next, with what the proof
        # adds there for all that it does not know exactly: the largest around, and all in the upper half of the excess.
        down, along = _OFFSETS[look % len(_OFFSETS)]
        offset = (down * stride // 2, along * stride // 2)
        rates = _rates(relief, program, stride, offset)[0][offset[0] :: stride, offset[1] :: stride]
        peaks = (rates >= scipy.ndimage.maximum_filter(rates, 3)) & (rates > _NEARLY)
        worst = peaks | (rates > max(_NEARLY, 0.5 * (1.0 + float(rates.max()))))
        where = (np.argwhere(worst) * stride + offset).astype(np.int64)
        if not len(where):
            break
        program.look_at(where, _overhead(program, where, rates[worst]))
        program.solve()
    _, largest = _rates(relief, program, 1, (0, 0))
    divisor = program.of_cells(largest) * (1.0 + 1e-9)
    # Ground that no place gains has no price.
    by = np.divide(1.0, divisor, out=np.zeros_like(divisor), where=divisor > 0.0)
    prices_m, highest_m = program.worth_m()
    look_m = _first_look_m(relief, program, by)
    return PricedGround(prices_m * by, highest_m * by, program.weight_m2, look_m)


def coverable_weight_m2(coverage: CoverageMap) -> FloatArray:
    """(cells,) ground in each cell, 0 where it cannot be covered."""
    weight: FloatArray = np.where(coverage.coverable, coverage.grid.weight_m2, 0.0)
    return weight


def _rates(
    relief: Relief, program: PriceProgram, stride: int, offset: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """(rows, columns) bounds of rates, 0 if none is examined. Also the largest to which each cell adds, 0 where to none."""
    bins = _bins(relief.reach, relief.side)
    rows, columns = relief.allowed.shape
    rates, largest = np.zeros((rows, columns)), np.zeros((rows // program.parts, columns // program.parts))
    rates_in_squares(
        relief, _prices(relief, program, bins), middles_of_bins(bins), 2, headings_over_half_a_turn(48), stride,
        offset, program.parts, rates, largest,
    )  # fmt: skip
    return rates, largest


def _overhead(program: PriceProgram, where: IntArray, rates: FloatArray) -> FloatArray:
    """Ratio of proved rates to those of the program at the same positions."""
    sampled = program.rates_at(where)
    return np.clip(np.divide(rates, sampled, out=np.ones_like(rates), where=sampled > 0.0), 1.0, 1.5)


def _corners(nodes: FloatArray) -> FloatArray:
    """(4, rows, columns) numbers at the corners of each square."""
    return np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]])


def _prices(relief: Relief, program: PriceProgram, bins: int) -> NodePrices:
    per_m2, slack, side = program.at_nodes(), _SLACK * relief.side, relief.side
    around = 0.5 * side + relief.reach * math.pi / bins + slack
    squares = math.ceil(2.0 * around / side) + 1
    windows = np.empty((*relief.allowed.shape, WINDOW_FIELDS))
    field = 0
    for nodes in (relief.ground_m, per_m2):
        for slopes in (np.diff(nodes, axis=1) / side, np.diff(nodes, axis=0) / side):
            ends = (slopes[:-1], slopes[1:]) if slopes.shape[0] > windows.shape[0] else (slopes[:, :-1], slopes[:, 1:])
            windows[:, :, field] = _over_windows(np.minimum(*ends), squares, least=True)
            windows[:, :, field + 1] = _over_windows(np.maximum(*ends), squares, least=False)
            field += 2
        if field == 4:
            windows[:, :, field] = _over_windows(
                np.where(program.priced, _corners(per_m2).max(axis=0), 0.0), squares, least=False
            )
            field += 1
    return NodePrices(per_m2, windows, around, slack)


def _over_windows(values: FloatArray, squares: int, *, least: bool) -> FloatArray:
    """Least or largest of ``squares`` rows and columns from each square on towards north-east."""
    merge = np.minimum if least else np.maximum
    for axis in (0, 1):
        merged = values.copy()
        for k in range(1, min(squares, values.shape[axis])):
            if axis == 0:
                merge(merged[:-k], values[k:], out=merged[:-k])
            else:
                merge(merged[:, :-k], values[:, k:], out=merged[:, :-k])
        values = merged
    return values


def _first_look_m(relief: Relief, program: PriceProgram, by: FloatArray) -> float:
    """Bound on the worth of any position's view, with the prices of cells times ``by``. Closer where it may be largest."""
    mean = _corners(program.at_nodes()).mean(axis=0) * program.by_squares(by)
    # a look that is as good as the program's may well be there, so smaller ones need no closer look.
    enough = program.first_look_m
    coarser, before = np.full((1, 1), math.inf), max(relief.allowed.shape)
    for tile in _TILES:
        each = max(tile, 1)
        shape = tuple(math.ceil(count / each) for count in relief.allowed.shape)
        i, j = (np.arange(count) * each // before for count in shape)
        wanted: BoolArray = coarser[np.ix_(i, j)] > enough
        looks = np.zeros(shape)
        looks_from_tiles(relief, mean, tile, wanted, looks)
        if tile == 0:
            # Away from the middle no more comes into view than twice what a metre gains, times the way.
            looks[wanted] += 2.0 * math.sqrt(0.5) * relief.side
            looks = np.minimum(looks, coarser)
        coarser, before = looks, each
    return max(enough, float(coarser.max()))


_MOST_SQUARES_ACROSS = 4_000


def least_path_length_m(coverage: CoverageMap, fraction: float) -> float:
    """Lower bound in metres on paths that cover a fraction of the visible ground; 0 without a proof.

    Args:
        coverage: on the evaluation grid.
        fraction: of the visible ground, 0..1.
    """
    grid, coverable = coverage.grid, coverage.coverable
    side = grid.size_m
    reach = np.sort(farthest_looks_m(coverage)[coverable])
    half_diagonal = side * math.sqrt(0.5)
    # The ground of a cell is at least as large as the cell on the map.
    unobserved_m2 = (1.0 - fraction) * float(grid.weight_m2[coverable].sum())
    radius = reach + half_diagonal
    area_m2 = side**2 * np.arange(1, len(reach) + 1) - unobserved_m2
    lengths = (area_m2 - math.pi * radius**2) / (2.0 * radius)
    return max(0.0, float(lengths.max(initial=0.0)))


def farthest_looks_m(coverage: CoverageMap) -> FloatArray:
    """(cells,) no place inside the height band further away on the map observes a cell, metres."""
    sight = any_heading(coverage.sight)
    reach = horizontal_reach(sight)
    # Where limits apply to waypoints alone, the legs between them may be at any height.
    if sight.kind != CONE or coverage.site.scenario.limits.applies_to == "waypoints":
        return np.full(coverage.grid.count, reach)
    tops, east0, north0, side = _tops(coverage, reach)
    looks = [
        farthest_looks(block.grid.cells.centre_m, tops, east0, north0, side, sight.tan_half_fov, reach)
        for block in coverage.blocks()
    ]
    return np.concatenate(looks)


def _tops(coverage: CoverageMap, reach_m: float) -> tuple[FloatArray, float, float, float]:
    """Highest allowed up over squares around the area, with their south-west corner and side."""
    surface, limits = coverage.site.ground.surface, coverage.site.scenario.limits
    highest_agl_m = limits.max_height_agl_m - limits.height_margin_m
    west, south, east, north = coverage.site.area.bounds
    east0, north0 = west - reach_m, south - reach_m
    across = max(east - west, north - south) + 2.0 * reach_m
    if surface.kind == GRID:
        side = max(0.5 * surface.step_m, coverage.grid.size_m, across / _MOST_SQUARES_ACROSS)
        count = math.ceil(across / side)
        # Plumb lines lean: above its ground a place of the band may stand a little aside of it, and so a little higher.
        lean_m = surface.grid.lean * highest_agl_m
        return highest_in_squares(surface, east0, north0, side, count, lean_m) + highest_agl_m, east0, north0, side
    side = max(0.25 * coverage.grid.size_m, across / _MOST_SQUARES_ACROSS)
    steps = side * np.arange(math.ceil(across / side) + 1)
    grid_e, grid_n = np.meshgrid(east0 + steps, north0 + steps)
    nodes = coverage.site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()])).reshape(grid_e.shape)
    corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]])
    highest = corners.max(axis=0) + surface.steepest * side * math.sqrt(0.5)
    return np.ascontiguousarray(highest + highest_agl_m), east0, north0, side


SPACING_CELLS = 0.5
MOST_POSITIONS = 20_000
"""The finest lattice on which a bound is proved."""

QUICK_PAIRS = 500_000
"""Places times cells in reach, up to which the linear relaxation is a matter of a second and done without being asked."""

_MET = 1e-9
_ANYWHERE = "any path inside the height band"
_OF_GROUND = "that observes this fraction of the ground itself (found: of the cells, one point in each)"
"""A path may observe the counted places of 98 % of the cells and less of the ground: prices say nothing about that one."""


def path_bounds(coverage: CoverageMap, plan: Plan, *, time_s: float = 0.0) -> list[Bound]:
    """Lower bound on paths with the required coverage; for sensors that look along the path.

    The quick bound holds for counted cells, each represented by one position. Prices hold for the ground itself.

    Args:
        coverage: on the evaluation grid.
        plan: the routes.
        time_s: about as long as prices on the ground may take; with 0, or too little for them, the quick bound stays.
    """
    if not coverage.site.scenario.sensor.looks_along_path:
        return []
    fraction = _required(plan)
    lengths = [m.metrics.path_length_m for m in _feasible(plan) if m.metrics.coverage_of_coverable >= fraction - _MET]
    anywhere = "any path" if coverage.site.scenario.limits.applies_to == "waypoints" else _ANYWHERE
    found, quick_m = min(lengths, default=None), least_path_length_m(coverage, fraction)
    parts = lattice_parts(coverage, time_s)
    priced = None if parts is None else price_ground(coverage, fraction, parts=parts)
    priced_m = 0.0 if priced is None else priced.least_length_m(fraction - _MET)
    if priced_m > quick_m:
        proved_on = f"{anywhere} {_OF_GROUND}"
        return [Bound("shortest_path_m", fraction, priced_m, found, proved_on, "prices on the ground", "ground")]
    return [Bound("shortest_path_m", fraction, quick_m, found, anywhere, "area within reach of a curve")]


def are_quick(coverage: CoverageMap) -> bool:
    """Whether the linear relaxations on the lattice are a matter of a second."""
    across = 2.0 * horizontal_reach(coverage.sight) / (SPACING_CELLS * coverage.grid.size_m)
    return min(coverage.grid.count * across * across, MOST_POSITIONS * (SPACING_CELLS * across) ** 2) <= QUICK_PAIRS


def waypoint_bounds(coverage: CoverageMap, plan: Plan, effort: SolverEffort) -> list[Bound]:
    """Fewest waypoints and most coverage on a lattice; for sensors that look from waypoints.

    Args:
        coverage: on the evaluation grid.
        plan: the routes.
        effort: for each question. With no nodes the linear relaxation alone, which is equal for equal plans; otherwise branch
            and bound, and the better of both.
    """
    if coverage.site.scenario.sensor.looks_along_path:
        return []
    spacing_m = SPACING_CELLS * coverage.grid.cells.size_m
    candidates = finest_lattice_candidates(coverage, spacing_m=spacing_m, most=MOST_POSITIONS)
    program = CoverProgram(reduce(candidates))
    fraction = min(_required(plan), program.reachable)
    count = plan.chosen.metrics.waypoint_count
    counts = [m.metrics.waypoint_count for m in _feasible(plan) if m.metrics.coverage_of_coverable >= fraction - _MET]
    observed = [m.metrics.coverage_of_coverable for m in _feasible(plan) if m.metrics.waypoint_count <= count]
    fewest = _best_proof(max, lambda e: program.fewest_positions(fraction, e).bound, effort)
    most = _best_proof(min, lambda e: program.most_coverage(count, e).bound, effort)
    bounds = []
    if fewest is not None:
        bounds.append(
            Bound("fewest_waypoints", fraction, fewest[0], min(counts, default=None), candidates.text, fewest[1])
        )
    if most is not None:
        bounds.append(Bound("most_coverage", count, most[0], max(observed, default=None), candidates.text, most[1]))
    return bounds


def _best_proof(
    tighter: Callable[..., tuple[float, str]], ask: Callable[[SolverEffort], float | None], effort: SolverEffort
) -> tuple[float, str] | None:
    """The tighter limit of relaxation and branch and bound, with its name; None when neither finished."""
    proofs = [(ask(SolverEffort(time_s=effort.time_s, nodes=0)), "linear relaxation")]
    if effort.nodes != 0:
        proofs.append((ask(effort), "branch and bound"))
    known = [(limit, method) for limit, method in proofs if limit is not None]
    return tighter(known, key=lambda proof: proof[0]) if known else None


def _required(plan: Plan) -> float:
    """The fraction of the visible ground that the rule asks for; all where it asks for none."""
    required = parse_rule(plan.rule).required_coverage
    return 1.0 if required is None else required


def _feasible(plan: Plan) -> list[RouteMember]:
    return [member for member in (*plan.members, *plan.baselines) if member.violation <= 0.0]
