"""Follows a vehicle along its mission until it has landed and disarmed."""

import math
from collections.abc import Callable, Collection

from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.items import Command
from mission_io.wire import messages as m
from uavcover.vehicle.arming import continue_mission, hold_mode, send_disarm, set_mode
from uavcover.vehicle.fall_watch import FallWatch
from uavcover.vehicle.flight_plan import FlightPlan
from uavcover.vehicle.hold_watch import HoldState, HoldWatch
from uavcover.vehicle.mission_guard import MissionGuard, ModeOverride, VolumeWatch
from uavcover.vehicle.modes import Mode
from uavcover.vehicle.outcome import Ending, EventKind, FlightFaultError
from uavcover.vehicle.policy import Phase, policy, reaction
from uavcover.vehicle.precautions import OnBreach
from uavcover.vehicle.preconditions import Preconditions
from uavcover.vehicle.progress import MissionProgress
from uavcover.vehicle.schedule import Schedule
from uavcover.vehicle.session import Session, Stopped, TakenOverError, Timer

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
    Ending.RESERVE_USED,
)
_COMES_TO_REST_S = 10.0
"""Time to wait for a disarmed vehicle to come to rest; one that has landed is at rest at once."""
_LOOK_S = 0.1
_EVIDENCE_S = 10.0
"""Time to wait for evidence of how a flight ended that ended in a gap of the link."""
_MOST_HOLDS = 3
"""After as many holds for the same breach the mission is not continued by itself any more."""


def follow_mission(
    session: Session,
    plan: FlightPlan,
    progress: MissionProgress,
    must_go_home: Callable[[], str | None] | None = None,
    preconditions: Preconditions | None = None,
) -> None:
    """Listen until the vehicle has flown the mission, landed and disarmed; the user may pause it meanwhile.

    Args:
        session: with the vehicle.
        plan: what it flies.
        progress: along it.
        must_go_home: why it must end its mission now, as text; None takes the plan's own battery and endurance.
        preconditions: what was checked before arming, to be watched; None watches nothing of it.

    Raises:
        FlightFaultError: it did not; the ending says why.
        Stopped: the user asked to stop while the vehicle did what it was told, or it must go home before the end.
    """
    schedule = Schedule(session, plan, progress)
    must_go_home = schedule.must_go_home if must_go_home is None else must_go_home
    places, falls = VolumeWatch(session, plan.volume, progress), FallWatch(session, plan)
    stuck_s = session.timeouts.stuck_s + longest_wait_s(plan)
    follower = _Follower(session, stuck_s, stops_before=0, pause=session.pause, progress=progress)

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
        if aloft and follower.is_ours:
            schedule.look()
        elif aloft:
            session.watch.rest()  # what is measured against the plan is not told of a vehicle that something else has
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


def follow_home(session: Session, *, stops_before: int, longest_wait_s: float) -> None:
    """Listen until the vehicle has flown its way home, landed and disarmed.

    Raises:
        FlightFaultError: it is gone, stuck, or on the ground and does not disarm.
        Stopped: the user asked once more.
    """
    stuck_s = session.timeouts.stuck_s + longest_wait_s
    follower = _Follower(session, stuck_s, stops_before=stops_before, pause=lambda: False, progress=None)
    falls = FallWatch(session, None)

    def look() -> None:
        if not session.monitor.on_ground:
            falls.look()

    while session.client.vehicle.armed:
        follower.step(look)
    follower.settle()
    fallen = _fallen(session, follower)
    if fallen is not None:
        raise FlightFaultError(Ending.CRASHED, f"{fallen} on its way home{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(
            follower.cause, f"{follower.why}; it did not fly its way home to the end, and it landed and disarmed"
        )
    session.tell(EventKind.STAGE, "disarmed")


