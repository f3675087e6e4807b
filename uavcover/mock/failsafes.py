"""What the mock vehicle does by itself: position, battery, ground station, fence.

Whether the mock vehicle is where its fence lets it be.

What the mock vehicle does by itself when something is not as it should be: position, battery, ground station, fence.

Whether and how it acts is in its parameters, with the autopilots' own names, values and defaults.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mission_io.model.areas import Fence, fence_from_items
from mission_io.model.items import MissionItem, MissionType
from uavcover.mock.behaviour import TransferClock
from uavcover.mock.dynamics import Vector
from uavcover.scenario.frames import LocalFrame
from uavcover.vehicle.modes import Mode

if TYPE_CHECKING:
    from uavcover.mock.vehicle import MockVehicle

Ring = tuple[tuple[float, float], ...]

_HEIGHT, _CIRCLE, _AREAS = 1, 2, 4
"""Bits of FENCE_TYPE."""


class FenceWatch:
    """The fence that a vehicle holds, in its own frame."""

    def __init__(self) -> None:
        self._items: tuple[MissionItem, ...] = ()
        self._inclusions: list[Ring] = []
        self._exclusions: list[Ring] = []
        self._circles: list[tuple[float, float, float, bool]] = []

    def breach(self, vehicle: "MockVehicle") -> str | None:
        """Which limit the vehicle believes to be beyond, in its autopilot's words; None when it is inside of all."""
        items = vehicle.missions.items(MissionType.FENCE)
        if items is not self._items:
            self._read(items, vehicle.body.frame)
        where = vehicle.body.believed.position_m
        ardupilot, get = vehicle.is_ardupilot, vehicle.parameters
        if ardupilot and not get["FENCE_ENABLE"]:
            return None
        kinds = int(get["FENCE_TYPE"]) if ardupilot else _HEIGHT | _CIRCLE | _AREAS
        highest_m = get["FENCE_ALT_MAX" if ardupilot else "GF_MAX_VER_DIST"]
        farthest_m = get["FENCE_RADIUS" if ardupilot else "GF_MAX_HOR_DIST"]
        if kinds & _HEIGHT and 0.0 < highest_m < where[2]:
            return "Max Alt"
        if kinds & _CIRCLE and 0.0 < farthest_m < math.hypot(where[0], where[1]):
            return "Circle"
        return "Polygon" if kinds & _AREAS and self._outside_areas(where) else None

    def _outside_areas(self, where: Vector) -> bool:
        x, y = where[0], where[1]
        wanted = [_inside(x, y, ring) for ring in self._inclusions]
        wanted += [math.hypot(x - e, y - n) <= r for e, n, r, inclusion in self._circles if inclusion]
        forbidden = [_inside(x, y, ring) for ring in self._exclusions]
        forbidden += [math.hypot(x - e, y - n) < r for e, n, r, inclusion in self._circles if not inclusion]
        return (bool(wanted) and not any(wanted)) or any(forbidden)

    def _read(self, items: tuple[MissionItem, ...], frame: LocalFrame) -> None:
        self._items = items
        fence: Fence = fence_from_items(items)

        def east_north(lat_deg: float, lon_deg: float) -> tuple[float, float]:
            east, north, _ = frame.enu_from_geodetic(lat_deg, lon_deg, frame.alt_amsl_m)[0]
            return float(east), float(north)

        rings = [
            (polygon.inclusion, tuple(east_north(v.lat_deg, v.lon_deg) for v in polygon.vertices))
            for polygon in fence.polygons
        ]
        self._inclusions = [ring for inclusion, ring in rings if inclusion]
        self._exclusions = [ring for inclusion, ring in rings if not inclusion]
        self._circles = [
            (*east_north(c.center.lat_deg, c.center.lon_deg), c.radius_m, c.inclusion) for c in fence.circles
        ]


def _inside(x: float, y: float, ring: Sequence[tuple[float, float]]) -> bool:
    """Whether a point is inside a ring, by the number of edges to its east (even-odd rule)."""
    inside = False
    ax, ay = ring[-1]
    for bx, by in ring:
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        ax, ay = bx, by
    return inside


_POSITION_TIMEOUT_S = 1.0
_WARNING, _CRITICAL, _EMERGENCY = 4, 2, 0
_LOW_CHARGE, _CRITICAL_CHARGE = 0.2, 0.1
_BATTERY_ACTIONS = {1.0: Mode.LAND, 2.0: Mode.RETURN}
_GCS_ACTIONS = {True: {1.0: Mode.RETURN, 5.0: Mode.LAND}, False: {1.0: Mode.HOLD, 2.0: Mode.RETURN, 3.0: Mode.LAND}}
_FENCE_ACTIONS = {
    True: {1.0: Mode.RETURN, 2.0: Mode.LAND, 4.0: Mode.HOLD},
    False: {2.0: Mode.HOLD, 3.0: Mode.RETURN, 5.0: Mode.LAND},
}
"""Value of the parameter to mode; ArduPilot under True, PX4 under False."""


