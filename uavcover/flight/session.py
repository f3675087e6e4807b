"""The session with one vehicle: its modes and commands, waiting with timeouts, passing on reports, noticing its loss."""

from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TypeVar

from mission_io.autopilots.autopilot import Autopilot, Mode, mode_from_custom
from mission_io.client.client import Client
from mission_io.data_tables import data_table
from mission_io.errors import CommandRefusedError, MisuseError, VehicleSilentError, WaitCancelledError
from mission_io.model.enums import AutopilotId, CommandResult, MissionState, Severity
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.messages import MissionCurrent, MissionSetCurrent
from uavcover.flight.evidence import Evidence
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import PREPARATION, FlightTimeouts, OnBreach, custom_mode
from uavcover.flight.parameter_rules import Limit
from uavcover.flight.watch import Watch
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFaultError


@dataclass(frozen=True, slots=True, kw_only=True)
class _Following:
    moved_m: float
    going_on_s: float
    evidence_s: float
    second_beat_s: float
    most_holds: int
    comes_to_rest_s: float
    look_s: float
    drift_m: float
    calm_s: float
    at_rest_m_s: float
    most_returns: int
    aside_m: float
    home_samples: int
    poll_s: float
    unknown_s: float


FOLLOWING = data_table(_Following, "uavcover/data/flight.toml", "following")


ResultT = TypeVar("ResultT")


class Stopped(Exception):  # noqa: N818 - the user's wish is no error
    """The flight is to end, by the user's wish, after a breach, or for the battery's reserve.

    Attributes:
        cause: the breach, or RESERVE_KEPT; None when the user asked.
    """

    def __init__(self, cause: Ending | None = None) -> None:
        self.cause = cause
        super().__init__()


class TakenOverError(FlightFaultError):
    """A command was withheld: the vehicle is not in a mode that we commanded."""


