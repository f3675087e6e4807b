"""Missions as data: items, home, and the enumerations behind MAVLink's numbers.

Latitudes and longitudes are degrees on WGS 84. A height is metres above the reference of its frame: mean sea level,
the vehicle's home, or the terrain below. Angles are degrees, speeds metres per second, times seconds.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, IntEnum

from mission_io.errors import FormatError


class MissionType(IntEnum):
    """The three lists that a vehicle keeps (MAV_MISSION_TYPE)."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


LAST_NAVIGATION = 95
"""MAV_CMD_NAV_LAST: commands up to here fly somewhere."""
ALL_MISSION_TYPES = 255
"""MAV_MISSION_TYPE_ALL: stands for all three lists in a MISSION_CLEAR_ALL."""


class Frame(IntEnum):
    """The reference of a height (MAV_FRAME, with the numbers used in files)."""

    AMSL = 0
    """Height above mean sea level."""
    COMMAND = 2
    """No position at all: the item only does something."""
    ABOVE_HOME = 3
    """Height above the vehicle's home."""
    ABOVE_TERRAIN = 10
    """Height above the terrain straight below, as the vehicle's own terrain data has it."""

    @property
    def wire(self) -> int:
        """The MAV_FRAME number that a MISSION_ITEM_INT carries for this frame."""
        return _WIRE_FRAMES[self]

    @classmethod
    def from_mav_frame(cls, number: int) -> "Frame":
        """The frame for a MAV_FRAME number, with integer or with floating-point coordinates.

        Raises:
            FormatError: a frame that mission_io does not support.
        """
        try:
            return _FRAMES[number]
        except KeyError:
            raise FormatError(
                f"unknown frame {number}", advice="use 0 (sea level), 3 (home), 10 (terrain) or 2 (no position)"
            ) from None


_WIRE_FRAMES = {Frame.AMSL: 5, Frame.COMMAND: 2, Frame.ABOVE_HOME: 6, Frame.ABOVE_TERRAIN: 11}
_FRAMES = {int(frame): frame for frame in Frame} | {number: frame for frame, number in _WIRE_FRAMES.items()}


class Command(IntEnum):
    """The commands (MAV_CMD) that mission_io knows by name; items carry any other number unchanged."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    NAV_SPLINE_WAYPOINT = 82
    NAV_VTOL_TAKEOFF = 84
    NAV_VTOL_LAND = 85
    NAV_DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    CONDITION_YAW = 115
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_LAND_START = 189
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI_NONE = 197
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONTROL = 205
    DO_SET_CAM_TRIGG_DIST = 206
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100
    # Commands that are sent as messages, never as items.
    DO_SET_MODE = 176
    DO_SET_HOME = 179
    DO_REPOSITION = 192
    DO_PAUSE_CONTINUE = 193
    DO_FENCE_ENABLE = 207
    DO_SET_MISSION_CURRENT = 224
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520


class SpeedType(Enum):
    """The speed that a DO_CHANGE_SPEED changes."""

    AIRSPEED = 0
    GROUND = 1
    CLIMB = 2
    DESCENT = 3


@dataclass(frozen=True, slots=True)
class GeoPoint:
    """A point on WGS 84 with its height above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item of a mission, fence or rally list."""

    command: int  # MAV_CMD number; any number is kept
    frame: Frame  # the reference of ``alt_m``
    # the first four parameters, whose meaning depends on the command. NaN means "the vehicle's default".
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    lat_deg: float = 0.0  # latitude in degrees, WGS 84 (the fifth parameter when the frame is COMMAND)
    lon_deg: float = 0.0  # longitude in degrees, WGS 84 (the sixth parameter when the frame is COMMAND)
    alt_m: float = 0.0  # height in metres above the frame's reference (the seventh parameter when the frame is COMMAND)
    autocontinue: bool = True  # whether the vehicle continues with the next item by itself

    @property
    def has_position(self) -> bool:
        """Whether latitude, longitude and height are a position."""
        return self.frame is not Frame.COMMAND

    def values(self) -> Iterator[tuple[str, float]]:
        """The seven numbers with their names in error messages."""
        yield from zip(("param1", "param2", "param3", "param4"), self.params, strict=True)
        yield from (("lat_deg", self.lat_deg), ("lon_deg", self.lon_deg), ("alt_m", self.alt_m))


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission: its items in flying order, without home.

    The first item is number 1 (home is 0); DO_JUMP refers to items by these numbers, for every autopilot.
    """

    home: GeoPoint | None  # the planned start; None when unknown
    # the items in flying order. Home is not one of them, also where a file or an autopilot puts it in row 0.
    items: tuple[MissionItem, ...]


