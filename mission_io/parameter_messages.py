"""MAVLink messages about a vehicle's parameters and streams of messages."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ParamRequestRead:
    """Asks for a parameter by name (``index`` -1) or by index."""

    target_system: int
    target_component: int
    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamSet:
    """Asks to set a parameter; ``param_type`` is a MAV_PARAM_TYPE number (9: 32-bit float)."""

    target_system: int
    target_component: int
    name: str
    value: float
    param_type: int = 9


@dataclass(frozen=True, slots=True)
class ParamValue:
    """A parameter as the vehicle has it."""

    name: str
    value: float
    param_type: int = 9
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamRequestList:
    """Asks for all parameters, one PARAM_VALUE each."""

    target_system: int
    target_component: int


@dataclass(frozen=True, slots=True)
class RequestDataStream:
    """Asks ArduPilot for a group of messages (a MAV_DATA_STREAM number, 0: all) at a rate; ``start`` 0 ends it."""

    target_system: int
    target_component: int
    stream: int
    rate_hz: int
    start: int = 1