class Session:
    """The session with one vehicle, shared by all stages of a flight.

    Attributes:
        watch: watches for failures.
        evidence: whether the known state is newer than the last gap.
        on_breach: the user's reaction to a breach; None: that of the policy.
        photos_required: whether a camera that reports no photo at all is an alarm too.
        simulated: whether the vehicle is proved to be simulated.
        paused: whether the vehicle was commanded to hold on its way and has not continued since.
    """

    def __init__(
        self,
        client: Client,  # talks to the vehicle
        monitor: Monitor,  # hears what the client hears
        *,
        timeouts: FlightTimeouts,  # timeouts
        on_event: Callable[[FlightEvent], None],  # called with every event
        stop: Callable[[], int],  # how often the user has asked to stop
        pause: Callable[[], bool] = lambda: False,  # whether the user wants the vehicle to wait where it is
    ) -> None:
        self.client, self.monitor, self.timeouts = client, monitor, timeouts
        self.stop = stop
        self.pause = pause
        self.paused = False
        self.on_breach: OnBreach | None = None
        self.photos_required = False
        self.simulated = False
        self._on_event = on_event
        self._recent_warnings: deque[str] = deque(maxlen=3)
        self.evidence = Evidence(client, monitor)
        self.watch = Watch(client, monitor, timeouts, self.tell, self.alarm)

    @property
    def autopilot(self) -> Autopilot:
        """The vehicle's autopilot."""
        return self.client.vehicle.autopilot

    @property
    def is_ardupilot(self) -> bool:
        """Whether the vehicle runs ArduPilot."""
        return self.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT

    @property
    def is_px4(self) -> bool:
        """Whether the vehicle runs PX4."""
        return self.client.vehicle.mav_autopilot == AutopilotId.PX4

    @property
    def recent_warnings(self) -> str:
        """The vehicle's latest warnings as the end of a sentence; empty when there were none."""
        return f"; the vehicle reports: {' | '.join(self._recent_warnings)}" if self._recent_warnings else ""

    @property
    def on_mission(self) -> bool:
        """Whether the vehicle flies its mission or was paused by us; MISSION_CURRENT shows a change before the heartbeat."""
        if self.paused:
            return True
        current = self.monitor.latest(m.MissionCurrent)
        left = current is not None and current.state == MissionState.PAUSED
        in_mission = self.client.vehicle.custom_mode == custom_mode(self.autopilot, Mode.MISSION)
        return in_mission and not left

    @property
    def mode_name(self) -> str:
        """The vehicle's flight mode as text."""
        number = self.client.vehicle.custom_mode
        mode = mode_from_custom(self.autopilot, number)
        return f"mode {number}" if mode is None else f"{mode.value} mode"

    @property
    def silence_s(self) -> float:
        """Time since the vehicle's last message."""
        return self.monitor.silence_s(self.client.clock.now())

    @property
    def is_silent(self) -> bool:
        """Whether nothing has been heard of the vehicle for longer than the deadman time: its present state is unknown."""
        return self.silence_s > self.timeouts.deadman_s

    @property
    def vehicle_now(self) -> str:
        """The vehicle's current or last known action, as text."""
        monitor = self.monitor
        try:
            vehicle = self.client.vehicle
        except MisuseError:
            return "not in contact"
        unproved = "on the ground, according to the vehicle" if monitor.ground.reports_landed else "somewhere"
        where = {True: "on the ground", False: "in the air", None: unproved}[monitor.on_ground]
        lies = not vehicle.armed and monitor.ground.lies(monitor.time_s)
        if (lies or self.watch.is_open(Ending.CRASHED)) and not monitor.on_ground:
            # It may go on reporting that it flies, as after a fall under power.
            where = "on the ground, according to its motion"
        parts = [where, "armed" if vehicle.armed else "disarmed", f"in {self.mode_name}"]
        if not self.is_silent and (age_s := self.client.heartbeat_age_s) > self.timeouts.heartbeat_s:
            parts[-1] += f" at its last heartbeat {age_s:.0f} s ago"
        here = monitor.latest(m.GlobalPositionInt)
        if here is not None:
            old = self.client.clock.now() - (monitor.position_at_s or 0.0) > self.timeouts.deadman_s + self.silence_s
            position = f"{here.lat_deg:.6f}, {here.lon_deg:.6f}, {here.alt_above_home_m:z.0f} m above home"
            parts.append(f"last known at {position}" if old else f"at {position}")
        return (f"last heard {self.silence_s:.0f} s ago: " if self.is_silent else "") + ", ".join(parts)

    def tell(self, kind: EventKind, text: str, *, waypoint: int | None = None, alarm: bool = False) -> None:
        """Pass on an event."""
        self._on_event(FlightEvent(kind, text, self.monitor.time_s, waypoint, alarm))

    def warn(self, text: str) -> None:
        """Report a warning."""
        self.tell(EventKind.WARNING, text)

    def alarm(self, text: str) -> None:
        """Report a warning that is also sounded."""
        self.tell(EventKind.WARNING, text, alarm=True)

    def tell_limits(self, head: str, rows: Sequence[Limit]) -> None:
        """Pass on the table of limits, line by line; its head has all rows as values."""
        values = tuple(row.as_json() for row in rows)
        self._on_event(FlightEvent(EventKind.STAGE, head, self.monitor.time_s, limits=values))
        for row in rows:
            self.tell(EventKind.STAGE, row.line)

    def pump(self) -> None:
        """Listen for a moment, and pass on the vehicle's messages.

        Raises:
            FlightFaultError: it is gone, or it restarted.
        """
        self.client.poll(FOLLOWING.poll_s)
        self.attend()

    def attend(self) -> None:
        """Pass on what was heard, and look at what can go wrong; also while a transfer is going on.

        Raises:
            FlightFaultError: the vehicle is gone, or it restarted.
        """
        while self.monitor.texts:
            said = self.monitor.texts.popleft()
            if said.severity <= Severity.WARNING:
                self._recent_warnings.append(said.text)
            self.watch.take_text(said)
            self.tell(EventKind.TEXT, said.text)
        while self.monitor.events:
            self.watch.causes.take_event(self.monitor.events.popleft())
        while self.monitor.other_texts:
            component, said = self.monitor.other_texts.popleft()
            self.tell(EventKind.TEXT, f"component {component}: {said.text}")
        self.evidence.look()
        self.watch.look()
        self._look_at_evidence()

    def _look_at_evidence(self) -> None:
        """Report a vehicle in flight that is heard with an unknown state; a lost heartbeat has its own report."""
        unknown_s, lost = self.evidence.unknown_s, self.watch.is_open(Ending.HEARTBEAT_LOST)
        if unknown_s > FOLLOWING.unknown_s and not lost and self.client.vehicle.armed:
            self.watch.open(Ending.STATE_UNKNOWN, self._unknown_text, unknown_s)
        else:
            self.watch.measure(Ending.STATE_UNKNOWN, None, "", "the vehicle's state is known again")

    @property
    def _unknown_text(self) -> str:
        return (
            f"the vehicle sends messages, but its state has been unknown for {self.evidence.unknown_s:.0f} s: "
            f"waiting for {self.evidence.missing} before sending any command"
        )

    def listen(self, seconds: float) -> None:
        """Listen for some seconds on the link's clock, through all errors."""
        until_s = self.client.clock.now() + seconds
        while self.client.clock.now() < until_s:
            self.client.poll(FOLLOWING.poll_s)

    def obeys(self, modes: Collection[Mode]) -> bool:
        """Whether evidence that is newer than the last gap shows the vehicle armed, and in one of these modes."""
        vehicle = self.client.vehicle
        in_mode = vehicle.custom_mode in [custom_mode(self.autopilot, mode) for mode in modes]
        return self.evidence.current and vehicle.armed and in_mode

    def steer(self, act: Callable[[], ResultT], *, while_in: Collection[Mode]) -> ResultT:
        """Command the vehicle in flight, as long as current evidence shows it in a mode that we commanded.

        Nothing is sent, and nothing is sent again, while the evidence is older than the last gap, or when it shows another mode:
        a failsafe or a pilot has the vehicle then. Silence is waited for until the link counts as lost, a vehicle that is heard
        and not known for some seconds.

        Args:
            act: sends the command and waits for its answer.
            while_in: the modes that we commanded, and the one that ``act`` commands.

        Raises:
            TakenOverError: the vehicle is in another mode, or disarmed, or its state stays unknown.
            FlightFaultError: the vehicle is gone.
            mission_io.errors.MissionIoError: any error of ``act`` but silence; silence too, when other messages arrive.
        """
        return self._command(act, lambda: self.obeys(while_in))

    def prepare(self, act: Callable[[], ResultT], *, while_in: Collection[Mode] = ()) -> ResultT:
        """Command a vehicle on the ground, as long as current evidence shows it disarmed, or in one of these modes.

        Raises:
            TakenOverError: it is armed, and in another mode, or its state stays unknown.
            FlightFaultError: the vehicle is gone.
            mission_io.errors.MissionIoError: as for ``steer``.
        """

        def may() -> bool:
            return self.evidence.current and (not self.client.vehicle.armed or self.obeys(while_in))

        return self._command(act, may)

    def require_obedience(self, modes: Collection[Mode]) -> None:
        """Nothing, unless current evidence shows the vehicle disarmed, or in none of these modes.

        Raises:
            TakenOverError: it does.
        """
        if self.evidence.current and not self.obeys(modes):
            raise self._withheld()

    def _withheld(self) -> TakenOverError:
        how = f"armed and in {self.mode_name}" if self.client.vehicle.armed else "disarmed"
        return TakenOverError(Ending.TAKEN_OVER, f"no command was sent: the vehicle is {how}")

    def _command(self, act: Callable[[], ResultT], may: Callable[[], bool]) -> ResultT:
        began_s = self.client.clock.now()

        def withheld() -> bool:
            self.evidence.look()  # nothing else asks while a long call waits
            return not may()

        while True:
            while not self.evidence.current:
                if self.evidence.unknown_s > FOLLOWING.unknown_s:
                    raise TakenOverError(Ending.STATE_UNKNOWN, f"no command was sent: {self._unknown_text}")
                self.pump()
            if not may():
                raise self._withheld()
            self.client.give_up = withheld
            try:
                return act()
            except WaitCancelledError:
                continue
            except VehicleSilentError:
                if self.client.clock.now() - began_s > self.timeouts.link_lost_s:
                    raise
            finally:
                self.client.give_up = None
            self.pump()

    def wait(
        self,
        done: Callable[[], bool],  # reads the monitor
        *,
        timeout_s: float,  # longest time to wait, vehicle time where the vehicle tells it
        what: Callable[[], str],  # the missing event, for the error
        stops_before: int | None = None,  # how many stops of the user are known already; None is not to look
        ending: Ending = Ending.FAILED,  # the name of it when it took too long
    ) -> None:
        """Listen until ``done``.

        Raises:
            FlightFaultError: it took too long, or the vehicle is gone.
            Stopped: the user asked once more.
        """
        timer = Timer(self, timeout_s)
        while not done():
            if stops_before is not None and self.stop() > stops_before:
                raise Stopped
            if timer.over:
                raise FlightFaultError(ending, f"{what()} within {timeout_s:g} s{self.recent_warnings}")
            self.pump()


