"""The MAVLink messages that mission_io uses, as plain data in degrees, metres, metres per second and seconds.

The codec converts between bytes and these classes. Numbers that MAVLink scales to integers are exact here:
``lat_deg`` is the double nearest to the integer divided by 1e7. A field is None where MAVLink's value means "unknown".
Fields named ``target_system`` and ``target_component`` name the recipient; 0 is everybody.
Mission items become messages, and messages items, here, too.
"""

import struct
from dataclasses import dataclass, replace
from typing import NamedTuple

from mission_io.errors import FormatError, MisuseError
from mission_io.model.enums import MissionState
from mission_io.model.items import Frame, MissionItem, MissionType
from mission_io.wire.telemetry_messages import *  # noqa: F403 - its messages are used under this module's name
from mission_io.wire.telemetry_messages import Addressed as Addressed
from mission_io.wire.telemetry_messages import Message as Message


@dataclass(frozen=True, slots=True)
class MissionCurrent(Message):
    """The item the vehicle flies to.

    ``total`` is None when the vehicle does not say (65535). ``mission_id`` is another number for each mission that the vehicle
    holds; 0 where it has none. ``fence_id`` and ``rally_points_id`` are the same for the other lists.
    """

    seq: int
    total: int | None = None
    state: int = MissionState.UNKNOWN
    mission_id: int = 0
    fence_id: int = 0
    rally_points_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionItemReached(Message):
    """The vehicle reached an item; may be repeated, and may be skipped."""

    seq: int


@dataclass(frozen=True, slots=True)
class CommandLong(Addressed):
    """A command with seven parameters."""

    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


@dataclass(frozen=True, slots=True)
class CommandInt(Addressed):
    """A command with a position; ``x`` and ``y`` are wire values (degrees times 1e7 in a global frame)."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


@dataclass(frozen=True, slots=True)
class CommandAck(Message):
    """The answer to a command; ``progress`` in per cent when the result is IN_PROGRESS (255 unknown)."""

    command: int
    result: int
    progress: int = 0
    result_param2: int = 0
    target_system: int = 0
    target_component: int = 0


@dataclass(frozen=True, slots=True)
class MissionCount(Addressed):
    """Number of items that the sender is going to send; a vehicle adds the list's id, 0 without one."""

    count: int
    mission_type: int = MissionType.MISSION
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionWritePartialList(Addressed):
    """The sender is going to replace the items from ``start_index`` to ``end_index``, both among them."""

    start_index: int
    end_index: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequest(Addressed):
    """Asks for an item, in the deprecated form; answered like the other."""

    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionRequestInt(Addressed):
    """Asks for an item."""

    seq: int
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionItemInt(Addressed):
    """One item; ``x`` and ``y`` as on the wire: degrees times 1e7, or plain numbers in frame 2. ``z`` in metres."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    current: int = 0
    autocontinue: int = 1
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionItemFloat(Addressed):
    """One item in the deprecated form: 32-bit degrees, good to 0.2 m. Read, never sent by this package."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    current: int = 0
    autocontinue: int = 1
    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionAck(Addressed):
    """Ends a transfer or a clear; ``result`` is a MissionResult number, ``opaque_id`` that of the list after an upload."""

    result: int
    mission_type: int = MissionType.MISSION
    opaque_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionRequestList(Addressed):
    """Asks for a list; answered by its count."""

    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionClearAll(Addressed):
    """Asks to empty a list (255: all of them)."""

    mission_type: int = MissionType.MISSION


@dataclass(frozen=True, slots=True)
class MissionSetCurrent(Addressed):
    """Asks to go on with another item."""

    seq: int


@dataclass(frozen=True, slots=True)
class SetMode(Message):
    """Asks for another flight mode."""

    target_system: int
    base_mode: int
    custom_mode: int


@dataclass(frozen=True, slots=True)
class ParamRequestRead(Addressed):
    """Asks for a parameter by name (``index`` -1) or by index."""

    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamSet(Addressed):
    """Asks to set a parameter; ``param_type`` is a MAV_PARAM_TYPE number (9: 32-bit float)."""

    name: str
    value: float
    param_type: int = 9


@dataclass(frozen=True, slots=True)
class ParamValue(Message):
    """A parameter as the vehicle has it."""

    name: str
    value: float
    param_type: int = 9
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamRequestList(Addressed):
    """Asks for all parameters, one PARAM_VALUE each."""


@dataclass(frozen=True, slots=True)
class ParamError(Addressed):
    """Reason for a missing PARAM_VALUE: ``error`` is a MAV_PARAM_ERROR number."""

    name: str
    index: int
    error: int


@dataclass(frozen=True, slots=True)
class ParamExtRequestRead(Addressed):
    """Asks for an extended parameter by name (``index`` -1) or by index."""

    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamExtRequestList(Addressed):
    """Asks for all extended parameters, one PARAM_EXT_VALUE each."""


@dataclass(frozen=True, slots=True)
class ParamExtValue(Message):
    """An extended parameter: 128 bytes, whose type (MAV_PARAM_EXT_TYPE) gives their number and meaning."""

    name: str
    value: bytes
    param_type: int
    count: int = 0
    index: int = 65535


