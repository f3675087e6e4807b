"""Local search where waypoints may be visited in any order: a tour with neighbourhoods.

It finds the shortest tours with enough coverage, and the best coverage for every number of waypoints.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.annealing import Weights
from uavcover.kernels.route_state import observed_alone, recount
from uavcover.kernels.sight import DISC
from uavcover.model.route import Route
from uavcover.planner.search.goal_search import search_goals
from uavcover.planner.search.local_search import CHAINS, Chain, SearchStart, Work, best_starts
from uavcover.planner.search.route_problem import RouteJudge, state_of
from uavcover.planner.search.tuning import FreeOrderTuning

FULL = 1.0 - 1e-9
"""Fraction of the visible ground that counts as all of it."""

_MOST_THINNED = 100
"""Largest number of routes kept while one is thinned, because each becomes a short tour."""


_THINNING = 0.05
"""Largest fraction of all the work for the first thinning."""


@dataclass(frozen=True, slots=True)
class _Stage:
    """Annealing stage of chains: heats of the chains, prices of a waypoint and of a radius of path in cells."""

    heats: tuple[float, float]
    waypoint: float
    path_weights: tuple[float, float]


def _squeeze(tuned: FreeOrderTuning) -> _Stage:
    return _Stage(tuned.squeeze_heats, 0.0, (tuned.path_cost_cells, tuned.path_cost_cells))


def _sweep(tuned: FreeOrderTuning) -> _Stage:
    return _Stage(tuned.sweep_heats, 0.0, (tuned.path_cost_cells, tuned.sweep_path_cost_cells))


@dataclass(frozen=True, slots=True, eq=False)
class Fewest:
    """State of the search for few waypoints."""

    best: Chain  # the chain that continues
    whole: SearchStart  # full coverage with the fewest waypoints; without one, the most coverage at the beginning
    full: bool  # whether all has been observed by as few as in ``best``, or by one more: no more come in then


def spread(
    work: Work, starts: Sequence[SearchStart], *, capacity: int, until: float, found: Callable[[Route], None]
) -> Fewest:
    """Add waypoints while they are worth their penalty.

    Args:
        work: the problem and the remaining budget; ``work.problem.free_order`` holds.
        starts: at least one.
        capacity: largest number of waypoints.
        until: fraction of all the work, 0..1, at which this ends.
        found: called with every route worth evaluating.
    """
    tuned = work.tuning.free_order
    stage = _Stage(tuned.spread_heats, tuned.waypoint_cost_cells, (tuned.path_cost_cells, tuned.path_cost_cells))
    ranked = sorted(starts, key=_fewest_that_see_most)
    chains = _chains(work, [ranked[k % len(ranked)].route for k in range(CHAINS)], stage, capacity=capacity)
    work.run(chains, until=until)
    best = _better(chains, found)
    whole = ranked[0] if ranked[0].observed >= FULL else SearchStart(best.route, best.observed)
    return Fewest(best, whole, full=False)


def squeeze(work: Work, fewest: Fewest, *, capacity: int, until: float, found: Callable[[Route], None]) -> Fewest:
    """Add waypoints until everything is observed, then remove them one by one; try each number again.

    Args:
        work: as of :func:`spread`.
        fewest: the progress so far.
        capacity: largest number of waypoints.
        until: fraction of all the work, 0..1, at which this ends.
        found: called with every route worth evaluating.
    """
    best, whole, full = fewest.best, fewest.whole, fewest.full
    tuned = work.tuning.free_order
    attempt = tuned.attempt * (until - work.pace.fraction)
    more = True
    while more and work.pace.fraction < until:
        fewer = best.observed >= FULL and len(best.route) > 1
        full = full or fewer
        route = _without_least(work, best) if fewer else best.route
        more_room = None if full else min(len(route) + 1, capacity)
        chains = _chains(work, [route] * CHAINS, _squeeze(tuned), capacity=more_room)
        more = work.run(chains, until=min(work.pace.fraction + attempt, until))
        tried = _better(chains, found)
        if tried.observed >= FULL and (whole.observed < FULL or len(tried.route) <= len(whole.route)):
            whole = SearchStart(tried.route, tried.observed)
        # Do not return to more waypoints: routes with full coverage are already known.
        if fewer or tried.energy <= best.energy:
            best = tried
    return Fewest(best, whole, full)


def sweep(work: Work, fewest: Fewest, *, until: float, found: Callable[[Route], None]) -> None:
    """Thin to one waypoint: without annealing from full coverage, then annealed, for coverage alone and with path length.

    Args:
        work: as of :func:`spread`.
        fewest: the result of the search for few waypoints.
        until: fraction of all the work, 0..1, at which this ends.
        found: called with every route worth evaluating.
    """
    thin(work, fewest.whole.route, found, until=until)
    chains = [fewest.best] * CHAINS
    more = not work.stopped and work.pace.fraction < until
    while more and max(len(chain.route) for chain in chains) > 1:
        routes = [_without_least(work, chain) if len(chain.route) > 1 else chain.route for chain in chains]
        chains = _chains(work, routes, _sweep(work.tuning.free_order))
        now = work.pace.fraction
        more = work.run(chains, until=now + (until - now) / max(map(len, routes)))
        _better(chains, found)


def thin(work: Work, route: Route, found: Callable[[Route], None], *, until: float) -> None:
    """Thin to one waypoint without annealing, for the most coverage before the sweep.

    Ends early after a fraction of all the work.
    """
    apart = math.ceil(len(route) / _MOST_THINNED)
    while len(route) > 1 and work.pace.fraction < until:
        chain, _ = _chains(work, [route] * CHAINS, _sweep(work.tuning.free_order))
        route = _without_least(work, chain)
        if len(route) % apart == 0:
            found(route)


def rebuild_tours(
    work: Work, starts: Sequence[SearchStart], *, capacity: int, until: float, found: Callable[[Route], None]
) -> list[SearchStart]:
    """Find the shortest tour with full coverage. Both chains rebuild it and continue from the better one of each stage.

    Args:
        work: as of :func:`spread`.
        starts: at least one.
        capacity: largest number of waypoints.
        until: fraction of all the work, 0..1, at which this ends.
        found: called with every route worth evaluating.

    Returns:
        The starts, and the better tour of each stage.
    """
    tuned, reach_m, begin = work.tuning.free_order, work.problem.reach_m, work.pace.fraction
    hottest, coldest = (heat * reach_m for heat in tuned.discs_heats)
    known = list(starts)
    best, done = best_starts(work.problem, starts, FULL)[0].route, 0.0
    for stage in tuned.rebuilt_stages:
        chains = _chains(work, [best] * CHAINS, _squeeze(tuned), capacity=capacity)
        metres = work.problem.metres_per_cost(best)
        # Every cell is worth the whole tour, because single targets are many radii apart.
        cell_m = max(metres * work.problem.cost(best), reach_m)
        waypoint_m = work.tuning.goal.waypoint_price * reach_m
        for chain in chains:
            chain.weights = Weights(metres, waypoint_m, cell_m * chain.weights.coverage, 1.0)
            chain.hottest, chain.coldest = (hottest * (coldest / hottest) ** fraction for fraction in (done, stage))
            chain.step_m, chain.rebuilt = work.tuning.goal.largest_step * reach_m, tuned.rebuilt
        more = work.run(chains, until=begin + stage * (until - begin))
        better = _better(chains, found)
        known.append(SearchStart(better.route, better.observed))
        best, done = better.route, stage
        if not more:
            break
    return known


def _fewest_that_see_most(start: SearchStart) -> tuple[float, int]:
    """Sort key: the most coverage first, and among routes with full coverage the fewest waypoints."""
    return -min(start.observed, FULL), len(start.route)


def _better(chains: Sequence[Chain], found: Callable[[Route], None]) -> Chain:
    for chain in chains:
        found(chain.route)
    return min(chains, key=lambda chain: chain.energy)


def _chains(work: Work, routes: Sequence[Route], stage: _Stage, *, capacity: int | None = None) -> list[Chain]:
    """A chain for each route, set up for a stage. It keeps its number of waypoints unless a capacity is given."""
    # Energies in units of one cell's fraction of the coverage.
    cells = max(1, int(np.count_nonzero(work.problem.numbers.weight)))
    return [
        Chain(
            problem=work.problem,
            state=state_of(work.problem, route, capacity=capacity or len(route)),
            weights=Weights(
                path_weight * work.problem.metres_per_cost(route) / work.problem.reach_m,
                stage.waypoint,
                float(cells),
                1.0,
            ),
            hottest=heat * work.tuning.free_order.hottest_cells,
            coldest=work.tuning.free_order.coldest_cells,
            step_m=work.problem.reach_m,
            fewest=len(route) if capacity is None else 1,
            most=len(route) if capacity is None else capacity,
        )
        for route, heat, path_weight in zip(routes, stage.heats, stage.path_weights, strict=True)
    ]


def _without_least(work: Work, chain: Chain) -> Route:
    """The chain's route without the waypoint that contributes least."""
    state = chain.state
    recount(work.problem.numbers, state)
    alone = [observed_alone(work.problem.numbers, state, k) for k in range(int(state.size[0]))]
    return Route(np.delete(chain.route.waypoints_m, int(np.argmin(alone)), axis=0))


