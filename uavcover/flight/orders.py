"""Orders and precautions for a flight: its plan, timeouts, the user's wishes, and which vehicles may be flown.

Only multirotors may be flown: plans, return routes and the meaning of a landing hold for nothing else. Only a vehicle that is
proved to be simulated may be armed without the user's confirmation.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache

import numpy as np

from mission_io.autopilots.autopilot import Autopilot, Mode
from mission_io.autopilots.autopilot import custom_mode as number_of_mode
from mission_io.client.client import Client
from mission_io.client.peers import VehicleInfo, two_in_one
from mission_io.data_tables import data_table, read_document
from mission_io.errors import MisuseError, VehicleSilentError
from mission_io.model.enums import AutopilotId, Firmware, VehicleKind, type_name
from mission_io.model.items import Command, Fence, Frame, GeoPoint, Mission, MissionItem, RallyPoints
from mission_io.wire import messages as m
from uavcover.errors import InputError, VehicleError
from uavcover.flight.ground_contact import GroundAt
from uavcover.flight.monitor import Monitor
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import Pace
from uavcover.missions.return_advice import OwnReturns
from uavcover.model.track import Ending, FlightEvent, TrackSample
from uavcover.model.vehicle import MOCK_UID, Vehicle
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class _Preparation:
    telemetry_tries: int
    ask_why_s: float
    arming_answer_s: float
    arming_tries: int
    reached_items: int
    position_each_s: float
    parameter_each_s: float
    most_unanswered: int
    list_each_s: float
    limit_answer_s: float
    first_limit_answer_s: float
    least_quiet_s: float
    quiet_answers: float
    limits_at_once: int
    limit_rounds: int
    home_slack_m: float
    late_ratio: float
    proof_answer_s: float
    proof_again_s: float
    after_restart_s: float
    shown_items: int


PREPARATION = data_table(_Preparation, "uavcover/data/flight.toml", "preparation")


_POSITIONS = (Command.NAV_WAYPOINT, Command.NAV_TAKEOFF, Command.NAV_LAND, Command.NAV_LOITER_TIME)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanNeeds:
    """Assumptions of a plan about the vehicle's settings."""

    pace: Pace  # its speeds and acceleration
    return_height_m: float  # height above home at which a straight return was checked
    fence: bool  # whether it requires an active fence
    camera_turns: bool = False  # whether the camera turns with the vehicle, and so with its legs
    # what the mission may take, its endurance less the reserve; None where there is no limit
    longest_flight_s: float | None = None
    vehicle: Vehicle | None = None  # its endurance and reserve, to watch the battery against; None skips that
    # seconds from a (3,) ENU place in flight to the ground at home along a checked transit; None if none is known. Raises
    # UavcoverError where there is no such transit.
    return_s: Callable[[FloatArray], float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingVolume:
    """Where the vehicle may be: fence, height band and known ground."""

    # height of the ground in the local frame by east and north; NaN where unknown
    ground_up_m: Callable[[float, float], float]
    # distance outside the fence, or inside one of its exclusions, by east and north; 0 where it is kept
    outside_fence_m: Callable[[float, float], float]
    min_height_agl_m: float  # lower end of the height band between the first and the last planned waypoint
    max_height_agl_m: float  # its upper end


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPlan:
    """The mission that the vehicle must hold, and what was planned with it."""

    mission: Mission  # the mission as it was uploaded; the vehicle's is compared with it before arming
    first_waypoint_item: int  # index in ``mission.items`` of the first planned waypoint
    waypoint_count: int  # number of planned waypoints from it on
    frame: LocalFrame  # the scenario's local frame, for the track
    home: GeoPoint  # where the mission was planned to start
    ground_alt_amsl_m: float | None = None  # height of the terrain at ``home``; None without terrain
    ground_at: GroundAt | None = None  # height of the terrain anywhere; None without terrain
    # largest distance of the vehicle's home from the planned one, over ground and in height
    max_home_error_m: float = 10.0
    passed_before: int = 0  # number of planned waypoints that an earlier flight passed
    acceptance_radius_m: float = 3.0  # distance within which a planned waypoint counts as passed
    max_climb_m_s: float | None = None  # upward speed that the plan assumes; None when it assumes none
    max_descent_m_s: float | None = None  # downward speed that the plan assumes
    # ground, fence and height band to check positions against in flight; None skips the check
    volume: OperatingVolume | None = None
    # what else the plan assumes, for the table of limits before arming; None skips the table
    needs: PlanNeeds | None = None
    # how many items each planned waypoint takes: itself, then commands that are carried out there
    items_per_waypoint: int = 1
    returns: OwnReturns | None = None  # judges the vehicle's own returns by its parameters; None skips the check
    lists: tuple[
        Fence | RallyPoints, ...
    ] = ()  # what the vehicle is to hold beside the mission, compared before arming

    def return_plan(self, mission: Mission, *, home_up_m: float) -> "FlightPlan":
        """The plan of a return that the vehicle now holds, without planned waypoints.

        Args:
            mission: as sent.
            home_up_m: how much higher than planned the vehicle's home is.
        """
        home = replace(self.home, alt_amsl_m=self.home.alt_amsl_m + home_up_m)
        return replace(
            self, mission=mission, home=home, first_waypoint_item=len(mission.items), waypoint_count=0, passed_before=0,
            items_per_waypoint=1, returns=None,
        )  # fmt: skip

    @property
    def is_return(self) -> bool:
        """Whether it is only a return."""
        return self.waypoint_count == 0

    @property
    def _end_item(self) -> int:
        """Index of the first item behind the planned waypoints."""
        return self.first_waypoint_item + self.items_per_waypoint * self.waypoint_count

    def waypoints_m(self) -> FloatArray:
        """(n, 3) ENU, the planned waypoints, from their items."""
        planned = slice(self.first_waypoint_item, self._end_item, self.items_per_waypoint)
        positions = [self.position_m(item) for item in self.mission.items[planned]]
        return np.array(positions, dtype=float).reshape(-1, 3)

    def legs_m(self) -> dict[int, FloatArray]:
        """The leg to each item, by its index: (2, 3) ENU; empty for the first position and for commands."""
        legs: dict[int, FloatArray] = {}
        before: FloatArray | None = None
        for index, item in enumerate(self.mission.items):
            if not self.has_position(item):
                continue
            here = self.position_m(item)
            if before is not None:
                legs[index] = np.vstack([before, here])
            before = here
        return legs

    def has_position(self, item: MissionItem) -> bool:
        """Whether an item leads to a position of its own."""
        return item.command in _POSITIONS and (item.lat_deg, item.lon_deg) != (0.0, 0.0)

    def position_m(self, item: MissionItem) -> FloatArray:
        """(3,) ENU, the position of an item as it was planned."""
        alt_amsl_m = item.alt_m + (self.home.alt_amsl_m if item.frame is Frame.ABOVE_HOME else 0.0)
        position_m: FloatArray = self.frame.enu_from_geodetic(item.lat_deg, item.lon_deg, alt_amsl_m)[0]
        return position_m

    def index_of(self, seq: int, autopilot: Autopilot) -> int:
        """Index in ``mission.items`` of item ``seq`` on the wire."""
        return seq - (1 if autopilot.home_in_item_0 else 0)

    def waypoint_of(self, seq: int, autopilot: Autopilot) -> int:
        """Number of the planned waypoint of wire item ``seq``, or of its command; -1 for other items."""
        number = (self.index_of(seq, autopilot) - self.first_waypoint_item) // self.items_per_waypoint
        return number if 0 <= number < self.waypoint_count else -1

    def is_past_waypoints(self, seq: int, autopilot: Autopilot) -> bool:
        """Whether item ``seq`` on the wire comes after the last planned waypoint."""
        return self.index_of(seq, autopilot) >= self._end_item


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightTimeouts:
    """Timeouts of a flight, in seconds of vehicle time unless noted otherwise."""

    deadman_s: float = 3.0  # silence, or time without a position, before a warning; on the link's clock
    # time without a heartbeat, while other messages arrive, before a warning; on the link's clock
    heartbeat_s: float = 5.0
    link_lost_s: float = 30.0  # silence before the vehicle is given up; on the link's clock
    ready_s: float = 120.0  # time to get ready for arming; ArduPilot needs about 41 s
    arm_s: float = 10.0  # time during which a refused arming is retried
    # the same for a vehicle that requests terrain heights, since it last requested others than before
    terrain_s: float = 60.0
    start_s: float = 30.0  # time from the start command to leaving the ground
    halt_s: float = 20.0  # time to come to rest after a hold command
    stuck_s: float = 60.0  # time without progress
    # without moving in a mode that a pilot or another station chose, after which following ends; by default it never
    # does, and the record goes on until the vehicle is on the ground
    override_s: float = math.inf
    # time of holding because of a breach, after which following ends and the vehicle is left holding
    held_s: float = 180.0
    rate_s: float = 2.0  # window over which telemetry rates are measured
    disarm_s: float = 30.0  # time from landing to disarming itself
    watchdog: float = 10.0  # each timeout in vehicle time also ends after this many times as long on the link's clock

    def __post_init__(self) -> None:
        for name in self.__slots__:
            endless = name == "override_s" and getattr(self, name) == math.inf
            if not (0.0 < getattr(self, name) < math.inf or endless):
                raise InputError(f"{name}: must be greater than 0, not {getattr(self, name):g}")
        if self.link_lost_s < self.deadman_s:
            raise InputError(f"link_lost_s: must be at least deadman_s ({self.deadman_s:g}), not {self.link_lost_s:g}")


class OnBreach(Enum):
    """Reaction when the vehicle leaves its route, fence, height band or known ground, or has another mission."""

    TELL = "tell"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True, kw_only=True)