class Failsafes:
    """Looks at the vehicle a few times a second and remembers what it has reacted to."""

    def __init__(self) -> None:
        self._fence = FenceWatch()
        self._position_lost_at_s: float | None = None
        self._heard_at_s: float | None = None
        self._charge_told = 1.0
        self._done: set[str] = set()

    def hear_ground_station(self, vehicle: "MockVehicle") -> None:
        """A ground station's heartbeat has come."""
        self._heard_at_s = vehicle.time_s
        self._done.discard("ground station")

    def breach(self, vehicle: "MockVehicle") -> str | None:
        """Which limit of its fence the vehicle is beyond; None for none."""
        return self._fence.breach(vehicle)

    def look(self, vehicle: "MockVehicle") -> None:
        """Look, and react."""
        self._look_at_position(vehicle)
        self._look_at_battery(vehicle)
        if vehicle.flying:
            self._look_for_ground_station(vehicle)
            self._look_at_fence(vehicle)

    def _once(self, what: str) -> bool:
        """Whether this is the first time that something is reacted to."""
        first = what not in self._done
        self._done.add(what)
        return first

    def _look_at_position(self, vehicle: "MockVehicle") -> None:
        if not vehicle.body.believed.lost:
            self._position_lost_at_s = None
            self._done.discard("position")
            return
        if self._position_lost_at_s is None:
            self._position_lost_at_s = vehicle.time_s
        if vehicle.time_s >= self._position_lost_at_s + _POSITION_TIMEOUT_S and self._once("position"):
            vehicle.fail_safe("EKF" if vehicle.is_ardupilot else "No position", Mode.LAND)

    def _look_at_battery(self, vehicle: "MockVehicle") -> None:
        battery = vehicle.body.battery
        if battery.remaining <= 0.0 and vehicle.flying:
            vehicle.say(_EMERGENCY, "Battery 1 is empty")
            vehicle.disarm(force=True)
        for level, word, severity in ((_LOW_CHARGE, "low", _WARNING), (_CRITICAL_CHARGE, "critical", _CRITICAL)):
            if battery.remaining <= level < self._charge_told:
                self._charge_told = level
                volts = f"Battery 1 is {word} {battery.voltage_v:.2f}V"
                vehicle.say(severity, volts if vehicle.is_ardupilot else f"{word.capitalize()} battery level")
        if not vehicle.flying:
            return
        for level, mode in _battery_actions(vehicle):
            if battery.remaining <= level and self._once(f"battery {level} {mode.value}"):
                vehicle.fail_safe("Battery", mode)

    def _look_for_ground_station(self, vehicle: "MockVehicle") -> None:
        ardupilot, get = vehicle.is_ardupilot, vehicle.parameters
        mode = _GCS_ACTIONS[ardupilot].get(get["FS_GCS_ENABLE" if ardupilot else "NAV_DLL_ACT"])
        if mode is None or self._heard_at_s is None:
            return
        patience_s = get["FS_GCS_TIMEOUT" if ardupilot else "COM_DL_LOSS_T"]
        if vehicle.behaviour.transfer_clock is TransferClock.LINK:
            patience_s *= vehicle.speed
        if vehicle.time_s >= self._heard_at_s + patience_s and self._once("ground station"):
            vehicle.fail_safe("GCS" if ardupilot else "Data link lost", mode)

    def _look_at_fence(self, vehicle: "MockVehicle") -> None:
        limit = self._fence.breach(vehicle)
        if limit is None:
            self._done.discard("fence")
        elif self._once("fence"):
            ardupilot = vehicle.is_ardupilot
            vehicle.say(_CRITICAL, f"{limit} fence breached" if ardupilot else f"Geofence violation: {limit}")
            action = vehicle.parameters["FENCE_ACTION" if ardupilot else "GF_ACTION"]
            mode = _FENCE_ACTIONS[ardupilot].get(action)
            if mode is not None:
                vehicle.fail_safe("Fence" if ardupilot else "Geofence", mode)


def _battery_actions(vehicle: "MockVehicle") -> list[tuple[float, Mode]]:
    """From which share of the charge on the vehicle does what."""
    get, battery = vehicle.parameters, vehicle.body.battery
    if vehicle.is_ardupilot:
        pairs = [(get["BATT_LOW_MAH"], get["BATT_FS_LOW_ACT"]), (get["BATT_CRT_MAH"], get["BATT_FS_CRT_ACT"])]
        found = [(mah / battery.capacity_mah if mah > 0.0 else -math.inf, _BATTERY_ACTIONS.get(a)) for mah, a in pairs]
        return [(level, mode) for level, mode in found if mode is not None]
    action = get["COM_LOW_BAT_ACT"]
    if action == 2.0:
        return [(get["BAT_CRIT_THR"], Mode.LAND)]
    if action == 3.0:
        return [(get["BAT_CRIT_THR"], Mode.RETURN), (get["BAT_EMERGEN_THR"], Mode.LAND)]
    return []