def follow_taken(session: Session) -> None:
    """Record a vehicle that something else has, or that answers no command, until it is on the ground.

    Raises:
        FlightFaultError: its cause, once the vehicle is on the ground and disarmed; the vehicle is gone, or holds on in a mode
            of ours.
        Stopped: the user asked once more, and the vehicle is in a mode of ours.
    """
    follower = _Follower(
        session, session.timeouts.stuck_s, stops_before=session.stop(), pause=lambda: False, progress=None,
        ours=(Mode.MISSION, Mode.HOLD, hold_mode(session)),
    )  # fmt: skip
    falls = FallWatch(session, None)

    def look() -> None:
        if not session.monitor.on_ground:
            falls.look()

    while session.client.vehicle.armed:
        follower.step(look)
    follower.settle()
    fallen = _fallen(session, follower)
    if fallen is not None:
        raise FlightFaultError(Ending.CRASHED, f"{fallen}{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(follower.cause, f"{follower.why}; it landed and disarmed")
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
        why = ""
        if before:
            why = f"; before, {follower.why if follower.cause is not None else watch.text_of(before[0])}"
        raise FlightFaultError(Ending.CRASHED, f"{fallen} after {flown}{why}{session.recent_warnings}")
    if follower.cause is not None:
        raise FlightFaultError(follower.cause, f"{follower.why}; it landed and disarmed after {flown}")
    how = "it landed and disarmed"
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

    Nothing is commanded before current evidence shows that the vehicle does what we commanded last.

    Args:
        session: with the vehicle.
        stuck_s: time without progress in its mission.
        stops_before: how many stops of the user are known already.
        pause: whether the vehicle is to wait now.
        progress: along the planned waypoints; None on the way home.
        ours: the modes that were commanded where nothing is flown by it.

    Attributes:
        last_armed_s: vehicle time when it was last known to be armed.
    """

    def __init__(
        self,
        session: Session,
        stuck_s: float,
        *,
        stops_before: int,
        pause: Callable[[], bool],
        progress: MissionProgress | None,
        ours: Collection[Mode] = (Mode.MISSION,),
    ) -> None:
        self._session, self._stops_before, self._pause, self._progress = session, stops_before, pause, progress
        self._ours = ours
        self._known_until_s = session.monitor.gap_ended_at_s
        self._override = ModeOverride(session)
        self._stillness = Stillness(session, stuck_s)
        self._elsewhere = Stillness(session, session.timeouts.override_s)
        self._landed: Timer | None = None
        self._told_to_disarm = self._record_goes_on = self._told_to_wait = False
        self._hold: HoldWatch | None = None
        self._lands_for: Ending | None = None
        self._holds_for: dict[Ending, int] = {}
        self._acted_on: set[Ending] = set()
        self._upside_down = False
        self._declined: bool | None = None
        self._going_on: Timer | None = None
        self._mode_changes = session.monitor.mode_changes
        self.last_armed_s = session.monitor.time_s

    @property
    def holds(self) -> bool:
        """Whether the vehicle was told to hold, and holds."""
        return self._hold is not None and not self._override.begun

    @property
    def in_mission(self) -> bool:
        """Whether current evidence shows the vehicle in the mission that it was told to fly."""
        return self.is_ours and self._hold is None and self._lands_for is None

    @property
    def is_ours(self) -> bool:
        """Whether current evidence shows that the vehicle does what we commanded."""
        return not self._override.begun and self._session.obeys(self._commanded)

    @property
    def _commanded(self) -> Collection[Mode]:
        """The modes that were commanded last."""
        if self._lands_for is not None:
            return [Mode.LAND]
        return self._ours if self._hold is None else [hold_mode(self._session)]

    @property
    def phase(self) -> Phase:
        """The part of the flight, for the policy."""
        progress = self._progress
        if progress is None:
            return Phase.RETURN
        if self._hold is not None:
            return Phase.HOLD
        if progress.heading_for > 0:
            return Phase.ROUTE
        return Phase.INBOUND if progress.reached_count > 0 and progress.heading_for < 0 else Phase.OUTBOUND

    @property
    def cause(self) -> Ending | None:
        """Why something else, a pilot or a failsafe, has the vehicle; None when nothing has."""
        return self._override.cause

    @property
    def why(self) -> str:
        """What was told of the cause."""
        return self._override.text

    @property
    def unseen(self) -> str:
        """The gap in which the flight ended, as the end of a clause; empty where its end was seen."""
        monitor = self._session.monitor
        if monitor.gap_ended_at_s <= self._known_until_s:
            return ""
        return f"; what happened in the silence of {monitor.gap_s:.0f} s before that is not known"

    def settle(self) -> None:
        """Find the cause of what happened in the last moment, or in the gap before it."""
        session, timer = self._session, Timer(self._session, _EVIDENCE_S)
        in_a_gap = not session.evidence.current
        while not (session.evidence.current or timer.over or session.silence_s > session.timeouts.deadman_s):
            session.pump()  # a vehicle that is switched off after its landing is not waited for
        if in_a_gap and (self._progress is None or not self._progress.all_reached):
            self._look_at_mode()
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
        try:
            self._pause_or_go_on()
            if self._going_on is not None and self._going_on.over:
                self._going_on, session.paused = None, self._hold is not None
            session.pump()
            look()
            if self._hold is not None and self.is_ours and session.monitor.on_ground is not True:
                self._look_at_hold(self._hold)
        except TakenOverError as error:
            session.tell(EventKind.WARNING, str(error), alarm=True)
        if session.evidence.current:
            self._look_at_mode()
            if session.client.vehicle.armed:
                self._known_until_s = session.monitor.gap_ended_at_s
        if session.monitor.on_ground:
            self._wait_until_disarmed()
            return
        self._landed = None
        if self._override.begun:
            self._stillness.restart()
            if self._elsewhere.too_long and self.cause is not None:
                raise FlightFaultError(
                    self.cause,
                    f"{self.why}; it has not moved for {self._elsewhere.timeout_s:g} s and is "
                    "left to whoever controls it",
                )
            return
        self._elsewhere.restart()
        if self._hold is not None:
            self._stillness.restart()
        elif self._stillness.too_long:
            self._raise_stuck()

    def react(self) -> None:
        """Do what the policy says about what goes wrong, once for each breach; nothing while something else has the vehicle.

        Raises:
            Stopped: the vehicle is to return.
            TakenOverError: something else has just taken the vehicle over.
        """
        session, watch = self._session, self._session.watch
        self._acted_on &= watch.open_kinds
        falls = watch.is_open(Ending.FALLING)  # what follows from a fall is no breach of its own
        if falls or not self.in_mission or session.monitor.on_ground is not False or self._going_on is not None:
            return
        beat_s = session.monitor.arrived_at_s(m.Heartbeat)
        for breach, phase in policy():
            is_new = watch.is_open(breach) and breach not in self._acted_on
            if phase is not self.phase or not is_new or beat_s <= watch.opened_at_s(breach):
                continue  # a mode that was reported before the breach says nothing of what the vehicle does about it
            self._acted_on.add(breach)
            action = reaction(breach, phase, simulated=session.simulated, chosen=session.on_breach)
            if action is OnBreach.RETURN:
                raise Stopped(breach)
            if action is OnBreach.HOLD:
                self._begin_hold(breach)
                return
            if action is OnBreach.LAND:
                self._land(breach)
                return

    def _look_at_mode(self) -> None:
        """Look whether the vehicle is in the mode that we commanded, and whether it has just come back to its mission."""
        session, progress = self._session, self._progress
        self._override.update(self._commanded)
        changes, self._mode_changes = self._mode_changes, session.monitor.mode_changes
        came_back = changes != self._mode_changes and not self._override.begun
        if came_back and self._hold is not None:
            self._hold.begin_again()
        if not came_back or Mode.MISSION not in self._commanded or progress is None or progress.heading_for < 0:
            return
        progress.rejoin()
        if (problem := progress.line_problem()) is not None:
            session.watch.open(Ending.UNSAFE_LINE, problem)

    def _begin_hold(self, breach: Ending) -> None:
        session = self._session
        session.paused = True
        try:
            obeyed = self._obeys(hold_mode(session), "hold")
        except TakenOverError as error:
            session.paused = False
            if error.ending is Ending.STATE_UNKNOWN:
                self._acted_on.discard(breach)
            raise
        if not obeyed:
            session.paused = False
            return
        self._holds_for[breach] = self._holds_for.get(breach, 0) + 1
        again = self._holds_for[breach] < _MOST_HOLDS and self._progress is not None
        self._hold = HoldWatch(session, breach, may_go_on=again)
        self._upside_down = not self._pause()
        session.tell(
            EventKind.STOP,
            f"the vehicle therefore holds its place in {session.mode_name} for at most {session.timeouts.held_s:g} s, then "
            "flies home: p continues, Ctrl-C flies it home now",
        )

    def _land(self, breach: Ending) -> None:
        session = self._session
        if self._obeys(Mode.LAND, "land"):
            session.paused, self._lands_for = True, breach
            session.tell(EventKind.STOP, "the vehicle therefore lands where it is")

    def _obeys(self, mode: Mode, what: str) -> bool:
        """Change a vehicle in its mission to a mode; one that refuses or does not answer is told, and followed on."""
        session = self._session
        try:
            session.steer(lambda: set_mode(session, mode), while_in=[Mode.MISSION, mode])
        except CommandRefusedError as error:
            session.tell(EventKind.WARNING, f"the vehicle refuses to {what}: {error}", alarm=True)
            return False
        except VehicleSilentError as error:
            session.tell(EventKind.WARNING, f"the vehicle was told to {what}, and does not obey: {error}", alarm=True)
            return False
        return True

    def _look_at_hold(self, hold: HoldWatch) -> None:
        session, state = self._session, hold.look()
        if state is HoldState.LOST and Ending.HOLD_LOST not in self._acted_on:
            self._acted_on.add(Ending.HOLD_LOST)
            raise Stopped(Ending.HOLD_LOST)
        if state is HoldState.OVERDUE and hold.purpose is not None:
            session.tell(
                EventKind.STOP,
                f"the vehicle has held its place for {session.timeouts.held_s:g} s, and nothing continued it",
            )
            raise Stopped(hold.purpose)
        if state is HoldState.OVER:
            problem = None if self._progress is None else self._progress.line_problem()
            if problem is not None and hold.purpose is not None:
                session.tell(EventKind.STOP, f"the mission is not continued: {problem}")
                raise Stopped(hold.purpose)
            if not self._goes_on("what it held for is over: the vehicle goes on with its mission"):
                raise Stopped(hold.purpose)
            self._upside_down = self._pause()

    def _goes_on(self, text: str) -> bool:
        """Continue the mission; a vehicle that refuses holds on, and one that flies another item is flown home."""
        session = self._session
        try:
            continue_mission(session)
        except FlightFaultError as error:
            if error.ending is not Ending.FAILED:
                raise
            session.watch.open(Ending.FAILED, str(error))
            raise Stopped(Ending.FAILED) from error
        except (CommandRefusedError, VehicleSilentError) as error:
            session.tell(EventKind.WARNING, f"the mission is not continued: {error}", alarm=True)
            return False
        session.tell(EventKind.STOP, text)
        self._going_on, self._hold = Timer(session, _GOING_ON_S), None
        return True

    def _end_at_users_wish(self, stops: int) -> None:
        """Home, unless something else has the vehicle: then the first stop is told, and the second ends the record."""
        session = self._session
        if session.evidence.current:
            self._look_at_mode()
            self._override.settle()
            if self.cause is None:
                raise Stopped
        why = "what the vehicle does is not known" if self.cause is None else self.why
        if self._record_goes_on or stops > self._stops_before + 1:
            raise FlightFaultError(
                self.cause or Ending.STATE_UNKNOWN,
                f"{why}; stopped following: the vehicle is left to whoever controls it",
            )
        if self.cause is None:
            if not self._told_to_wait:
                self._told_to_wait = True
                session.tell(
                    EventKind.STOP,
                    f"{why}: it is asked to return as soon as it is heard in its mission; once more ends the record",
                )
            return
        self._record_goes_on, self._stops_before = True, stops
        session.tell(
            EventKind.STOP,
            "something else has the vehicle, so nothing is commanded; the record goes on until it is on the ground; once "
            "more ends the record",
        )

    def _pause_or_go_on(self) -> None:
        session = self._session
        pressed = self._pause()
        if self._declined is not pressed:
            self._declined = None
        wanted = pressed is not self._upside_down  # a key that was pressed before a breach does not end its hold
        if (
            self._declined is not None
            or wanted == (self._hold is not None)
            or not self.is_ours
            or session.monitor.on_ground is not False
        ):
            return
        if wanted:
            session.paused, self._declined = True, pressed  # until it holds
            try:
                session.paused = self._obeys(hold_mode(session), "hold")
            except TakenOverError:
                session.paused = False
                raise
            if not session.paused:
                return
            self._declined = None
            self._hold = HoldWatch(session, None, may_go_on=False)
            session.tell(EventKind.STOP, f"paused: the vehicle holds its place in {session.mode_name}")
            return
        problem = None if self._progress is None else self._progress.line_problem()
        if problem is not None:
            self._declined = pressed
            session.tell(EventKind.WARNING, f"the mission is not continued: {problem}; Ctrl-C flies home", alarm=True)
            return
        if not self._goes_on("the vehicle goes on with its mission"):
            self._declined = pressed

    def _raise_stuck(self) -> None:
        session = self._session
        cause = session.watch.recent_cause(within_s=self._stillness.timeout_s)
        windy = cause is not None and cause.kind is Ending.WIND_ABOVE_LIMITS
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
            if self.cause is not None:
                raise FlightFaultError(
                    self.cause, f"{self.why}; it is on the ground and stays armed: left to whoever controls it"
                )
            if not session.evidence.current:
                return
            if self._told_to_disarm:
                raise FlightFaultError(
                    Ending.STAYED_ARMED, f"the vehicle has landed but stays armed{session.recent_warnings}"
                )
            self._told_to_disarm = True
            ours = [Mode.MISSION, Mode.LAND, Mode.HOLD, hold_mode(session)]
            try:
                session.steer(lambda: send_disarm(session), while_in=ours)
            except (TakenOverError, CommandRefusedError, VehicleSilentError) as error:
                if session.client.vehicle.armed:
                    session.tell(
                        EventKind.WARNING, f"the vehicle is on the ground and stays armed: {error}", alarm=True
                    )
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
