"""Reactions of the mock vehicle to messages and commands, and to failures of position, battery, link or fence.

Whether and how it acts on a failure is set by its parameters, with the autopilots' own names, values and defaults.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from mission_io.autopilots.autopilot import Mode, mode_from_custom, mode_from_params
from mission_io.model.enums import CommandResult, Severity, VehicleClass
from mission_io.model.items import Command, Frame, GeoPoint, MissionItem
from mission_io.wire import messages as m
from mission_io.wire.messages import DEGREES_SCALE
from uavcover.mock.behaviour import BODY, TransferClock
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.itinerary import Step, StepKind, changed_speeds
from uavcover.mock.state import MockState
from uavcover.mock.telemetry import KIND_BY_ID, tell


@dataclass(frozen=True, slots=True)
class _Smart:
    """ArduCopter's SmartRTL, or another mode where that is not available."""

    otherwise: Mode


_RETURN, _LAND, _HOLD = Mode.RETURN, Mode.LAND, Mode.HOLD
_BATTERY_ACTIONS: Mapping[float, Mode | _Smart] = {
    1.0: _LAND, 2.0: _RETURN, 3.0: _Smart(_RETURN), 4.0: _Smart(_LAND), 6.0: _RETURN, 7.0: _HOLD,
}  # fmt: skip
_GCS_ACTIONS: Mapping[bool, Mapping[float, Mode | _Smart]] = {
    True: {
        1.0: _RETURN, 2.0: _RETURN, 3.0: _Smart(_RETURN), 4.0: _Smart(_LAND), 5.0: _LAND, 6.0: _RETURN, 7.0: _HOLD,
    },
    False: {1.0: _HOLD, 2.0: _RETURN, 3.0: _LAND},
}  # fmt: skip
_FENCE_ACTIONS: Mapping[bool, Mapping[float, Mode | _Smart]] = {
    True: {1.0: _RETURN, 2.0: _LAND, 3.0: _Smart(_RETURN), 4.0: _HOLD, 5.0: _Smart(_LAND)},
    False: {2.0: _HOLD, 3.0: _RETURN, 5.0: _LAND},
}
"""Parameter value to action; ArduPilot under True, PX4 under False. It knows no AUTO_RTL: then ArduPilot returns."""


