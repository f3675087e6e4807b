"""Limits of a flight: the plan's assumptions against the vehicle's parameters, which may be set and put back.

Settings that would interrupt the flight, drain the battery or spoil the observations prevent arming. Others cause warnings. The
data classifies the parameters, see :mod:`uavcover.flight.parameter_rules`. Parameters are set only if the user agrees. They are
read and written as plain numbers in their own units; PX4 transmits the bits of its integers as if they were floats.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from mission_io.errors import MissionIoError, VehicleSilentError
from mission_io.model.items import Command, Frame, FramedPoint
from mission_io.model.plain_text import counted
from mission_io.protocol.parameters import float_of_value, is_whole, value_of_float
from mission_io.wire import messages as m
from mission_io.wire.messages import ParamRequestRead, ParamValue
from uavcover.flight.orders import PREPARATION, FlightPlan, Precautions
from uavcover.flight.parameter_rules import Limit, Weight, parameter_table
from uavcover.flight.session import Session
from uavcover.kernels.flight_time import Pace, mission_time
from uavcover.missions.failsafes import failsafe_parameter_groups
from uavcover.missions.return_advice import OwnReturns, ReturnAdvice
from uavcover.model.track import Ending, EventKind, FlightFaultError
from uavcover.model.vehicle import MOTIONS

_POINTS_GIMBAL = (Command.DO_MOUNT_CONTROL, Command.DO_GIMBAL_MANAGER_PITCHYAW)
_TAKES_PHOTO = (Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE)


def parameter_groups(*, px4: bool) -> list[list[str]]:
    """The names to request; the vehicle has at most one of each group."""
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
        plan: of the flight.
        px4: whether the vehicle is one; else ArduPilot.
        home_alt_amsl_m: the vehicle's home; None if unknown.
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
    positions_m = np.vstack(
        [plan.position_m(i) for i in plan.mission.items if i.command == Command.NAV_WAYPOINT] or [home_m]
    )
    if plan.is_return:
        waypoints_m = positions_m
    if len(waypoints_m):
        to_first_m = np.linalg.norm(waypoints_m - positions_m[0], axis=1)
        found |= {
            "first": float(np.hypot(*(positions_m[0] - home_m)[:2])),
            "lowest": float(positions_m[:, 2].min() - home_m[2]),
            "restart_line": float(to_first_m.max()),
        }
    return found


def _path_m(plan: FlightPlan) -> np.ndarray:
    """(n, 3) ENU: from home on the ground by the take-off's top to where the mission lands."""
    legs = list(plan.legs_m().values())
    positions = [leg[1] for leg in legs]
    home_m = plan.frame.enu_from_geodetic(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)[0]
    return np.vstack([home_m, *(leg[0] for leg in legs[:1] if len(legs) > 2), *positions])


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


def read_parameters(session: Session, groups: Iterable[Collection[str]]) -> dict[str, ParamValue]:
    """Ask for parameters; of each group of names for the same thing one answer is enough.

    A vehicle is silent about a parameter that it does not have, so a missing answer may also be lost: the parameter is requested
    again, and more often where a second question has found something. A few are requested at once, since ArduPilot keeps 20
    questions.
    """
    found = dict[str, ParamValue]()
    wanted = [tuple(names) for names in groups]
    quiet_s, found_at_once = PREPARATION.first_limit_answer_s, 0
    for number in range(PREPARATION.limit_rounds):
        left = [names for names in wanted if found.keys().isdisjoint(names)]
        found_at_once = len(found) if number == 1 else found_at_once
        if number > 1 and len(found) == found_at_once:
            break
        for first in range(0, len(left), PREPARATION.limits_at_once):
            quiet_s = _ask(session, left[first : first + PREPARATION.limits_at_once], found, quiet_s)
    # ArduPilot also broadcasts parameters that it counts by itself.
    requested = {name for names in wanted for name in names}
    return {name: value for name, value in found.items() if name in requested}


