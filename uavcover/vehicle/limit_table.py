"""Compares what the plan assumes with the vehicle's settings, and tells what prevents arming.

Settings that would interrupt the flight or drain the battery prevent arming: an active fence that is too low or too small, and
speeds at which the mission takes longer than the endurance. A low return height and an inactive fence are warnings: the
mission itself needs neither.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

import numpy as np

from uavcover.kernels.flight_time import Pace, mission_time
from uavcover.vehicle.flight_plan import FlightPlan

_SLOWER = 0.99
"""Parameters are 32-bit numbers in units of their own: what is slower by less is rounding."""
_RETURN_SLACK_M = 0.5
_HOME_SLACK_M = 3.0
_ABOVE_MISSION_M, _BEYOND_MISSION_M = 10.0, 50.0
_HEIGHT_BIT, _CIRCLE_BIT, _AREAS_BIT = 1, 2, 4

_Names = tuple[tuple[str, float], ...]
"""Names of a parameter, older and newer, each with its units in one metre, metre per second or metre per second squared."""


_IDLE_FENCE = "the uploaded fence is not in force"


class Weight(Enum):
    """How serious a difference is."""

    NONE = "none"
    NOTE = "note"
    WARNING = "warning"
    REFUSED = "refused"


_Verdict = tuple[Weight, str, float | None]
"""How much it matters, why, and what the plan needs it to be, in the table's unit."""
_Judge = Callable[[float], _Verdict]


@dataclass(frozen=True, slots=True)
class Limit:
    """A row of the table.

    Attributes:
        what: for people.
        planned: what the plan counts on, in ``unit``; None where it does not say.
        vehicle: what the vehicle says, in ``unit``.
        unit: of both; empty for a setting's number.
        parameter: the vehicle's; empty for what is no parameter.
        weight: how much the difference matters.
        matters: why.
        wanted: what the plan needs the parameter to be, in the parameter's own unit; None for nothing.
        doing: what the vehicle does at such a speed, for people; empty for what is none.
    """

    what: str
    planned: float | None
    vehicle: float
    unit: str
    parameter: str
    weight: Weight
    matters: str
    wanted: float | None = None
    doing: str = ""

    def as_json(self) -> dict[str, Any]:
        """For ``--json``."""
        values = asdict(self)
        del values["doing"]
        return {**values, "weight": self.weight.value}

    @property
    def sentence(self) -> str:
        """The row as a warning."""
        name, unit = f" ({self.parameter})" if self.parameter else "", f" {self.unit}" if self.unit else ""
        if self.doing and self.planned is not None:
            return (
                f"the vehicle {self.doing} at {self.vehicle:g}{unit}{name}, the plan counts on {self.planned:g}{unit}: "
                f"{self.matters}; plan with the vehicle's speeds, or set the parameter"
            )
        planned = "" if self.planned is None else f", planned {self.planned:g}{unit}"
        return f"{self.what}: the vehicle has {self.vehicle:g}{unit}{name}{planned}; {self.matters}"

    @property
    def line(self) -> str:
        """The row for people: planned | vehicle | matters because."""
        planned = "-" if self.planned is None else f"{self.planned:g} {self.unit}".strip()
        name = f" ({self.parameter})" if self.parameter else ""
        mark = {Weight.WARNING: "! ", Weight.REFUSED: "X "}.get(self.weight, "  ")
        return f"{mark}{self.what} | {planned} | {f'{self.vehicle:g} {self.unit}'.strip()}{name} | {self.matters}"