class Precautions:
    """The user's precautions."""

    # what to do on a breach; None leaves it to the policy (``data/breach_policy.toml``)
    on_breach: OnBreach | None = None
    # whether to set the parameters that the plan needs, and to put the old values back at the end
    apply_limits: bool = False
    agree: Callable[[str], bool] = lambda _: False  # asked with the list of changes before any is made
    # receives the old values while they are changed, to have them on disk; an empty mapping when all are back
    keep: Callable[[Mapping[str, float]], None] = lambda _: None
    # old values that an earlier flight could not put back
    left_changed: Mapping[str, float] = field(default_factory=dict)
    photos_required: bool = False  # whether a camera that reports no photo at all is an alarm too


USUAL = Precautions()
"""The default precautions."""


# Reaction to a breach: one table of breach, phase and kind of vehicle (``data/breach_policy.toml``).


class Phase(Enum):
    """The part of a flight in which a breach is judged."""

    OUTBOUND = "outbound"
    ROUTE = "route"
    INBOUND = "inbound"
    HOLD = "hold"
    RETURN = "return"


@dataclass(frozen=True, slots=True)
class PolicyCell:
    """One cell of the table."""

    simulated: OnBreach  # reaction of a vehicle that is proved to be simulated
    real: OnBreach  # reaction of any other vehicle
    choice: bool  # whether the user's ``--on-breach`` replaces it
    reason: str  # why, for the documentation


