"""Make a vehicle ready, arm, start and disarm it, in the order that each autopilot requires; every (dis)arm command is here.

Ready: telemetry rates, the vehicle's own checks, its home, and the mission that it holds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mission_io.autopilots.autopilot import Mode
from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.autopilots.mission_lists import wire_items
from mission_io.errors import CommandRefusedError
from mission_io.model.enums import CommandResult, GpsFix
from mission_io.model.items import Command, GeoPoint, MissionType
from mission_io.wire import messages as m
from mission_io.wire.messages import MissionCurrent
from uavcover.errors import VehicleError
from uavcover.flight.orders import PREPARATION, FlightPlan, require_one_vehicle
from uavcover.flight.session import (
    Session,
    Stopped,
    TakenOverError,
    Timer,
    first_seq,
    hold_mode,
    set_current_item,
    set_mode,
)
from uavcover.flight.watch import has_position
from uavcover.model.track import Ending, EventKind, FlightFaultError
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True)
class _Stream:
    """A kind of message that following needs."""

    interval_s: float  # the requested interval
    least_hz: float  # required rate, in the vehicle's time


_STREAMS: dict[type[m.Message], _Stream] = {
    m.GlobalPositionInt: _Stream(0.1, 5.0),
    m.Attitude: _Stream(0.1, 2.0),
    m.MissionCurrent: _Stream(0.2, 0.4),
    m.ExtendedSysState: _Stream(0.5, 0.4),
    m.SysStatus: _Stream(1.0, 0.2),
    m.GpsRawInt: _Stream(1.0, 0.2),
}
_OF_ARDUPILOT: dict[type[m.Message], _Stream] = {m.EkfStatusReport: _Stream(1.0, 0.2)}
_UNASKED_OF_PX4 = frozenset({m.MissionCurrent})
"""PX4 sends these unasked, and answers a request with FAILED."""
_PREARM_CHECKS = 401


def request_telemetry(session: Session) -> None:
    """Request the telemetry that following needs. A refusal is only a warning: the rates are checked later."""
    _request(session, _streams(session))


def check_telemetry(session: Session) -> None:
    """Measure the telemetry rates that following needs, and request rare messages again.

    Raises:
        FlightFaultError: a kind of message does not arrive, or too rarely; the error names it.
    """
    wanted = _streams(session)
    rare = _rare(session, wanted)
    for _ in range(PREPARATION.telemetry_tries - 1):
        if not rare:
            return
        again = {kind: wanted[kind] for kind in rare}
        _request(session, again)
        rare = _rare(session, again)
    if not rare:
        return
    measured = " and ".join(f"{kind.__name__} {rate_hz:.1f} times a second" for kind, rate_hz in rare.items())
    needed = " and ".join(f"{wanted[kind].least_hz:g}" for kind in rare)
    raise FlightFaultError(
        Ending.NOT_READY,
        f"after {PREPARATION.telemetry_tries} requests, the vehicle sends {measured} of vehicle time, but following "
        f"the flight requires {needed}; the flight was not started: raise the autopilot's rate, or use a faster link",
    )


def _streams(session: Session) -> dict[type[m.Message], _Stream]:
    return {**_STREAMS, **(_OF_ARDUPILOT if session.is_ardupilot else {})}


def _request(session: Session, streams: Mapping[type[m.Message], _Stream]) -> None:
    for kind, stream in streams.items():
        if session.is_px4 and kind in _UNASKED_OF_PX4:
            continue
        try:
            session.client.request_message_interval(kind, stream.interval_s)
        except CommandRefusedError as error:
            text = f"{kind.__name__} every {stream.interval_s:g} s: the vehicle answered {error.result_name}"
            session.warn(text)


def _rare(session: Session, streams: Mapping[type[m.Message], _Stream]) -> dict[type[m.Message], float]:
    """The kinds of messages below the needed rate, with their rates; rare kinds get the time for three."""
    monitor = session.monitor
    before, began_s = monitor.counts.copy(), monitor.time_s
    window_s = max(session.timeouts.rate_s, 3.0 * max(stream.interval_s for stream in streams.values()))
    timer = Timer(session, window_s)
    while not timer.over:
        if session.stop():
            raise Stopped
        session.pump()
    elapsed_s = window_s if began_s is None or monitor.time_s is None else monitor.time_s - began_s
    rates_hz = {kind: (monitor.counts[kind] - before[kind]) / max(elapsed_s, window_s) for kind in streams}
    return {kind: rate_hz for kind, rate_hz in rates_hz.items() if rate_hz < streams[kind].least_hz}


def wait_until_ready(session: Session) -> None:
    """Wait until the vehicle can be armed, and its telemetry is frequent enough.

    ArduPilot's pre-arm bit is good about 18 s before arming works, so its position filter must also agree. The reasons for not
    being ready are requested repeatedly and reported.

    Raises:
        FlightFaultError: it does not get ready; the message names what is missing.
    """
    session.tell(EventKind.STAGE, "waiting until the vehicle is ready")
    requested = _Reasons(session)

    def ready() -> bool:
        lacks = missing(session)
        if lacks:
            requested.ask()
        return not lacks

    session.wait(
        ready,
        timeout_s=session.timeouts.ready_s,
        what=lambda: f"vehicle {session.client.vehicle.system_id} has no {' and no '.join(missing(session))}",
        stops_before=0,
        ending=Ending.NOT_READY,
    )
    check_telemetry(session)
    require_one_vehicle(session.client, session.monitor)
    session.tell(EventKind.STAGE, "the vehicle is ready")


class _Reasons:
    """Ask a vehicle periodically why it cannot be armed, unless it does not support the question."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._timer = Timer(session, PREPARATION.ask_why_s)
        self._knows = session.is_ardupilot

    def ask(self) -> None:
        """Ask, if it is time to."""
        if not self._knows or not self._timer.over:
            return
        self._timer.restart()
        try:
            self._session.client.command(_PREARM_CHECKS)
        except CommandRefusedError as error:
            self._knows = error.result != CommandResult.UNSUPPORTED


