"""The MAVLink messages as rows: layout by MAVLink's own tables, and for each field the conversion between wire value and units.

The only module that imports pymavlink.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from operator import attrgetter, itemgetter
from struct import Struct
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from mission_io.errors import MisuseError
from mission_io.model.plain_text import plain_text
from mission_io.wire import messages as m

_EVENT_ID: Final = 410
_EVENT_STRUCT: Final = Struct("<IIH3B40B")
_EVENT_CRC_EXTRA: Final = 160
"""EVENT of the common message set, which pymavlink's tables lack."""

CRC_EXTRAS: Final[Mapping[int, int]] = {
    **{number: kind.crc_extra for number, kind in _dialect.mavlink_map.items()},
    _EVENT_ID: _EVENT_CRC_EXTRA,
}
"""For each message id of the dialect, the byte that goes last into its checksum."""

PAYLOAD_SIZES: Final[Mapping[int, int]] = {
    **{number: kind.unpacker.size for number, kind in _dialect.mavlink_map.items()},
    _EVENT_ID: _EVENT_STRUCT.size,
}
"""For each message id of the dialect, the size of its payload with all extensions, in bytes."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Packing of the payload of a kind of message."""

    name: str  # its MAVLink name, in small letters
    message_id: int  # its number
    struct: Struct  # packs and unpacks the whole payload, extensions included
    # for each field, where its first value is among the values of ``struct``, and how many it has
    spans: Mapping[str, tuple[int, int]]

    @property
    def value_count(self) -> int:
        """Number of values that ``struct`` packs."""
        return sum(count for _, count in self.spans.values())

    def size_before(self, field: str) -> int:
        """The bytes of the payload before a field; before its first extension that is all MAVLink 1 has."""
        index = self.spans[field][0]
        items = _format_items(self.struct.format)
        return Struct("<" + "".join(items[:index])).size


_LATER_EXTENSIONS: Final[Mapping[str, tuple[tuple[str, str], ...]]] = {
    "mission_ack": (("opaque_id", "I"),),
    "mission_count": (("opaque_id", "I"),),
    "mission_current": (("mission_id", "I"), ("fence_id", "I"), ("rally_points_id", "I")),
}
"""Extensions of the common message set that pymavlink's tables may lack, each with its format. Checksums do not know them."""


_EVENT_SPANS: Final = {
    **{
        field: (index, 1)
        for index, field in enumerate(
            ("id", "event_time_boot_ms", "sequence", "destination_component", "destination_system", "log_levels")
        )
    },
    "arguments": (6, 40),
}


