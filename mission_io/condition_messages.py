"""MAVLink messages about how a vehicle is: sensors, satellites, position filter, battery, radio."""

from dataclasses import dataclass

PREARM_CHECK_BIT = 0x10000000
"""The bit of ``SysStatus.sensors_healthy`` that says the vehicle's own checks before arming pass."""


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


@dataclass(frozen=True, slots=True)
class BatteryStatus:
    """One battery.

    Attributes:
        battery: Its number, from 0.
        voltages_v: Of up to ten cells, None for the rest; a battery that knows only its sum has it in the first.
        current_a: What is drawn; None unknown.
        consumed_mah: What was drawn; None unknown.
        remaining_percent: What is left; None unknown.
        time_left_s: Until it is empty; None unknown.
        charge_state: A MAV_BATTERY_CHARGE_STATE number: 1 ok, 2 low, 3 critical.
    """

    battery: int
    voltages_v: tuple[float | None, ...]
    current_a: float | None = None
    consumed_mah: int | None = None
    remaining_percent: int | None = None
    time_left_s: int | None = None
    charge_state: int = 0


@dataclass(frozen=True, slots=True)
class VfrHud:
    """What a pilot's display shows; heading in whole degrees."""

    airspeed_m_s: float
    ground_speed_m_s: float
    heading_deg: int
    throttle_percent: int
    alt_amsl_m: float
    climb_m_s: float
