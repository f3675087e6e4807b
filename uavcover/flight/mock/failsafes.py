"""What the mock vehicle does by itself when something it flies by is missing: position, battery."""

from typing import TYPE_CHECKING

from uavcover.flight.modes import Mode

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

_POSITION_TIMEOUT_S = 1.0
_WARNING, _CRITICAL, _EMERGENCY = 4, 2, 0
_LOW_CHARGE, _CRITICAL_CHARGE = 0.2, 0.1


class Failsafes:
    """Looks at the vehicle a few times a second and remembers what it has reacted to."""

    def __init__(self) -> None:
        self._position_lost_at_s: float | None = None
        self._landed_for_position = False
        self._charge_told = 1.0

    def look(self, vehicle: "MockVehicle") -> None:
        """Look, and react."""
        self._look_at_position(vehicle)
        self._look_at_battery(vehicle)

    def _look_at_position(self, vehicle: "MockVehicle") -> None:
        if not vehicle.body.believed.lost:
            self._position_lost_at_s, self._landed_for_position = None, False
            return
        if self._position_lost_at_s is None:
            self._position_lost_at_s = vehicle.time_s
        if not self._landed_for_position and vehicle.time_s >= self._position_lost_at_s + _POSITION_TIMEOUT_S:
            self._landed_for_position = True
            vehicle.fail_safe("EKF" if vehicle.is_ardupilot else "No position", Mode.LAND)

    def _look_at_battery(self, vehicle: "MockVehicle") -> None:
        battery = vehicle.body.battery
        if battery.remaining <= 0.0 and not vehicle.body.on_ground and vehicle.armed:
            vehicle.say(_EMERGENCY, "Battery 1 is empty")
            vehicle.disarm(force=True)
        for level, word, severity in ((_LOW_CHARGE, "low", _WARNING), (_CRITICAL_CHARGE, "critical", _CRITICAL)):
            if battery.remaining <= level < self._charge_told:
                self._charge_told = level
                volts = f"Battery 1 is {word} {battery.voltage_v:.2f}V"
                vehicle.say(severity, volts if vehicle.is_ardupilot else f"{word.capitalize()} battery level")
