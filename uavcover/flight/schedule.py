"""Watch a flight against its plan: its delay, its battery, and the photos that its camera reports."""

import math
from dataclasses import dataclass

import numpy as np

from mission_io.model.items import Command
from mission_io.wire.telemetry_messages import SysStatus
from uavcover.errors import UavcoverError
from uavcover.flight.orders import FlightPlan
from uavcover.flight.progress import MissionProgress
from uavcover.flight.session import Session
from uavcover.flight.tuning import RESERVE, SCHEDULE
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import Pace, landing_time, leg_times, takeoff_time, turn_times
from uavcover.model.outcome import Ending
from uavcover.model.vehicle import Vehicle

# Battery use of a flight: whether the charge lasts for the rest of the mission, or only for the return.


@dataclass(slots=True)
class BatteryUse:
    """Battery use of a flight. Knows no clock: times are arguments."""

    vehicle: Vehicle  # with its endurance and reserve
    planned_each_s: float  # percent that a second in the air is planned to use
    # time in the air, and the charge at the first report after the climb; none before
    first: tuple[float, float] | None = None
    percent: float = math.nan  # its latest report
    aloft_s: float = 0.0  # time in the air by then

    def take(self, percent: float, *, aloft_s: float) -> None:
        """Take the battery's report at a time after take-off."""
        if self.first is None and aloft_s >= RESERVE.climb_s:
            self.first = aloft_s, percent
        self.percent, self.aloft_s = percent, aloft_s

    @property
    def each_s(self) -> float:
        """Percent of the battery for a second in the air: planned at first, measured once it reports any use."""
        if self.first is None or self.aloft_s - self.first[0] < RESERVE.measured_s or self.percent >= self.first[1]:
            return self.planned_each_s
        return (self.first[1] - self.percent) / (self.aloft_s - self.first[0])

    @property
    def spare(self) -> float:
        """Percent above the reserve."""
        return self.percent - RESERVE.rounding_percent - 100.0 * self.vehicle.reserve_fraction

    def lasts_home(self, seconds: float) -> bool:
        """Whether the return can still be begun a moment later."""
        return self.spare > RESERVE.use_home_ratio * self.each_s * (seconds + RESERVE.to_turn_s)

    def lasts_on(self, seconds: float) -> bool:
        """Whether so much more of the mission keeps the reserve."""
        return self.spare >= RESERVE.use_on_ratio * self.each_s * seconds

    def may_wait_s(self, seconds: float) -> float:
        """Time that it may hold before a rest of the mission; infinite while the battery reports nothing."""
        if math.isnan(self.percent):
            return math.inf
        return self.spare / self.each_s - RESERVE.use_on_ratio * seconds

    def allows_on(self, *, rest_s: float, home_s: float) -> bool:
        """Whether it may go on, with ``rest_s`` to the landing by the mission and ``home_s`` straight home."""
        return home_s + RESERVE.to_turn_s >= rest_s or self.lasts_home(home_s) or self.lasts_on(rest_s)


_TAKES_PHOTO = (Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE)
_WAITS = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)


