"""Missions as points with actions of the camera, as drone apps and map programs have them: both ways."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.formats.text import check_position, is_position
from mission_io.model.actions import (
    Action,
    ChangeSpeed,
    Land,
    MountMode,
    PointGimbal,
    PointMount,
    StartPictures,
    StopPictures,
    Takeoff,
    TakePicture,
    TriggerEvery,
    Turn,
    Waypoint,
    action_of,
    item_of,
)
from mission_io.model.items import (
    Frame,
    FramedPoint,
    GeoPoint,
    Mission,
    MissionItem,
    SpeedType,
    change_speed,
    delay,
    ground_distance_m,
    takeoff,
    waypoint,
)

# Routes of points made into missions: take-off, waypoints, and the end.


@dataclass(frozen=True, slots=True)
class StopCamera:
    """Actions at a point, and settings from there on."""

    pitch_deg: float | None = None  # of the camera from there on, -90 is straight down; None: as before
    heading_deg: float | None = None  # of the aircraft's nose on the leg after it; None: along the leg
    photos: int = 0  # how many are taken there
    distance_m: float | None = None  # between photos from there on; None: none by distance
    interval_s: float | None = None  # the same by time
    hover_s: float = 0.0  # how long it stays


NOTHING = StopCamera()


def items_at_stop(before: StopCamera, here: StopCamera, course_deg: float | None) -> list[MissionItem]:
    """The items after a point's waypoint.

    Args:
        before: state at the previous point.
        here: state at this point.
        course_deg: of the leg after it; None at the last point.
    """
    found = []
    if here.hover_s > 0.0:
        found.append(delay(here.hover_s))
    if here.pitch_deg is not None and here.pitch_deg != before.pitch_deg:
        found.append(item_of(PointGimbal(pitch_deg=here.pitch_deg)))
    if here.heading_deg is not None and course_deg is not None:
        off_deg = math.remainder(here.heading_deg - course_deg, 360.0)
        if abs(off_deg) > 1.0:
            found.append(item_of(Turn(heading_deg=here.heading_deg % 360.0)))
    found += [item_of(StartPictures(count=1))] * min(here.photos, 1000)
    if here.distance_m != before.distance_m:
        found.append(item_of(TriggerEvery(distance_m=here.distance_m or 0.0)))
    if here.interval_s != before.interval_s:
        found.append(item_of(StopPictures() if here.interval_s is None else StartPictures(interval_s=here.interval_s)))
    return found


def course_deg(lat_deg: Sequence[float], lon_deg: Sequence[float]) -> float | None:
    """Direction from a first position to a second one, clockwise from north; None where they are the same.

    >>> round(course_deg((46.0, 46.0), (8.0, 8.001)) or 0.0, 3)
    90.0
    """
    if (lat_deg[0], lon_deg[0]) == (lat_deg[1], lon_deg[1]):
        return None
    a, b = map(math.radians, lat_deg)
    east = math.radians(math.remainder(lon_deg[1] - lon_deg[0], 360.0))
    x = math.sin(east) * math.cos(b)
    y = math.cos(a) * math.sin(b) - math.sin(a) * math.cos(b) * math.cos(east)
    return math.degrees(math.atan2(x, y)) % 360.0


_LOWEST_M, _HIGHEST_M = -500.0, 20_000.0


@dataclass(frozen=True, slots=True)
class RouteStop:
    """A point of a route: degrees, metres above ``frame``'s reference, and the speed of the leg after it.

    ``camera`` has the actions there.
    """

    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: Frame
    speed_m_s: float | None = None
    camera: StopCamera = NOTHING


@dataclass(frozen=True, slots=True)
class PointRoute:
    """A route as a mission."""

    # item 1 is a take-off to the height of the first point, the points follow. It has no home: the files have none.
    mission: Mission
    numbers: tuple[int, ...]  # the number of the item of each point
    repairs: tuple[str, ...] = ()  # what was read otherwise than it stands there, one line each
    # above home, at which the aircraft returns by itself; None where the file does not say
    return_height_m: float | None = None
    speed_m_s: float | None = None  # of all of it; None where the file states none, or several, which are then items


def route_from_stops(
    stops: Sequence[RouteStop], *, end: Sequence[MissionItem] = (), repairs: Sequence[str] = (),
    return_height_m: float | None = None, takeoff_height_m: float | None = None,
) -> PointRoute:  # fmt: skip
    """Make a mission of points.

    Args:
        stops: The points, in order.
        end: Items after the last one, such as a return.
        repairs: For the result.
        return_height_m: For the result.
        takeoff_height_m: Above home, to which it climbs first; None: to the height of the first point.

    Raises:
        FormatError: no point, or one that is no place, or a height that is none.
    """
    if not stops:
        raise FormatError("the route has no points", where="route", advice="use a route with at least one point")
    for number, stop in enumerate(stops, start=1):
        check_position(stop.lat_deg, stop.lon_deg, f"point {number}")
        if not _LOWEST_M <= stop.alt_m <= _HIGHEST_M:
            raise FormatError(
                f"the height is {stop.alt_m:g} m", where=f"point {number}", advice="use a finite height in metres"
            )
    first = stops[0]
    top_m, frame = first.alt_m, first.frame
    if takeoff_height_m is not None and frame is Frame.ABOVE_HOME:
        top_m = max(top_m, takeoff_height_m)
    items = [takeoff(first.lat_deg, first.lon_deg, top_m, frame=frame)]
    numbers = []
    speeds = {stop.speed_m_s for stop in stops if stop.speed_m_s is not None and stop.speed_m_s > 0.0}
    speed_m_s = next(iter(speeds)) if len(speeds) == 1 else None
    before = NOTHING
    for number, stop in enumerate(stops):
        items.append(waypoint(stop.lat_deg, stop.lon_deg, stop.alt_m, frame=stop.frame))
        numbers.append(len(items))
        after = stops[number + 1] if number + 1 < len(stops) else None
        course = None if after is None else course_deg((stop.lat_deg, after.lat_deg), (stop.lon_deg, after.lon_deg))
        items += items_at_stop(before, stop.camera, course)
        pitch_deg = before.pitch_deg if stop.camera.pitch_deg is None else stop.camera.pitch_deg
        before = dataclasses.replace(stop.camera, pitch_deg=pitch_deg)
        if len(speeds) > 1 and stop.speed_m_s in speeds and stop.speed_m_s != speed_m_s:
            speed_m_s = float(stop.speed_m_s or 0.0)
            items.append(change_speed(speed_m_s))
    return PointRoute(
        Mission(None, (*items, *end)),
        tuple(numbers),
        tuple(repairs),
        return_height_m,
        speed_m_s if len(speeds) == 1 else None,
    )


# A mission as points with camera actions, for controllers that fly points without commands.
#
# Nothing is omitted in silence: an item that a list of points cannot express is an error that names it.

_YAW_LOCK = 16
"""GIMBAL_MANAGER_FLAGS: yaw is a heading, not an angle relative to the vehicle's nose."""
_STRAIGHT_UP_M = 1.0
"""Take-off and landing this near to the point above them are vertical."""
_SAME_POSITION_DEG, _SAME_HEIGHT_M = 1e-9, 1e-4


