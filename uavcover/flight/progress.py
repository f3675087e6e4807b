"""Progress of a flight along its plan: waypoints passed, delay, and whether the battery lasts."""

import math
from dataclasses import dataclass

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.enums import Firmware
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.telemetry_messages import SysStatus
from uavcover.errors import UavcoverError
from uavcover.flight.orders import FlightPlan
from uavcover.flight.session import Session
from uavcover.flight.watch import RESERVE, BatteryUse
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import Pace, landing_time, leg_times, takeoff_time, turn_times
from uavcover.model.track import Ending, EventKind
from uavcover.model.vehicle import Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class _Progress:
    unobserved_s: float
    trust_s: float
    step_m: float
    slack_m: float


PROGRESS = data_table(_Progress, "uavcover/data/flight.toml", "progress")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Resume:
    near_radii: float
    unobserved_s: float
    corridor_radii: float
    overlap_radii: float
    overlap_m: float


RESUME = data_table(_Resume, "uavcover/data/flight.toml", "resume")


class Passage:
    """Counts the planned waypoints that were passed, from the vehicle's reports and its position.

    A waypoint counts if the vehicle continues from it to the next one, or comes near it while it reports flying to it or to a
    later one. The last one also counts if the vehicle is near it when it continues to something else. A jump over waypoints, as
    when another ground station sets the current item, passes none of them.

    Args:
        waypoints_m: (n, 3) ENU, the planned waypoints.
        radius_m: largest distance that counts as near.

    Attributes:
        reached: number of waypoints passed, counted from the first.
        number: target waypoint at the last update; -1 for none.
    """

    def __init__(self, waypoints_m: FloatArray, *, radius_m: float) -> None:
        self._waypoints_m, self._near_m = waypoints_m, RESUME.near_radii * radius_m
        self._before_m: FloatArray | None = None
        self.reached, self.number = 0, -1

    @property
    def complete(self) -> bool:
        """Whether all were passed."""
        return self.reached >= len(self._waypoints_m)

    def take(self, number: int, position_m: FloatArray) -> None:
        """Look at one moment.

        Args:
            number: of the planned waypoint that is flown to; -1 for none.
            position_m: (3,) ENU, where the vehicle is.
        """
        before, self.number = self.number, number
        if before == self.reached and number == self.reached + 1:
            self.reached += 1
        last = len(self._waypoints_m) - 1
        heading = last if number < 0 and before == last else number
        while self.reached <= min(heading, last) and self._near(position_m):
            self.reached += 1
        self._before_m = np.array(position_m, dtype=float)

    def believe(self, count: int) -> None:
        """Count the first ``count`` waypoints as passed, as after a silence."""
        self.reached = max(self.reached, min(count, len(self._waypoints_m)))

    def _near(self, position_m: FloatArray) -> bool:
        """Whether the straight line since the last look comes near the next waypoint."""
        start_m = position_m if self._before_m is None else self._before_m
        waypoint_m = self._waypoints_m[self.reached]
        nearest_m = _nearest_m(waypoint_m, np.stack([start_m, position_m]))
        return float(np.linalg.norm(nearest_m - waypoint_m)) <= self._near_m


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
        if plan.is_return and (here := self.position_m) is not None:  # autopilots fly to its first item from here
            first = next((k for k, item in enumerate(plan.mission.items) if plan.has_position(item)), None)
            if first is not None:
                self._legs_m[first] = np.vstack([here, plan.position_m(plan.mission.items[first])])
        self._observed_s = -math.inf
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
        """Distance from the current leg, transit legs included; 0 without one."""
        toward = self.off_leg_toward_m
        return 0.0 if toward is None else float(np.linalg.norm(toward))

    @property
    def off_leg_toward_m(self) -> FloatArray | None:
        """(3,) ENU from the vehicle to the nearest point of its leg; None without one."""
        here, leg = self.position_m, self._leg()
        if here is None or leg is None:
            return None
        paths = [leg] if self._rejoins is None else [leg, *_pieces(self._path_on(leg[0], leg[1]))]
        return min((_nearest_m(here, path) - here for path in paths), key=lambda toward: float(np.linalg.norm(toward)))

    def rejoin(self) -> None:
        """The mission was continued where the mode changed last: autopilots fly to the item from there, see ``_path_on``."""
        here = self._position_m(self._session.monitor.mode_changed_here)
        self._rejoins = None if here is None else (self._index, here)

    def line_problem(self) -> str | None:
        """Problem of the line from here to the current item; None when it is clear, or off the route."""
        here, leg, around = self.position_m, self._legs_m.get(self._index), self._plan.volume
        if here is None or leg is None or around is None or self.heading_for <= 0:
            return None
        points = np.vstack([_along(piece) for piece in _pieces(self._path_on(here, leg[1]))])
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

    def _path_on(self, here: FloatArray, item: FloatArray) -> FloatArray:
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
        here, passage = self.position_m, self._passage
        if monitor.current_seq < 0 or here is None or self._session.watch.is_open(Ending.MISSION_CHANGED):
            return
        self._look_for_silence()
        number = plan.waypoint_of(monitor.current_seq, autopilot)
        was_last = passage.number == plan.waypoint_count - 1
        passage.take(number, here)
        reached = plan.waypoint_of(monitor.reached, autopilot)
        if reached == passage.reached and number in (reached, reached + 1, -1):
            passage.believe(reached + 1)
        trusted = self._observed_s <= self._trust_until_s
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
    def position_m(self) -> FloatArray | None:
        """(3,) ENU, the last reported position of the vehicle; None before the first one."""
        return self._position_m(self._session.monitor.latest(m.GlobalPositionInt))

    def _position_m(self, here: m.GlobalPositionInt | None) -> FloatArray | None:
        if here is None:
            return None
        position_m: FloatArray = self._plan.frame.enu_from_geodetic(here.lat_deg, here.lon_deg, here.alt_amsl_m)[0]
        return position_m

    def _look_for_silence(self) -> None:
        """After missing positions, believe the vehicle's reported waypoint for a moment."""
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None:
            return
        if math.isfinite(self._observed_s) and here.time_boot_s - self._observed_s > PROGRESS.unobserved_s:
            self._trust_until_s = here.time_boot_s + PROGRESS.trust_s
        self._observed_s = here.time_boot_s


