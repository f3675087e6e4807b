"""MAVLink messages about the vehicle's state, message streams, terrain and logs.

State: mode, position, attitude, sensors, satellites, position filter, battery, radio. Terrain: the vehicle requests ground
heights, and a ground station answers. Heights come in blocks of 7 times 8 parts; a part is 4 times 4 heights, ``spacing_m``
apart, the first at the south-west corner, row by row to the east. Logs: the list is requested first, then the bytes.
"""

from dataclasses import dataclass

from mission_io.model.enums import ModeFlag


@dataclass(frozen=True, slots=True)
class Message:
    """Any message of MAVLink that mission_io uses."""


@dataclass(frozen=True, slots=True)
class Addressed(Message):
    """A message to one system and component; 0 is all of them."""

    target_system: int
    target_component: int


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
class ExtendedSysState(Message):
    """Whether the vehicle is on the ground (a LandedState number)."""

    landed_state: int
    vtol_state: int = 0


@dataclass(frozen=True, slots=True)
class AutopilotVersion(Message):
    """Capabilities (MAV_PROTOCOL_CAPABILITY bits), release and hardware number; ArduPilot reports only ``uid2``."""

    capabilities: int
    flight_sw_version: int = 0
    uid: int = 0
    uid2: tuple[int, ...] = (0,) * 18  # 18 bytes


PREARM_CHECK_BIT = 0x10000000
"""The bit of ``SysStatus.sensors_healthy`` that says the vehicle's own checks before arming pass."""


@dataclass(frozen=True, slots=True)
class SysStatus(Message):
    """Sensor health as bit masks (MAV_SYS_STATUS_SENSOR), load and battery; None where unknown."""

    sensors_present: int
    sensors_enabled: int
    sensors_healthy: int
    load_fraction: float = 0.0
    battery_v: float | None = None
    battery_a: float | None = None
    battery_remaining_percent: int | None = None


@dataclass(frozen=True, slots=True)
class GpsRawInt(Message):
    """Report of the satellite receiver, before any filter."""

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
class CameraFeedback(Message):
    """ArduPilot has taken a photo: its position, and the attitude of the vehicle. ``time_s`` is the sender's own time."""

    time_s: float
    number: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    alt_above_home_m: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    completed: int = 0


@dataclass(frozen=True, slots=True)
class CameraImageCaptured(Message):
    """A photo of a PX4 or camera-protocol camera; ``success`` is not 1 when the attempt failed.

    ``quaternion`` (w, x, y, z) turns the camera's frame to north, east, down.
    """

    time_boot_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    alt_above_home_m: float
    quaternion: tuple[float, float, float, float]
    number: int
    success: int


@dataclass(frozen=True, slots=True)
class EkfStatusReport(Message):
    """Report of ArduPilot's position filter about itself; variances are ratios, above 1 is bad."""

    flags: int
    velocity_variance: float = 0.0
    position_horizontal_variance: float = 0.0
    position_vertical_variance: float = 0.0
    compass_variance: float = 0.0
    terrain_alt_variance: float = 0.0


@dataclass(frozen=True, slots=True)
class RadioStatus(Message):
    """Report of a telemetry radio about its link; strengths and noise in its own units, 255 unknown."""

    rssi: int  # signal here
    remote_rssi: int  # signal at the other radio
    transmit_buffer_percent: int  # room left in the radio's buffer
    noise: int  # noise here
    remote_noise: int  # noise at the other radio
    receive_errors: int = 0  # packets with errors
    corrected: int = 0  # packets that the radio repaired


@dataclass(frozen=True, slots=True)
class BatteryStatus(Message):
    """One battery."""

    battery: int  # its number, from 0
    # of up to ten cells, None for the rest; a battery that knows only its sum has it in the first
    voltages_v: tuple[float | None, ...]
    current_a: float | None = None  # what is drawn; None unknown
    consumed_mah: int | None = None  # what was drawn; None unknown
    remaining_percent: int | None = None  # what is left; None unknown
    time_left_s: int | None = None  # until it is empty; None unknown
    charge_state: int = 0  # A MAV_BATTERY_CHARGE_STATE number: 1 ok, 2 low, 3 critical


