"""Questions to the user about the heights and angles of photos; nothing is corrected here."""

import itertools
import math
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uavcover.extras.photos.picture import HeightDatum
from uavcover.extras.photos.placing import PlacedPictures, courses_deg
from uavcover.kernels.arrays import FloatArray
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

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


def missing_stretches(placed: PlacedPictures) -> list[MissingStretch]:
    """Find where photos of a flight are missing, whether or not the ground there is in enough others.

    A step counts that is half as long again as the steps around it and as the flight's median, and either skips numbers of the
    photos' names, or goes straight on and takes half as long again. The vehicle is not much slower on it than around it.
    """
    found: list[MissingStretch] = []
    for _, group in itertools.groupby(range(len(placed.pictures)), key=lambda k: placed.pictures[k].clock):
        members = list(group)
        if len(members) >= _FEW:
            found += _missing_of(placed, members)
    return found


def _missing_of(placed: PlacedPictures, members: list[int]) -> list[MissingStretch]:
    pictures = [placed.pictures[k] for k in members]
    steps = np.diff(placed.eyes_m[members][:, :2], axis=0)
    long_m = np.hypot(steps[:, 0], steps[:, 1])
    usual_m = np.maximum(_around(long_m), np.median(long_m))
    long_s = np.diff(np.array([np.nan if p.time_s is None else p.time_s for p in pictures]))
    usual_s = _around(long_s)
    skipped = np.diff([_number(p.name) for p in pictures]) - 1
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
            ends = [(p.lon_deg or 0.0, p.lat_deg or 0.0) for p in pictures[k : k + 2]]
            found.append(
                MissingStretch(
                    after=pictures[k].name, before=pictures[k + 1].name, photos=max(count, 1), length_m=float(long_m[k]),
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
    placed: PlacedPictures,  # the photos
    frame: LocalFrame,  # of their places
    ground: Ground,  # of the elevation data
    *,
    by_takeoff: bool,  # whether heights above take-off count, from the ground there, or those above sea level
    error_m: float,  # what a height may be wrong by before anything is said
    home_en_m: FloatArray | None = None,  # (2,) ENU metres of the planned home, where there is a plan
) -> list[str]:
    """Contradictions between heights and the elevation data, or among heights.

    Many aircraft tell two heights: above sea level by satellites, and above the place of take-off by pressure. Their
    difference is the height of that place, the same in the whole flight, and somewhere near has to be ground at that height.
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
    placed: PlacedPictures, frame: LocalFrame, *, by_takeoff: bool
) -> tuple[FloatArray, float | None]:
    """Height above sea level of the take-off position, from each photo with two heights. Also of its ground, if known."""
    _, _, alt_amsl_m = frame.geodetic_from_enu(placed.eyes_m)
    by_pictures, grounds = [], []
    for picture, alt in zip(placed.pictures, alt_amsl_m, strict=True):
        above = picture.height_above_takeoff_m
        if above is None or picture.alt_m is None:
            continue
        if not by_takeoff:
            by_pictures.append(float(alt) - above)
        elif picture.datum is HeightDatum.SEA_LEVEL:
            by_pictures.append(picture.alt_m - above)
            grounds.append(float(alt) - above)
    return np.array(by_pictures), float(np.median(grounds)) if grounds else None


def _alt_amsl_m(en_m: FloatArray, ground: Ground, frame: LocalFrame) -> float:
    """Height above sea level of the ground at a place; NaN where it is not known."""
    up_m = ground.heights_m(en_m[None, :])
    _, _, alt_amsl_m = frame.geodetic_from_enu(np.column_stack([en_m[None, :], up_m]))
    return float(alt_amsl_m[0])


def _no_ground_there(
    takeoff_m: float, eyes_m: FloatArray, ground: Ground, frame: LocalFrame, *, error_m: float
) -> list[str]:
    (west, south), (east, north) = eyes_m[:, :2].min(axis=0) - _AROUND_M, eyes_m[:, :2].max(axis=0) + _AROUND_M
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, _AROUND_NODES), np.linspace(south, north, _AROUND_NODES))
    places = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up_m = ground.heights_m(places)
    known = np.isfinite(up_m)
    if not known.any():
        return []
    _, _, alt_amsl_m = frame.geodetic_from_enu(np.column_stack([places, up_m])[known])
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


def direction_doubts(placed: PlacedPictures) -> list[str]:
    """Questions to the user about the angles of photos."""
    doubts = []
    up = placed.axes[:, 2] >= 0.0
    if up.any():
        names = [picture.name for picture, looks in zip(placed.pictures, up, strict=True) if looks]
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
