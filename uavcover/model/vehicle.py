"""The vehicle and the wind it is planned for."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Literal, get_args

from mission_io.data_tables import (
    STRICT,
    read_document,
    require,
    require_between,
    require_not_negative,
    require_positive,
)
from uavcover.errors import InputError
from uavcover.model.area import Outline
from uavcover.model.limits import Home
from uavcover.model.sensor import Sensor

# Several vehicles that fly one plan: how many there are, and what keeps them apart.


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """Number of vehicles, and their separation.

    All vehicles are equal ([vehicle]) and have take-off pads at and beside [home], unless each has its own [[vehicle]].
    """

    __pydantic_config__: ClassVar = STRICT

    vehicles: int = 1  # number of vehicles that fly at the same time
    turnaround_s: float = 300.0  # time from the landing of a vehicle to its next take-off with a new battery
    separation_m: float = 20.0  # smallest distance between two vehicles in flight
    # possible deviation of a vehicle from its planned path. Planned paths are separated by twice this distance more.
    path_error_m: float = 3.0
    timing_error_fraction: float = 0.05  # fraction of the time since take-off by which a vehicle may be early or late
    start_error_s: float = 5.0  # time by which a take-off may be early or late
    # possible difference between the arrival times of positions from two vehicles, because of link delays or several
    # computers. Verification uses it.
    clock_error_s: float = 0.5
    # time that a vehicle stands at home before take-off and after landing. No other vehicle may be close during this
    # time.
    pad_s: float = 30.0
    # distance between the take-off pads of equal vehicles. The first pad is [home]; a plan names the others. Default,
    # and least: `separation_m`, twice `path_error_m` and twice `limits.max_home_error_m`. 0: all vehicles take off from
    # [home], one after the other.
    pad_spacing_m: float | None = None
    max_pad_slope_deg: float = 15.0  # steepest ground of a pad
    # whether only one vehicle flies at a time. Each takes off `turnaround_s` after the previous landing. This always
    # applies to a vehicle with several launch points ([[launch_point]]).
    one_at_a_time: bool = False

    def __post_init__(self) -> None:
        require_between(self, 1, 50, "vehicles")
        require_not_negative(self, "turnaround_s", "start_error_s", "pad_s", "pad_spacing_m")
        require_not_negative(self, "path_error_m", "clock_error_s")
        require_positive(self, "separation_m")
        require_between(self, 0.0, 0.5, "timing_error_fraction")
        require(
            0.0 < self.max_pad_slope_deg < 90.0,
            f"max_pad_slope_deg: must be between 0 and 90, not {self.max_pad_slope_deg}",
        )

    @property
    def planned_separation_m(self) -> float:
        """Least distance between planned paths: each vehicle may be beside its own."""
        return self.separation_m + 2.0 * self.path_error_m

    @property
    def held_apart_m(self) -> float:
        """Distance below which one of two vehicles holds its position: both positions are known, and only one of them moves."""
        return self.separation_m + self.path_error_m


# Power model of a multirotor: the parameters of its battery use, with the origin of their defaults.

AIR_KG_M3 = 1.225
"""Density of the standard atmosphere at sea level."""
GRAVITY_M_S2 = 9.80665
_INDUCED_M_S = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerModel:
    """Power model of the vehicle, relative to hovering. Hovering for ``endurance_s`` empties a full battery.

    Induced power decreases with the airspeed (Glauert; Leishman, Principles of Helicopter Aerodynamics, 2.14). The drag of
    blades, rotors and body increases with it. A climb needs additional power. The defaults suit a 2 kg quadcopter with
    10 inch rotors.
    """

    __pydantic_config__: ClassVar = STRICT

    mass_kg: float | None = None  # take-off mass at which the vehicle hovers for `endurance_s`
    payload_kg: float = 0.0  # additional mass. The hover power increases with the mass to the power of 1.5.
    # total disc area of all rotors. Together with `mass_kg`, it determines the induced velocity.
    rotor_area_m2: float | None = None
    # induced velocity in hover at `mass_kg`; default: computed from `mass_kg` and `rotor_area_m2`, or 6
    hover_induced_m_s: float | None = None
    # fraction of the hover power of the rotors that overcomes blade drag; 0.474 in Zeng et al. 2019.
    profile_share: float = 0.0
    tip_speed_m_s: float = 120.0  # speed of the blade tips
    rotor_drag_1_s: float = 0.2  # rotor drag as acceleration per metre per second of airspeed
    body_drag_area_m2: float = 0.0  # drag coefficient times frontal area of the body; requires `mass_kg`
    idle_share: float = 0.03  # fraction of the hover power that the electronics use
    descent_gain: float = 0.3  # fraction of the potential energy that a descent recovers
    # margin for the battery use, as a fraction. Sorties are planned with this margin.
    uncertainty_fraction: float = 0.05

    def __post_init__(self) -> None:
        require_positive(self, "tip_speed_m_s", "mass_kg", "rotor_area_m2", "hover_induced_m_s")
        require_not_negative(self, "payload_kg", "rotor_drag_1_s", "body_drag_area_m2")
        require(0.0 <= self.profile_share < 1.0, f"profile_share: must be between 0 and 1, not {self.profile_share}")
        require(0.0 <= self.idle_share < 1.0, f"idle_share: must be between 0 and 1, not {self.idle_share}")
        require_between(self, 0.0, 1.0, "descent_gain", "uncertainty_fraction")
        for key in ("payload_kg", "rotor_area_m2", "body_drag_area_m2"):
            require(not getattr(self, key) or self.mass_kg is not None, f"{key}: this key requires mass_kg")
        require(
            self.rotor_area_m2 is None or self.hover_induced_m_s is None,
            "hover_induced_m_s: rotor_area_m2 already defines this value; remove one of the two keys",
        )

    @property
    def load(self) -> float:
        """Factor on the mass that hovers for ``endurance_s``, with payload."""
        return 1.0 if self.mass_kg is None else 1.0 + self.payload_kg / self.mass_kg

    @property
    def hover_factor(self) -> float:
        """Power in hover with the payload, as a multiple of that without: thrust times induced velocity."""
        return math.pow(self.load, 1.5)

    @property
    def induced_m_s(self) -> float:
        """Induced velocity in hover with the payload, ``sqrt(weight / (2 density area))``."""
        if self.mass_kg is not None and self.rotor_area_m2 is not None:
            weight_n = self.mass_kg * self.load * GRAVITY_M_S2
            return math.sqrt(weight_n / (2.0 * AIR_KG_M3 * self.rotor_area_m2))
        return (self.hover_induced_m_s or _INDUCED_M_S) * math.sqrt(self.load)

    @property
    def body_drag_1_m(self) -> float:
        """Drag of the body as acceleration per square of the airspeed."""
        if self.mass_kg is None:
            return 0.0
        return 0.5 * AIR_KG_M3 * self.body_drag_area_m2 / (self.mass_kg * self.load)


MOCK_UID = int.from_bytes(b"uavcover", "big")
"""The ``uid`` in the mock vehicle's AUTOPILOT_VERSION: how it says that it is no real vehicle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """Constant wind during the flight, and the wind for which batteries are planned."""

    __pydantic_config__: ClassVar = STRICT

    speed_m_s: float = 0.0  # horizontal wind speed
    from_deg: float = 0.0  # direction from which the wind blows, clockwise from north
    # strongest steady wind, from any direction, in which every flight keeps its reserve; default: only the wind above
    most_m_s: float | None = None
    # standard deviation of the wind in each horizontal direction. Gusts increase the battery use.
    gust_m_s: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(self, "speed_m_s", "gust_m_s")
        require(
            self.most_m_s is None or self.most_m_s >= self.speed_m_s,
            f"most_m_s: must be at least speed_m_s = {self.speed_m_s}, not {self.most_m_s}",
        )
        require_between(self, -360.0, 360.0, "from_deg", unit=" degrees")


