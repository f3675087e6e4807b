"""What may be flown: multirotors. Plans, ways home and the meaning of a landing hold for nothing else."""

from mission_io.choice import two_in_one
from mission_io.enums import Firmware
from mission_io.neighbours import VehicleInfo
from mission_io.vehicle_types import VehicleKind, type_name
from uavcover.errors import VehicleError
from uavcover.flight.vehicle_client import VehicleClient


def require_multirotor(client: VehicleClient) -> VehicleInfo:
    """The vehicle that is talked to, if it is a multirotor whose flight modes are known. Nothing is sent for that.

    Raises:
        VehicleError: it is something else, or two vehicles share its ids.
    """
    vehicle = client.vehicle
    if client.impostor is not None:
        raise VehicleError(f"{two_in_one(vehicle, client.impostor)}; not touched")
    if vehicle.kind is not VehicleKind.MULTIROTOR:
        name = type_name(vehicle.vehicle_type)
        what = name if vehicle.kind in (VehicleKind.OTHER, VehicleKind.VTOL) else vehicle.kind.value
        raise VehicleError(
            f"vehicle {vehicle.system_id} says that it is {_a(what)}, MAV_TYPE {vehicle.vehicle_type}; uavcover plans for and "
            "flies multirotors only; not touched: nothing was uploaded, no mode changed, nothing armed"
        )
    if vehicle.autopilot.firmware is Firmware.OTHER:
        raise VehicleError(f"the flight modes of vehicle {vehicle.system_id}, {vehicle.described}, are not known")
    return vehicle


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeio' else 'a'} {noun}"
