"""The local search: its starts, the cells it counts coverage on, and annealing chains side by side.

Chains run in batches, until the evaluations or the time are used up. The cells are other ones than routes are judged on, with a
margin by which the sensor is narrowed there, so that a route is not laid out for the places of single centres.
"""

import bisect
import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from uavcover.kernels import annealing
from uavcover.kernels.annealing import Prices, Schedule
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.route_state import RouteState
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.search.route_problem import RouteProblem, route_problem, share_seen, state_of
from uavcover.planner.search.tuning import TUNED, GoalTuning, SearchTuning
from uavcover.scenario.site import Site
from uavcover.sensing.cells import is_judged_on_smaller_cells, make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap

CHAINS = 2
"""Chains that run side by side, for any number of threads: the result must not depend on it."""

PROPOSALS_PER_EVALUATION = 50
"""This number of proposals counts as one evaluation: about what they cost in time (docs/results/coverage.md)."""

_BATCHES = 400
_LARGEST_BATCH = 5000
"""A batch is not interrupted: it must be over in a moment."""


class SearchPace(Protocol):
    """Pace of a search: how much of the work remains."""

    @property
    def fraction(self) -> float:
        """Share of the work that is done, 0..1."""
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
        """Share of the work that is done, 0..1."""
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
        """Share of the time used, 0..1."""
        return min(1.0, (self._now() - self._begin) / max(self._until - self._begin, 1e-9))

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the time is over."""
        self._at = self._now()
        return self._batch if self._at < self._until else 0

    def done(self, proposals: int) -> None:
        """Record proposals, and size the next batch by the time that this one took, without what was done before it."""
        now = self._now()
        wanted_s = min(self._batch_s, max(self._until - now, 1e-3))
        each_s = max(now - self._at, 1e-6) / max(proposals // CHAINS, 1)
        # The first batches may have waited for the compiler: grow step by step.
        self._batch = max(1, min(4 * self._batch, int(wanted_s / each_s)))


@dataclass(slots=True, eq=False)
class Chain:
    """One route under annealing."""

    problem: RouteProblem  # what is looked at
    state: RouteState  # the route
    prices: Prices  # of the energy
    hottest: float  # temperature at the beginning of a stage
    coldest: float  # at its end
    step_m: float  # widest moves
    fewest: int  # waypoints
    most: int  # waypoints
    rebuilt: float = 0.0  # share of the proposals that rebuild the route around a waypoint, where the order is free

    @property
    def route(self) -> Route:
        """The route as it is now."""
        return Route(annealing.snapshot(self.state))

    @property
    def seen(self) -> float:
        """Share of what counts that is seen, 0..1."""
        return float(self.state.seen[0])

    @property
    def energy(self) -> float:
        """Energy that the chain minimises."""
        route = self.route
        return (
            self.prices.way * self.problem.cost(route)
            + self.prices.waypoint * len(route)
            + annealing.energy_of_share(self.prices, self.seen)
        )


@dataclass(slots=True, eq=False)
class Work:
    """The work of one local search, and its observers."""

    problem: RouteProblem  # what is looked at
    pace: SearchPace  # how much is left
    rngs: Sequence[np.random.Generator]  # one random generator for each chain
    executor: Executor | None  # runs the chains side by side; the result does not depend on it
    should_stop: Callable[[], bool]  # asked between batches
    on_batch: Callable[[Sequence[Chain]], None]  # called after every batch, with the chains
    # the problem on the finest cells that counts of a route what is judged of it; none where there are none
    finest: Callable[[Route, float], RouteProblem] | None = None
    tuning: SearchTuning = TUNED  # of the search
    proposals: int = 0  # done so far, by all chains
    stopped: bool = field(default=False)  # whether ``should_stop`` ended the work
    # share of all the work that judging routes and preparing chains took the last time; 0 where work is counted by
    # proposals
    correction: float = 0.0

    def run(self, chains: Sequence[Chain], *, until: float) -> bool:
        """Anneal CHAINS chains until a share ``until`` of all work is done, cooling throughout; False: no work is left.

        Args:
            chains: are changed.
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
            share = min(1.0, (self.pace.fraction - begin) / max(until - begin, 1e-12))

            def one(number: int, batch: int = batch, share: float = share) -> None:
                chain = chains[number]
                temperature = chain.hottest * (chain.coldest / chain.hottest) ** share
                schedule = Schedule(
                    batch, temperature, temperature, chain.step_m, chain.fewest, chain.most, self.tuning.moves,
                    chain.rebuilt, self.tuning.free_order.rebuilt_heat,
                )  # fmt: skip
                annealing.anneal(self.problem.numbers, chain.prices, schedule, chain.state, self.rngs[number])

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
    seen: float  # share of what can be covered that it sees on the planner's cells


