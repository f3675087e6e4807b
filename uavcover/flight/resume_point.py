"""Which planned waypoints a track passed, where it left its route, and what remains to be flown.

All of it is judged from the track alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.flight.tuning import RESUME
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import Track


class Passage:
    """Counts the planned waypoints that were passed, from the vehicle's reports and its position.

    A waypoint counts when the vehicle goes on from it to the very next one, or comes near it while it says that it flies to it
    or to a later one; the last one also when the vehicle is near it as it goes on to something else. A jump over waypoints, as
    when another ground station sets the current item, passes none of them.

    Args:
        waypoints_m: (n, 3) ENU, the planned waypoints.
        radius_m: how near is near.

    Attributes:
        reached: number of waypoints passed, counted from the first.
        number: the waypoint that was flown to at the last update; -1 for none.
    """

    def __init__(self, waypoints_m: FloatArray, *, radius_m: float) -> None:
        self._waypoints_m, self._near_m = waypoints_m, RESUME.near_radii * radius_m
        self._before_m: FloatArray | None = None
        self.reached, self.number = 0, -1

    @property
    def complete(self) -> bool:
        """Whether all were passed."""
        return self.reached >= len(self._waypoints_m)

    def take(self, number: int, place_m: FloatArray) -> None:
        """Look at one moment.

        Args:
            number: of the planned waypoint that is flown to; -1 for none.
            place_m: (3,) ENU, where the vehicle is.
        """
        before, self.number = self.number, number
        if before == self.reached and number == self.reached + 1:
            self.reached += 1
        last = len(self._waypoints_m) - 1
        heading = last if number < 0 and before == last else number
        while self.reached <= min(heading, last) and self._near(place_m):
            self.reached += 1
        self._before_m = np.array(place_m, dtype=float)

    def believe(self, count: int) -> None:
        """Count the first ``count`` waypoints as passed, as after a silence."""
        self.reached = max(self.reached, min(count, len(self._waypoints_m)))

    def _near(self, place_m: FloatArray) -> bool:
        """Whether the straight line since the last look comes near the next waypoint."""
        start_m = place_m if self._before_m is None else self._before_m
        way_m, waypoint_m = place_m - start_m, self._waypoints_m[self.reached]
        length2 = float(way_m @ way_m)
        share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, float((waypoint_m - start_m) @ way_m) / length2))
        return float(np.linalg.norm(start_m + share * way_m - waypoint_m)) <= self._near_m


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """The end of what was flown of a planned route."""

    waypoint: int  # number of the first planned waypoint that was not passed; the number of waypoints when all were
    flown_m: float  # distance flown along the leg to it before the vehicle left it; 0 when that leg was not begun


def find_resume_point(track: Track, waypoints_m: FloatArray, *, radius_m: float) -> ResumePoint:
    """Where a track left its route.

    The vehicle's own count is believed where it begins, where it goes on one by one, and over a time that was not recorded; a
    jump passes nothing (see :class:`~uavcover.flight.resume_point.Passage`).

    Args:
        track: what was flown; its waypoint numbers are those of the route.
        waypoints_m: (n, 3) ENU, the planned route.
        radius_m: the vehicle's acceptance radius.
    """
    passage = Passage(waypoints_m, radius_m=radius_m)
    numbers, begun, begun_at = track.current_waypoint.tolist(), False, 0
    gaps = np.diff(track.time_s, prepend=track.time_s[:1]) > RESUME.unseen_s
    for row, (number, place_m) in enumerate(zip(numbers, track.enu_m, strict=True)):
        before = passage.reached
        if gaps[row] or (number >= 0 and not begun):
            passage.believe(number)
            begun = True
        passage.take(number, place_m)
        if passage.reached != before:
            begun_at = row
    flown_m = 0.0
    if 0 < passage.reached < len(waypoints_m):
        rows = slice(begun_at, None)
        leg = waypoints_m[passage.reached - 1 : passage.reached + 1]
        on_leg = (track.current_waypoint[rows] == passage.reached) & ~gaps[rows]
        flown_m = _along_m(track.enu_m[rows], on_leg, leg, corridor_m=RESUME.corridor_radii * radius_m)
    return ResumePoint(passage.reached, flown_m)


def remaining_route(
    waypoints_m: FloatArray, broken: ResumePoint, *, radius_m: float, sees_along_legs: bool
) -> FloatArray:
    """(k, 3) ENU: what is left of a planned route.

    A sensor that looks along the path has to fly the rest of the leg that was left, too: the route begins on that leg, a
    little before the place where it was left, because a vehicle cuts its first corner. The leg was checked at its full length
    and so was every part of it.

    Args:
        waypoints_m: (n, 3) ENU, the planned route.
        broken: where it was left.
        radius_m: the vehicle's acceptance radius.
        sees_along_legs: whether the sensor looks between the waypoints, too.
    """
    left = waypoints_m[broken.waypoint :]
    if not sees_along_legs or broken.waypoint == 0 or len(left) == 0:
        return left.copy()
    begin, end = waypoints_m[broken.waypoint - 1], waypoints_m[broken.waypoint]
    length_m = float(np.linalg.norm(end - begin))
    again_m = max(0.0, broken.flown_m - RESUME.overlap_radii * radius_m - RESUME.overlap_m)
    entry = begin if length_m == 0.0 else begin + min(1.0, again_m / length_m) * (end - begin)
    return np.vstack([entry, left])


def along_leg_m(place_m: FloatArray, leg_m: FloatArray) -> tuple[float, float]:
    """Distance of a (3,) position along a (2, 3) leg, and aside of it, in metres."""
    along = leg_m[1] - leg_m[0]
    length_m = float(np.linalg.norm(along))
    if length_m == 0.0:
        return 0.0, float(np.linalg.norm(place_m - leg_m[0]))
    flown_m = min(length_m, max(0.0, float((place_m - leg_m[0]) @ along) / length_m))
    return flown_m, float(np.linalg.norm(place_m - leg_m[0] - flown_m / length_m * along))


def _along_m(places_m: FloatArray, on_leg: NDArray[np.bool_], leg_m: FloatArray, *, corridor_m: float) -> float:
    """Length of the leg that the positions follow without leaving it, from the first one on it."""
    flown_m, begun = 0.0, False
    for place_m, on in zip(places_m, on_leg.tolist(), strict=True):
        along_m, aside_m = along_leg_m(place_m, leg_m)
        if not on or aside_m > corridor_m:
            if begun:
                break
            continue
        begun = True
        flown_m = max(flown_m, along_m)
    return flown_m
