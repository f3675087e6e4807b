"""Commands, modes and parameters over a connection. Requests are repeated on silence; every refusal is a named error."""

from collections.abc import Callable
from typing import TypeVar

from mission_io.client.connection import Connection, VehicleInfo
from mission_io.errors import CommandRefusedError, MisuseError
from mission_io.model.enums import AutopilotId, CommandResult
from mission_io.model.items import Command
from mission_io.protocol.timing import CALLS
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from mission_io.wire.mission_items import float32

MessageT = TypeVar("MessageT", bound=m.Message)


def send_command(connection: Connection, command: int, params: tuple[float, ...], *, timeout_s: float) -> m.CommandAck:
    """Send a COMMAND_LONG repeatedly until answered, with an increasing confirmation.

    Raises:
        MisuseError: more than seven parameters.
        CommandRefusedError: any answer but ACCEPTED; IN_PROGRESS is waited for.
        VehicleSilentError: no final answer within ``timeout_s`` seconds.
    """
    if len(params) > 7:
        raise MisuseError(f"command {name_of(command)} has {len(params)} parameters, but the maximum is 7")
    p1, p2, p3, p4, p5, p6, p7 = (*params, *(0.0,) * (7 - len(params)))
    to = connection.vehicle.address

    def send(attempt: int) -> None:
        connection.send(m.CommandLong(*to, command, (p1, p2, p3, p4, p5, p6, p7), confirmation=min(attempt, 255)))

    return _await_answer(connection, command, send, timeout_s)


def send_command_int(connection: Connection, message: m.CommandInt, *, timeout_s: float) -> m.CommandAck:
    """Send a COMMAND_INT repeatedly until answered; errors as ``send_command``."""
    return _await_answer(connection, message.command, lambda _: connection.send(message), timeout_s)


def _await_answer(connection: Connection, command: int, send: Callable[[int], None], timeout_s: float) -> m.CommandAck:
    started = False

    def answers(received: m.Received) -> bool:
        nonlocal started
        ack = received.message
        if not isinstance(ack, m.CommandAck) or ack.command != command:
            return False
        if ack.target_system not in (0, connection.local.system_id):
            return False
        started = started or ack.result == CommandResult.IN_PROGRESS
        return ack.result != CommandResult.IN_PROGRESS

    def ask(attempt: int) -> None:
        if not started:  # a command in progress must not be repeated
            send(attempt)

    what = f"an answer to command {name_of(command)}"
    ack = connection.wait_until(answers, timeout_s=timeout_s, what=what, again=ask, again_s=CALLS.resend_s).message
    if not isinstance(ack, m.CommandAck):
        raise MisuseError(f"{ack} is not an answer to a command")
    if ack.result != CommandResult.ACCEPTED:
        raise refusal(connection.vehicle.system_id, ack)
    return ack


def refusal(system_id: int, ack: m.CommandAck) -> CommandRefusedError:
    """The error for a command answer other than ACCEPTED."""
    result = name_of_result(ack.result)
    return CommandRefusedError(
        f"vehicle {system_id} answered {name_of(ack.command)} with {result}",
        command=ack.command,
        result=ack.result,
        result_name=result,
    )


def set_mode(connection: Connection, custom_mode: int, *, timeout_s: float) -> None:
    """Change the flight mode and wait until the vehicle's heartbeat shows it.

    Raises:
        CommandRefusedError: the vehicle refuses that mode now.
        VehicleSilentError: no answer, or no heartbeat with that mode, within ``timeout_s`` seconds each.
    """
    send_command(connection, Command.DO_SET_MODE, mode_params(connection.vehicle, custom_mode), timeout_s=timeout_s)
    await_mode(connection, custom_mode, timeout_s=timeout_s)


def mode_params(vehicle: VehicleInfo, custom_mode: int) -> tuple[float, ...]:
    """The parameters of DO_SET_MODE for a vehicle's flight mode."""
    if vehicle.mav_autopilot == AutopilotId.PX4:  # PX4 packs main and sub mode in the upper bytes
        return 1.0, float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24 & 0xFF)
    return 1.0, float(custom_mode)