@cache
def policy() -> Mapping[tuple[Ending, Phase], PolicyCell]:
    """The table: a rule for each breach and phase with a reaction, or with a report only."""
    rules: dict[tuple[Ending, Phase], PolicyCell] = {}
    for row in read_document("uavcover/data/breach_policy.toml")["row"]:
        rule = PolicyCell(OnBreach(row["simulated"]), OnBreach(row["real"]), row["choice"], row["reason"])
        for phase in row["phase"]:
            rules[Ending[row["breach"].upper()], Phase(phase)] = rule
    return rules


def reaction(breach: Ending, phase: Phase, *, simulated: bool, chosen: OnBreach | None) -> OnBreach:
    """The reaction to a breach.

    Args:
        breach: what went wrong.
        phase: where in the flight.
        simulated: whether the vehicle is proved to be simulated.
        chosen: the user's ``--on-breach``; None without one.
    """
    rule = policy().get((breach, phase))
    if rule is None:
        return OnBreach.TELL
    if rule.choice and chosen is not None:
        return chosen
    return rule.simulated if simulated else rule.real


@dataclass(frozen=True, slots=True, kw_only=True)
class Clearance:
    """Permission to start or fly home, asked repeatedly while the vehicle waits, holds or flies."""

    may_start: Callable[[], bool] = lambda: True  # whether it may arm and take off now
    # whether it may fly these checked legs home now; raises InfeasibleError when it never may, and the vehicle is left
    # holding then
    may_go_home: Callable[[Mission], bool] = lambda _: True
    # why it must end its mission now and fly home along checked legs, as text, None while it may fly on; without such a
    # function its own battery and endurance decide
    must_go_home: Callable[[], str | None] | None = None


