"""Cells on which the local search counts coverage, and the margin by which it narrows the sensor there.

They are other cells than routes are judged on, so that a route is not laid out for the places of single centres.
"""

from collections.abc import Sequence

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


def search_problem(coverage: CoverageMap, judging: CoverageMap) -> RouteProblem:
    """The problem of a search: on scattered cells, or at waypoints on the planner's.

    Where routes are judged on smaller cells, these see other ground than the planner's do: on the walls of a canyon a search saw
    98.6 % where 93.7 % were judged, and its goal, corrected up to 100 %, had no effect any more.
    """
    site = coverage.site
    if site.scenario.sensor.looks_along_path or is_judged_on_smaller_cells(site):
        return scattered_problem(
            CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m, cut=make_scattered_cells)
        )
    return _problem(site, coverage, margin_cells=0.0 if judging is coverage else MARGIN_CELLS)


def counted_as_judged(problem: RouteProblem, judging: CoverageMap, starts: Sequence[SearchStart]) -> RouteProblem:
    """The problem; where it counts far less of what photos by distance show than is judged, with likely photos."""
    if problem.numbers.trigger_m == 0.0:
        return problem
    most = max(starts, key=lambda start: start.seen).route
    counted = float(state_of(problem, most, capacity=len(most)).seen[0])
    return problem.with_likely_pictures() if counted < share_seen(most, judging) - _FAR_LESS else problem


def scattered_problem(scattered: CoverageMap) -> RouteProblem:
    """The problem of a search on scattered cells."""
    return _problem(scattered.site, scattered, margin_cells=SCATTERED_MARGIN_CELLS)


def _problem(site: Site, coverage: CoverageMap, *, margin_cells: float) -> RouteProblem:
    cell_m = coverage.grid.cells.size_m
    margin_m = margin_cells * cell_m
    reach_m = max(site.scenario.sensor.half_width_m(best_height_agl_m(site)), cell_m)
    return route_problem(coverage, margin_m=margin_m, reach_m=reach_m)