class Timer:
    """A timer in vehicle time where that is known, with the link's clock as its watchdog."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self._session, self._timeout_s = session, timeout_s
        self.restart()

    def restart(self) -> None:
        """Begin again."""
        self._vehicle_s = self._session.monitor.time_s
        self._link_s = self._session.client.clock.now()

    @property
    def over(self) -> bool:
        """Whether the time has passed."""
        link_elapsed_s = self._session.client.clock.now() - self._link_s
        now_s = self._session.monitor.time_s
        if now_s is None or self._vehicle_s is None:
            return link_elapsed_s > self._timeout_s
        watchdog_s = self._timeout_s * self._session.timeouts.watchdog
        return now_s - self._vehicle_s > self._timeout_s or link_elapsed_s > watchdog_s


def set_mode(session: Session, mode: Mode) -> None:
    """Change the flight mode and confirm it in the heartbeat."""
    session.client.set_mode(custom_mode(session.autopilot, mode))


def hold_mode(session: Session) -> Mode:
    """The mode in which the vehicle stays where it is without a pilot's sticks.

    ArduPilot's LOITER takes the height from the throttle stick, which is down when no pilot holds it; GUIDED stays.
    """
    return Mode.GUIDED if session.is_ardupilot else Mode.HOLD


def first_seq(session: Session) -> int:
    """Number on the wire of a mission's first item."""
    return 1 if session.autopilot.home_in_item_0 else 0


