"""After the user's stop: hold, then fly home along checked legs; a second stop leaves the vehicle holding."""

import math
from collections.abc import Callable
from dataclasses import replace

from mission_io.errors import MissionIoError
from mission_io.model.items import Frame, Mission
from mission_io.wire import messages as m
from uavcover.errors import UavcoverError
from uavcover.flight.arming import first_seq, fly_from_item, hold_mode, is_flying, set_mode
from uavcover.flight.follow import follow_home
from uavcover.flight.modes import Mode
from uavcover.flight.preconditions import Preconditions
from uavcover.flight.session import Session, Stopped
from uavcover.flight.tuning import FOLLOWING
from uavcover.model.outcome import Ending, EventKind, FlightFaultError

_ASKED = "the user stopped the flight a second time"

PlanReturn = Callable[[float, float, float], Mission]
"""Plans a mission home with checked legs from latitude, longitude (degrees) and height above sea level (metres)."""


def hold(session: Session, text: str = "stop: commanding the vehicle to hold") -> None:
    """Tell ``text``, make the vehicle stay where it is, and wait until it has come to rest.

    Raises:
        TakenOverError: something else has it, or its state stays unknown.
        FlightFaultError: it is gone, or does not come to rest.
        mission_io.errors.CommandRefusedError: it refuses to hold.
    """
    session.tell(EventKind.STOP, text)
    ours = (Mode.MISSION, Mode.HOLD, hold_mode(session))
    session.steer(lambda: set_mode(session, hold_mode(session)), while_in=ours)

    def at_rest() -> bool:
        session.require_obedience(ours)
        return _speed_m_s(session) <= FOLLOWING.at_rest_m_s

    session.wait(
        at_rest,
        timeout_s=session.timeouts.halt_s,
        what=lambda: f"the vehicle is in {session.mode_name} and does not stop",
    )
    session.tell(EventKind.STOP, "the vehicle holds its position")


class _LeftHoldingError(Exception):
    """The vehicle is to be left holding, and why."""


def return_home(
    session: Session,
    plan_return: PlanReturn,
    *,
    stops: int = 1,
    preconditions: Preconditions | None = None,
    clear: Callable[[Mission], bool] = lambda _: True,
) -> bool:
    """Hold, fly home along checked legs, land; one more stop of the user than ``stops`` leaves the vehicle holding.

    Beside other vehicles it holds until ``clear`` says that the return is free. Heights above a home that was moved in flight
    are sent so that the planned ones are flown. What was checked before arming is watched on; a change that makes the return
    unsafe has it planned and sent again, as ``data/breach_policy.toml`` says, a few times.

    Returns:
        Whether the vehicle landed; False when it was left holding, which was reported.

    Raises:
        TakenOverError: something else has the vehicle, or its state stays unknown.
        FlightFaultError: the vehicle is gone, or does something else.
    """
    for _ in range(FOLLOWING.most_ways_home):
        try:
            sent = _send(session, _hold_and_plan(session, plan_return, stops, clear), stops, preconditions)
        except _LeftHoldingError as left:
            return _leave(session, str(left))
        plan = None if preconditions is None else preconditions.go_home(sent)
        session.monitor.forget(m.MissionCurrent)
        fly_from_item(session, first_seq(session))
        session.tell(EventKind.STOP, "returning along checked legs")
        try:
            follow_home(session, stops_before=stops, plan=plan, preconditions=preconditions)
        except Stopped as stop:
            if not is_flying(session):
                return True
            if stop.cause is None:
                hold(session)
                return _leave(session, _ASKED)
            why = session.watch.text_of(stop.cause)
            session.tell(EventKind.STOP, f"planning the return again: {why}")
        else:
            return True
    hold(session)
    return _leave(session, f"the return was interrupted {FOLLOWING.most_ways_home} times, most recently because {why}")


def _hold_and_plan(session: Session, plan_return: PlanReturn, stops: int, clear: Callable[[Mission], bool]) -> Mission:
    """Hold, and plan the return from there."""
    session.paused = False
    session.watch.rest()
    try:
        hold(session)
    except FlightFaultError as error:
        if error.ending is not Ending.FAILED:
            raise
        session.tell(EventKind.WARNING, f"{error}; returning anyway", alarm=True)  # as in a strong wind
    if session.stop() > stops:
        raise _LeftHoldingError(_ASKED)
    here = session.monitor.latest(m.GlobalPositionInt)
    if here is None:
        raise FlightFaultError(Ending.POSITION_LOST, "the vehicle does not report its position; it continues to hold")
    try:
        mission = plan_return(here.lat_deg, here.lon_deg, here.alt_amsl_m)
        is_clear = clear(mission)
    except (UavcoverError, MissionIoError) as error:
        raise _LeftHoldingError(f"no checked return starts at the current position: {error}") from error
    if not is_clear:
        session.tell(EventKind.STOP, "the vehicle holds until its return is clear of other vehicles")
    while not is_clear:
        if session.stop() > stops:
            raise _LeftHoldingError(_ASKED)
        session.pump()
        session.require_obedience([hold_mode(session)])
        try:
            is_clear = clear(mission)
        except UavcoverError as error:
            raise _LeftHoldingError(f"no return keeps the separation from the other vehicles: {error}") from error
    return mission


def _send(session: Session, mission: Mission, stops: int, preconditions: Preconditions | None) -> Mission:
    """Upload the return, with heights that make up for a moved home."""
    moved_m = 0.0 if preconditions is None else preconditions.home_moved_up_m()
    if moved_m:
        session.tell(
            EventKind.STOP, f"home was moved by {moved_m:+.1f} m: the return is uploaded with corrected heights"
        )
        mission = _above_moved_home(mission, moved_m)
    session.tell(EventKind.STOP, "uploading the return")
    try:
        checked = session.steer(
            lambda: session.client.upload_and_verify(mission, in_flight=True), while_in=[hold_mode(session)]
        )
    except MissionIoError as error:
        raise _LeftHoldingError(f"cannot upload the return: {error}") from error
    if not checked.passed:
        raise _LeftHoldingError("the mission read back from the vehicle differs from the return")
    if session.stop() > stops:
        raise _LeftHoldingError(_ASKED)
    return mission


def _above_moved_home(mission: Mission, up_m: float) -> Mission:
    """The same positions, for a vehicle whose home is higher by ``up_m`` than planned."""
    above_home = Frame.ABOVE_HOME
    items = [replace(i, alt_m=i.alt_m - up_m) if i.frame is above_home and i.has_position else i for i in mission.items]
    return replace(mission, items=tuple(items))


def _leave(session: Session, why: str) -> bool:
    session.tell(
        EventKind.STOP,
        f"{why}: the vehicle holds in {session.mode_name}, armed and in the air; take manual control now",
    )
    return False


def _speed_m_s(session: Session) -> float:
    position = session.monitor.latest(m.GlobalPositionInt)
    if position is None:
        return math.inf
    return math.hypot(position.velocity_north_m_s, position.velocity_east_m_s, position.velocity_down_m_s)
