"""Progress of a vehicle along its planned waypoints, in flight and by its track, and what is left of its route."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_io.model.enums import Firmware
from mission_io.wire import messages as m
from uavcover.flight.orders import FlightPlan
from uavcover.flight.session import Session
from uavcover.flight.tuning import PROGRESS, RESUME
from uavcover.kernels.arrays import FloatArray
from uavcover.model.outcome import Ending, EventKind
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
    jump passes nothing (see :class:`Passage`).

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


class MissionProgress:
    """Progress along the planned waypoints: by MISSION_CURRENT, MISSION_ITEM_REACHED and position together.

    A report proves no more than it says: a jump over waypoints passes none of them, unless no observation was possible
    because nothing was heard.

    Attributes:
        heading_for: number of the planned waypoint being flown to; -1 before the first and after the last.
    """

    def __init__(self, session: Session, plan: FlightPlan) -> None:
        self._session, self._plan = session, plan
        self._passage = Passage(plan.waypoints_m(), radius_m=plan.acceptance_radius_m)
        self._passage.believe(plan.passed_before)
        self._legs_m = plan.legs_m()
        self._seen_s = -math.inf
        self._trust_until_s = -math.inf
        self._rejoins: tuple[int, FloatArray] | None = None
        self.heading_for = -1

    @property
    def reached_count(self) -> int:
        """Number of planned waypoints that were passed in order."""
        return self._passage.reached

    @property
    def all_reached(self) -> bool:
        """Whether the last planned waypoint was passed."""
        return self._passage.complete

    @property
    def off_leg_m(self) -> float:
        """Distance from the current leg, transit legs included; 0 where there is none."""
        toward = self.off_leg_toward_m
        return 0.0 if toward is None else float(np.linalg.norm(toward))

    @property
    def off_leg_toward_m(self) -> FloatArray | None:
        """(3,) ENU from the vehicle to the nearest point of its leg; None where there is none."""
        here, leg = self.place_m, self._leg()
        if here is None or leg is None:
            return None
        ways = [leg] if self._rejoins is None else [leg, *_pieces(self._way_on(leg[0], leg[1]))]
        return min((_nearest_m(here, way) - here for way in ways), key=lambda toward: float(np.linalg.norm(toward)))

    def rejoin(self) -> None:
        """The mission was continued where the mode changed last: autopilots fly to the item from there, see ``_way_on``."""
        here = self._place_m(self._session.monitor.mode_changed_here)
        self._rejoins = None if here is None else (self._index, here)

    def line_problem(self) -> str | None:
        """Problem of the line from here to the current item; None when it is clear, or off the route."""
        here, leg, around = self.place_m, self._legs_m.get(self._index), self._plan.volume
        if here is None or leg is None or around is None or self.heading_for <= 0:
            return None
        points = np.vstack([_along(piece) for piece in _pieces(self._way_on(here, leg[1]))])
        heights = [up - around.ground_up_m(east, north) for east, north, up in points.tolist()]
        lowest = min((h for h in heights if not math.isnan(h)), default=math.inf)
        to = f"the straight line from here to waypoint {self.heading_for}"
        if any(math.isnan(height) for height in heights):
            return f"{to} leads over ground without elevation data"
        if lowest < around.min_height_agl_m - PROGRESS.slack_m:
            return f"{to} comes within {lowest:.0f} m of the ground; {around.min_height_agl_m:g} m is required"
        highest = max(heights)
        if highest > around.max_height_agl_m + PROGRESS.slack_m and self._climbs_first:
            return (
                f"the vehicle climbs in place before it flies to waypoint {self.heading_for}: up to {highest:.0f} m "
                f"above the ground; {around.max_height_agl_m:g} m is allowed"
            )
        return None

    @property
    def _climbs_first(self) -> bool:
        return self._session.autopilot.firmware is Firmware.PX4

    def _way_on(self, here: FloatArray, item: FloatArray) -> FloatArray:
        """(k, 3) ENU, the continuation of a mission: straight to the item; PX4 climbs first to a higher one."""
        if not self._climbs_first or item[2] <= here[2]:
            return np.vstack([here, item])
        return np.vstack([here, [here[0], here[1], item[2]], item])

    @property
    def _index(self) -> int:
        return self._plan.index_of(self._session.monitor.current_seq, self._session.autopilot)

    def _leg(self) -> FloatArray | None:
        """(2, 3) ENU, the leg that is flown: from where the mission was continued, if that was on this leg."""
        index, leg = self._index, self._legs_m.get(self._index)
        if self._rejoins is not None and self._rejoins[0] != index:
            self._rejoins = None
        return leg if leg is None or self._rejoins is None else np.vstack([self._rejoins[1], leg[1]])

    def update(self) -> None:
        """Read the vehicle's reports, and report a new waypoint."""
        monitor, autopilot, plan = self._session.monitor, self._session.autopilot, self._plan
        here, passage = self.place_m, self._passage
        if monitor.current_seq < 0 or here is None or self._session.watch.is_open(Ending.MISSION_CHANGED):
            return
        self._look_for_silence()
        number = plan.waypoint_of(monitor.current_seq, autopilot)
        was_last = passage.number == plan.waypoint_count - 1
        passage.take(number, here)
        reached = plan.waypoint_of(monitor.reached, autopilot)
        if reached == passage.reached and number in (reached, reached + 1, -1):
            passage.believe(reached + 1)
        trusted = self._seen_s <= self._trust_until_s
        if trusted and number > passage.reached:
            passage.believe(number)
        past = plan.is_past_waypoints(monitor.current_seq, autopilot)
        complete = number == plan.waypoint_count - 1 == passage.reached and monitor.mission_complete
        if complete or (past and (was_last or trusted)):
            passage.believe(plan.waypoint_count)
        if number == self.heading_for:
            return
        self.heading_for = number
        if number >= 0:
            text = f"flying to waypoint {number} of {plan.waypoint_count}"
            self._session.tell(EventKind.WAYPOINT, text, waypoint=number)
        elif self.all_reached:
            self._session.tell(EventKind.STAGE, "flew all planned waypoints; returning")

    @property
    def place_m(self) -> FloatArray | None:
        """(3,) ENU, the last reported position of the vehicle; None before the first one."""
        return self._place_m(self._session.monitor.latest(m.GlobalPositionInt))

    def _place_m(self, here: m.GlobalPositionInt | None) -> FloatArray | None:
        if here is None:
            return None
        place_m: FloatArray = self._plan.frame.enu_from_geodetic(here.lat_deg, here.lon_deg, here.alt_amsl_m)[0]
        return place_m

    def _look_for_silence(self) -> None:
        """After missing positions, believe the vehicle's reported waypoint for a moment."""
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None:
            return
        if math.isfinite(self._seen_s) and here.time_boot_s - self._seen_s > PROGRESS.unseen_s:
            self._trust_until_s = here.time_boot_s + PROGRESS.trust_s
        self._seen_s = here.time_boot_s


def _pieces(way: FloatArray) -> list[FloatArray]:
    """(2, 3) each, the straight pieces of a (k, 3) way."""
    return [way[number : number + 2] for number in range(len(way) - 1)]


def _along(piece: FloatArray) -> FloatArray:
    """(n, 3) points along a (2, 3) piece, a few metres apart."""
    line = piece[1] - piece[0]
    fractions = np.linspace(0.0, 1.0, 2 + math.ceil(float(np.linalg.norm(line)) / PROGRESS.step_m))
    points: FloatArray = piece[0] + fractions[:, None] * line
    return points


def _nearest_m(here: FloatArray, leg: FloatArray) -> FloatArray:
    """(3,) the point of a (2, 3) leg that is nearest to a (3,) position."""
    along = leg[1] - leg[0]
    square = float(along @ along)
    fraction = 0.0 if square == 0.0 else min(1.0, max(0.0, float((here - leg[0]) @ along) / square))
    nearest: FloatArray = leg[0] + fraction * along
    return nearest