def missing(session: Session) -> list[str]:
    """Preconditions of arming that are missing; empty when the vehicle is ready."""
    monitor = session.monitor
    lacks: list[str] = []
    gps = monitor.latest(m.GpsRawInt)
    if gps is None or gps.fix_type < GpsFix.FIX_3D:
        lacks.append("satellite fix")
    if session.is_ardupilot:
        ekf = monitor.latest(m.EkfStatusReport)
        if ekf is None or not has_position(ekf):
            lacks.append("position estimate")
    status = monitor.latest(m.SysStatus)
    checked = m.PREARM_CHECK_BIT
    if status is None or (status.sensors_present & checked and not status.sensors_healthy & checked):
        lacks.append("passed pre-arm check")
    if monitor.latest(m.GlobalPositionInt) is None:
        shared = " with agreeing times (two vehicles may share this system ID)" if monitor.doubts_positions else ""
        lacks.append(f"position messages{shared}")
    return lacks


def check_home(session: Session, plan: FlightPlan) -> None:
    """Refuse a vehicle that is not, or whose home is not, at the planned start of the mission.

    Heights above home would be wrong by the difference. ArduPilot sets home again when it arms, so both count.

    Raises:
        VehicleError: it is too far away, over ground or in height.
    """
    check_home_position(session, plan)
    here = session.monitor.latest(m.GlobalPositionInt)
    if here is not None:
        _check_position(plan, "position", GeoPoint(here.lat_deg, here.lon_deg, here.alt_amsl_m))