@dataclass(frozen=True, slots=True)
class CameraPoint:
    """A point of a flight, and what holds from there on."""

    lat_deg: float  # latitude, WGS 84
    lon_deg: float  # longitude, WGS 84
    height_above_home_m: float  # height above the place of take-off
    speed_m_s: float  # over ground, from there on
    heading_deg: float | None = None  # heading held from there on, clockwise from north; None: along the legs
    pitch_deg: float | None = None  # pitch of the camera from there on, -90 is straight down; None: not stated
    photos: int = 0  # how many photos are taken there
    photo_distance_m: float | None = None  # trigger distance over ground in metres from there on; None: no trigger


@dataclass(frozen=True, slots=True)
class CameraFlight:
    """A flight from the ground at home to the ground at home."""

    home: GeoPoint  # where it takes off and lands
    # in flying order: the first is the top of the climb, straight above home, the last is straight above the landing
    points: tuple[CameraPoint, ...]


def camera_flight(mission: Mission, *, pitch_deg: float | None = None) -> CameraFlight:
    """A mission that takes off first and lands last, as points.

    Args:
        mission: What to fly.
        pitch_deg: Pitch of the camera where the mission has no item that sets it, such as that of a fixed camera.

    Raises:
        FormatError: an item that points cannot express, no home, or no take-off and landing straight below its ends.
    """
    home = mission.home
    if home is None:
        raise FormatError("the mission has no home", where="home", advice="specify the start position")
    if not is_position(home.lat_deg, home.lon_deg) or not math.isfinite(home.alt_amsl_m):
        raise FormatError("home is not a valid position", where="home", advice="specify the start position")
    reader = _Reader(home, pitch_deg)
    for number, item in enumerate(mission.items, start=1):
        where = f"item {number}"
        action = action_of(item)
        if action is None or not item.autocontinue:
            what = f"command {int(item.command)} cannot be written as a list of points"
            raise FormatError(what if item.autocontinue else "this item waits for the pilot to continue", where=where)
        if reader.landed:
            raise FormatError("an item follows the landing", where=where, advice="remove it")
        reader.read(action, where)
    return reader.flight()


