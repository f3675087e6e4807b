"""What each fault does to the mock vehicle when its moment has come, and what ends it."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from mission_io.model.items import Command, MissionItem, MissionType
from uavcover.mock.dynamics import Wind
from uavcover.mock.faults import Fault, FaultKind, Since
from uavcover.vehicle.modes import Mode

if TYPE_CHECKING:
    from uavcover.mock.vehicle import MockVehicle

_ON_THE_LINKS_CLOCK = (FaultKind.HEARTBEAT_LOSS, FaultKind.LINK_OUTAGE)
_CRITICAL_CHARGE = 0.06
_UPWIND_DEG = 270.0
_INFO, _WARNING, _CRITICAL = 6, 4, 2


class Faults:
    """The faults that are still to come, and those that are going on.

    Attributes:
        begun: every fault that has begun, in that order.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self.begun: list[Fault] = []
        self._coming = list(faults)
        self._going_on: list[tuple[float, Fault]] = []

    def add(self, fault: Fault) -> None:
        """One more to come; at once when its moment is over."""
        self._coming.append(fault)

    def is_going_on(self, kind: FaultKind) -> bool:
        """Whether a fault of this kind has begun and not ended."""
        return any(fault.kind is kind for _, fault in self._going_on)

    def step(self, vehicle: "MockVehicle") -> None:
        """Begin and end what is due."""
        now = vehicle.powered_s
        if self._coming:
            for fault in [f for f in self._coming if _is_due(f, vehicle)]:
                self._coming.remove(fault)
                self._begin(fault, vehicle, now)
        if self._going_on:
            for ends_s, fault in list(self._going_on):
                if now >= ends_s:
                    self._going_on.remove((ends_s, fault))
                    if (end := _END.get(fault.kind)) is not None:
                        end(vehicle)

    def _begin(self, fault: Fault, vehicle: "MockVehicle", now: float) -> None:
        self.begun.append(fault)
        per_second = vehicle.speed if fault.kind in _ON_THE_LINKS_CLOCK else 1.0
        self._going_on.append((now + fault.number * per_second, fault))
        if (begin := _BEGIN.get(fault.kind)) is not None:
            begin(vehicle, fault)


def _is_due(fault: Fault, vehicle: "MockVehicle") -> bool:
    moment = fault.moment
    if moment.since is Since.BOOT:
        return vehicle.powered_s >= moment.value
    took_off_s = vehicle.took_off_at_s
    if moment.since is Since.TAKE_OFF:
        return took_off_s is not None and vehicle.powered_s >= took_off_s + moment.value
    return took_off_s is not None and vehicle.current_seq >= moment.value


def _lose_fix(vehicle: "MockVehicle", _: Fault) -> None:
    vehicle.body.believed.lose_fix()
    vehicle.say(_CRITICAL, "GPS 1: lost fix" if vehicle.is_ardupilot else "GNSS data fusion stopped")


def _find_fix(vehicle: "MockVehicle") -> None:
    vehicle.body.believed.find_fix()
    vehicle.say(_INFO, "GPS 1: fix is back" if vehicle.is_ardupilot else "GNSS data fusion started")


def _drain_battery(vehicle: "MockVehicle", fault: Fault) -> None:
    mode = fault.mode or Mode.RETURN
    vehicle.body.battery.drop_to(_CRITICAL_CHARGE)
    battery = vehicle.body.battery
    if vehicle.is_ardupilot:
        used_mah = (1.0 - battery.remaining) * battery.capacity_mah
        vehicle.say(_CRITICAL, f"Battery 1 is critical {battery.voltage_v:.2f}V used {used_mah:.0f} mAh")
    vehicle.fail_safe("Battery", mode)


def _change_mode(vehicle: "MockVehicle", fault: Fault) -> None:
    vehicle.set_mode(fault.mode or Mode.HOLD)


def _reboot(vehicle: "MockVehicle", fault: Fault) -> None:
    vehicle.power_off(fault.number)


def _get_stuck(vehicle: "MockVehicle", _: Fault) -> None:
    vehicle.body.itinerary.stuck = True


def _come_loose(vehicle: "MockVehicle") -> None:
    vehicle.body.itinerary.stuck = False


def _blow(vehicle: "MockVehicle", fault: Fault) -> None:
    vehicle.body.air.change(Wind(speed_m_s=fault.number, from_deg=_UPWIND_DEG))
    if not vehicle.is_ardupilot:
        vehicle.say(_WARNING, f"High wind speed detected ({fault.number:.1f} m/s)")


def _change_mission(vehicle: "MockVehicle", _: Fault) -> None:
    """Another ground station uploads the mission without the next waypoint but one, or without the last."""
    items = vehicle.mission_items
    places = [
        seq
        for seq, item in enumerate(items)
        if item.command == Command.NAV_WAYPOINT and (seq > 0 or not vehicle.autopilot.home_in_item_0)
    ]
    if not places:
        return
    ahead = [seq for seq in places if seq > vehicle.current_seq + 1]
    gone = ahead[0] if ahead else places[-1]
    _upload(vehicle, (*items[:gone], *items[gone + 1 :]))


def _lower_mission(vehicle: "MockVehicle", fault: Fault) -> None:
    """Another ground station uploads the same mission with lower waypoints: neither its length nor the current item tells."""
    home = int(vehicle.autopilot.home_in_item_0)
    _upload(
        vehicle,
        tuple(
            replace(item, alt_m=item.alt_m - fault.number)
            if item.command == Command.NAV_WAYPOINT and n >= home
            else item
            for n, item in enumerate(vehicle.mission_items)
        ),
    )


def _upload(vehicle: "MockVehicle", items: tuple[MissionItem, ...]) -> None:
    vehicle.missions.replace(MissionType.MISSION, items)
    if vehicle.is_ardupilot:
        vehicle.say(_INFO, "Flight plan received")
    vehicle.mission.changed()


def _force_disarm(vehicle: "MockVehicle", _: Fault) -> None:
    """Another station sends a disarm that is forced (COMPONENT_ARM_DISARM, second parameter 21196)."""
    vehicle.disarm(force=True)


_BEGIN: dict[FaultKind, Callable[["MockVehicle", Fault], None]] = {
    FaultKind.GPS_LOSS: _lose_fix,
    FaultKind.BATTERY_FAILSAFE: _drain_battery,
    FaultKind.PILOT_MODE: _change_mode,
    FaultKind.REBOOT: _reboot,
    FaultKind.STUCK: _get_stuck,
    FaultKind.STRONG_WIND: _blow,
    FaultKind.MISSION_CHANGED: _change_mission,
    FaultKind.MISSION_LOWERED: _lower_mission,
    FaultKind.FORCE_DISARM: _force_disarm,
}
"""A fault that is not here works by going on: the vehicle asks ``is_going_on``."""

_END: dict[FaultKind, Callable[["MockVehicle"], None]] = {
    FaultKind.GPS_LOSS: _find_fix,
    FaultKind.STUCK: _come_loose,
}
