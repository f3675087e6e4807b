"""The vehicle and the wind it is planned for."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.errors import InputError
from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """Constant wind for the whole flight.

    Attributes:
        speed_m_s: horizontal wind speed.
        from_deg: direction it comes from, clockwise from north.
    """

    __pydantic_config__: ClassVar = STRICT

    speed_m_s: float = 0.0
    from_deg: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(speed_m_s=self.speed_m_s)
        require(abs(self.from_deg) <= 360.0, f"from_deg: {self.from_deg} is outside -360..360 degrees")


AutopilotName = Literal["ardupilot", "px4"]


def autopilot_name(text: str | None, default: AutopilotName) -> AutopilotName:
    """Check the name of an autopilot; none is the default.

    Raises:
        InputError: it is neither.
    """
    match text:
        case None:
            return default
        case "ardupilot" | "px4":
            return text
    raise InputError(f"--autopilot: {text!r} is neither ardupilot nor px4")


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """The multirotor, as planning needs it.

    Attributes:
        cruise_speed_m_s: ground speed along the legs.
        max_climb_m_s: largest upward speed.
        max_descent_m_s: largest downward speed.
        max_airspeed_m_s: largest airspeed, for the wind of the scenario; none: wind does not limit the speed.
        acceleration_m_s2: acceleration over ground at a waypoint; none: turns take no time.
        acceptance_radius_m: a waypoint counts as reached within this distance.
        takeoff_height_m: height above home of the vertical climb, raised where the transit requires it.
        return_height_m: height above home of the autopilot's own return, checked from every waypoint.
        endurance_s: longest flight, or none. A route that takes longer is flown as several sorties.
        max_mission_items: largest number of mission items, home included where the autopilot counts it; none: the known limit.
        autopilot: the autopilot whose conventions mission files follow, unless a command says otherwise.
    """

    __pydantic_config__: ClassVar = STRICT

    cruise_speed_m_s: float = 10.0
    max_climb_m_s: float = 4.0
    max_descent_m_s: float = 3.0
    max_airspeed_m_s: float | None = None
    acceleration_m_s2: float | None = None
    acceptance_radius_m: float = 3.0
    takeoff_height_m: float = 30.0
    return_height_m: float = 60.0
    endurance_s: float | None = None
    max_mission_items: int | None = None
    autopilot: AutopilotName = "ardupilot"

    def __post_init__(self) -> None:
        require_positive(
            cruise_speed_m_s=self.cruise_speed_m_s,
            max_climb_m_s=self.max_climb_m_s,
            max_descent_m_s=self.max_descent_m_s,
            acceptance_radius_m=self.acceptance_radius_m,
            takeoff_height_m=self.takeoff_height_m,
            return_height_m=self.return_height_m,
        )
        require(
            self.cruise_speed_m_s <= 100.0,
            f"cruise_speed_m_s: {self.cruise_speed_m_s} m/s is too fast for a multirotor",
        )
        airspeed, acceleration = self.max_airspeed_m_s, self.acceleration_m_s2
        require(
            airspeed is None or airspeed >= self.cruise_speed_m_s,
            f"max_airspeed_m_s: {airspeed} m/s is below cruise_speed_m_s = {self.cruise_speed_m_s}",
        )
        require(acceleration is None or acceleration > 0.0, "acceleration_m_s2: must be above 0")
        require(self.endurance_s is None or self.endurance_s > 0.0, "endurance_s: must be above 0")
        require(
            self.max_mission_items is None or self.max_mission_items >= 8,
            f"max_mission_items: {self.max_mission_items} is too few for take-off, a leg and landing (8)",
        )