@dataclass(frozen=True, slots=True)
class Timetable:
    """When a flight is planned to be where."""

    legs_m: dict[int, FloatArray]  # the leg to each place, by the index of its item: (2, 3) ENU
    begins_s: dict[int, float]  # when each leg is begun, by the index of its item, in seconds after take-off
    ends_s: dict[int, float]  # when each leg is ended
    total_s: float  # from take-off to landing

    def planned_s(self, index: int, place_m: FloatArray) -> float | None:
        """Planned time after take-off at a (3,) ENU position on the leg to an item; None without a leg."""
        leg = self.legs_m.get(index)
        if leg is None:
            return None
        along = leg[1] - leg[0]
        square = float(along @ along)
        fraction = 1.0 if square == 0.0 else min(1.0, max(0.0, float((place_m - leg[0]) @ along) / square))
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
    """Warn, before arming, of a battery that does not last for the mission above its reserve; it would fly home early."""
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
        self._home_s = None if needs is None else needs.way_home_s
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
        now_s, place_m = self._session.monitor.time_s, self._progress.place_m
        if now_s is None or place_m is None or now_s < self._next_s:
            return
        self._next_s = now_s + SCHEDULE.look_every_s
        index = self._plan.index_of(self._session.monitor.current_seq, self._session.autopilot)
        planned_s = None if self._table is None else self._table.planned_s(index, place_m)
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
        self._look_at_reserve(place_m, self.left_s)

    def must_go_home(self) -> str | None:
        """Reason to end the mission now for the battery's reserve; None while it may go on."""
        return self._must

    def _look_at_reserve(self, place_m: FloatArray, left_s: float) -> None:
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
            home_s = self._home_s(place_m)
        except UavcoverError:  # the ground below the return is not known
            return
        if not use.allows_on(rest_s=left_s, home_s=home_s):
            self._must = (
                f"{source} has {percent:.0f} % left and loses {60.0 * use.each_s:.1f} % per minute: the return takes "
                f"{home_s:.0f} s and the remaining mission {left_s:.0f} s, which would use the reserve of "
                f"{100.0 * vehicle.reserve_fraction:.0f} %; the vehicle returns now"
            )


class PhotoWatch:
    """Compares the photos that a vehicle reports with those that its mission takes on the planned route.

    A vehicle that has reported no photo at all is watched where photos are required, and otherwise not: its camera may have no
    feedback.
    """

    def __init__(self, session: Session, plan: FlightPlan, progress: MissionProgress) -> None:
        self._session, self._progress = session, progress
        items = plan.mission.items
        self._trigger_m = max(
            (item.params[0] for item in items if item.command == Command.DO_SET_CAM_TRIGG_DIST), default=0.0
        )
        self._at_waypoints = not self._trigger_m and any(item.command in _TAKES_PHOTO for item in items)
        self._taken = session.monitor.photos_taken
        self._begin()

    def _begin(self) -> None:
        """Count from here: a photo was reported, or the camera is off."""
        self._from_m: FloatArray | None = None
        self._last_m: FloatArray | None = None
        self._expected, self._flown_m, self._since_s = 0, 0.0, self._session.monitor.time_s
        self._reached = self._progress.reached_count

    def look(self) -> None:
        """Look once."""
        session = self._session
        taken, now_s, here_m = session.monitor.photos_taken, session.monitor.time_s, self._progress.place_m
        if here_m is None or now_s is None or not (self._trigger_m or self._at_waypoints):
            return
        if taken != self._taken:
            self._taken = taken
            self._begin()
        elif self._at_waypoints or (session.on_mission and self._progress.heading_for > 0):
            self._count(here_m)
        else:
            self._from_m = self._last_m = None  # between the legs of the route the camera is off
        watched = taken is not None or session.photos_required
        missing = self._expected if watched and self._expected >= self._enough else None
        lasts_s = now_s - (now_s if self._since_s is None else self._since_s)
        session.watch.measure(
            Ending.PHOTOS_MISSING, missing,
            f"the camera has reported no photo for {self._flown_m:.0f} m ({lasts_s:.0f} s); expected photos: {self._expected}",
            "the camera reports photos again",
        )  # fmt: skip

    @property
    def _enough(self) -> float:
        link = self._session.client.statistics
        lost = link.lost / max(1, link.lost + link.frames_in)
        if lost >= 1.0:
            return math.inf
        return (
            max(SCHEDULE.fewest_photos, math.ceil(math.log(SCHEDULE.by_chance) / math.log(lost)))
            if lost > 0.0
            else SCHEDULE.fewest_photos
        )

    def _count(self, here_m: FloatArray) -> None:
        if self._last_m is not None:
            self._flown_m += float(np.linalg.norm(here_m - self._last_m))
        self._last_m = here_m
        if self._at_waypoints:
            self._expected = self._progress.reached_count - self._reached
        elif self._from_m is None:
            self._from_m = here_m
        elif (away_m := math.dist(here_m[:2], self._from_m[:2])) >= self._trigger_m:
            self._expected += int(away_m / self._trigger_m)
            self._from_m = here_m
