"""MAVLink bytes to messages and back.

Each message has one row in a table: its MAVLink name and, field by field, how a number on the wire becomes a number in
units. Frames are found by their checksum, so garbage, damaged and unknown messages are skipped and counted, and a
datagram holds nothing back for the next. MAVLink 2 is spoken, and MAVLink 1 to peers that speak nothing else.
"""

import struct
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from operator import attrgetter, itemgetter
from typing import Any, Final

from mission_io import messages as m
from mission_io.dialect import Layout, layout_of
from mission_io.errors import MisuseError
from mission_io.framing import SIGNED_FLAG, Framer, WireFrame, mavlink1_frame, mavlink2_frame
from mission_io.signing import Signing, Verdict
from mission_io.statistics import LinkStatistics, SequenceCounter


@dataclass(frozen=True, slots=True)
class _Field:
    """One attribute of ours: the wire fields it is made of, and how; without conversions it is what is on the wire."""

    name: str
    wire: tuple[str, ...]
    decode: Callable[[Any], Any] | None = None
    encode: Callable[[Any], Any] | None = None


@dataclass(frozen=True, slots=True)
class _Row:
    """A message of ours and the MAVLink message it is.

    Attributes:
        ours: Our class.
        layout: How MAVLink packs it.
        fields: How our attributes stand to its fields, in the order of the class.
        attributes: Takes all of them from a message.
        takers: For each, what takes it from the values of the layout.
        slots: For each, where it is among the values of the layout: a place, or from where to where.
        constants: Values in the order of the layout, where what our attributes do not set is always the same.
        size_1: The bytes of its payload that exist in MAVLink 1.
        extensions: Our attributes that do not exist in MAVLink 1, each with the value that stands for "not said".
    """

    ours: type[m.Message]
    layout: Layout
    fields: tuple[_Field, ...]
    attributes: Callable[[m.Message], tuple[Any, ...]]
    takers: tuple[Callable[[Sequence[Any]], Any], ...]
    slots: tuple[int | slice, ...]
    constants: tuple[Any, ...]
    size_1: int
    extensions: Mapping[str, Any]


def _same(name: str, wire: str = "") -> _Field:
    return _Field(name, (wire or name,))


def _scaled(name: str, wire: str, per_unit: float, *, unknown: int | None = None) -> _Field:
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

    return _Field(name, (wire,), decode, encode)


def _known(name: str, wire: str, unknown: int) -> _Field:
    """An integer as it is, except for the one that stands for None."""
    return _Field(
        name,
        (wire,),
        lambda value: None if value == unknown else value,
        lambda value: unknown if value is None else value,
    )


def _numbers(count: int) -> _Field:
    """``params``, from param1 on."""
    return _Field("params", tuple(f"param{i}" for i in range(1, count + 1)))


def _text(name: str, wire: str, size: int) -> _Field:
    """A string in a fixed number of bytes; longer ones are refused, not cut."""

    def encode(value: str) -> bytes:
        data = value.encode("ascii", errors="replace")
        if len(data) > size:
            raise MisuseError(f"{name} has {len(data)} bytes, MAVLink has room for {size}: {value!r}")
        return data

    return _Field(name, (wire,), lambda value: value.split(b"\0", 1)[0].decode("ascii", errors="replace"), encode)


_FIRST_EXTENSION: Final = {
    "autopilot_version": "uid2",
    "command_ack": "progress",
    "ekf_status_report": "airspeed_variance",
    "gps_raw_int": "alt_ellipsoid",
    "home_position": "time_usec",
    "mission_ack": "mission_type",
    "mission_clear_all": "mission_type",
    "mission_count": "mission_type",
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


def _row(ours: type[m.Message], wire: str, *fields_of: _Field | str, **constants: Any) -> _Row:
    layout = layout_of(wire)
    named = {f.name: f for f in (_same(f) if isinstance(f, str) else f for f in fields_of)}
    ours_fields = tuple(named.pop(field.name) for field in fields(ours))
    values: list[Any] = [0] * layout.value_count
    for name, value in constants.items():
        start, count = layout.places[name]
        values[start : start + count] = value if count > 1 else [value]
    first = _FIRST_EXTENSION.get(wire)
    extension_at = layout.value_count if first is None else layout.places[first][0]
    defaults = {field.name: field.default for field in fields(ours) if field.default is not MISSING}
    slots = tuple(_slot_of(field, layout) for field in ours_fields)
    return _Row(
        ours,
        layout,
        ours_fields,
        _all_of([field.name for field in ours_fields]),
        tuple(itemgetter(slot) for slot in slots),
        slots,
        tuple(values),
        layout.struct.size if first is None else layout.size_before(first),
        {f.name: defaults[f.name] for f in ours_fields if layout.places[f.wire[0]][0] >= extension_at},
    )


def _slot_of(field: _Field, layout: Layout) -> int | slice:
    """Where a field is among the values; the parts of one that has several follow each other in every message."""
    start = layout.places[field.wire[0]][0]
    return start if len(field.wire) == 1 else slice(start, start + len(field.wire))


def _all_of(names: list[str]) -> Callable[[m.Message], tuple[Any, ...]]:
    """What takes these attributes from a message, as a tuple also when there is only one."""
    take = attrgetter(*names)
    return take if len(names) > 1 else lambda message: (take(message),)


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
    _row(
        m.RadioStatus, "radio_status", "rssi", _same("remote_rssi", "remrssi"),
        _same("transmit_buffer_percent", "txbuf"), "noise", _same("remote_noise", "remnoise"),
        _same("receive_errors", "rxerrors"), _same("corrected", "fixed"),
    ),
    _row(m.SystemTime, "system_time", _scaled("time_unix_s", "time_unix_usec", 1e6), _BOOT),
)  # fmt: skip

