"""What the user wants done before a flight and when it goes wrong, and whether a vehicle is proved to be simulated.

Only a vehicle that is proved to be simulated may be armed without the user's confirmation.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from mission_io.errors import VehicleSilentError
from mission_io.model.enums import AutopilotId
from mission_io.wire import messages as m
from uavcover.vehicle.client import VehicleClient

MOCK_UID = int.from_bytes(b"uavcover", "big")
"""The ``uid`` in the mock vehicle's AUTOPILOT_VERSION: how it says that it is no real vehicle."""

_ANSWER_S = 8.0


def simulated_by(client: VehicleClient) -> str | None:
    """What simulates the vehicle; None without proof.

    Heartbeats cannot tell. What counts as proof:

    - the mock vehicle's own ``uid`` in AUTOPILOT_VERSION, where real autopilots have a hardware serial number;
    - ArduPilot: the parameter SIM_SPEEDUP, which only simulator builds have;
    - PX4: SYS_HITL other than 0, with which it drives no motors. PX4's software-in-the-loop has no parameter that a
      flight controller's build could not have too, so it needs the user's word.
    """
    try:
        if client.request_message(m.AutopilotVersion, timeout_s=_ANSWER_S).uid == MOCK_UID:
            return "uavcover's mock vehicle"
    except VehicleSilentError:
        pass  # not every autopilot answers; the parameters may still tell
    name = "SYS_HITL" if client.vehicle.mav_autopilot == AutopilotId.PX4 else "SIM_SPEEDUP"
    try:
        value = client.read_parameter(name, timeout_s=_ANSWER_S).value
    except VehicleSilentError:
        return None
    if name == "SIM_SPEEDUP":
        return "ArduPilot's simulator"
    return "PX4 with simulated hardware" if value != 0.0 else None


class OnBreach(Enum):
    """What to do when the vehicle leaves its route, its fence, its height band or known ground, or has another mission."""

    TELL = "tell"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True, kw_only=True)
class Precautions:
    """What the user wants.

    Attributes:
        on_breach: what to do on a breach; None leaves it to the policy (``data/breach_policy.toml``).
        apply_limits: whether to set the parameters that the plan needs, and to put the old values back at the end.
        agree: asked with the list of changes before any is made.
        keep: told the old values while they are changed, to have them on disk; an empty mapping when all are back.
        left_changed: old values that an earlier flight could not put back.
    """

    on_breach: OnBreach | None = None
    apply_limits: bool = False
    agree: Callable[[str], bool] = lambda _: False
    keep: Callable[[Mapping[str, float]], None] = lambda _: None
    left_changed: Mapping[str, float] = field(default_factory=dict)


USUAL = Precautions()
"""The default precautions."""
