"""Missions, fences and rally points as data: items, home, distances, and the enumerations behind MAVLink's numbers.

Latitudes and longitudes are degrees on WGS 84. A height is metres above the reference of its frame: mean sea level,
the vehicle's home, or the terrain below. Angles are degrees, speeds metres per second, times seconds.
"""

import math
from collections.abc import Iterable, Iterator
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


WITHOUT_POSITION = frozenset(
    {
        Command.NAV_RETURN_TO_LAUNCH,
        Command.NAV_DELAY,
        Command.CONDITION_DELAY,
        Command.CONDITION_DISTANCE,
        Command.CONDITION_YAW,
        Command.DO_JUMP,
        Command.DO_CHANGE_SPEED,
        Command.DO_LAND_START,
        Command.DO_SET_ROI_NONE,
        Command.DO_DIGICAM_CONTROL,
        Command.DO_MOUNT_CONTROL,
        Command.DO_SET_CAM_TRIGG_DIST,
        Command.DO_GIMBAL_MANAGER_PITCHYAW,
        Command.IMAGE_START_CAPTURE,
        Command.IMAGE_STOP_CAPTURE,
        Command.VIDEO_START_CAPTURE,
        Command.VIDEO_STOP_CAPTURE,
    }
)
"""The commands mission_io knows to have no position, in any frame."""

FENCE_COMMANDS = frozenset(range(Command.NAV_FENCE_RETURN_POINT, Command.NAV_FENCE_CIRCLE_EXCLUSION + 1))
NOT_STEPS = FENCE_COMMANDS | {int(Command.NAV_RALLY_POINT)}
"""The commands of fences and rally points: they are never flown one after the other."""


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


# Fences and rally points, and the item lists in which vehicles and files keep them.


@dataclass(frozen=True, slots=True)
class LatLon:
    """A position without height: degrees, WGS 84."""

    lat_deg: float
    lon_deg: float