ALONE = Clearance()
"""No other vehicle is near."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Orders:
    """The user's orders for a flight, and the receiver of its events."""

    on_sample: Callable[[TrackSample], None]  # called with every sample as it is recorded, also when the flight fails
    on_event: Callable[[FlightEvent], None] = lambda _: None  # called with every event
    # called before the vehicle is armed, or commanded in the air; an exception that it raises ends the flight there
    on_begin: Callable[[], None] = lambda: None
    # how often the user has asked to stop (Ctrl-C): once to fly home along checked legs, twice to hold
    stop: Callable[[], int] = lambda: 0
    # whether the user wants the vehicle to hold its place; it continues when this turns false
    pause: Callable[[], bool] = lambda: False
    confirmed: bool = False  # whether the user confirmed that a vehicle that may be real may be flown
    timeouts: FlightTimeouts | None = None  # timeouts; None: the defaults
    precautions: Precautions = USUAL  # precautions before the flight and on failures
    clearance: Clearance = ALONE  # permission to start, and to fly home, near other vehicles
    # from the link's clock to UTC, for the times of arrival in the track; NaN where there is no such clock
    utc_offset_s: float = math.nan


_GCS_PARAMETERS = ("MAV_GCS_SYSID", "SYSID_MYGCS")
"""Newer and older: the ground station that ArduPilot minds, which every one of its vehicles has."""


def require_multirotor(client: Client) -> VehicleInfo:
    """The vehicle that is talked to, if it is a multirotor whose flight modes are known. Nothing is sent for that.

    Raises:
        VehicleError: it is something else, or two vehicles share its ids.
    """
    vehicle = client.vehicle
    if client.impostor is not None:
        raise VehicleError(f"{two_in_one(vehicle, client.impostor)}; no command was sent")
    if vehicle.kind is not VehicleKind.MULTIROTOR:
        name = type_name(vehicle.vehicle_type)
        what = name if vehicle.kind in (VehicleKind.OTHER, VehicleKind.VTOL) else vehicle.kind.value
        article = "an" if what[0] in "aeio" else "a"
        raise VehicleError(
            f"vehicle {vehicle.system_id} reports that it is {article} {what}, MAV_TYPE {vehicle.vehicle_type}; uavcover "
            "supports only multirotors, so nothing was uploaded, changed or armed"
        )
    if vehicle.autopilot.firmware is Firmware.OTHER:
        raise VehicleError(f"the flight modes of vehicle {vehicle.system_id}, {vehicle.described}, are unknown")
    return vehicle


