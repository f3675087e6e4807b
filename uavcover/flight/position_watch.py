"""Watch in flight whether home was moved, and whether the vehicle holds its position, falls, and takes its photos.

Heights of a mission are above home. ArduPilot lays a leg out when it begins, so that a new home counts from the next item on; PX4
moves the leg that is being flown.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.items import Command, GeoPoint, ground_distance_m
from mission_io.wire import messages as m
from uavcover.flight.orders import PREPARATION, FlightPlan
from uavcover.flight.progress import SCHEDULE, MissionProgress
from uavcover.flight.session import FOLLOWING, Session, Timer
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import Ending, FlightFaultError
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fall:
    least_fall_m_s: float
    fall_ratio: float
    lean_deg: float
    tumbles_s: float
    still_m_s: float
    near_m: float
    lies_m: float
    aloft_m: float
    lies_s: float
    hit_still_s: float


FALL = data_table(_Fall, "uavcover/data/flight.toml", "fall")


class HomeWatch:
    """Home and the origin of the position filter, compared with what they were before arming, or at the take-off.

    Args:
        session: with the vehicle.
        plan: what it is to fly.
        px4: whether it is one; else ArduPilot.

    Attributes:
        moved_up_m: rise of home since its check; 0 within a barometer's error.
    """

    def __init__(self, session: Session, plan: FlightPlan, *, px4: bool) -> None:
        self._session, self._plan, self._px4 = session, plan, px4
        self._checked = [] if (home := session.monitor.latest(m.HomePosition)) is None else [_point(home)]
        here = session.monitor.latest(m.GlobalPositionInt)
        if here is not None and session.monitor.on_ground is not False:
            self._checked.append(GeoPoint(here.lat_deg, here.lon_deg, here.alt_amsl_m))  # arming sets home there
        self._origin = self._judged_origin = session.monitor.latest(m.GpsGlobalOrigin)
        self._origin_moved_m = 0.0
        self._judged: m.HomePosition | None = None
        self._begun = self._settled = False
        self._amount: float | None = None
        self._text = ""
        self.moved_up_m = 0.0

    def look(self) -> None:
        """Compare the latest of both, and report a move."""
        if not self._begun:  # both autopilots set home anew at arming or take-off: wait for one that is fresh
            self._begun = True
            self._session.monitor.forget(m.HomePosition)
        home = self._session.monitor.latest(m.HomePosition)
        if home is not None and home != self._judged:
            self._judged = home
            self._amount, self._text = self._judge(_point(home))
        origin = self._session.monitor.latest(m.GpsGlobalOrigin)
        if origin is not None and origin != self._judged_origin:
            self._judged_origin = origin
            self._origin = origin if self._origin is None else self._origin
            self._origin_moved_m = math.dist((0.0, 0.0, 0.0), _offset_m(_point(self._origin), _point(origin)))
        moved_m = self._origin_moved_m
        amount, text = self._amount, self._text
        if amount is None and moved_m > PREPARATION.home_slack_m:
            amount = moved_m
            text = f"the vehicle's local origin for heights and positions was moved by {moved_m:.1f} m in flight"
        watch = self._session.watch
        if amount is not None:
            watch.measure(Ending.HOME_MOVED, amount, text, "")
        elif watch.is_open(Ending.HOME_MOVED):
            left = [incident.text for incident in watch.incidents if incident.kind is Ending.BAND_LEFT]
            if left:  # what was flown meanwhile was not as planned, and stays so
                was = f"the vehicle's home was moved in flight and later restored; meanwhile {left[-1]}"
                watch.open(Ending.HOME_MOVED, was, math.inf)
            else:
                watch.measure(Ending.HOME_MOVED, None, "", "the vehicle's home was restored")

    def _judge(self, home: GeoPoint) -> tuple[float | None, str]:
        """By how much home was moved, and what comes of it; None for what arming alone explains."""
        offsets = [_offset_m(position, home) for position in self._checked] or [_offset_m(self._plan.home, home)]
        east, north, up = min(offsets, key=lambda offset: math.dist((0.0, 0.0, 0.0), offset))
        aside_m = math.hypot(east, north)
        self.moved_up_m = up if abs(up) > PREPARATION.home_slack_m else 0.0
        if abs(up) <= PREPARATION.home_slack_m and aside_m <= FOLLOWING.aside_m:
            if not self._settled:  # the home of this flight, from which a move counts
                self._checked, self._settled = [home], True
            return None, ""
        parts = [f"{abs(up):.1f} m {'higher' if up > 0.0 else 'lower'}"] if abs(up) > PREPARATION.home_slack_m else []
        parts += [f"{aside_m:.0f} m aside"] if aside_m > FOLLOWING.aside_m else []
        text = f"the vehicle's home was moved {' and '.join(parts)} in flight"
        if abs(up) > PREPARATION.home_slack_m:
            text += f": {self._lowered_by(home.alt_amsl_m - self._plan.home.alt_amsl_m)}"
        if aside_m > FOLLOWING.aside_m:
            text += "; the autopilot's own return ends at the new home, along an unchecked path"
        if self._plan.is_return and abs(up) <= PREPARATION.home_slack_m:  # its items stand where they stood
            self._session.alarm(f"{text}; this does not affect the return")
            return None, ""
        return math.hypot(aside_m, up), text

    def _lowered_by(self, off_m: float) -> str:
        """Consequence for heights above home of another home altitude."""
        since = "immediately" if self._px4 else "from the next item onwards"
        side, flown = "higher" if off_m > 0.0 else "lower", "return" if self._plan.is_return else "mission"
        text = f"{since}, the vehicle flies the remaining {flown} {abs(off_m):.1f} m {side} than planned"
        heights_m, volume = self._rest_agl_m(), self._plan.volume
        if volume is None or not len(heights_m):
            return text
        low_m, high_m = float(heights_m.min()), float(heights_m.max())
        what, was_m, limit = "maximum height", high_m, f"{volume.max_height_agl_m:g} m is allowed"
        if off_m < 0.0:
            what, was_m, limit = "clearance", low_m, f"{volume.min_height_agl_m:g} m is required"
        text = f"{text}, and its {what} above the ground changes from {was_m:.1f} m to {was_m + off_m:.1f} m"
        return text if self._plan.is_return else f"{text}, where {limit}"  # the band is that of the route

    def _rest_agl_m(self) -> FloatArray:
        """Planned heights above the ground along the legs that are left, those of planned waypoints where there are any."""
        plan, session = self._plan, self._session
        if plan.volume is None:
            return np.array([])
        legs_m = rest_of_legs(plan, session)
        spacing = max(5.0, sum(float(np.linalg.norm(leg[1] - leg[0])) for leg in legs_m) / FOLLOWING.home_samples)
        heights = []
        for leg in legs_m:
            count = max(2, math.ceil(float(np.linalg.norm(leg[1] - leg[0])) / spacing) + 1)
            for fraction in np.linspace(0.0, 1.0, count):
                east, north, up = (leg[0] + fraction * (leg[1] - leg[0])).tolist()
                heights.append(up - plan.volume.ground_up_m(east, north))
        return np.array([height for height in heights if math.isfinite(height)])


def rest_of_legs(plan: FlightPlan, session: Session) -> list[FloatArray]:
    """(2, 3) ENU each, the legs between waypoints from the current one on; transits only if none is left."""
    current = plan.index_of(session.monitor.current_seq, session.autopilot)
    legs = {
        index: leg
        for index, leg in plan.legs_m().items()
        if index >= current and plan.mission.items[index].command == Command.NAV_WAYPOINT
    }
    wire = 1 if session.autopilot.home_in_item_0 else 0
    planned = [leg for index, leg in legs.items() if plan.waypoint_of(index + wire, session.autopilot) > 0]
    return planned or list(legs.values())


def _point(message: m.HomePosition | m.GpsGlobalOrigin) -> GeoPoint:
    return GeoPoint(message.lat_deg, message.lon_deg, message.alt_amsl_m)


def _offset_m(of: GeoPoint, position: GeoPoint) -> tuple[float, float, float]:
    """East, north and up from one position to another."""
    frame = LocalFrame(of.lat_deg, of.lon_deg, of.alt_amsl_m)
    east, north, up = frame.enu_from_geodetic(position.lat_deg, position.lon_deg, position.alt_amsl_m)[0].tolist()
    return east, north, up


_TRANSIENT = frozenset(
    {Ending.BAND_LEFT, Ending.FENCE_BREACHED, Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS, Ending.GROUND_UNKNOWN}
)
"""Breaches that can end by themselves. A changed mission does not change back."""


class HoldState(Enum):
    """State of a hold."""

    HOLDS = "the hold continues"
    OVER = "the reason for the hold is gone: the mission may continue"
    OVERDUE = "the hold has reached its time limit"
    LOST = "the vehicle does not hold its position"


class HoldWatch:
    """One hold.

    Args:
        session: with the vehicle.
        purpose: the breach that it is for; None for the user's pause, which ends with the user's word.
        may_go_on: whether the mission may go on by itself once the breach is over.
    """

    def __init__(self, session: Session, purpose: Ending | None, *, may_go_on: bool) -> None:
        self.purpose = purpose
        self._session = session
        self._may_go_on = may_go_on and purpose in _TRANSIENT
        self._rest = Timer(session, FOLLOWING.comes_to_rest_s)
        self._deadline = Timer(session, session.timeouts.held_s)
        self._calm: Timer | None = None
        self._position: m.GlobalPositionInt | None = None

    def begin_again(self) -> None:
        """Hold at the next position of rest: a pilot may have moved the vehicle and given it back."""
        self._position = None
        self._rest.restart()

    def look(self) -> HoldState:
        """Judge it now."""
        if self._drifts():
            return HoldState.LOST
        if self.purpose is None:
            return HoldState.HOLDS
        if self._session.watch.is_open(self.purpose):
            self._calm = None
        elif self._calm is None:
            self._calm = Timer(self._session, FOLLOWING.calm_s)
        elif self._calm.over and self._may_go_on and self._position is not None:
            return HoldState.OVER
        return HoldState.OVERDUE if self._deadline.over else HoldState.HOLDS

    @property
    def drift_m(self) -> float:
        """Distance from the held position; 0 before the vehicle has come to rest."""
        here, position = self._session.monitor.latest(m.GlobalPositionInt), self._position
        if here is None or position is None:
            return 0.0
        level_m = ground_distance_m(position.lat_deg, position.lon_deg, here.lat_deg, here.lon_deg)
        return math.hypot(level_m, here.alt_amsl_m - position.alt_amsl_m)

    def _drifts(self) -> bool:
        watch = self._session.watch
        if self._position is None:
            if self._rest.over:
                self._position = self._session.monitor.latest(m.GlobalPositionInt)
            return False
        drift_m = self.drift_m
        watch.measure(
            Ending.HOLD_LOST, drift_m if drift_m > FOLLOWING.drift_m else None,
            f"the vehicle has drifted {drift_m:.0f} m from its hold position",
            "the vehicle is back at its hold position",
        )  # fmt: skip
        return drift_m > FOLLOWING.drift_m


# Detect by motion alone that an armed vehicle falls, has hit something, or lies on the ground.
#
# A motor that fails, a propeller that is lost or a hillside ends a flight while the autopilot still reports that it flies.

_HIT_M_S2, _HIT_FROM_M_S, _STOPPED_M_S = 20.0, 4.0, 1.5
"""No multirotor brakes so hard: autopilots limit their acceleration to a few metres per second squared."""
_LANDINGS = (Command.NAV_LAND, Command.NAV_RETURN_TO_LAUNCH)


class FallWatch:
    """Looks at height, motion and attitude all the time while a vehicle is armed.

    Args:
        session: with the vehicle.
        plan: what it flies; None on its return.
    """

    def __init__(self, session: Session, plan: FlightPlan | None) -> None:
        self._session, self._plan = session, plan
        descent_m_s = (None if plan is None else plan.max_descent_m_s) or 3.0
        self._fall_m_s = max(FALL.least_fall_m_s, FALL.fall_ratio * descent_m_s)
        self._observed: m.GlobalPositionInt | None = None
        self._fast = 0
        self._leans_since_s: float | None = None
        self._from_m = self._fastest_m_s = 0.0
        self._hit_m_s: float | None = None
        self._still_since_s: float | None = None
        self._aloft = False

    def look(self) -> None:
        """Look once. Raises FlightFaultError: the vehicle has crashed."""
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None or here is self._observed:
            return
        before, self._observed = self._observed, here
        height_m = self._session.monitor.ground.height_m
        self._aloft = self._aloft or height_m > FALL.aloft_m
        if before is not None and here.time_boot_s > before.time_boot_s:
            self._look_for_hit(before, here)
        self._look_for_fall(here, height_m)
        self._look_whether_it_lies(here, height_m)

    def _look_for_fall(self, here: m.GlobalPositionInt, height_m: float) -> None:
        watch, lean_deg = self._session.watch, self._lean_deg()
        self._fast = self._fast + 1 if here.velocity_down_m_s > self._fall_m_s else 0
        if lean_deg <= FALL.lean_deg:
            self._leans_since_s = None
        elif self._leans_since_s is None:
            self._leans_since_s = here.time_boot_s
        tumbles = self._leans_since_s is not None and here.time_boot_s - self._leans_since_s >= FALL.tumbles_s
        falls = self._aloft and (self._fast > 1 or tumbles)
        if falls and not watch.is_open(Ending.FALLING):
            self._from_m, self._fastest_m_s = height_m, 0.0
        if falls:
            self._fastest_m_s = max(self._fastest_m_s, here.velocity_down_m_s)
        watch.measure(
            Ending.FALLING, max(1.0, here.velocity_down_m_s) if falls else None,
            f"the vehicle is falling: it descends at {here.velocity_down_m_s:.0f} m/s, {height_m:.0f} m above the "
            f"ground, and is tilted by {lean_deg:.0f} degrees",
            "the vehicle has stopped falling",
        )  # fmt: skip

    def _look_for_hit(self, before: m.GlobalPositionInt, here: m.GlobalPositionInt) -> None:
        change_m_s = math.dist(_velocity(before), _velocity(here))
        was_m_s, is_m_s = math.hypot(*_velocity(before)), math.hypot(*_velocity(here))
        hard = change_m_s / (here.time_boot_s - before.time_boot_s) > _HIT_M_S2
        if hard and was_m_s > _HIT_FROM_M_S and is_m_s < _STOPPED_M_S and self._aloft:
            self._hit_m_s = was_m_s
        elif is_m_s > _STOPPED_M_S:
            self._hit_m_s = None

    def _look_whether_it_lies(self, here: m.GlobalPositionInt, height_m: float) -> None:
        still = math.hypot(*_velocity(here)) < FALL.still_m_s
        reports_flying = self._session.monitor.ground.reports_landed is False
        if not still or not (self._aloft or reports_flying):
            self._still_since_s = None
            return
        if self._still_since_s is None:
            self._still_since_s = here.time_boot_s
        still_s = here.time_boot_s - self._still_since_s
        if self._session.watch.is_open(Ending.FALLING) and height_m < FALL.near_m and still_s >= 1.0:
            self._crashed(f"fell from {self._from_m:.0f} m at {self._fastest_m_s:.0f} m/s and is now")
        if self._hit_m_s is not None and height_m < FALL.near_m and still_s >= FALL.hit_still_s:
            self._crashed(f"stopped abruptly at {self._hit_m_s:.0f} m/s and is now")
        if height_m < FALL.lies_m and still_s >= FALL.lies_s and not self._may_stand():
            self._crashed("should be in the air but is")

    def _may_stand(self) -> bool:
        """Whether the vehicle may be on the ground: before take-off, it lands, reports so, or its mode is unknown."""
        monitor, plan = self._session.monitor, self._plan
        if plan is None or monitor.ground.reports_landed or not self._session.on_mission:
            return True
        index = plan.index_of(monitor.current_seq, self._session.autopilot)
        items = plan.mission.items
        waits = index == 0 and monitor.ground.reports_landed is None
        return not 0 <= index < len(items) or items[index].command in _LANDINGS or waits

    def _crashed(self, how: str) -> None:
        session, here = self._session, self._observed
        position = "" if here is None else f" at {here.lat_deg:.6f}, {here.lon_deg:.6f}"
        text = (
            f"the vehicle {how} on the ground{position}; it is armed and its motors may start, so keep "
            f"away{session.recent_warnings}"
        )
        session.watch.open(Ending.CRASHED, text)
        raise FlightFaultError(Ending.CRASHED, text)

    def _lean_deg(self) -> float:
        attitude = self._session.monitor.latest(m.Attitude)
        if attitude is None:
            return 0.0
        tilt = math.cos(attitude.roll_rad) * math.cos(attitude.pitch_rad)
        return math.degrees(math.acos(max(-1.0, min(1.0, tilt))))


def _velocity(position: m.GlobalPositionInt) -> tuple[float, float, float]:
    return position.velocity_north_m_s, position.velocity_east_m_s, position.velocity_down_m_s


_TAKES_PHOTO = (Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE)


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
        taken, now_s, here_m = session.monitor.photos_taken, session.monitor.time_s, self._progress.position_m
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
