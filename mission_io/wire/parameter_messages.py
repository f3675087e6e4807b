"""MAVLink messages about parameters: those of the autopilot, and the extended ones of cameras and other components."""

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
class ParamError:
    """Reason for a missing PARAM_VALUE: ``error`` is a MAV_PARAM_ERROR number."""

    target_system: int
    target_component: int
    name: str
    index: int
    error: int


@dataclass(frozen=True, slots=True)
class ParamExtRequestRead:
    """Asks for an extended parameter by name (``index`` -1) or by index."""

    target_system: int
    target_component: int
    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamExtRequestList:
    """Asks for all extended parameters, one PARAM_EXT_VALUE each."""

    target_system: int
    target_component: int


@dataclass(frozen=True, slots=True)
class ParamExtValue:
    """An extended parameter: 128 bytes, whose type (MAV_PARAM_EXT_TYPE) gives their number and meaning."""

    name: str
    value: bytes
    param_type: int
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamExtSet:
    """Asks to set an extended parameter."""

    target_system: int
    target_component: int
    name: str
    value: bytes
    param_type: int


@dataclass(frozen=True, slots=True)
class ParamExtAck:
    """The answer to PARAM_EXT_SET: the value now, and a PARAM_ACK number as ``result``."""

    name: str
    value: bytes
    param_type: int
    result: int
