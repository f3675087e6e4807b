"""The messages in which the mock vehicle reports its state, how fast it sends them, and a log of its true position.

The log is for tests and for judging a track. Pacing limits how far a vehicle that flies faster than real time may run ahead of
the ground stations that listen to it.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import astuple, fields
from pathlib import Path
from typing import Generic, TypeVar

from mission_io.autopilots.autopilot import Mode
from mission_io.links.datagrams import Closing
from mission_io.model.enums import EkfFlag, GpsFix, MissionState, ModeFlag
from mission_io.model.items import MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from mission_io.wire.telemetry_messages import TimeSync
from uavcover.errors import InputError
from uavcover.mock.behaviour import LINK
from uavcover.mock.state import MockState, TruthSample
from uavcover.model.vehicle import MOCK_UID

_CAPABILITIES = {
    # MISSION_INT, COMMAND_INT, MAVLINK2, MISSION_FENCE, MISSION_RALLY; then ArduPilot's C_CAST and TERRAIN, PX4's BYTEWISE
    True: 0x4 | 0x8 | 0x2000 | 0x4000 | 0x8000 | 0x20000 | 0x200,
    False: 0x4 | 0x8 | 0x2000 | 0x4000 | 0x8000 | 0x10,
}
_VERSIONS = {True: 0x04070000, False: 0x011100FF}  # 4.7.0-dev, 1.17.0; ArduPilot under True
_CHARGE_OK, _CHARGE_LOW, _CHARGE_CRITICAL = 1, 2, 3
_STANDBY, _ACTIVE, _BOOT = 3, 4, 1
_SENSOR_GPS, _SENSOR_FENCE = 0x20, 0x100000
_SENSORS = 0x2C | _SENSOR_FENCE | 0x8000 | m.PREARM_CHECK_BIT
_EKF_GOOD = (
    EkfFlag.ATTITUDE
    | EkfFlag.VELOCITY_HORIZONTAL
    | EkfFlag.VELOCITY_VERTICAL
    | EkfFlag.POSITION_HORIZONTAL_RELATIVE
    | EkfFlag.POSITION_HORIZONTAL_ABSOLUTE
    | EkfFlag.POSITION_VERTICAL_ABSOLUTE
)
_EKF_WAITING = EkfFlag.ATTITUDE | EkfFlag.VELOCITY_VERTICAL | EkfFlag.CONSTANT_POSITION


def tell(vehicle: MockState, kind: type[m.Message]) -> None:
    """Send one message of a kind now; nothing for a kind that this vehicle does not send."""
    builder = _BUILDERS.get(kind)
    message = None if builder is None else builder(vehicle)
    if message is not None:
        vehicle.send(message)


def _heartbeat(vehicle: MockState) -> m.Message:
    flags = ModeFlag.CUSTOM_MODE_ENABLED
    flags |= ModeFlag.STABILIZE_ENABLED if vehicle.mode is Mode.MANUAL else ModeFlag.GUIDED_ENABLED
    if vehicle.mode is Mode.MISSION:
        flags |= ModeFlag.AUTO_ENABLED
    if vehicle.armed:
        flags |= ModeFlag.SAFETY_ARMED
    status = _BOOT if not vehicle.ready else _STANDBY if vehicle.body.on_ground else _ACTIVE
    return m.Heartbeat(
        vehicle.autopilot.mav_autopilot,
        vehicle.vehicle_type,
        int(flags),
        vehicle.custom_mode,
        status,
    )


def _position(vehicle: MockState) -> m.Message | None:
    if vehicle.body.believed.lost and not vehicle.is_ardupilot:
        return None  # PX4 reports no global position without an estimate; ArduPilot continues with a guess
    here, body = vehicle.body.geodetic_of(vehicle.body.believed.position_m), vehicle.body.point
    east, north, up = body.velocity_m_s
    return m.GlobalPositionInt(
        vehicle.time_s,
        here.lat_deg,
        here.lon_deg,
        here.alt_amsl_m,
        here.alt_amsl_m - vehicle.body.home.alt_amsl_m,
        north,
        east,
        -up,
        math.degrees(body.yaw_rad) % 360.0,
    )


def _attitude(vehicle: MockState) -> m.Message:
    body = vehicle.body.point
    yaw = math.remainder(body.yaw_rad, math.tau)
    return m.Attitude(vehicle.time_s, body.roll_rad, body.pitch_rad, yaw, 0.0, 0.0, 0.0)


def _mission_current(vehicle: MockState) -> m.Message:
    count = len(vehicle.mission_items)
    total = max(0, count - 1) if vehicle.autopilot.home_in_item_0 else count
    state = vehicle.mission_state if count else MissionState.NO_MISSION
    ids = (vehicle.missions.list_id(mission_type) for mission_type in MissionType)
    return m.MissionCurrent(vehicle.current_seq, total, state, *ids)


def _sys_status(vehicle: MockState) -> m.Message:
    # The pre-arm bit is set before arming works, as on ArduPilot: a station that trusts it alone is refused.
    healthy = _SENSORS if vehicle.checks_pass else _SENSORS & ~m.PREARM_CHECK_BIT
    if not vehicle.has_fix:
        healthy &= ~_SENSOR_GPS
    if vehicle.fence.breach() is not None:
        healthy &= ~_SENSOR_FENCE
    enabled = _SENSORS if vehicle.fence.in_force else _SENSORS & ~_SENSOR_FENCE
    battery = vehicle.body.battery
    return m.SysStatus(
        _SENSORS, enabled, healthy, 0.3, battery.voltage_v, battery.current_a, round(100.0 * battery.remaining)
    )


def _gps(vehicle: MockState) -> m.Message:
    believed = vehicle.body.believed
    here = vehicle.body.geodetic_of(believed.receiver_m)
    east, north, _ = vehicle.body.point.velocity_m_s
    fix, satellites = (GpsFix.FIX_3D, 14) if vehicle.has_fix else (GpsFix.NO_FIX, 0)
    speed_m_s = math.hypot(east, north)
    return m.GpsRawInt(
        vehicle.time_s, fix, here.lat_deg, here.lon_deg, here.alt_amsl_m, 0.8, 1.2, speed_m_s, None, satellites
    )


def _battery(vehicle: MockState) -> m.Message:
    battery = vehicle.body.battery
    left = battery.remaining
    state = _CHARGE_CRITICAL if left <= 0.1 else _CHARGE_LOW if left <= 0.2 else _CHARGE_OK
    return m.BatteryStatus(
        0,
        (battery.voltage_v, *(None,) * 9),
        battery.current_a,
        round((1.0 - left) * battery.capacity_mah),
        round(100.0 * left),
        (round(battery.time_left_s) or None) if math.isfinite(battery.time_left_s) else None,
        state,
    )


def _display(vehicle: MockState) -> m.Message:
    point, believed = vehicle.body.point, vehicle.body.believed.position_m
    east, north, up = point.velocity_m_s
    throttle = round(50.0 * vehicle.body.battery.power_w / vehicle.body.battery.data.hover_w) if vehicle.flying else 0
    heading = round(math.degrees(point.yaw_rad)) % 360
    alt_amsl_m = vehicle.body.frame.alt_amsl_m + believed[2]
    return m.VfrHud(point.airspeed_m_s, math.hypot(east, north), heading, min(100, throttle), alt_amsl_m, up)


def _terrain(vehicle: MockState) -> m.Message | None:
    if vehicle.terrain is None:
        return None
    here = vehicle.body.geodetic_of(vehicle.body.believed.position_m)
    return vehicle.terrain.report(here.lat_deg, here.lon_deg, here.alt_amsl_m)


def _home(vehicle: MockState) -> m.Message | None:
    home = vehicle.body.home
    return m.HomePosition(home.lat_deg, home.lon_deg, home.alt_amsl_m) if vehicle.home_known else None


def _origin(vehicle: MockState) -> m.Message:
    frame = vehicle.body.frame
    return m.GpsGlobalOrigin(frame.lat_deg, frame.lon_deg, frame.alt_amsl_m)


class TruthFile(Closing):
    """Writes samples to a CSV file as they come; a context manager.

    Raises:
        InputError: the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputError(f"{path}: the file cannot be written: {error.strerror}") from None
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(field.name for field in fields(TruthSample))

    def __call__(self, sample: TruthSample) -> None:
        """Write one sample."""
        self._rows.writerow(astuple(sample))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def truth_sample(vehicle: MockState) -> TruthSample:
    """The true position, and the error of the believed one."""
    here, point = vehicle.body.geodetic(), vehicle.body.point
    return TruthSample(
        vehicle.time_s,
        here.lat_deg,
        here.lon_deg,
        here.alt_amsl_m,
        *vehicle.body.believed.error_m,
        math.degrees(point.roll_rad),
        math.degrees(point.pitch_rad),
        math.degrees(point.yaw_rad) % 360.0,
    )


