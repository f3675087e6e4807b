"""Local search for routes of few waypoints: each next price of a waypoint is dearer, and the way may get longer for it."""

from collections.abc import Callable, Sequence

from uavcover.model.route import Route
from uavcover.planning.goal_search import Start, search_goal
from uavcover.planning.local_search import Work

PRICES = (0.3, 1.0, 3.0)
"""Of a waypoint, in radii of the sensor."""

_STAGES = (0.4, 0.8, 1.0)


def search_waypoints(
    work: Work,
    starts: Sequence[Start],
    *,
    goal: float,
    capacity: int,
    until: float,
    judged_coverage: Callable[[Route], float],
    found: Callable[[Route], None],
) -> list[Start]:
    """Routes that reach a goal with ever fewer waypoints.

    Args:
        work: what is looked at, and how much may be done.
        starts: one at least; long ones of few waypoints are good for the higher prices.
        goal: share of what can be covered.
        capacity: most waypoints.
        until: share of all the work, 0..1, after which this search ends.
        judged_coverage: of a route, on the cells it is judged on.
        found: told every route worth judging.
    """
    begin = work.pace.fraction
    each = (until - begin) / len(PRICES)
    known = list(starts)
    for number, price in enumerate(PRICES):
        share = (begin + number * each, begin + (number + 1) * each)
        known += search_goal(
            work, known, goal, capacity, share, _STAGES, judged_coverage, found, waypoint_price=price
        )  # fmt: skip
    return known
