"""Commands with named and typed parameters, converted from and to mission items.

``item_of(PointGimbal(pitch_deg=-90.0))`` makes an item, ``action_of(item)`` reads one. An item with any other command stays
a plain ``MissionItem`` and loses nothing: actions are a view of items, not another model.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, TypeVar

from mission_io.model.items import Command, Frame, FramedPoint, MissionItem, SpeedType

EnumT = TypeVar("EnumT", bound=Enum)


class TurnDirection(Enum):
    """Direction of a turn."""

    COUNTERCLOCKWISE = -1
    SHORTEST = 0
    CLOCKWISE = 1


class MountMode(Enum):
    """Mode of a camera mount in DO_MOUNT_CONTROL (MAV_MOUNT_MODE)."""

    RETRACT = 0
    NEUTRAL = 1
    ANGLES = 2
    PILOT = 3
    POSITION = 4


@dataclass(frozen=True, slots=True)
class _Parameter:
    """The parameter (1 to 7) that carries an attribute, with the conversions to and from a number."""

    number: int
    encode: Callable[[Any], float]
    decode: Callable[[float], Any]


def _number(number: int) -> dict[str, _Parameter]:
    return {"parameter": _Parameter(number, float, lambda value: value)}


def _whole(number: int) -> dict[str, _Parameter]:
    def decode(value: float) -> int:
        if not value.is_integer():
            raise ValueError(value)
        return int(value)

    return {"parameter": _Parameter(number, float, decode)}


def _or_none(number: int) -> dict[str, _Parameter]:
    """None leaves the value to the vehicle; it is NaN on the wire."""
    return {
        "parameter": _Parameter(
            number,
            lambda value: math.nan if value is None else float(value),
            lambda value: None if math.isnan(value) else value,
        )
    }


def _flag(number: int) -> dict[str, _Parameter]:
    return {"parameter": _Parameter(number, float, {0.0: False, 1.0: True}.__getitem__)}


def _kind(number: int, kind: type[EnumT]) -> dict[str, _Parameter]:
    return {"parameter": _Parameter(number, lambda value: float(value.value), lambda value: kind(int(value)))}


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Fly to a position. A radius of 0 and a heading of None are left to the vehicle."""

    COMMAND: ClassVar = Command.NAV_WAYPOINT
    position: FramedPoint
    hold_s: float = field(default=0.0, metadata=_number(1))
    acceptance_radius_m: float = field(default=0.0, metadata=_number(2))
    pass_radius_m: float = field(default=0.0, metadata=_number(3))
    heading_deg: float | None = field(default=None, metadata=_or_none(4))


@dataclass(frozen=True, slots=True)
class SplineWaypoint:
    """Fly to a position along a smooth curve."""

    COMMAND: ClassVar = Command.NAV_SPLINE_WAYPOINT
    position: FramedPoint
    hold_s: float = field(default=0.0, metadata=_number(1))


@dataclass(frozen=True, slots=True)
class Takeoff:
    """Climb to a height; ``pitch_deg`` is a fixed wing's least pitch."""

    COMMAND: ClassVar = Command.NAV_TAKEOFF
    position: FramedPoint
    pitch_deg: float = field(default=0.0, metadata=_number(1))
    heading_deg: float | None = field(default=None, metadata=_or_none(4))


@dataclass(frozen=True, slots=True)
class Land:
    """Land at a position; ``abort_alt_m`` is the height to climb to when a fixed wing's landing is aborted."""

    COMMAND: ClassVar = Command.NAV_LAND
    position: FramedPoint
    abort_alt_m: float = field(default=0.0, metadata=_number(1))
    heading_deg: float | None = field(default=None, metadata=_or_none(4))


@dataclass(frozen=True, slots=True)
class LoiterUnlimited:
    """Circle a position until commanded otherwise; a negative radius is counterclockwise."""

    COMMAND: ClassVar = Command.NAV_LOITER_UNLIM
    position: FramedPoint
    radius_m: float = field(default=0.0, metadata=_number(3))


@dataclass(frozen=True, slots=True)
class LoiterTurns:
    """Circle a position a number of times; a negative radius is counterclockwise."""

    COMMAND: ClassVar = Command.NAV_LOITER_TURNS
    position: FramedPoint
    turns: float = field(default=1.0, metadata=_number(1))
    radius_m: float = field(default=0.0, metadata=_number(3))


