"""Which vehicles may be flown, and their flight modes (``mission_io.autopilots.autopilot``).

Only multirotors may be flown: plans, return routes and the meaning of a landing hold for nothing else.
"""

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.autopilot import Mode as Mode
from mission_io.autopilots.autopilot import custom_mode as number_of_mode
from mission_io.autopilots.autopilot import has_mode as has_mode
from mission_io.autopilots.autopilot import mode_from_custom as mode_from_custom
from mission_io.autopilots.autopilot import mode_from_params as mode_from_params
from mission_io.client.peers import VehicleInfo, two_in_one
from mission_io.errors import MisuseError
from mission_io.model.enums import Firmware, VehicleKind, type_name
from uavcover.errors import VehicleError
from uavcover.flight.client import VehicleClient


def require_multirotor(client: VehicleClient) -> VehicleInfo:
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
        return number_of_mode(autopilot, mode)
    except MisuseError as error:
        raise VehicleError(str(error)) from None
