"""What the mock vehicle does with messages and commands, and why it does not arm.

Why the mock vehicle does not arm, in the words of its autopilot.

What the mock vehicle does when it is commanded, and what it answers.

What the mock vehicle does with each kind of message that reaches it.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission_io.model.enums import CommandResult, VehicleClass
from mission_io.model.items import Command, Frame, MissionItem
from mission_io.wire import messages as m
from mission_io.wire.mission_items import DEGREES_SCALE
from uavcover.mock.faults import FaultKind
from uavcover.mock.itinerary import Step, StepKind, changed_speeds
from uavcover.mock.telemetry import KIND_BY_ID
from uavcover.vehicle.modes import Mode, mode_from_custom, mode_from_params

if TYPE_CHECKING:
    from uavcover.mock.vehicle import MockVehicle

_LOW_CHARGE = 0.1
_CRITICAL = 2
_ARMABLE = (Mode.MANUAL, Mode.GUIDED, Mode.HOLD)
"""ArduPilot's modes that can be armed in, of those that this vehicle has."""


def refusal_to_arm(vehicle: "MockVehicle") -> CommandResult | None:
    """What an arming is answered that is refused, with the reason said; None when nothing speaks against it."""
    ardupilot = vehicle.is_ardupilot
    reason = reason_not_to_arm(vehicle)
    if reason is not None:
        vehicle.say(_CRITICAL, reason)
        return CommandResult.FAILED if ardupilot else CommandResult.TEMPORARILY_REJECTED
    if vehicle.mode not in (_ARMABLE if ardupilot else tuple(Mode)):
        vehicle.say(_CRITICAL, f"Arm: {vehicle.mode.name} mode is not armable")
        return CommandResult.FAILED
    if vehicle.mode is Mode.MISSION and not vehicle.mission.there_is_one:
        vehicle.say(_CRITICAL, "Preflight Fail: no valid mission")
        return CommandResult.TEMPORARILY_REJECTED
    return None


def reason_not_to_arm(vehicle: "MockVehicle") -> str | None:
    """What it says when it refuses to be armed; None when nothing speaks against it."""
    if vehicle.faults.is_going_on(FaultKind.ARMING_REFUSED):
        return _REFUSED[vehicle.is_ardupilot]
    if not vehicle.has_fix:
        return _NO_FIX[vehicle.is_ardupilot]
    if not vehicle.ready:
        return _NO_POSITION[vehicle.is_ardupilot]
    if vehicle.body.battery.remaining < _LOW_CHARGE:
        return _LOW_BATTERY[vehicle.is_ardupilot]
    if vehicle.mission.needs_terrain:
        return "PreArm: waiting for terrain data"
    if (limit := vehicle.failsafes.breach(vehicle)) is not None:
        return _FENCE[vehicle.is_ardupilot].format(limit)
    return None


# ArduPilot's words under True, PX4's under False.
_REFUSED = {True: "Arm: Compass not healthy", False: "Arming denied: Resolve system health failures first"}
_NO_FIX = {True: "PreArm: GPS 1: Bad fix", False: "Preflight Fail: GPS fix too low"}
_NO_POSITION = {True: "PreArm: Need Position Estimate", False: "Preflight Fail: no position"}
_LOW_BATTERY = {True: "PreArm: Battery 1 below minimum arming capacity", False: "Preflight Fail: low battery"}
_FENCE = {True: "PreArm: Vehicle breaching {} fence", False: "Preflight Fail: Geofence violation: {}"}


Params = tuple[float, ...]
_FORCE_DISARM = 21196.0


def answer_command(vehicle: "MockVehicle", command: m.CommandLong | m.CommandInt) -> CommandResult:
    """Carry out a command and return what to answer."""
    if command.command == Command.DO_REPOSITION and isinstance(command, m.CommandInt):
        return _reposition(vehicle, command)
    handler = _HANDLERS.get(command.command)
    return CommandResult.UNSUPPORTED if handler is None else handler(vehicle, command.params)


