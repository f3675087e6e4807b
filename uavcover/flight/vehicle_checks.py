"""Which vehicles may be flown, and the proof that one is simulated.

Only multirotors may be flown: plans, return routes and the meaning of a landing hold for nothing else. Only a vehicle that is
proved to be simulated may be armed without the user's confirmation.
"""

import math

from mission_io.autopilots import flight_modes
from mission_io.autopilots.autopilot import Autopilot, VehicleKind, type_name
from mission_io.autopilots.flight_modes import Mode
from mission_io.client.client import Client
from mission_io.client.connection import VehicleInfo
from mission_io.client.peers import two_in_one
from mission_io.errors import MisuseError, VehicleSilentError
from mission_io.model.enums import AutopilotId, Firmware
from mission_io.wire import messages as m
from uavcover.errors import VehicleError
from uavcover.flight.tuning import PREPARATION
from uavcover.model.vehicle import MOCK_UID

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
        raise VehicleError(
            f"vehicle {vehicle.system_id} reports that it is {_a(what)}, MAV_TYPE {vehicle.vehicle_type}; uavcover "
            "supports only multirotors, so nothing was uploaded, changed or armed"
        )
    if vehicle.autopilot.firmware is Firmware.OTHER:
        raise VehicleError(f"the flight modes of vehicle {vehicle.system_id}, {vehicle.described}, are unknown")
    return vehicle


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeio' else 'a'} {noun}"


def custom_mode(autopilot: Autopilot, mode: Mode) -> int:
    """The heartbeat's ``custom_mode`` of a mode. Raises VehicleError: such a vehicle has no such mode."""
    try:
        return flight_modes.custom_mode(autopilot, mode)
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
