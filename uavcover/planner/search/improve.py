"""The local search of the memetic planner: improves the routes of the optimizer and the baselines move by move."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.tours import short_tour
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.model.scenario import PlannerSettings
from uavcover.planner.budget import FRACTIONS
from uavcover.planner.final_changes import certainly, with_sound_corners
from uavcover.planner.front import Candidate
from uavcover.planner.search.goal_search import search_goals, search_waypoints
from uavcover.planner.search.local_search import (
    CHAINS,
    PROPOSALS_PER_EVALUATION,
    Chain,
    PaceByClock,
    PaceByNumber,
    SearchPace,
    SearchStart,
    Work,
    counted_as_judged,
    finest_problem,
    search_problem,
)
from uavcover.planner.search.optimizer_search import Effort, SearchProgress, SearchRun
from uavcover.planner.search.repair import with_gaps_closed
from uavcover.planner.search.route_problem import (
    MOST_WAYPOINTS,
    OneAfterTheOther,
    RouteJudge,
    RouteProblem,
    fraction_observed,
    route_problem,
    with_safety,
)
from uavcover.planner.search.tour_with_neighbourhoods import search_free_order
from uavcover.planner.search.tuning import TUNED, GoalTuning, SearchTuning
from uavcover.planner.selection_rule import Rule
from uavcover.planner.terrain_following import repaired_routes
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.flown_line import line_flown, photos_on, positions_passed_m
from uavcover.sensing.sensors import trigger_distance_m
from uavcover.sensing.site_maps import finer_map, judging_maps

_FLOWN = 0.98
"""The goal if the rule requires no coverage."""

_LOCAL_SEARCH_STREAM = 1


@dataclass(frozen=True, slots=True, eq=False)
class Improved:
    """Result of a local search."""

    routes: tuple[Route, ...]  # worth judging
    evaluations: int  # its work, PROPOSALS_PER_EVALUATION proposals each
    interrupted: bool  # whether the user ended it


def improve(
    coverage: CoverageMap,  # on the planner's cells
    judging: CoverageMap,  # on the evaluation grid
    candidates: Sequence[Candidate],  # found so far; infeasible ones are no initial solutions
    # its effort and clock, the executor of its chains, and who follows it; evaluations that are done already count
    run: SearchRun,
    *,
    settings: PlannerSettings,  # encoding, capacity and seed
    rule: Rule,  # selects one route; most of the work goes to its coverage
    evaluations_done: int,  # by the optimizer
    # may inspect the routes found, between batches
    look: Callable[[Callable[[], Sequence[Route]]], None] = lambda _: None,
    tuning: SearchTuning = TUNED,  # of the search
) -> Improved:
    """Improve routes by local search."""
    site, effort = coverage.site, run.effort
    left = max(0, effort.evaluations - evaluations_done) if effort.budget_s is None else 1
    required, tuned = rule.required_coverage, tuning.goal
    goal = _FLOWN if required is None else required
    starts = _starts(coverage, candidates, settings)
    repaired: list[SearchStart] = []
    if all(start.observed < goal for start in starts):
        repaired = _repaired_starts(
            coverage, candidates, lambda: effort.is_over(run.started, fraction=FRACTIONS.repaired)
        )
        starts += repaired
    if repaired:
        best = max(repaired, key=lambda start: start.observed)
        observed = best.observed * coverage.fraction(coverage.coverable)
        run.on_progress(SearchProgress(evaluations_done, effort.evaluations, observed, None, best.route))
    kept = run.found
    kept += [start.route for start in repaired]
    if not starts or left == 0 or effort.is_over(run.started):
        return Improved(tuple(kept), 0, interrupted=False)
    counted_certainly = search_problem(coverage, judging, starts, goal)
    problem = counted_as_judged(counted_certainly, judging, starts)
    nearly = tuned.nearly_all_on_finest
    prepared = 0.0 if effort.budget_s is None else (effort.now() - run.started) / effort.budget_s
    if problem is not counted_certainly and prepared <= tuned.most_prepared:
        nearly = tuned.likely_on_finest
    finer = finer_map(site) if required is not None and required > nearly else None
    if finer is not None:
        tuned = replace(tuned, nearly_all=nearly)
        tuning = replace(tuning, goal=tuned)
    judges = judging_maps(site) if site.scenario.sensor.looks_along_path else [judging]
    pace: SearchPace
    if effort.budget_s is None:
        pace = PaceByNumber(left * PROPOSALS_PER_EVALUATION)
    else:
        pace = PaceByClock(effort.now, run.started + effort.budget_s)
    judging_of = _Judging(site, judging, judges, problem, tuned, run.executor, kept)
    progress = _Progress(coverage, problem, starts, pace, effort, evaluations_done, required, run.on_progress)
    seeds = np.random.SeedSequence([settings.seed, _LOCAL_SEARCH_STREAM]).spawn(CHAINS)
    generators = [np.random.default_rng(seed) for seed in seeds]

    def between(chains: Sequence[Chain]) -> None:
        progress.report(work.proposals, chains)
        look(lambda: [*judging_of.kept, *(_shortened(problem, chain.route) for chain in chains)])

    time_factor = 1.0 if finer is None or effort.budget_s is None else finer.grid.count / len(problem.numbers.square)
    work = Work(
        problem, pace, generators, run.executor, run.should_stop, between,
        None if finer is None else partial(finest_problem, finer), time_factor, tuning,
    )  # fmt: skip
    capacity = _capacity(problem, settings, starts, tuned)
    # If time costs, finer cells are evaluated only after the search's own cells confirm the route.
    exactly = judging_of.on_each if effort.budget_s is None else OneAfterTheOther(judges)
    judge = RouteJudge(
        lambda route, goal: exactly(judging_of.as_chosen(route), goal), judging_of.keep, judging_of.closed
    )
    if problem.free_order:
        search_free_order(work, starts, required=required, capacity=capacity, judge=judge)
    else:
        known = search_goals(
            work, starts, required=required, capacity=capacity, until=1.0 - tuned.waypoint_fraction, judge=judge
        )
        finer = finer_map(site)
        if finer is not None:
            # The final choice needs these cells, so prepare them while there is time.
            _ = finer.knows_coverable(lambda: effort.is_over(run.started))
        on_these_cells = RouteJudge(
            lambda route, _: fraction_observed(judging_of.as_chosen(route), judging), judging_of.keep
        )
        search_waypoints(work, known, goal=goal, capacity=capacity, until=1.0, judge=on_these_cells)
    return Improved(tuple(judging_of.kept), work.proposals // PROPOSALS_PER_EVALUATION, work.stopped)


@dataclass(frozen=True, slots=True, eq=False)
class _Judging:
    """Evaluate the routes of a search as final routes, and store its results."""

    site: Site  # the scenario on its ground
    judging: CoverageMap  # the evaluation grid
    judges: Sequence[CoverageMap]  # these, and finer ones
    problem: RouteProblem  # the search's
    tuned: GoalTuning  # how gaps are closed
    executor: Executor | None  # judges on several maps at once; None: one after the other
    kept: list[Route]  # the routes that were found

    def as_chosen(self, route: Route) -> Route:
        """The route with sure photos and sound corners, as a final choice requires. Long routes lose some coverage."""
        return with_sound_corners(self.site, certainly(self.site, route))

    def keep(self, route: Route) -> None:
        """Store a route in the form of a final choice."""
        self.kept.append(self.as_chosen(_shortened(self.problem, route)))

    def on_each(self, route: Route, _goal: float) -> float:
        """The least coverage of a route on any map."""
        observed = map if self.executor is None else self.executor.map
        return min(observed(partial(fraction_observed, route), self.judges))

    def closed(self, route: Route, goal: float, is_over: Callable[[], bool]) -> Route | None:
        """The route with its gaps closed; None if it reaches the goal, or has too many gaps."""
        begun, nearly, aim = self.as_chosen(route), goal > self.tuned.nearly_all, with_safety(goal)
        judges = self.judges if nearly else [self.judging]
        reaches = None
        # Far from the goal, closing gaps is not worth the time.
        if aim - _least_coverage(begun, judges) <= self.tuned.most_short:
            penalty = (
                self.tuned.nearly_all_penalty * self.tuned.closed_costlier if nearly else self.tuned.waiting_penalty
            )
            begun = with_turns_further_out(
                judges, begun, aim, cost=self.problem.cost, penalty=penalty, reach_m=_REACHES * self.problem.reach_m,
                is_over=is_over,
            )  # fmt: skip
            if _least_coverage(begun, judges) >= 0.5 * (goal + aim):
                return begun
            reaches = begun if _least_coverage(begun, judges) >= goal else None
        least = min(judges, key=lambda judging: fraction_observed(begun, judging))
        whole = with_gaps_closed(least, begun, aim, self.tuned.closed, is_over, most_trials=self.tuned.most_trials)
        return min((each for each in (whole, reaches) if each is not None), key=self.problem.cost, default=None)


def _starts(coverage: CoverageMap, known: Sequence[Candidate], settings: PlannerSettings) -> list[SearchStart]:
    """The feasible routes, with their fraction of the visible ground."""
    legs = coverage.site.scenario.limits.applies_to == "legs"
    # Over terrain there are waypoints between the nodes of the encoding, which its capacity does not count.
    longest = settings.capacity if settings.encoding == "waypoints" and not legs else MOST_WAYPOINTS
    fewest = 2 if legs else 1
    coverable = max(coverage.fraction(coverage.coverable), 1e-12)
    return [
        SearchStart(each.route[0], min(1.0, -float(each.objectives[0]) / coverable))
        for each in known
        if each.violation <= 0.0 and fewest <= len(each.route[0]) <= longest
    ]


_MOST_REPAIRED = 6
_OBSERVES_MOST = 0.5
"""Routes that observe at least this fraction of the most are repaired, those that break the limits by the least first."""


def _repaired_starts(
    coverage: CoverageMap, known: Sequence[Candidate], is_over: Callable[[], bool]
) -> list[SearchStart]:
    """Routes made of stretches that keep the limits, of known ones that break them and observe more than all others."""
    site = coverage.site
    feasible = [float(each.objectives[0]) for each in known if each.violation <= 0.0]
    more = [each for each in known if each.violation > 0.0 and each.objectives[0] < min(feasible, default=0.0)]
    if site.scenario.limits.applies_to != "legs" or not more:
        return []
    most = min(float(each.objectives[0]) for each in more)
    seeing = [each for each in more if each.objectives[0] <= _OBSERVES_MOST * most]
    routes = [each.route[0] for each in sorted(seeing, key=lambda each: each.violation)[:_MOST_REPAIRED]]
    problem = route_problem(coverage, margin_m=0.0, reach_m=0.0).numbers
    repaired = repaired_routes(site, problem, routes, is_over)
    return [
        SearchStart(route, fraction_observed(route, coverage)) for route in repaired if len(route) <= MOST_WAYPOINTS
    ]


def _capacity(
    problem: RouteProblem, settings: PlannerSettings, starts: Sequence[SearchStart], tuned: GoalTuning
) -> int:
    if settings.encoding == "waypoints" and problem.free_order:
        return settings.capacity
    if settings.most_waypoints is not None:
        return settings.most_waypoints
    return tuned.path_capacity * max(len(start.route) for start in starts) + tuned.spare_waypoints


def _shortened(problem: RouteProblem, route: Route) -> Route:
    """With a free order: a shorter tour if it costs less, begun at the end that is nearer to the origin."""
    if not problem.free_order or len(route) < 2:
        return route
    points = route.waypoints_m
    order = short_tour(points)
    if np.linalg.norm(points[order[-1]]) < np.linalg.norm(points[order[0]]):
        order = order[::-1]
    return min((Route(points[order]), route), key=problem.cost)


class _Progress:
    """Reports the incumbent of a search after each batch."""

    def __init__(
        self, coverage: CoverageMap, problem: RouteProblem, starts: Sequence[SearchStart], pace: SearchPace, effort: Effort,
        evaluations_done: int, required: float | None, on_progress: Callable[[SearchProgress], None],
    ) -> None:  # fmt: skip
        self._coverable = coverage.fraction(coverage.coverable)
        self._pace, self._effort, self._done = pace, effort, evaluations_done
        self._required, self._on_progress = required, on_progress
        self._best = max(start.observed for start in starts) * self._coverable
        self._incumbent: tuple[bool, float, Route] | None = None
        enough = (
            []
            if required is None
            else [problem.cost_of_path(start.route) for start in starts if start.observed >= required]
        )
        self._shortest = min(enough, default=None)

    def report(self, proposals: int, chains: Sequence[Chain]) -> None:
        """Report the results of the chains after this number of proposals."""
        evaluations = self._done + proposals // PROPOSALS_PER_EVALUATION
        self._best = max(self._best, *(chain.observed * self._coverable for chain in chains))
        if self._required is not None:
            costs = [chain.problem.cost_of_path(chain.route) for chain in chains if chain.observed >= self._required]
            known = [] if self._shortest is None else [self._shortest]
            self._shortest = min([*known, *costs], default=None)
        total = self._effort.evaluations
        if self._effort.budget_s is not None:
            total = max(evaluations, round(evaluations / max(self._pace.fraction, 1e-3)))
        for chain in chains:
            enough = self._required is not None and chain.observed >= self._required
            merit = enough, -chain.problem.cost_of_path(chain.route) if enough else chain.observed
            if self._incumbent is None or merit > self._incumbent[:2]:
                self._incumbent = *merit, chain.route
        incumbent = None if self._incumbent is None else self._incumbent[2]
        self._on_progress(SearchProgress(evaluations, total, self._best, self._shortest, incumbent))


# Turns further out, where that shows enough for its way.
#
# The local search counts what is observed from straight legs, and half of a photo's distance beyond the end of each leg. A
# search makes its lines as short as that allows: a corner is passed on the inside, and where a line turns back the last photo
# is missing more often than not.

_TURNS_RAD = math.radians(50.0)
"""Below this turn, the line and its photos continue."""

_MOST_WAIT = 0.75
"""Fraction of the trigger distance that a turn waits at most."""

_MORE_M = (1.5, 6.0)
"""Extra distance of a turn, because the vehicle cuts the corner."""

_SWEEPS = 3
_REACHES = 2.0
"""Of the sensor: a waypoint farther from all missing ground stays."""

_PASSED_M, _OUTWARD = 1.0, (1.0, 1.8)
"""A waypoint passed at this distance moves outward by these multiples of it: the corner moves with it in part."""


def with_turns_further_out(
    judges: Sequence[CoverageMap],  # the evaluation grid
    route: Route,  # keeps the limits
    goal: float,  # fraction of the visible ground, on each of them
    *,
    cost: Callable[[Route], float],  # of a route
    # of all coverage, in costs of the route: penalty for missing coverage, compared with the extra distance
    penalty: float,
    reach_m: float,  # farther from all missing ground, a waypoint stays
    is_over: Callable[[], bool],  # whether the time is over
) -> Route:
    """The route with turns that wait for their next photo or are further out, one by one until the goal is reached.

    Returns:
        The route itself if no turn needs to move.
    """
    site = judges[0].site
    best, observed, spent = route, _least_coverage(route, judges), cost(route)
    violations = _violations(site, route)
    for _ in range(_SWEEPS):
        before = best
        missing_m = np.vstack([
            each.grid.cells.centre_m[each.coverable & ~each.observed(best.waypoints_m), :2] for each in judges
        ])  # fmt: skip
        for number, position_m in enumerate(before.waypoints_m):
            if not len(missing_m) or np.hypot(*(missing_m - position_m[:2]).T).min() > reach_m:
                continue
            worth = 0.0
            for other in itertools.chain(_waiting_at(site, best, number), _outward_at(site, best, number)):
                if observed >= goal or is_over():
                    return best
                if _violations(site, other) > violations:
                    continue
                # Each map can only lower the value of a change, so the large maps evaluate few.
                observes, extra = goal, cost(other) - spent
                for judging in judges:
                    if (observes - observed) * penalty * spent - extra > worth:
                        observes = min(observes, fraction_observed(other, judging))
                more = (observes - observed) * penalty * spent - extra
                if more > worth:
                    worth, found = more, other
            if worth > 0.0:
                best, observed, spent = found, _least_coverage(found, judges), cost(found)
        if best is before:
            break
    return best


def _least_coverage(route: Route, judges: Sequence[CoverageMap]) -> float:
    return min(fraction_observed(route, each) for each in judges)


def _waiting_at(site: Site, route: Route, number: int) -> Iterator[Route]:
    """The route with a waypoint moved forward to the next photo; nothing if that is not needed."""
    points, trigger_m = route.waypoints_m, trigger_distance_m(site.scenario)
    if number == 0 or trigger_m is None:
        return
    onward = points[number, :2] - points[number - 1, :2]
    if number + 1 < len(points) and _turn_rad(onward, points[number + 1, :2] - points[number, :2]) < _TURNS_RAD:
        return
    line_m = line_flown(site, points).positions_m
    pieces, photos_m = photos_on(line_m, trigger_m)
    nearest = int(np.argmin(np.linalg.norm(line_m - points[number], axis=1)))
    before, length_m = photos_m[pieces < nearest], float(np.hypot(*onward))
    if len(before) == 0 or length_m == 0.0:
        return
    short_m = trigger_m - float(np.hypot(*(points[number] - before[-1])[:2]))
    if not 0.0 < short_m <= _MOST_WAIT * trigger_m:
        return
    for more_m in _MORE_M:
        yield from _moved(site, route, number, (short_m + more_m) / length_m * onward)


def _outward_at(site: Site, route: Route, number: int) -> Iterator[Route]:
    """Routes with a waypoint moved outwards, or with one of its legs longer, if the vehicle cuts the corner."""
    points = route.waypoints_m
    out_m = (points[number] - positions_passed_m(site, points)[number])[:2]
    passed_m = float(np.hypot(*out_m))
    if passed_m < _PASSED_M:
        return
    moves_m = [out_m]
    for beside in (number - 1, number + 1):
        if 0 <= beside < len(points):
            leg_m = (points[number] - points[beside])[:2]
            moves_m.append(passed_m / max(float(np.hypot(*leg_m)), _PASSED_M) * leg_m)
    for move_m, fraction in itertools.product(moves_m, _OUTWARD):
        yield from _moved(site, route, number, fraction * move_m)


def _moved(site: Site, route: Route, number: int, move_m: FloatArray) -> Iterator[Route]:
    """The route with a waypoint moved (2,) metres on the map at its height above ground; nothing outside the elevation data."""
    moved = np.array(route.waypoints_m)
    height_agl_m = site.ground.heights_agl_m(moved[number])
    moved[number, :2] += move_m
    moved[number, 2] = site.ground.ups_m(moved[number, :2], height_agl_m)[0]
    if np.isfinite(moved).all():
        yield certainly(site, Route(moved, route.begins))


def _turn_rad(before: FloatArray, behind: FloatArray) -> float:
    """Angle between two directions on the map, 0 for straight on."""
    return abs(math.remainder(math.atan2(*before[::-1]) - math.atan2(*behind[::-1]), 2.0 * math.pi))


def _violations(site: Site, route: Route) -> float:
    return measure_violations(site, route.waypoints_m, margin_m=site.scenario.limits.height_margin_m).total