_ARDUPILOT: Mapping[str, _Names] = {
    "cruise": (("WPNAV_SPEED", 100.0), ("WP_SPD", 1.0)),
    "climb": (("WPNAV_SPEED_UP", 100.0), ("WP_SPD_UP", 1.0)),
    "descent": (("WPNAV_SPEED_DN", 100.0), ("WP_SPD_DN", 1.0)),
    "acceleration": (("WPNAV_ACCEL", 100.0), ("WP_ACC", 1.0)),
    "jerk": (("WPNAV_JERK", 1.0), ("WP_JERK", 1.0)),
    "return": (("RTL_ALT", 100.0), ("RTL_ALT_M", 1.0)),
    **{
        name: ((name, 1.0),)
        for name in (
            "FENCE_ENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_ALT_MAX", "FENCE_RADIUS", "BATT_FS_LOW_ACT",
            "BATT_FS_CRT_ACT", "FS_GCS_ENABLE",
        )
    },
}  # fmt: skip
_PX4: Mapping[str, _Names] = {
    "cruise": (("MPC_XY_CRUISE", 1.0),),
    "climb": (("MPC_Z_V_AUTO_UP", 1.0), ("MPC_Z_VEL_MAX_UP", 1.0)),
    "descent": (("MPC_Z_V_AUTO_DN", 1.0), ("MPC_Z_VEL_MAX_DN", 1.0)),
    "acceleration": (("MPC_ACC_HOR", 1.0),),
    "jerk": (("MPC_JERK_AUTO", 1.0),),
    "return": (("RTL_RETURN_ALT", 1.0),),
    **{
        name: ((name, 1.0),)
        for name in ("GF_ACTION", "GF_MAX_VER_DIST", "GF_MAX_HOR_DIST", "COM_LOW_BAT_ACT", "NAV_DLL_ACT")
    },
}


def parameter_groups(*, px4: bool) -> list[list[str]]:
    """The names to ask for; of each group the vehicle has one, or none."""
    return [[name for name, _ in names] for names in (_PX4 if px4 else _ARDUPILOT).values()]


def limit_table(
    values: Mapping[str, float], plan: FlightPlan, *, px4: bool, home_alt_amsl_m: float | None
) -> tuple[Limit, ...]:
    """Compare the plan with the vehicle's parameters.

    Args:
        values: the vehicle's parameters that are known, in their own units.
        plan: what is to be flown.
        px4: whether the vehicle is one; else ArduPilot.
        home_alt_amsl_m: the vehicle's home; None where it is not known.
    """
    table = _Table(values, plan, _PX4 if px4 else _ARDUPILOT)
    table.add_speeds()
    table.add_time()
    table.add_return()
    if px4:
        table.add_px4_fence()
        table.add_settings({"COM_LOW_BAT_ACT": "low battery", "NAV_DLL_ACT": "lost ground station"})
    else:
        table.add_ardupilot_fence()
        table.add_settings(
            {
                "BATT_FS_LOW_ACT": "low battery",
                "BATT_FS_CRT_ACT": "critical battery",
                "FS_GCS_ENABLE": "lost ground station",
            }
        )
    if home_alt_amsl_m is not None:
        table.add_home(home_alt_amsl_m)
    return tuple(table.rows)


