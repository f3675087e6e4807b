"""Positions and camera directions of photos in the local frame, with their uncertainty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.errors import TerrainError, TrackError
from uavcover.extras.photos.picture import HeightDatum, Picture
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.sensor import FrameCamera
from uavcover.sensing.pictures import camera_axes
from uavcover.terrain.file_heights import Undulation
from uavcover.terrain.frames import LocalFrame

_NO_COURSE_M = 0.5
_ROUGHLY_M = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
"""Errors are rounded up to these, so that photos of like errors are counted together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assumptions:
    """Defaults for values that photos do not have."""

    horizontal_m: float = 3.0  # error of places
    vertical_m: float = 10.0  # error of heights above sea level or the ellipsoid
    vertical_by_barometer_m: float = 3.0  # error of heights above the place of take-off
    attitude_deg: float = 2.0  # error of the camera's angles where they are known
    unknown_attitude_deg: float = 10.0  # largest lean of a camera without known angles
    pitch_deg: float = -90.0  # of the camera where it is not known
    takeoff_alt_amsl_m: float | None = None  # of the place of take-off: heights above it count, if given
    geoid_height_m: float | None = None  # of the sea level above the ellipsoid; default: by PROJ's grid
    # a camera whose mount says how it hangs on the vehicle, for photos that tell the vehicle's attitude only; none:
    # that is not known
    mounted: FrameCamera | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlacedPictures:
    """The n photos that have a place and a direction."""

    pictures: tuple[Picture, ...]  # themselves
    eyes_m: FloatArray  # (n, 3) ENU
    axes: FloatArray  # (n, 3) unit vectors along their views
    tops: FloatArray  # (n, 3) unit vectors towards their tops
    direction_known: BoolArray  # (n,) whether the camera's angles were known
    horizontal_m: FloatArray  # (n,) errors of places
    vertical_m: FloatArray  # (n,) errors of heights
    turn_deg: FloatArray  # (n,) errors of directions
    left_out: dict[str, str]  # why the others do not count, by name

    def without(self, why: Mapping[str, str]) -> "PlacedPictures":
        """Those that are not named; the others do not count any more, with the reason."""
        kept = np.array([picture.name not in why for picture in self.pictures], dtype=bool)
        return PlacedPictures(
            tuple(picture for picture, keep in zip(self.pictures, kept, strict=True) if keep),
            np.ascontiguousarray(self.eyes_m[kept]), self.axes[kept], self.tops[kept], self.direction_known[kept],
            self.horizontal_m[kept], self.vertical_m[kept], self.turn_deg[kept], self.left_out | dict(why),
        )  # fmt: skip


