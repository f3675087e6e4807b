"""Follows a vehicle along its mission until it has landed and disarmed."""

from collections.abc import Callable

from mission_io.model.items import Command
from uavcover.flight.arming import hold_mode
from uavcover.flight.fall_watch import FallWatch
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.follower import Follower
from uavcover.flight.mission_guard import MissionGuard, VolumeWatch
from uavcover.flight.modes import Mode
from uavcover.flight.policy import reaction
from uavcover.flight.precautions import OnBreach
from uavcover.flight.preconditions import Preconditions
from uavcover.flight.progress import MissionProgress
from uavcover.flight.schedule import FlightSchedule, PhotoWatch
from uavcover.flight.session import Session, Stopped, Timer
from uavcover.flight.tuning import FOLLOWING
from uavcover.model.outcome import Ending, EventKind, FlightFaultError

_CHANGES = (Ending.MISSION_CHANGED, Ending.HOME_MOVED, Ending.SETTINGS_CHANGED, Ending.FENCE_CHANGED)
_LASTING = (
    *_CHANGES,
    Ending.WIND_ABOVE_LIMITS,
    Ending.OFF_ROUTE,
    Ending.FENCE_BREACHED,
    Ending.RESERVE_USED,
)


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
            follower.cause, f"{follower.why}; it did not complete its return, but landed and disarmed"
        )
    if guard is not None:
        guard.look_once_more()
    for kind in _CHANGES:
        if watch.is_open(kind) and kind not in known:
            raise FlightFaultError(kind, f"{watch.text_of(kind)}; on its return it landed and disarmed")
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
        raise FlightFaultError(follower.cause, f"{follower.why}; it landed and disarmed")
    session.tell(EventKind.STAGE, "disarmed")


def _judge(session: Session, plan: FlightPlan, progress: MissionProgress, follower: Follower) -> None:
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