class _Table:
    def __init__(self, values: Mapping[str, float], plan: FlightPlan, names: Mapping[str, _Names]) -> None:
        self._values, self._plan, self._names = values, plan, names
        self._needs = plan.needs
        self.rows: list[Limit] = []
        legs = list(plan.legs_m().values())
        places = [leg[1] for leg in legs]
        home_m = plan.frame.enu_from_geodetic(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)[0]
        path = np.vstack([home_m, *places]) if places else home_m.reshape(1, 3)
        self._path_m = np.vstack([home_m, *(leg[0] for leg in legs[:1]), *places]) if len(legs) > 2 else path
        self._highest_m = float(path[:, 2].max() - home_m[2])
        self._farthest_m = float(np.hypot(path[:, 0] - home_m[0], path[:, 1] - home_m[1]).max())

    def _reading(self, key: str) -> tuple[str, float, float] | None:
        """Name, value in our unit, and units of the parameter in one of ours; None for what the vehicle does not have."""
        for name, per_unit in self._names.get(key, ()):
            if name in self._values:
                return name, self._values[name] / per_unit, per_unit
        return None

    def _number(self, key: str, default: float) -> float:
        reading = self._reading(key)
        return default if reading is None else reading[1]

    def _add(
        self, key: str, what: str, planned: float | None, unit: str,
        judge: _Judge, doing: str = "",
    ) -> None:  # fmt: skip
        reading = self._reading(key)
        if reading is None:
            return
        name, value, per_unit = reading
        weight, matters, wanted = judge(value)
        wanted = None if wanted is None else wanted * per_unit
        self.rows.append(Limit(what, planned, value, unit, name, weight, matters, wanted, doing))

    def add_speeds(self) -> None:
        plan = self._plan
        for key, doing, planned in (
            ("climb", "climbs", plan.max_climb_m_s),
            ("descent", "descends", plan.max_descent_m_s),
        ):
            if planned is not None:
                self._add(key, f"{key} speed", planned, "m/s", _slower(planned), doing)
        if self._needs is None:
            return
        pace = self._needs.pace
        slow = self._number("cruise", math.inf) < _SLOWER * pace.cruise_m_s
        own_speed = _when(
            slow, Weight.NOTE, "the mission sets its own speed", otherwise="the mission sets its own speed"
        )
        self._add("cruise", "waypoint speed", pace.cruise_m_s, "m/s", own_speed)
        if math.isfinite(pace.acceleration_m_s2):
            self._add("acceleration", "acceleration", pace.acceleration_m_s2, "m/s2", _slower(pace.acceleration_m_s2))
            self._add("jerk", "jerk", pace.jerk_m_s3, "m/s3", _slower(pace.jerk_m_s3))
        else:
            self._add("acceleration", "acceleration", None, "m/s2", _fine("this plan counts no time for turns"))
            self._add("jerk", "jerk", None, "m/s3", _fine("this plan counts no time for turns"))

    def add_time(self) -> None:
        """The time of the mission by the vehicle's own speeds, and with its acceleration, against the endurance."""
        needs = self._needs
        if needs is None or needs.longest_flight_s is None:
            return
        pace = needs.pace._replace(
            climb_m_s=self._number("climb", needs.pace.climb_m_s),
            descent_m_s=self._number("descent", needs.pace.descent_m_s),
        )
        if min(pace.climb_m_s, pace.descent_m_s) <= 0.0:
            return
        accelerated = pace._replace(
            acceleration_m_s2=self._number("acceleration", 0.0) or pace.acceleration_m_s2,
            jerk_m_s3=self._number("jerk", 0.0) or pace.jerk_m_s3,
        )
        by_speeds_s, with_turns_s = self._time_s(pace), self._time_s(accelerated)
        end_s = needs.longest_flight_s
        longer = f"it takes longer than the {end_s:g} s that endurance and reserve allow"
        weight, matters = Weight.NONE, f"by the vehicle's own speeds and acceleration; at most {end_s:g} s"
        if by_speeds_s > end_s:
            weight, matters = Weight.REFUSED, f"by its own speeds {longer}"
        elif with_turns_s > end_s:
            weight, matters = Weight.WARNING, f"with its acceleration {longer}"
        self.rows.append(
            Limit("flight time", round(self._time_s(needs.pace), 1), round(with_turns_s, 1), "s", "", weight, matters)
        )

    def _time_s(self, pace: Pace) -> float:
        """From home on the ground by the take-off's top to where the mission lands."""
        return float(mission_time(pace, self._path_m)) if len(self._path_m) > 3 else 0.0

    def add_return(self) -> None:
        if self._needs is None:
            return
        planned = self._needs.return_height_m

        def judge(height_m: float) -> _Verdict:
            if height_m < planned - _RETURN_SLACK_M:
                return (
                    Weight.WARNING,
                    "a failsafe flies home straight at it, and only the planned height was checked",
                    planned,
                )
            return Weight.NONE, "a failsafe flies home straight at it", None

        self._add("return", "return height", planned, "m", judge)

    def add_ardupilot_fence(self) -> None:
        needs = self._needs
        if needs is None:
            return
        enabled, kinds = self._number("FENCE_ENABLE", 0.0) != 0.0, int(self._number("FENCE_TYPE", 0.0))
        idle = needs.fence and not enabled
        in_force = "the fence is in force" if enabled else "no fence is needed"
        judge = _when(idle, Weight.WARNING, _IDLE_FENCE, 1.0, otherwise=in_force)
        self._add("FENCE_ENABLE", "fence in force", float(needs.fence), "", judge)
        no_areas = needs.fence and not kinds & _AREAS_BIT
        areas = _when(
            no_areas, Weight.WARNING, "polygons are no part of it", float(kinds | _AREAS_BIT),
            otherwise="1 height, 2 circle, 4 polygons",
        )  # fmt: skip
        self._add("FENCE_TYPE", "kinds of fence", None, "", areas)
        acts = self._number("FENCE_ACTION", 1.0) != 0.0
        reaction = _when(
            not acts, Weight.NOTE, "leaving the fence is only reported", otherwise="what the vehicle does there"
        )
        self._add("FENCE_ACTION", "at the fence", None, "", reaction)
        if kinds & _HEIGHT_BIT:
            self._add_bound("FENCE_ALT_MAX", "fence height", self._highest_m, enabled and acts, idle, _ABOVE_MISSION_M)
        if kinds & _CIRCLE_BIT:
            self._add_bound("FENCE_RADIUS", "fence radius", self._farthest_m, enabled and acts, idle, _BEYOND_MISSION_M)

    def add_px4_fence(self) -> None:
        needs = self._needs
        if needs is None:
            return
        acts = self._number("GF_ACTION", 2.0) >= 2.0
        idle = needs.fence and not acts
        judge = _when(idle, Weight.WARNING, _IDLE_FENCE, 2.0, otherwise="what the vehicle does there")
        self._add("GF_ACTION", "at the fence", None, "", judge)
        for key, what, reach_m, beyond_m in (
            ("GF_MAX_VER_DIST", "fence height", self._highest_m, _ABOVE_MISSION_M),
            ("GF_MAX_HOR_DIST", "fence radius", self._farthest_m, _BEYOND_MISSION_M),
        ):
            if self._number(key, 0.0) > 0.0:
                self._add_bound(key, what, reach_m, acts, idle, beyond_m)

    def _add_bound(self, key: str, what: str, reach_m: float, acts: bool, will_act: bool, beyond_m: float) -> None:
        """A height or radius that the mission must not reach."""

        def judge(most_m: float) -> _Verdict:
            if most_m > reach_m:
                return Weight.NONE, "the mission stays inside of it", None
            wanted = float(math.ceil(reach_m + beyond_m))
            if acts:
                return Weight.REFUSED, "the mission goes beyond it: the vehicle would break it off", wanted
            why = "the mission goes beyond it, once the fence is in force"
            return (Weight.NOTE, why, wanted) if will_act else (Weight.NOTE, why, None)

        self._add(key, what, round(reach_m, 1), "m", judge)

    def add_settings(self, settings: Mapping[str, str]) -> None:
        if self._needs is None:
            return
        for key, what in settings.items():
            nothing = self._number(key, 1.0) == 0.0
            judge = _when(
                nothing, Weight.NOTE, "the vehicle does nothing by itself", otherwise="what the vehicle does then"
            )
            self._add(key, what, None, "", judge)

    def add_home(self, alt_amsl_m: float) -> None:
        """Heights in the mission are above home: where home is in height, the whole route goes with it."""
        planned_m, around = self._plan.home.alt_amsl_m, self._plan.volume
        off_m = alt_amsl_m - planned_m
        weight, matters = Weight.NONE, "heights of the mission are above it"
        if abs(off_m) > _HOME_SLACK_M:
            side = "higher" if off_m > 0.0 else "lower"
            weight, matters = Weight.WARNING, f"the whole route is flown {abs(off_m):.1f} m {side} than planned"
            if around is not None:
                low_m, high_m = around.min_height_agl_m, around.max_height_agl_m
                matters += (
                    f": a band of {low_m:g} to {high_m:g} m becomes {low_m + off_m:.1f} to {high_m + off_m:.1f} m"
                )
        self.rows.append(
            Limit("home above sea level", round(planned_m, 2), round(alt_amsl_m, 2), "m", "", weight, matters)
        )


def _slower(planned: float) -> _Judge:
    def judge(value: float) -> _Verdict:
        if value >= _SLOWER * planned:
            return Weight.NONE, "the flight takes no longer than planned", None
        return Weight.WARNING, "the flight takes longer than planned", planned

    return judge


def _when(bad: bool, weight: Weight, why: str, wanted: float | None = None, *, otherwise: str) -> _Judge:
    verdict = (weight, why, wanted) if bad else (Weight.NONE, otherwise, None)
    return lambda _: verdict


def _fine(why: str) -> _Judge:
    return lambda _: (Weight.NONE, why, None)