def _ask(session: Session, groups: Collection[Collection[str]], found: dict[str, ParamValue], quiet_s: float) -> float:
    """Ask once, and listen until everything is answered or the link is quiet; returns the next waiting time."""
    client = session.client
    to, began_s = client.vehicle, client.clock.now()
    for name in (name for names in groups for name in names):
        client.send(ParamRequestRead(*to.address, name))
    until_s, longest_s = began_s + quiet_s, began_s + PREPARATION.limit_answer_s
    while any(found.keys().isdisjoint(names) for names in groups) and client.clock.now() < min(until_s, longest_s):
        for received in client.poll(0.1):
            ours = received.sender == to.address
            if ours and isinstance(received.message, ParamValue):
                found[received.message.name] = received.message
                now = client.clock.now()
                quiet_s = max(PREPARATION.least_quiet_s, PREPARATION.quiet_answers * (now - began_s))
                until_s = now + quiet_s
    return quiet_s


def numbers(values: Mapping[str, ParamValue], *, px4: bool) -> dict[str, float]:
    """The values in their own units."""
    return {name: float(value_of_float(value.value, value.param_type, bytewise=px4)) for name, value in values.items()}


def _read_numbers(session: Session, groups: Iterable[Collection[str]]) -> dict[str, float]:
    """The same parameters in their own units."""
    return numbers(read_parameters(session, groups), px4=session.is_px4)


def set_parameter(session: Session, name: str, number: float) -> None:
    """Set a parameter of any type to a number in its own unit, and verify the value.

    Raises:
        VehicleSilentError: it does not exist, or the vehicle does not answer.
        mission_io.errors.MisuseError: the vehicle limits or refuses it.
    """
    client = session.client
    known = read_parameters(session, [[name]]).get(name)
    if known is None:
        raise VehicleSilentError(f"the vehicle did not report the parameter {name}")
    value = round(number) if is_whole(known.param_type) else number
    wire = float_of_value(value, known.param_type, bytewise=session.is_px4, name=name)
    client.set_parameter(name, wire, param_type=known.param_type, timeout_s=PREPARATION.limit_answer_s)


