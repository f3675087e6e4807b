"""Positions and camera directions of photos in the local frame, their uncertainty, and doubts about them."""

import itertools
import math
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.errors import TerrainError, TrackError
from uavcover.extras.photos.photo import HeightDatum, Photo
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.sensor import FrameCamera
from uavcover.sensing.photos import camera_axes
from uavcover.terrain.frames import LocalFrame, Undulation
from uavcover.terrain.ground import Ground

_NO_COURSE_M = 0.5
_ROUGHLY_M = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
"""Errors are rounded up to these, so that photos with similar errors are counted together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Defaults for values that photos do not have."""

    horizontal_m: float = 3.0  # error of places
    vertical_m: float = 10.0  # error of heights above sea level or the ellipsoid
    vertical_by_barometer_m: float = 3.0  # error of heights above the place of take-off
    attitude_deg: float = 2.0  # error of the camera's angles where they are known
    unknown_attitude_deg: float = 10.0  # largest lean of a camera without known angles
    pitch_deg: float = -90.0  # of the camera if unknown
    takeoff_alt_amsl_m: float | None = None  # of the place of take-off: heights above it count, if given
    geoid_height_m: float | None = None  # of the sea level above the ellipsoid; default: by PROJ's grid
    # a camera whose mount applies to photos that contain only the vehicle's attitude; None: unknown
    mounted: FrameCamera | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LocatedPhotos:
    """The n photos with a position and a direction."""

    photos: tuple[Photo, ...]  # themselves
    eyes_m: FloatArray  # (n, 3) ENU
    axes: FloatArray  # (n, 3) unit vectors along their views
    tops: FloatArray  # (n, 3) unit vectors towards their tops
    direction_known: BoolArray  # (n,) whether the camera's angles were known
    horizontal_m: FloatArray  # (n,) errors of places
    vertical_m: FloatArray  # (n,) errors of heights
    turn_deg: FloatArray  # (n,) errors of directions
    left_out: dict[str, str]  # why the others do not count, by name

    def without(self, why: Mapping[str, str]) -> "LocatedPhotos":
        """Those that are not named; the others do not count any more, with the reason."""
        kept = np.array([photo.name not in why for photo in self.photos], dtype=bool)
        return LocatedPhotos(
            tuple(photo for photo, keep in zip(self.photos, kept, strict=True) if keep),
            np.ascontiguousarray(self.eyes_m[kept]), self.axes[kept], self.tops[kept], self.direction_known[kept],
            self.horizontal_m[kept], self.vertical_m[kept], self.turn_deg[kept], self.left_out | dict(why),
        )  # fmt: skip


