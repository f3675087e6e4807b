"""Compare the plan's assumptions with the vehicle's settings, and find those that prevent arming.

Settings that would interrupt the flight, drain the battery or spoil what is seen prevent arming. Others are warnings: the mission
itself does not need them. Which parameter is which stands in data, see :mod:`uavcover.flight.parameter_rules`.
"""

import math
from collections.abc import Mapping

import numpy as np

from mission_io.model.items import Command, Frame
from uavcover.flight.flight_plan import FlightPlan
from uavcover.flight.parameter_rules import Limit, Weight, parameter_table
from uavcover.flight.tuning import PREPARATION
from uavcover.kernels.flight_time import Pace, mission_time
from uavcover.model.vehicle import MOTIONS

__all__ = ["Limit", "Weight", "limit_table", "parameter_groups", "plan_facts"]

_POINTS_GIMBAL = (Command.DO_MOUNT_CONTROL, Command.DO_GIMBAL_MANAGER_PITCHYAW)
_TAKES_PHOTO = (Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE)


def parameter_groups(*, px4: bool) -> list[list[str]]:
    """The names to ask for; of each group the vehicle has one, or none."""
    return [[name for name, _ in row.names] for row in parameter_table(px4=px4).rows]


def limit_table(
    values: Mapping[str, float],
    plan: FlightPlan,
    *,
    px4: bool,
    home_alt_amsl_m: float | None,
    own_system: int = 255,  # a ground station
) -> tuple[Limit, ...]:
    """Compare the plan with the vehicle's parameters.

    Args:
        values: the vehicle's parameters that are known, in their own units.
        plan: what is to be flown.
        px4: whether the vehicle is one; else ArduPilot.
        home_alt_amsl_m: the vehicle's home; None where it is not known.
        own_system: our own system id.
    """
    facts = plan_facts(plan, px4=px4) | {"own_system": float(own_system)}
    time = _flight_time(values, plan, px4=px4)
    if time is not None:
        facts["flight_time"] = time.vehicle
    rows = [row for row in parameter_table(px4=px4).judge(values, facts) if plan.needs or row.weight is not Weight.NONE]
    rows += [] if time is None else [time]
    rows += [] if home_alt_amsl_m is None else [_home(plan, home_alt_amsl_m)]
    return tuple(rows)


def plan_facts(plan: FlightPlan, *, px4: bool) -> dict[str, float]:
    """Assumptions of the plan, for the rules: see ``parameter_rules.FACTS``."""
    needs, items = plan.needs, plan.mission.items
    commands = {item.command for item in items}
    distance_m = max((i.params[0] for i in items if i.command == Command.DO_SET_CAM_TRIGG_DIST), default=0.0)
    facts = {
        "acceptance": plan.acceptance_radius_m,
        "climb": plan.max_climb_m_s,
        "descent": plan.max_descent_m_s,
        "gimbal": float(any(command in commands for command in _POINTS_GIMBAL)),
        "heading": float(
            px4 and any(0.0 < abs(i.params[3]) < math.inf for i in items if i.command == Command.NAV_WAYPOINT)
        ),
        "pictures": float(distance_m > 0.0 or any(command in commands for command in _TAKES_PHOTO)),
        "pictures_by_distance": float(distance_m > 0.0),
        "terrain_frames": float(any(item.frame is Frame.ABOVE_TERRAIN for item in items)),
        "gimbal_pitch": next((item.params[0] for item in items if item.command in _POINTS_GIMBAL), None),
        "yaw_rate": MOTIONS["px4" if px4 else "ardupilot"].yaw_rate_deg_s,
        "band_low": None if plan.volume is None else plan.volume.min_height_agl_m,
        "takeoff": next((item.alt_m for item in items if item.command == Command.NAV_TAKEOFF), None),
        **_extent(plan),
    }
    if needs is not None:
        finite = math.isfinite(needs.pace.acceleration_m_s2)
        facts |= {
            "camera_turns": float(needs.camera_turns),
            "cruise": needs.pace.cruise_m_s,
            "fence": float(needs.fence),
            "return_height": needs.return_height_m,
            "turn_time": float(finite),
        }
        facts |= {"acceleration": needs.pace.acceleration_m_s2, "jerk": needs.pace.jerk_m_s3} if finite else {}
        facts |= {"picture_interval": distance_m / needs.pace.cruise_m_s} if distance_m > 0.0 else {}
    return {name: value for name, value in facts.items() if value is not None}


