"""Aircraft of a mission, which its file does not name, and the defaults of its autopilot."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from uavcover.extras.check.tuning import CHECKS
from uavcover.model.vehicle import GRAVITY_M_S2, MOTIONS, AutopilotName

Kind = Literal["multirotor", "fixed-wing", "vtol"]
KINDS: Final[tuple[Kind, ...]] = ("multirotor", "fixed-wing", "vtol")
BANK_DEG: Final[Mapping[AutopilotName, float]] = MappingProxyType({"ardupilot": 45.0, "px4": 50.0})
"""LIM_ROLL_CD (ROLL_LIMIT_DEG) and FW_R_LIM."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aircraft:
    """An aircraft and its autopilot's settings."""

    autopilot: AutopilotName = "ardupilot"  # whose meaning the commands have
    kind: Kind = "multirotor"  # how it moves
    cruise_speed_m_s: float = 10.0  # over ground for a multirotor, through the air for the others
    max_climb_m_s: float = 2.5  # largest upward speed
    max_descent_m_s: float = 1.5  # largest downward speed
    max_airspeed_m_s: float | None = None  # largest speed through the air; none: wind does not slow a multirotor
    return_height_m: float = 15.0  # height above home of the autopilot's own return
    loiter_radius_m: float = 10.0  # radius of a circle whose item states none
    turn_radius_m: float = 0.0  # smallest radius of a turn at cruise speed; 0 for a multirotor
    acceptance_m: float = 0.0  # how far before a waypoint the next leg is taken, where its item does not say
    endurance_s: float | None = None  # time in the air; none: unknown
    reserve_fraction: float = 0.2  # share of it that a flight leaves
    speeds_from: str = "the autopilot's defaults"  # where the speeds are from, for people

    @property
    def speeds_in_words(self) -> str:
        """The speeds that times are reckoned with, and where they are from."""
        words = f"{self.cruise_speed_m_s:g} m/s, climb {self.max_climb_m_s:g} m/s, descent {self.max_descent_m_s:g} m/s"
        if not self.has_wings:
            words += f", acceleration {MOTIONS[self.autopilot].acceleration_m_s2:g} m/s2"
        return f"{words}; from {self.speeds_from}"

    @property
    def has_wings(self) -> bool:
        """Whether it flies between waypoints on wings."""
        return self.kind != "multirotor"

    def turn_radius_at(self, speed_m_s: float) -> float:
        """Smallest radius of a turn at a speed: with one bank it grows with the square."""
        return self.turn_radius_m * (speed_m_s / self.cruise_speed_m_s) ** 2


def default_aircraft(autopilot: AutopilotName, kind: Kind) -> Aircraft:
    """An aircraft with the parameters that its autopilot comes with.

    ArduCopter: WPNAV_SPEED, WPNAV_SPEED_UP, WPNAV_SPEED_DN, RTL_ALT, CIRCLE_RADIUS; ArduPlane: AIRSPEED_CRUISE, TECS_CLMB_MAX,
    TECS_SINK_MAX, ALT_HOLD_RTL, WP_LOITER_RAD, LIM_ROLL_CD, NAVL1_PERIOD; PX4: MPC_XY_CRUISE, MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN,
    FW_AIRSPD_TRIM, FW_T_CLMB_R_SP, FW_T_SINK_R_SP, RTL_RETURN_ALT, NAV_LOITER_RAD, FW_R_LIM,
    NPFG_PERIOD, NAV_ACC_RAD.
    """
    if kind == "multirotor":
        if autopilot == "px4":
            return Aircraft(
                autopilot=autopilot, cruise_speed_m_s=5.0, max_climb_m_s=3.0, max_descent_m_s=1.5, return_height_m=30.0,
                loiter_radius_m=80.0, acceptance_m=10.0,
            )  # fmt: skip
        return Aircraft(autopilot=autopilot)
    radius_m = radius_of_bank_m(15.0, BANK_DEG[autopilot])
    if autopilot == "px4":  # npfg's switch distance: 0.32 * 10 s / pi * 0.7 * 15 m/s
        return Aircraft(
            autopilot=autopilot, kind=kind, cruise_speed_m_s=15.0, max_climb_m_s=3.0, max_descent_m_s=2.0, return_height_m=60.0,
            loiter_radius_m=80.0, turn_radius_m=radius_m, acceptance_m=10.7,
        )  # fmt: skip
    return Aircraft(  # the L1 distance: 17 s / pi * 0.75 * 15 m/s; WP_RADIUS, 90 m, is more
        autopilot=autopilot, kind=kind, cruise_speed_m_s=15.0, max_climb_m_s=5.0, max_descent_m_s=5.0, return_height_m=100.0,
        loiter_radius_m=60.0, turn_radius_m=radius_m, acceptance_m=61.0,
    )  # fmt: skip


def radius_of_bank_m(speed_m_s: float, bank_deg: float) -> float:
    """Radius of a level turn at a bank: v^2 / (g tan bank)."""
    return speed_m_s**2 / (GRAVITY_M_S2 * math.tan(math.radians(bank_deg)))


def return_height_m(height_above_home_m: float, distance_m: float, aircraft: Aircraft) -> float:
    """Height above home at which an autopilot returns from a place.

    ArduCopter climbs to RTL_ALT, near home no higher than ``cone_slope`` times the distance (ModeRTL::compute_return_target).
    """
    wanted = aircraft.return_height_m
    if aircraft.autopilot == "ardupilot" and not aircraft.has_wings:
        wanted = min(wanted, max(CHECKS.cone_slope * distance_m, CHECKS.cone_climb_m))
    elif aircraft.has_wings and aircraft.autopilot == "ardupilot":
        return wanted
    return max(wanted, height_above_home_m)
