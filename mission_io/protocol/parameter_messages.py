"""Meaning of messages about parameters: autopilots' (PARAM_*) and extended ones (PARAM_EXT_*)."""

from dataclasses import dataclass

from mission_io.protocol.exchange import Address
from mission_io.protocol.parameter_values import (
    Parameter,
    Value,
    bytes_of_value,
    float_of_value,
    value_of_bytes,
    value_of_float,
)
from mission_io.wire import messages as m

_ACCEPTED, _IN_PROGRESS = 0, 3
"""PARAM_ACK numbers."""
_REASONS = {1: "unsupported value", 2: "failed"}
_ERRORS = {1: "does not exist", 2: "value out of range", 3: "permission denied", 4: "no such component", 5: "read only",
           6: "unsupported type", 7: "type mismatch", 8: "cannot be read"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Heard:
    """Content of a message about parameters."""

    name: str  # which one
    parameter: Parameter | None  # its value; None when the message refuses
    count: int = 0  # how many there are; 0 where the message does not say
    refused: str = ""  # why there is no value, or why it was not set; empty for a value
    in_progress: bool = False  # whether the component is still setting it


class ParameterMessages:
    """The messages about parameters, to and from one component.

    Args:
        to: The component.
        bytewise: Whether it sends the bits of an integer as if they were a float, or casts it.
        extended: Whether it has extended parameters.
    """

    def __init__(self, to: Address, *, bytewise: bool = False, extended: bool = False) -> None:
        self.to, self.bytewise, self.extended = to, bytewise, extended

    def list_request(self) -> m.Message:
        """Asks for all."""
        kind = m.ParamExtRequestList if self.extended else m.ParamRequestList
        return kind(self.to.system_id, self.to.component_id)

    def read_request(self, name: str, index: int = -1) -> m.Message:
        """Asks for one, by name or by index."""
        kind = m.ParamExtRequestRead if self.extended else m.ParamRequestRead
        return kind(self.to.system_id, self.to.component_id, name, index)

    def set_request(self, name: str, value: Value, param_type: int) -> m.Message:
        """Asks to set one.

        Raises:
            MisuseError: the value does not fit the type.
        """
        system_id, component_id = self.to.system_id, self.to.component_id
        if self.extended:
            return m.ParamExtSet(
                system_id, component_id, name, bytes_of_value(value, param_type, name=name), param_type
            )
        number = float("nan") if isinstance(value, bytes) else value
        wire = float_of_value(number, param_type, bytewise=self.bytewise, name=name)
        return m.ParamSet(system_id, component_id, name, wire, param_type)

    def heard(self, received: m.Received) -> Heard | None:
        """Content of a message about parameters of this component; None for other messages."""
        if Address(received.system_id, received.component_id) != self.to:
            return None
        match received.message:
            case m.ParamValue(name, wire, param_type, count, index) if not self.extended:
                value: Value = value_of_float(wire, param_type, bytewise=self.bytewise)
            case m.ParamExtValue(name, raw, param_type, count, index) if self.extended:
                value = value_of_bytes(raw, param_type)
            case m.ParamError(name=name, error=error) if not self.extended:
                return Heard(name, None, refused=_ERRORS.get(error, f"error {error}"))
            case m.ParamExtAck(name, raw, param_type, result) if self.extended:
                if result not in (_ACCEPTED, _IN_PROGRESS):
                    return Heard(name, None, refused=_REASONS.get(result, f"result {result}"))
                parameter = Parameter(name, value_of_bytes(raw, param_type), param_type)
                return Heard(name, parameter, in_progress=result == _IN_PROGRESS)
            case _:
                return None
        return Heard(name, Parameter(name, value, param_type, None if index == 0xFFFF else index), count)