@dataclass(frozen=True, slots=True)
class LoiterTime:
    """Circle or hover at a position for a time; a negative radius is counterclockwise."""

    COMMAND: ClassVar = Command.NAV_LOITER_TIME
    position: FramedPoint
    time_s: float = field(default=0.0, metadata=_number(1))
    radius_m: float = field(default=0.0, metadata=_number(3))


@dataclass(frozen=True, slots=True)
class ReturnToLaunch:
    """Return home in a straight line at the height set in the autopilot, and land."""

    COMMAND: ClassVar = Command.NAV_RETURN_TO_LAUNCH


@dataclass(frozen=True, slots=True)
class Delay:
    """Wait for a time, or until a time of day (UTC); -1 disables either."""

    COMMAND: ClassVar = Command.NAV_DELAY
    time_s: float = field(default=-1.0, metadata=_number(1))
    until_hour: float = field(default=-1.0, metadata=_number(2))
    until_minute: float = field(default=-1.0, metadata=_number(3))
    until_second: float = field(default=-1.0, metadata=_number(4))


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn the vehicle to a heading, or by an angle when it is ``relative``. A rate of 0 leaves it to the vehicle."""

    COMMAND: ClassVar = Command.CONDITION_YAW
    heading_deg: float = field(metadata=_number(1))
    rate_deg_s: float = field(default=0.0, metadata=_number(2))
    direction: TurnDirection = field(default=TurnDirection.SHORTEST, metadata=_kind(3, TurnDirection))
    relative: bool = field(default=False, metadata=_flag(4))


@dataclass(frozen=True, slots=True)
class Jump:
    """Continue with another item (the first of the mission is 1); ``times`` -1 repeats forever."""

    COMMAND: ClassVar = Command.DO_JUMP
    item: int = field(metadata=_whole(1))
    times: int = field(default=1, metadata=_whole(2))


@dataclass(frozen=True, slots=True)
class ChangeSpeed:
    """Change the speed; a throttle of -1 leaves it unchanged."""

    COMMAND: ClassVar = Command.DO_CHANGE_SPEED
    kind: SpeedType = field(metadata=_kind(1, SpeedType))
    speed_m_s: float = field(metadata=_number(2))
    throttle_percent: float = field(default=-1.0, metadata=_number(3))


@dataclass(frozen=True, slots=True)
class LookAt:
    """Point the camera at a position from now on; gimbal 0 is all of them."""

    COMMAND: ClassVar = Command.DO_SET_ROI_LOCATION
    position: FramedPoint
    gimbal: int = field(default=0, metadata=_whole(1))


@dataclass(frozen=True, slots=True)
class LookAhead:
    """End ``LookAt`` and return camera control to the vehicle."""

    COMMAND: ClassVar = Command.DO_SET_ROI_NONE
    gimbal: int = field(default=0, metadata=_whole(1))


@dataclass(frozen=True, slots=True)
class PointMount:
    """Point an older camera mount: pitch 0 is level, -90 straight down."""

    COMMAND: ClassVar = Command.DO_MOUNT_CONTROL
    pitch_deg: float = field(metadata=_number(1))
    roll_deg: float = field(default=0.0, metadata=_number(2))
    yaw_deg: float = field(default=0.0, metadata=_number(3))
    mode: MountMode = field(default=MountMode.ANGLES, metadata=_kind(7, MountMode))


@dataclass(frozen=True, slots=True)
class PointGimbal:
    """Point a gimbal: pitch 0 is level, -90 straight down. None leaves an axis unchanged; gimbal 0 is the first.

    ``flags`` are GIMBAL_MANAGER_FLAGS; 0 keeps the yaw relative to the vehicle.
    """

    COMMAND: ClassVar = Command.DO_GIMBAL_MANAGER_PITCHYAW
    pitch_deg: float | None = field(default=None, metadata=_or_none(1))
    yaw_deg: float | None = field(default=None, metadata=_or_none(2))
    pitch_rate_deg_s: float | None = field(default=None, metadata=_or_none(3))
    yaw_rate_deg_s: float | None = field(default=None, metadata=_or_none(4))
    flags: int = field(default=0, metadata=_whole(5))
    gimbal: int = field(default=0, metadata=_whole(7))


@dataclass(frozen=True, slots=True)
class TriggerEvery:
    """Take a photo at a distance interval over ground, 0 to stop; ``at_once`` takes the first one now."""

    COMMAND: ClassVar = Command.DO_SET_CAM_TRIGG_DIST
    distance_m: float = field(metadata=_number(1))
    shutter_ms: float = field(default=0.0, metadata=_number(2))
    at_once: bool = field(default=False, metadata=_flag(3))


@dataclass(frozen=True, slots=True)
class TakePicture:
    """Take one photo, or with ``photos`` 0 only set zoom and focus, with an older camera interface."""

    COMMAND: ClassVar = Command.DO_DIGICAM_CONTROL
    session: float = field(default=0.0, metadata=_number(1))
    zoom: float = field(default=0.0, metadata=_number(2))
    zoom_step: float = field(default=0.0, metadata=_number(3))
    focus: float = field(default=0.0, metadata=_number(4))
    photos: int = field(default=1, metadata=_whole(5))


@dataclass(frozen=True, slots=True)
class StartPictures:
    """Take photos every ``interval_s``; ``count`` 0 continues until stopped. Camera 0 is all of them."""

    COMMAND: ClassVar = Command.IMAGE_START_CAPTURE
    camera: int = field(default=0, metadata=_whole(1))
    interval_s: float = field(default=0.0, metadata=_number(2))
    count: int = field(default=0, metadata=_whole(3))
    first_number: int = field(default=0, metadata=_whole(4))


@dataclass(frozen=True, slots=True)
class StopPictures:
    """End ``StartPictures``."""

    COMMAND: ClassVar = Command.IMAGE_STOP_CAPTURE
    camera: int = field(default=0, metadata=_whole(1))


@dataclass(frozen=True, slots=True)
class StartVideo:
    """Record video; ``status_hz`` is how often the camera reports. Stream 0 is all of them."""

    COMMAND: ClassVar = Command.VIDEO_START_CAPTURE
    stream: int = field(default=0, metadata=_whole(1))
    status_hz: float = field(default=0.0, metadata=_number(2))


@dataclass(frozen=True, slots=True)
class StopVideo:
    """End ``StartVideo``."""

    COMMAND: ClassVar = Command.VIDEO_STOP_CAPTURE
    stream: int = field(default=0, metadata=_whole(1))


Action = (
    Waypoint | SplineWaypoint | Takeoff | Land | LoiterUnlimited | LoiterTurns | LoiterTime | ReturnToLaunch | Delay
    | Turn | Jump | ChangeSpeed | LookAt | LookAhead | PointMount | PointGimbal | TriggerEvery | TakePicture
    | StartPictures | StopPictures | StartVideo | StopVideo
)  # fmt: skip

ACTIONS: tuple[type[Action], ...] = Action.__args__
_BY_COMMAND = {int(kind.COMMAND): kind for kind in ACTIONS}


def item_of(action: Action, *, autocontinue: bool = True) -> MissionItem:
    """The item of an action; unused parameters are 0."""
    values = [0.0] * 7
    frame = Frame.COMMAND
    for attribute in dataclasses.fields(action):
        value = getattr(action, attribute.name)
        if isinstance(value, FramedPoint):
            frame, values[4:] = value.frame, [value.lat_deg, value.lon_deg, value.alt_m]
        else:
            parameter: _Parameter = attribute.metadata["parameter"]
            values[parameter.number - 1] = parameter.encode(value)
    p1, p2, p3, p4, lat, lon, alt = values
    return MissionItem(action.COMMAND, frame, (p1, p2, p3, p4), lat, lon, alt, autocontinue)


def action_of(item: MissionItem) -> Action | None:
    """The action of an item; None when its command is not among ``ACTIONS`` or a parameter value is invalid.

    Unused parameters are ignored, so ``item_of`` writes 0 in their place.
    """
    kind = _BY_COMMAND.get(item.command)
    if kind is None:
        return None
    values = [value for _, value in item.values()]
    arguments: dict[str, Any] = {}
    for attribute in dataclasses.fields(kind):
        parameter: _Parameter | None = attribute.metadata.get("parameter")
        if parameter is None:
            if not item.has_position:
                return None
            arguments[attribute.name] = FramedPoint(item.lat_deg, item.lon_deg, item.alt_m, item.frame)
            continue
        try:
            arguments[attribute.name] = parameter.decode(values[parameter.number - 1])
        except (ValueError, KeyError, OverflowError):
            return None
    return kind(**arguments)
