"""How sure it is that a vehicle is no real one. Only then may it be armed without the user's word."""

from mission_io import messages as m
from mission_io.enums import AutopilotId
from mission_io.errors import VehicleSilentError
from uavcover.flight.mock.telemetry import MOCK_UID
from uavcover.flight.vehicle_client import VehicleClient

_ANSWER_S = 8.0


def simulated_by(client: VehicleClient) -> str | None:
    """What simulates the vehicle; None when nothing proves that anything does.

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
