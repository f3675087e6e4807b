"""Behaviour of the mock vehicle as data: flight, start-up, messages and transfers by autopilot, and tuned numbers.

``OBSERVED`` reproduces two simulated vehicles (``data/mock_behaviour.toml``). ``quick`` is a vehicle without their
delays: ready in two seconds, with all streams on from the start, and with transfer timeouts on the link's clock.
``data/mock.toml`` explains each number.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Any

from mission_io.data_tables import data_table, read_document, table_of
from mission_io.model.enums import AutopilotId, Severity
from mission_io.wire import messages as m
from mission_io.wire.messages import ParamValue
from uavcover.model.vehicle import AutopilotMotion, AutopilotName, Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class _Body:
    step_s: float
    same_position_m: float
    tumbled_rad: float
    touch_m: float
    comes_up_s: float
    same_m_s: float
    battery_cells: int
    full_v: float
    empty_v: float
    sag_v: float
    receiver_s: float
    recovery_s: float
    drift_m_s: float
    position_timeout_s: float
    failsafe_low_charge: float
    failsafe_critical_charge: float
    fault_charge: float
    upwind_deg: float
    glitch_s: float
    arming_charge: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Guidance:
    braking_fraction: float
    corner_fraction: float
    cross_track_gain_1_s: float
    approach_gain_1_s: float
    follow_gain_1_s: float
    velocity_gain_1_s: float
    lag_m: float
    stands_lag_m: float
    height_radius_m: float
    longer_ratio: float
    late_fraction: float
    kept_fraction: float
    least_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Flight:
    slow_landing_below_m: float
    settled_m: float
    circle_radius_m: float
    circle_leg_m: float
    repeat_s: float
    report_s: float
    climb_from_m: float
    terrain_step_m: float
    return_settled_m: float
    above_start_m: float
    trail_timeout_s: float
    routine_points: int
    low_space: int
    simplify_fraction: float
    prune_fraction: float
    disarm_after_landing_s: float
    check_every: int
    disarm_when_idle_s: float
    tolerance_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    ask_every_s: float
    ahead_s: float
    ask_again_s: float
    unanswered_s: float
    most_endpoints: int
    datagram_bytes: int
    peer_tick_s: float
    most_connections: int
    tick_s: float
    longest_tick_s: float
    stale_s: float
    terrain_ask_every_s: float
    terrain_around_spacings: int


BODY = data_table(_Body, "uavcover/data/mock.toml", "body")
GUIDANCE = data_table(_Guidance, "uavcover/data/mock.toml", "guidance")
FLIGHT = data_table(_Flight, "uavcover/data/mock.toml", "flight")
LINK = data_table(_Link, "uavcover/data/mock.toml", "link")


@dataclass(frozen=True, slots=True)
class Speeds:
    """Speeds of flight: over ground along a leg, upwards and downwards, metres per second."""

    cruise_m_s: float
    climb_m_s: float
    descent_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of the vehicle's flight without commands of a mission."""

    cruise_m_s: float = 10.0  # ground speed
    climb_m_s: float = 4.0  # upward speed
    descent_m_s: float = 3.0  # downward speed
    land_m_s: float = 0.7  # downward speed of the last metres
    acceptance_radius_m: float = 2.0  # a waypoint without a radius of its own counts as reached within this distance
    return_height_m: float = 30.0  # height above home that the vehicle returns at
    motion: AutopilotMotion | None = None  # how it is led along legs, up and down; None: as fast as its airframe can

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if name != "motion" and not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: must be greater than 0, not {getattr(self, name)}")

    @classmethod
    def for_vehicle(cls, vehicle: Vehicle, autopilot: AutopilotName | None = None) -> "Settings":
        """The settings of a scenario's vehicle under an autopilot; its own if none is named."""
        motion = vehicle.motion(autopilot)
        return cls(
            cruise_m_s=vehicle.cruise_speed_m_s,
            climb_m_s=vehicle.max_climb_m_s,
            descent_m_s=vehicle.max_descent_m_s,
            acceptance_radius_m=vehicle.acceptance_radius_m,
            return_height_m=vehicle.return_height_m,
            land_m_s=motion.land_m_s,
            motion=motion if math.isfinite(motion.acceleration_m_s2) and math.isfinite(motion.jerk_m_s3) else None,
        )

    @property
    def speeds(self) -> Speeds:
        """The three speeds."""
        return Speeds(self.cruise_m_s, self.climb_m_s, self.descent_m_s)


class TransferClock(Enum):
    """The clock on which mission transfers time out."""

    LINK = "seconds on the link's clock, independent of the speed of the vehicle's time"
    VEHICLE = "vehicle time, as simulated autopilots do"


class GroundSource(Enum):
    """Source of the terrain heights."""

    KNOWN = "the terrain data is on the vehicle's memory card"
    GROUND_STATION = "the vehicle requests the terrain data with TERRAIN_REQUEST"


_EVERYTHING: Mapping[type[m.Message], float] = MappingProxyType(
    {
        m.Heartbeat: 1.0,
        m.GlobalPositionInt: 0.1,
        m.Attitude: 0.1,
        m.MissionCurrent: 1.0,
        m.SysStatus: 1.0,
        m.GpsRawInt: 1.0,
        m.EkfStatusReport: 1.0,
        m.ExtendedSysState: 1.0,
        m.SystemTime: 1.0,
        m.HomePosition: 5.0,
        m.BatteryStatus: 2.0,
        m.VfrHud: 1.0,
    }
)


