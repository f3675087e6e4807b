"""Arms, starts and disarms the vehicle, in the order that each autopilot requires. Every (dis)arm command comes from here."""

from collections.abc import Callable

from mission_io.autopilots.flight_modes import Mode
from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command
from mission_io.wire.messages import MissionCurrent, MissionSetCurrent
from uavcover.flight.client import custom_mode
from uavcover.flight.session import Session, Stopped, TakenOverError, Timer
from uavcover.flight.tuning import PREPARATION
from uavcover.model.outcome import Ending, EventKind, FlightFaultError

_LACKS_TERRAIN = "terrain data"
"""Words of ArduPilot's refusal, "PreArm: waiting for terrain data"."""
_AGAIN = (CommandResult.TEMPORARILY_REJECTED, CommandResult.FAILED)


def arm_and_start(session: Session) -> None:
    """Arm, start the mission, and wait until the vehicle has left the ground.

    ArduPilot: GUIDED, arm, AUTO, MISSION_START. PX4: mission mode, then arm, which starts it.

    Raises:
        TakenOverError: something else has it, or its state stays unknown; nothing more was commanded.
        FlightFaultError: it refuses to arm, or does not leave the ground.
        mission_io.errors.CommandRefusedError: it refuses another step.
        Stopped: the user asked to stop; it may be armed.
    """
    first = first_seq(session)
    session.prepare(lambda: set_current_item(session, first))
    if session.stop():
        raise Stopped
    start = Mode.GUIDED if session.is_ardupilot else Mode.MISSION
    session.prepare(lambda: set_mode(session, start))
    session.monitor.forget(MissionCurrent)  # the item of an older flight may still be reported
    _arm(session, start)
    session.tell(EventKind.STAGE, "armed")
    if session.is_ardupilot:
        session.steer(lambda: set_mode(session, Mode.MISSION), while_in=[start, Mode.MISSION])
        session.steer(lambda: session.client.command(Command.MISSION_START), while_in=[Mode.MISSION])

    def off_the_ground() -> bool:
        if session.client.vehicle.armed:
            session.require_obedience([Mode.MISSION])
        on_ground = session.monitor.on_ground
        return on_ground is False or (on_ground is None and session.monitor.current_seq > first)

    session.wait(
        off_the_ground,
        timeout_s=session.timeouts.start_s,
        what=lambda: f"the vehicle is armed and in {session.mode_name}, but did not take off",
        stops_before=0,
        ending=Ending.NOT_STARTED,
    )
    session.watch.take_off()
    session.tell(EventKind.STAGE, "in the air")


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


def wire_seq(session: Session, index: int) -> int:
    """Number on the wire of item ``index`` of a mission."""
    return first_seq(session) + index


def set_current_item(session: Session, seq: int) -> None:
    """Go on with item ``seq``, by command, or by the older message where the command is not known."""
    try:
        session.client.command(Command.DO_SET_MISSION_CURRENT, float(seq), timeout_s=PREPARATION.arming_answer_s)
    except (CommandRefusedError, VehicleSilentError) as error:
        if isinstance(error, CommandRefusedError) and error.result != CommandResult.UNSUPPORTED:
            raise
        session.client.send(MissionSetCurrent(*session.client.vehicle.address, seq))


def disarm_on_ground(session: Session) -> bool:
    """Disarm a vehicle that stands on the ground.

    Returns:
        Whether it is disarmed; False when it refuses, because it has just left the ground, or when not all that is known of it
        (its word, its height, its motion) tells that it stands there.
    """
    if not session.client.vehicle.armed:
        return True
    ours = [Mode.MISSION, Mode.HOLD, hold_mode(session)]
    try:
        return session.steer(lambda: _disarm_where_it_stands(session), while_in=ours)
    except (CommandRefusedError, TakenOverError):
        return not session.client.vehicle.armed


def _disarm_where_it_stands(session: Session) -> bool:
    if session.monitor.on_ground is not True:
        return False
    send_disarm(session)
    return True


def send_disarm(session: Session) -> None:
    """Send the command; the caller has made sure that the vehicle stands on the ground.

    Raises:
        mission_io.errors.CommandRefusedError: the autopilot refuses.
    """
    session.client.command(Command.COMPONENT_ARM_DISARM, 0.0)


def is_flying(session: Session) -> bool:
    """Whether the vehicle is armed and not proved to stand on the ground."""
    return session.client.vehicle.armed and session.monitor.on_ground is not True


class _ArmingTimeout:
    """Timeout of a refused arming: longer while a slow link still carries terrain heights."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._asked_count = len(session.monitor.terrain_asked)
        self._any = Timer(session, session.timeouts.arm_s)
        self._terrain = Timer(session, session.timeouts.terrain_s)

    @property
    def over(self) -> bool:
        """Whether the next refusal is the last."""
        asked_count = len(self._session.monitor.terrain_asked)
        if asked_count > self._asked_count:
            self._asked_count = asked_count
            self._terrain.restart()
        lacks_terrain = asked_count > 0 and _LACKS_TERRAIN in self._session.recent_warnings
        return self._any.over and not (lacks_terrain and not self._terrain.over)


def _arm(session: Session, mode: Mode) -> None:
    timeout = _ArmingTimeout(session)
    while True:
        try:
            session.prepare(lambda: session.client.command(Command.COMPONENT_ARM_DISARM, 1.0), while_in=[mode])
        except CommandRefusedError as error:
            if error.result not in _AGAIN or timeout.over:
                raise FlightFaultError(Ending.ARMING_REFUSED, f"{error}{session.recent_warnings}") from error
            if session.stop():
                raise Stopped from None
            pause = Timer(session, 1.0)
            while not pause.over:
                session.pump()
        else:
            break
    session.wait(
        lambda: session.client.vehicle.armed,
        timeout_s=session.timeouts.start_s,
        what=lambda: "arming was accepted, but the heartbeat does not confirm it",
        ending=Ending.ARMING_REFUSED,  # a stop of the user waits for it: what is not known to be armed is not disarmed
    )