class _Reader:
    """Reads a mission item by item: the points so far, and the state after the last one."""

    def __init__(self, home: GeoPoint, pitch_deg: float | None) -> None:
        self.landed = False
        self._home = home
        self._points: list[CameraPoint] = []
        self._speed_m_s = math.nan
        self._pitch_deg = pitch_deg
        self._camera_heading_deg: float | None = None
        self._own_heading_deg: float | None = None  # of the last waypoint alone
        self._distance_m: float | None = None

    def read(self, action: Action, where: str) -> None:
        match action:
            case Takeoff():
                self._takeoff(action, where)
            case Waypoint():
                self._waypoint(action, where)
            case Land():
                self._land(action, where)
            case ChangeSpeed():
                if action.kind is not SpeedType.GROUND or not 0.0 < action.speed_m_s < math.inf:
                    raise FormatError("only changes of the ground speed can be converted", where=where)
                self._speed_m_s = action.speed_m_s
            case PointMount() | PointGimbal():
                self._point_camera(action, where)
            case TriggerEvery():
                self._trigger(action, where)
            case TakePicture() | StartPictures():
                self._photo(action, where)
            case _:
                what = f"{type(action).__name__} (command {int(action.COMMAND)}) cannot be written as a list of points"
                raise FormatError(what, where=where)
        self._hold_from_here()

    def flight(self) -> CameraFlight:
        if not self.landed:
            raise FormatError("the mission does not end with a landing", where="mission", advice="land at home")
        if len(self._points) < 2:
            raise FormatError("the mission has fewer than two points", where="mission")
        if any(math.isnan(point.speed_m_s) for point in self._points):
            raise FormatError("no speed is set before the first leg", where="mission", advice="set it before the leg")
        return CameraFlight(self._home, tuple(self._points))

    def _takeoff(self, action: Takeoff, where: str) -> None:
        if self._points:
            raise FormatError("this take-off comes in flight", where=where)
        self._require_near(action.position, self._home.lat_deg, self._home.lon_deg, where, "the take-off is", "home")
        self._add(action.position, where)

    def _waypoint(self, action: Waypoint, where: str) -> None:
        if not self._points:
            raise FormatError("the mission does not begin with a take-off", where=where, advice="take off at home")
        if action.hold_s or action.acceptance_radius_m or action.pass_radius_m:
            raise FormatError("a waypoint with a hold time or a radius cannot be converted", where=where)
        if action.heading_deg is not None and not math.isfinite(action.heading_deg):
            raise FormatError("the heading is not a valid number", where=where)
        self._own_heading_deg = None if action.heading_deg is None else action.heading_deg % 360.0
        self._add(action.position, where)

    def _land(self, action: Land, where: str) -> None:
        if not self._points:
            raise FormatError("the mission does not begin with a take-off", where=where, advice="take off at home")
        last = self._points[-1]
        self._require_near(action.position, last.lat_deg, last.lon_deg, where, "the landing is", "the point before it")
        self._require_near(action.position, self._home.lat_deg, self._home.lon_deg, where, "the landing is", "home")
        self.landed = True

    def _require_near(
        self, position: FramedPoint, lat_deg: float, lon_deg: float, where: str, what: str, of: str
    ) -> None:
        check_position(position.lat_deg, position.lon_deg, where)
        if not ground_distance_m(position.lat_deg, position.lon_deg, lat_deg, lon_deg) <= _STRAIGHT_UP_M:
            raise FormatError(f"{what} more than {_STRAIGHT_UP_M:g} m from {of}", where=where)

    def _add(self, position: FramedPoint, where: str) -> None:
        check_position(position.lat_deg, position.lon_deg, where)
        if position.frame is Frame.ABOVE_TERRAIN:
            raise FormatError("its height is above the terrain, which this conversion does not know", where=where)
        height_m = position.alt_m - (self._home.alt_amsl_m if position.frame is Frame.AMSL else 0.0)
        if not math.isfinite(height_m):
            raise FormatError("its height is not a finite number", where=where)
        last = self._points[-1] if self._points else None
        if last is None or not (
            abs(last.lat_deg - position.lat_deg) <= _SAME_POSITION_DEG
            and abs(last.lon_deg - position.lon_deg) <= _SAME_POSITION_DEG
            and abs(last.height_above_home_m - height_m) <= _SAME_HEIGHT_M
        ):
            self._points.append(CameraPoint(position.lat_deg, position.lon_deg, height_m, self._speed_m_s))

    def _point_camera(self, action: PointMount | PointGimbal, where: str) -> None:
        if isinstance(action, PointMount):
            if action.mode is not MountMode.ANGLES or action.roll_deg or action.yaw_deg:
                raise FormatError("the camera is yawed or rolled", where=where)
            self._pitch_deg = action.pitch_deg
        else:
            if action.pitch_rate_deg_s or action.yaw_rate_deg_s or action.gimbal:
                raise FormatError("a gimbal that moves at a rate, or a second gimbal, cannot be converted", where=where)
            if action.flags == _YAW_LOCK:
                self._camera_heading_deg = None if action.yaw_deg is None else action.yaw_deg % 360.0
            elif action.flags or action.yaw_deg:
                raise FormatError("the camera is yawed", where=where)
            self._pitch_deg = self._pitch_deg if action.pitch_deg is None else action.pitch_deg
        if self._pitch_deg is not None and not math.isfinite(self._pitch_deg):
            raise FormatError("the camera angle is not a valid number", where=where)

    def _trigger(self, action: TriggerEvery, where: str) -> None:
        if not 0.0 <= action.distance_m < math.inf or action.shutter_ms or (action.distance_m and not action.at_once):
            raise FormatError("the distance-based trigger does not start immediately", where=where)
        self._distance_m = action.distance_m or None

    def _photo(self, action: TakePicture | StartPictures, where: str) -> None:
        plain = (
            action == TakePicture()
            if isinstance(action, TakePicture)
            else action.count == 1 and not action.interval_s and not action.camera
        )
        if not plain:
            raise FormatError("only single photos can be converted", where=where)
        if not self._points:
            raise FormatError("this photo comes before take-off", where=where)
        last = self._points[-1]
        self._points[-1] = dataclasses.replace(last, photos=last.photos + 1)

    def _hold_from_here(self) -> None:
        own, camera = self._own_heading_deg, self._camera_heading_deg
        if self._points and not self.landed:
            self._points[-1] = dataclasses.replace(
                self._points[-1],
                speed_m_s=self._speed_m_s,
                heading_deg=camera if own is None else own,
                pitch_deg=self._pitch_deg,
                photo_distance_m=self._distance_m,
            )