def await_mode(connection: Connection, custom_mode: int, *, timeout_s: float) -> None:
    """Wait until the vehicle's heartbeat shows a flight mode.

    Raises:
        VehicleSilentError: none with that mode within ``timeout_s`` seconds.
    """
    if connection.vehicle.custom_mode == custom_mode:
        return
    connection.wait_until(
        lambda received: isinstance(received.message, m.Heartbeat) and connection.vehicle.custom_mode == custom_mode,
        timeout_s=timeout_s,
        what=f"a heartbeat in mode {custom_mode}",
    )


def request_message_interval(
    connection: Connection, kind: type[m.Message], interval_s: float, *, timeout_s: float
) -> m.CommandAck:
    """Request a message at an interval of ``interval_s`` seconds; errors as ``send_command``."""
    params = (float(message_id(kind)), interval_s * 1e6)
    return send_command(connection, Command.SET_MESSAGE_INTERVAL, params, timeout_s=timeout_s)


def request_message(connection: Connection, kind: type[MessageT], *, timeout_s: float) -> MessageT:
    """Request a message once and wait for it.

    Raises:
        VehicleSilentError: none came within ``timeout_s`` seconds.
    """
    to = connection.vehicle

    def ask(attempt: int) -> None:
        connection.send(message_question(to, kind, attempt))

    return _await_message(connection, kind, lambda _: True, ask, timeout_s=timeout_s, what=f"a {kind.__name__}")


def message_question(to: VehicleInfo, kind: type[MessageT], attempt: int = 0) -> m.CommandLong:
    """The command that requests a message of a kind once."""
    params = (float(message_id(kind)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return m.CommandLong(*to.address, Command.REQUEST_MESSAGE, params, confirmation=min(attempt, 255))


def read_parameter(connection: Connection, name: str, *, timeout_s: float) -> m.ParamValue:
    """Read a parameter by its name.

    Raises:
        VehicleSilentError: no answer within ``timeout_s`` seconds, as for a parameter that does not exist.
    """
    ask = m.ParamRequestRead(*connection.vehicle.address, name)
    return _await_parameter(connection, name, ask, timeout_s)


def set_parameter(
    connection: Connection, name: str, value: float, *, param_type: int = 9, timeout_s: float
) -> m.ParamValue:
    """Set a parameter and wait for the vehicle to report its value.

    Raises:
        MisuseError: the vehicle answered with another value than the 32-bit float nearest to ``value``.
        VehicleSilentError: no answer within ``timeout_s`` seconds, as for a parameter that does not exist.
    """
    ask = m.ParamSet(*connection.vehicle.address, name, value, param_type)
    answer = _await_parameter(connection, name, ask, timeout_s)
    if answer.value != float32(value):
        raise MisuseError(f"{name} was set to {value:g}, but is {answer.value:g}; the vehicle limits or refuses it")
    return answer


def _await_parameter(
    connection: Connection, name: str, ask: m.ParamRequestRead | m.ParamSet, timeout_s: float
) -> m.ParamValue:
    return _await_message(
        connection, m.ParamValue, lambda value: value.name == name, lambda _: connection.send(ask),
        timeout_s=timeout_s, what=f"parameter {name}",
    )  # fmt: skip


def _await_message(
    connection: Connection,
    kind: type[MessageT],
    accept: Callable[[MessageT], bool],
    ask: Callable[[int], None],
    *,
    timeout_s: float,
    what: str,
) -> MessageT:
    """Ask, again after each silence, until a message of a kind comes that ``accept`` takes; it."""
    found: list[MessageT] = []

    def is_it(received: m.Received) -> bool:
        if isinstance(received.message, kind) and accept(received.message):
            found.append(received.message)
        return bool(found)

    connection.wait_until(is_it, timeout_s=timeout_s, what=what, again=ask, again_s=CALLS.resend_s)
    return found[0]


def name_of(command: int) -> str:
    """A command's name where mission_io knows it, and its number."""
    known = command in Command._value2member_map_
    return f"{Command(command).name} ({command})" if known else str(command)


def name_of_result(result: int) -> str:
    """A MAV_RESULT's name where mission_io knows it, or its number."""
    return CommandResult(result).name if result in CommandResult._value2member_map_ else str(result)