def answer_parameter(vehicle: "MockVehicle", message: m.ParamRequestRead | m.ParamSet) -> m.ParamValue | None:
    """Read or set a parameter; None (silence) for one that does not exist."""
    index = message.index if isinstance(message, m.ParamRequestRead) else -1
    name = vehicle.parameters.name_of(message.name, index)
    if name is None:
        return None
    if isinstance(message, m.ParamSet):
        vehicle.parameters.set(name, message.value)
    return vehicle.parameters.message(name)


_STREAMS: dict[int, tuple[type[m.Message], ...]] = {
    2: (m.SysStatus, m.MissionCurrent, m.GpsRawInt, m.ExtendedSysState),
    6: (m.GlobalPositionInt,),
    10: (m.Attitude,),
    11: (m.VfrHud,),
    12: (m.SystemTime, m.EkfStatusReport, m.BatteryStatus, m.TerrainReport),
}
"""What ArduPilot has in each group (MAV_DATA_STREAM), of what this vehicle tells."""
_EVERY_STREAM = 0


def request_stream(vehicle: "MockVehicle", message: m.RequestDataStream) -> None:
    """Begin or end groups of messages, as ArduPilot does; PX4 knows no groups."""
    if not vehicle.is_ardupilot:
        return
    groups = _STREAMS.values() if message.stream == _EVERY_STREAM else [_STREAMS.get(message.stream, ())]
    interval_s = 1.0 / message.rate_hz if message.start and message.rate_hz > 0 else None
    for kind in (kind for group in groups for kind in group):
        vehicle.set_interval(kind, interval_s)


def _arm(vehicle: "MockVehicle", params: Params) -> CommandResult:
    if params[0] != 0.0:
        return vehicle.arm()
    return vehicle.disarm(force=len(params) > 1 and params[1] == _FORCE_DISARM)


def _set_mode(vehicle: "MockVehicle", params: Params) -> CommandResult:
    mode = mode_from_params(vehicle.autopilot, params)
    return CommandResult.DENIED if mode is None else vehicle.set_mode(mode)


def _start(vehicle: "MockVehicle", params: Params) -> CommandResult:
    del params
    return vehicle.start_mission()


def _pause_or_continue(vehicle: "MockVehicle", params: Params) -> CommandResult:
    return vehicle.set_mode(Mode.MISSION if params[0] == 1.0 else Mode.HOLD)


def _set_current(vehicle: "MockVehicle", params: Params) -> CommandResult:
    return vehicle.set_current(int(params[0]))


def _change_speed(vehicle: "MockVehicle", params: Params) -> CommandResult:
    vehicle.set_speeds(changed_speeds(vehicle.speeds, params))
    return CommandResult.ACCEPTED


def _message_interval(vehicle: "MockVehicle", params: Params) -> CommandResult:
    kind = KIND_BY_ID.get(int(params[0]))
    if kind is None or not math.isfinite(params[1]):
        return CommandResult.DENIED
    interval_us = params[1]
    # -1 is never, 0 the default.
    vehicle.set_interval(kind, None if interval_us < 0.0 else interval_us * 1e-6)
    return CommandResult.ACCEPTED


def _request_message(vehicle: "MockVehicle", params: Params) -> CommandResult:
    kind = KIND_BY_ID.get(int(params[0]))
    if kind is None:
        return CommandResult.UNSUPPORTED
    vehicle.tell(kind)
    return CommandResult.ACCEPTED


def _home(vehicle: "MockVehicle", params: Params) -> CommandResult:
    del params
    vehicle.tell(m.HomePosition)
    return CommandResult.ACCEPTED


def _capabilities(vehicle: "MockVehicle", params: Params) -> CommandResult:
    del params
    vehicle.tell(m.AutopilotVersion)
    return CommandResult.ACCEPTED


def _return(vehicle: "MockVehicle", params: Params) -> CommandResult:
    del params
    return vehicle.set_mode(Mode.RETURN)


def _land(vehicle: "MockVehicle", params: Params) -> CommandResult:
    del params
    return vehicle.set_mode(Mode.LAND)


