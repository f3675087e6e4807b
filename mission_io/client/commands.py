"""Commands, modes and parameters over a connection. Requests are repeated on silence; every refusal is a named error."""

from collections.abc import Callable, Collection, Mapping
from typing import TypeVar

from mission_io.client.connection import Connection, Progress, Stop
from mission_io.client.peers import VehicleInfo
from mission_io.errors import CommandRefusedError, MisuseError, VehicleSilentError, WaitCancelledError
from mission_io.model.enums import AutopilotId, Capability, CommandResult
from mission_io.model.items import Command
from mission_io.protocol.parameters import (
    Parameter,
    ParameterDownload,
    ParameterMessages,
    ParameterReads,
    ParameterWrites,
    Value,
)
from mission_io.protocol.timing import CALLS
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from mission_io.wire.messages import Address, AutopilotVersion, float32

MessageT = TypeVar("MessageT", bound=m.Message)


def send_command(
    connection: Connection, command: int, *params: float, timeout_s: float = CALLS.answer_s
) -> m.CommandAck:
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
    started = False

    def is_answer(ack: m.CommandAck) -> bool:
        nonlocal started
        if ack.command != command or ack.target_system not in (0, connection.local.system_id):
            return False
        started = started or ack.result == CommandResult.IN_PROGRESS
        return ack.result != CommandResult.IN_PROGRESS

    def ask(attempt: int) -> None:
        if not started:  # a command in progress must not be repeated
            connection.send(m.CommandLong(*to, command, (p1, p2, p3, p4, p5, p6, p7), confirmation=min(attempt, 255)))

    what = f"an answer to command {name_of(command)}"
    ack = _await_message(connection, m.CommandAck, is_answer, ask, timeout_s=timeout_s, what=what)
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


def set_mode(connection: Connection, custom_mode: int, *, timeout_s: float = CALLS.answer_s) -> None:
    """Change the flight mode and wait until the vehicle's heartbeat shows it.

    Raises:
        CommandRefusedError: the vehicle refuses that mode now.
        VehicleSilentError: no answer, or no heartbeat with that mode, within ``timeout_s`` seconds each.
    """
    send_command(connection, Command.DO_SET_MODE, *mode_params(connection.vehicle, custom_mode), timeout_s=timeout_s)
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
    connection: Connection, kind: type[m.Message], interval_s: float, *, timeout_s: float = CALLS.answer_s
) -> m.CommandAck:
    """Request a message at an interval of ``interval_s`` seconds; errors as ``send_command``."""
    numbers = float(message_id(kind)), interval_s * 1e6
    return send_command(connection, Command.SET_MESSAGE_INTERVAL, *numbers, timeout_s=timeout_s)


def request_message(connection: Connection, kind: type[MessageT], *, timeout_s: float = CALLS.answer_s) -> MessageT:
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


def read_parameter(connection: Connection, name: str, *, timeout_s: float = CALLS.answer_s) -> m.ParamValue:
    """Read a parameter by its name.

    Raises:
        VehicleSilentError: no answer within ``timeout_s`` seconds, as for a parameter that does not exist.
    """
    ask = m.ParamRequestRead(*connection.vehicle.address, name)
    return _await_parameter(connection, name, ask, timeout_s)


