"""Routes that a search starts from, and which of them are best for a goal."""

import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from uavcover.model.route import Route
from uavcover.planner.search.local_search import CHAINS
from uavcover.planner.search.route_problem import RouteProblem
from uavcover.planner.search.tuning import TUNED, GoalTuning


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


def _merit(
    problem: RouteProblem, start: SearchStart, goal: float, waypoint_m: float, tuned: GoalTuning
) -> tuple[bool, float]:
    """Smallest for the best initial solution. Where the order is free, any route that reaches the goal ranks first."""
    with_waypoints = 1.0 + waypoint_m * len(start.route) / max(start.route.length_m, problem.reach_m)
    cost = problem.cost(start.route) * with_waypoints
    return problem.free_order and start.seen < goal, tuned.start_cost(cost, start.seen, goal)