def check_home_position(session: Session, plan: FlightPlan) -> None:
    """Refuse a vehicle whose home is not the planned one, or not on the terrain there.

    Raises:
        VehicleError: it is too far away, over ground or in height.
    """
    home = session.client.request_message(m.HomePosition)
    _check_position(plan, "home", GeoPoint(home.lat_deg, home.lon_deg, home.alt_amsl_m))
    most_m = plan.max_home_error_m
    if plan.ground_alt_amsl_m is not None and abs(home.alt_amsl_m - plan.ground_alt_amsl_m) > most_m:
        raise VehicleError(
            f"the vehicle's home is at {home.alt_amsl_m:.1f} m above sea level and the terrain there at "
            f"{plan.ground_alt_amsl_m:.1f} m, but max_home_error_m is {most_m:g}; the flight was not started: check "
            "the vertical datum"
        )


def _check_position(plan: FlightPlan, name: str, position: GeoPoint) -> None:
    frame = LocalFrame(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)
    most_m = plan.max_home_error_m
    east, north, up = frame.enu_from_geodetic(position.lat_deg, position.lon_deg, position.alt_amsl_m)[0].tolist()
    aside_m = math.hypot(east, north)
    where = f"the vehicle's {name} (latitude {position.lat_deg:.7f}, longitude {position.lon_deg:.7f})"
    if aside_m > most_m:
        raise VehicleError(
            f"{where} is {aside_m:.1f} m from the planned home, but max_home_error_m is {most_m:g}, so the vehicle "
            "was not armed: move it, or plan for this home"
        )
    if abs(up) > most_m:
        raise VehicleError(
            f"{where} is at {position.alt_amsl_m:.1f} m above sea level, {abs(up):.1f} m "
            f"{'above' if up > 0 else 'below'} the planned home, but max_home_error_m is {most_m:g}, so the vehicle "
            "was not armed: all heights above home would be wrong by this amount"
        )


def check_mission(session: Session, plan: FlightPlan) -> None:
    """Refuse a vehicle that holds another mission than the planned one.

    Raises:
        VehicleError: it holds none, or another one; the message names the largest difference.
    """
    autopilot = session.autopilot
    wanted = wire_items(plan.mission, autopilot)
    held = session.client.download(MissionType.MISSION)
    wrong = fault_text(compare_items(wanted, held, autopilot))
    if wrong is not None:
        raise VehicleError(
            f"the mission on the vehicle differs from the plan ({wrong}), so the vehicle was not "
            "armed; upload the mission first"
        )


_LACKS_TERRAIN = "terrain data"
"""Words of ArduPilot's refusal, "PreArm: waiting for terrain data"."""
_AGAIN = (CommandResult.TEMPORARILY_REJECTED, CommandResult.FAILED)


def arm_and_start(session: Session) -> None:
    """Arm, start the mission, and wait until the vehicle has left the ground.

    ArduPilot: GUIDED, arm, AUTO, MISSION_START. PX4: mission mode, then arm, which starts it.

    Raises:
        TakenOverError: something else controls it, or its state stays unknown; no further command was sent.
        FlightFaultError: it refuses to arm, or does not leave the ground.
        mission_io.errors.CommandRefusedError: it refuses another step.
        Stopped: the user asked to stop; it may be armed.
    """
    require_one_vehicle(session.client, session.monitor)
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


def disarm_on_ground(session: Session) -> bool:
    """Disarm a vehicle that stands on the ground.

    Returns:
        Whether it is disarmed. False if it refuses, because it has just left the ground, or if its reports, height and motion do
        not
        all show it on the ground.
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
        self._requested_count = len(session.monitor.terrain_requested)
        self._any = Timer(session, session.timeouts.arm_s)
        self._terrain = Timer(session, session.timeouts.terrain_s)

    @property
    def over(self) -> bool:
        """Whether the next refusal is the last."""
        requested_count = len(self._session.monitor.terrain_requested)
        if requested_count > self._requested_count:
            self._requested_count = requested_count
            self._terrain.restart()
        lacks_terrain = requested_count > 0 and _LACKS_TERRAIN in self._session.recent_warnings
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
        ending=Ending.ARMING_REFUSED,  # the user's stop waits for it: a vehicle that may be unarmed is not disarmed
    )
