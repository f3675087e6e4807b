"""Judges of a search's routes: coverage on the evaluation grid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from uavcover.model.route import Route
from uavcover.sensing.coverage_map import CoverageMap

SAFETY = 0.0003
"""Share of the coverage by which a route is to reach more than its goal on the finest cells: other cells see less."""


def with_safety(goal: float) -> float:
    """Coverage at which a search for a goal aims: SAFETY more, or half of what is left to all."""
    return goal + min(SAFETY, 0.5 * (1.0 - goal))


@dataclass(frozen=True, slots=True, eq=False)
class RouteJudge:
    """Judge of a search's routes."""

    # share of what can be covered that a route sees, on the cells it is judged on; exact where it may reach the goal,
    # which it is given
    coverage: Callable[[Route, float], float]
    found: Callable[[Route], None]  # called with every route worth judging
    # a route and what else has to be flown to reach a goal on those cells; none where that is too much to find out. It
    # receives the test whether there is no time left for it.
    closed: Callable[[Route, float, Callable[[], bool]], Route | None] = lambda _route, _goal, _is_over: None


def share_seen(route: Route, cells: CoverageMap) -> float:
    """Share of what can be covered that a route sees."""
    return cells.share_of_coverable(cells.seen(route.waypoints_m))


class OneAfterTheOther:
    """Least coverage of a route on several maps, the first one first.

    A route that misses its goal there skips the others.

    On those as much less is taken to be seen of it as was of the last route that reached its goal.
    """

    def __init__(self, judges: Sequence[CoverageMap]) -> None:
        self._judges = judges
        self._less = 0.0

    def __call__(self, route: Route, goal: float) -> float:
        """Share of what can be covered, exact where it reaches the goal."""
        first = share_seen(route, self._judges[0])
        if first < goal:
            return first - self._less
        least = min([first, *(share_seen(route, judge) for judge in self._judges[1:])])
        self._less = first - least
        return least