def set_current_item(session: Session, seq: int) -> None:
    """Go on with item ``seq``, by command, or by the older message where the command is not known."""
    try:
        session.client.command(Command.DO_SET_MISSION_CURRENT, float(seq), timeout_s=PREPARATION.arming_answer_s)
    except (CommandRefusedError, VehicleSilentError) as error:
        if isinstance(error, CommandRefusedError) and error.result != CommandResult.UNSUPPORTED:
            raise
        session.client.send(MissionSetCurrent(*session.client.vehicle.address, seq))


def fly_from_item(session: Session, seq: int) -> None:
    """Fly the mission that an airborne vehicle holds, from item ``seq`` on; on failure command a hold.

    ArduPilot begins its mission anew each time that it enters AUTO when MIS_RESTART is 1. So the item is set again once it has
    entered AUTO, and MISSION_CURRENT has to show it.

    Raises:
        FlightFaultError: the vehicle is gone, or flies to another item.
        mission_io.errors.CommandRefusedError: it refuses.
    """
    _steer(session, lambda: set_current_item(session, seq))
    continue_mission(session, seq)


def continue_mission(session: Session, seq: int | None = None) -> None:
    """Fly on with item ``seq``, which is the current one; errors as ``fly_from_item``."""
    wanted = session.monitor.current_seq if seq is None else seq
    if wanted < 0:  # nothing is known of its item
        _steer(session, lambda: set_mode(session, Mode.MISSION))
        return
    if session.is_ardupilot:
        _steer(session, lambda: session.client.command(Command.MISSION_START))  # enters AUTO, and answers at once
        _steer(session, lambda: set_current_item(session, wanted))
    _steer(session, lambda: set_mode(session, Mode.MISSION))
    item = _reported_item(session)
    for _ in range(PREPARATION.arming_tries):
        if wanted <= item <= wanted + PREPARATION.reached_items:
            return
        _steer(session, lambda: set_current_item(session, wanted))
        item = _reported_item(session)
    _steer(session, lambda: set_mode(session, hold_mode(session)))
    flies = f"flies to item {item}" if item >= 0 else "does not report its current item"
    raise FlightFaultError(
        Ending.FAILED,
        f"the vehicle {flies} instead of flying to item {wanted}; it was commanded to hold; set MIS_RESTART to 0 so "
        "that missions resume at the current item",
    )


def _steer(session: Session, act: Callable[[], object]) -> None:
    """Command a vehicle that holds or flies its mission by our command; errors as ``Session.steer``."""
    session.steer(act, while_in=[hold_mode(session), Mode.HOLD, Mode.MISSION])


def _reported_item(session: Session) -> int:
    """The next reported item that the vehicle flies to; -1 without a report."""
    session.monitor.forget(MissionCurrent)
    silent = Timer(session, PREPARATION.arming_answer_s)
    while session.monitor.current_seq < 0 and not silent.over:
        session.pump()
    return session.monitor.current_seq