def set_parameter(
    connection: Connection, name: str, value: float, *, param_type: int = 9, timeout_s: float = CALLS.answer_s
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


# A vehicle's parameters: all, some by name or prefix, and setting with confirmation. Extended ones of cameras as well.


class VehicleParameters:
    """The parameters of a client's vehicle, in their own units and types.

    Args:
        client: Has found its vehicle.
        component_id: Whose; None for the autopilot. Cameras have 100 to 105.
        extended: Whether that component has extended parameters (PARAM_EXT_*).
        bytewise: Whether whole numbers travel by their bits, or as floats of the same value; None takes what is known of the
            autopilot, and asks an unknown one.

    Raises:
        MisuseError: an autopilot that is not known and does not say how it encodes whole numbers.
    """

    def __init__(
        self,
        client: Connection,
        *,
        component_id: int | None = None,
        extended: bool = False,
        bytewise: bool | None = None,
    ) -> None:
        self._client = client
        vehicle = client.vehicle
        if bytewise is None:
            bytewise = False if extended else _is_bytewise(client)
        to = Address(vehicle.system_id, vehicle.component_id if component_id is None else component_id)
        self._messages = ParameterMessages(to, bytewise=bytewise, extended=extended)

    def all(
        self, *, prefix: str = "", progress: Progress | None = None, stop: Stop | None = None, silent_s: float = 10.0
    ) -> dict[str, Parameter]:
        """Read all parameters, by name, in the vehicle's order; lost ones are requested again.

        Args:
            prefix: Only those whose names begin so, such as ``FENCE_``; MAVLink has no request for groups, so all are read.
            progress: Called with the number of those here, and the total.
            stop: Polled; True ends it.
            silent_s: Time without a new parameter after which it is given up.

        Raises:
            VehicleSilentError: some never came; it says how many, and which first.
            WaitCancelledError: ``stop`` returned True.
        """
        machine = ParameterDownload(self._messages, now=self._client.clock.now(), silent_s=silent_s)
        self._client.run(machine, machine.counts, progress=progress, stop=stop)
        here, total = machine.counts()
        if machine.cancelled:
            raise WaitCancelledError(f"parameters: stopped after {here} of {total or 'an unknown number'}")
        if machine.silent:
            what = f"{here} of {total} parameters; number {machine.missing[0]} is missing" if total else "no parameter"
            raise VehicleSilentError(f"{self._who} sent {what}{self._client.signing_advice()}")
        found = sorted(machine.found.values(), key=lambda one: one.index or 0)
        return {one.name: one for one in found if one.name.startswith(prefix)}

    def read(self, names: Collection[str], *, timeout_s: float = 3.0) -> dict[str, Parameter]:
        """Read some parameters by name; those that the vehicle does not have are omitted.

        A vehicle may be silent about what it does not have; then this takes ``timeout_s`` seconds.
        """
        machine = ParameterReads(self._messages, names, now=self._client.clock.now(), timeout_s=timeout_s)
        self._client.run(machine, machine.counts)
        return {name: machine.found[name] for name in names if name in machine.found}

    def set(self, values: Mapping[str, Value], *, timeout_s: float = 10.0) -> dict[str, Parameter]:
        """Set parameters, each in its own unit, and wait until the vehicle reports the new values.

        They are read first: their types say how a value travels.

        Returns:
            The parameters with their new values.

        Raises:
            MisuseError: one does not exist, does not take such a value (nothing was set), or was refused; it says which were set.
            VehicleSilentError: no answer within ``timeout_s`` seconds; it says which were set.
        """
        client = self._client
        known = self.read(values.keys())
        lacking = [name for name in values if name not in known]
        if lacking:
            raise MisuseError(f"{self._who} did not report {_listed(lacking)}, so no parameter was set")
        wanted = [Parameter(name, value, known[name].param_type) for name, value in values.items()]
        machine = ParameterWrites(self._messages, wanted, now=client.clock.now(), timeout_s=timeout_s)
        client.run(machine, machine.counts)
        if machine.refused:
            reasons = "; ".join(f"{name} {why}" for name, why in machine.refused.items())
            raise MisuseError(f"{self._who} refused or limited: {reasons} (set: {_listed(list(machine.confirmed))})")
        if machine.missing:
            raise VehicleSilentError(
                f"{self._who} did not confirm {_listed(machine.missing)} within {timeout_s:g} s "
                f"(set: {_listed(list(machine.confirmed))}){client.signing_advice()}"
            )
        return machine.confirmed

    @property
    def _who(self) -> str:
        return f"vehicle {self._messages.to.system_id}, component {self._messages.to.component_id}"


def _is_bytewise(client: Connection) -> bool:
    """Whether the autopilot sends the bits of whole numbers."""
    known = {AutopilotId.PX4: True, AutopilotId.ARDUPILOT: False}
    number = client.vehicle.mav_autopilot
    if number in known:
        return known[AutopilotId(number)]
    try:
        capabilities = request_message(client, AutopilotVersion, timeout_s=CALLS.ask_version_s).capabilities
    except (VehicleSilentError, CommandRefusedError):
        capabilities = 0
    if not capabilities & (Capability.PARAM_ENCODE_BYTEWISE | Capability.PARAM_ENCODE_C_CAST):
        raise MisuseError(
            f"vehicle {client.vehicle.system_id} ({client.vehicle.described}) does not report how its parameters "
            "encode whole numbers; specify bytewise"
        )
    return bool(capabilities & Capability.PARAM_ENCODE_BYTEWISE)


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return (f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown) or "none"
