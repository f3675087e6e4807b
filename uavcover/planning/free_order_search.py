"""Local search where waypoints may be visited in any order: shortest tours that see enough, and every number of waypoints."""

from collections.abc import Callable, Sequence

from uavcover.model.route import Route
from uavcover.planning.count_search import FULL, spread, squeeze, sweep, thin
from uavcover.planning.goal_search import Start, search_goals
from uavcover.planning.local_search import Work

_TOURS = 0.4
"""Share of the work for shortest tours, once something sees as much as they are to see."""

_SPREAD, _SQUEEZE = 0.35, 0.85
"""Shares of what is left for numbers of waypoints, after which its parts end."""
_LONG_SPREAD, _FIRST_SQUEEZE, _LATE_TOURS = 0.65, 0.75, 0.9
"""The same while nothing sees enough: one long annealing with as many waypoints as there may be, and tours when it was enough."""


def search_free_order(
    work: Work,
    starts: Sequence[Start],
    *,
    asked: float | None,
    capacity: int,
    judged_coverage: Callable[[Route], float],
    found: Callable[[Route], None],
) -> None:
    """Shortest tours for what is asked for, or all, and the most coverage with every number of waypoints.

    A tour of the fewest waypoints is not the shortest: with more of them it cuts corners and turns back earlier (the travelling
    salesman who need only come close). Tours come first when something sees enough already, so that a search which is stopped
    early has a good one; else when few waypoints have been found that do.

    Args:
        work: what is looked at, and how much may be done; ``work.task.free_order`` holds.
        starts: one at least.
        asked: share of what can be covered that the selection rule asks for; None: as much as there is.
        capacity: most waypoints.
        judged_coverage: of a route, on the cells it is judged on.
        found: told every route worth judging.
    """
    goal = FULL if asked is None else asked

    def tours(known: Sequence[Start], until: float) -> None:
        search_goals(
            work, known, asked=goal, capacity=capacity, until=until, judged_coverage=judged_coverage, found=found
        )

    most = min(starts, key=lambda start: (-start.seen, len(start.route)))
    thin(work, most.route, found)
    begin = work.pace.fraction
    toured = asked is not None or any(start.seen >= goal for start in starts)
    if toured:
        tours(starts, begin + _TOURS * (1.0 - begin))
        begin = work.pace.fraction

    def at(share: float) -> float:
        return begin + share * (1.0 - begin)

    if work.stopped or begin >= 1.0:
        return
    fewest = spread(work, starts, capacity=capacity, until=at(_SPREAD if toured else _LONG_SPREAD), found=found)
    if not toured:
        fewest = squeeze(work, fewest, capacity=capacity, until=at(_FIRST_SQUEEZE), found=found)
        if fewest.whole.seen >= goal:
            tours([*starts, fewest.whole], at(_LATE_TOURS))
    fewest = squeeze(work, fewest, capacity=capacity, until=at(_SQUEEZE if toured else _LATE_TOURS), found=found)
    sweep(work, fewest, until=1.0, found=found)
