"""Why the mock vehicle does not arm, in the words of its autopilot."""

from typing import TYPE_CHECKING

from mission_io.enums import CommandResult
from uavcover.flight.mock.faults import FaultKind
from uavcover.flight.modes import Mode

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

_LOW_CHARGE = 0.1
_CRITICAL = 2
_ARMABLE = (Mode.MANUAL, Mode.GUIDED, Mode.HOLD)
"""ArduPilot's modes that can be armed in, of those that this vehicle has."""


def refusal_to_arm(vehicle: "MockVehicle") -> CommandResult | None:
    """What an arming is answered that is refused, with the reason said; None when nothing speaks against it."""
    ardupilot = vehicle.is_ardupilot
    reason = reason_not_to_arm(vehicle)
    if reason is not None:
        vehicle.say(_CRITICAL, reason)
        return CommandResult.FAILED if ardupilot else CommandResult.TEMPORARILY_REJECTED
    if vehicle.mode not in (_ARMABLE if ardupilot else tuple(Mode)):
        vehicle.say(_CRITICAL, f"Arm: {vehicle.mode.name} mode is not armable")
        return CommandResult.FAILED
    if vehicle.mode is Mode.MISSION and not vehicle.mission.there_is_one:
        vehicle.say(_CRITICAL, "Preflight Fail: no valid mission")
        return CommandResult.TEMPORARILY_REJECTED
    return None


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
    if vehicle.mission.needs_terrain:
        return "PreArm: waiting for terrain data"
    if (limit := vehicle.failsafes.breach(vehicle)) is not None:
        return _FENCE[vehicle.is_ardupilot].format(limit)
    return None


# ArduPilot's words under True, PX4's under False.
_REFUSED = {True: "Arm: Compass not healthy", False: "Arming denied: Resolve system health failures first"}
_NO_FIX = {True: "PreArm: GPS 1: Bad fix", False: "Preflight Fail: GPS fix too low"}
_NO_POSITION = {True: "PreArm: Need Position Estimate", False: "Preflight Fail: no position"}
_LOW_BATTERY = {True: "PreArm: Battery 1 below minimum arming capacity", False: "Preflight Fail: low battery"}
_FENCE = {True: "PreArm: Vehicle breaching {} fence", False: "Preflight Fail: Geofence violation: {}"}
