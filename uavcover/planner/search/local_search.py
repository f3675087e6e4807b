"""The local search: its initial solutions, its cells, and parallel annealing chains.

Chains run in batches until the evaluations or the time are used up. The cells differ from the evaluation grid, and the sensor is
narrowed by a margin, so that a route does not exploit the exact positions of cell centres.
"""

import bisect
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np

from uavcover.kernels import annealing
from uavcover.kernels.annealing import Schedule, Weights
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.route_state import RouteState
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.search.route_problem import RouteProblem, fraction_observed, route_problem, state_of
from uavcover.planner.search.tuning import TUNED, GoalTuning, SearchTuning
from uavcover.scenario.site import Site
from uavcover.sensing.cells import is_judged_on_smaller_cells, make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap

CHAINS = 2
"""Chains in parallel, for any number of threads: the result must not depend on it."""

PROPOSALS_PER_EVALUATION = 50
"""This number of proposals counts as one evaluation: about what they cost in time (docs/results/coverage.md)."""

_BATCHES = 400
_LARGEST_BATCH = 5000
"""Duration of a batch, which cannot be interrupted."""


class SearchPace(Protocol):
    """Pace of a search: the remaining work."""

    @property
    def fraction(self) -> float:
        """Fraction of the work that is done, 0..1."""
        ...

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the work is done."""
        ...

    def done(self, proposals: int) -> None:
        """Take note of proposals, of all chains together."""
        ...


class PaceByNumber:
    """A fixed number of proposals, in reproducible batches."""

    def __init__(self, proposals: int) -> None:
        self._total = proposals
        self._left = proposals
        self._batch = min(_LARGEST_BATCH, max(1, proposals // (CHAINS * _BATCHES)))

    @property
    def fraction(self) -> float:
        """Fraction of the work that is done, 0..1."""
        return 1.0 - self._left / self._total if self._total > 0 else 1.0

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the work is done."""
        return min(self._batch, self._left // CHAINS)

    def done(self, proposals: int) -> None:
        """Take note of proposals, of all chains together."""
        self._left -= proposals


class PaceByClock:
    """Proposals until a deadline, in batches of about ``batch_s``; their number depends on the machine's speed."""

    def __init__(self, now: Callable[[], float], until: float, *, batch_s: float = 0.1) -> None:
        self._now = now
        self._until = until
        self._batch_s = batch_s
        self._begin = self._at = now()
        self._batch = 50

    @property
    def fraction(self) -> float:
        """Fraction of the time used, 0..1."""
        return min(1.0, (self._now() - self._begin) / max(self._until - self._begin, 1e-9))

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the time is over."""
        self._at = self._now()
        return self._batch if self._at < self._until else 0

    def done(self, proposals: int) -> None:
        """Record proposals, and size the next batch by the time that this one took, without earlier work."""
        now = self._now()
        wanted_s = min(self._batch_s, max(self._until - now, 1e-3))
        each_s = max(now - self._at, 1e-6) / max(proposals // CHAINS, 1)
        # The first batches may have waited for the compiler: grow step by step.
        self._batch = max(1, min(4 * self._batch, int(wanted_s / each_s)))


@dataclass(slots=True, eq=False)
class Chain:
    """One route under annealing."""

    problem: RouteProblem  # the problem
    state: RouteState  # the route
    weights: Weights  # of the energy
    hottest: float  # temperature at the beginning of a stage
    coldest: float  # at its end
    step_m: float  # widest moves
    fewest: int  # waypoints
    most: int  # waypoints
    rebuilt: float = 0.0  # fraction of the proposals that rebuild the route around a waypoint, where the order is free

    @property
    def route(self) -> Route:
        """The route as it is now."""
        return Route(annealing.snapshot(self.state))

    @property
    def observed(self) -> float:
        """Fraction of the counted ground that is observed, 0..1."""
        return float(self.state.observed[0])

    @property
    def energy(self) -> float:
        """Energy that the chain minimises."""
        route = self.route
        return (
            self.weights.path * self.problem.cost(route)
            + self.weights.waypoint * len(route)
            + annealing.energy_of_coverage(self.weights, self.observed)
        )


@dataclass(slots=True, eq=False)
class Work:
    """The work of one local search, and its observers."""

    problem: RouteProblem  # the problem
    pace: SearchPace  # how much is left
    rngs: Sequence[np.random.Generator]  # one random generator for each chain
    executor: Executor | None  # runs the chains in parallel; the result does not depend on it
    should_stop: Callable[[], bool]  # called between batches
    on_batch: Callable[[Sequence[Chain]], None]  # called after every batch, with the chains
    # the problem on the finest cells, which agrees with the evaluation grid; None without finer cells
    finest: Callable[[Route, float], RouteProblem] | None = None
    finest_time_factor: float = 1.0  # factor of the time of a proposal there; 1 if proposals are counted
    tuning: SearchTuning = TUNED  # of the search
    proposals: int = 0  # done so far, by all chains
    stopped: bool = field(default=False)  # whether ``should_stop`` ended the work
    # fraction of all the work that the last evaluation and preparation of chains took; 0 if work is counted in proposals
    correction: float = 0.0

    def run(self, chains: Sequence[Chain], *, until: float) -> bool:
        """Anneal CHAINS chains until a fraction ``until`` of all work is done, cooling throughout; False: no work is left.

        Args:
            chains: modified in place.
            until: 0..1 of all the work.
        """
        begin = self.pace.fraction
        while not self.stopped and self.pace.fraction < until:
            batch = self.pace.next_batch()
            if batch == 0:
                return False
            if self.should_stop():
                self.stopped = True
                break
            fraction = min(1.0, (self.pace.fraction - begin) / max(until - begin, 1e-12))

            def one(number: int, batch: int = batch, fraction: float = fraction) -> None:
                chain = chains[number]
                temperature = chain.hottest * (chain.coldest / chain.hottest) ** fraction
                schedule = Schedule(
                    batch, temperature, temperature, chain.step_m, chain.fewest, chain.most, self.tuning.moves,
                    chain.rebuilt, self.tuning.free_order.rebuilt_heat,
                )  # fmt: skip
                annealing.anneal(self.problem.numbers, chain.weights, schedule, chain.state, self.rngs[number])

            numbers = range(len(chains))
            list(map(one, numbers) if self.executor is None else self.executor.map(one, numbers))
            self.proposals += batch * len(chains)
            self.pace.done(batch * len(chains))
            self.on_batch(chains)
        return not self.stopped


@dataclass(frozen=True, slots=True, eq=False)
class SearchStart:
    """A feasible route to start from."""

    route: Route  # its waypoints
    observed: float  # fraction of the visible ground that it observes on the planner's cells


def promising_starts(
    problem: RouteProblem,  # the problem
    routes: Sequence[Route],  # of any coverage
    goal: float,  # fraction of the visible ground
    fraction_observed: Callable[[Route], float],  # fraction of the visible ground that a route observes
    tuned: GoalTuning = TUNED.goal,  # has the price of what is missing
) -> list[SearchStart]:
    """Routes as initial solutions for a goal, without those too expensive for :func:`best_starts`.

    Computing coverage is slow on many cells, and missing coverage only adds to the cost. So routes are evaluated from the
    cheapest on, until the next one costs more than CHAINS evaluated ones with their missing coverage.

    Returns:
        Initial solutions in the order of the routes; the best CHAINS of all are among them.
    """
    costs = [problem.cost(route) for route in routes]
    evaluated: dict[int, SearchStart] = {}
    merits: list[float] = []
    for k in sorted(range(len(routes)), key=costs.__getitem__):
        if not problem.free_order and len(merits) >= CHAINS and costs[k] > merits[CHAINS - 1]:
            break
        evaluated[k] = SearchStart(routes[k], fraction_observed(routes[k]))
        bisect.insort(merits, _merit(problem, evaluated[k], goal, 0.0, tuned)[1])
    return [evaluated[k] for k in sorted(evaluated)]


def best_starts(
    problem: RouteProblem,  # the problem
    starts: Sequence[SearchStart],  # of any coverage
    goal: float,  # fraction of the visible ground
    waypoint_m: float = 0.0,  # a price of waypoints beside that of the cost
    tuned: GoalTuning = TUNED.goal,  # has the price of what is missing
) -> list[SearchStart]:
    """The initial solutions for a goal, the best first."""
    return sorted(starts, key=lambda start: _merit(problem, start, goal, waypoint_m, tuned))


def starts_of_chains(
    problem: RouteProblem, ranked: Sequence[SearchStart], goal: float, tuned: GoalTuning = TUNED.goal
) -> list[SearchStart]:
    """The best initial solution, and for the second chain one with other lines if that is nearly as good.

    Otherwise the second chain gets the next best. Most initial solutions are the best one with a few more waypoints, and two
    chains from the same lines end with the same lines.

    Args:
        problem: the problem.
        ranked: the initial solutions, the best first.
        goal: fraction of the visible ground.
        tuned: its limit for the cost of other lines.
    """
    best, *others = ranked
    if problem.free_order or not others or goal > tuned.nearly_all:
        return list(ranked[:CHAINS])
    most = tuned.other_lines * _merit(problem, best, goal, 0.0, tuned)[1]
    near = itertools.takewhile(lambda other: _merit(problem, other, goal, 0.0, tuned)[1] <= most, others)
    different = (
        other for other in near if fraction_apart(best.route, other.route, 0.5 * problem.reach_m) > _OTHER_LINES
    )
    return [best, next(different, others[0])]


def fraction_apart(route: Route, other: Route, apart_m: float) -> float:
    """Fraction of the legs of a route without a nearby leg of the other one, 0..1; the larger one of both routes.

    Only legs in a similar direction count.

    Args:
        route: at least two waypoints, otherwise no leg is nearby.
        other: the same.
        apart_m: largest distance on the map of a nearby leg.
    """
    if min(len(route), len(other)) < 2:
        return 1.0
    both = route.waypoints_m[:, :2], other.waypoints_m[:, :2]
    return max(_fraction_without(a, b, apart_m) for a, b in (both, both[::-1]))


def _fraction_without(line_m: FloatArray, other_m: FloatArray, apart_m: float) -> float:
    legs_m = np.diff(line_m, axis=0)
    counts = np.maximum(1, np.hypot(*legs_m.T) / apart_m).astype(np.int64)
    fractions = np.concatenate([(np.arange(count) + 0.5) / count for count in counts.tolist()])
    leg = np.repeat(np.arange(len(legs_m)), counts)
    positions_m = line_m[leg] + fractions[:, None] * legs_m[leg]
    other_legs_m = np.diff(other_m, axis=0)
    from_m = positions_m[:, None] - other_m[:-1]
    along = np.clip((from_m * other_legs_m).sum(axis=2) / np.maximum((other_legs_m**2).sum(axis=1), 1e-9), 0.0, 1.0)
    off_m = np.linalg.norm(from_m - along[:, :, None] * other_legs_m, axis=2)
    turns = np.arctan2(*legs_m[leg].T)[:, None] - np.arctan2(*other_legs_m.T)
    off_m[np.abs(np.cos(turns)) < math.sqrt(0.5)] = math.inf
    return float(np.mean(off_m.min(axis=1) > apart_m))


def _merit(
    problem: RouteProblem, start: SearchStart, goal: float, waypoint_m: float, tuned: GoalTuning
) -> tuple[bool, float]:
    """Smallest for the best initial solution. With a free order, any route that reaches the goal ranks first."""
    with_waypoints = 1.0 + waypoint_m * len(start.route) / max(start.route.length_m, problem.reach_m)
    cost = problem.cost(start.route) * with_waypoints
    return problem.free_order and start.observed < goal, tuned.start_cost(cost, start.observed, goal)


MARGIN_CELLS = 0.45
"""Reduction of the planner's sensor range, in planning cells, if the evaluation grid differs."""

SCATTERED_MARGIN_CELLS = 0.1
"""The same on scattered cells. A route passes them at all distances, so that it barely profits from their centres."""

_OTHER_LINES = 0.08
"""Routes have other lines if more than this fraction of one has no nearby leg of the other. A return line is a tenth."""

_FAR_LESS = 0.04
"""A fraction of coverage: of scripts/bench/kinds.py, photos every 40 m over cliffs are counted 0.05 to 0.2 less than they are
judged, others up to 0.025."""


_LIKELY, _LIKELIER, _SURER = 0.7, (0.3, 1.0), (1.0, 1.5, 2.0, 2.5)
"""Multiples of the distance between two photos along which ground has to be in view. Of 40 routes that searches found over
canyon, terraces and city with a photo every 40 m, 0.7 is counted 0.01 less to 0.015 more than is judged, 0.5 up to 0.04 more.
On the finest cells, the one between 0.3 and 1.0 that counts as much as is judged: six terrains take 4 % less with 20 s than with
1.0 at least."""

_LARGEST_MARGIN, _HALVINGS, _AS_JUDGED, _NEARLY_AS_JUDGED = 0.5, 7, 1e-4, 2e-3
"""Largest margin on the finest cells, in cells; halvings to find one; and how far what is counted may be from what is judged, for
margins and for photos."""

_HIDDEN, _LESS_MARGIN = 0.004, (0.05, 0.025, 0.0)
"""Where the narrowed sensor loses more of the best beginning, a fraction of coverage, its lines have no room for the margin,
and a smaller one, in cells, is tried."""


def search_problem(
    coverage: CoverageMap, judging: CoverageMap, starts: Sequence[SearchStart], goal: float
) -> RouteProblem:
    """The problem of a search: on scattered cells, or on the planner's cells if the sensor observes at waypoints.

    If adjacent lines leave no room for the margin, the problem has none. Otherwise a search would see gaps between all lines of a
    route that reaches the goal.

    If the evaluation grid is finer, it covers other ground than the planner's cells. On the walls of a canyon a search counted
    98.6 % where the evaluation found 93.7 %, and correcting its goal up to 100 % had no further effect.
    """
    site = coverage.site
    if site.scenario.sensor.looks_along_path or is_judged_on_smaller_cells(site):
        scattered = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m, cut=make_scattered_cells)
        problem = scattered_problem(scattered)
        whole = [start for start in starts if start.observed >= goal]
        best = min(whole, key=lambda start: problem.cost(start.route), default=None)
        if best is None or problem.numbers.trigger_m > 0.0 or site.scenario.requirements.looks > 1:
            return problem
        return _with_room(scattered, best.route, (SCATTERED_MARGIN_CELLS, *_LESS_MARGIN), _HIDDEN)
    return _problem(site, coverage, margin_cells=0.0 if judging is coverage else MARGIN_CELLS)


