"""Follows a vehicle along its mission until it has landed and disarmed."""

import math
from collections.abc import Callable, Sequence

from mission_io.errors import CommandRefusedError
from mission_io.model.items import Command
from mission_io.wire import messages as m
from uavcover.vehicle.arming import continue_mission, hold_mode, send_disarm, set_mode
from uavcover.vehicle.flight_plan import FlightPlan
from uavcover.vehicle.mission_guard import MissionGuard, ModeOverride, VolumeWatch
from uavcover.vehicle.modes import Mode
from uavcover.vehicle.outcome import Ending, EventKind, FlightFaultError
from uavcover.vehicle.precautions import BREACHES, OnBreach
from uavcover.vehicle.preconditions import Preconditions
from uavcover.vehicle.progress import MissionProgress
from uavcover.vehicle.session import Session, Stopped, Timer

_MOVED_M = 2.0
_METRES_PER_DEGREE = 111_320.0
_GOING_ON_S = 2.0
"""After a pause the vehicle may still report for a moment that its mission is paused."""
_LASTING = (
    Ending.MISSION_CHANGED,
    Ending.HOME_MOVED,
    Ending.SETTINGS_CHANGED,
    Ending.FENCE_CHANGED,
    Ending.WIND_ABOVE_LIMITS,
    Ending.OFF_ROUTE,
    Ending.FENCE_BREACHED,
)
_COMES_TO_REST_S = 10.0
"""Time to wait for a disarmed vehicle to come to rest; one that has landed is at rest at once."""
_LOOK_S = 0.1


def follow_mission(
    session: Session,
    plan: FlightPlan,
    progress: MissionProgress,
    must_go_home: Callable[[], str | None] = lambda: None,
    preconditions: Preconditions | None = None,
) -> None:
    """Listen until the vehicle has flown the mission, landed and disarmed; the user may pause it meanwhile.

    Raises:
        FlightFaultError: it did not; the ending says why.
        Stopped: the user asked to stop while the vehicle did what it was told, or it ``must_go_home`` before the end.
    """
    places = VolumeWatch(session, plan.volume, progress)

    def meanwhile() -> None:
        progress.update()
        if not session.monitor.on_ground:
            places.look(in_mission=follower.in_mission)

    guard = MissionGuard(session, plan, progress, meanwhile)
    stuck_s = session.timeouts.stuck_s + longest_wait_s(plan)
    follower = _Follower(session, stuck_s, stops_before=0, pause=session.pause)
    session.watch.take_begun()

    def look() -> None:
        if follower.in_mission and not session.monitor.on_ground:
            guard.look()
        meanwhile()
        if preconditions is not None and session.monitor.on_ground is False:
            preconditions.look(meanwhile)
        follower.react(session.watch.take_begun())
        if follower.cause is None and session.monitor.on_ground is False and (why := must_go_home()) is not None:
            session.tell(EventKind.STOP, why)
            raise Stopped(Ending.RESERVE_KEPT)

    while session.client.vehicle.armed:
        follower.step(look)
    follower.settle()
    progress.update()
    guard.look_once_more()
    _judge(session, plan, progress, follower)
    session.tell(EventKind.STAGE, "disarmed")


def follow_home(session: Session, *, stops_before: int, longest_wait_s: float) -> None:
    """Listen until the vehicle has flown its way home, landed and disarmed.

    Raises:
        FlightFaultError: it is gone, stuck, or on the ground and does not disarm.
        Stopped: the user asked once more.
    """
    stuck_s = session.timeouts.stuck_s + longest_wait_s
    follower = _Follower(session, stuck_s, stops_before=stops_before, pause=lambda: False)
    while session.client.vehicle.armed:
        follower.step(lambda: None)
    follower.settle()
    fallen = _fallen(session, follower)
    if fallen is not None:
        raise FlightFaultError(Ending.CRASHED, f"{fallen} on its way home{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(
            follower.cause, "the vehicle did not fly its way home to the end; it has landed and disarmed"
        )
    session.tell(EventKind.STAGE, "disarmed")


