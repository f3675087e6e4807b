"""Reactions of the mock vehicle to a failure of its position, battery, ground station link or fence.

Whether and how it acts is set by its parameters, with the autopilots' own names, values and defaults.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mission_io.autopilots.autopilot import Mode
from mission_io.model.enums import Severity
from uavcover.mock.behaviour import TransferClock
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.state import MockState
from uavcover.mock.tuning import BODY


@dataclass(frozen=True, slots=True)
class Smart:
    """ArduCopter's SmartRTL, or another mode where that is not available."""

    otherwise: Mode


_RETURN, _LAND, _HOLD = Mode.RETURN, Mode.LAND, Mode.HOLD
_BATTERY_ACTIONS: Mapping[float, Mode | Smart] = {
    1.0: _LAND, 2.0: _RETURN, 3.0: Smart(_RETURN), 4.0: Smart(_LAND), 6.0: _RETURN, 7.0: _HOLD,
}  # fmt: skip
_GCS_ACTIONS: Mapping[bool, Mapping[float, Mode | Smart]] = {
    True: {
        1.0: _RETURN, 2.0: _RETURN, 3.0: Smart(_RETURN), 4.0: Smart(_LAND), 5.0: _LAND, 6.0: _RETURN, 7.0: _HOLD,
    },
    False: {1.0: _HOLD, 2.0: _RETURN, 3.0: _LAND},
}  # fmt: skip
_FENCE_ACTIONS: Mapping[bool, Mapping[float, Mode | Smart]] = {
    True: {1.0: _RETURN, 2.0: _LAND, 3.0: Smart(_RETURN), 4.0: _HOLD, 5.0: Smart(_LAND)},
    False: {2.0: _HOLD, 3.0: _RETURN, 5.0: _LAND},
}
"""Parameter value to action; ArduPilot under True, PX4 under False. It knows no AUTO_RTL: then ArduPilot returns."""


class Failsafes:
    """Checks the vehicle a few times a second and remembers what it has reacted to."""

    def __init__(self, control: FlightControl) -> None:
        self._control, self._state = control, control.state
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a reboot."""
        self._position_lost_at_s: float | None = None
        self._heard_at_s: float | None = None
        self._charge_told = 1.0
        self._done: set[str] = set()

    def hear_ground_station(self) -> None:
        """Note a ground station's heartbeat."""
        self._heard_at_s = self._state.time_s
        self._done.discard("ground station")

    def check(self) -> None:
        """Check everything once, and react."""
        self._check_position()
        self._check_battery()
        if self._state.flying:
            self._check_ground_station()
            self._check_fence()
        self._control.end_delay()

    @property
    def _delay_s(self) -> float:
        """Time of the hold before it returns or lands."""
        return 0.0 if self._state.is_ardupilot else self._state.parameters["COM_FAIL_ACT_T"]

    def _once(self, what: str) -> bool:
        """Whether this is the first reaction to a failure."""
        first = what not in self._done
        self._done.add(what)
        return first

    def _check_position(self) -> None:
        vehicle = self._state
        if not vehicle.body.believed.lost:
            self._position_lost_at_s = None
            self._done.discard("position")
            return
        if self._position_lost_at_s is None:
            self._position_lost_at_s = vehicle.time_s
        if vehicle.time_s >= self._position_lost_at_s + BODY.position_timeout_s and self._once("position"):
            self._control.fail_safe("EKF" if vehicle.is_ardupilot else "No position", Mode.LAND)

    def _check_battery(self) -> None:
        vehicle = self._state
        battery = vehicle.body.battery
        if battery.remaining <= 0.0 and vehicle.flying:
            vehicle.say(Severity.EMERGENCY, "Battery 1 is empty")
            self._control.disarm(force=True)
        for level, word, severity in (
            (BODY.failsafe_low_charge, "low", Severity.WARNING),
            (BODY.failsafe_critical_charge, "critical", Severity.CRITICAL),
        ):
            if battery.remaining <= level < self._charge_told:
                self._charge_told = level
                volts = f"Battery 1 is {word} {battery.voltage_v:.2f}V"
                vehicle.say(severity, volts if vehicle.is_ardupilot else f"{word.capitalize()} battery level")
        if not vehicle.flying:
            return
        for level, action in _battery_actions(vehicle):
            if battery.remaining <= level and self._once(f"battery {level} {action}"):
                self._act("Battery", action)

    def _act(self, what: str, action: Mode | Smart) -> None:
        if isinstance(action, Smart):
            self._control.fail_safe_smartly(what, action.otherwise)
        else:
            self._control.fail_safe(what, action, delay_s=self._delay_s)

    def _check_ground_station(self) -> None:
        vehicle = self._state
        ardupilot, get = vehicle.is_ardupilot, vehicle.parameters
        action = _GCS_ACTIONS[ardupilot].get(get["FS_GCS_ENABLE" if ardupilot else "NAV_DLL_ACT"])
        if action is None or self._heard_at_s is None:
            return
        timeout_s = get["FS_GCS_TIMEOUT" if ardupilot else "COM_DL_LOSS_T"]
        if vehicle.behaviour.transfer_clock is TransferClock.LINK:
            timeout_s *= vehicle.speed
        goes_on = (
            ardupilot and vehicle.mode is Mode.MISSION and int(get["FS_OPTIONS"]) & 2
        )  # bit: go on with the mission
        if vehicle.time_s >= self._heard_at_s + timeout_s and not goes_on and self._once("ground station"):
            self._act("GCS" if ardupilot else "Data link lost", action)

    def _check_fence(self) -> None:
        vehicle = self._state
        limit = vehicle.fence.breach()
        if limit is None:
            self._done.discard("fence")
        elif self._once("fence"):
            ardupilot = vehicle.is_ardupilot
            vehicle.say(Severity.CRITICAL, f"{limit} fence breached" if ardupilot else f"Geofence violation: {limit}")
            action = _FENCE_ACTIONS[ardupilot].get(vehicle.parameters["FENCE_ACTION" if ardupilot else "GF_ACTION"])
            if action is not None:
                self._act("Fence" if ardupilot else "Geofence", action)


def _battery_actions(vehicle: MockState) -> list[tuple[float, Mode | Smart]]:
    """Battery failsafes: remaining charge (1 is full) below which the vehicle acts, and how."""
    get, battery = vehicle.parameters, vehicle.body.battery
    if vehicle.is_ardupilot:
        pairs = [(get["BATT_LOW_MAH"], get["BATT_FS_LOW_ACT"]), (get["BATT_CRT_MAH"], get["BATT_FS_CRT_ACT"])]
        found = [(mah / battery.capacity_mah if mah > 0.0 else -math.inf, _BATTERY_ACTIONS.get(a)) for mah, a in pairs]
        return [(level, action) for level, action in found if action is not None]
    action = get["COM_LOW_BAT_ACT"]
    if action == 2.0:
        return [(get["BAT_CRIT_THR"], Mode.LAND)]
    if action == 3.0:
        return [(get["BAT_CRIT_THR"], Mode.RETURN), (get["BAT_EMERGEN_THR"], Mode.LAND)]
    return []