def counted_as_judged(problem: RouteProblem, judging: CoverageMap, starts: Sequence[SearchStart]) -> RouteProblem:
    """The problem, with likely photos if it counts far less ground in distance-triggered photos than the evaluation."""
    if problem.numbers.trigger_m == 0.0:
        return problem
    most = max(starts, key=lambda start: start.observed).route
    if fraction_counted(problem, most) >= fraction_observed(most, judging) - _FAR_LESS:
        return problem
    return problem.with_photos_in_view(_LIKELY)


def fraction_counted(problem: RouteProblem, route: Route) -> float:
    """Fraction of the visible ground that a search counts for a route."""
    return float(state_of(problem, route, capacity=len(route)).observed[0])


def finest_problem(cells: CoverageMap, route: Route, judged: float) -> RouteProblem:
    """The problem on the finest cells that counts as much of a route as the evaluation grid.

    It is for searches for nearly all of the ground. Straight legs show more than flown corners, and distance-triggered photos
    fall anywhere. If a search counts everything as observed but the evaluation finds less, the goal has no effect. So the sensor
    is narrowed, or ground must be in view for longer, until as much is missing; or less long, where far too much is missing.
    """
    cells.expect_many_routes()
    counted_so = _problem(cells.site, cells, margin_cells=0.0)
    if counted_so.numbers.trigger_m > 0.0:
        certainly = counted_so
        if fraction_counted(certainly, route) < judged - _FAR_LESS:
            return _as_much_as(judged, certainly.with_photos_in_view, route, _LIKELIER, _NEARLY_AS_JUDGED)
        for fraction in _SURER:
            counted_so = certainly.with_photos_in_view(fraction)
            if fraction_counted(counted_so, route) <= judged + _AS_JUDGED:
                break
        return counted_so
    narrowed = partial(_narrowed_problem, cells)
    return _as_much_as(judged, narrowed, route, (0.0, _LARGEST_MARGIN), _AS_JUDGED)


