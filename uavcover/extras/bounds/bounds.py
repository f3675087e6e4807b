"""Proved bounds of a plan, beside its figures: fewest waypoints, most coverage, shortest path.

There are two lower bounds on path length. The tighter one prices the ground (``ground_prices.py``) and takes a while. The
quick one: a curve of length L has at most the area 2 r L + pi r^2 within r of it. Every cell has a
largest distance on the map from which any allowed place sees it. Of the cells for which that is at most r the path must see
all but what may stay unseen, so it comes within r, and half a cell's diagonal, of their area. The best r is taken. The bound
depends on no lattice of places, so no route inside the height band beats it; it is far below the shortest path, because a
path also has to turn.
"""

import math
from collections.abc import Callable

import numpy as np

from uavcover.extras.bounds.ground_prices import lattice_parts, price_ground
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.sight import CONE, farthest_looks, highest_in_squares, horizontal_reach
from uavcover.kernels.surface import GRID
from uavcover.model.route import Bound, Plan, RouteMember
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.set_cover.candidates import finest_lattice_candidates, reduce
from uavcover.planner.set_cover.solvers import CoverProgram, SolverEffort
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import whatever_heading

_MOST_SQUARES_ACROSS = 4_000


def least_path_length_m(coverage: CoverageMap, share: float) -> float:
    """Lower bound in metres on paths that cover a share of the visible ground; 0 without a proof.

    Args:
        coverage: on the cells by which routes are judged.
        share: of what can be covered, 0..1.
    """
    grid, coverable = coverage.grid, coverage.coverable
    side = grid.size_m
    reach = np.sort(farthest_looks_m(coverage)[coverable])
    half_diagonal = side * math.sqrt(0.5)
    # The ground of a cell is at least as large as the cell on the map.
    unseen_m2 = (1.0 - share) * float(grid.weight_m2[coverable].sum())
    radius = reach + half_diagonal
    area_m2 = side**2 * np.arange(1, len(reach) + 1) - unseen_m2
    lengths = (area_m2 - math.pi * radius**2) / (2.0 * radius)
    return max(0.0, float(lengths.max(initial=0.0)))


def farthest_looks_m(coverage: CoverageMap) -> FloatArray:
    """(cells,) no place inside the height band further away on the map sees a cell, metres."""
    sight = whatever_heading(coverage.sight)
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
MOST_PLACES = 20_000
"""The finest lattice on which a bound is proved."""

QUICK_PAIRS = 500_000
"""Places times cells in reach, up to which the linear relaxation is a matter of a second and done without being asked."""

_MET = 1e-9
_ANYWHERE = "any path inside the height band"
_OF_GROUND = "that observes this fraction of the ground itself (found: of the cells, one point in each)"
"""A path may see the counted places of 98 % of the cells and less of the ground: prices say nothing about that one."""


def path_bounds(coverage: CoverageMap, plan: Plan, *, time_s: float = 0.0) -> list[Bound]:
    """Lower bound on paths with the required coverage; for sensors that look along the path.

    The quick bound holds for what is counted: cells, each by one place in it. Prices hold for the ground itself.

    Args:
        coverage: on the cells by which routes are judged.
        plan: the routes.
        time_s: about as long as prices on the ground may take; with 0, or too little for them, the quick bound stays.
    """
    if not coverage.site.scenario.sensor.looks_along_path:
        return []
    share = _asked(plan)
    lengths = [m.metrics.path_length_m for m in _feasible(plan) if m.metrics.coverage_of_coverable >= share - _MET]
    anywhere = "any path" if coverage.site.scenario.limits.applies_to == "waypoints" else _ANYWHERE
    found, quick_m = min(lengths, default=None), least_path_length_m(coverage, share)
    parts = lattice_parts(coverage, time_s)
    priced = None if parts is None else price_ground(coverage, share, parts=parts)
    priced_m = 0.0 if priced is None else priced.least_length_m(share - _MET)
    if priced_m > quick_m:
        proved_on = f"{anywhere} {_OF_GROUND}"
        return [Bound("shortest_path_m", share, priced_m, found, proved_on, "prices on the ground", "ground")]
    return [Bound("shortest_path_m", share, quick_m, found, anywhere, "area within reach of a curve")]


def are_quick(coverage: CoverageMap) -> bool:
    """Whether the linear relaxations on the lattice are a matter of a second."""
    across = 2.0 * horizontal_reach(coverage.sight) / (SPACING_CELLS * coverage.grid.size_m)
    return min(coverage.grid.count * across * across, MOST_PLACES * (SPACING_CELLS * across) ** 2) <= QUICK_PAIRS


def waypoint_bounds(coverage: CoverageMap, plan: Plan, effort: SolverEffort) -> list[Bound]:
    """Fewest waypoints and most coverage on a lattice; for sensors that look from waypoints.

    Args:
        coverage: on the cells by which routes are judged.
        plan: the routes.
        effort: for each question. With no nodes the linear relaxation alone, which is equal for equal plans; otherwise branch
            and bound, and the better of both.
    """
    if coverage.site.scenario.sensor.looks_along_path:
        return []
    spacing_m = SPACING_CELLS * coverage.grid.cells.size_m
    candidates = finest_lattice_candidates(coverage, spacing_m=spacing_m, most=MOST_PLACES)
    program = CoverProgram(reduce(candidates))
    share = min(_asked(plan), program.reachable)
    count = plan.chosen.metrics.waypoint_count
    counts = [m.metrics.waypoint_count for m in _feasible(plan) if m.metrics.coverage_of_coverable >= share - _MET]
    seen = [m.metrics.coverage_of_coverable for m in _feasible(plan) if m.metrics.waypoint_count <= count]
    fewest = _best_proof(max, lambda e: program.fewest_places(share, e).bound, effort)
    most = _best_proof(min, lambda e: program.most_coverage(count, e).bound, effort)
    bounds = []
    if fewest is not None:
        bounds.append(
            Bound("fewest_waypoints", share, fewest[0], min(counts, default=None), candidates.in_words, fewest[1])
        )
    if most is not None:
        bounds.append(Bound("most_coverage", count, most[0], max(seen, default=None), candidates.in_words, most[1]))
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


def _asked(plan: Plan) -> float:
    """The share of what can be covered that the rule asks for; all where it asks for none."""
    asked = parse_rule(plan.rule).required_coverage
    return 1.0 if asked is None else asked


def _feasible(plan: Plan) -> list[RouteMember]:
    return [member for member in (*plan.members, *plan.baselines) if member.violation <= 0.0]