def _pieces(path: FloatArray) -> list[FloatArray]:
    """(2, 3) each, the straight pieces of a (k, 3) way."""
    return [path[number : number + 2] for number in range(len(path) - 1)]


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Schedule:
    late_s: float
    late_ratio: float
    look_every_s: float
    fewest_photos: int
    by_chance: float


SCHEDULE = data_table(_Schedule, "uavcover/data/flight.toml", "schedule")


_WAITS = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)


@dataclass(frozen=True, slots=True)
class Timetable:
    """Planned times of a flight."""

    legs_m: dict[int, FloatArray]  # the leg to each place, by the index of its item: (2, 3) ENU
    begins_s: dict[int, float]  # when each leg is begun, by the index of its item, in seconds after take-off
    ends_s: dict[int, float]  # when each leg is ended
    total_s: float  # from take-off to landing

    def planned_s(self, index: int, position_m: FloatArray) -> float | None:
        """Planned time after take-off at a (3,) ENU position on the leg to an item; None without a leg."""
        leg = self.legs_m.get(index)
        if leg is None:
            return None
        along = leg[1] - leg[0]
        square = float(along @ along)
        fraction = 1.0 if square == 0.0 else min(1.0, max(0.0, float((position_m - leg[0]) @ along) / square))
        return self.begins_s[index] + fraction * (self.ends_s[index] - self.begins_s[index])


def timetable(plan: FlightPlan, pace: Pace) -> Timetable | None:
    """The timetable of a mission; None for one without legs."""
    legs = plan.legs_m()
    if not legs:
        return None
    home_m = plan.frame.enu_from_geodetic(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)[0]
    indices = sorted(legs)
    path = np.vstack([legs[indices[0]][0], *(legs[index][1] for index in indices)])
    lands = path[-1, 2] <= home_m[2] + 1.0
    legs_s = leg_times(pace, path)
    if lands:
        legs_s[-1] = float(landing_time(pace, max(0.0, path[-2, 2] - path[-1, 2])))
    turns_s = turn_times(pace, path[:-1] if lands else path)
    climb_s = float(takeoff_time(pace, max(0.0, path[0, 2] - home_m[2])))
    begins, ends, now_s = {}, {}, climb_s
    items = plan.mission.items
    for number, index in enumerate(indices):
        begins[index] = now_s
        now_s += float(legs_s[number]) + (float(turns_s[number + 1]) if number + 1 < len(turns_s) else 0.0)
        ends[index] = now_s
        until = indices[number + 1] if number + 1 < len(indices) else len(items)
        now_s += sum(_wait_s(items[k].command, items[k].params[0]) for k in range(index, until))
    return Timetable(legs, begins, ends, now_s)


def _wait_s(command: int, seconds: float) -> float:
    return seconds if command in _WAITS and math.isfinite(seconds) and seconds > 0.0 else 0.0