@dataclass(frozen=True, slots=True)
class ParamExtSet(Addressed):
    """Asks to set an extended parameter."""

    name: str
    value: bytes
    param_type: int


@dataclass(frozen=True, slots=True)
class ParamExtAck(Message):
    """The answer to PARAM_EXT_SET: the value now, and a PARAM_ACK number as ``result``."""

    name: str
    value: bytes
    param_type: int
    result: int


class Address(NamedTuple):
    """A system and one of its components; also the first two fields of a message to it."""

    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True)
class Received:
    """A message, who sent it, and in which version of MAVLink."""

    message: Message
    system_id: int
    component_id: int
    mavlink_version: int = 2

    @property
    def sender(self) -> Address:
        """System and component that sent it."""
        return Address(self.system_id, self.component_id)


def is_for(message: Message, *, system_id: int, component_id: int) -> bool:
    """Whether a message is addressed to this system and component, to all of them, or has no address."""
    to_system = getattr(message, "target_system", 0)
    to_component = getattr(message, "target_component", 0)
    return to_system in (0, system_id) and to_component in (0, component_id)


# Mission items as MISSION_ITEM_INT messages, and back.

DEGREES_SCALE = 1e7
"""Coordinates travel as whole numbers of 1e-7 degrees, about 11 mm of latitude."""

_INT32_LIMIT = 2**31


def message_from_item(
    item: MissionItem, seq: int, *, mission_type: MissionType, target_system: int, target_component: int
) -> MissionItemInt:
    """The message that carries an item.

    Raises:
        MisuseError: coordinates that are not finite or that do not fit 32 bits.
    """
    scale = DEGREES_SCALE if item.has_position else 1.0
    x, y = (
        _int32(value * scale, name, seq) for name, value in (("latitude", item.lat_deg), ("longitude", item.lon_deg))
    )
    return MissionItemInt(
        target_system,
        target_component,
        seq,
        item.frame.wire,
        item.command,
        item.params,
        x,
        y,
        item.alt_m,
        current=int(seq == 0 and mission_type is MissionType.MISSION),
        autocontinue=int(item.autocontinue),
        mission_type=mission_type,
    )


def message_to_send(
    item: MissionItem, seq: int, *, mission_type: MissionType, target_system: int, target_component: int
) -> MissionItemInt:
    """The message that carries an item to a vehicle; errors as ``message_from_item``.

    Rally points have the frames 0 and 3 (and 10), which name the same heights: PX4 1.17 stores frames 5 and 6 of rally points
    and then returns to no place at all ("RTL: unsupported MAV_FRAME": navigator/rtl.cpp, setSafepointAsDestination).
    """
    message = message_from_item(
        item, seq, mission_type=mission_type, target_system=target_system, target_component=target_component
    )
    return replace(message, frame=int(item.frame)) if mission_type is MissionType.RALLY else message


def item_from_message(message: MissionItemInt | MissionItemFloat) -> MissionItem:
    """The item that a message carries.

    Raises:
        FormatError: a frame in which the coordinates mean nothing to mission_io.
    """
    try:
        frame = Frame.from_mav_frame(message.frame)
    except FormatError as error:
        raise FormatError(error.what, where=f"item {message.seq}", advice=error.advice) from None
    scaled = isinstance(message, MissionItemInt) and frame is not Frame.COMMAND
    scale = DEGREES_SCALE if scaled else 1.0
    return MissionItem(
        message.command,
        frame,
        message.params,
        message.x / scale,
        message.y / scale,
        message.z,
        bool(message.autocontinue),
    )


def float_message(message: MissionItemInt) -> MissionItemFloat:
    """The same item in the deprecated form, with 32-bit degrees."""
    scale = 1.0 if message.frame == Frame.COMMAND else DEGREES_SCALE
    return MissionItemFloat(
        message.target_system, message.target_component, message.seq, message.frame, message.command, message.params,
        message.x / scale, message.y / scale, message.z, message.current, message.autocontinue, message.mission_type,
    )  # fmt: skip


def degrees_on_wire(value_deg: float) -> float:
    """The coordinate that arrives when ``value_deg`` is sent."""
    return round(value_deg * DEGREES_SCALE) / DEGREES_SCALE


def float32(value: float) -> float:
    """The number that arrives when ``value`` is sent as a 32-bit float.

    Raises:
        MisuseError: it is beyond the range of 32-bit floats.
    """
    try:
        result: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        raise MisuseError(f"{value} is beyond the range of MAVLink's 32-bit numbers") from None
    return result


def _int32(value: float, name: str, seq: int) -> int:
    if not -_INT32_LIMIT <= value < _INT32_LIMIT:  # also false for NaN
        raise MisuseError(f"item {seq}: the {name} does not fit in a MISSION_ITEM_INT")
    return round(value)


class WireFrame(NamedTuple):
    """One frame whose checksum is right."""

    version: int  # MAVLink 1 or 2
    seq: int  # the sender's count of its frames, from 0 to 255 and over again
    system_id: int  # who sent it
    component_id: int  # which part of the sender
    message_id: int  # the kind of message
    payload: bytes  # its payload; in MAVLink 2 without the zeros at its end
    data: bytes  # all of the frame's bytes, the signature included
    signature: bytes  # link id, timestamp and signature (13 bytes), or nothing
