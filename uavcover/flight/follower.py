"""Follow a flying vehicle: its mode, pauses, stops, breaches and holds, and the landing.

Nothing is commanded before current evidence shows that the vehicle does what was commanded last.
"""

import math
from collections.abc import Callable, Collection

from mission_io.autopilots.autopilot import Mode
from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.items import ground_distance_m
from mission_io.wire import messages as m
from uavcover.flight.arming import send_disarm
from uavcover.flight.mission_guard import ModeOverride
from uavcover.flight.orders import OnBreach, Phase, policy, reaction
from uavcover.flight.position_watch import HoldState, HoldWatch
from uavcover.flight.progress import MissionProgress
from uavcover.flight.session import (
    FOLLOWING,
    Session,
    Stopped,
    TakenOverError,
    Timer,
    continue_mission,
    hold_mode,
    set_mode,
)
from uavcover.model.track import Ending, EventKind, FlightFaultError


class Follower:
    """Checks that run all the time in every phase of a flight.

    Nothing is commanded before current evidence shows that the vehicle does what we commanded last.

    Attributes:
        last_armed_s: vehicle time when it was last known to be armed.
    """

    def __init__(
        self,
        session: Session,  # with the vehicle
        stuck_s: float,  # time without progress in its mission
        *,
        stops_before: int,  # how many stops of the user are known already
        pause: Callable[[], bool],  # whether the vehicle is to wait now
        progress: MissionProgress | None,  # along the planned waypoints; None on the return
        ours: Collection[Mode] = (Mode.MISSION,),  # the modes that were commanded where nothing is flown by it
    ) -> None:
        self._session, self._stops_before, self._pause, self._progress = session, stops_before, pause, progress
        self._ours = ours
        self._known_until_s = session.monitor.gap_ended_at_s
        self._override = ModeOverride(session)
        self._stillness = Stillness(session, stuck_s)
        self._elsewhere = Stillness(session, session.timeouts.override_s)
        self._landed: Timer | None = None
        self._ordered_to_disarm = self._record_goes_on = self._ordered_to_wait = False
        self._hold: HoldWatch | None = None
        self._lands_for: Ending | None = None
        self._holds_for: dict[Ending, int] = {}
        # What goes wrong since before the return was planned was acted on by that.
        self._acted_on: set[Ending] = set() if progress is not None else set(session.watch.open_kinds)
        self._upside_down = False
        self._declined: bool | None = None
        self._going_on: Timer | None = None
        self._mode_changes = session.monitor.mode_changes
        self.last_armed_s = session.monitor.time_s

    @property
    def holds(self) -> bool:
        """Whether the vehicle was commanded to hold, and holds."""
        return self._hold is not None and not self._override.begun

    @property
    def in_mission(self) -> bool:
        """Whether current evidence shows the vehicle in the mission that it was commanded to fly."""
        return self.is_ours and self._hold is None and self._lands_for is None

    @property
    def mode_is_unknown(self) -> bool:
        """Whether no heartbeat tells its mode, and nothing else is known to have the vehicle; its positions still arrive."""
        return self._session.watch.is_open(Ending.HEARTBEAT_LOST) and self.cause is None

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
        """Cause for which a pilot or a failsafe has the vehicle; None when nothing has."""
        return self._override.cause

    @property
    def why(self) -> str:
        """The reported text of the cause."""
        return self._override.text

    @property
    def unobserved(self) -> str:
        """The gap in which the flight ended, as the end of a clause; empty where its end was seen."""
        monitor = self._session.monitor
        if monitor.gap_ended_at_s <= self._known_until_s:
            return ""
        return f"; events during the preceding {monitor.gap_s:.0f} s without messages are unknown"

    def settle(self) -> None:
        """Find the cause of what happened in the last moment, or in the gap before it."""
        session, timer = self._session, Timer(self._session, FOLLOWING.evidence_s)
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
            session.alarm(str(error))
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
                    f"{self.why}; the vehicle has not moved for {self._elsewhere.timeout_s:g} s; the pilot or "
                    "station that controls it remains in control",
                )
            return
        self._elsewhere.restart()
        if self._hold is not None:
            self._stillness.restart()
        elif self._stillness.too_long:
            self._raise_stuck()

    def react(self) -> None:
        """React to each breach once, by the policy; nothing while a pilot or another station has the vehicle.

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
        """Check the commanded mode, and whether the vehicle has just come back to its mission."""
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
        again = self._holds_for[breach] < FOLLOWING.most_holds and self._progress is not None
        self._hold = HoldWatch(session, breach, may_go_on=again)
        self._upside_down = not self._pause()
        then = "returns: press p to continue the mission, or Ctrl-C to return now"
        if self._progress is None:
            then = "uavcover plans the return again: press Ctrl-C to keep the vehicle holding"
        session.tell(
            EventKind.STOP,
            f"the vehicle now holds its position in {session.mode_name} for up to {session.timeouts.held_s:g} s, then "
            f"{then}",
        )

    def _land(self, breach: Ending) -> None:
        session = self._session
        if self._obeys(Mode.LAND, "land"):
            session.paused, self._lands_for = True, breach
            session.tell(EventKind.STOP, "the vehicle is landing at its current position")

    def _obeys(self, mode: Mode, what: str) -> bool:
        """Change a vehicle in its mission to a mode; report a refusal or silence, and follow on."""
        session = self._session
        try:
            session.steer(lambda: set_mode(session, mode), while_in=[Mode.MISSION, mode])
        except CommandRefusedError as error:
            session.alarm(f"the vehicle refused the command to {what}: {error}")
            return False
        except VehicleSilentError as error:
            session.alarm(f"the vehicle did not follow the command to {what}: {error}")
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
                f"the vehicle has held its position for {session.timeouts.held_s:g} s without continuing the mission",
            )
            raise Stopped(hold.purpose)
        if state is HoldState.OVER:
            problem = None if self._progress is None else self._progress.line_problem()
            if problem is not None and hold.purpose is not None:
                session.tell(EventKind.STOP, f"the mission was not continued: {problem}")
                raise Stopped(hold.purpose)
            if not self._goes_on("the reason for the hold is gone: the vehicle continues its mission"):
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
            session.alarm(f"the mission was not continued: {error}")
            return False
        session.tell(EventKind.STOP, text)
        self._going_on, self._hold = Timer(session, FOLLOWING.going_on_s), None
        return True

    def _end_at_users_wish(self, stops: int) -> None:
        """Home, unless something else has the vehicle: then the first stop is reported, and the second ends the record."""
        session = self._session
        if session.evidence.current:
            self._look_at_mode()
            self._override.settle()
            if self.cause is None:
                raise Stopped
        why = "the state of the vehicle is unknown" if self.cause is None else self.why
        if self._record_goes_on or stops > self._stops_before + 1:
            raise FlightFaultError(
                self.cause or Ending.STATE_UNKNOWN,
                f"{why}; uavcover no longer follows the flight: the pilot or station that controls the vehicle "
                "remains in control",
            )
        if self.cause is None:
            if not self._ordered_to_wait:
                self._ordered_to_wait = True
                session.tell(
                    EventKind.STOP,
                    f"{why}; uavcover commands the vehicle to return as soon as it reports its mission; press Ctrl-C "
                    "again to stop recording",
                )
            return
        self._record_goes_on, self._stops_before = True, stops
        session.tell(
            EventKind.STOP,
            "another party controls the vehicle, so no command is sent; recording continues until the vehicle is on "
            "the ground; press Ctrl-C again to stop recording",
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
            session.tell(EventKind.STOP, f"paused: the vehicle holds its position in {session.mode_name}")
            return
        problem = None if self._progress is None else self._progress.line_problem()
        if problem is not None:
            self._declined = pressed
            session.alarm(f"the mission was not continued: {problem}; press Ctrl-C to return")
            return
        if not self._goes_on("the vehicle continues its mission"):
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
                f"{session.watch.text_of(Ending.HEARTBEAT_LOST)}; the vehicle is on the ground and may be armed, so keep away",
            )
        if self._landed is None:
            self._landed = Timer(session, session.timeouts.disarm_s)
            session.tell(EventKind.STAGE, "on the ground")
        elif self._landed.over:
            if self.cause is not None:
                raise FlightFaultError(
                    self.cause,
                    f"{self.why}; the vehicle is on the ground and still armed; the pilot or station that controls "
                    "it remains in control",
                )
            if not session.evidence.current:
                return
            if self._ordered_to_disarm:
                raise FlightFaultError(
                    Ending.STAYED_ARMED, f"the vehicle has landed but is still armed{session.recent_warnings}"
                )
            self._ordered_to_disarm = True
            ours = [Mode.MISSION, Mode.LAND, Mode.HOLD, hold_mode(session)]
            try:
                session.steer(lambda: send_disarm(session), while_in=ours)
            except (TakenOverError, CommandRefusedError, VehicleSilentError) as error:
                if session.client.vehicle.armed:
                    session.alarm(f"the vehicle is on the ground and still armed: {error}")
            self._landed.restart()


class Stillness:
    """Detects that a vehicle neither moves nor continues to another item."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self._session = session
        self._timer = Timer(session, timeout_s)
        self._observed: tuple[int, m.GlobalPositionInt] | None = None

    def restart(self) -> None:
        """Begin anew."""
        self._observed = None
        self._timer.restart()

    @property
    def too_long(self) -> bool:
        """Whether nothing changed for ``timeout_s``; a vehicle whose positions are lost may move."""
        session, monitor = self._session, self._session.monitor
        position = monitor.latest(m.GlobalPositionInt)
        age_s = session.client.clock.now() - (monitor.position_at_s or 0.0)
        if position is None or age_s > session.timeouts.deadman_s:
            self.restart()
            return False
        last = self._observed
        if last is None or last[0] != monitor.current_seq or self._moved_m(position) > FOLLOWING.moved_m:
            self._observed = (monitor.current_seq, position)
            self._timer.restart()
        return self._timer.over

    def _moved_m(self, here: m.GlobalPositionInt) -> float:
        if self._observed is None:
            return 0.0
        before = self._observed[1]
        level_m = ground_distance_m(before.lat_deg, before.lon_deg, here.lat_deg, here.lon_deg)
        return math.hypot(level_m, here.alt_amsl_m - before.alt_amsl_m)