def _narrowed_problem(cells: CoverageMap, margin_cells: float) -> RouteProblem:
    return _problem(cells.site, cells, margin_cells=margin_cells)


def _as_much_as(
    judged: float, problem_of: Callable[[float], RouteProblem], route: Route, between: tuple[float, float], near: float
) -> RouteProblem:
    """The problem that counts as much of a route as is judged, by halving the interval of a number.

    Args:
        judged: fraction of the visible ground.
        problem_of: makes the problem; it counts less, the larger the number is.
        route: the waypoints.
        between: the interval.
        near: sufficient difference from ``judged``.
    """
    low, high = between
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        problem = problem_of(middle)
        difference = fraction_counted(problem, route) - judged
        if abs(difference) <= near:
            break
        low, high = (middle, high) if difference > 0.0 else (low, middle)
    return problem


def _with_room(cells: CoverageMap, route: Route, margins: Sequence[float], hidden: float) -> RouteProblem:
    """The problem with the first margin, in cells, that hides at most a fraction of the observed ground.

    Without one, the problem with the last margin.
    """
    observed = fraction_observed(route, cells)
    for margin_cells in margins[:-1]:
        problem = _problem(cells.site, cells, margin_cells=margin_cells)
        if fraction_counted(problem, route) >= observed - hidden:
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