def tell_short_battery(session: Session, plan: FlightPlan) -> None:
    """Warn before arming that the battery is too small for the mission and its reserve."""
    needs, status = plan.needs, session.monitor.latest(SysStatus)
    vehicle, table = (None, None) if needs is None else (needs.vehicle, timetable(plan, needs.pace))
    left = None if status is None else status.battery_remaining_percent
    if vehicle is None or vehicle.endurance_s is None or table is None or left is None or left < 0:
        return
    used, reserve = 100.0 * table.total_s / vehicle.endurance_s, 100.0 * vehicle.reserve_fraction
    if left + RESERVE.rounding_percent < used + reserve:
        session.alarm(
            f"the battery has {left} % left, but the mission uses about {used:.0f} % and the reserve is {reserve:.0f} %: "
            "the vehicle may return before it is done; change or charge the battery"
        )


class FlightSchedule:
    """Compares a flight in the air with its plan."""

    def __init__(self, session: Session, plan: FlightPlan, progress: MissionProgress) -> None:
        self._session, self._plan, self._progress = session, plan, progress
        needs = plan.needs
        self._table = None if needs is None else timetable(plan, needs.pace)
        self._vehicle = Vehicle() if needs is None or needs.vehicle is None else needs.vehicle
        self._home_s = None if needs is None else needs.return_s
        endurance_s = self._vehicle.endurance_s
        self._use = BatteryUse(self._vehicle, 100.0 / endurance_s if endurance_s else 0.0)
        self._began: tuple[float, float] | None = None
        self._next_s = -math.inf
        self.aloft_s = 0.0
        self.late_s = 0.0
        self.left_s: float | None = None
        self._must: str | None = None

    def look(self) -> None:
        """Look whether the flight is late, and whether its reserve lasts; called while the vehicle is in the air."""
        now_s, position_m = self._session.monitor.time_s, self._progress.position_m
        if now_s is None or position_m is None or now_s < self._next_s:
            return
        self._next_s = now_s + SCHEDULE.look_every_s
        index = self._plan.index_of(self._session.monitor.current_seq, self._session.autopilot)
        planned_s = None if self._table is None else self._table.planned_s(index, position_m)
        if self._began is None:
            self._began = now_s, planned_s or 0.0
        began_s, offset_s = self._began
        self.aloft_s = now_s - began_s
        if planned_s is None or self._table is None:
            return
        done_s, total_s = planned_s - offset_s, self._table.total_s - offset_s
        self.late_s = self.aloft_s - done_s
        pace = max(1.0, self.aloft_s / done_s) if done_s > SCHEDULE.late_s else 1.0
        self.left_s = pace * (total_s - done_s)
        astray = self._session.watch.is_open(Ending.MISSION_CHANGED)  # what is flown then has another timetable
        late = not astray and self.late_s > max(SCHEDULE.late_s, SCHEDULE.late_ratio * done_s)
        self._session.watch.measure(
            Ending.LATE, self.late_s if late else None,
            f"the flight is {self.late_s:.0f} s late: {self.aloft_s:.0f} s in the air instead of the planned "
            f"{done_s:.0f} s; it will land after about {self.aloft_s + self.left_s:.0f} s instead of {total_s:.0f} s",
            "the flight is on schedule again",
        )  # fmt: skip
        self._look_at_reserve(position_m, self.left_s)

    def must_go_home(self) -> str | None:
        """Reason to end the mission now for the battery's reserve; None while it may go on."""
        return self._must

    def _look_at_reserve(self, position_m: FloatArray, left_s: float) -> None:
        vehicle, use = self._vehicle, self._use
        status = self._session.monitor.latest(SysStatus)
        remaining_percent = None if status is None else status.battery_remaining_percent
        if remaining_percent is not None and remaining_percent >= 0:
            source, percent = "the battery", float(remaining_percent)
        elif vehicle.endurance_s is not None:
            source, percent = "the planned endurance", 100.0 * (1.0 - self.aloft_s / vehicle.endurance_s)
        else:
            return
        use.take(percent, aloft_s=self.aloft_s)
        below = percent < 100.0 * vehicle.reserve_fraction
        self._session.watch.measure(
            Ending.RESERVE_USED, 100.0 / max(1.0, percent) if below else None,
            f"the flight is using its battery reserve: {source} has {max(0.0, percent):.0f} % left, but the reserve "
            f"is {100.0 * vehicle.reserve_fraction:.0f} %",
            "the battery is above its reserve again",
        )  # fmt: skip
        if self._home_s is None or self._must is not None or use.lasts_on(left_s):
            return
        try:
            home_s = self._home_s(position_m)
        except UavcoverError:  # the ground below the return is not known
            return
        if not use.allows_on(rest_s=left_s, home_s=home_s):
            self._must = (
                f"{source} has {percent:.0f} % left and loses {60.0 * use.each_s:.1f} % per minute: the return takes "
                f"{home_s:.0f} s and the remaining mission {left_s:.0f} s, which would use the reserve of "
                f"{100.0 * vehicle.reserve_fraction:.0f} %; the vehicle returns now"
            )
