"""Cells on which the local search counts coverage, and the margin by which it narrows the sensor there.

They are other cells than routes are judged on, so that a route is not laid out for the places of single centres.
"""

from collections.abc import Sequence

from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.search.route_judge import share_seen
from uavcover.planner.search.route_problem import RouteProblem, route_problem, state_of
from uavcover.planner.search.starts import SearchStart
from uavcover.scenario.site import Site
from uavcover.sensing.cells import is_judged_on_smaller_cells, make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap

MARGIN_CELLS = 0.45
"""Reduction of the planner's sensor range, in planning cells, where other cells judge."""

SCATTERED_MARGIN_CELLS = 0.1
"""The same on scattered cells. A route passes them at all distances, so that it barely profits from their centres."""

_FAR_LESS = 0.04
"""A share of coverage: of scripts/bench/kinds.py, photos every 40 m over cliffs are counted 0.05 to 0.2 less than they are
judged, others up to 0.025."""


_LIKELY, _SURER = 0.7, (1.0, 1.5, 2.0, 2.5)
"""Multiples of the distance between two photos along which ground has to be in view. Of 40 routes that searches found over
canyon, terraces and city with a photo every 40 m, 0.7 is counted 0.01 less to 0.015 more than is judged, 0.5 up to 0.04 more."""

_LARGEST_MARGIN, _HALVINGS, _AS_JUDGED = 0.5, 7, 1e-4
"""Largest margin on the finest cells, in cells; halvings to find one; and how far what is counted may be from what is judged."""

_HIDDEN, _LESS_MARGIN = 0.004, (0.05, 0.025, 0.0)
"""Where the narrowed sensor loses more of the best beginning, a share of coverage, its lines have no room for the margin, and a
smaller one, in cells, is tried."""


def search_problem(
    coverage: CoverageMap, judging: CoverageMap, starts: Sequence[SearchStart], goal: float
) -> RouteProblem:
    """The problem of a search: on scattered cells, or at waypoints on the planner's.

    Where lines side by side leave no room for the margin, there is none: a search that sees gaps between all lines which reach
    the goal would close them, or give the goal up.

    Where routes are judged on smaller cells, these see other ground than the planner's do: on the walls of a canyon a search saw
    98.6 % where 93.7 % were judged, and its goal, corrected up to 100 %, had no effect any more.
    """
    site = coverage.site
    if site.scenario.sensor.looks_along_path or is_judged_on_smaller_cells(site):
        scattered = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m, cut=make_scattered_cells)
        problem = scattered_problem(scattered)
        whole = [start for start in starts if start.seen >= goal]
        best = min(whole, key=lambda start: problem.cost(start.route), default=None)
        if best is None or problem.numbers.trigger_m > 0.0 or site.scenario.requirements.looks > 1:
            return problem
        return _with_room(scattered, best.route, (SCATTERED_MARGIN_CELLS, *_LESS_MARGIN), _HIDDEN)
    return _problem(site, coverage, margin_cells=0.0 if judging is coverage else MARGIN_CELLS)


def counted_as_judged(problem: RouteProblem, judging: CoverageMap, starts: Sequence[SearchStart]) -> RouteProblem:
    """The problem; where it counts far less of what photos by distance show than is judged, with likely photos."""
    if problem.numbers.trigger_m == 0.0:
        return problem
    most = max(starts, key=lambda start: start.seen).route
    if share_counted(problem, most) >= share_seen(most, judging) - _FAR_LESS:
        return problem
    return problem.with_pictures_in_view(_LIKELY)


def share_counted(problem: RouteProblem, route: Route) -> float:
    """Share of what can be covered that a search counts of a route."""
    return float(state_of(problem, route, capacity=len(route)).seen[0])


def finest_problem(cells: CoverageMap, route: Route, judged: float) -> RouteProblem:
    """The problem on the finest cells that counts as much of a route as is judged.

    It is for a search for nearly all of the ground.

    Straight legs show more than flown corners do, and photos by distance fall anywhere: where all is counted as seen and less is
    judged, the goal has no effect. So the sensor is narrowed, or ground has to be in view for longer, until as much is missing.
    """
    counted_so = _problem(cells.site, cells, margin_cells=0.0)
    if counted_so.numbers.trigger_m > 0.0:
        surely = counted_so
        for share in _SURER:
            counted_so = surely.with_pictures_in_view(share)
            if share_counted(counted_so, route) <= judged + _AS_JUDGED:
                break
        return counted_so
    low, high = 0.0, _LARGEST_MARGIN
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        counted_so = _problem(cells.site, cells, margin_cells=middle)
        difference = share_counted(counted_so, route) - judged
        if abs(difference) <= _AS_JUDGED:
            break
        low, high = (middle, high) if difference > 0.0 else (low, middle)
    return counted_so


def _with_room(cells: CoverageMap, route: Route, margins: Sequence[float], hidden: float) -> RouteProblem:
    """The problem with the first margin, in cells, that hides no more than a share of what a route sees; else with the last."""
    seen = share_seen(route, cells)
    for margin_cells in margins[:-1]:
        problem = _problem(cells.site, cells, margin_cells=margin_cells)
        if share_counted(problem, route) >= seen - hidden:
            return problem
    return _problem(cells.site, cells, margin_cells=margins[-1])


def scattered_problem(scattered: CoverageMap) -> RouteProblem:
    """The problem of a search on scattered cells."""
    return _problem(scattered.site, scattered, margin_cells=SCATTERED_MARGIN_CELLS)


def _problem(site: Site, coverage: CoverageMap, *, margin_cells: float) -> RouteProblem:
    cell_m = coverage.grid.cells.size_m
    margin_m = margin_cells * cell_m
    reach_m = max(site.scenario.sensor.half_width_m(best_height_agl_m(site)), cell_m)
    return route_problem(coverage, margin_m=margin_m, reach_m=reach_m)
