"""Why the mock vehicle does not arm, in the words of its autopilot."""

from typing import TYPE_CHECKING

from uavcover.flight.mock.faults import FaultKind

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

_LOW_CHARGE = 0.1


def reason_not_to_arm(vehicle: "MockVehicle") -> str | None:
    """What it says when it refuses to be armed; None when nothing speaks against it."""
    if vehicle.faults.is_going_on(FaultKind.ARMING_REFUSED):
        return _REFUSED[vehicle.is_ardupilot]
    if not vehicle.has_fix:
        return _NO_FIX[vehicle.is_ardupilot]
    if not vehicle.ready:
        return _NO_POSITION[vehicle.is_ardupilot]
    if vehicle.body.battery.remaining < _LOW_CHARGE:
        return _LOW_BATTERY[vehicle.is_ardupilot]
    return None


# ArduPilot's words under True, PX4's under False.
_REFUSED = {True: "Arm: Compass not healthy", False: "Arming denied: Resolve system health failures first"}
_NO_FIX = {True: "PreArm: GPS 1: Bad fix", False: "Preflight Fail: GPS fix too low"}
_NO_POSITION = {True: "PreArm: Need Position Estimate", False: "Preflight Fail: no position"}
_LOW_BATTERY = {True: "PreArm: Battery 1 below minimum arming capacity", False: "Preflight Fail: low battery"}