_BUILDERS: dict[type[m.Message], Callable[[MockState], m.Message | None]] = {
    m.Heartbeat: _heartbeat,
    m.GlobalPositionInt: _position,
    m.Attitude: _attitude,
    m.MissionCurrent: _mission_current,
    m.SysStatus: _sys_status,
    m.GpsRawInt: _gps,
    m.EkfStatusReport: lambda vehicle: m.EkfStatusReport(int(_EKF_GOOD if vehicle.ready else _EKF_WAITING)),
    m.ExtendedSysState: lambda vehicle: m.ExtendedSysState(int(vehicle.body.landed_state)),
    m.SystemTime: lambda vehicle: m.SystemTime(0.0, vehicle.time_s),
    m.HomePosition: _home,
    m.GpsGlobalOrigin: _origin,
    m.AutopilotVersion: lambda vehicle: m.AutopilotVersion(
        _CAPABILITIES[vehicle.is_ardupilot], _VERSIONS[vehicle.is_ardupilot], MOCK_UID
    ),
    m.BatteryStatus: _battery,
    m.VfrHud: _display,
    m.TerrainReport: _terrain,
    m.TerrainRequest: lambda vehicle: None if vehicle.terrain is None else vehicle.terrain.request(vehicle.time_s),
}

KIND_BY_ID: dict[int, type[m.Message]] = {message_id(kind): kind for kind in _BUILDERS}
"""The kinds of message that can be requested."""