@dataclass(frozen=True, slots=True)
class VfrHud(Message):
    """Values of a pilot's display; heading in whole degrees."""

    airspeed_m_s: float
    ground_speed_m_s: float
    heading_deg: int
    throttle_percent: int
    alt_amsl_m: float
    climb_m_s: float


@dataclass(frozen=True, slots=True)
class RequestDataStream(Addressed):
    """Asks ArduPilot for a group of messages (a MAV_DATA_STREAM number, 0: all) at a rate; ``start`` 0 ends it."""

    stream: int
    rate_hz: int
    start: int = 1


@dataclass(frozen=True, slots=True)
class TerrainRequest(Message):
    """Asks for parts of a block of heights."""

    lat_deg: float  # latitude of the block's south-west corner
    lon_deg: float  # longitude of the block's south-west corner
    spacing_m: int  # distance of neighbouring heights
    mask: int  # bit n is set when part n is wanted; 8 parts to the east, then the next row to the north


@dataclass(frozen=True, slots=True)
class TerrainData(Message):
    """One part of a block."""

    lat_deg: float  # latitude of the block's south-west corner, as requested
    lon_deg: float  # longitude of the block's south-west corner, as requested
    spacing_m: int  # distance of neighbouring heights
    part: int  # its number, the bit in the request
    # 16 whole metres above mean sea level: 4 to the east, then the next row to the north
    heights_amsl_m: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TerrainReport(Message):
    """A vehicle's knowledge of the ground: ``pending`` parts are requested, ``loaded`` ones are there."""

    lat_deg: float
    lon_deg: float
    spacing_m: int
    terrain_alt_amsl_m: float
    height_above_terrain_m: float
    pending: int
    loaded: int


@dataclass(frozen=True, slots=True)
class FileTransfer(Addressed):
    """A request or an answer of MAVLink FTP; see ``mission_io.protocol.ftp`` for its 251 bytes."""

    payload: bytes


LOG_DATA_BYTES = 90
"""As many bytes of a log fit in one message."""


@dataclass(frozen=True, slots=True)
class LogRequestList(Addressed):
    """Asks for the entries from number ``first`` to ``last``."""

    first: int = 0
    last: int = 65535


@dataclass(frozen=True, slots=True)
class LogEntry(Message):
    """One log of the vehicle."""

    log_id: int  # its number
    log_count: int  # how many logs there are; with 0 the rest means nothing
    last_log_id: int  # the highest number
    time_unix_s: int  # when it was begun; 0 when the vehicle did not know the time
    size_bytes: int  # its size; 0 for a log that is being written, with some autopilots


@dataclass(frozen=True, slots=True)
class LogRequestData(Addressed):
    """Asks for ``count`` bytes of a log from ``offset_bytes`` on."""

    log_id: int
    offset_bytes: int
    count: int


@dataclass(frozen=True, slots=True)
class LogData(Message):
    """Bytes of a log: the first ``count`` of ``padded`` are from ``offset_bytes`` on; fewer than 90 mean its end."""

    log_id: int
    offset_bytes: int
    count: int
    padded: tuple[int, ...]

    @property
    def content(self) -> bytes:
        """The bytes that belong to the log."""
        return bytes(self.padded[: self.count])


@dataclass(frozen=True, slots=True)
class LogRequestEnd(Addressed):
    """Ends the requests, so that the vehicle may log again."""


@dataclass(frozen=True, slots=True)
class SystemTime(Message):
    """Time since 1970 in UTC, 0 when unknown, and since boot; seconds."""

    time_unix_s: float
    time_boot_s: float


@dataclass(frozen=True, slots=True)
class TimeSync(Message):
    """A question for the other side's time, or the answer to one.

    ``requested_ns`` is the asker's time, which the answer repeats; ``answered_ns`` is the answerer's time, 0 in a question.
    """

    answered_ns: int
    requested_ns: int


@dataclass(frozen=True, slots=True)
class Event(Message):
    """An event of PX4's events interface, which gives reasons that STATUSTEXT lacks."""

    target_component: int  # recipient; 0 is everybody
    target_system: int  # the same for the system
    event_id: int  # number of the event: the component in the highest byte, below it 24 bits of a hash of its name
    time_boot_ms: int  # when it happened
    sequence: int  # counts the events of a component
    log_levels: int  # severity, for logs outside of the vehicle in the lower four bits
    arguments: tuple[int, ...]  # 40 bytes, packed as the event defines