def layout_of(name: str) -> Layout:
    """The layout of a message by its MAVLink name, in small letters."""
    if name == "event":
        return Layout(name, _EVENT_ID, _EVENT_STRUCT, _EVENT_SPANS)
    kind = getattr(_dialect, f"MAVLink_{name}_message")
    spans: dict[str, tuple[int, int]] = {}
    start = 0
    for field, count in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
        spans[field] = (start, count)
        start += count
    packed = kind.unpacker.format
    for field, letter in _LATER_EXTENSIONS.get(name, ()):
        if field not in spans:
            spans[field] = (start, 1)
            start, packed = start + 1, packed + letter
    return Layout(name, kind.id, Struct(packed), spans)


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, the checksum of every MAVLink frame."""
    crc: int = _dialect.x25crc(data).crc
    return crc


def _format_items(text: str) -> list[str]:
    """One format for each value: ``<B50s2H`` is ``B``, ``50s``, ``H``, ``H``."""
    found = re.findall(r"(\d*)([a-zA-Z])", text)
    return [item for n, letter in found for item in ([n + letter] if letter == "s" else [letter] * int(n or 1))]


@dataclass(frozen=True, slots=True)
class FieldRow:
    """One attribute of ours, its wire fields and its conversions; without conversions it equals the field."""

    name: str
    wire: tuple[str, ...]
    decode: Callable[[Any], Any] | None = None
    encode: Callable[[Any], Any] | None = None


@dataclass(frozen=True, slots=True)
class MessageRow:
    """A message of ours and the MAVLink message it is."""

    ours: type[m.Message]  # our class
    layout: Layout  # how MAVLink packs it
    fields: tuple[FieldRow, ...]  # how our attributes stand to its fields, in the order of the class
    attributes: Callable[[m.Message], tuple[Any, ...]]  # takes all of them from a message
    takers: tuple[Callable[[Sequence[Any]], Any], ...]  # for each, what takes it from the values of the layout
    # for each, where it is among the values of the layout: a place, or from where to where
    slots: tuple[int | slice, ...]
    # values in the order of the layout, where what our attributes do not set is always the same
    constants: tuple[Any, ...]
    size_1: int  # the bytes of its payload that exist in MAVLink 1
    # our attributes that do not exist in MAVLink 1, each with the value that stands for "not said"
    extensions: Mapping[str, Any]


def _same(name: str, wire: str = "") -> FieldRow:
    return FieldRow(name, (wire or name,))


def _scaled(name: str, wire: str, per_unit: float, *, unknown: int | None = None) -> FieldRow:
    """An integer that counts ``per_unit`` to our unit; ``unknown`` is the integer that stands for None.

    ``round``, not truncation: 6 % of the coordinates with seven decimals would otherwise come out one too small.
    """

    def decode(value: int) -> float | None:
        return None if value == unknown and unknown is not None else value / per_unit

    def encode(value: float | None) -> int:
        if value is None and unknown is not None:
            return unknown
        try:
            return round(value * per_unit)  # type: ignore[operator]
        except (TypeError, ValueError, OverflowError) as error:
            raise MisuseError(f"{name} = {value} cannot be sent: {error}") from None

    return FieldRow(name, (wire,), decode, encode)


def _known(name: str, wire: str, unknown: int) -> FieldRow:
    """An integer, or None for the one that stands for it."""
    return FieldRow(
        name,
        (wire,),
        lambda value: None if value == unknown else value,
        lambda value: unknown if value is None else value,
    )


def _numbers(count: int) -> FieldRow:
    """``params``, from param1 on."""
    return FieldRow("params", tuple(f"param{i}" for i in range(1, count + 1)))


def _array(name: str, wire: str, per_unit: float = 1.0, *, unknown: int | None = None) -> FieldRow:
    """An array of integers that count ``per_unit`` to our unit, as a tuple; ``unknown`` stands for None."""
    one = _scaled(name, wire, per_unit, unknown=unknown)
    decode, encode = one.decode, one.encode
    if decode is None or encode is None:
        raise MisuseError(f"{name}: a scaled field requires conversions in both directions")
    return FieldRow(
        name, (wire,), lambda values: tuple(decode(v) for v in values), lambda values: tuple(encode(v) for v in values)
    )


def _text(name: str, wire: str, size: int) -> FieldRow:
    """A string in a fixed number of bytes; longer ones are refused, not cut. What arrives may be shown as it is."""

    def encode(value: str) -> bytes:
        data = value.encode("ascii", errors="replace")
        if len(data) > size:
            raise MisuseError(f"{name} has {len(data)} bytes, but the limit of MAVLink is {size}: {value!r}")
        return data

    def decode(value: bytes) -> str:
        return plain_text(value.split(b"\0", 1)[0].decode("ascii", errors="replace"))

    return FieldRow(name, (wire,), decode, encode)


_FIRST_EXTENSION: Final = {
    "autopilot_version": "uid2",
    "battery_status": "time_remaining",
    "camera_feedback": "completed_captures",
    "command_ack": "progress",
    "ekf_status_report": "airspeed_variance",
    "gps_global_origin": "time_usec",
    "gps_raw_int": "alt_ellipsoid",
    "home_position": "time_usec",
    "mission_ack": "mission_type",
    "mission_clear_all": "mission_type",
    "mission_count": "mission_type",
    "mission_write_partial_list": "mission_type",
    "mission_current": "total",
    "mission_item": "mission_type",
    "mission_item_int": "mission_type",
    "mission_request": "mission_type",
    "mission_request_int": "mission_type",
    "mission_request_list": "mission_type",
    "statustext": "id",
    "sys_status": "onboard_control_sensors_present_extended",
}
"""The first field of each message that came with MAVLink 2; all that follow it on the wire did, too."""


def _row(ours: type[m.Message], wire: str, *fields_of: FieldRow | str, **constants: Any) -> MessageRow:
    layout = layout_of(wire)
    named = {f.name: f for f in (_same(f) if isinstance(f, str) else f for f in fields_of)}
    ours_fields = tuple(named.pop(field.name) for field in fields(ours))
    values: list[Any] = [0] * layout.value_count
    for name, value in constants.items():
        start, count = layout.spans[name]
        values[start : start + count] = value if count > 1 else [value]
    first = _FIRST_EXTENSION.get(wire)
    extension_at = layout.value_count if first is None else layout.spans[first][0]
    defaults = {field.name: field.default for field in fields(ours) if field.default is not MISSING}
    slots = tuple(_slot_of(field, layout) for field in ours_fields)
    return MessageRow(
        ours,
        layout,
        ours_fields,
        _all_of([field.name for field in ours_fields]),
        tuple(itemgetter(slot) for slot in slots),
        slots,
        tuple(values),
        layout.struct.size if first is None else layout.size_before(first),
        {f.name: defaults[f.name] for f in ours_fields if layout.spans[f.wire[0]][0] >= extension_at},
    )


def _slot_of(field: FieldRow, layout: Layout) -> int | slice:
    """Where a field is among the values; the parts of one that has several follow each other in every message."""
    start, count = layout.spans[field.wire[0]]
    count = max(count, len(field.wire))
    return start if count == 1 else slice(start, start + count)


def _all_of(names: list[str]) -> Callable[[m.Message], tuple[Any, ...]]:
    """A function that takes these attributes from a message, as a tuple also for a single one."""
    take = attrgetter(*names)
    return take if len(names) > 1 else lambda message: (take(message),)


_TO = ("target_system", "target_component")
_BOOT = _scaled("time_boot_s", "time_boot_ms", 1e3)
_ITEM = (*_TO, "seq", "frame", "command", _numbers(4), "x", "y", "z", "current", "autocontinue", "mission_type")

ROWS: Final[tuple[MessageRow, ...]] = (
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
        m.GpsGlobalOrigin, "gps_global_origin",
        _scaled("lat_deg", "latitude", 1e7), _scaled("lon_deg", "longitude", 1e7),
        _scaled("alt_amsl_m", "altitude", 1e3),
    ),
    _row(
        m.HomePosition, "home_position",
        _scaled("lat_deg", "latitude", 1e7), _scaled("lon_deg", "longitude", 1e7),
        _scaled("alt_amsl_m", "altitude", 1e3),
        x=0.0, y=0.0, z=0.0, q=(1.0, 0.0, 0.0, 0.0), approach_x=0.0, approach_y=0.0, approach_z=0.0,
    ),
    _row(
        m.MissionCurrent, "mission_current", "seq", _known("total", "total", 65535), _same("state", "mission_state"),
        "mission_id", "fence_id", "rally_points_id",
    ),
    _row(m.MissionItemReached, "mission_item_reached", "seq"),
    _row(
        m.StatusText, "statustext", "severity", _text("text", "text", 50), _same("text_id", "id"),
        _same("chunk", "chunk_seq"),
    ),
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
        m.CameraFeedback, "camera_feedback", _scaled("time_s", "time_usec", 1e6), _same("number", "img_idx"),
        _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lng", 1e7), _same("alt_amsl_m", "alt_msl"),
        _same("alt_above_home_m", "alt_rel"), _same("roll_deg", "roll"), _same("pitch_deg", "pitch"), _same("yaw_deg", "yaw"),
        _same("completed", "completed_captures"), target_system=0, cam_idx=0, foc_len=0.0, flags=0,
    ),
    _row(
        m.CameraImageCaptured, "camera_image_captured", _BOOT, _scaled("lat_deg", "lat", 1e7),
        _scaled("lon_deg", "lon", 1e7), _scaled("alt_amsl_m", "alt", 1e3), _scaled("alt_above_home_m", "relative_alt", 1e3),
        _same("quaternion", "q"), _same("number", "image_index"), _same("success", "capture_result"),
        time_utc=0, camera_id=0, file_url=b"",
    ),
    _row(
        m.EkfStatusReport, "ekf_status_report", "flags", "velocity_variance",
        _same("position_horizontal_variance", "pos_horiz_variance"),
        _same("position_vertical_variance", "pos_vert_variance"), "compass_variance", "terrain_alt_variance",
    ),
    _row(m.ExtendedSysState, "extended_sys_state", "landed_state", "vtol_state"),
    _row(m.MissionCount, "mission_count", *_TO, "count", "mission_type", "opaque_id"),
    _row(m.MissionWritePartialList, "mission_write_partial_list", *_TO, "start_index", "end_index", "mission_type"),
    _row(m.MissionRequest, "mission_request", *_TO, "seq", "mission_type"),
    _row(m.MissionRequestInt, "mission_request_int", *_TO, "seq", "mission_type"),
    _row(m.MissionItemInt, "mission_item_int", *_ITEM),
    _row(m.MissionItemFloat, "mission_item", *_ITEM),
    _row(m.MissionAck, "mission_ack", *_TO, _same("result", "type"), "mission_type", "opaque_id"),
    _row(m.MissionRequestList, "mission_request_list", *_TO, "mission_type"),
    _row(m.MissionClearAll, "mission_clear_all", *_TO, "mission_type"),
    _row(m.MissionSetCurrent, "mission_set_current", *_TO, "seq"),
    _row(
        m.AutopilotVersion, "autopilot_version", "capabilities", "flight_sw_version", "uid", "uid2",
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
    _row(m.ParamRequestList, "param_request_list", *_TO),
    _row(m.ParamError, "param_error", *_TO, _text("name", "param_id", 16), _same("index", "param_index"), "error"),
    _row(
        m.ParamExtRequestRead, "param_ext_request_read", *_TO, _text("name", "param_id", 16),
        _same("index", "param_index"),
    ),
    _row(m.ParamExtRequestList, "param_ext_request_list", *_TO),
    _row(
        m.ParamExtValue, "param_ext_value", _text("name", "param_id", 16), _same("value", "param_value"), "param_type",
        _same("count", "param_count"), _same("index", "param_index"),
    ),
    _row(
        m.ParamExtSet, "param_ext_set", *_TO, _text("name", "param_id", 16), _same("value", "param_value"), "param_type"
    ),
    _row(
        m.ParamExtAck, "param_ext_ack", _text("name", "param_id", 16), _same("value", "param_value"), "param_type",
        _same("result", "param_result"),
    ),
    _row(
        m.RequestDataStream, "request_data_stream", *_TO, _same("stream", "req_stream_id"),
        _same("rate_hz", "req_message_rate"), _same("start", "start_stop"),
    ),
    _row(
        m.BatteryStatus, "battery_status", _same("battery", "id"), _array("voltages_v", "voltages", 1e3, unknown=65535),
        _scaled("current_a", "current_battery", 1e2, unknown=-1), _known("consumed_mah", "current_consumed", -1),
        _known("remaining_percent", "battery_remaining", -1), _known("time_left_s", "time_remaining", 0), "charge_state",
        energy_consumed=-1, temperature=32767, battery_function=0, type=0,
    ),
    _row(
        m.VfrHud, "vfr_hud", _same("airspeed_m_s", "airspeed"), _same("ground_speed_m_s", "groundspeed"),
        _same("heading_deg", "heading"), _same("throttle_percent", "throttle"), _same("alt_amsl_m", "alt"),
        _same("climb_m_s", "climb"),
    ),
    _row(
        m.TerrainRequest, "terrain_request", _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lon", 1e7),
        _same("spacing_m", "grid_spacing"), "mask",
    ),
    _row(
        m.TerrainData, "terrain_data", _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lon", 1e7),
        _same("spacing_m", "grid_spacing"), _same("part", "gridbit"), _same("heights_amsl_m", "data"),
    ),
    _row(
        m.TerrainReport, "terrain_report", _scaled("lat_deg", "lat", 1e7), _scaled("lon_deg", "lon", 1e7),
        _same("spacing_m", "spacing"), _same("terrain_alt_amsl_m", "terrain_height"),
        _same("height_above_terrain_m", "current_height"), "pending", "loaded",
    ),
    _row(
        m.FileTransfer, "file_transfer_protocol", *_TO, FieldRow("payload", ("payload",), bytes, tuple), target_network=0
    ),
    _row(m.LogRequestList, "log_request_list", *_TO, _same("first", "start"), _same("last", "end")),
    _row(
        m.LogEntry, "log_entry", _same("log_id", "id"), _same("log_count", "num_logs"),
        _same("last_log_id", "last_log_num"), _same("time_unix_s", "time_utc"), _same("size_bytes", "size"),
    ),
    _row(
        m.LogRequestData, "log_request_data", *_TO, _same("log_id", "id"), _same("offset_bytes", "ofs"), "count"
    ),
    _row(
        m.LogData, "log_data", _same("log_id", "id"), _same("offset_bytes", "ofs"), "count", _same("padded", "data")
    ),
    _row(m.LogRequestEnd, "log_request_end", *_TO),
    _row(
        m.RadioStatus, "radio_status", "rssi", _same("remote_rssi", "remrssi"),
        _same("transmit_buffer_percent", "txbuf"), "noise", _same("remote_noise", "remnoise"),
        _same("receive_errors", "rxerrors"), _same("corrected", "fixed"),
    ),
    _row(m.SystemTime, "system_time", _scaled("time_unix_s", "time_unix_usec", 1e6), _BOOT),
    _row(
        m.Event, "event", _same("target_component", "destination_component"),
        _same("target_system", "destination_system"), _same("event_id", "id"),
        _same("time_boot_ms", "event_time_boot_ms"), "sequence", "log_levels", "arguments",
    ),
    _row(m.TimeSync, "timesync", _same("answered_ns", "tc1"), _same("requested_ns", "ts1")),
)  # fmt: skip

BY_CLASS: Final = {row.ours: row for row in ROWS}
BY_ID: Final = {row.layout.message_id: row for row in ROWS}
