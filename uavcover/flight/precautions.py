"""The user's precautions before a flight and after a failure, and the proof that a vehicle is simulated.

Only a vehicle that is proved to be simulated may be armed without the user's confirmation.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache

from mission_io.data_tables import read_document
from mission_io.errors import VehicleSilentError
from mission_io.model.enums import AutopilotId
from mission_io.wire import messages as m
from uavcover.errors import VehicleError
from uavcover.flight.client import VehicleClient
from uavcover.flight.tuning import PREPARATION
from uavcover.model.outcome import Ending
from uavcover.model.vehicle import MOCK_UID

_GCS_PARAMETERS = ("MAV_GCS_SYSID", "SYSID_MYGCS")
"""Newer and older: the ground station that ArduPilot minds, which every one of its vehicles has."""


def simulated_by(client: VehicleClient) -> str | None:
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


def require_answers(client: VehicleClient) -> None:
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

    simulated: OnBreach  # what is done with a vehicle that is proved to be simulated
    real: OnBreach  # what is done with any other
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
        chosen: the user's ``--on-breach``; None where there is none.
    """
    rule = policy().get((breach, phase))
    if rule is None:
        return OnBreach.TELL
    if rule.choice and chosen is not None:
        return chosen
    return rule.simulated if simulated else rule.real