def _judge(session: Session, plan: FlightPlan, progress: MissionProgress, follower: "_Follower") -> None:
    """Whether a flight that is over was the planned one.

    Raises:
        FlightFaultError: it was not.
    """
    watch = session.watch
    flown = f"{progress.reached_count} of {plan.waypoint_count} planned waypoints"
    fallen = _fallen(session, follower)
    if fallen is not None:
        before = [follower.cause] if follower.cause is not None else []
        before += [kind for kind in _LASTING if watch.is_open(kind)]
        why = f"; before, {watch.text_of(before[0])}" if before else ""
        raise FlightFaultError(Ending.CRASHED, f"{fallen} after {flown}{why}{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(follower.cause, f"{watch.text_of(follower.cause)}; it landed and disarmed after {flown}")
    how = "it landed and disarmed"
    for kind in _LASTING:
        if watch.is_open(kind):
            raise FlightFaultError(kind, f"{watch.text_of(kind)}; {how} after {flown}")
    cause = watch.recent_cause(within_s=10.0)
    if cause is not None and cause[0] is Ending.CRASHED:
        raise FlightFaultError(Ending.CRASHED, f"{how} after {flown}{session.recent_warnings}")
    if progress.all_reached:
        return
    lasting = next((kind for kind in (Ending.GPS_LOST, Ending.POSITION_LOST) if watch.is_open(kind)), None)
    if lasting is not None:
        raise FlightFaultError(lasting, f"{watch.text_of(lasting)}; {how} after {flown}")
    raise FlightFaultError(
        Ending.ENDED_EARLY,
        f"the vehicle landed and disarmed after {flown}, in {session.mode_name}{session.recent_warnings}",
    )


def _fallen(session: Session, follower: "_Follower") -> str | None:
    """How the vehicle, which is disarmed now, came down without motors; None when it has landed.

    It is listened to until it lies still.
    """
    monitor, timer = session.monitor, Timer(session, _COMES_TO_REST_S)
    began_s = session.client.clock.now()
    while not (monitor.on_ground or timer.over or session.client.clock.now() - began_s > _COMES_TO_REST_S):
        session.listen(_LOOK_S)
        settled = monitor.ground.is_still(monitor.time_s) and monitor.ground.says_landed is not False
        if settled:
            break
    fall = monitor.ground.fall(follower.last_armed_s, monitor.time_s)
    if fall is not None:
        return f"disarmed {fall}"
    return "disarmed in the air" if monitor.on_ground is False else None


class _Follower:
    """What following checks all the time, whatever is flown.

    Args:
        session: with the vehicle.
        stuck_s: time without progress in its mission.
        stops_before: how many stops of the user are known already.
        pause: whether the vehicle is to wait now.

    Attributes:
        last_armed_s: vehicle time when it was last known to be armed.
    """

    def __init__(self, session: Session, stuck_s: float, *, stops_before: int, pause: Callable[[], bool]) -> None:
        self._session, self._stops_before, self._pause = session, stops_before, pause
        self._override = ModeOverride(session)
        self._stillness = Stillness(session, stuck_s)
        self._elsewhere = Stillness(session, session.timeouts.override_s)
        self._landed: Timer | None = None
        self._told_to_disarm = self._record_goes_on = False
        self._holds = False
        self._upside_down = False
        self._held_for: Ending | None = None
        self._held_still = Stillness(session, session.timeouts.held_s)
        self._going_on: Timer | None = None
        self.last_armed_s = session.monitor.time_s

    @property
    def in_mission(self) -> bool:
        """Whether the vehicle flies its mission now."""
        return not self._override.begun and not self._holds

    @property
    def cause(self) -> Ending | None:
        """Why somebody else, a pilot or a failsafe, has the vehicle; None when nobody has."""
        return self._override.cause

    def settle(self) -> None:
        """Find the cause of what happened in the last moment."""
        self._override.settle()

    def step(self, look: Callable[[], None]) -> None:
        """Listen for a moment.

        Raises:
            FlightFaultError: the vehicle is gone, stuck, or stays armed.
            Stopped: the user asked once more.
        """
        session = self._session
        self.last_armed_s = session.monitor.time_s
        if (stops := session.stop()) > self._stops_before:
            self._end_at_users_wish(stops)
        self._pause_or_go_on()
        if self._going_on is not None and self._going_on.over:
            self._going_on, session.paused = None, self._holds
        session.pump()
        look()
        self._override.update({hold_mode(session)} if self._holds else {Mode.MISSION})
        if session.monitor.on_ground:
            self._wait_until_disarmed()
            return
        self._landed = None
        if self._override.begun:
            self._stillness.restart()
            if self._elsewhere.too_long and self.cause is not None:
                raise FlightFaultError(
                    self.cause,
                    f"{session.watch.text_of(self.cause)}; it has not moved for {self._elsewhere.timeout_s:g} s and is "
                    "left to whoever controls it",
                )
            return
        self._elsewhere.restart()
        if self._holds:
            self._stillness.restart()
            self._end_if_held_for_good()
        elif self._stillness.too_long:
            self._raise_stuck()

    def react(self, begun: Sequence[Ending]) -> None:
        """Do what the user wants done about what has begun to go wrong; nothing while somebody else has the vehicle.

        Raises:
            Stopped: the vehicle is to return.
        """
        session = self._session
        breach = next((kind for kind in begun if kind in BREACHES), None)
        if breach is None or not self.in_mission or session.monitor.on_ground is not False:
            return
        if session.on_breach is OnBreach.RETURN:
            raise Stopped(breach)
        if session.on_breach is OnBreach.TELL:
            return
        session.paused = True
        try:
            session.insist(lambda: set_mode(session, hold_mode(session)))
        except CommandRefusedError as error:
            session.paused = False
            session.tell(EventKind.WARNING, f"the vehicle refuses to hold: {error}", alarm=True)
            return
        self._holds, self._held_for, self._upside_down = True, breach, not self._pause()
        self._held_still.restart()
        session.tell(
            EventKind.STOP,
            f"the vehicle therefore holds its place in {session.mode_name}: p continues, Ctrl-C flies it home",
        )

    def _end_if_held_for_good(self) -> None:
        if self._held_for is not None and self._held_still.too_long:
            raise FlightFaultError(
                self._held_for,
                f"{self._session.watch.text_of(self._held_for)}; it has held its place for "
                f"{self._held_still.timeout_s:g} s and nobody continued: left holding; fly --resume continues",
            )

    def _end_at_users_wish(self, stops: int) -> None:
        """Home, unless somebody else has the vehicle: then the first stop is told, and the second ends the record."""
        self._override.settle()
        if self.cause is None:
            raise Stopped
        if self._record_goes_on or stops > self._stops_before + 1:
            raise FlightFaultError(
                self.cause,
                f"{self._session.watch.text_of(self.cause)}; stopped following: the vehicle is left to whoever controls it",
            )
        self._record_goes_on, self._stops_before = True, stops
        self._session.tell(
            EventKind.STOP,
            "somebody else has the vehicle, so nothing is asked of it; the record goes on until it is on the ground; once more "
            "ends the record",
        )

    def _pause_or_go_on(self) -> None:
        session = self._session
        wanted = self._pause() is not self._upside_down  # a key that was pressed before a breach does not end its hold
        if wanted == self._holds or self._override.begun or session.monitor.on_ground is not False:
            return
        if wanted:
            session.paused = True
            session.insist(lambda: set_mode(session, hold_mode(session)))
            session.tell(EventKind.STOP, f"paused: the vehicle holds its place in {session.mode_name}")
        else:
            continue_mission(session)
            session.tell(EventKind.STOP, "the vehicle goes on with its mission")
            self._going_on = Timer(session, _GOING_ON_S)
            self._held_for = None
        self._holds = wanted

    def _raise_stuck(self) -> None:
        session = self._session
        cause = session.watch.recent_cause(within_s=self._stillness.timeout_s)
        windy = cause is not None and cause[0] is Ending.WIND_ABOVE_LIMITS
        text = (
            f"the vehicle is stuck: no progress at item {session.monitor.current_seq} "
            f"for {self._stillness.timeout_s:g} s{session.recent_warnings}"
        )
        raise FlightFaultError(Ending.WIND_ABOVE_LIMITS if windy else Ending.STUCK, text)

    def _wait_until_disarmed(self) -> None:
        session = self._session
        if session.watch.is_open(Ending.HEARTBEAT_LOST):
            raise FlightFaultError(
                Ending.HEARTBEAT_LOST,
                f"{session.watch.text_of(Ending.HEARTBEAT_LOST)}; it is on the ground and may be armed: keep away",
            )
        if self._landed is None:
            self._landed = Timer(session, session.timeouts.disarm_s)
            session.tell(EventKind.STAGE, "on the ground")
        elif self._landed.over:
            if self.cause is Ending.PILOT_TOOK_OVER:
                raise FlightFaultError(
                    self.cause,
                    f"{session.watch.text_of(self.cause)}; it is on the ground and stays armed: left to whoever controls it",
                )
            if self._told_to_disarm:
                raise FlightFaultError(
                    Ending.STAYED_ARMED, f"the vehicle has landed but stays armed{session.recent_warnings}"
                )
            self._told_to_disarm = True
            send_disarm(session)
            self._landed.restart()


class Stillness:
    """Detects that a vehicle neither moves nor continues to another item."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self._session = session
        self._timer = Timer(session, timeout_s)
        self._seen: tuple[int, float, float, float] | None = None

    def restart(self) -> None:
        """Begin anew."""
        self._seen = None
        self._timer.restart()

    @property
    def too_long(self) -> bool:
        """Whether nothing changed for ``timeout_s``."""
        monitor = self._session.monitor
        position = monitor.latest(m.GlobalPositionInt)
        if position is None:
            return self._timer.over
        north = position.lat_deg * _METRES_PER_DEGREE
        east = position.lon_deg * _METRES_PER_DEGREE * math.cos(math.radians(position.lat_deg))
        now = (monitor.current_seq, east, north, position.alt_amsl_m)
        if self._seen is None or self._seen[0] != now[0] or math.dist(self._seen[1:], now[1:]) > _MOVED_M:
            self._seen = now
            self._timer.restart()
        return self._timer.over


def longest_wait_s(plan: FlightPlan) -> float:
    """Longest time that an item of the mission lets the vehicle stay in one place."""
    waiting = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)
    return max((i.params[0] for i in plan.mission.items if i.command in waiting and i.params[0] > 0.0), default=0.0)