class Streams(Enum):
    """Messages that it sends unasked, each with its interval in seconds."""

    EVERYTHING = _EVERYTHING
    HEARTBEATS = MappingProxyType({m.Heartbeat: 1.0})


@dataclass(frozen=True, slots=True)
class StartText:
    """A STATUSTEXT sent during start-up."""

    at_s: float  # when, in seconds since it was switched on
    severity: Severity  # how bad it is
    text: str  # the line


@dataclass(frozen=True, slots=True, kw_only=True)
class Behaviour:
    """One way to behave."""

    fix_s: float  # satellite fix, in seconds since it was switched on
    checks_pass_s: float  # home is known and the pre-arm bit is good
    ready_s: float  # arming works
    start_texts: tuple[StartText, ...]  # the texts it sends until then
    streams: Streams  # messages that it sends unasked
    transfer_clock: TransferClock  # the clock on which transfers time out
    terrain: GroundSource  # source of its terrain heights
    stale_read_back: float  # fraction of the uploads after which a read-back still briefly returns the previous list


def quick(ready_s: float = 2.0) -> Behaviour:
    """A vehicle that is ready after ``ready_s`` seconds and passes its pre-arm checks half-way there."""
    return Behaviour(
        fix_s=0.5 * ready_s,
        checks_pass_s=0.5 * ready_s,
        ready_s=ready_s,
        start_texts=(),
        streams=Streams.EVERYTHING,
        transfer_clock=TransferClock.LINK,
        terrain=GroundSource.KNOWN,
        stale_read_back=0.0,
    )


OBSERVED: Mapping[int, Behaviour] = MappingProxyType(
    {
        autopilot: data_table(Behaviour, "uavcover/data/mock_behaviour.toml", autopilot.name.lower())
        for autopilot in (AutopilotId.ARDUPILOT, AutopilotId.PX4)
    }
)
"""By MAV_AUTOPILOT number."""


# The parameters of the mock vehicle: names, types, units and defaults of its autopilot, and what they control.

_REAL, _INT = 9, 6
"""MAV_PARAM_TYPE numbers: a 32-bit float and a 32-bit integer."""


@dataclass(frozen=True, slots=True)
class MockParameter:
    """One parameter."""

    default: float = 0.0  # its value unless it is set
    attribute: str = ""  # the attribute of ``Settings`` that it exposes; empty for a value of its own
    per_unit: float = 1.0  # units of the parameter in one of the attribute
    whole: bool = False  # whether it is an integer

    def __post_init__(self) -> None:
        if self.attribute and self.attribute not in Settings.__slots__:
            raise ValueError(f"{self.attribute!r} is not one of {', '.join(Settings.__slots__)}")


def _parameters(autopilot: AutopilotId) -> Mapping[str, MockParameter]:
    """Each row is a number, or names the setting that it exposes."""
    name, path = autopilot.name.lower(), "uavcover/data/mock_parameters.toml"
    plain = {"default": 0.0, "attribute": "", "per_unit": 1.0, "whole": False}
    return {
        key: table_of(
            MockParameter,
            plain | (row if isinstance(row, dict) else {"default": row, "whole": isinstance(row, int)}),
            where=f"{path}: {name}.{key}",
        )
        for key, row in read_document(path)[name].items()
    }


PARAMETERS: Mapping[int, Mapping[str, MockParameter]] = MappingProxyType(
    {autopilot: _parameters(autopilot) for autopilot in (AutopilotId.ARDUPILOT, AutopilotId.PX4)}
)
"""By MAV_AUTOPILOT number and name."""


class Parameters:
    """Values of one vehicle's parameters.

    Attributes:
        settings: the settings that some parameters expose.
    """

    def __init__(self, mav_autopilot: int, settings: Settings) -> None:
        self.settings = settings
        self._known = PARAMETERS[mav_autopilot]
        self._names = list(self._known)
        self._bytewise = mav_autopilot == AutopilotId.PX4
        self._values = {name: row.default for name, row in self._known.items() if not row.attribute}

    def __getitem__(self, name: str) -> float:
        """The value of a parameter in its own unit."""
        row = self._known[name]
        if row.attribute:
            return float(getattr(self.settings, row.attribute)) * row.per_unit
        return self._values[name]

    def name_of(self, name: str, index: int) -> str | None:
        """Name of the requested parameter, by index or else by name; None for one that does not exist."""
        if 0 <= index < len(self._names):
            return self._names[index]
        return name if name in self._known else None

    def message(self, name: str) -> ParamValue:
        """The PARAM_VALUE of a parameter: PX4 sends the bits of an integer, ArduPilot its value."""
        row, value = self._known[name], self[name]
        if row.whole and self._bytewise:
            value = float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
        return ParamValue(name, value, _INT if row.whole else _REAL, len(self._names), self._names.index(name))

    def messages(self) -> list[ParamValue]:
        """All of them, in order."""
        return [self.message(name) for name in self._names]

    def set(self, name: str, wire_value: float) -> None:
        """Set a parameter from its wire value; an invalid value changes nothing, as on real vehicles."""
        row = self._known[name]
        value = wire_value
        if row.whole and self._bytewise:
            value = float(struct.unpack("<i", struct.pack("<f", wire_value))[0])
        self.put(name, value)

    def put(self, name: str, value: float) -> None:
        """Set a parameter to a number in its own unit; an invalid value changes nothing."""
        row = self._known[name]
        if not row.attribute:
            self._values[name] = float(round(value)) if row.whole else value
            return
        try:
            changed: dict[str, Any] = {row.attribute: value / row.per_unit}
            self.settings = replace(self.settings, **changed)
        except ValueError:
            return