def locate_photos(photos: Sequence[Photo], frame: LocalFrame, assumed: Assumptions) -> LocatedPhotos:
    """Place photos in the local frame.

    A camera without known angles has the mount of ``assumed.mounted``. If that is unknown, too, it looks along
    ``assumed.pitch_deg``, with the top of its photo along the vehicle's heading, or otherwise along the line of the photos.

    Raises:
        TrackError: none can be placed, or heights above the ellipsoid cannot be converted to sea level.
    """
    left_out = {photo.name: why for photo in photos if (why := photo.lacks()) is not None}
    placed = [photo for photo in photos if photo.name not in left_out]
    by_takeoff = assumed.takeoff_alt_amsl_m is not None
    heights = []
    for photo in list(placed):
        height = photo.height_above_takeoff_m if by_takeoff else photo.alt_m
        if height is None:
            left_out[photo.name] = (
                "no height above the take-off position"
                if by_takeoff
                else "only a height above take-off; specify --takeoff"
            )
            placed.remove(photo)
        else:
            heights.append(height + (assumed.takeoff_alt_amsl_m or 0.0))
    if not placed:
        raise TrackError(_none_placed(photos, left_out))
    lat = np.array([photo.lat_deg for photo in placed], dtype=float)
    lon = np.array([photo.lon_deg for photo in placed], dtype=float)
    alt_amsl_m = np.array(heights)
    if not by_takeoff:
        above_ellipsoid = np.array([photo.datum is HeightDatum.ELLIPSOID for photo in placed])
        alt_amsl_m -= np.where(above_ellipsoid, _geoid_m(lat, lon, above_ellipsoid, assumed), 0.0)
    eyes = frame.enu_from_geodetic(lat, lon, alt_amsl_m)
    known = np.array([photo.has_direction for photo in placed])
    yaw, found = _yaws_deg(placed, eyes)
    for photo, has_angles, some in zip(placed, known, found, strict=True):
        if not has_angles and not some:
            left_out[photo.name] = "no direction: no camera angles, no heading and no other photos on the same line"
    keep = known | found
    if not keep.any():
        raise TrackError(_none_placed(photos, left_out))
    pitch = np.array([assumed.pitch_deg if photo.pitch_deg is None else photo.pitch_deg for photo in placed])
    roll = np.array([photo.roll_deg or 0.0 for photo in placed])
    # a gimbal's pitch counts with the vehicle's heading, too: its yaw follows the nose.
    tilted = known | np.array([photo.vehicle_yaw_deg is not None for photo in placed])
    axes, tops = camera_axes(yaw, np.where(tilted, pitch, assumed.pitch_deg), np.where(tilted, roll, 0.0))
    if assumed.mounted is not None:
        turn = assumed.mounted.camera_turn(_vehicle_attitudes_deg(placed))
        hung = ~known & turn.known & np.array([photo.vehicle_yaw_deg is not None for photo in placed])
        axes[hung], tops[hung] = turn.axes[hung], turn.tops[hung]
        known = known | hung
    horizontal = [_or(photo.horizontal_error_m, assumed.horizontal_m) for photo in placed]
    vertical = [_vertical_m(photo, assumed) for photo in placed]
    turn_deg = np.where(known, assumed.attitude_deg, assumed.unknown_attitude_deg)
    return LocatedPhotos(
        tuple(photo for photo, kept in zip(placed, keep, strict=True) if kept),
        np.ascontiguousarray(eyes[keep]), axes[keep], tops[keep], known[keep],
        _rounded_up(np.array(horizontal)[keep]), _rounded_up(np.array(vertical)[keep]), turn_deg[keep], left_out,
    )  # fmt: skip


def _vehicle_attitudes_deg(photos: Sequence[Photo]) -> FloatArray:
    """(n, 3) roll, pitch and yaw of the vehicle; NaN if unknown."""
    angles = [(p.vehicle_roll_deg, p.vehicle_pitch_deg, p.vehicle_yaw_deg) for p in photos]
    return np.array([[np.nan if angle is None else angle for angle in row] for row in angles])


def _none_placed(photos: Sequence[Photo], left_out: dict[str, str]) -> str:
    name, why = next(iter(left_out.items()))
    first = next(photo for photo in photos if photo.name == name)
    advice = ""
    if first.fault is None and not (first.is_zoomed or first.has_position):
        advice = "; add a list of their positions (geo.txt, .csv, .MRK or the flight's log), or geotag them"
    return f"none of the {len(left_out)} photos can be located ({name}: {why}){advice}"


def _or(error_m: float | None, otherwise_m: float) -> float:
    return otherwise_m if error_m is None or error_m <= 0.0 else error_m


def _vertical_m(photo: Photo, assumed: Assumptions) -> float:
    if assumed.takeoff_alt_amsl_m is not None:
        return assumed.vertical_by_barometer_m
    return _or(photo.vertical_error_m, assumed.vertical_m)


def _rounded_up(errors_m: FloatArray) -> FloatArray:
    steps = np.array(_ROUGHLY_M)
    return np.where(
        errors_m <= steps[-1], steps[np.minimum(np.searchsorted(steps, errors_m), len(steps) - 1)], errors_m
    )


def _geoid_m(lat: FloatArray, lon: FloatArray, wanted: BoolArray, assumed: Assumptions) -> FloatArray:
    if not wanted.any():
        return np.zeros(lat.size)
    if assumed.geoid_height_m is not None:
        return np.full(lat.size, assumed.geoid_height_m)
    try:
        return Undulation().heights_m(lat, lon)
    except TerrainError as error:
        raise TrackError(
            f"{counted(int(wanted.sum()), 'photo has a height', 'photos have heights')} above the ellipsoid, but PROJ has "
            f"no geoid grid for {'it' if wanted.sum() == 1 else 'them'}: "
            "download it (projsync --file us_nga_egm96_15.tif), or specify --geoid-height, the local height of sea "
            "level above the ellipsoid"
        ) from error


