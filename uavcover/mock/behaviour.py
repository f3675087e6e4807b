"""Flight, start-up, messages and transfers of the mock vehicle, by autopilot, as data.

``OBSERVED`` reproduces two simulated vehicles (``data/mock_behaviour.toml``). ``quick`` is a vehicle without their
delays: ready in two seconds, with all streams on from the start, and with transfer timeouts on the link's clock.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from mission_io.data_tables import data_table
from mission_io.model.enums import AutopilotId, Severity
from mission_io.wire import messages as m
from uavcover.mock.guidance import Speeds
from uavcover.model.vehicle import AutopilotMotion, AutopilotName, Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of the vehicle's flight without commands of a mission.

    Attributes:
        cruise_m_s: ground speed.
        climb_m_s: upward speed.
        descent_m_s: downward speed.
        land_m_s: downward speed of the last metres.
        acceptance_radius_m: a waypoint without a radius of its own counts as reached within this distance.
        return_height_m: height above home that the vehicle returns at.
        motion: how it is led along legs, up and down; none: as fast as its airframe can.
    """

    cruise_m_s: float = 10.0
    climb_m_s: float = 4.0
    descent_m_s: float = 3.0
    land_m_s: float = 0.7
    acceptance_radius_m: float = 2.0
    return_height_m: float = 30.0
    motion: AutopilotMotion | None = None

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if name != "motion" and not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: {getattr(self, name)} must be above 0")

    @classmethod
    def for_vehicle(cls, vehicle: Vehicle, autopilot: AutopilotName | None = None) -> "Settings":
        """The settings of a scenario's vehicle under an autopilot; its own where none is named."""
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

    LINK = "seconds of the link, independent of the speed of the vehicle's time"
    VEHICLE = "vehicle time, as simulated autopilots do"


class GroundSource(Enum):
    """Source of the terrain heights."""

    KNOWN = "the ground is on its memory card"
    GROUND_STATION = "it requests the ground with TERRAIN_REQUEST"


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
    """A STATUSTEXT sent during start-up.

    Attributes:
        at_s: when, in seconds since it was switched on.
        severity: how bad it is.
        text: the line.
    """

    at_s: float
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Behaviour:
    """One way to behave.

    Attributes:
        fix_s: satellite fix, in seconds since it was switched on.
        checks_pass_s: home is known and the pre-arm bit is good.
        ready_s: arming works.
        start_texts: the texts it sends until then.
        streams: messages that it sends unasked.
        transfer_clock: the clock on which transfers time out.
        terrain: source of its terrain heights.
        stale_read_back: share of the uploads after which a read-back still returns the previous list for a moment.
    """

    fix_s: float
    checks_pass_s: float
    ready_s: float
    start_texts: tuple[StartText, ...]
    streams: Streams
    transfer_clock: TransferClock
    terrain: GroundSource
    stale_read_back: float


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
