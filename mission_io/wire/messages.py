"""The MAVLink messages that mission_io uses, as plain data in degrees, metres, metres per second and seconds.

The codec converts between bytes and these classes. Numbers that MAVLink scales to integers are exact here:
``lat_deg`` is the double nearest to the integer divided by 1e7. A field is None where MAVLink's value means "unknown".
Fields named ``target_system`` and ``target_component`` name the recipient; 0 is everybody.
"""

from dataclasses import dataclass
from typing import NamedTuple

from mission_io.model.enums import MissionState, ModeFlag
from mission_io.model.items import MissionType
from mission_io.wire.telemetry_messages import *  # noqa: F403 - its messages are used under this module's name
from mission_io.wire.telemetry_messages import Addressed as Addressed
from mission_io.wire.telemetry_messages import Message as Message


@dataclass(frozen=True, slots=True)
class Heartbeat(Message):
    """A sender is alive. ``custom_mode`` is the autopilot's own mode number."""

    autopilot: int
    vehicle_type: int
    base_mode: int = 0
    custom_mode: int = 0
    system_status: int = 0

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""
        return bool(self.base_mode & ModeFlag.SAFETY_ARMED)


@dataclass(frozen=True, slots=True)
class GlobalPositionInt(Message):
    """Where the vehicle believes it is. Velocity is north, east, down; heading in degrees, None when unknown."""

    time_boot_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    alt_above_home_m: float
    velocity_north_m_s: float
    velocity_east_m_s: float
    velocity_down_m_s: float
    heading_deg: float | None


@dataclass(frozen=True, slots=True)
class Attitude(Message):
    """Roll, pitch and yaw in radians and their rates in radians per second."""

    time_boot_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    roll_rate_rad_s: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True)
class HomePosition(Message):
    """Where the vehicle's heights above home start, and where it returns to."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class GpsGlobalOrigin(Message):
    """Where the local frame of the vehicle's position filter starts."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class MissionCurrent(Message):
    """The item the vehicle flies to.

    ``total`` is None when the vehicle does not say (65535). ``mission_id`` is another number for each mission that the vehicle
    holds; 0 where it has none. ``fence_id`` and ``rally_points_id`` are the same for the other lists.
    """

    seq: int
    total: int | None = None
    state: int = MissionState.UNKNOWN
    mission_id: int = 0
    fence_id: int = 0
    rally_points_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionItemReached(Message):
    """The vehicle reached an item; may be repeated, and may be skipped."""

    seq: int


TEXT_LETTERS = 50
"""Letters of one StatusText; a longer line comes in pieces."""


@dataclass(frozen=True, slots=True)
class StatusText(Message):
    """A line for the pilot; severity 0 is an emergency and 7 is debug."""

    severity: int  # how bad it is
    text: str  # the line, or a piece of it
    text_id: int = 0  # other than 0 for a line that comes in pieces of 50 letters; the same for all of them
    chunk: int = 0  # the piece's number; the last one has fewer letters


@dataclass(frozen=True, slots=True)
class CommandLong(Addressed):
    """A command with seven parameters."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


@dataclass(frozen=True, slots=True)
class CommandInt(Addressed):
    """A command with a position; ``x`` and ``y`` are wire values (degrees times 1e7 in a global frame)."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


@dataclass(frozen=True, slots=True)
class CommandAck(Message):
    """The answer to a command; ``progress`` in per cent when the result is IN_PROGRESS (255 unknown)."""

    command: int
    result: int
    progress: int = 0
    result_param2: int = 0
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True, slots=True)
class ExtendedSysState(Message):
    """Whether the vehicle is on the ground (a LandedState number)."""

    landed_state: int
    vtol_state: int = 0


