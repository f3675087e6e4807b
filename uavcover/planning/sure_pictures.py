"""A route none of whose pictures by distance is taken or missed by centimetres: a waypoint gives way by a few of them."""

import math

import numpy as np

from uavcover.model.route import Route
from uavcover.routes.leg_checks import measure_violations
from uavcover.scenario.site import Site
from uavcover.sensing.unsure_pictures import LEAST_SPARE_M, unsure_pictures

_MORE_M = 0.1
"""By so much a waypoint gives way more than the line has to: it is passed on the inside."""

_MOST_TRIES = 40
"""Each moves one waypoint by a metre at most. A plan of 25 waypoints takes three; where they do not end, pictures stay unsure."""


def surely(site: Site, route: Route) -> Route:
    """The route, or in its place the one with sure pictures where that keeps the limits as it does."""
    other = with_sure_pictures(site, route)
    if other is None:
        return route
    margin_m = site.scenario.limits.height_margin_m
    before, after = (
        measure_violations(site, each.waypoints_m, margin_m=margin_m).total for each in (route, other)
    )  # fmt: skip
    return other if after <= before else route


def with_sure_pictures(site: Site, route: Route) -> Route | None:
    """A route whose pictures are those of the given one, all of them sure; none where they are already, or cannot be made so.

    A waypoint keeps its height above ground. Limits and coverage are for the caller to judge.
    """
    points = np.array(route.waypoints_m)
    for tries in range(_MOST_TRIES):
        unsure = next(unsure_pictures(site, points), None)
        if unsure is None:
            return Route(points, route.begins) if tries > 0 else None
        # The nearest waypoint is that of the corner, or the end.
        nearest = int(np.argmin(np.linalg.norm(points - unsure.turning_m, axis=1)))
        wanted_m = math.copysign(LEAST_SPARE_M + _MORE_M, unsure.spare_m)
        height_agl_m = site.ground.heights_agl_m(points[nearest])
        points[nearest, :2] += (wanted_m - unsure.spare_m) * unsure.away
        points[nearest, 2] = site.ground.ups_m(points[nearest, :2], height_agl_m)[0]
    return None
