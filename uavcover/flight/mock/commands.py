"""What the mock vehicle does when it is commanded, and what it answers."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission_io import messages as m
from mission_io.enums import CommandResult
from mission_io.items import Command
from uavcover.flight.mock.itinerary import changed_speeds
from uavcover.flight.mock.settings import PARAMETERS, parameter, with_parameter
from uavcover.flight.mock.telemetry import KIND_BY_ID
from uavcover.flight.modes import Mode, mode_from_params

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

Params = tuple[float, ...]
_FORCE_DISARM = 21196.0


def answer_command(vehicle: "MockVehicle", command: m.CommandLong | m.CommandInt) -> CommandResult:
    """Carry out a command and return what to answer."""
    handler = _HANDLERS.get(command.command)
    return CommandResult.UNSUPPORTED if handler is None else handler(vehicle, command.params)


def answer_parameter(vehicle: "MockVehicle", message: m.ParamRequestRead | m.ParamSet) -> m.ParamValue | None:
    """Read or set a parameter; None (silence) for one that does not exist."""
    number = vehicle.autopilot.mav_autopilot
    names = list(PARAMETERS[number])
    name = message.name
    if isinstance(message, m.ParamRequestRead) and 0 <= message.index < len(names):
        name = names[message.index]
    if name not in names:
        return None
    if isinstance(message, m.ParamSet):
        vehicle.settings = with_parameter(vehicle.settings, number, name, message.value)
    value = parameter(vehicle.settings, number, name)
    return None if value is None else m.ParamValue(name, value, 9, len(names), names.index(name))


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
}