def place_pictures(pictures: Sequence[Picture], frame: LocalFrame, assumed: Assumptions) -> PlacedPictures:
    """Place photos in the local frame.

    A camera without known angles hangs on its vehicle as ``assumed.mounted`` does. Where that is not known either, it looks
    along ``assumed.pitch_deg``, its photo's top along the vehicle's nose, or else along the line on which the photos lie.

    Raises:
        TrackError: none can be placed, or heights above the ellipsoid cannot be brought to sea level.
    """
    left_out = {picture.name: why for picture in pictures if (why := picture.lacks()) is not None}
    placed = [picture for picture in pictures if picture.name not in left_out]
    by_takeoff = assumed.takeoff_alt_amsl_m is not None
    heights = []
    for picture in list(placed):
        height = picture.height_above_takeoff_m if by_takeoff else picture.alt_m
        if height is None:
            left_out[picture.name] = (
                "no height above the take-off position"
                if by_takeoff
                else "only a height above take-off; specify --takeoff"
            )
            placed.remove(picture)
        else:
            heights.append(height + (assumed.takeoff_alt_amsl_m or 0.0))
    if not placed:
        raise TrackError(_none_placed(pictures, left_out))
    lat = np.array([picture.lat_deg for picture in placed], dtype=float)
    lon = np.array([picture.lon_deg for picture in placed], dtype=float)
    alt_amsl_m = np.array(heights)
    if not by_takeoff:
        above_ellipsoid = np.array([picture.datum is HeightDatum.ELLIPSOID for picture in placed])
        alt_amsl_m -= np.where(above_ellipsoid, _geoid_m(lat, lon, above_ellipsoid, assumed), 0.0)
    eyes = frame.enu_from_geodetic(lat, lon, alt_amsl_m)
    known = np.array([picture.has_direction for picture in placed])
    yaw, found = _yaws_deg(placed, eyes)
    for picture, has_angles, some in zip(placed, known, found, strict=True):
        if not has_angles and not some:
            left_out[picture.name] = "no direction: no camera angles, no heading and no other photos on the same line"
    keep = known | found
    if not keep.any():
        raise TrackError(_none_placed(pictures, left_out))
    pitch = np.array([assumed.pitch_deg if picture.pitch_deg is None else picture.pitch_deg for picture in placed])
    roll = np.array([picture.roll_deg or 0.0 for picture in placed])
    # a gimbal's pitch counts with the vehicle's heading, too: its yaw follows the nose.
    tilted = known | np.array([picture.vehicle_yaw_deg is not None for picture in placed])
    axes, tops = camera_axes(yaw, np.where(tilted, pitch, assumed.pitch_deg), np.where(tilted, roll, 0.0))
    if assumed.mounted is not None:
        turn = assumed.mounted.camera_turn(_vehicle_attitudes_deg(placed))
        hung = ~known & turn.known & np.array([picture.vehicle_yaw_deg is not None for picture in placed])
        axes[hung], tops[hung] = turn.axes[hung], turn.tops[hung]
        known = known | hung
    horizontal = [_or(picture.horizontal_error_m, assumed.horizontal_m) for picture in placed]
    vertical = [_vertical_m(picture, assumed) for picture in placed]
    turn_deg = np.where(known, assumed.attitude_deg, assumed.unknown_attitude_deg)
    return PlacedPictures(
        tuple(picture for picture, kept in zip(placed, keep, strict=True) if kept),
        np.ascontiguousarray(eyes[keep]), axes[keep], tops[keep], known[keep],
        _rounded_up(np.array(horizontal)[keep]), _rounded_up(np.array(vertical)[keep]), turn_deg[keep], left_out,
    )  # fmt: skip


def _vehicle_attitudes_deg(pictures: Sequence[Picture]) -> FloatArray:
    """(n, 3) roll, pitch and yaw of the vehicle; NaN where they are not known."""
    angles = [(p.vehicle_roll_deg, p.vehicle_pitch_deg, p.vehicle_yaw_deg) for p in pictures]
    return np.array([[np.nan if angle is None else angle for angle in row] for row in angles])


def _none_placed(pictures: Sequence[Picture], left_out: dict[str, str]) -> str:
    name, why = next(iter(left_out.items()))
    first = next(picture for picture in pictures if picture.name == name)
    advice = ""
    if first.fault is None and not (first.is_zoomed or first.has_position):
        advice = "; add a list of their positions (geo.txt, .csv, .MRK or the flight's log), or geotag them"
    return f"none of the {len(left_out)} photos can be located ({name}: {why}){advice}"


def _or(error_m: float | None, otherwise_m: float) -> float:
    return otherwise_m if error_m is None or error_m <= 0.0 else error_m


def _vertical_m(picture: Picture, assumed: Assumptions) -> float:
    if assumed.takeoff_alt_amsl_m is not None:
        return assumed.vertical_by_barometer_m
    return _or(picture.vertical_error_m, assumed.vertical_m)


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


def _yaws_deg(pictures: Sequence[Picture], eyes_m: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Headings of the photos' tops, and whether there is one."""
    yaw = np.array(
        [np.nan if (a := p.yaw_deg if p.has_direction else p.vehicle_yaw_deg) is None else a for p in pictures]
    )
    along = courses_deg(eyes_m)
    yaw = np.where(np.isfinite(yaw), yaw, along)
    return np.where(np.isfinite(yaw), yaw, 0.0), np.isfinite(yaw)


def courses_deg(eyes_m: FloatArray) -> FloatArray:
    """(n,) the direction of the line on which each of some places in order lies; NaN where there is none.

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
