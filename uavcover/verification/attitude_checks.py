"""Which attitudes of a track are known, and what is wrong with the others."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from uavcover.model.track import Track
from uavcover.verification.lean import lean_problem
from uavcover.verification.motion_windows import Windows
from uavcover.verification.possible_motion import GRAVITY_M_S2

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MAX_AGE_S = 1.0
"""An attitude further from its position in time is not that of the position."""
MAX_TILT_DEG = 60.0
"""A multirotor that leans by more needs twice its weight as thrust to keep its height."""
_STUCK_S, _TURNED_DEG = 5.0, 60.0
_COURSE_S = 2.0
_RADIANS_AT_MOST = 6.3
_AGREES_DEG, _DIFFERS_DEG = 25.0, 40.0
_COURSE_M_S = 2.0
"""Slower than this there is no course to compare a heading with."""
_BRISK_M_S2 = 2.0
"""To accelerate like this a multirotor leans by 11 degrees."""
_LEANS_AT_LEAST = 0.35
_ENOUGH = 5


def known_attitude(track: Track, enu_m: FloatArray, joined: BoolArray) -> tuple[FloatArray, list[str]]:
    """Attitudes that can be believed.

    Args:
        track: what was flown.
        enu_m: (n, 3) its positions.
        joined: (n - 1,) legs that were observed.

    Returns:
        (n, 3) roll, pitch and yaw in degrees, NaN where they are not known; and what is wrong with the track's, for people.
    """
    attitude = track.attitude_deg.copy()
    problems: list[str] = []
    old = np.abs(track.attitude_age_s) > MAX_AGE_S
    # A heading beside an empty roll and pitch is the one that the position told itself.
    attitude[old & np.isfinite(attitude[:, :2]).any(axis=1)] = np.nan
    low, high = np.array([-180.0, -90.0, -180.0]), np.array([180.0, 90.0, 360.0])
    wrong = np.flatnonzero(((attitude < low) | (attitude > high)).any(axis=1))
    if wrong.size:
        first = wrong[0]
        roll, pitch, yaw = attitude[first]
        problems.append(
            f"{wrong.size} attitudes are out of range, first roll {roll:g}, pitch {pitch:g}, yaw {yaw:g} degrees at "
            f"{track.time_s[first]:.1f} s"
        )
        attitude[wrong] = np.nan
    tilt = np.degrees(np.arccos(np.prod(np.cos(np.radians(attitude[:, :2])), axis=1)))
    tilted = np.flatnonzero(tilt > MAX_TILT_DEG)
    if tilted.size:
        first = tilted[0]
        problems.append(
            f"{tilted.size} attitudes lean by more than {MAX_TILT_DEG:g} degrees, first by {tilt[first]:.0f} at "
            f"{track.time_s[first]:.1f} s: nothing flies a route like that"
        )
        attitude[tilted] = np.nan
    told = np.isfinite(attitude).all(axis=1)
    if not told.any():
        return attitude, problems
    for first, last, turn_deg in _stuck(track.time_s, enu_m, attitude):
        problems.append(
            f"the attitude stays exactly the same from {track.time_s[first]:.1f} s to {track.time_s[last]:.1f} s, while the "
            f"course turns by {turn_deg:.0f} degrees: it was not measured"
        )
        attitude[first : last + 1] = np.nan
    told = np.isfinite(attitude).all(axis=1)
    if not told.any():
        return attitude, problems
    if _in_radians(track.time_s, enu_m, attitude):
        problems.append(
            "the attitude is in radians where degrees belong: its yaw times 57.3 is the course that was flown"
        )
        attitude[:] = np.nan
    elif (attitude[told, :2] == 0.0).all():
        problems.append("roll and pitch are exactly zero throughout: nothing measured them")
        attitude[:, : 3 if (attitude[told, 2] == 0.0).all() else 2] = np.nan
    elif (lean := _never_leans(track.time_s, enu_m, joined, attitude)) is not None:
        problems.append(
            f"roll and pitch are never above {lean[0]:.1f} degrees, though the vehicle accelerates with {lean[1]:.1f} m/s2"
        )
        attitude[:, :2] = np.nan
    elif (problem := lean_problem(track.time_s, enu_m, joined, attitude)) is not None:
        problems.append(problem.text)
        attitude[problem.samples] = np.nan
    return attitude, problems


def _stuck(time_s: FloatArray, enu_m: FloatArray, attitude: FloatArray) -> Iterator[tuple[int, int, float]]:
    """Runs of samples with exactly the same attitude in which the course turns: first, last and by how much in degrees."""
    same = np.append((np.diff(attitude, axis=0) == 0.0).all(axis=1), False)
    starts = np.flatnonzero(same & ~np.insert(same[:-1], 0, False))
    for start in starts:
        last = int(start) + int(np.argmin(same[start:]))
        if time_s[last] - time_s[start] < _STUCK_S:
            continue
        # Places so far apart in time that their noise is no course.
        steps = np.unique(np.searchsorted(time_s, np.arange(time_s[start], time_s[last], _COURSE_S)))
        way = np.diff(enu_m[steps, :2], axis=0)
        fast = np.hypot(way[:, 0], way[:, 1]) > _COURSE_M_S * np.diff(time_s[steps])
        course = np.degrees(np.unwrap(np.arctan2(way[fast, 0], way[fast, 1])))
        if course.size and (turn := float(np.ptp(course))) > _TURNED_DEG:
            yield int(start), last, turn


def _in_radians(time_s: FloatArray, enu_m: FloatArray, attitude: FloatArray) -> bool:
    """Whether the headings agree with the courses when they are taken as radians, and not as they stand there."""
    if float(np.nanmax(np.abs(attitude))) > _RADIANS_AT_MOST or len(time_s) < 3:
        return False
    velocity = np.gradient(enu_m[:, :2], time_s, axis=0)
    moving = (np.hypot(velocity[:, 0], velocity[:, 1]) > _COURSE_M_S) & np.isfinite(attitude[:, 2])
    if moving.sum() < _ENOUGH:
        return False
    course = np.degrees(np.arctan2(velocity[moving, 0], velocity[moving, 1]))
    yaw = attitude[moving, 2]

    def median_off(heading_deg: FloatArray) -> float:
        return float(np.median(np.abs((heading_deg - course + 180.0) % 360.0 - 180.0)))

    return median_off(np.degrees(yaw)) < _AGREES_DEG and median_off(yaw) > _DIFFERS_DEG


def _never_leans(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude: FloatArray
) -> tuple[float, float] | None:
    """The largest lean in degrees and the largest acceleration, when the first is far too small for the second."""
    brisk = np.zeros(_ENOUGH)
    # Over the longer one noise hides less, over the shorter one a short turn shows more.
    for window_s in (1.0, 2.0):
        windows = Windows.of(time_s, enu_m, window_s=window_s, joined=joined)
        most = np.sort(windows.level_m_s2 - windows.allowance_m_s2(0))[-_ENOUGH:]
        if most.size == _ENOUGH and most[0] > brisk[0]:
            brisk = most
    if brisk[0] < _BRISK_M_S2:
        return None
    lean = float(np.nanmax(np.abs(attitude[:, :2])))
    if lean >= _LEANS_AT_LEAST * np.degrees(np.arctan2(brisk[0], GRAVITY_M_S2)):
        return None
    return lean, float(brisk[-1])
