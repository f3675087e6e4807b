"""The user's precautions before a flight and after a failure, and the proof that a vehicle is simulated.

Only a vehicle that is proved to be simulated may be armed without the user's confirmation.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from mission_io.errors import VehicleSilentError
from mission_io.model.enums import AutopilotId
from mission_io.wire import messages as m
from uavcover.errors import VehicleError
from uavcover.flight.client import VehicleClient
from uavcover.flight.tuning import PREPARATION
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
                client.send(m.ParamRequestRead(vehicle.system_id, vehicle.component_id, name))
        for received in client.poll(0.1):
            ours = (received.system_id, received.component_id) == (vehicle.system_id, vehicle.component_id)
            # It also broadcasts parameters that it changes by itself, such as its running time.
            if ours and isinstance(received.message, m.ParamValue) and received.message.name in _GCS_PARAMETERS:
                return
    if client.heartbeat_age_s < PREPARATION.proof_answer_s:
        own = client.local.system_id
        raise VehicleError(
            f"vehicle {vehicle.system_id} sends heartbeats, but does not answer this program (system "
            f"{own}){client.signing_advice()}; it may accept only one ground station (MAV_OPTIONS 1, SYSID_ENFORCE): "
            f"set --own-system to the number in its MAV_GCS_SYSID (SYSID_MYGCS), or set that to {own}"
        )


class OnBreach(Enum):
    """Reaction when the vehicle leaves its route, fence, height band or known ground, or has another mission."""

    TELL = "tell"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True, kw_only=True)
class Precautions:
    """The user's precautions.

    Attributes:
        on_breach: what to do on a breach; None leaves it to the policy (``data/breach_policy.toml``).
        apply_limits: whether to set the parameters that the plan needs, and to put the old values back at the end.
        agree: asked with the list of changes before any is made.
        keep: receives the old values while they are changed, to have them on disk; an empty mapping when all are back.
        left_changed: old values that an earlier flight could not put back.
        photos_required: whether a camera that reports no photo at all is an alarm too.
    """

    on_breach: OnBreach | None = None
    apply_limits: bool = False
    agree: Callable[[str], bool] = lambda _: False
    keep: Callable[[Mapping[str, float]], None] = lambda _: None
    left_changed: Mapping[str, float] = field(default_factory=dict)
    photos_required: bool = False


USUAL = Precautions()
"""The default precautions."""