def _extent(plan: FlightPlan) -> dict[str, float]:
    """Heights above home and distances from it."""
    path_m, home_m = (
        _path_m(plan),
        plan.frame.enu_from_geodetic(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)[0],
    )
    away_m = np.hypot(path_m[:, 0] - home_m[0], path_m[:, 1] - home_m[1])
    found = {"highest": float(path_m[:, 2].max() - home_m[2]), "farthest": float(away_m.max())}
    waypoints_m = plan.waypoints_m()
    places_m = np.vstack([plan.place_m(i) for i in plan.mission.items if i.command == Command.NAV_WAYPOINT] or [home_m])
    if plan.is_way_home:
        waypoints_m = places_m
    if len(waypoints_m):
        to_first_m = np.linalg.norm(waypoints_m - places_m[0], axis=1)
        found |= {
            "first": float(np.hypot(*(places_m[0] - home_m)[:2])),
            "lowest": float(places_m[:, 2].min() - home_m[2]),
            "restart_line": float(to_first_m.max()),
        }
    return found


def _path_m(plan: FlightPlan) -> np.ndarray:
    """(n, 3) ENU: from home on the ground by the take-off's top to where the mission lands."""
    legs = list(plan.legs_m().values())
    places = [leg[1] for leg in legs]
    home_m = plan.frame.enu_from_geodetic(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)[0]
    return np.vstack([home_m, *(leg[0] for leg in legs[:1] if len(legs) > 2), *places])


def _flight_time(values: Mapping[str, float], plan: FlightPlan, *, px4: bool) -> Limit | None:
    """The time of the mission by the vehicle's own speeds, and with its acceleration, against the endurance."""
    needs = plan.needs
    if needs is None:
        return None
    own = {
        row.key: values[name] / per_unit
        for row in parameter_table(px4=px4).rows
        for name, per_unit in reversed(row.names)
        if name in values
    }
    pace = needs.pace._replace(
        climb_m_s=own.get("climb", needs.pace.climb_m_s), descent_m_s=own.get("descent", needs.pace.descent_m_s)
    )
    if min(pace.climb_m_s, pace.descent_m_s) <= 0.0:
        return None
    path_m = _path_m(plan)

    def time_s(pace: Pace) -> float:
        return float(mission_time(pace, path_m)) if len(path_m) > 3 else 0.0

    by_speeds_s = time_s(pace)
    with_turns_s = time_s(
        pace._replace(
            acceleration_m_s2=own.get("acceleration", 0.0) or pace.acceleration_m_s2,
            jerk_m_s3=own.get("jerk", 0.0) or pace.jerk_m_s3,
        )
    )
    end_s, planned_s = needs.longest_flight_s, time_s(needs.pace)
    if end_s is None:
        weight, matters = Weight.NONE, "with the vehicle's own speeds and acceleration"
        if with_turns_s > PREPARATION.late_ratio * planned_s:
            weight, matters = (
                Weight.WARNING,
                f"the flight takes longer than planned {matters}: {_slower(own, needs.pace)}",
            )
        return Limit("flight time", round(planned_s, 1), round(with_turns_s, 1), "s", "", weight, matters)
    longer = f"the flight takes longer than the {end_s:g} s that endurance and reserve allow"
    weight, matters = Weight.NONE, f"with the vehicle's own speeds and acceleration; at most {end_s:g} s"
    if by_speeds_s > end_s:
        weight, matters = Weight.REFUSED, f"with the vehicle's own speeds, {longer}"
    elif with_turns_s > end_s:
        weight, matters = Weight.WARNING, f"with the vehicle's acceleration, {longer}"
    return Limit("flight time", round(planned_s, 1), round(with_turns_s, 1), "s", "", weight, matters)


def _slower(own: Mapping[str, float], pace: Pace) -> str:
    """Which of a vehicle's own values are below the planned ones."""
    planned = {
        "climb": (pace.climb_m_s, "m/s"), "descent": (pace.descent_m_s, "m/s"),
        "acceleration": (pace.acceleration_m_s2, "m/s2"), "jerk": (pace.jerk_m_s3, "m/s3"),
    }  # fmt: skip
    below = [
        f"{name} {own[name]:g} of {value:g} {unit}"
        for name, (value, unit) in planned.items()
        if 0.0 < own.get(name, 0.0) < value and math.isfinite(value)
    ]
    return ", ".join(below) or "its turns"


def _home(plan: FlightPlan, alt_amsl_m: float) -> Limit:
    """Heights in the mission are above home: an error in the altitude of home moves the whole route."""
    planned_m, around = plan.home.alt_amsl_m, plan.volume
    off_m = alt_amsl_m - planned_m
    weight, matters = Weight.NONE, "heights in the mission are relative to it"
    if abs(off_m) > PREPARATION.home_slack_m:
        side = "higher" if off_m > 0.0 else "lower"
        weight, matters = Weight.WARNING, f"the vehicle flies the whole route {abs(off_m):.1f} m {side} than planned"
        if around is not None:
            low_m, high_m = around.min_height_agl_m, around.max_height_agl_m
            matters += f": a band of {low_m:g} to {high_m:g} m becomes {low_m + off_m:.1f} to {high_m + off_m:.1f} m"
    return Limit("home altitude above sea level", round(planned_m, 2), round(alt_amsl_m, 2), "m", "", weight, matters)