@dataclass(frozen=True, slots=True)
class MissionCount(Addressed):
    """Number of items that the sender is going to send; a vehicle adds the list's id, 0 without one."""

    count: int
    mission_type: int = MissionType.MISSION
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionWritePartialList(Addressed):
    """The sender is going to replace the items from ``start_index`` to ``end_index``, both among them."""

    start_index: int
    end_index: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequest(Addressed):
    """Asks for an item, in the deprecated form; answered like the other."""

    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequestInt(Addressed):
    """Asks for an item."""

    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionItemInt(Addressed):
    """One item; ``x`` and ``y`` as on the wire: degrees times 1e7, or plain numbers in frame 2. ``z`` in metres."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    current: int = 0
    autocontinue: int = 1
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionItemFloat(Addressed):
    """One item in the deprecated form: 32-bit degrees, good to 0.2 m. Read, never sent by this package."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    current: int = 0
    autocontinue: int = 1
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionAck(Addressed):
    """Ends a transfer or a clear; ``result`` is a MissionResult number, ``opaque_id`` that of the list after an upload."""

    result: int
    mission_type: int = MissionType.MISSION
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionRequestList(Addressed):
    """Asks for a list; answered by its count."""

    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionClearAll(Addressed):
    """Asks to empty a list (255: all of them)."""

    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionSetCurrent(Addressed):
    """Asks to go on with another item."""

    seq: int


@dataclass(frozen=True, slots=True)
class AutopilotVersion(Message):
    """Capabilities (MAV_PROTOCOL_CAPABILITY bits) and release of the autopilot."""

    capabilities: int
    flight_sw_version: int = 0
    uid: int = 0


@dataclass(frozen=True, slots=True)
class SetMode(Message):
    """Asks for another flight mode."""

    target_system: int
    base_mode: int
    custom_mode: int


@dataclass(frozen=True, slots=True)
class ParamRequestRead(Addressed):
    """Asks for a parameter by name (``index`` -1) or by index."""

    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamSet(Addressed):
    """Asks to set a parameter; ``param_type`` is a MAV_PARAM_TYPE number (9: 32-bit float)."""

    name: str
    value: float
    param_type: int = 9


@dataclass(frozen=True, slots=True)
class ParamValue(Message):
    """A parameter as the vehicle has it."""

    name: str
    value: float
    param_type: int = 9
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamRequestList(Addressed):
    """Asks for all parameters, one PARAM_VALUE each."""


@dataclass(frozen=True, slots=True)
class ParamError(Addressed):
    """Reason for a missing PARAM_VALUE: ``error`` is a MAV_PARAM_ERROR number."""

    name: str
    index: int
    error: int


@dataclass(frozen=True, slots=True)
class ParamExtRequestRead(Addressed):
    """Asks for an extended parameter by name (``index`` -1) or by index."""

    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamExtRequestList(Addressed):
    """Asks for all extended parameters, one PARAM_EXT_VALUE each."""


@dataclass(frozen=True, slots=True)
class ParamExtValue(Message):
    """An extended parameter: 128 bytes, whose type (MAV_PARAM_EXT_TYPE) gives their number and meaning."""

    name: str
    value: bytes
    param_type: int
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamExtSet(Addressed):
    """Asks to set an extended parameter."""

    name: str
    value: bytes
    param_type: int


@dataclass(frozen=True, slots=True)
class ParamExtAck(Message):
    """The answer to PARAM_EXT_SET: the value now, and a PARAM_ACK number as ``result``."""

    name: str
    value: bytes
    param_type: int
    result: int


class Address(NamedTuple):
    """A system and one of its components; also the first two fields of a message to it."""

    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True)
class Received:
    """A message, who sent it, and in which version of MAVLink."""

    message: Message
    system_id: int
    component_id: int
    mavlink_version: int = 2

    @property
    def sender(self) -> Address:
        """System and component that sent it."""
        return Address(self.system_id, self.component_id)


def is_for(message: Message, *, system_id: int, component_id: int) -> bool:
    """Whether a message is addressed to this system and component, to all of them, or has no address."""
    to_system = getattr(message, "target_system", 0)
    to_component = getattr(message, "target_component", 0)
    return to_system in (0, system_id) and to_component in (0, component_id)