def _yaws_deg(photos: Sequence[Photo], eyes_m: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Headings of the photos' tops, and whether they are known."""
    yaw = np.array(
        [np.nan if (a := p.yaw_deg if p.has_direction else p.vehicle_yaw_deg) is None else a for p in photos]
    )
    along = courses_deg(eyes_m)
    yaw = np.where(np.isfinite(yaw), yaw, along)
    return np.where(np.isfinite(yaw), yaw, 0.0), np.isfinite(yaw)


def courses_deg(eyes_m: FloatArray) -> FloatArray:
    """(n,) the direction of the line on which each of some places in order lies; NaN without one.

    Of the steps to a place and from it the one counts that goes on straight, so that the first and last places of a line belong
    to it and not to the way to the next one.
    """
    steps = np.diff(eyes_m[:, :2], axis=0)
    long_enough = np.hypot(steps[:, 0], steps[:, 1]) >= _NO_COURSE_M
    course = np.where(long_enough, np.degrees(np.arctan2(steps[:, 0], steps[:, 1])), np.nan)
    count = len(eyes_m)
    out = np.full(count, np.nan)
    for k in range(count):
        before = course[k - 1] if k >= 1 else np.nan
        after = course[k] if k < count - 1 else np.nan
        bend_before = _bend_deg(course[k - 2], before) if k >= 2 else 180.0
        bend_after = _bend_deg(after, course[k + 1]) if k < count - 2 else 180.0
        choices = [(bend_before, before), (bend_after, after)]
        choices = [choice for choice in choices if np.isfinite(choice[1])]
        if choices:
            out[k] = min(choices, key=lambda choice: choice[0])[1]
    return out


def _bend_deg(one_deg: float, other_deg: float) -> float:
    bend = abs((one_deg - other_deg + 180.0) % 360.0 - 180.0)
    return bend if np.isfinite(bend) else 180.0


_DOWN_WITHIN_DEG = 20.0
_TURNED_DEG = 20.0
_FEW = 10
_FEW_HEIGHTS = 3
_TOO_LONG = 1.5
"""A step between photos that is longer than the usual one by this factor lacks a photo."""
_STRAIGHT_DEG = 30.0
_MOST_SKIPPED = 50
_SLOWEST = 0.5
"""Fraction of the usual speed; a slower step is a break in the flight."""
_NEIGHBOURS = 7
_AROUND_M = 500.0
_AROUND_NODES = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingStretch:
    """A step of a flight that is longer than the steps around it."""

    after: str  # the last photo before it
    before: str  # the first photo after it
    photos: int  # how many are missing
    length_m: float  # of the step
    usual_m: float  # median of the steps around it
    lon_lat_deg: tuple[tuple[float, float], tuple[float, float]]  # of both photos


def missing_stretches(placed: LocatedPhotos) -> list[MissingStretch]:
    """Find missing photos of a flight, even if other photos show the ground there.

    A step counts if it is half as long again as the steps around it and as the flight's median, and either skips numbers in the
    photos' names, or continues straight and takes half as long again. The vehicle must not be much slower on it than around it.
    """
    found: list[MissingStretch] = []
    for _, group in itertools.groupby(range(len(placed.photos)), key=lambda k: placed.photos[k].clock):
        members = list(group)
        if len(members) >= _FEW:
            found += _missing_of(placed, members)
    return found


def _missing_of(placed: LocatedPhotos, members: list[int]) -> list[MissingStretch]:
    photos = [placed.photos[k] for k in members]
    steps = np.diff(placed.eyes_m[members][:, :2], axis=0)
    long_m = np.hypot(steps[:, 0], steps[:, 1])
    usual_m = np.maximum(_around(long_m), np.median(long_m))
    long_s = np.diff(np.array([np.nan if p.time_s is None else p.time_s for p in photos]))
    usual_s = _around(long_s)
    skipped = np.diff([_number(p.name) for p in photos]) - 1
    course = np.degrees(np.arctan2(steps[:, 0], steps[:, 1]))
    bend = np.abs((np.diff(course) + 180.0) % 360.0 - 180.0) <= _STRAIGHT_DEG
    straight = np.append(False, bend) & np.append(bend, False)
    uncertain_m = placed.horizontal_m[members][1:]
    found = []
    for k in np.flatnonzero((long_m > _TOO_LONG * usual_m) & (long_m - usual_m > uncertain_m)):
        by_number = 0 < skipped[k] <= _MOST_SKIPPED
        count = int(skipped[k]) if by_number else round(long_m[k] / usual_m[k]) - 1
        late = straight[k] and not long_s[k] <= _TOO_LONG * usual_s[k]
        if (by_number or late) and not long_s[k] > (count + 1) * usual_s[k] / _SLOWEST:
            ends = [(p.lon_deg or 0.0, p.lat_deg or 0.0) for p in photos[k : k + 2]]
            found.append(
                MissingStretch(
                    after=photos[k].name, before=photos[k + 1].name, photos=max(count, 1), length_m=float(long_m[k]),
                    usual_m=float(usual_m[k]), lon_lat_deg=(ends[0], ends[1]),
                )
            )  # fmt: skip
    return found


def _around(steps: FloatArray) -> FloatArray:
    """(n,) median of the steps around each."""
    padded = np.pad(steps, _NEIGHBOURS, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of windows without any time
        return np.nanmedian(windows, axis=1)


def _number(name: str) -> float:
    """The last number in the name of a file; NaN without one."""
    digits = re.findall(r"\d{1,9}", Path(name).stem)
    return float(digits[-1]) if digits else math.nan


def height_doubts(
    placed: LocatedPhotos,  # the photos
    frame: LocalFrame,  # of their places
    ground: Ground,  # of the elevation data
    *,
    by_takeoff: bool,  # whether heights above take-off count, from the ground there, or those above sea level
    error_m: float,  # tolerated error of a height
    home_en_m: FloatArray | None = None,  # (2,) ENU metres of the planned home, where there is a plan
) -> list[str]:
    """Contradictions between heights and the elevation data, or among heights.

    Many aircraft record two heights: above sea level from satellites, and above take-off from pressure. Their difference is the
    height of the take-off position, constant during the flight, and ground at that height must be nearby.
    """
    above_m = ground.heights_agl_m(placed.eyes_m)
    doubts = []
    under = int((above_m <= 0.0).sum())
    if under:
        doubts.append(
            f"{under} of {above_m.size} photos are below ground (lowest: {np.nanmin(above_m):.0f} m): their heights "
            "do not match the elevation data; use heights above take-off with --takeoff LAT,LON"
        )
    outside = int(np.isnan(above_m).sum())
    if outside:
        doubts.append(f"{outside} of {above_m.size} photos were taken outside the elevation data")
    takeoff_m, ground_m = _takeoff_heights_m(placed, frame, by_takeoff=by_takeoff)
    if takeoff_m.size < _FEW_HEIGHTS:
        return doubts
    low_m, middle_m, high_m = (float(value) for value in np.percentile(takeoff_m, (5.0, 50.0, 95.0)))
    if high_m - low_m > error_m:
        doubts.append(
            "during the flight, heights above sea level and heights above take-off drift apart by "
            f"{high_m - low_m:.0f} m: one of them is wrong, or the photos are from several flights"
        )
    elif ground_m is not None:
        off_m = middle_m - ground_m
        if abs(off_m) > error_m:
            doubts.append(
                f"heights above sea level put the take-off {abs(off_m):.0f} m {'above' if off_m > 0.0 else 'below'} "
                "the ground at --takeoff: the heights are wrong by this amount (receiver error, or a different "
                "datum), or the position is wrong; uavcover uses heights above take-off"
            )
    elif home_en_m is not None and math.isfinite(home_m := _alt_amsl_m(home_en_m, ground, frame)):
        off_m = middle_m - home_m
        if abs(off_m) > error_m:
            doubts.append(
                f"heights above sea level put the take-off {abs(off_m):.0f} m {'above' if off_m > 0.0 else 'below'} "
                "the ground at the scenario's home: the heights are wrong by this amount (receiver error, or a "
                "different datum), or the flight began elsewhere; use --takeoff LAT,LON to select heights above "
                "take-off instead"
            )
    else:
        doubts += _no_ground_there(middle_m, placed.eyes_m, ground, frame, error_m=error_m)
    return doubts


def _takeoff_heights_m(
    placed: LocatedPhotos, frame: LocalFrame, *, by_takeoff: bool
) -> tuple[FloatArray, float | None]:
    """Height above sea level of the take-off position, from each photo with two heights. Also of its ground, if known."""
    _, _, alt_amsl_m = frame.geodetic_from_enu(placed.eyes_m)
    by_photos, grounds = [], []
    for photo, alt in zip(placed.photos, alt_amsl_m, strict=True):
        above = photo.height_above_takeoff_m
        if above is None or photo.alt_m is None:
            continue
        if not by_takeoff:
            by_photos.append(float(alt) - above)
        elif photo.datum is HeightDatum.SEA_LEVEL:
            by_photos.append(photo.alt_m - above)
            grounds.append(float(alt) - above)
    return np.array(by_photos), float(np.median(grounds)) if grounds else None


def _alt_amsl_m(en_m: FloatArray, ground: Ground, frame: LocalFrame) -> float:
    """Height above sea level of the ground at a place; NaN if unknown."""
    up_m = ground.heights_m(en_m[None, :])
    _, _, alt_amsl_m = frame.geodetic_from_enu(np.column_stack([en_m[None, :], up_m]))
    return float(alt_amsl_m[0])


def _no_ground_there(
    takeoff_m: float, eyes_m: FloatArray, ground: Ground, frame: LocalFrame, *, error_m: float
) -> list[str]:
    (west, south), (east, north) = eyes_m[:, :2].min(axis=0) - _AROUND_M, eyes_m[:, :2].max(axis=0) + _AROUND_M
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, _AROUND_NODES), np.linspace(south, north, _AROUND_NODES))
    positions = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up_m = ground.heights_m(positions)
    known = np.isfinite(up_m)
    if not known.any():
        return []
    _, _, alt_amsl_m = frame.geodetic_from_enu(np.column_stack([positions, up_m])[known])
    lowest_m, highest_m = float(alt_amsl_m.min()), float(alt_amsl_m.max())
    off_m = max(takeoff_m - highest_m, lowest_m - takeoff_m)
    if off_m <= error_m:
        return []
    return [
        f"heights above sea level put the take-off at {takeoff_m:.0f} m, but the ground within {_AROUND_M:g} m of "
        f"the photos lies between {lowest_m:.0f} and {highest_m:.0f} m: the heights are at least {off_m:.0f} m too "
        f"{'high' if takeoff_m > highest_m else 'low'} (receiver error, or a different datum); use --takeoff LAT,LON "
        "to select heights above take-off instead"
    ]


def direction_doubts(placed: LocatedPhotos) -> list[str]:
    """Questions to the user about the angles of photos."""
    doubts = []
    up = placed.axes[:, 2] >= 0.0
    if up.any():
        names = [photo.name for photo, looks in zip(placed.photos, up, strict=True) if looks]
        doubts.append(
            f"{len(names)} of {len(up)} photos (first: {names[0]}) point at the horizon or above: their angles have "
            "a different reference, or the gimbal did not point down"
        )
    course = courses_deg(placed.eyes_m)
    yaw = np.degrees(np.arctan2(placed.tops[:, 0], placed.tops[:, 1]))
    is_judged = (
        placed.direction_known & np.isfinite(course) & (-placed.axes[:, 2] >= math.cos(math.radians(_DOWN_WITHIN_DEG)))
    )
    # a landscape sensor lies across the line, whichever way the vehicle flies along it.
    off = np.abs((yaw - course + 90.0) % 180.0 - 90.0)[is_judged]
    if off.size >= _FEW and np.median(off) > _TURNED_DEG:
        doubts.append(
            f"the yaw of the photos differs by {np.median(off):.0f} degrees (median) from the flight direction: the "
            "camera was turned, or the yaw is not the camera's"
        )
    return doubts