EndpointT = TypeVar("EndpointT")


class Pacing(Generic[EndpointT]):
    """Sends TIMESYNC requests after all other messages: the answer shows how far a ground station has read.

    A real vehicle sends no more than a ground station can process; at a hundred times real time a busy machine would lose
    messages that no real link loses. Ground stations that never answer, or have stopped answering, are not waited for.
    """

    def __init__(self) -> None:
        self._requested_s = 0.0
        self._requested_at = 0.0
        self._read_s: dict[EndpointT, float] = {}
        self._waits_since: float | None = None

    def questions(self, vehicle_s: float, now: float) -> list[TimeSync]:
        """The request to send at a vehicle time, and at ``now`` on the link's clock; empty when none is due."""
        due = vehicle_s - self._requested_s >= LINK.ask_every_s
        again = self._waits_since is not None and now - self._requested_at >= LINK.ask_again_s
        if not (due or again):
            return []
        self._requested_s, self._requested_at = vehicle_s, now
        return [TimeSync(answered_ns=0, requested_ns=round(vehicle_s * 1e9))]

    def take(self, endpoint: EndpointT, answer: TimeSync) -> None:
        """Take a ground station's answer to a request of this vehicle; its own requests are ignored."""
        if answer.answered_ns == 0 or not 0 < answer.requested_ns <= round(self._requested_s * 1e9):
            return
        self._read_s[endpoint] = max(self._read_s.get(endpoint, 0.0), answer.requested_ns / 1e9)

    def forget(self) -> None:
        """Treat all ground stations as unreachable until they answer again."""
        self._read_s.clear()
        self._waits_since = None

    def waits(self, vehicle_s: float, now: float) -> bool:
        """Whether vehicle time must stand still because a ground station lags behind."""
        behind = [endpoint for endpoint, read_s in self._read_s.items() if vehicle_s - read_s > LINK.ahead_s]
        if not behind:
            self._waits_since = None
            return False
        if self._waits_since is None:
            self._waits_since = now
        if now - self._waits_since <= LINK.unanswered_s:
            return True
        for endpoint in behind:
            del self._read_s[endpoint]
        self._waits_since = None
        return False
