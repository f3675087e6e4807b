"""Reactions and answers of the mock vehicle to each message and command."""

import math
from collections.abc import Callable
from dataclasses import replace

from mission_io.autopilots.autopilot import Mode, mode_from_custom, mode_from_params
from mission_io.model.enums import CommandResult, VehicleClass
from mission_io.model.items import Command, Frame, GeoPoint, MissionItem
from mission_io.wire import messages as m
from mission_io.wire.mission_items import DEGREES_SCALE
from uavcover.mock.failsafes import Failsafes
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.itinerary import Step, StepKind, changed_speeds
from uavcover.mock.state import MockState
from uavcover.mock.telemetry import KIND_BY_ID, tell

Params = tuple[float, ...]


def answer_command(control: FlightControl, command: m.CommandLong | m.CommandInt) -> CommandResult:
    """Carry out a command and return the result to acknowledge."""
    if isinstance(command, m.CommandInt):
        if command.command == Command.DO_REPOSITION:
            return _reposition(control, command)
        place = (command.x / DEGREES_SCALE, command.y / DEGREES_SCALE, command.z)
        command = m.CommandLong(
            command.target_system, command.target_component, command.command, (*command.params, *place)
        )
    handler = _HANDLERS.get(command.command)
    return CommandResult.UNSUPPORTED if handler is None else handler(control, command.params)


def answer_parameter(vehicle: MockState, message: m.ParamRequestRead | m.ParamSet) -> m.ParamValue | None:
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
    12: (m.SystemTime, m.EkfStatusReport, m.BatteryStatus, m.TerrainReport, m.TerrainRequest),
}
"""The messages of this vehicle in each of ArduPilot's groups (MAV_DATA_STREAM)."""


def request_stream(vehicle: MockState, message: m.RequestDataStream) -> None:
    """Start or stop groups of messages, as ArduPilot does; PX4 has no groups."""
    if not vehicle.is_ardupilot:
        return
    groups = _STREAMS.values() if message.stream == 0 else [_STREAMS.get(message.stream, ())]
    interval_s = 1.0 / message.rate_hz if message.start and message.rate_hz > 0 else None
    for kind in (kind for group in groups for kind in group):
        vehicle.set_interval(kind, interval_s)


def _arm(control: FlightControl, params: Params) -> CommandResult:
    if params[0] != 0.0:
        return control.arm()
    return control.disarm(force=len(params) > 1 and params[1] == 21196.0)  # MAVLink: force


def _change_mode(control: FlightControl, mode: Mode | None, number: int) -> CommandResult:
    """Change the mode, and keep ArduPilot's number of it: BRAKE holds as LOITER, and cannot be armed in."""
    if mode is None:
        return CommandResult.DENIED
    return control.set_mode(mode, number=number if control.state.is_ardupilot else None)


def _start(control: FlightControl, params: Params) -> CommandResult:
    if control.state.is_ardupilot and any(params[:2]):
        return CommandResult.DENIED  # it knows no first and last item
    return control.start_mission()


def _change_speed(control: FlightControl, params: Params) -> CommandResult:
    control.set_speeds(changed_speeds(control.state.speeds, params))
    return CommandResult.ACCEPTED


def _message_interval(control: FlightControl, params: Params) -> CommandResult:
    kind = KIND_BY_ID.get(int(params[0]))
    if kind is None or not math.isfinite(params[1]):
        return CommandResult.DENIED
    interval_us = params[1]
    # -1 stops the stream, 0 is the default rate.
    control.state.set_interval(kind, None if interval_us < 0.0 else interval_us * 1e-6)
    return CommandResult.ACCEPTED


def _request_message(control: FlightControl, params: Params) -> CommandResult:
    kind = KIND_BY_ID.get(int(params[0]))
    return CommandResult.UNSUPPORTED if kind is None else _told(control, kind)


def _told(control: FlightControl, kind: type[m.Message]) -> CommandResult:
    tell(control.state, kind)
    return CommandResult.ACCEPTED


def _set_home(control: FlightControl, params: Params) -> CommandResult:
    lat_deg, lon_deg, alt_m = params[4:7]
    if params[0] == 1.0:
        return control.set_home(None)
    known = all(map(math.isfinite, (lat_deg, lon_deg, alt_m))) and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
    return control.set_home(GeoPoint(lat_deg, lon_deg, alt_m)) if known else CommandResult.DENIED


