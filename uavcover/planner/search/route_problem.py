"""The problem of the local search, routes as its incremental state, and their evaluation.

The problem describes a site to the kernels. Judges compute coverage on the evaluation grid.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.nadir_visibility import cone_cells
from uavcover.kernels.path_cost import LENGTH, route_cost
from uavcover.kernels.photo_visibility import photo_cells
from uavcover.kernels.route_state import RouteState, recount
from uavcover.kernels.search_problem import ALONG_PATH, AT_WAYPOINTS, RouteLimits, SearchProblem, flyable_ground
from uavcover.kernels.sight import horizontal_reach
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Route
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import narrowed, sample_spacing_m, trigger_distance_m

MOST_WAYPOINTS = 60_000
"""Longer routes are not searched, because counts of a cell have 16 bits."""

_RUNS_OF_A_ROW = 3
"""Average runs of cells that a leg observes in the rows it passes. There is room for them on a leg across the whole area."""


@dataclass(frozen=True, slots=True, eq=False)
class RouteProblem:
    """The kernels' view of a site."""

    numbers: SearchProblem  # for :mod:`uavcover.kernels.annealing`
    reach_m: float  # horizontal radius of the view from the middle of the height band
    stride: int  # most numbers that the runs of a segment may have

    def cost(self, route: Route) -> float:
        """Cost of a route without missing coverage: its length or the planner's objective, plus the penalty for waypoints."""
        return float(route_cost(self.numbers.surface, self.numbers.path_cost, route.waypoints_m))

    def cost_of_path(self, route: Route) -> float:
        """The cost without the penalty for waypoints."""
        path_cost = self.numbers.path_cost._replace(waypoint_price=0.0)
        return float(route_cost(self.numbers.surface, path_cost, route.waypoints_m))

    @property
    def is_of_length(self) -> bool:
        """Whether the cost of a path is its length."""
        return bool(self.numbers.path_cost.unit == LENGTH and self.numbers.path_cost.deviation_price == 0.0)

    def metres_per_cost(self, route: Route) -> float:
        """Factor from cost to metres of path, from a route that has both; 1 if the cost is the length."""
        if self.is_of_length:
            return 1.0
        cost = self.cost(route)
        return route.length_m / cost if cost > 0.0 and route.length_m > 0.0 else 1.0

    def with_photos_in_view(self, fraction: float) -> "RouteProblem":
        """The problem that counts ground in view along at least this multiple of the trigger distance.

        At least this number of photos shows such ground. On cliffs, little ground is in view all the way: on terraces with a
        photo every 40 m, lines that observe 98 % were counted as 79 %. A larger multiple makes photos surer.
        """
        return replace(self, numbers=self.numbers._replace(trigger_m=fraction * self.numbers.trigger_m))

    @property
    def free_order(self) -> bool:
        """Whether waypoints can be visited in any order, because legs neither observe nor have limits."""
        return self.numbers.sensing == AT_WAYPOINTS and self.numbers.limits.legs == 0


def route_problem(coverage: CoverageMap, *, margin_m: float, reach_m: float) -> RouteProblem:
    """The kernels' view of a site; only visible cells count.

    Args:
        coverage: the cells to count on.
        margin_m: reduction of the sensor's range on the map, so that a route does not exploit the exact positions of cell
            centres.
        reach_m: horizontal radius of the view from a usual height.
    """
    site = coverage.site
    scenario = site.scenario
    cells = coverage.grid.cells
    square = np.empty(coverage.grid.count, dtype=np.int32)
    positions = np.flatnonzero(cells.lattice >= 0)
    square[cells.lattice.ravel()[positions]] = positions
    counted = np.where(coverage.coverable, coverage.grid.weight_m2, 0.0)
    weight = np.zeros(cells.lattice.size)
    weight[square] = counted / max(float(counted.sum()), 1e-300)
    for array in (square, weight):
        array.flags.writeable = False
    sight = narrowed(coverage.sight, margin_m=margin_m, reach_m=reach_m)
    numbers = SearchProblem(
        site.ground.surface,
        sight,
        cells,
        cone_cells(site.ground.surface, sight, cells),
        photo_cells(site.ground.surface, sight, cells),
        square,
        weight,
        sample_spacing_m(scenario),
        ALONG_PATH if scenario.sensor.looks_along_path else AT_WAYPOINTS,
        _limits(site),
        path_cost_of(site),
        scenario.requirements.looks,
        scenario.requirements.look_distance_m or 0.0,
        trigger_distance_m(scenario) or 0.0,
    )
    across = 2.0 * horizontal_reach(sight) / cells.size_m + 2.0
    # From a position, every other cell in reach may be visible. A leg has few runs per row, or is split.
    with_scatter = across + 2.0 * cells.scatter_m / cells.size_m
    stride = int(0.25 * math.pi * with_scatter * with_scatter) + 8
    if scenario.sensor.looks_along_path:
        stride = max(stride, int(40.0 * across) + 2 * _RUNS_OF_A_ROW * cells.lattice.shape[0])
    return RouteProblem(numbers, reach_m, stride)