def custom_mode(autopilot: Autopilot, mode: Mode) -> int:
    """The heartbeat's ``custom_mode`` of a mode. Raises VehicleError: such a vehicle has no such mode."""
    try:
        return number_of_mode(autopilot, mode)
    except MisuseError as error:
        raise VehicleError(str(error)) from None


def simulated_by(client: Client) -> str | None:
    """The simulator of the vehicle; None without proof.

    Heartbeats cannot tell. What counts as proof:

    - the mock vehicle's own ``uid`` in AUTOPILOT_VERSION, where real autopilots have a hardware serial number;
    - ArduPilot: the parameter SIM_SPEEDUP, which only simulator builds have;
    - PX4: SYS_HITL other than 0, with which it drives no motors. PX4's software-in-the-loop has no parameter that a
      flight controller's build could not have too, so it needs the user's word.
    """
    try:
        if client.request_message(m.AutopilotVersion, timeout_s=PREPARATION.proof_answer_s).uid == MOCK_UID:
            return "uavcover's mock vehicle"
    except VehicleSilentError:
        pass  # not every autopilot answers; the parameters may still tell
    name = "SYS_HITL" if client.vehicle.mav_autopilot == AutopilotId.PX4 else "SIM_SPEEDUP"
    try:
        value = client.read_parameter(name, timeout_s=PREPARATION.proof_answer_s).value
    except VehicleSilentError:
        return None
    if name == "SIM_SPEEDUP":
        return "ArduPilot's simulator"
    return "PX4 with simulated hardware" if value != 0.0 else None


def require_answers(client: Client) -> None:
    """Refuse an ArduPilot that sends heartbeats and answers nothing: it may listen to another ground station alone.

    Its parameter for that cannot be read then, so silence is the sign.

    Raises:
        VehicleError: it does not answer.
    """
    vehicle = client.vehicle
    if vehicle.mav_autopilot != AutopilotId.ARDUPILOT:
        return
    until_s, again_s = client.clock.now() + PREPARATION.proof_answer_s, -math.inf
    while client.clock.now() < until_s:
        if client.clock.now() >= again_s:
            again_s = client.clock.now() + PREPARATION.proof_again_s
            for name in _GCS_PARAMETERS:
                client.send(m.ParamRequestRead(*vehicle.address, name))
        for received in client.poll(0.1):
            ours = received.sender == vehicle.address
            # It also broadcasts parameters that it changes by itself, such as its running time.
            if ours and isinstance(received.message, m.ParamValue) and received.message.name in _GCS_PARAMETERS:
                return
    if client.heartbeat_age_s < PREPARATION.proof_answer_s:
        own = client.local.system_id
        raise VehicleError(
            f"vehicle {vehicle.system_id} sends heartbeats, but does not answer this program (system "
            f"{own}){client.signing_advice()}; it may accept only one ground station (MAV_OPTIONS 1, SYSID_ENFORCE): "
            f"set --own-system to its MAV_GCS_SYSID (SYSID_MYGCS), or set that parameter to {own}"
        )


def require_one_vehicle(client: Client, monitor: Monitor) -> None:
    """Refuse two vehicles that share one system ID, by what was heard so far: each command would go to both.

    Raises:
        VehicleError: answers have two hardware numbers, or positions go back and forth between two places.
    """
    if monitor.positions.apart_m is not None:
        found = f"its positions alternate between two places {monitor.positions.apart_m:.0f} m apart"
    elif any(len({uid for uid in uids if uid}) > 1 for uids in zip(*monitor.uids, strict=True)):
        found = "it answers with different hardware IDs (UID of AUTOPILOT_VERSION)"
    else:
        return
    raise VehicleError(
        f"two vehicles share system ID {client.vehicle.system_id}: {found}, and each command would go to both, so "
        "nothing was uploaded or armed; change the system ID of one of them"
    )