def search_free_order(
    work: Work,  # the problem and the remaining budget; ``work.problem.free_order`` holds
    starts: Sequence[SearchStart],  # one at least
    *,
    required: float
    | None,  # fraction of the visible ground that the selection rule asks for; None: as much as there is
    capacity: int,  # most waypoints
    judge: RouteJudge,  # judges what is found
) -> None:
    """Shortest tours with the required or full coverage, and the most coverage for every number of waypoints.

    A tour with the fewest waypoints is not the shortest: with more of them it cuts corners and turns back earlier (the
    close-enough travelling salesman problem). Tours come first if a route already has enough coverage, so that a search which is
    stopped early has a good one; otherwise they follow the search for few waypoints.
    """
    goal, tuned = FULL if required is None else required, work.tuning.free_order

    def tours(known: Sequence[SearchStart], until: float) -> None:
        search_goals(work, known, required=goal, capacity=capacity, until=until, judge=judge)

    thin(work, min(starts, key=_fewest_that_see_most).route, judge.found, until=_THINNING)
    begin = work.pace.fraction
    if required is not None and required >= FULL and work.problem.numbers.sight.kind == DISC:
        # A disc is equally wide at any height. If heights matter, a chain that does not rebuild is better.
        until = begin + tuned.tours_of_discs * (1.0 - begin)
        starts = rebuild_tours(work, starts, capacity=capacity, until=until, found=judge.found)
        begin = work.pace.fraction
    toured = required is not None or any(start.observed >= goal for start in starts)
    if toured:
        fraction = tuned.tours if required is None else tuned.tours_required
        tours(starts, begin + fraction * (1.0 - begin))
        begin = work.pace.fraction

    def at(fraction: float) -> float:
        return begin + fraction * (1.0 - begin)

    if work.stopped or begin >= 1.0:
        return
    spread_until = at(tuned.spread if toured else tuned.long_spread)
    fewest = spread(work, starts, capacity=capacity, until=spread_until, found=judge.found)
    if not toured:
        fewest = squeeze(work, fewest, capacity=capacity, until=at(tuned.first_squeeze), found=judge.found)
        if fewest.whole.observed >= goal:
            tours([*starts, fewest.whole], at(tuned.late_tours))
    squeeze_until = at(tuned.squeeze if toured else tuned.late_tours)
    fewest = squeeze(work, fewest, capacity=capacity, until=squeeze_until, found=judge.found)
    sweep(work, fewest, until=1.0, found=judge.found)