def _fence(control: FlightControl, params: Params) -> CommandResult:
    if not control.state.is_ardupilot:
        return CommandResult.UNSUPPORTED
    control.state.fence.switched_off = params[0] == 0.0
    return CommandResult.ACCEPTED


def _take_off(control: FlightControl, params: Params) -> CommandResult:
    """Take off: ArduPilot in GUIDED to a height above home (param7); PX4 to an altitude, or its default."""
    vehicle = control.state
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


def _reposition(control: FlightControl, command: m.CommandInt) -> CommandResult:
    """Fly to a position and stay there: ArduPilot in GUIDED, PX4 in HOLD."""
    vehicle = control.state
    if not vehicle.flying:
        return CommandResult.FAILED
    if command.frame not in _GLOBAL_FRAMES or not math.isfinite(command.z):
        return CommandResult.DENIED
    lat_deg, lon_deg = command.x / DEGREES_SCALE, command.y / DEGREES_SCALE
    frame = _GLOBAL_FRAMES[command.frame]
    item = MissionItem(Command.NAV_WAYPOINT, frame, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=command.z)
    result = control.set_mode(Mode.GUIDED if vehicle.is_ardupilot else Mode.HOLD)
    if result is CommandResult.ACCEPTED:
        vehicle.follow([Step(None, StepKind.GO, vehicle.settings.speeds, vehicle.place(item))])
    return result


_GLOBAL_FRAMES = {0: Frame.AMSL, 5: Frame.AMSL, 3: Frame.ABOVE_HOME, 6: Frame.ABOVE_HOME}

_HANDLERS: dict[int, Callable[[FlightControl, Params], CommandResult]] = {
    Command.COMPONENT_ARM_DISARM: _arm,
    Command.DO_SET_MODE: lambda control, params: _change_mode(
        control, mode_from_params(control.state.autopilot, params), int(params[1])
    ),
    Command.MISSION_START: _start,
    Command.DO_PAUSE_CONTINUE: lambda control, params: control.set_mode(
        Mode.MISSION if params[0] == 1.0 else Mode.HOLD
    ),
    Command.DO_SET_MISSION_CURRENT: lambda control, params: control.set_current(int(params[0])),
    Command.DO_CHANGE_SPEED: _change_speed,
    Command.SET_MESSAGE_INTERVAL: _message_interval,
    Command.REQUEST_MESSAGE: _request_message,
    Command.DO_SET_HOME: _set_home,
    Command.DO_FENCE_ENABLE: _fence,
    Command.GET_HOME_POSITION: lambda control, _: _told(control, m.HomePosition),
    Command.REQUEST_AUTOPILOT_CAPABILITIES: lambda control, _: _told(control, m.AutopilotVersion),
    Command.NAV_RETURN_TO_LAUNCH: lambda control, _: control.set_mode(Mode.RETURN),
    Command.NAV_LAND: lambda control, _: control.set_mode(Mode.LAND),
    Command.NAV_TAKEOFF: _take_off,
}


def handle(control: FlightControl, failsafes: Failsafes, received: m.Received) -> list[m.Message]:
    """Act on a message and return the immediate answers."""
    vehicle, message = control.state, received.message
    match message:
        case m.Heartbeat():
            counts = not vehicle.is_ardupilot or received.system_id == vehicle.parameters["MAV_GCS_SYSID"]
            if message.vehicle_type == VehicleClass.GROUND_STATION and counts:
                failsafes.hear_ground_station()
        case m.TimeSync():
            return [replace(message, answered_ns=round(vehicle.time_s * 1e9) or 1)] if message.answered_ns == 0 else []
        case m.CommandLong() | m.CommandInt():
            result = answer_command(control, message)
            to = {"target_system": received.system_id, "target_component": received.component_id}
            return [m.CommandAck(message.command, result, **to)]
        case m.SetMode():
            _change_mode(control, mode_from_custom(vehicle.autopilot, message.custom_mode), message.custom_mode)
        case m.MissionSetCurrent():
            control.set_current(message.seq)
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
        case m.FileTransfer():
            back = received.sender
            answers = vehicle.files.answer(message.payload)
            control.apply_mission_changes()  # one of its lists may have come as a file
            return [m.FileTransfer(*back, payload) for payload in answers]
        case m.LogRequestList():
            return [m.LogEntry(log_id=0, log_count=0, last_log_id=0, time_unix_s=0, size_bytes=0)]  # it keeps no logs
        case _:
            return control.take_mission_message(received)
    return []
