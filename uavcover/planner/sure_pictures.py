"""A route with robust distance-triggered photos: a waypoint moves by centimetres where one may be missed."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.scenario.site import Site
from uavcover.sensing.flown_line import corners_matter, line_flown, pictures_on
from uavcover.sensing.sensors import trigger_distance_m

_MORE_M = 0.1
"""Extra move of a waypoint beyond that of the line, because its corner is cut."""

_MOST_TRIES = 40
"""Each moves one waypoint by a metre at most. A plan of 25 waypoints takes three; where they do not end, photos stay unsure."""


def surely(site: Site, route: Route) -> Route:
    """The route, or in its place the one with sure photos where that keeps the limits as it does."""
    other = with_sure_pictures(site, route)
    if other is None:
        return route
    margin_m = site.scenario.limits.height_margin_m
    before, after = (
        measure_violations(site, each.waypoints_m, margin_m=margin_m).total for each in (route, other)
    )  # fmt: skip
    return other if after <= before else route


def with_sure_pictures(site: Site, route: Route) -> Route | None:
    """A route with the photos of the given one, all of them sure.

    None where they are already, or cannot be made so.

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


# Photos by distance that are taken or not by less than a vehicle keeps to its line.
#
# Where a line turns back just where the next photo is due, a few centimetres decide. If that photo is missing, all
# later ones come later by as much as their distance, and see other ground than was planned.

LEAST_SPARE_M = 0.5
"""Below this spare a photo is unsure: in flights of the mock vehicle photos were up to 0.42 m from their planned positions."""


@dataclass(frozen=True, slots=True, eq=False)
class UnsurePicture:
    """A photo that is unsure."""

    turning_m: FloatArray  # (3,) ENU place where the line turns back to the last photo, or ends
    away: FloatArray  # (2,) unit vector to it from there, east and north
    # by how much it is farther away than the distance between two photos; less than 0: the photo is not taken
    spare_m: float


def unsure_pictures(site: Site, route_m: FloatArray) -> Iterator[UnsurePicture]:
    """Those along an (n, 3) ENU route as it is flown, in their order; none where corners are flown exactly."""
    trigger_m = trigger_distance_m(site.scenario)
    if trigger_m is None or not corners_matter(site) or len(route_m) < 2:
        return
    line_m = line_flown(site, route_m).places_m
    legs, places_m = pictures_on(line_m, trigger_m)
    for number, (leg, place_m) in enumerate(zip(legs, places_m, strict=True)):
        is_last = number + 1 == len(legs)
        due = len(line_m) if is_last else int(legs[number + 1]) + 1
        # Between most photos the line is straight.
        turns = due - leg > 2
        missed = _turned_back(line_m[leg + 1 : due], place_m, least_m=trigger_m - LEAST_SPARE_M) if turns else None
        if missed is not None:
            yield _unsure(missed, place_m, trigger_m)
        if not is_last:
            taken = _barely_passed(places_m[number + 1], line_m, due, place_m, trigger_m)
            if taken is not None:
                yield _unsure(taken, place_m, trigger_m)


def _unsure(turning_m: FloatArray, from_m: FloatArray, trigger_m: float) -> UnsurePicture:
    away = turning_m[:2] - from_m[:2]
    reach_m = float(np.hypot(*away))
    return UnsurePicture(turning_m, away / reach_m, reach_m - trigger_m)


def _turned_back(points_m: FloatArray, from_m: FloatArray, *, least_m: float) -> FloatArray | None:
    """The first of (k, 3) points with this distance from a point and a nearer one after it: a line is farthest at its points."""
    reach_m = np.hypot(points_m[:, 0] - from_m[0], points_m[:, 1] - from_m[1])
    turns = np.flatnonzero((reach_m[:-1] >= least_m) & (reach_m[1:] < reach_m[:-1]))
    return None if turns.size == 0 else points_m[turns[0]]


def _barely_passed(
    picture_m: FloatArray, line_m: FloatArray, first: int, from_m: FloatArray, trigger_m: float
) -> FloatArray | None:
    """Farthest point of a line from its last photo, if it ends or turns back within the tolerance of the next one."""
    farthest_m, most_m = picture_m, trigger_m
    for point_m in line_m[first:]:
        reach_m = math.hypot(point_m[0] - from_m[0], point_m[1] - from_m[1])
        if reach_m >= trigger_m + LEAST_SPARE_M:
            return None
        if reach_m < trigger_m:
            break
        if reach_m > most_m:
            farthest_m, most_m = point_m, reach_m
    return farthest_m