class AppliedLimits:
    """The limits of one flight, and what of the vehicle's parameters was changed for it.

    Args:
        session: with the vehicle.
        precautions: whether to change anything, whom to ask, and where old values are kept.

    Attributes:
        rows: the table as it was reported last; rows that are as planned and not ``shown`` are omitted.
        values: the vehicle's parameters of the table, in their own units, as they were read last.
    """

    def __init__(self, session: Session, precautions: Precautions) -> None:
        self._session, self._precautions = session, precautions
        self._before: dict[str, float] = {}
        self.rows: tuple[Limit, ...] = ()
        self.values: dict[str, float] = {}

    def put_back_older(self) -> None:
        """Restore parameters that an interrupted flight left changed."""
        if self._precautions.left_changed:
            self._before = dict(self._precautions.left_changed)
            self._session.tell(
                EventKind.STAGE, "an earlier flight left changed parameters on the vehicle; restoring them"
            )
            self.put_back()

    def check(self, plan: FlightPlan) -> None:
        """Report the table, and make the changes that the plan needs if the user agrees.

        Raises:
            FlightFaultError: the vehicle would not complete the plan.
        """
        self._read(plan)
        changes = {row.parameter: row for row in self.rows if row.wanted is not None}
        if self._precautions.apply_limits and changes:
            self._apply(changes)
            self._read(plan)
        for row in self.rows:
            if row.weight is Weight.WARNING:
                self._session.warn(row.sentence)
        refused = next((row for row in self.rows if row.weight is Weight.REFUSED), None)
        if refused is not None:
            advice = "plan a shorter flight" if not refused.parameter else "set the parameter"
            advice += ", or add --apply-limits" if refused.wanted is not None else ""
            raise FlightFaultError(Ending.NOT_ARMED, f"{refused.sentence}; the vehicle was not armed: {advice}")

    def look(self, plan: FlightPlan) -> None:
        """Report the table of a vehicle in the air: differences that would have prevented arming are alarms."""
        self._read(plan)
        for row in self.rows:
            if row.weight in (Weight.WARNING, Weight.REFUSED):
                self._session.tell(EventKind.WARNING, row.sentence, alarm=row.weight is Weight.REFUSED)

    def put_back(self) -> None:
        """Restore the old values; report failures, and keep them for the next time."""
        session = self._session
        if not self._before:
            return
        vehicle = session.client.vehicle
        left: dict[str, float] = {}
        why = ""
        for name, number in self._before.items():
            if vehicle.armed and session.monitor.on_ground is not True:
                left[name], why = number, "the vehicle is in the air and requires them for the remaining flight"
                continue
            try:
                set_parameter(session, name, number)
            except MissionIoError as error:
                left[name], why = number, str(error)
        self._before = left
        self._precautions.keep(left)
        if left:
            text = ", ".join(f"{name} was {number:g}" for name, number in left.items())
            session.alarm(f"some parameters on the vehicle remain changed ({why}): {text}")
        else:
            session.tell(EventKind.STAGE, "restored the vehicle's previous parameters")

    def _read(self, plan: FlightPlan) -> None:
        session, px4 = self._session, self._session.is_px4
        self.values = _read_numbers(session, parameter_groups(px4=px4))
        home = session.monitor.latest(m.HomePosition)
        self.rows = tuple(
            row
            for row in limit_table(
                self.values, plan, px4=px4,
                home_alt_amsl_m=None if home is None else home.alt_amsl_m, own_system=session.client.local.system_id,
            )
            if row.shown
        )  # fmt: skip
        if plan.needs is not None:
            session.tell_limits("limits: planned | on the vehicle | effect", self.rows)

    def _apply(self, changes: Mapping[str, Limit]) -> None:
        session = self._session
        old = _read_numbers(session, [[name] for name in changes])
        wanted = {name: row.wanted for name, row in changes.items() if row.wanted is not None and name in old}
        text = ", ".join(f"{name} {old[name]:g} -> {number:g}" for name, number in wanted.items())
        if not self._precautions.agree(f"parameters to set for this flight and restore afterwards: {text}"):
            session.warn(f"the parameters were not changed: {text}")
            return
        self._before = {name: old[name] for name in wanted}
        self._precautions.keep(self._before)
        for name, number in wanted.items():
            try:
                set_parameter(session, name, number)
            except MissionIoError as error:
                session.warn(f"cannot set the parameter {name}: {error}")
        session.tell(EventKind.STAGE, f"parameters set for this flight: {text}")


_MOST_SAID = 6


def tell_returns_by(
    session: Session, returns: OwnReturns, parameters: Mapping[str, float], rally: Sequence[FramedPoint] | None
) -> None:
    """Warn of every unsafe interval of the vehicle's own returns by its parameters and rally points; nothing is refused."""
    for words in return_warnings(returns.advice(parameters, rally=rally)):
        session.warn(words)


def return_warnings(advice: ReturnAdvice) -> list[str]:
    """Unsafe returns, one line for each interval, then the remedy."""
    found = [f"the autopilot's own return is not safe {words}" for words in advice.sentences[:_MOST_SAID]]
    if len(advice.sentences) > _MOST_SAID:
        more = len(advice.sentences) - _MOST_SAID
        parts = counted(more, "further part of the flight also has", "further parts of the flight also have")
        found.append(f"{parts} an unsafe return")
    if found:
        found.append(advice.remedy)
    return found


def read_return_parameters(session: Session) -> Mapping[str, float]:
    """The vehicle's values of the parameters that its returns depend on, in their own units."""
    return _read_numbers(session, failsafe_parameter_groups("px4" if session.is_px4 else "ardupilot"))