def waypoint(
    lat_deg: float, lon_deg: float, alt_m: float, *, frame: Frame, hold_s: float = 0.0, acceptance_radius_m: float = 0.0
) -> MissionItem:
    """Fly to a point. The vehicle chooses the heading, and the acceptance radius if ``acceptance_radius_m`` is 0."""
    return MissionItem(Command.NAV_WAYPOINT, frame, (hold_s, acceptance_radius_m, 0.0, 0.0), lat_deg, lon_deg, alt_m)


def takeoff(lat_deg: float, lon_deg: float, alt_m: float, *, frame: Frame) -> MissionItem:
    """Climb to a height; a multicopter climbs vertically and ignores the position."""
    return MissionItem(Command.NAV_TAKEOFF, frame, (0.0, 0.0, 0.0, 0.0), lat_deg, lon_deg, alt_m)


def land(lat_deg: float, lon_deg: float, alt_m: float = 0.0, *, frame: Frame) -> MissionItem:
    """Fly to a position at the current height and land; ``alt_m`` is the height of the ground there."""
    return MissionItem(Command.NAV_LAND, frame, (0.0, 0.0, 0.0, 0.0), lat_deg, lon_deg, alt_m)


def return_to_launch() -> MissionItem:
    """Return home in a straight line at the height set in the autopilot, and land."""
    return MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.COMMAND)


def change_speed(speed_m_s: float, *, kind: SpeedType = SpeedType.GROUND) -> MissionItem:
    """Change the speed from here on; the throttle stays unchanged."""
    return MissionItem(Command.DO_CHANGE_SPEED, Frame.COMMAND, (float(kind.value), speed_m_s, -1.0, 0.0))


def delay(time_s: float) -> MissionItem:
    """Wait before the next navigation item."""
    return MissionItem(Command.NAV_DELAY, Frame.COMMAND, (time_s, -1.0, -1.0, -1.0))


def trigger_camera_every(distance_m: float) -> MissionItem:
    """Take a photo now and after each ``distance_m`` metres over ground; 0 stops it."""
    return MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.COMMAND, (distance_m, 0.0, 1.0 if distance_m else 0.0, 0.0))


def look_at(lat_deg: float, lon_deg: float, alt_m: float, *, frame: Frame) -> MissionItem:
    """Point the camera at a position from here on."""
    return MissionItem(Command.DO_SET_ROI_LOCATION, frame, (0.0, 0.0, 0.0, 0.0), lat_deg, lon_deg, alt_m)


def look_ahead() -> MissionItem:
    """End ``look_at`` and return camera control to the vehicle."""
    return MissionItem(Command.DO_SET_ROI_NONE, Frame.COMMAND)


def same_number(a: float, b: float) -> bool:
    """Equality in which "no value" (NaN) equals itself."""
    return a == b or (math.isnan(a) and math.isnan(b))


def same_item(a: MissionItem, b: MissionItem) -> bool:
    """Whether two items are equal in every field, NaN counting as equal to NaN."""
    if (a.command, a.frame, a.autocontinue) != (b.command, b.frame, b.autocontinue):
        return False
    return all(same_number(x, y) for (_, x), (_, y) in zip(a.values(), b.values(), strict=True))
