"""Search for the route of one part.

It is a function of its task alone: any worker gives the same answer.

A cell belongs to one part: to its own, or, once there are routes, to one of those that observe it. So parts can be improved in
parallel, and no cell is required twice or forgotten.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import horizontal_reach
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner.baselines.adaptive_swaths import adaptive_swaths, can_be_adapted, tight_lines
from uavcover.planner.baselines.boustrophedon import Baseline, boustrophedons, fly_layout, long_side_angle_rad
from uavcover.planner.search.goal_search import search_goal
from uavcover.planner.search.local_search import (
    CHAINS,
    PROPOSALS_PER_EVALUATION,
    PaceByClock,
    PaceByNumber,
    SearchPace,
    Work,
    best_starts,
    promising_starts,
    scattered_problem,
)
from uavcover.planner.search.route_problem import RouteJudge
from uavcover.planner.search.tuning import TUNED
from uavcover.scenario.site import Site, forget_computed
from uavcover.scenario.vehicles import Piece, polygons_of
from uavcover.sensing.cells import make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_maps, planning_map

_LATER_STAGES = (0.4, 0.7, 0.85, 1.0)
"""After the first round, in place of the stages of ``TUNED``: what begins is good already."""
_STRAIGHT = 6
"""This number of straight layouts is tried as initial solutions."""


@dataclass(frozen=True, slots=True, eq=False)
class Neighbour:
    """The route of another part."""

    route_m: FloatArray  # (n, 3) its waypoints
    first: bool  # whether a cell that both observe is its own


@dataclass(frozen=True, slots=True, eq=False)
class PartTask:
    """Search task of one part."""

    number: int  # of the part, from 0
    round: int  # of the search, from 0
    area_wkb: bytes  # the part, as well-known binary
    goal: float  # required fraction of the coverable ground
    seed: int  # of the whole search
    evaluations: int  # of the local search, PROPOSALS_PER_EVALUATION proposals each
    budget_s: float | None = None  # or a time budget
    # (n, 3) the route so far; none in the first round where lines are to be laid out for the part
    route_m: FloatArray | None = None
    neighbours: tuple[Neighbour, ...] = ()  # the routes that observe some of the part

    @property
    def area(self) -> Piece:
        """The part, east and north metres."""
        return polygons_of(shapely.from_wkb(self.area_wkb))


class PartCells:
    """The cells that one part has to observe."""

    def __init__(self, task: PartTask) -> None:
        self._task = task
        self._area = task.area

    def required(self, coverage: CoverageMap) -> CoverageMap:
        """The map, with only these cells to observe."""
        task = self._task
        own = np.asarray(shapely.contains_xy(self._area, *coverage.grid.middles_m.T))
        if task.route_m is None:
            return coverage.restricted_to(own)
        by_itself = coverage.observed(task.route_m)
        first = self._observed_by(coverage, first=True)
        later = self._observed_by(coverage, first=False)
        return coverage.restricted_to(~first & (by_itself | (own & ~later)))

    def _observed_by(self, coverage: CoverageMap, *, first: bool) -> BoolArray:
        observed = np.zeros(coverage.grid.count, dtype=bool)
        for neighbour in self._task.neighbours:
            if neighbour.first == first:
                observed |= coverage.observed(neighbour.route_m)
        return observed


def search_part(site: Site, task: PartTask, *, now: Callable[[], float], should_stop: Callable[[], bool]) -> Route:
    """Search for the route of a part.

    Args:
        site: of the whole area.
        task: what to do.
        now: the clock of a budget.
        should_stop: called between batches; the best so far is returned.
    """
    part = dataclasses.replace(site, area=_searched_area(site, task), whole=site, block_cells=None)
    try:
        return _search(part, task, now=now, should_stop=should_stop)
    finally:
        forget_computed(part)


def _search(part: Site, task: PartTask, *, now: Callable[[], float], should_stop: Callable[[], bool]) -> Route:
    begin = now()
    cells = PartCells(task)
    scattered = cells.required(CoverageMap(part, cell_size_m=part.scenario.area.cell_size_m, cut=make_scattered_cells))
    problem = scattered_problem(scattered)
    judges = [cells.required(each) for each in judging_maps(part)]
    lines = _constructed(part, task.goal) if task.route_m is None else [Route(task.route_m)]
    starts = promising_starts(
        problem, lines, task.goal, lambda route: scattered.fraction_of_coverable(scattered.observed(route.waypoints_m))
    )
    pace: SearchPace
    if task.budget_s is None:
        pace = PaceByNumber(task.evaluations * PROPOSALS_PER_EVALUATION)
    else:
        pace = PaceByClock(now, begin + task.budget_s)

    known: dict[bytes, float] = {}

    def judged(route: Route) -> float:
        key = route.waypoints_m.tobytes()
        if key not in known:
            known[key] = min(each.fraction_of_coverable(each.observed(route.waypoints_m)) for each in judges)
        return known[key]

    # a short search may end with worse than what it began with.
    found = [best_starts(problem, starts, task.goal)[0].route]
    seeds = np.random.SeedSequence([task.seed, task.round, task.number]).spawn(CHAINS)
    work = Work(problem, pace, [np.random.default_rng(seed) for seed in seeds], None, should_stop, lambda _: None)
    tuned = TUNED.goal
    capacity = tuned.path_capacity * max(len(route) for route in lines) + tuned.spare_waypoints
    judge = RouteJudge(lambda route, _: judged(route), found.append)
    stages = tuned.main_stages if task.round == 0 else _LATER_STAGES
    search_goal(work, starts, task.goal, capacity, (0.0, 1.0), stages, judge)
    margin_m = part.scenario.limits.height_margin_m

    def merit(route: Route) -> tuple[bool, float, float]:
        short = max(0.0, task.goal - judged(route))
        return measure_violations(part, route.waypoints_m, margin_m=margin_m).total > 0.0, short, problem.cost(route)

    return min(found, key=merit)


def _searched_area(site: Site, task: PartTask) -> Piece:
    """The part; later what its route observes beside it, too."""
    if task.route_m is None:
        return task.area
    reach_m = horizontal_reach(site.scenario.sensor.sight) + site.scenario.area.cell_size_m
    observed = shapely.union(task.area, shapely.LineString(task.route_m[:, :2]).buffer(reach_m))
    return polygons_of(shapely.intersection(observed, site.area))


def _constructed(part: Site, goal: float) -> list[Route]:
    """Lines over a part that keep the limits; where none does, what is nearest to it.

    Lines that bend, in two directions; straight ones, begun at either end, for a sensor whose strip cannot be measured, or where
    no line that bends keeps the limits.
    """
    margin_m = part.scenario.limits.height_margin_m

    def broken(route: Route) -> float:
        return measure_violations(part, route.waypoints_m, margin_m=margin_m).total

    made: list[tuple[Route, float]] = []
    if can_be_adapted(part):
        angle_rad = long_side_angle_rad(part.area)
        tight = tight_lines(part, angle_rad) + tight_lines(part, angle_rad + 0.5 * math.pi)
        made = [(route, broken(route)) for route in adaptive_swaths(part, angle_rad) + tight]
    if all(much > 0.0 for _, much in made):
        made += [(route, broken(route)) for route in _straight(part, goal)]
    least = min(much for _, much in made)
    return [route for route, much in made if much <= max(0.0, least)]


def _straight(part: Site, goal: float) -> list[Route]:
    """The best boustrophedons of a short scan."""
    batches = iter([False])
    coarse = planning_map(part)
    required = goal * coarse.fraction(coarse.coverable)
    tried = boustrophedons(coarse, should_stop=lambda: next(batches, True))
    return [
        fly_layout(part, dataclasses.replace(each.layout, start=start))
        for each in sorted(tried, key=lambda b: (b.violation, _merit(b, required)))[:_STRAIGHT]
        if each.layout is not None
        for start in (0, 1)
    ]


def _merit(baseline: Baseline, required: float) -> float:
    """Cost, with a penalty for missing coverage."""
    return TUNED.goal.start_cost(float(baseline.objectives[2]), -float(baseline.objectives[0]), required)
