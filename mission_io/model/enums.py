"""The MAVLink enumerations that mission_io uses, under their MAVLink names, and the kinds of vehicles."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag
from types import MappingProxyType
from typing import Final

from mission_io.data_tables import data_rows
from mission_io.errors import MisuseError


class MissionResult(IntEnum):
    """Result of a mission transfer (MAV_MISSION_RESULT)."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class CommandResult(IntEnum):
    """Result of a command (MAV_RESULT)."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    COMMAND_UNSUPPORTED_MAV_FRAME = 9


class MissionState(IntEnum):
    """State of a vehicle's mission (MISSION_STATE)."""

    UNKNOWN = 0
    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class LandedState(IntEnum):
    """Whether a vehicle is on the ground (MAV_LANDED_STATE)."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Severity(IntEnum):
    """Severity of a StatusText (MAV_SEVERITY)."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class GpsFix(IntEnum):
    """Fix of a satellite receiver (GPS_FIX_TYPE), as far as mission_io distinguishes it."""

    NO_FIX = 1
    FIX_3D = 3


class ModeFlag(IntFlag):
    """Bits of a heartbeat's base mode (MAV_MODE_FLAG) that mission_io uses."""

    CUSTOM_MODE_ENABLED = 1
    AUTO_ENABLED = 4
    GUIDED_ENABLED = 8
    STABILIZE_ENABLED = 16
    SAFETY_ARMED = 128


class VehicleClass(IntEnum):
    """The kinds of sender (MAV_TYPE) that mission_io distinguishes."""

    GENERIC = 0
    FIXED_WING = 1
    QUADROTOR = 2
    GROUND_STATION = 6
    HEXAROTOR = 13


class AutopilotId(IntEnum):
    """The autopilots (MAV_AUTOPILOT) that mission_io distinguishes."""

    GENERIC = 0
    ARDUPILOT = 3
    INVALID = 8
    """Not an autopilot: a ground station, a camera."""
    PX4 = 12


class Firmware(Enum):
    """Autopilot firmwares, each with its own flight mode numbers."""

    COPTER = "ArduCopter"
    PLANE = "ArduPlane"
    ROVER = "Rover"
    SUB = "ArduSub"
    BLIMP = "Blimp"
    PX4 = "PX4"
    OTHER = "other"


class EkfFlag(IntFlag):
    """Bits of EkfStatusReport.flags about the validity of a position."""

    ATTITUDE = 0x1
    VELOCITY_HORIZONTAL = 0x2
    VELOCITY_VERTICAL = 0x4
    POSITION_HORIZONTAL_RELATIVE = 0x8
    POSITION_HORIZONTAL_ABSOLUTE = 0x10
    POSITION_VERTICAL_ABSOLUTE = 0x20
    CONSTANT_POSITION = 0x80


class ParamType(IntEnum):
    """Type of a parameter (MAV_PARAM_TYPE and MAV_PARAM_EXT_TYPE, which agree)."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    UINT64 = 7
    INT64 = 8
    REAL32 = 9
    REAL64 = 10
    CUSTOM = 11


class Capability(IntFlag):
    """The ways in which autopilots send whole numbers as parameters (MAV_PROTOCOL_CAPABILITY)."""

    PARAM_ENCODE_BYTEWISE = 0x10
    """By their bits."""
    PARAM_ENCODE_C_CAST = 0x20000
    """By their value."""


# Vehicle types: the numbers of MAV_TYPE, by name and by kind (multicopter, plane, rover, ...).


class VehicleKind(Enum):
    """Vehicles that move in the same way; the value is as text."""

    MULTIROTOR = "multirotor"
    HELICOPTER = "helicopter"
    PLANE = "plane"
    VTOL = "VTOL plane"
    ROVER = "rover"
    BOAT = "boat"
    SUBMARINE = "submarine"
    AIRSHIP = "airship"
    OTHER = "other vehicle"
    NO_VEHICLE = "part of a vehicle, or a station"


@dataclass(frozen=True, slots=True)
class _Type:
    number: int
    kind: VehicleKind


_TYPES: Final[Mapping[int, tuple[str, VehicleKind]]] = MappingProxyType(
    {
        row.number: (name, row.kind)
        for name, row in data_rows(_Type, "mission_io/data/vehicle_types.toml", "types").items()
    }
)
"""Name and kind of each MAV_TYPE."""

VEHICLE_TYPES: Final = tuple(_TYPES)
"""The numbers that have a name here."""


def type_name(vehicle_type: int) -> str:
    """The name of a MAV_TYPE number, for people and as :func:`parse_type` reads it.

    >>> type_name(2), type_name(22), type_name(200)
    ('quadrotor', 'vtol-fixedrotor', 'type 200')
    """
    known = _TYPES.get(vehicle_type)
    return f"type {vehicle_type}" if known is None else known[0]


def kind_of(vehicle_type: int) -> VehicleKind:
    """The kind of vehicle with a MAV_TYPE number; an unknown number is another vehicle."""
    known = _TYPES.get(vehicle_type)
    return VehicleKind.OTHER if known is None else known[1]


def parse_type(text: str) -> int:
    """The MAV_TYPE number of a vehicle's name; ``vtol`` is short for the most common of them."""
    wanted = "vtol-fixedrotor" if text == "vtol" else text
    vehicles = {name: number for number, (name, kind) in _TYPES.items() if kind is not VehicleKind.NO_VEHICLE}
    if wanted not in vehicles:
        raise MisuseError(f"unknown vehicle type {text!r}; use one of {', '.join(vehicles)}")
    return vehicles[wanted]