def _limits(site: Site) -> RouteLimits:
    limits = site.scenario.limits
    # Height above sea level less up: smallest at the origin, largest at the far corners, where the Earth has curved away.
    fence = shapely.get_coordinates(site.fence)
    positions = np.column_stack([np.vstack([fence, [[0.0, 0.0]]]), np.zeros(len(fence) + 1)])
    sea = site.alts_amsl_m(positions)
    lowest = -math.inf if limits.min_alt_amsl_m is None else limits.min_alt_amsl_m - float(sea.min())
    highest = math.inf if limits.max_alt_amsl_m is None else limits.max_alt_amsl_m - float(sea.max())
    return RouteLimits(
        lowest_agl_m=limits.min_height_agl_m + limits.height_margin_m,
        highest_agl_m=limits.max_height_agl_m - limits.height_margin_m,
        lowest_up_m=lowest,
        highest_up_m=highest,
        max_slope=math.tan(math.radians(limits.max_climb_angle_deg)),
        legs=1 if limits.applies_to == "legs" else 0,
        ground=flyable_ground(flyable_area(site).polygon),
        beside_m=site.scenario.obstacles.clearance_beside_m,
        above_m=site.scenario.obstacles.clearance_above_m,
    )


def state_of(problem: RouteProblem, route: Route, *, capacity: int) -> RouteState:
    """Incremental state of a route with its observations counted. The longest legs are split until each one fits.

    Args:
        problem: the problem.
        route: at least one waypoint.
        capacity: largest number of waypoints; larger if the route already has more.
    """
    points = _apart(np.array(route.waypoints_m), problem.numbers.apart_m)
    while True:
        state = _empty(problem, points, capacity)
        if recount(problem.numbers, state):
            return state
        points = _halved(points)


def _empty(problem: RouteProblem, points: FloatArray, capacity: int) -> RouteState:
    cells = problem.numbers.cells
    state = RouteState.empty(
        capacity=min(max(capacity, len(points)), MOST_WAYPOINTS),
        stride=problem.stride,
        squares=cells.lattice.size,
        cells=len(cells.centre_m),
        columns=cells.lattice.shape[1],
    )
    state.size[0] = len(points)
    state.route[: len(points)] = points
    return state


def _apart(points: FloatArray, apart_m: float) -> FloatArray:
    """The points without those closer than ``apart_m`` to an earlier one."""
    if apart_m == 0.0:
        return points
    kept: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) >= apart_m for other in kept):
            kept.append(point)
    return np.array(kept)


def _halved(points: FloatArray) -> FloatArray:
    """(m, 3) points: the given ones, and the midpoints of the legs longer than half the longest."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    split = np.flatnonzero(lengths > 0.5 * lengths.max())
    return np.insert(points, split + 1, 0.5 * (points[split] + points[split + 1]), axis=0)


SAFETY = 0.0003
"""Fraction of the coverage by which a route should exceed its goal on the finest cells, because other cells give less."""


def with_safety(goal: float) -> float:
    """Target coverage of a search for a goal: SAFETY more, or half of the remaining coverage."""
    return goal + min(SAFETY, 0.5 * (1.0 - goal))


@dataclass(frozen=True, slots=True, eq=False)
class RouteJudge:
    """Evaluates the routes of a search."""

    # coverage of the visible ground on the evaluation grid; exact if the route may reach the given goal
    coverage: Callable[[Route, float], float]
    found: Callable[[Route], None]  # called with every route worth judging
    # a route with a repair that reaches a goal; None if that is too slow. It receives a test whether the time is over.
    closed: Callable[[Route, float, Callable[[], bool]], Route | None] = lambda _route, _goal, _is_over: None


def fraction_observed(route: Route, cells: CoverageMap) -> float:
    """Fraction of the visible ground that a route observes."""
    return cells.fraction_of_coverable(cells.observed(route.waypoints_m))


class OneAfterTheOther:
    """Least coverage of a route on several maps, the first one first; a route that misses its goal skips the others.

    The skipped maps count as much less as they did for the last route that reached its goal.
    """

    def __init__(self, judges: Sequence[CoverageMap]) -> None:
        self._judges = judges
        self._less = 0.0

    def __call__(self, route: Route, goal: float) -> float:
        """Fraction of the visible ground, exact if it reaches the goal."""
        first = fraction_observed(route, self._judges[0])
        if first < goal:
            return first - self._less
        least = min([first, *(fraction_observed(route, judge) for judge in self._judges[1:])])
        self._less = first - least
        return least
