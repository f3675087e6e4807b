"""What can be set on the mock vehicle, and the parameter names and units that each autopilot has for it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from mission_io.enums import AutopilotId
from uavcover.flight.mock.guidance import Speeds
from uavcover.model.vehicle import Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """How the vehicle flies unless a mission says otherwise.

    Attributes:
        cruise_m_s: ground speed.
        climb_m_s: upward speed.
        descent_m_s: downward speed.
        land_m_s: downward speed of the last metres.
        acceptance_radius_m: a waypoint without a radius of its own counts as reached within this distance.
        return_height_m: height above home that the vehicle returns at.
    """

    cruise_m_s: float = 10.0
    climb_m_s: float = 4.0
    descent_m_s: float = 3.0
    land_m_s: float = 0.7
    acceptance_radius_m: float = 2.0
    return_height_m: float = 30.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: {getattr(self, name)} must be above 0")

    @classmethod
    def for_vehicle(cls, vehicle: Vehicle) -> "Settings":
        """The settings of the vehicle that a scenario plans with."""
        return cls(
            cruise_m_s=vehicle.cruise_speed_m_s,
            climb_m_s=vehicle.max_climb_m_s,
            descent_m_s=vehicle.max_descent_m_s,
            acceptance_radius_m=vehicle.acceptance_radius_m,
            return_height_m=vehicle.return_height_m,
        )

    @property
    def speeds(self) -> Speeds:
        """The three speeds."""
        return Speeds(self.cruise_m_s, self.climb_m_s, self.descent_m_s)


PARAMETERS: Mapping[int, Mapping[str, tuple[str, float]]] = MappingProxyType(
    {
        AutopilotId.ARDUPILOT: {
            "WPNAV_SPEED": ("cruise_m_s", 100.0),
            "WPNAV_SPEED_UP": ("climb_m_s", 100.0),
            "WPNAV_SPEED_DN": ("descent_m_s", 100.0),
            "LAND_SPEED": ("land_m_s", 100.0),
            "WPNAV_RADIUS": ("acceptance_radius_m", 100.0),
            "RTL_ALT": ("return_height_m", 100.0),
        },
        AutopilotId.PX4: {
            "MPC_XY_CRUISE": ("cruise_m_s", 1.0),
            "MPC_Z_V_AUTO_UP": ("climb_m_s", 1.0),
            "MPC_Z_V_AUTO_DN": ("descent_m_s", 1.0),
            "MPC_LAND_SPEED": ("land_m_s", 1.0),
            "NAV_ACC_RAD": ("acceptance_radius_m", 1.0),
            "RTL_RETURN_ALT": ("return_height_m", 1.0),
        },
    }
)
"""Parameter name to attribute of :class:`Settings` and units per metre."""


def parameter(settings: Settings, mav_autopilot: int, name: str) -> float | None:
    """The value of a parameter in its own unit; None when the vehicle has none of that name."""
    if name not in PARAMETERS[mav_autopilot]:
        return None
    attribute, per_unit = PARAMETERS[mav_autopilot][name]
    return float(getattr(settings, attribute)) * per_unit


def with_parameter(settings: Settings, mav_autopilot: int, name: str, value: float) -> Settings:
    """The settings after a parameter was set; a value that makes no sense changes nothing, as on real vehicles."""
    attribute, per_unit = PARAMETERS[mav_autopilot][name]
    try:
        return replace(settings, **{attribute: value / per_unit})
    except ValueError:
        return settings
