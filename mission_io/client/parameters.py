"""A vehicle's parameters: all, some by name or prefix, and setting with confirmation. Extended ones of cameras as well."""

from collections.abc import Collection, Mapping

from mission_io.client import commands
from mission_io.client.client import Client
from mission_io.client.running import Progress, Stop, run
from mission_io.errors import CommandRefusedError, MisuseError, VehicleSilentError, WaitCancelledError
from mission_io.model.enums import AutopilotId
from mission_io.protocol.parameter_values import PARAM_ENCODE_BYTEWISE, PARAM_ENCODE_C_CAST, Parameter, Value
from mission_io.protocol.parameters import ParameterDownload, ParameterMessages, ParameterReads, ParameterWrites
from mission_io.protocol.timing import CALLS
from mission_io.wire.messages import Address, AutopilotVersion


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
        self, client: Client, *, component_id: int | None = None, extended: bool = False, bytewise: bool | None = None
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
        run(self._client, machine, machine.counts, progress=progress, stop=stop)
        here, total = machine.counts()
        if machine.cancelled:
            raise WaitCancelledError(f"parameters: stopped after {here} of {total or 'an unknown number'}")
        if machine.silent:
            what = f"{here} of {total} parameters; number {machine.missing[0]} is missing" if total else "no parameter"
            raise VehicleSilentError(f"{self._who} sent {what}{self._client.signing_advice()}")
        found = sorted(machine.found.values(), key=lambda one: one.index or 0)
        return {one.name: one for one in found if one.name.startswith(prefix)}

    def read(self, names: Collection[str], *, timeout_s: float = 3.0) -> dict[str, Parameter]:
        """Read some parameters by name; those that the vehicle does not have are left out.

        A vehicle may be silent about what it does not have; then this takes ``timeout_s`` seconds.
        """
        machine = ParameterReads(self._messages, names, now=self._client.clock.now(), timeout_s=timeout_s)
        run(self._client, machine, machine.counts)
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
        run(client, machine, machine.counts)
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


def _is_bytewise(client: Client) -> bool:
    """Whether the autopilot sends the bits of whole numbers."""
    known = {AutopilotId.PX4: True, AutopilotId.ARDUPILOT: False}
    number = client.vehicle.mav_autopilot
    if number in known:
        return known[AutopilotId(number)]
    try:
        capabilities = commands.request_message(client, AutopilotVersion, timeout_s=CALLS.ask_version_s).capabilities
    except (VehicleSilentError, CommandRefusedError):
        capabilities = 0
    if not capabilities & (PARAM_ENCODE_BYTEWISE | PARAM_ENCODE_C_CAST):
        raise MisuseError(
            f"vehicle {client.vehicle.system_id} ({client.vehicle.described}) does not report how its parameters "
            "encode whole numbers; specify bytewise"
        )
    return bool(capabilities & PARAM_ENCODE_BYTEWISE)


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:5])
    return (f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown) or "none"
