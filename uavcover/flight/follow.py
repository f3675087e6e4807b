"""Follow a vehicle along its mission, or home along checked legs after the user's stop, until it has landed and disarmed.

After a stop it holds first; a second stop leaves it holding.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from mission_io.autopilots.autopilot import Mode
from mission_io.errors import MissionIoError
from mission_io.model.items import Command, Frame, Mission
from mission_io.wire import messages as m
from uavcover.errors import UavcoverError
from uavcover.flight.arming import is_flying
from uavcover.flight.follower import Follower
from uavcover.flight.mission_guard import MissionGuard, VolumeWatch
from uavcover.flight.orders import FlightPlan, OnBreach, reaction
from uavcover.flight.position_watch import FallWatch, PhotoWatch
from uavcover.flight.preconditions import Preconditions
from uavcover.flight.progress import FlightSchedule, MissionProgress
from uavcover.flight.session import FOLLOWING, Session, Stopped, Timer, first_seq, fly_from_item, hold_mode, set_mode
from uavcover.model.track import Ending, EventKind, FlightFaultError

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
    positions, falls = VolumeWatch(session, plan.volume, progress), FallWatch(session, plan)
    stuck_s = session.timeouts.stuck_s + longest_wait_s(plan)
    follower = Follower(session, stuck_s, stops_before=0, pause=session.pause, progress=progress)

    def meanwhile() -> None:
        progress.update()
        if not session.monitor.on_ground:
            falls.look()
            positions.look(on_route=follower.in_mission or follower.holds)

    guard = MissionGuard(session, plan, progress, meanwhile)

    def look() -> None:
        aloft = not session.monitor.on_ground and not session.watch.is_open(Ending.FALLING)
        if preconditions is not None and session.monitor.on_ground is False:
            preconditions.look(meanwhile)  # first: what changed here is the cause of what the others see
        if aloft and follower.in_mission:
            guard.look()
        elif aloft and (follower.holds or follower.mode_is_unknown):
            guard.look_at_position()
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

    _until_disarmed(session, follower, look)
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
        if progress is not None and guard is not None and (follower.in_mission or follower.mode_is_unknown):
            progress.update()
            (guard.look if follower.in_mission else guard.look_at_position)()
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

    _until_disarmed(session, follower, look)
    return _fallen(session, follower)


def _until_disarmed(session: Session, follower: Follower, look: Callable[[], None]) -> None:
    while session.client.vehicle.armed or not _stays_disarmed(session):
        follower.step(look)
    follower.settle()


def _stays_disarmed(session: Session) -> bool:
    """Whether a second heartbeat says that a vehicle in the air is disarmed: the first may be another vehicle's."""
    beat_s, again = session.monitor.arrived_at_s(m.Heartbeat), Timer(session, FOLLOWING.second_beat_s)
    while session.monitor.on_ground is False and session.monitor.arrived_at_s(m.Heartbeat) == beat_s and not again.over:
        session.pump()
    return not session.client.vehicle.armed


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
        f"the vehicle landed and disarmed after {flown}, in {session.mode_name}{follower.unobserved}{session.recent_warnings}",
    )


def _fallen(session: Session, follower: Follower) -> str | None:
    """The way in which the disarmed vehicle came down without motors; None when it has landed.

    It is listened to until it lies still. Raises FlightFaultError: its positions were lost before, and neither is known.
    """
    monitor, timer = session.monitor, Timer(session, FOLLOWING.comes_to_rest_s)
    began_s = session.client.clock.now()
    while not (monitor.on_ground or timer.over or session.client.clock.now() - began_s > FOLLOWING.comes_to_rest_s):
        session.listen(FOLLOWING.look_s)
        settled = monitor.ground.is_still(monitor.time_s) and monitor.ground.reports_landed is not False
        if settled:
            break
    fall = monitor.ground.fall(follower.last_armed_s, monitor.time_s)
    if fall is not None:
        return f"disarmed {fall}"
    if session.watch.is_open(Ending.POSITION_LOST) and not monitor.on_ground:
        text = (
            f"{session.watch.text_of(Ending.POSITION_LOST)}; the vehicle disarmed, but whether it landed is not known"
        )
        raise FlightFaultError(Ending.POSITION_LOST, text)
    return "disarmed in the air" if monitor.on_ground is False and not monitor.ground.lies(monitor.time_s) else None


def longest_wait_s(plan: FlightPlan) -> float:
    """Longest time that an item of the mission lets the vehicle stay in one position."""
    waiting = (Command.NAV_WAYPOINT, Command.NAV_DELAY, Command.NAV_LOITER_TIME)
    return max((i.params[0] for i in plan.mission.items if i.command in waiting and i.params[0] > 0.0), default=0.0)


_REQUESTED = "the user stopped the flight a second time"

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
    for _ in range(FOLLOWING.most_returns):
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
                return _leave(session, _REQUESTED)
            why = session.watch.text_of(stop.cause)
            session.tell(EventKind.STOP, f"planning the return again: {why}")
        else:
            return True
    hold(session)
    return _leave(session, f"the return was interrupted {FOLLOWING.most_returns} times, most recently because {why}")


def _hold_and_plan(session: Session, plan_return: PlanReturn, stops: int, clear: Callable[[Mission], bool]) -> Mission:
    """Hold, and plan the return from there."""
    session.paused = False
    session.watch.rest()
    try:
        hold(session)
    except FlightFaultError as error:
        if error.ending is not Ending.FAILED:
            raise
        session.alarm(f"{error}; returning anyway")  # as in a strong wind
    if session.stop() > stops:
        raise _LeftHoldingError(_REQUESTED)
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
            raise _LeftHoldingError(_REQUESTED)
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
        raise _LeftHoldingError(_REQUESTED)
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