AutopilotName = Literal["ardupilot", "px4"]


def autopilot_name(text: str | None, default: AutopilotName) -> AutopilotName:
    """Check the name of an autopilot; none is the default. Raises InputError: it is neither."""
    match text:
        case None:
            return default
        case "ardupilot" | "px4":
            return text
    raise InputError(f"--autopilot: must be ardupilot or px4, not {text!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotMotion:
    """Default motion of an autopilot's multirotor between waypoints, at take-off and at landing."""

    acceleration_m_s2: float  # over ground
    vertical_acceleration_m_s2: float  # up and down
    jerk_m_s3: float  # how fast the acceleration changes
    # "blended": the next leg begins before the last one has ended; "braked": it slows down for the corner
    corner: Literal["blended", "braked"]
    corner_radius_m: float  # within which it passes a waypoint
    smoothing_s: float = 0.0  # by which each leg takes longer because the jerk does not change at once
    # by which a long leg takes longer because the vehicle follows its own set speed late; measured
    settling_s: float = 0.0
    settling_tc_s: float = 1.0  # time constant of that; measured
    # largest change of vertical speed at a waypoint that it does not brake for; None: any
    vertical_change_m_s: float | None = None
    takeoff_m_s: float | None = None  # speed of the first metres of the climb; None: as any climb
    takeoff_slow_m: float = 0.0  # how many metres these are
    land_m_s: float  # speed of the last metres of the landing
    land_slow_m: float  # how many metres these are
    land_band_m: float  # metres above those over which the speed changes
    # at which its nose turns
    yaw_rate_deg_s: float = 60.0  # ATC_SLEW_YAW of ArduCopter, MPC_YAWRAUTO_MAX of PX4 from 1.15 on (45 before)
    yaw_acceleration_deg_s2: float | None = None  # how fast that rate changes; None: at once


MOTIONS: Mapping[AutopilotName, AutopilotMotion] = MappingProxyType(
    {name: AutopilotMotion(**read_document("uavcover/data/motions.toml")[name]) for name in get_args(AutopilotName)}
)
"""Motion of ArduCopter 4.7 and PX4 1.17."""


_LEAST_SPEED_M_S = 0.01
"""A flight takes 28 hours per kilometre at this speed, and is examined each second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """Performance of the multirotor."""

    __pydantic_config__: ClassVar = STRICT

    cruise_speed_m_s: float = 10.0  # ground speed along the legs
    max_climb_m_s: float = 4.0  # greatest climb speed
    max_descent_m_s: float = 3.0  # greatest descent speed
    max_airspeed_m_s: float | None = None  # greatest airspeed; default: wind does not limit the ground speed
    # horizontal acceleration; default: value of the autopilot (ArduPilot 2.5, PX4 3.0). With `inf`, turns take no time.
    acceleration_m_s2: float | None = None
    # rate of change of the acceleration; default: value of the autopilot (ArduPilot 1.0, PX4 4.0)
    jerk_m_s3: float | None = None
    acceptance_radius_m: float = 3.0  # distance at which the autopilot considers a waypoint as reached
    takeoff_height_m: float = 30.0  # height above home of the vertical climb; increased if the transit requires it
    return_height_m: float = 60.0  # height above home of the autopilot's own return
    endurance_s: float | None = None  # hover time of a full battery. No planned flight takes longer. Default: no limit.
    # fraction of the battery and endurance that every planned flight keeps in reserve. A longer mission is split into
    # sorties.
    reserve_fraction: float = 0.2
    # largest number of mission items, including home if the autopilot counts it; default: known limit of the autopilot
    max_mission_items: int | None = None
    autopilot: AutopilotName = "ardupilot"  # autopilot for which mission files are written
    power: PowerModel = field(default_factory=PowerModel)  # power model of the vehicle
    home: Home | None = None  # take-off and landing position of one of several vehicles; default: [home]
    # part of the area for one of several vehicles; default: vehicles without a part share the rest
    area: Outline | None = None
    # sensor of one of several vehicles; default: [sensor]. Vehicles with different sensors fly different parts of the
    # area.
    sensor: Sensor | None = None
    link: str | None = None  # URL of the vehicle for commands without `--to`
    system_id: int | None = None  # MAVLink system id of the vehicle; required if several vehicles share a link

    def __post_init__(self) -> None:
        require_positive(self, "cruise_speed_m_s", "max_climb_m_s", "max_descent_m_s", "acceptance_radius_m")
        require_positive(self, "takeoff_height_m", "return_height_m")
        for key in ("cruise_speed_m_s", "max_climb_m_s", "max_descent_m_s"):
            speed = getattr(self, key)
            require(speed >= _LEAST_SPEED_M_S, f"{key}: {speed} m/s is too slow for a multirotor; use a higher speed")
        require(
            self.cruise_speed_m_s <= 100.0,
            f"cruise_speed_m_s: {self.cruise_speed_m_s} m/s is too fast for a multirotor; use a lower speed",
        )
        airspeed, acceleration = self.max_airspeed_m_s, self.acceleration_m_s2
        require(
            airspeed is None or airspeed >= self.cruise_speed_m_s,
            f"max_airspeed_m_s: must be at least cruise_speed_m_s = {self.cruise_speed_m_s}, not {airspeed}",
        )
        require(acceleration is None or acceleration > 0.0, "acceleration_m_s2: must be greater than 0")
        require(self.jerk_m_s3 is None or self.jerk_m_s3 > 0.0, "jerk_m_s3: must be greater than 0")
        require(self.endurance_s is None or self.endurance_s > 0.0, "endurance_s: must be greater than 0")
        require_between(self, 1, 255, "system_id")
        require(
            0.0 <= self.reserve_fraction < 1.0,
            f"reserve_fraction: must be between 0 and 1, not {self.reserve_fraction}",
        )
        require(
            self.max_mission_items is None or self.max_mission_items >= 8,
            f"max_mission_items: must be at least 8 (take-off, a leg and landing), not {self.max_mission_items}",
        )

    @property
    def hover_s(self) -> float | None:
        """Time in hover on a full battery with the payload; None without a endurance."""
        return None if self.endurance_s is None else self.endurance_s / self.power.hover_factor

    @property
    def longest_flight_s(self) -> float | None:
        """Longest planned flight: the endurance less the reserve; None without an endurance."""
        return None if self.hover_s is None else (1.0 - self.reserve_fraction) * self.hover_s

    def motion(self, autopilot: AutopilotName | None = None) -> AutopilotMotion:
        """Motion of an autopilot, by default the scenario's, with the scenario's acceleration and jerk where it has them."""
        own = MOTIONS[autopilot or self.autopilot]
        return replace(
            own,
            acceleration_m_s2=own.acceleration_m_s2 if self.acceleration_m_s2 is None else self.acceleration_m_s2,
            jerk_m_s3=own.jerk_m_s3 if self.jerk_m_s3 is None else self.jerk_m_s3,
        )