class Failsafes:
    """Checks the vehicle a few times a second and remembers what it has reacted to."""

    def __init__(self, control: FlightControl) -> None:
        self._control, self._state = control, control.state
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a reboot."""
        self._position_lost_at_s: float | None = None
        self._heard_at_s: float | None = None
        self._charge_reported = 1.0
        self._done: set[str] = set()

    def hear_ground_station(self) -> None:
        """Note a ground station's heartbeat."""
        self._heard_at_s = self._state.time_s
        self._done.discard("ground station")

    def check(self) -> None:
        """Check everything once, and react."""
        self._check_position()
        self._check_battery()
        if self._state.flying:
            self._check_ground_station()
            self._check_fence()
        self._control.end_delay()

    @property
    def _delay_s(self) -> float:
        """Time of the hold before it returns or lands."""
        return 0.0 if self._state.is_ardupilot else self._state.parameters["COM_FAIL_ACT_T"]

    def _once(self, what: str) -> bool:
        """Whether this is the first reaction to a failure."""
        first = what not in self._done
        self._done.add(what)
        return first

    def _check_position(self) -> None:
        vehicle = self._state
        if not vehicle.body.believed.lost:
            self._position_lost_at_s = None
            self._done.discard("position")
            return
        if self._position_lost_at_s is None:
            self._position_lost_at_s = vehicle.time_s
        if vehicle.time_s >= self._position_lost_at_s + BODY.position_timeout_s and self._once("position"):
            self._control.fail_safe("EKF" if vehicle.is_ardupilot else "No position", Mode.LAND)

    def _check_battery(self) -> None:
        vehicle = self._state
        battery = vehicle.body.battery
        if battery.remaining <= 0.0 and vehicle.flying:
            vehicle.say(Severity.EMERGENCY, "Battery 1 is empty")
            self._control.disarm(force=True)
        for level, word, severity in (
            (BODY.failsafe_low_charge, "low", Severity.WARNING),
            (BODY.failsafe_critical_charge, "critical", Severity.CRITICAL),
        ):
            if battery.remaining <= level < self._charge_reported:
                self._charge_reported = level
                volts = f"Battery 1 is {word} {battery.voltage_v:.2f}V"
                vehicle.say(severity, volts if vehicle.is_ardupilot else f"{word.capitalize()} battery level")
        if not vehicle.flying:
            return
        for level, action in _battery_actions(vehicle):
            if battery.remaining <= level and self._once(f"battery {level} {action}"):
                self._act("Battery", action)

    def _act(self, what: str, action: Mode | _Smart) -> None:
        if isinstance(action, _Smart):
            self._control.fail_safe_smartly(what, action.otherwise)
        else:
            self._control.fail_safe(what, action, delay_s=self._delay_s)

    def _check_ground_station(self) -> None:
        vehicle = self._state
        ardupilot, get = vehicle.is_ardupilot, vehicle.parameters
        action = _GCS_ACTIONS[ardupilot].get(get["FS_GCS_ENABLE" if ardupilot else "NAV_DLL_ACT"])
        if action is None or self._heard_at_s is None:
            return
        timeout_s = get["FS_GCS_TIMEOUT" if ardupilot else "COM_DL_LOSS_T"]
        if vehicle.behaviour.transfer_clock is TransferClock.LINK:
            timeout_s *= vehicle.speed
        goes_on = (
            ardupilot and vehicle.mode is Mode.MISSION and int(get["FS_OPTIONS"]) & 2
        )  # bit: go on with the mission
        if vehicle.time_s >= self._heard_at_s + timeout_s and not goes_on and self._once("ground station"):
            self._act("GCS" if ardupilot else "Data link lost", action)

    def _check_fence(self) -> None:
        vehicle = self._state
        limit = vehicle.fence.breach()
        if limit is None:
            self._done.discard("fence")
        elif self._once("fence"):
            ardupilot = vehicle.is_ardupilot
            vehicle.say(Severity.CRITICAL, f"{limit} fence breached" if ardupilot else f"Geofence violation: {limit}")
            action = _FENCE_ACTIONS[ardupilot].get(vehicle.parameters["FENCE_ACTION" if ardupilot else "GF_ACTION"])
            if action is not None:
                self._act("Fence" if ardupilot else "Geofence", action)


def _battery_actions(vehicle: MockState) -> list[tuple[float, Mode | _Smart]]:
    """Battery failsafes: remaining charge (1 is full) below which the vehicle acts, and how."""
    get, battery = vehicle.parameters, vehicle.body.battery
    if vehicle.is_ardupilot:
        pairs = [(get["BATT_LOW_MAH"], get["BATT_FS_LOW_ACT"]), (get["BATT_CRT_MAH"], get["BATT_FS_CRT_ACT"])]
        found = [(mah / battery.capacity_mah if mah > 0.0 else -math.inf, _BATTERY_ACTIONS.get(a)) for mah, a in pairs]
        return [(level, action) for level, action in found if action is not None]
    action = get["COM_LOW_BAT_ACT"]
    if action == 2.0:
        return [(get["BAT_CRIT_THR"], Mode.LAND)]
    if action == 3.0:
        return [(get["BAT_CRIT_THR"], Mode.RETURN), (get["BAT_EMERGEN_THR"], Mode.LAND)]
    return []


Params = tuple[float, ...]


def answer_command(control: FlightControl, command: m.CommandLong | m.CommandInt) -> CommandResult:
    """Carry out a command and return the result to acknowledge."""
    if isinstance(command, m.CommandInt):
        if command.command == Command.DO_REPOSITION:
            return _reposition(control, command)
        position = (command.x / DEGREES_SCALE, command.y / DEGREES_SCALE, command.z)
        command = m.CommandLong(
            command.target_system, command.target_component, command.command, (*command.params, *position)
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
    return CommandResult.UNSUPPORTED if kind is None else _reported(control, kind)


def _reported(control: FlightControl, kind: type[m.Message]) -> CommandResult:
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
        vehicle.follow([Step(None, StepKind.GO, vehicle.settings.speeds, vehicle.position(item))])
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
    Command.GET_HOME_POSITION: lambda control, _: _reported(control, m.HomePosition),
    Command.REQUEST_AUTOPILOT_CAPABILITIES: lambda control, _: _reported(control, m.AutopilotVersion),
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
