"""Pictures by distance that are taken or not by less than a vehicle keeps to its line.

Where a line turns back just where the next picture is due, a few centimetres decide. If that picture is missing, all later ones
come later by as much as their distance, and see other ground than was planned.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.site import Site
from uavcover.sensing.flown_line import corners_matter, line_flown, pictures_on
from uavcover.sensing.sensors import trigger_distance_m

LEAST_SPARE_M = 0.5
"""By less a picture is unsure: in flights of the mock vehicle pictures were up to 0.42 m from where they were planned."""


@dataclass(frozen=True, slots=True, eq=False)
class UnsurePicture:
    """A picture that is unsure.

    Attributes:
        turning_m: (3,) ENU place where the line turns back to the last picture, or ends.
        away: (2,) unit vector to it from there, east and north.
        spare_m: by how much it is farther away than the distance between two pictures; less than 0: the picture is not taken.
    """

    turning_m: FloatArray
    away: FloatArray
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
        # Between most pictures the line is straight.
        turns = due - leg > 2
        missed = _turned_back(line_m[leg + 1 : due], place_m, least_m=trigger_m - LEAST_SPARE_M) if turns else None
        if missed is not None:
            yield _unsure(missed, place_m, trigger_m)
        if not is_last:
            taken = _hardly_passed(places_m[number + 1], line_m, due, place_m, trigger_m)
            if taken is not None:
                yield _unsure(taken, place_m, trigger_m)


def _unsure(turning_m: FloatArray, from_m: FloatArray, trigger_m: float) -> UnsurePicture:
    away = turning_m[:2] - from_m[:2]
    reach_m = float(np.hypot(*away))
    return UnsurePicture(turning_m, away / reach_m, reach_m - trigger_m)


def _turned_back(points_m: FloatArray, from_m: FloatArray, *, least_m: float) -> FloatArray | None:
    """The first of (k, 3) points at least so far from a place with a nearer one behind it: a line is farthest at its points."""
    reach_m = np.hypot(points_m[:, 0] - from_m[0], points_m[:, 1] - from_m[1])
    turns = np.flatnonzero((reach_m[:-1] >= least_m) & (reach_m[1:] < reach_m[:-1]))
    return None if turns.size == 0 else points_m[turns[0]]


def _hardly_passed(
    picture_m: FloatArray, line_m: FloatArray, first: int, from_m: FloatArray, trigger_m: float
) -> FloatArray | None:
    """Where a line is farthest from the last picture behind the next one, if it ends or turns back within the tolerance."""
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
