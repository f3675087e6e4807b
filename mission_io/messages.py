"""The MAVLink messages that mission_io speaks, as plain data in degrees, metres, metres per second and seconds.

The codec turns bytes into these and back. Numbers that MAVLink scales to integers are given in units here, exactly:
``lat_deg`` is the nearest double to the integer divided by 1e7. A field is None where MAVLink's value says "unknown".
Fields named ``target_system`` and ``target_component`` say whom a message is for; 0 is everybody.
"""

from dataclasses import dataclass
from typing import TypeAlias

from mission_io.enums import MissionState, ModeFlag
from mission_io.items import MissionType


@dataclass(frozen=True, slots=True)
class Heartbeat:
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
class GlobalPositionInt:
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
class Attitude:
    """Roll, pitch and yaw in radians and their rates in radians per second."""

    time_boot_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    roll_rate_rad_s: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True)
class HomePosition:
    """Where the vehicle's heights above home start, and where it returns to."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class MissionCurrent:
    """The item the vehicle flies to. ``total`` is None when the vehicle does not say (65535)."""

    seq: int
    total: int | None = None
    state: int = MissionState.UNKNOWN


@dataclass(frozen=True, slots=True)
class MissionItemReached:
    """The vehicle reached an item; may be repeated, and may be skipped."""

    seq: int


@dataclass(frozen=True, slots=True)
class StatusText:
    """A line for the pilot; severity 0 is an emergency and 7 is debug."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class CommandLong:
    """A command with seven parameters."""

    target_system: int
    target_component: int
    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


@dataclass(frozen=True, slots=True)
class CommandInt:
    """A command with a position; ``x`` and ``y`` as they are on the wire (degrees times 1e7 in a global frame)."""

    target_system: int
    target_component: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


@dataclass(frozen=True, slots=True)
class CommandAck:
    """The answer to a command; ``progress`` in per cent when the result is IN_PROGRESS (255 unknown)."""

    command: int
    result: int
    progress: int = 0
    result_param2: int = 0
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True, slots=True)
class SysStatus:
    """Sensor health as bit masks (MAV_SYS_STATUS_SENSOR), load and battery; None where unknown."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    load_fraction: float = 0.0
    battery_v: float | None = None
    battery_a: float | None = None
    battery_remaining_percent: int | None = None


PREARM_CHECK_BIT = 0x10000000
"""The bit of ``SysStatus.sensors_healthy`` that says the vehicle's own checks before arming pass."""


@dataclass(frozen=True, slots=True)
class GpsRawInt:
    """What the satellite receiver says, before any filter."""

    time_s: float
    fix_type: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    horizontal_dilution: float | None = None
    vertical_dilution: float | None = None
    ground_speed_m_s: float | None = None
    course_deg: float | None = None
    satellites_visible: int | None = None


@dataclass(frozen=True, slots=True)
class EkfStatusReport:
    """What ArduPilot's position filter believes of itself; variances are ratios, above 1 is bad."""

    flags: int
    velocity_variance: float = 0.0
    position_horizontal_variance: float = 0.0
    position_vertical_variance: float = 0.0
    compass_variance: float = 0.0
    terrain_alt_variance: float = 0.0


@dataclass(frozen=True, slots=True)
class ExtendedSysState:
    """Whether the vehicle is on the ground (a LandedState number)."""

    landed_state: int
    vtol_state: int = 0


@dataclass(frozen=True, slots=True)
class MissionCount:
    """How many items the sender is going to send."""

    target_system: int
    target_component: int
    count: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequest:
    """Asks for an item, in the deprecated form; answered like the other."""

    target_system: int
    target_component: int
    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequestInt:
    """Asks for an item."""

    target_system: int
    target_component: int
    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionItemInt:
    """One item; ``x`` and ``y`` as on the wire: degrees times 1e7, or plain numbers in frame 2. ``z`` in metres."""

    target_system: int
    target_component: int
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
class MissionItemFloat:
    """One item in the deprecated form: 32-bit degrees, good to 0.2 m. Read, never sent by this package."""

    target_system: int
    target_component: int
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
class MissionAck:
    """Ends a transfer or a clear; ``result`` is a MissionResult number."""

    target_system: int
    target_component: int
    result: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequestList:
    """Asks for a list; answered by its count."""

    target_system: int
    target_component: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionClearAll:
    """Asks to empty a list (255: all of them)."""

    target_system: int
    target_component: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionSetCurrent:
    """Asks to go on with another item."""

    target_system: int
    target_component: int
    seq: int


@dataclass(frozen=True, slots=True)
class AutopilotVersion:
    """What the autopilot can do (MAV_PROTOCOL_CAPABILITY bits) and which release it is."""

    capabilities: int
    flight_sw_version: int = 0
    uid: int = 0


@dataclass(frozen=True, slots=True)
class SetMode:
    """Asks for another flight mode."""

    target_system: int
    base_mode: int
    custom_mode: int


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
class SystemTime:
    """Time since 1970 in UTC, 0 when unknown, and since boot; seconds."""

    time_unix_s: float
    time_boot_s: float


@dataclass(frozen=True, slots=True)
class RadioStatus:
    """What a telemetry radio says of its link; strengths and noise in its own units, 255 unknown.

    Attributes:
        rssi: Signal here.
        remote_rssi: Signal at the other radio.
        transmit_buffer_percent: Room left in the radio's buffer.
        noise: Noise here.
        remote_noise: Noise at the other radio.
        receive_errors: Packets with errors.
        corrected: Packets that the radio repaired.
    """

    rssi: int
    remote_rssi: int
    transmit_buffer_percent: int
    noise: int
    remote_noise: int
    receive_errors: int = 0
    corrected: int = 0


Message: TypeAlias = (
    Heartbeat
    | GlobalPositionInt
    | Attitude
    | HomePosition
    | MissionCurrent
    | MissionItemReached
    | StatusText
    | CommandLong
    | CommandInt
    | CommandAck
    | SysStatus
    | GpsRawInt
    | EkfStatusReport
    | ExtendedSysState
    | MissionCount
    | MissionRequest
    | MissionRequestInt
    | MissionItemInt
    | MissionItemFloat
    | MissionAck
    | MissionRequestList
    | MissionClearAll
    | MissionSetCurrent
    | AutopilotVersion
    | SetMode
    | ParamRequestRead
    | ParamSet
    | ParamValue
    | SystemTime
    | RadioStatus
)


@dataclass(frozen=True, slots=True)
class Received:
    """A message, who sent it, and in which version of MAVLink."""

    message: Message
    system_id: int
    component_id: int
    mavlink_version: int = 2


def is_for(message: Message, *, system_id: int, component_id: int) -> bool:
    """Whether a message is addressed to this system and component, to everybody, or to nobody in particular."""
    to_system = getattr(message, "target_system", 0)
    to_component = getattr(message, "target_component", 0)
    return to_system in (0, system_id) and to_component in (0, component_id)
