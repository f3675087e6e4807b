"""Trigger points of a mission's camera commands on its path, and the camera's direction, for each autopilot.

The commands are listed in docs/reference/checked_missions.md. The vehicle is level and keeps its speed; ArduCopter and PX4
turn along the leg unless an item says otherwise.
"""

import itertools
import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from mission_io.model.items import Command, Frame, Mission, MissionItem
from uavcover.extras.check.findings import FlownPath, Segment
from uavcover.extras.check.tuning import PATH
from uavcover.extras.check.world import Aircraft, World
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.coverage import photo_positions

_ROI_AT_A_POSITION, _ANGLES, _YAW_LOCK = 3.0, 2.0, 16


class _Also(IntEnum):
    """Commands that items carry as numbers only."""

    SET_ROI = 201
    TRIGGER_INTERVAL = 214
    TRIGGER_CONTROL = 2003


_CAMERA = frozenset(
    (
        Command.DO_SET_CAM_TRIGG_DIST, Command.IMAGE_START_CAPTURE, Command.IMAGE_STOP_CAPTURE, Command.DO_DIGICAM_CONTROL,
        Command.DO_MOUNT_CONTROL, Command.DO_GIMBAL_MANAGER_PITCHYAW, Command.CONDITION_YAW, Command.DO_SET_ROI_LOCATION,
        Command.DO_SET_ROI_NONE, *_Also,
    )
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPhotos:
    """The n photos of a mission, in the order they are taken."""

    positions_m: FloatArray  # (n, 3) ENU of the camera
    yaw_deg: FloatArray  # (n,) direction of the photo's top when it looks straight down, clockwise from north
    pitch_deg: FloatArray  # (n,) of the camera above the horizon: -90 looks straight down
    items: IntArray  # (n,) number of the item on the way to which it is taken
    least_gap_s: float  # shortest time between two photos of a series; infinite where there is no series
    least_gap_item: int  # where that is
    notes: tuple[str, ...]  # what was not understood or does not count, as text
    conditional: tuple[int, ...] = ()  # numbers of the camera's items that a condition delays or skips


@dataclass(frozen=True, slots=True)
class Series:
    """Photos that are taken all the time, where a mission leaves them to somebody else: by distance or by time."""

    distance_m: float | None = None
    interval_s: float | None = None


@dataclass(slots=True)
class _Stretch:
    """A part of the path on which a series of photos is taken."""

    distance_m: float | None
    interval_s: float | None
    at_once: bool
    most: int | None
    points: list[FloatArray] = field(default_factory=list)


@dataclass(slots=True)
class _Camera:
    """Pointing of the camera and yaw of the vehicle."""

    pitch_deg: float
    gimbal_yaw_deg: float = 0.0
    gimbal_yaw_is_heading: bool = False
    yaw_deg: float | None = None
    """Held on the next leg only."""
    roi_m: FloatArray | None = None


_NORTH = 0.0
_COLUMNS = 7
"""East, north, up, time, yaw, pitch, item."""


def planned_photos(
    mission: Mission, path: FlownPath, world: World, aircraft: Aircraft, *, pitch_deg: float = -90.0, always: Series | None = None
) -> PlannedPhotos:  # fmt: skip
    """The photos of a mission.

    Args:
        mission: its items.
        path: as flown.
        world: where it is.
        aircraft: whose autopilot gives the commands their meaning.
        pitch_deg: of the camera where no item says it.
        always: photos on the whole route beside those of the items; None: only the items' own.
    """
    shooting = _Shooting(mission, world, aircraft, pitch_deg)
    deeds = list(path.deeds)
    for k, segment in enumerate(path.segments):
        while deeds and deeds[0].after <= k:
            shooting.do(deeds.pop(0).item)
        if always is not None:
            on_route = [each.phase == "route" for each in path.segments[max(k - 1, 0) : k + 1]]
            if on_route[-1] and (k == 0 or not on_route[0]):
                shooting.begin(always.distance_m, always.interval_s, at_once=True, most=None)
            elif not on_route[-1] and on_route[0]:
                shooting.stop()
        shooting.fly(segment)
    for deed in deeds:
        shooting.do(deed.item)
    conditional = [deed.item for deed in path.deeds if deed.is_conditional]
    return shooting.end(tuple(n for n in conditional if mission.items[n - 1].command in _CAMERA))


class _Shooting:
    """Flies segment by segment; rows are ``_COLUMNS``."""

    def __init__(self, mission: Mission, world: World, aircraft: Aircraft, pitch_deg: float) -> None:
        self._items, self._world, self._aircraft = mission.items, world, aircraft
        self._camera = _Camera(pitch_deg)
        self._at = np.array([0.0, 0.0, 0.0, 0.0, math.nan, pitch_deg, 0.0])
        self._by_distance: _Stretch | None = None
        self._by_time: _Stretch | None = None
        self._taken: list[FloatArray] = []
        self._least_gap = (math.inf, 0)
        self._notes: dict[str, None] = {}

    def begin(self, distance_m: float | None, interval_s: float | None, *, at_once: bool, most: int | None) -> None:
        """Begin a series here."""
        stretch = _Stretch(distance_m, interval_s, at_once, most, [self._at[None]])
        if distance_m is not None:
            self._stop_distance()
            self._by_distance = stretch
        else:
            self._stop_time()
            self._by_time = stretch

    def stop(self) -> None:
        """End all series here."""
        self._stop_distance()
        self._stop_time()

    def do(self, number: int) -> None:
        """Carry out an item that flies nowhere."""
        item = self._items[number - 1]
        p1, p2, p3, _ = item.params
        match item.command:
            case Command.DO_SET_CAM_TRIGG_DIST:
                if p1 > 0.0:
                    self.begin(p1, None, at_once=p3 == 1.0, most=None)
                else:
                    self._stop_distance()
            case Command.IMAGE_START_CAPTURE:
                if p2 > 0.0 and p3 != 1.0:
                    self.begin(None, p2, at_once=True, most=int(p3) if p3 > 0.0 else None)
                else:
                    self._take_here(number, times=max(1, int(p3)) if math.isfinite(p3) else 1)
            case Command.IMAGE_STOP_CAPTURE:
                self._stop_time()
            case Command.DO_DIGICAM_CONTROL if item.lat_deg == 1.0:
                self._take_here(number, times=1)
            case _Also.TRIGGER_INTERVAL:
                if p1 > 0.0:
                    self.begin(None, p1 / 1000.0, at_once=True, most=None)
                elif p1 == 0.0:
                    self._stop_time()
            case _Also.TRIGGER_CONTROL:
                self._notes["a trigger that uses the camera's own interval (DO_TRIGGER_CONTROL) is not counted"] = None
            case Command.VIDEO_START_CAPTURE:
                self._notes["only photos are counted, not video"] = None
            case _:
                self._point(item)

    def fly(self, segment: Segment) -> None:
        """Fly on, and note the way for the series that are on."""
        points = segment.known_m
        if len(points) < 2:
            return
        steps = np.diff(points, axis=0)
        flat = np.hypot(steps[:, 0], steps[:, 1])
        course = np.where(flat > 1e-3, np.degrees(np.arctan2(steps[:, 0], steps[:, 1])), np.nan)
        course = _carried(course, self._at[4])
        rise = np.where(
            steps[:, 2] > 0.0, steps[:, 2] / self._aircraft.max_climb_m_s, -steps[:, 2] / self._aircraft.max_descent_m_s
        )
        seconds = np.maximum(flat / max(segment.speed_m_s, 0.1), rise)
        yaw = self._yaw_deg(segment)
        rows = np.empty((len(points), _COLUMNS))
        rows[:, :3] = points
        rows[:, 3] = self._at[3] + np.concatenate([[0.0], np.cumsum(seconds)])
        rows[1:, 4] = course if yaw is None else yaw
        rows[0, 4], rows[:, 5], rows[:, 6] = rows[1, 4], self._camera.pitch_deg, segment.items[1]
        rows = self._looking(rows)
        rest = rows[-1:].copy()
        rest[0, 3] += segment.wait_s
        for stretch in (self._by_distance, self._by_time):
            if stretch is not None:
                stretch.points += [rows, rest]
        self._at = rest[0].copy()
        self._at[4] = course[-1] if yaw is None else yaw
        self._camera.yaw_deg = None

    def end(self, conditional: tuple[int, ...]) -> PlannedPhotos:
        """All photos by time."""
        self.stop()
        rows = np.vstack([np.empty((0, _COLUMNS)), *self._taken])
        rows = rows[np.argsort(rows[:, 3], kind="stable")]
        yaw = _carried(rows[::-1, 4], _NORTH)[::-1]  # before the first leg the nose is where that leg will point it
        return PlannedPhotos(
            np.ascontiguousarray(rows[:, :3]), yaw, rows[:, 5].copy(), rows[:, 6].astype(np.int64), *self._least_gap,
            tuple(self._notes), conditional,
        )  # fmt: skip

    # The camera.

    def _point(self, item: MissionItem) -> None:
        camera, (p1, p2, p3, p4) = self._camera, item.params
        match item.command:
            case Command.DO_MOUNT_CONTROL if self._aircraft.autopilot == "ardupilot" or item.alt_m == _ANGLES:
                camera.pitch_deg, camera.gimbal_yaw_deg, camera.gimbal_yaw_is_heading = p1, p3, False
                camera.roi_m = None
            case Command.DO_GIMBAL_MANAGER_PITCHYAW:
                if math.isfinite(p1):
                    camera.pitch_deg = p1
                if math.isfinite(p2):
                    camera.gimbal_yaw_deg, camera.gimbal_yaw_is_heading = p2, bool(int(item.lat_deg) & _YAW_LOCK)
                camera.roi_m = None
            case Command.CONDITION_YAW if not self._aircraft.has_wings and self._aircraft.autopilot == "ardupilot":
                turn = p1 if p3 >= 0.0 else -p1
                before = self._at[4] if math.isfinite(self._at[4]) else _NORTH
                camera.yaw_deg = before + turn if p4 == 1.0 else p1
            case Command.DO_SET_ROI_LOCATION:
                camera.roi_m = self._position_of(item)
            case _Also.SET_ROI:
                camera.roi_m = self._position_of(item) if p1 == _ROI_AT_A_POSITION else None
            case Command.DO_SET_ROI_NONE:
                camera.roi_m = None

    def _position_of(self, item: MissionItem) -> FloatArray | None:
        if not math.isfinite(item.lat_deg + item.lon_deg) or (item.lat_deg, item.lon_deg) == (0.0, 0.0):
            return None
        en = [self._world.position(item.lat_deg, item.lon_deg)]
        alt = item.alt_m if math.isfinite(item.alt_m) else 0.0
        if item.frame is Frame.ABOVE_TERRAIN:
            return np.asarray(self._world.above_ground(en, alt)[0])
        base = 0.0 if item.frame is Frame.AMSL else self._world.home_alt_amsl_m
        return np.asarray(self._world.at_alts(en, alt + base)[0])

    def _yaw_deg(self, segment: Segment) -> float | None:
        """Yaw that an item holds on the leg to it; None: along the leg."""
        if self._aircraft.has_wings:
            return None
        if self._camera.yaw_deg is not None:
            return self._camera.yaw_deg
        number = segment.items[1]
        if self._aircraft.autopilot == "px4" and 1 <= number <= len(self._items):
            item = self._items[number - 1]
            if item.command == Command.NAV_WAYPOINT and math.isfinite(item.params[3]):
                return item.params[3]
        return None

    def _looking(self, rows: FloatArray) -> FloatArray:
        """Rows with the camera's own yaw and pitch instead of the nose's."""
        camera = self._camera
        if camera.roi_m is not None:
            away = camera.roi_m - rows[:, :3]
            flat = np.hypot(away[:, 0], away[:, 1])
            rows[:, 4] = np.where(flat > 1e-3, np.degrees(np.arctan2(away[:, 0], away[:, 1])), rows[:, 4])
            rows[:, 5] = np.degrees(np.arctan2(away[:, 2], flat))
        elif camera.gimbal_yaw_is_heading:
            rows[:, 4] = camera.gimbal_yaw_deg
        else:
            rows[:, 4] += camera.gimbal_yaw_deg
        return rows

    # Photos.

    def _take_here(self, number: int, *, times: int) -> None:
        row = self._at[None].copy()
        row[0, 5] = self._camera.pitch_deg
        if self._camera.yaw_deg is not None:
            row[0, 4] = self._camera.yaw_deg
        row = self._looking(row)
        row[0, 6] = number
        self._taken.append(np.repeat(row, min(times, PATH.most_photos), axis=0))

    def _stop_distance(self) -> None:
        stretch, self._by_distance = self._by_distance, None
        if stretch is None or stretch.distance_m is None:
            return
        rows = np.vstack(stretch.points)
        over_ground = float(np.hypot(*np.diff(rows[:, :2], axis=0).T).sum()) if len(rows) > 1 else 0.0
        if over_ground / stretch.distance_m > PATH.most_photos:
            self._notes[f"more than {PATH.most_photos} distance-triggered photos are not counted"] = None
            return
        legs, fractions = photo_positions(np.ascontiguousarray(rows[:, :3]), stretch.distance_m)
        taken = _between(rows, legs, fractions)
        self._keep(taken if stretch.at_once else taken[1:], of_series=True)

    def _stop_time(self) -> None:
        stretch, self._by_time = self._by_time, None
        if stretch is None or stretch.interval_s is None:
            return
        rows = np.vstack(stretch.points)
        count = int((rows[-1, 3] - rows[0, 3]) / stretch.interval_s + 1e-9) + 1
        if stretch.most is not None:
            count = min(count, stretch.most)
        if count > PATH.most_photos:
            self._notes[f"more than {PATH.most_photos} time-triggered photos are not counted"] = None
            return
        times = rows[0, 3] + stretch.interval_s * np.arange(count)
        legs = np.clip(np.searchsorted(rows[:, 3], times, side="left") - 1, 0, max(len(rows) - 2, 0))
        if len(rows) == 1:
            self._keep(rows, of_series=False)
            return
        length = rows[legs + 1, 3] - rows[legs, 3]
        fractions = np.where(length > 0.0, (times - rows[legs, 3]) / np.where(length > 0.0, length, 1.0), 1.0)
        self._keep(_between(rows, legs, fractions), of_series=True)

    def _keep(self, taken: FloatArray, *, of_series: bool) -> None:
        self._taken.append(taken)
        if of_series and len(taken) > 1:
            gaps = np.diff(taken[:, 3])
            k = int(np.argmin(gaps))
            self._least_gap = min(self._least_gap, (float(gaps[k]), int(taken[k + 1, 6])))


def _between(rows: FloatArray, legs: IntArray, fractions: FloatArray) -> FloatArray:
    """Rows at fractions 0..1 between some rows and the next ones. Angles and items are those at the end of the leg."""
    after = np.minimum(legs + 1, len(rows) - 1)
    out: FloatArray = rows[after].copy()
    out[:, :4] = rows[legs, :4] + fractions[:, None] * (rows[after, :4] - rows[legs, :4])
    return out


def _carried(values: FloatArray, first: float) -> FloatArray:
    """Values with each NaN replaced by the one before it, ``first`` before all."""
    carried = itertools.accumulate(
        values, lambda before, value: value if math.isfinite(value) else before, initial=first
    )
    return np.array(list(carried)[1:], dtype=float)
