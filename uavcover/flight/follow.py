"""Follows a vehicle along its mission until it has landed and disarmed."""

import math
from collections.abc import Callable

from mission_io.model.items import Command
from mission_io.wire import messages as m
from uavcover.flight.arming import hold_mode
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.follower import Follower
from uavcover.flight.mission_guard import MissionGuard, VolumeWatch
from uavcover.flight.modes import Mode
from uavcover.flight.precautions import OnBreach, reaction
from uavcover.flight.preconditions import Preconditions
from uavcover.flight.progress import MissionProgress
from uavcover.flight.schedule import FlightSchedule, PhotoWatch
from uavcover.flight.session import Session, Stopped, Timer
from uavcover.flight.tuning import FALL, FOLLOWING
from uavcover.model.outcome import Ending, EventKind, FlightFaultError

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
        self._seen: m.GlobalPositionInt | None = None
        self._fast = 0
        self._leans_since_s: float | None = None
        self._from_m = self._fastest_m_s = 0.0
        self._hit_m_s: float | None = None
        self._still_since_s: float | None = None
        self._aloft = False

    def look(self) -> None:
        """Look once. Raises FlightFaultError: the vehicle has crashed."""
        here = self._session.monitor.latest(m.GlobalPositionInt)
        if here is None or here is self._seen:
            return
        before, self._seen = self._seen, here
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
        if not still or not self._aloft:
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
        """Whether the vehicle may be on the ground: it lands, reports a landing, or its mode is unknown."""
        monitor, plan = self._session.monitor, self._plan
        if plan is None or monitor.ground.says_landed or not self._session.on_mission:
            return True
        index = plan.index_of(monitor.current_seq, self._session.autopilot)
        items = plan.mission.items
        return not 0 <= index < len(items) or items[index].command in _LANDINGS or index == 0

    def _crashed(self, how: str) -> None:
        session, here = self._session, self._seen
        place = "" if here is None else f" at {here.lat_deg:.6f}, {here.lon_deg:.6f}"
        text = (
            f"the vehicle {how} on the ground{place}; it is armed and its motors may start, so keep "
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


_CHANGES = (Ending.MISSION_CHANGED, Ending.HOME_MOVED, Ending.SETTINGS_CHANGED, Ending.FENCE_CHANGED)
_LASTING = (
    *_CHANGES,
    Ending.WIND_ABOVE_LIMITS,
    Ending.OFF_ROUTE,
    Ending.FENCE_BREACHED,
    Ending.RESERVE_USED,
)


def follow_mission(
    session: Session,  # with the vehicle
    plan: FlightPlan,  # what it flies
    progress: MissionProgress,  # along it
    # why it must end its mission now, as text; None takes the plan's own battery and endurance
    must_go_home: Callable[[], str | None] | None = None,
    # what was checked before arming, to be watched; None watches nothing of it
    preconditions: Preconditions | None = None,
) -> None:
    """Listen until the vehicle has flown the mission, landed and disarmed; the user may pause it meanwhile.

    Raises:
        FlightFaultError: it did not; the ending says why.
        Stopped: the user asked to stop while the vehicle obeyed, or it must go home before the end.
    """
    schedule, photos = FlightSchedule(session, plan, progress), PhotoWatch(session, plan, progress)
    must_go_home = schedule.must_go_home if must_go_home is None else must_go_home
    places, falls = VolumeWatch(session, plan.volume, progress), FallWatch(session, plan)
    stuck_s = session.timeouts.stuck_s + longest_wait_s(plan)
    follower = Follower(session, stuck_s, stops_before=0, pause=session.pause, progress=progress)

    def meanwhile() -> None:
        progress.update()
        if not session.monitor.on_ground:
            falls.look()
            places.look(on_route=follower.in_mission or follower.holds)

    guard = MissionGuard(session, plan, progress, meanwhile)

    def look() -> None:
        aloft = not session.monitor.on_ground and not session.watch.is_open(Ending.FALLING)
        if preconditions is not None and session.monitor.on_ground is False:
            preconditions.look(meanwhile)  # first: what changed here is the cause of what the others see
        if aloft and follower.in_mission:
            guard.look()
        elif aloft and follower.holds:
            guard.look_at_place()
        meanwhile()
        photos.look()
        if aloft and follower.is_ours:
            schedule.look()
        elif aloft:
            session.watch.rest()  # no reports against the plan while a pilot or a failsafe has the vehicle
        follower.react()
        returns = (
            reaction(Ending.RESERVE_KEPT, follower.phase, simulated=session.simulated, chosen=None) is OnBreach.RETURN
        )
        ours_aloft = follower.is_ours and session.monitor.on_ground is False
        if ours_aloft and returns and (why := must_go_home()) is not None:
            session.tell(EventKind.STOP, why)
            raise Stopped(Ending.RESERVE_KEPT)

    while session.client.vehicle.armed:
        follower.step(look)
    follower.settle()
    progress.update()
    guard.look_once_more()
    if preconditions is not None:
        preconditions.look_once_more()
    _judge(session, plan, progress, follower)
    session.tell(EventKind.STAGE, "disarmed")


def follow_home(
    session: Session, *, stops_before: int, plan: FlightPlan | None = None, preconditions: Preconditions | None = None
) -> None:
    """Listen until the vehicle has flown its return, landed and disarmed.

    Args:
        session: with the vehicle.
        stops_before: how many stops of the user are known already.
        plan: of the return, to be read back while it is flown; None reads nothing.
        preconditions: what was checked before arming, to be watched on.

    Raises:
        FlightFaultError: it is gone, stuck, on the ground and does not disarm, or flew home with a change of another station.
        Stopped: the user asked once more, or the return has to be planned again: the cause says why.
    """
    watch, known = session.watch, session.watch.open_kinds
    follower = Follower(
        session, session.timeouts.stuck_s, stops_before=stops_before, pause=lambda: False, progress=None
    )
    progress = None if plan is None else MissionProgress(session, plan)
    guard = None if plan is None or progress is None else MissionGuard(session, plan, progress, lambda: None)

    def look() -> None:
        if session.monitor.on_ground is not False or watch.is_open(Ending.FALLING):
            return
        if preconditions is not None:
            preconditions.look(lambda: None)
        if progress is not None and guard is not None and follower.in_mission:
            progress.update()
            guard.look()
        follower.react()

    fallen = _follow_to_the_ground(session, follower, look)
    if fallen is not None:
        raise FlightFaultError(Ending.CRASHED, f"{fallen} on its return{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(
            follower.cause, f"{follower.why}; the vehicle landed and disarmed without completing its return"
        )
    if guard is not None:
        guard.look_once_more()
    for kind in _CHANGES:
        if watch.is_open(kind) and kind not in known:
            raise FlightFaultError(kind, f"{watch.text_of(kind)}; the vehicle returned, landed and disarmed")
    session.tell(EventKind.STAGE, "disarmed")


def _follow_to_the_ground(
    session: Session, follower: Follower, meanwhile: Callable[[], None] = lambda: None
) -> str | None:
    """Listen until the vehicle is disarmed; how it fell, or None when it has landed."""
    falls = FallWatch(session, None)

    def look() -> None:
        if not session.monitor.on_ground:
            falls.look()
        meanwhile()

    while session.client.vehicle.armed:
        follower.step(look)
    follower.settle()
    return _fallen(session, follower)


def follow_taken(session: Session) -> None:
    """Record a vehicle that something else has, or that answers no command, until it is on the ground.

    Raises:
        FlightFaultError: its cause, once the vehicle is on the ground and disarmed; the vehicle is gone, or holds on in a mode
            of ours.
        Stopped: the user asked once more, and the vehicle is in a mode of ours.
    """
    follower = Follower(
        session, session.timeouts.stuck_s, stops_before=session.stop(), pause=lambda: False, progress=None,
        ours=(Mode.MISSION, Mode.HOLD, hold_mode(session)),
    )  # fmt: skip
    fallen = _follow_to_the_ground(session, follower)
    if fallen is not None:
        raise FlightFaultError(Ending.CRASHED, f"{fallen}{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(follower.cause, f"{follower.why}; the vehicle landed and disarmed")
    session.tell(EventKind.STAGE, "disarmed")


def _judge(session: Session, plan: FlightPlan, progress: MissionProgress, follower: Follower) -> None:
    """Whether a flight that is over was the planned one. Raises FlightFaultError: it was not."""
    watch = session.watch
    flown = f"{progress.reached_count} of {plan.waypoint_count} planned waypoints"
    fallen = _fallen(session, follower)
    if fallen is not None:
        before = [follower.cause] if follower.cause is not None else []
        before += [kind for kind in _LASTING if watch.is_open(kind)]
        why = ""
        if before:
            why = f"; before, {follower.why if follower.cause is not None else watch.text_of(before[0])}"
        raise FlightFaultError(Ending.CRASHED, f"{fallen} after {flown}{why}{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(follower.cause, f"{follower.why}; the vehicle landed and disarmed after {flown}")
    how = "the vehicle landed and disarmed"
    for kind in _LASTING:
        if watch.is_open(kind):
            raise FlightFaultError(kind, f"{watch.text_of(kind)}; {how} after {flown}")
    cause = watch.recent_cause(within_s=10.0)
    if cause is not None and cause.kind is Ending.CRASHED:
        raise FlightFaultError(Ending.CRASHED, f"{how} after {flown}{session.recent_warnings}")
    if progress.all_reached:
        return
    lasting = next((kind for kind in (Ending.GPS_LOST, Ending.POSITION_LOST) if watch.is_open(kind)), None)
    if lasting is not None:
        raise FlightFaultError(lasting, f"{watch.text_of(lasting)}; {how} after {flown}")
    raise FlightFaultError(
        Ending.ENDED_EARLY,
        f"the vehicle landed and disarmed after {flown}, in {session.mode_name}{follower.unseen}{session.recent_warnings}",
    )


def _fallen(session: Session, follower: Follower) -> str | None:
    """The way in which the disarmed vehicle came down without motors; None when it has landed.

    It is listened to until it lies still.
    """
    monitor, timer = session.monitor, Timer(session, FOLLOWING.comes_to_rest_s)
    began_s = session.client.clock.now()
    while not (monitor.on_ground or timer.over or session.client.clock.now() - began_s > FOLLOWING.comes_to_rest_s):
        session.listen(FOLLOWING.look_s)
        settled = monitor.ground.is_still(monitor.time_s) and monitor.ground.says_landed is not False
        if settled:
            break
    fall = monitor.ground.fall(follower.last_armed_s, monitor.time_s)
    if fall is not None:
        return f"disarmed {fall}"
    return "disarmed in the air" if monitor.on_ground is False else None


def longest_wait_s(plan: FlightPlan) -> float:
    """Longest time that an item of the mission lets the vehicle stay in one position."""
    waiting = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)
    return max((i.params[0] for i in plan.mission.items if i.command in waiting and i.params[0] > 0.0), default=0.0)
