"""Lines that turn just before a picture by distance is due: where it shows enough for its way, the turn waits for it.

The local search counts half of a picture's distance beyond the end of each leg as shown, as it is on average. A search makes its
lines as short as that allows, and where a line turns back the last picture is missing more often than not.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Route
from uavcover.planning.search.route_judge import share_seen
from uavcover.planning.sure_pictures import surely
from uavcover.routes.leg_checks import measure_violations
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.flown_line import line_flown, pictures_on
from uavcover.sensing.sensors import trigger_distance_m

_TURNS_RAD = math.radians(50.0)
"""By less the line goes on, and so do its pictures."""

_MOST_WAY = 0.75
"""Of the distance between two pictures: a turn does not wait longer."""

_MORE_M = (1.5, 6.0)
"""A turn waits by so much longer than the line is too short: it is passed on the inside."""


def with_waiting_turns(
    judging: CoverageMap,
    route: Route,
    goal: float,
    *,
    cost: Callable[[Route], float],
    price: float,
    is_over: Callable[[], bool],
) -> Route:
    """The route with turns that wait for their next picture, one after the other until the goal is reached.

    Args:
        judging: the cells by which routes are judged.
        route: keeps the limits.
        goal: share of what can be covered.
        cost: of a route.
        price: of all coverage, in costs of the route: what a turn shows by waiting has to be worth more than its way.
        is_over: whether there is no time left for it.

    Returns:
        The route itself where no turn should wait, and where pictures are not taken by distance.
    """
    site = judging.site
    if trigger_distance_m(site.scenario) is None:
        return route
    best, seen, spent = route, share_seen(route, judging), cost(route)
    violations = _violations(site, route)
    for number in range(1, len(route)):
        worth = 0.0
        for other in _waiting_at(site, best, number):
            if seen >= goal or is_over():
                return best
            if _violations(site, other) > violations:
                continue
            gained = min(share_seen(other, judging), goal) - seen
            more = gained * price * spent - (cost(other) - spent)
            if more > worth:
                worth, found = more, other
        if worth > 0.0:
            best, seen, spent = found, share_seen(found, judging), cost(found)
    return best


def _waiting_at(site: Site, route: Route, number: int) -> Iterator[Route]:
    """The route with a waypoint further along the way to it, to where the next picture is taken; none where it need not be."""
    points = route.waypoints_m
    onward = points[number, :2] - points[number - 1, :2]
    if number + 1 < len(points) and _turn_rad(onward, points[number + 1, :2] - points[number, :2]) < _TURNS_RAD:
        return
    trigger_m = trigger_distance_m(site.scenario) or 0.0
    line_m = line_flown(site, points).places_m
    pieces, pictures_m = pictures_on(line_m, trigger_m)
    nearest = int(np.argmin(np.linalg.norm(line_m - points[number], axis=1)))
    before, length_m = pictures_m[pieces < nearest], float(np.hypot(*onward))
    if len(before) == 0 or length_m == 0.0:
        return
    short_m = trigger_m - float(np.hypot(*(points[number] - before[-1])[:2]))
    if not 0.0 < short_m <= _MOST_WAY * trigger_m:
        return
    height_agl_m = site.ground.heights_agl_m(points[number])
    for more_m in _MORE_M:
        moved = np.array(points)
        moved[number, :2] += (short_m + more_m) / length_m * onward
        moved[number, 2] = site.ground.ups_m(moved[number, :2], height_agl_m)[0]
        if np.isfinite(moved).all():
            yield surely(site, Route(moved, route.begins))


def _turn_rad(before: FloatArray, behind: FloatArray) -> float:
    """Angle between two directions on the map, 0 for straight on."""
    return abs(math.remainder(math.atan2(*before[::-1]) - math.atan2(*behind[::-1]), 2.0 * math.pi))


def _violations(site: Site, route: Route) -> float:
    return measure_violations(site, route.waypoints_m, margin_m=site.scenario.limits.height_margin_m).total