def _take_off(vehicle: "MockVehicle", params: Params) -> CommandResult:
    """ArduPilot in GUIDED: to a height above home (param7). PX4: to a height above sea level, or its own default."""
    height_m = params[6] if len(params) > 6 else math.nan
    if vehicle.is_ardupilot:
        if vehicle.mode is not Mode.GUIDED or not math.isfinite(height_m):
            return CommandResult.FAILED
    elif math.isfinite(height_m):
        height_m -= vehicle.body.home.alt_amsl_m
    else:
        height_m = vehicle.parameters["MIS_TAKEOFF_ALT"]
    if not vehicle.armed or not height_m > 0.0:
        return CommandResult.FAILED
    if not vehicle.is_ardupilot:
        vehicle.mode = Mode.HOLD
    east, north, up = vehicle.body.home_m
    vehicle.stay_armed()
    vehicle.follow([Step(None, StepKind.CLIMB, vehicle.settings.speeds, (east, north, up + height_m))])
    return CommandResult.ACCEPTED


def _reposition(vehicle: "MockVehicle", command: m.CommandInt) -> CommandResult:
    """To a place, and stay there: ArduPilot in GUIDED, PX4 in HOLD."""
    if not vehicle.flying:
        return CommandResult.FAILED
    if command.frame not in _GLOBAL_FRAMES or not math.isfinite(command.z):
        return CommandResult.DENIED
    lat_deg, lon_deg = command.x / DEGREES_SCALE, command.y / DEGREES_SCALE
    frame = _GLOBAL_FRAMES[command.frame]
    item = MissionItem(Command.NAV_WAYPOINT, frame, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=command.z)
    result = vehicle.set_mode(Mode.GUIDED if vehicle.is_ardupilot else Mode.HOLD)
    if result is CommandResult.ACCEPTED:
        vehicle.follow([Step(None, StepKind.GO, vehicle.settings.speeds, vehicle.place(item))])
    return result


_GLOBAL_FRAMES = {0: Frame.AMSL, 5: Frame.AMSL, 3: Frame.ABOVE_HOME, 6: Frame.ABOVE_HOME}

_HANDLERS: dict[int, Callable[["MockVehicle", Params], CommandResult]] = {
    Command.COMPONENT_ARM_DISARM: _arm,
    Command.DO_SET_MODE: _set_mode,
    Command.MISSION_START: _start,
    Command.DO_PAUSE_CONTINUE: _pause_or_continue,
    Command.DO_SET_MISSION_CURRENT: _set_current,
    Command.DO_CHANGE_SPEED: _change_speed,
    Command.SET_MESSAGE_INTERVAL: _message_interval,
    Command.REQUEST_MESSAGE: _request_message,
    Command.GET_HOME_POSITION: _home,
    Command.REQUEST_AUTOPILOT_CAPABILITIES: _capabilities,
    Command.NAV_RETURN_TO_LAUNCH: _return,
    Command.NAV_LAND: _land,
    Command.NAV_TAKEOFF: _take_off,
}


def take(vehicle: "MockVehicle", received: m.Received) -> list[m.Message]:
    """Act on a message, and return what is answered at once."""
    message = received.message
    match message:
        case m.Heartbeat():
            if message.vehicle_type == VehicleClass.GROUND_STATION:
                vehicle.failsafes.hear_ground_station(vehicle)
        case m.CommandLong() | m.CommandInt():
            result = answer_command(vehicle, message)
            to = {"target_system": received.system_id, "target_component": received.component_id}
            return [m.CommandAck(message.command, result, **to)]
        case m.SetMode():
            mode = mode_from_custom(vehicle.autopilot, message.custom_mode)
            if mode is not None:
                vehicle.set_mode(mode)
        case m.MissionSetCurrent():
            vehicle.set_current(message.seq)
        case m.ParamRequestRead() | m.ParamSet():
            value = answer_parameter(vehicle, message)
            return [] if value is None else [value]
        case m.ParamRequestList():
            return list(vehicle.parameters.messages())
        case m.RequestDataStream():
            request_stream(vehicle, message)
        case m.TerrainData():
            if vehicle.terrain is not None:
                vehicle.terrain.take(message)
        case m.LogRequestList():
            return [m.LogEntry(log_id=0, log_count=0, last_log_id=0, time_unix_s=0, size_bytes=0)]  # it keeps none
        case _:
            return vehicle.take_mission_message(received)
    return []