_BY_CLASS: Final = {row.ours: row for row in _ROWS}
_BY_ID: Final = {row.layout.message_id: row for row in _ROWS}


def message_id(kind: type[Any]) -> int:
    """The number that MAVLink gives a kind of message, as SET_MESSAGE_INTERVAL and REQUEST_MESSAGE want it."""
    return _BY_CLASS[kind].layout.message_id


_REMEMBERED = 200
"""Frames of our own that are known when they come back; fewer than there are sequence numbers."""

_USE_2 = "the peer speaks nothing newer: switch its link to MAVLink 2 (ArduPilot: SERIALn_PROTOCOL = 2)"
_WHAT_IS_NEW = {"mission_type": "fences and rally points"}


class Codec:
    """Speaks as one system and component; keeps the sequence number of what it sends and counts what it skips.

    Args:
        system_id: The MAVLink system that it speaks as.
        component_id: The component.
        signing: Signs what is sent and refuses what is not signed with the same key; None does neither.

    Attributes:
        version: The MAVLink version that is spoken: 2, or 1 to peers that know no other.
    """

    def __init__(self, *, system_id: int, component_id: int, signing: Signing | None = None) -> None:
        for name, value in (("system_id", system_id), ("component_id", component_id)):
            if not 1 <= value <= 255:
                raise MisuseError(f"{name} is {value}, MAVLink has 1 to 255")
        self.system_id, self.component_id = system_id, component_id
        self.signing = signing
        self.version = 2
        self._seq = 0
        self._sent: dict[bytes, None] = {}
        self._framer = Framer()
        self._sequence = SequenceCounter()
        self._counts: Counter[str] = Counter()

    @property
    def statistics(self) -> LinkStatistics:
        """What was sent, received, lost and refused up to now."""
        framing = self._framer.counts
        return LinkStatistics(
            **self._counts,
            lost=self._sequence.lost,
            late=self._sequence.late,
            duplicates=self._sequence.duplicates,
            checksum_errors=framing.checksum_errors,
            truncated_frames=framing.truncated_frames,
            garbage_bytes=framing.garbage_bytes,
        )

    def encode(self, message: m.Message) -> bytes:
        """The bytes of one message.

        Raises:
            MisuseError: a value that does not fit its MAVLink field, or that does not exist in MAVLink 1 when that is
                spoken; it names the message and the field.
        """
        row = _BY_CLASS[type(message)]
        frame = self._frame_1(row, message) if self.version == 1 else self._frame_2(row, message)
        self._seq = (self._seq + 1) % 256
        self._counts["frames_out"] += 1
        self._sent[frame] = None
        if len(self._sent) > _REMEMBERED:
            del self._sent[next(iter(self._sent))]
        return frame

    def _frame_2(self, row: _Row, message: m.Message) -> bytes:
        signing = self.signing
        flags = 0 if signing is None else SIGNED_FLAG
        frame = mavlink2_frame(
            row.layout.message_id,
            _payload(row, message),
            seq=self._seq,
            system_id=self.system_id,
            component_id=self.component_id,
            flags=flags,
        )
        return frame if signing is None else frame + signing.signature(frame)

    def _frame_1(self, row: _Row, message: m.Message) -> bytes:
        if self.signing is not None:
            raise MisuseError(f"MAVLink 1 cannot be signed; {_USE_2}")
        for name, unsaid in row.extensions.items():
            value = getattr(message, name)
            if value != unsaid:
                what = _WHAT_IS_NEW.get(name, f"{name} = {value}")
                raise MisuseError(f"{row.layout.name.upper()}: {what} do not exist in MAVLink 1; {_USE_2}")
        return mavlink1_frame(
            row.layout.message_id,
            _payload(row, message)[: row.size_1],
            seq=self._seq,
            system_id=self.system_id,
            component_id=self.component_id,
        )

    def decode(self, datagram: bytes) -> list[m.Received]:
        """The messages in one datagram, in order. Never raises on what a peer sent."""
        found: list[m.Received] = []
        for frame in [*self._framer.feed(datagram), *self._framer.end()]:
            self._counts["frames_in"] += 1
            if frame.data in self._sent:
                self._counts["echoes"] += 1
                continue
            verdict = Verdict.ACCEPTED if self.signing is None else self.signing.judge(frame)
            if verdict is not Verdict.ACCEPTED:
                self._counts[verdict.value] += 1
                continue
            self._sequence.take((frame.system_id, frame.component_id), frame.seq)
            row = _BY_ID.get(frame.message_id)
            if row is None:
                self._counts["other_kinds"] += 1
                continue
            found.append(m.Received(_message_of(row, frame), frame.system_id, frame.component_id, frame.version))
        return found


def _payload(row: _Row, message: m.Message) -> bytes:
    values = list(row.constants)
    for field, slot, value in zip(row.fields, row.slots, row.attributes(message), strict=True):
        values[slot] = value if field.encode is None else field.encode(value)
    try:
        return row.layout.struct.pack(*values)
    except (struct.error, OverflowError) as error:
        raise MisuseError(f"{message} does not fit in {row.layout.name.upper()}: {error}") from None


def _message_of(row: _Row, frame: WireFrame) -> m.Message:
    """Our message; what does not exist in MAVLink 1 keeps its default when that was spoken."""
    size = row.layout.struct.size
    wire = row.layout.struct.unpack(frame.payload[:size].ljust(size, b"\0"))
    values = [
        take(wire) if field.decode is None else field.decode(take(wire))
        for field, take in zip(row.fields, row.takers, strict=True)
    ]
    message = row.ours(*values)
    return replace(message, **row.extensions) if frame.version == 1 and row.extensions else message