def starts_worth_looking_at(
    problem: RouteProblem,  # what is looked at
    routes: Sequence[Route],  # of any coverage
    goal: float,  # share of what can be covered
    share_seen: Callable[[Route], float],  # share of what can be covered that a route sees
    tuned: GoalTuning = TUNED.goal,  # has the price of what is missing
) -> list[SearchStart]:
    """Routes as initial solutions for a goal, without those too expensive for :func:`best_starts`.

    Finding out what a route sees takes long on many cells. Missing coverage only adds to its cost: routes are looked at from the
    cheapest on, until the next one costs more than the best come to, as many as there are chains.

    Returns:
        Beginnings in the order of the routes; the best CHAINS of all are among them.
    """
    costs = [problem.cost(route) for route in routes]
    looked: dict[int, SearchStart] = {}
    merits: list[float] = []
    for k in sorted(range(len(routes)), key=costs.__getitem__):
        if not problem.free_order and len(merits) >= CHAINS and costs[k] > merits[CHAINS - 1]:
            break
        looked[k] = SearchStart(routes[k], share_seen(routes[k]))
        bisect.insort(merits, _merit(problem, looked[k], goal, 0.0, tuned)[1])
    return [looked[k] for k in sorted(looked)]


def best_starts(
    problem: RouteProblem,  # what is looked at
    starts: Sequence[SearchStart],  # of any coverage
    goal: float,  # share of what can be covered
    waypoint_m: float = 0.0,  # a price of waypoints beside that of the cost
    tuned: GoalTuning = TUNED.goal,  # has the price of what is missing
) -> list[SearchStart]:
    """The beginnings for a goal, the best first."""
    return sorted(starts, key=lambda start: _merit(problem, start, goal, waypoint_m, tuned))


def starts_of_chains(
    problem: RouteProblem, ranked: Sequence[SearchStart], goal: float, tuned: GoalTuning = TUNED.goal
) -> list[SearchStart]:
    """The best beginning, and for the second chain one of other lines if that is nearly as good.

    Otherwise it is the next best. Most beginnings are the best one with a few waypoints more, and two chains from the same lines
    end with the same lines.

    Args:
        problem: what is looked at.
        ranked: the beginnings, the best first.
        goal: share of what can be covered.
        tuned: has how much worse other lines may be.
    """
    best, *others = ranked
    if problem.free_order or not others or goal > tuned.nearly_all:
        return list(ranked[:CHAINS])
    most = tuned.other_lines * _merit(problem, best, goal, 0.0, tuned)[1]
    near = itertools.takewhile(lambda other: _merit(problem, other, goal, 0.0, tuned)[1] <= most, others)
    different = (other for other in near if share_apart(best.route, other.route, 0.5 * problem.reach_m) > _OTHER_LINES)
    return [best, next(different, others[0])]


def share_apart(route: Route, other: Route, apart_m: float) -> float:
    """Share of the legs of a route with no leg of the other nearby, 0..1; of both the larger one.

    Only legs that run about as they do count.

    Args:
        route: of two waypoints at least, otherwise nothing is nearby.
        other: the same.
        apart_m: how far away on the map is nearby.
    """
    if min(len(route), len(other)) < 2:
        return 1.0
    both = route.waypoints_m[:, :2], other.waypoints_m[:, :2]
    return max(_share_without(a, b, apart_m) for a, b in (both, both[::-1]))


def _share_without(line_m: FloatArray, other_m: FloatArray, apart_m: float) -> float:
    legs_m = np.diff(line_m, axis=0)
    counts = np.maximum(1, np.hypot(*legs_m.T) / apart_m).astype(np.int64)
    shares = np.concatenate([(np.arange(count) + 0.5) / count for count in counts.tolist()])
    leg = np.repeat(np.arange(len(legs_m)), counts)
    places_m = line_m[leg] + shares[:, None] * legs_m[leg]
    other_legs_m = np.diff(other_m, axis=0)
    from_m = places_m[:, None] - other_m[:-1]
    along = np.clip((from_m * other_legs_m).sum(axis=2) / np.maximum((other_legs_m**2).sum(axis=1), 1e-9), 0.0, 1.0)
    off_m = np.linalg.norm(from_m - along[:, :, None] * other_legs_m, axis=2)
    turns = np.arctan2(*legs_m[leg].T)[:, None] - np.arctan2(*other_legs_m.T)
    off_m[np.abs(np.cos(turns)) < math.sqrt(0.5)] = math.inf
    return float(np.mean(off_m.min(axis=1) > apart_m))


def _merit(
    problem: RouteProblem, start: SearchStart, goal: float, waypoint_m: float, tuned: GoalTuning
) -> tuple[bool, float]:
    """Smallest for the best initial solution. Where the order is free, any route that reaches the goal ranks first."""
    with_waypoints = 1.0 + waypoint_m * len(start.route) / max(start.route.length_m, problem.reach_m)
    cost = problem.cost(start.route) * with_waypoints
    return problem.free_order and start.seen < goal, tuned.start_cost(cost, start.seen, goal)


MARGIN_CELLS = 0.45
"""Reduction of the planner's sensor range, in planning cells, where other cells judge."""

SCATTERED_MARGIN_CELLS = 0.1
"""The same on scattered cells. A route passes them at all distances, so that it barely profits from their centres."""

_OTHER_LINES = 0.08
"""Routes have other lines where more of one than this share has no leg of the other nearby: a line that returns is a tenth."""

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
