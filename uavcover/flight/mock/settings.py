"""How the mock vehicle flies unless a mission says otherwise."""

from dataclasses import dataclass

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
