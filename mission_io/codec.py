"""MAVLink 2 bytes to messages and back. The only module that knows pymavlink.

Each message has one row in a table: its MAVLink name and, field by field, how a number on the wire becomes a number in
units. Frames are found by their checksum, so garbage, damaged and unknown messages are skipped and counted, and a
datagram holds nothing back for the next.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mission_io import messages as m
from mission_io.errors import MisuseError


@dataclass(frozen=True, slots=True)
class _Field:
    """One attribute of ours: the wire fields it is made of, and how."""

    name: str
    wire: tuple[str, ...]
    decode: Callable[..., Any]
    encode: Callable[[Any], tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class _Row:
    """A message of ours, the MAVLink message it is, and the wire fields that are always the same when sent."""

    ours: type[m.Message]
    wire: str
    fields: tuple[_Field, ...]
    constants: Mapping[str, Any]


def _same(name: str, wire: str = "") -> _Field:
    return _Field(name, (wire or name,), lambda value: value, lambda value: (value,))


def _scaled(name: str, wire: str, per_unit: float, *, unknown: int | None = None) -> _Field:
    """An integer that counts ``per_unit`` to our unit; ``unknown`` is the integer that stands for None.

    ``round``, not truncation: 6 % of the coordinates with seven decimals would otherwise come out one too small.
    """

    def decode(value: int) -> float | None:
        return None if value == unknown and unknown is not None else value / per_unit

    def encode(value: float | None) -> tuple[int]:
        if value is None and unknown is not None:
            return (unknown,)
        try:
            return (round(value * per_unit),)  # type: ignore[operator]
        except (TypeError, ValueError, OverflowError) as error:
            raise MisuseError(f"{name} = {value} cannot be sent: {error}") from None

    return _Field(name, (wire,), decode, encode)


def _known(name: str, wire: str, unknown: int) -> _Field:
    """An integer as it is, except for the one that stands for None."""
    return _Field(
        name,
        (wire,),
        lambda value: None if value == unknown else value,
        lambda value: (unknown if value is None else value,),
    )


def _numbers(count: int) -> _Field:
    """``params``, from param1 on."""
    names = tuple(f"param{i}" for i in range(1, count + 1))
    return _Field("params", names, lambda *values: values, tuple)


def _text(name: str, wire: str, size: int) -> _Field:
    """A string in a fixed number of bytes; longer ones are refused, not cut."""

    def encode(value: str) -> tuple[bytes]:
        data = value.encode("ascii", errors="replace")
        if len(data) > size:
            raise MisuseError(f"{name} has {len(data)} bytes, MAVLink has room for {size}: {value!r}")
        return (data,)

    return _Field(name, (wire,), lambda value: value, encode)


def _row(ours: type[m.Message], wire: str, *fields: _Field | str, **constants: Any) -> _Row:
    return _Row(ours, wire, tuple(_same(f) if isinstance(f, str) else f for f in fields), constants)


_TO = ("target_system", "target_component")
_BOOT = _scaled("time_boot_s", "time_boot_ms", 1e3)
_ITEM = (*_TO, "seq", "frame", "command", _numbers(4), "x", "y", "z", "current", "autocontinue", "mission_type")

_ROWS: Final[tuple[_Row, ...]] = (
    _row(
        m.Heartbeat, "heartbeat",
        "autopilot", _same("vehicle_type", "type"), "base_mode", "custom_mode", "system_status", mavlink_version=3,
    ),
    _row(
        m.GlobalPositionInt, "global_position_int", _BOOT,
        _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lon", 1e7), _scaled("alt_amsl_m", "alt", 1e3),
        _scaled("alt_above_home_m", "relative_alt", 1e3), _scaled("velocity_north_m_s", "vx", 1e2),
        _scaled("velocity_east_m_s", "vy", 1e2), _scaled("velocity_down_m_s", "vz", 1e2),
        _scaled("heading_deg", "hdg", 1e2, unknown=65535),
    ),
    _row(
        m.Attitude, "attitude", _BOOT,
        _same("roll_rad", "roll"), _same("pitch_rad", "pitch"), _same("yaw_rad", "yaw"),
        _same("roll_rate_rad_s", "rollspeed"), _same("pitch_rate_rad_s", "pitchspeed"),
        _same("yaw_rate_rad_s", "yawspeed"),
    ),
    _row(
        m.HomePosition, "home_position",
        _scaled("lat_deg", "latitude", 1e7), _scaled("lon_deg", "longitude", 1e7),
        _scaled("alt_amsl_m", "altitude", 1e3),
        x=0.0, y=0.0, z=0.0, q=(1.0, 0.0, 0.0, 0.0), approach_x=0.0, approach_y=0.0, approach_z=0.0,
    ),
    _row(m.MissionCurrent, "mission_current", "seq", _known("total", "total", 65535), _same("state", "mission_state")),
    _row(m.MissionItemReached, "mission_item_reached", "seq"),
    _row(m.StatusText, "statustext", "severity", _text("text", "text", 50)),
    _row(m.CommandLong, "command_long", *_TO, "command", _numbers(7), "confirmation"),
    _row(
        m.CommandInt, "command_int", *_TO, "frame", "command", _numbers(4), "x", "y", "z", current=0, autocontinue=0
    ),
    _row(m.CommandAck, "command_ack", "command", "result", "progress", "result_param2", *_TO),
    _row(
        m.SysStatus, "sys_status",
        _same("sensors_present", "onboard_control_sensors_present"),
        _same("sensors_enabled", "onboard_control_sensors_enabled"),
        _same("sensors_healthy", "onboard_control_sensors_health"),
        _scaled("load_fraction", "load", 1e3), _scaled("battery_v", "voltage_battery", 1e3, unknown=65535),
        _scaled("battery_a", "current_battery", 1e2, unknown=-1),
        _known("battery_remaining_percent", "battery_remaining", -1),
        drop_rate_comm=0, errors_comm=0, errors_count1=0, errors_count2=0, errors_count3=0, errors_count4=0,
    ),
    _row(
        m.GpsRawInt, "gps_raw_int", _scaled("time_s", "time_usec", 1e6), "fix_type",
        _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lon", 1e7), _scaled("alt_amsl_m", "alt", 1e3),
        _scaled("horizontal_dilution", "eph", 1e2, unknown=65535),
        _scaled("vertical_dilution", "epv", 1e2, unknown=65535),
        _scaled("ground_speed_m_s", "vel", 1e2, unknown=65535), _scaled("course_deg", "cog", 1e2, unknown=65535),
        _known("satellites_visible", "satellites_visible", 255),
    ),
    _row(
        m.EkfStatusReport, "ekf_status_report", "flags", "velocity_variance",
        _same("position_horizontal_variance", "pos_horiz_variance"),
        _same("position_vertical_variance", "pos_vert_variance"), "compass_variance", "terrain_alt_variance",
    ),
    _row(m.ExtendedSysState, "extended_sys_state", "landed_state", "vtol_state"),
    _row(m.MissionCount, "mission_count", *_TO, "count", "mission_type"),
    _row(m.MissionRequest, "mission_request", *_TO, "seq", "mission_type"),
    _row(m.MissionRequestInt, "mission_request_int", *_TO, "seq", "mission_type"),
    _row(m.MissionItemInt, "mission_item_int", *_ITEM),
    _row(m.MissionItemFloat, "mission_item", *_ITEM),
    _row(m.MissionAck, "mission_ack", *_TO, _same("result", "type"), "mission_type"),
    _row(m.MissionRequestList, "mission_request_list", *_TO, "mission_type"),
    _row(m.MissionClearAll, "mission_clear_all", *_TO, "mission_type"),
    _row(m.MissionSetCurrent, "mission_set_current", *_TO, "seq"),
    _row(
        m.AutopilotVersion, "autopilot_version", "capabilities", "flight_sw_version", "uid",
        middleware_sw_version=0, os_sw_version=0, board_version=0, flight_custom_version=(0,) * 8,
        middleware_custom_version=(0,) * 8, os_custom_version=(0,) * 8, vendor_id=0, product_id=0,
    ),
    _row(m.SetMode, "set_mode", "target_system", "base_mode", "custom_mode"),
    _row(m.ParamRequestRead, "param_request_read", *_TO, _text("name", "param_id", 16), _same("index", "param_index")),
    _row(
        m.ParamSet, "param_set", *_TO, _text("name", "param_id", 16), _same("value", "param_value"), "param_type"
    ),
    _row(
        m.ParamValue, "param_value", _text("name", "param_id", 16), _same("value", "param_value"), "param_type",
        _same("count", "param_count"), _same("index", "param_index"),
    ),
    _row(m.SystemTime, "system_time", _scaled("time_unix_s", "time_unix_usec", 1e6), _BOOT),
)  # fmt: skip

_BY_CLASS: Final = {row.ours: (row, getattr(dialect, f"MAVLink_{row.wire}_message")) for row in _ROWS}
_BY_NAME: Final = {row.wire.upper(): row for row in _ROWS}


def message_id(kind: type[Any]) -> int:
    """The number that MAVLink gives a kind of message, as SET_MESSAGE_INTERVAL and REQUEST_MESSAGE want it."""
    number: int = _BY_CLASS[kind][1].id
    return number


_MAGIC_V1, _MAGIC_V2, _SIGNED = 0xFE, 0xFD, 0x01
_SIGNATURE_SIZE = 13


class Codec:
    """Speaks as one system and component; keeps the sequence number of what it sends and counts what it skips.

    Attributes:
        skipped_bytes: Bytes that belonged to no valid message.
        unknown_messages: Valid messages of kinds that mission_io has no use for.
    """

    def __init__(self, *, system_id: int, component_id: int) -> None:
        for name, value in (("system_id", system_id), ("component_id", component_id)):
            if not 1 <= value <= 255:
                raise MisuseError(f"{name} is {value}, MAVLink has 1 to 255")
        self.system_id, self.component_id = system_id, component_id
        self._sender = dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._reader = dialect.MAVLink(None)
        self.skipped_bytes = 0
        self.unknown_messages = 0

    def encode(self, message: m.Message) -> bytes:
        """The bytes of one message.

        Raises:
            MisuseError: a value that does not fit its MAVLink field; it names the message and the field.
        """
        row, wire_class = _BY_CLASS[type(message)]
        values = dict(row.constants)
        for field in row.fields:
            values.update(zip(field.wire, field.encode(getattr(message, field.name)), strict=True))
        try:
            data: bytes = wire_class(**values).pack(self._sender)
        except (struct.error, TypeError, OverflowError) as error:
            raise MisuseError(f"{message} does not fit in {row.wire.upper()}: {error}") from None
        self._sender.seq = (self._sender.seq + 1) % 256
        return bytes(data)

    def decode(self, datagram: bytes) -> list[m.Received]:
        """The messages in one datagram, in order. Never raises on what a peer sent."""
        found: list[m.Received] = []
        start = 0
        while start < len(datagram):
            size = _frame_size(datagram, start)
            received = self._decode_frame(datagram[start : start + size]) if size else None
            if received is None:
                self.skipped_bytes += 1
                start += 1
                continue
            start += size
            if received.get_type() not in _BY_NAME:
                self.unknown_messages += 1
                continue
            found.append(m.Received(_message_of(received), received.get_srcSystem(), received.get_srcComponent()))
        return found

    def _decode_frame(self, frame: bytes) -> Any:
        try:
            message = self._reader.decode(bytearray(frame))
        except dialect.MAVError:
            return None
        # Of a kind that is not in the dialect nothing is known, not even whether the checksum is right.
        return None if message.get_type().startswith("UNKNOWN") else message


def _frame_size(data: bytes, start: int) -> int:
    """The size in bytes of the frame that may start here; 0 when none does or it is cut off."""
    rest = len(data) - start
    if data[start] == _MAGIC_V2 and rest >= 12:
        size = 12 + data[start + 1] + (_SIGNATURE_SIZE if data[start + 2] & _SIGNED else 0)
    elif data[start] == _MAGIC_V1 and rest >= 8:
        size = 8 + data[start + 1]
    else:
        return 0
    return size if size <= rest else 0


def _message_of(received: Any) -> m.Message:
    row = _BY_NAME[received.get_type()]
    return row.ours(**{f.name: f.decode(*(getattr(received, wire) for wire in f.wire)) for f in row.fields})