@dataclass(frozen=True, slots=True)
class FramedPoint:
    """A position with a height in metres above the reference of ``frame``."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: Frame = Frame.ABOVE_HOME


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon to stay inside (``inclusion``) or outside. Its ring is open: no vertex is repeated."""

    vertices: tuple[LatLon, ...]
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle to stay inside (``inclusion``) or outside."""

    center: LatLon
    radius_m: float
    inclusion: bool = True


@dataclass(frozen=True, slots=True)
class Fence:
    """A geofence; ``return_point``, if set, is the destination after a breach."""

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()
    return_point: FramedPoint | None = None


@dataclass(frozen=True, slots=True)
class RallyPoints:
    """Alternative return positions nearer than home."""

    points: tuple[FramedPoint, ...] = ()


_VERTEX = {True: Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, False: Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION}
_CIRCLE = {True: Command.NAV_FENCE_CIRCLE_INCLUSION, False: Command.NAV_FENCE_CIRCLE_EXCLUSION}
_VERTEX_COMMANDS = {int(command): inclusion for inclusion, command in _VERTEX.items()}
_CIRCLE_COMMANDS = {int(command): inclusion for inclusion, command in _CIRCLE.items()}


def items_from_fence(fence: Fence) -> tuple[MissionItem, ...]:
    """The items of a fence: polygons, then circles, then the return point. Every vertex carries its polygon's size.

    Raises:
        FormatError: a polygon of fewer than three vertices, or a circle without a positive radius.
    """
    items: list[MissionItem] = []
    for number, polygon in enumerate(fence.polygons):
        size = len(polygon.vertices)
        if size < 3:
            raise FormatError(f"the polygon has {size} vertices, but needs at least 3", where=f"fence polygon {number}")
        items.extend(
            MissionItem(_VERTEX[polygon.inclusion], Frame.AMSL, (float(size), 0.0, 0.0, 0.0), v.lat_deg, v.lon_deg)
            for v in polygon.vertices
        )
    for number, circle in enumerate(fence.circles):
        if not circle.radius_m > 0:
            raise FormatError(f"the radius must be above 0, not {circle.radius_m} m", where=f"fence circle {number}")
        params = (circle.radius_m, 0.0, 0.0, 0.0)
        center = circle.center
        items.append(MissionItem(_CIRCLE[circle.inclusion], Frame.AMSL, params, center.lat_deg, center.lon_deg))
    if fence.return_point is not None:
        items.append(_item_from_point(Command.NAV_FENCE_RETURN_POINT, fence.return_point))
    return tuple(items)


def fence_from_items(items: Iterable[MissionItem]) -> Fence:
    """The fence that an item list describes.

    Raises:
        FormatError: with the number of the item (from 0) that does not belong in a fence, a polygon with another
            number of vertices than it announces, a radius that is not positive, or a second return point.
    """
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    return_point: FramedPoint | None = None
    ring: list[LatLon] = []
    ring_command, ring_size = 0, 0
    for number, item in enumerate(items):
        where = f"fence item {number}"
        if ring and (item.command, item.params[0]) != (ring_command, ring_size):
            raise FormatError(f"the preceding polygon has only {len(ring)} of its {ring_size:g} vertices", where=where)
        if item.command in _VERTEX_COMMANDS:
            ring_command, ring_size = item.command, _ring_size(item, where)
            ring.append(LatLon(item.lat_deg, item.lon_deg))
            if len(ring) == ring_size:
                polygons.append(FencePolygon(tuple(ring), _VERTEX_COMMANDS[item.command]))
                ring = []
        elif item.command in _CIRCLE_COMMANDS:
            if not item.params[0] > 0:
                raise FormatError(f"the radius must be above 0, not {item.params[0]} m", where=where)
            center = LatLon(item.lat_deg, item.lon_deg)
            circles.append(FenceCircle(center, item.params[0], _CIRCLE_COMMANDS[item.command]))
        elif item.command == Command.NAV_FENCE_RETURN_POINT:
            if return_point is not None:
                raise FormatError("this is a second return point", where=where, advice="keep only one of them")
            return_point = _point_from_item(item)
        else:
            raise FormatError(f"command {item.command} is not a fence item", where=where, advice="use 5000 to 5004")
    if ring:
        raise FormatError(f"the last polygon has only {len(ring)} of its {ring_size} vertices", where="fence")
    return Fence(tuple(polygons), tuple(circles), return_point)


def items_from_rally(rally: RallyPoints) -> tuple[MissionItem, ...]:
    """One item for each rally point, in order."""
    return tuple(_item_from_point(Command.NAV_RALLY_POINT, point) for point in rally.points)


def rally_from_items(items: Iterable[MissionItem]) -> RallyPoints:
    """The rally points that an item list describes.

    Raises:
        FormatError: with the number of the item (from 0) that is not a rally point.
    """
    points: list[FramedPoint] = []
    for number, item in enumerate(items):
        if item.command != Command.NAV_RALLY_POINT:
            raise FormatError(f"command {item.command} is not a rally point", where=f"rally item {number}")
        points.append(_point_from_item(item))
    return RallyPoints(tuple(points))


def _ring_size(item: MissionItem, where: str) -> int:
    size = item.params[0]
    if not (3 <= size <= 65535 and size == int(size)):
        raise FormatError(f"the polygon has {size:g} vertices", where=where, advice="a polygon needs at least 3")
    return int(size)


def _item_from_point(command: Command, point: FramedPoint) -> MissionItem:
    return MissionItem(command, point.frame, (0.0, 0.0, 0.0, 0.0), point.lat_deg, point.lon_deg, point.alt_m)


def _point_from_item(item: MissionItem) -> FramedPoint:
    return FramedPoint(item.lat_deg, item.lon_deg, item.alt_m, item.frame)


EQUATOR_RADIUS_M = 6378137.0
ECCENTRICITY_SQUARED = (2.0 - 1.0 / 298.257223563) / 298.257223563
"""WGS 84 (NIMA TR8350.2): semi-major axis and first eccentricity squared, from the flattening."""
MEAN_RADIUS_M = 6_371_000.0
M_PER_DEG, EQUATOR_M_PER_DEG = 111_195.0, 111_319.0
"""Length of a degree on a sphere of that radius, and along the equator."""


def earth_centred_m(lat_deg: float, lon_deg: float, height_m: float = 0.0) -> tuple[float, float, float]:
    """A position as x, y, z from the centre of the Earth; ``height_m`` is above the ellipsoid."""
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    normal_m = EQUATOR_RADIUS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(lat) ** 2)
    across_m = (normal_m + height_m) * math.cos(lat)
    up_m = (normal_m * (1.0 - ECCENTRICITY_SQUARED) + height_m) * math.sin(lat)
    return across_m * math.cos(lon), across_m * math.sin(lon), up_m


def ground_distance_m(lat_a_deg: float, lon_a_deg: float, lat_b_deg: float, lon_b_deg: float) -> float:
    """The distance over ground between two positions, at sea level.

    Computed as the chord through the Earth, bent with the mean curvature: below 500 km it agrees with the geodesic to
    1 part in 10,000, and below 20 km to a millimetre and 1 part in a million (tested against pyproj).
    """
    a, b = earth_centred_m(lat_a_deg, lon_a_deg), earth_centred_m(lat_b_deg, lon_b_deg)
    chord_m = math.dist(a, b)
    radius_m = 0.5 * (math.hypot(*a) + math.hypot(*b))
    return 2.0 * radius_m * math.asin(min(1.0, chord_m / (2.0 * radius_m)))
