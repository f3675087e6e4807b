"""Progress of a vehicle along its planned waypoints."""

import math

import numpy as np

from mission_io.model.enums import Firmware
from mission_io.wire import messages as m
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.resume import Passage
from uavcover.flight.session import Session
from uavcover.flight.tuning import PROGRESS
from uavcover.kernels.arrays import FloatArray
from uavcover.model.outcome import Ending, EventKind


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
