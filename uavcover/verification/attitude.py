"""Check which attitudes of a track are known and plausible: ranges, ages, and the lean that the accelerations require.

A multirotor accelerates by leaning: over ground its acceleration is that of its thrust, ``g tan(lean)`` in the direction of the
lean, minus aerodynamic drag. Drag grows with airspeed, so apart from noise and gusts

    g tan(lean) - acceleration = drag_per_s * velocity - wind_drag

with one number and one vector for the flight. An attitude that was invented, rotated, mirrored or taken from another time does
not fit. An autopilot with such an attitude could not fly.

A small residual alone proves nothing on a gentle flight: there, no lean at all fits as well. An attitude therefore counts only
when its lean explains the accelerations of the track: with their sign, their size and without a delay.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.verification.lean_fit import LEAN, lean_fits, mean_over, thrust_m_s2
from uavcover.verification.measured_motion import FITTED_STEP_S, Windows
from uavcover.verification.possible_motion import GRAVITY_M_S2, MAX_LEAN_DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class _Attitude:
    most_unexplained_m_s2: float
    most_unexplained_in_block_m_s2: float
    block_s: float
    most_noise_m_s2: float
    most_sideways_deg: float
    most_backwards_deg: float
    window_s: float
    longest_s: float
    moves_m_s: float
    enough_blocks: int
    enough_in_block: int
    own_fraction: float
    max_age_s: float
    max_tilt_deg: float
    stuck_s: float
    turned_deg: float
    course_s: float
    most_radians: float
    agrees_deg: float
    differs_deg: float
    course_m_s: float
    brisk_m_s2: float
    least_lean_fraction: float
    enough_windows: int


ATTITUDE = data_table(_Attitude, "uavcover/data/verification.toml", "attitude")


@dataclass(frozen=True, slots=True, eq=False)
class LeanProblem:
    """An attitude that does not fit the motion, or that the motion does not confirm."""

    text: str  # what is wrong, as text
    samples: BoolArray  # (n,) the affected samples
    # whether it leaves accelerations unexplained; whether the motion contradicts it, so that one of the two was not
    # measured; or whether the motion is too gentle to confirm it
    kind: Literal["unexplained", "contradicted", "unconfirmed"]


def lean_problem(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude_deg: FloatArray
) -> LeanProblem | None:
    """Return the problem of an attitude that contradicts the motion or is not confirmed by it.

    None when it is confirmed.

    Args:
        time_s: (n,) vehicle time.
        enu_m: (n, 3) positions.
        joined: (n - 1,) legs that were observed.
        attitude_deg: (n, 3) roll, pitch and yaw, NaN if unknown.
    """
    unexplained = _unexplained(time_s, enu_m, joined, attitude_deg)
    unconfirmed = _unconfirmed(time_s, enu_m, joined, attitude_deg)
    if unexplained is None:
        return unconfirmed
    # a storm leaves much unexplained, and contradicts nothing.
    contradicted = unconfirmed is not None and unconfirmed.kind == "contradicted"
    return replace(unexplained, kind="contradicted") if contradicted else unexplained


def _unexplained(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude_deg: FloatArray
) -> LeanProblem | None:
    """The problem of an attitude that leaves large accelerations unexplained; None with too little data."""
    windows = Windows.of(time_s, enu_m, window_s=ATTITUDE.window_s, joined=joined, step_s=FITTED_STEP_S)
    before, middle, after = windows.before, windows.middle, windows.after
    velocity, acceleration = windows.velocity_m_s[:, :2], windows.acceleration_m_s2[:, :2]
    half_s = np.maximum(time_s[middle] - time_s[before], time_s[after] - time_s[middle])
    thrust = mean_over(time_s, thrust_m_s2(attitude_deg), time_s[middle], half_s)
    good = np.isfinite(thrust).all(axis=1) & (half_s <= ATTITUDE.longest_s)
    good &= np.hypot(velocity[:, 0], velocity[:, 1]) > ATTITUDE.moves_m_s
    # Larger accelerations are not flight; another check finds them.
    good &= windows.level_m_s2 <= GRAVITY_M_S2 * np.tan(np.radians(MAX_LEAN_DEG))
    if good.sum() < ATTITUDE.enough_blocks:
        return None
    yaw = np.radians(attitude_deg[middle, 2])
    terms = _terms(velocity[good], np.column_stack([np.cos(yaw), -np.sin(yaw)])[good])
    drag = (thrust - acceleration)[good]
    columns = terms.reshape(-1, terms.shape[-1])
    fitted = np.linalg.lstsq(columns, drag.reshape(-1), rcond=None)[0]
    along_m_s2 = fitted[0] * float(np.sqrt((velocity[good] ** 2).sum(axis=1).mean()))
    along_deg, sideways_deg = np.degrees(np.arctan([along_m_s2 / GRAVITY_M_S2, fitted[3] / GRAVITY_M_S2]))
    everywhere = np.ones(len(time_s), dtype=bool)
    if abs(sideways_deg) > ATTITUDE.most_sideways_deg and _stands_alone(columns, 3):
        return LeanProblem(
            f"roll and pitch show a lean of {abs(sideways_deg):.0f} degrees to one side on all headings, which "
            "nothing in the flight explains",
            everywhere,
            "contradicted",
        )
    if along_deg < -ATTITUDE.most_backwards_deg and _stands_alone(columns, 0):
        return LeanProblem(
            f"roll and pitch show a lean of {-along_deg:.0f} degrees against the direction of flight",
            everywhere,
            "contradicted",
        )
    left = drag - terms @ fitted
    noise_m_s2 = min(windows.noise_m[0] / ATTITUDE.window_s**2, ATTITUDE.most_noise_m_s2)
    left_m_s2 = float(np.sqrt((left**2).sum(axis=1).mean()))
    if left_m_s2 > ATTITUDE.most_unexplained_m_s2 + noise_m_s2:
        return LeanProblem(
            f"roll and pitch do not match the flown accelerations: they differ by {left_m_s2:.1f} m/s2 (rms)",
            everywhere,
            "unexplained",
        )
    block = ((time_s - time_s[0]) // ATTITUDE.block_s).astype(np.int64)
    in_block_m_s2 = _rms_by_block(block[middle[good]], left, int(block[-1]) + 1)
    bad = in_block_m_s2 > ATTITUDE.most_unexplained_in_block_m_s2 + noise_m_s2
    if not bad.any():
        return None
    worst = int(np.argmax(in_block_m_s2))
    return LeanProblem(
        f"roll and pitch do not match the flown accelerations for about {ATTITUDE.block_s * bad.sum():.0f} s, mostly "
        f"around {time_s[0] + (worst + 0.5) * ATTITUDE.block_s:.0f} s: they differ by {in_block_m_s2[worst]:.1f} "
        "m/s2 (rms)",
        bad[block],
        "unexplained",
    )


def _unconfirmed(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude_deg: FloatArray
) -> LeanProblem | None:
    """The problem of an attitude that does not explain the accelerations; None when it does."""
    fits = lean_fits(time_s, enu_m, joined, attitude_deg)
    everywhere = np.ones(len(time_s), dtype=bool)
    if 0.0 not in fits.late:
        return LeanProblem(
            "too little motion or attitude to test whether roll and pitch were measured", everywhere, "unconfirmed"
        )
    own, best = fits.late[0.0], max(fits.late, key=lambda late_s: fits.late[late_s].correlation)
    if abs(best) > LEAN.most_late_s and fits.late[best].signal > LEAN.smallest_signal:
        side = "late" if best > 0.0 else "early"
        return LeanProblem(
            f"roll and pitch match the flown accelerations, but with a shift in time: {abs(best):g} s {side}",
            everywhere,
            "contradicted",
        )
    if fits.axes_apart_s > LEAN.most_apart_s:
        text = (
            f"roll and pitch match the eastward and the northward accelerations at times {fits.axes_apart_s:g} s apart"
        )
        return LeanProblem(text, everywhere, "contradicted")
    if (why := own.contradiction) is not None:
        return LeanProblem(f"roll and pitch do not match the flown accelerations: {why}", everywhere, "contradicted")
    if fits.bad:
        where = np.full(len(time_s), not own.confirms)
        for part in fits.bad:
            where |= (time_s >= part.begin_s) & (time_s <= part.end_s)
        lasts_s = sum(part.end_s - part.begin_s for part in fits.bad)
        return LeanProblem(
            f"roll and pitch do not match the flown accelerations for about {lasts_s:.0f} s, first from "
            f"{fits.bad[0].begin_s:.0f} s to {fits.bad[0].end_s:.0f} s: {fits.bad[0].why}",
            where,
            "contradicted",
        )
    if not own.confirms:
        text = (
            f"roll and pitch are not confirmed by the flown accelerations (correlation {own.correlation:.2f}, "
            f"{own.signal:.1f} standard errors)"
        )
        return LeanProblem(text, everywhere, "unconfirmed")
    return None


def _terms(velocity: FloatArray, right: FloatArray) -> FloatArray:
    """(k, 2, 4) the terms of drag: speed, constant wind from east and from north, a lean to the right."""
    ones, none = np.ones(len(velocity)), np.zeros(len(velocity))
    return np.stack([velocity, np.column_stack([ones, none]), np.column_stack([none, ones]), right], axis=-1)


def _rms_by_block(block: IntArray, left: FloatArray, count: int) -> FloatArray:
    """(count,) root mean squares of (k, 2) vectors by block, 0 for a block with few of them."""
    numbers = np.bincount(block, minlength=count)
    squares = np.bincount(block, weights=(left**2).sum(axis=1), minlength=count)
    return np.asarray(np.sqrt(np.where(numbers >= ATTITUDE.enough_in_block, squares / np.maximum(numbers, 1), 0.0)))


def _stands_alone(columns: FloatArray, number: int) -> bool:
    """Whether a term can be separated from the others. On a single heading, a constant lean may be due to wind."""
    others = np.delete(columns, number, axis=1)
    one = columns[:, number]
    rest = one - others @ np.linalg.lstsq(others, one, rcond=None)[0]
    return bool((rest**2).sum() > ATTITUDE.own_fraction * (one**2).sum())


@dataclass(frozen=True, slots=True, eq=False)
class KnownAttitude:
    """The attitudes of a track that can be trusted."""

    attitude_deg: FloatArray  # (n, 3) roll, pitch and yaw, NaN where unknown
    problems: tuple[str, ...]  # what was found, one line each
    # why it is unknown although nothing contradicts it: the motion is too gentle to confirm it
    unconfirmed: str | None = None
    # the problem that the motion contradicts, so that either attitude or motion was not measured
    contradiction: str | None = None
    confirmed: bool = False  # whether the motion confirms it


def known_attitude(track: Track, enu_m: FloatArray, joined: BoolArray) -> KnownAttitude:
    """Find the attitudes that can be trusted.

    Args:
        track: what was flown.
        enu_m: (n, 3) its positions.
        joined: (n - 1,) legs that were observed.
    """
    attitude = track.attitude_deg.copy()
    problems: list[str] = []
    old = np.abs(track.attitude_age_s) > ATTITUDE.max_age_s
    # a heading without roll and pitch was derived from the positions themselves.
    attitude[old & np.isfinite(attitude[:, :2]).any(axis=1)] = np.nan
    low, high = np.array([-180.0, -90.0, -180.0]), np.array([180.0, 90.0, 360.0])
    wrong = np.flatnonzero(((attitude < low) | (attitude > high)).any(axis=1))
    if wrong.size:
        first = wrong[0]
        roll, pitch, yaw = attitude[first]
        problems.append(
            f"{counted(wrong.size, 'attitude is', 'attitudes are')} out of range, the first (roll {roll:g}, "
            f"pitch {pitch:g}, yaw {yaw:g} degrees) at {track.time_s[first]:.1f} s"
        )
        attitude[wrong] = np.nan
    tilt = np.degrees(np.arccos(np.prod(np.cos(np.radians(attitude[:, :2])), axis=1)))
    tilted = np.flatnonzero(tilt > ATTITUDE.max_tilt_deg)
    if tilted.size:
        first = tilted[0]
        problems.append(
            f"{counted(tilted.size, 'attitude is', 'attitudes are')} tilted by more than "
            f"{ATTITUDE.max_tilt_deg:g} degrees, the first by {tilt[first]:.0f} degrees at "
            f"{track.time_s[first]:.1f} s; no vehicle flies a route in this way"
        )
        attitude[tilted] = np.nan
    with_attitude = np.isfinite(attitude).all(axis=1)
    if not with_attitude.any():
        return KnownAttitude(attitude, tuple(problems))
    for first, last, turn_deg in _stuck(track.time_s, enu_m, attitude):
        problems.append(
            f"the attitude is exactly constant from {track.time_s[first]:.1f} s to {track.time_s[last]:.1f} s, while "
            f"the course turns by {turn_deg:.0f} degrees: it was not measured"
        )
        attitude[first : last + 1] = np.nan
    with_attitude = np.isfinite(attitude).all(axis=1)
    if not with_attitude.any():
        return KnownAttitude(attitude, tuple(problems))
    unconfirmed, contradiction, confirmed = None, None, False
    if _in_radians(track.time_s, enu_m, attitude):
        problems.append("the attitude is in radians instead of degrees: yaw times 57.3 equals the flown course")
        attitude[:] = np.nan
    elif (attitude[with_attitude, :2] == 0.0).all():
        problems.append("roll and pitch are exactly zero throughout: they were not measured")
        attitude[:, : 3 if (attitude[with_attitude, 2] == 0.0).all() else 2] = np.nan
    elif (lean := _never_leans(track.time_s, enu_m, joined, attitude)) is not None:
        problems.append(
            f"roll and pitch never exceed {lean[0]:.1f} degrees, although the vehicle accelerates by {lean[1]:.1f} m/s2"
        )
        attitude[:, :2] = np.nan
    elif (problem := lean_problem(track.time_s, enu_m, joined, attitude)) is not None:
        if problem.kind == "unconfirmed":
            unconfirmed = problem.text
            attitude[:, :2] = np.nan
        else:
            problems.append(problem.text)
            attitude[problem.samples] = np.nan
        contradiction = problem.text if problem.kind == "contradicted" else None
    else:
        confirmed = True
    return KnownAttitude(attitude, tuple(problems), unconfirmed, contradiction, confirmed)


def _stuck(time_s: FloatArray, enu_m: FloatArray, attitude: FloatArray) -> Iterator[tuple[int, int, float]]:
    """Runs of samples with constant attitude while the course turns: first, last, and turn in degrees."""
    same = np.append((np.diff(attitude, axis=0) == 0.0).all(axis=1), False)
    starts = np.flatnonzero(same & ~np.insert(same[:-1], 0, False))
    for start in starts:
        last = int(start) + int(np.argmin(same[start:]))
        if time_s[last] - time_s[start] < ATTITUDE.stuck_s:
            continue
        # Positions far enough apart in time that noise does not determine the course.
        steps = np.unique(np.searchsorted(time_s, np.arange(time_s[start], time_s[last], ATTITUDE.course_s)))
        moved = np.diff(enu_m[steps, :2], axis=0)
        fast = np.hypot(moved[:, 0], moved[:, 1]) > ATTITUDE.course_m_s * np.diff(time_s[steps])
        course = np.degrees(np.unwrap(np.arctan2(moved[fast, 0], moved[fast, 1])))
        if course.size and (turn := float(np.ptp(course))) > ATTITUDE.turned_deg:
            yield int(start), last, turn


def _in_radians(time_s: FloatArray, enu_m: FloatArray, attitude: FloatArray) -> bool:
    """Whether the headings agree with the courses as radians and not as degrees."""
    if float(np.nanmax(np.abs(attitude))) > ATTITUDE.most_radians or len(time_s) < 3:
        return False
    velocity = np.gradient(enu_m[:, :2], time_s, axis=0)
    moving = (np.hypot(velocity[:, 0], velocity[:, 1]) > ATTITUDE.course_m_s) & np.isfinite(attitude[:, 2])
    if moving.sum() < ATTITUDE.enough_windows:
        return False
    course = np.degrees(np.arctan2(velocity[moving, 0], velocity[moving, 1]))
    yaw = attitude[moving, 2]

    def median_off(heading_deg: FloatArray) -> float:
        return float(np.median(np.abs((heading_deg - course + 180.0) % 360.0 - 180.0)))

    return median_off(np.degrees(yaw)) < ATTITUDE.agrees_deg and median_off(yaw) > ATTITUDE.differs_deg


def _never_leans(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude: FloatArray
) -> tuple[float, float] | None:
    """The largest lean in degrees and the largest acceleration, if the lean is far too small for it."""
    brisk = np.zeros(ATTITUDE.enough_windows)
    # The longer window suppresses noise, the shorter one shows short turns.
    for window_s in (1.0, 2.0):
        windows = Windows.of(time_s, enu_m, window_s=window_s, joined=joined, step_s=FITTED_STEP_S)
        most = np.sort(windows.level_m_s2 - windows.allowance_m_s2(0))[-ATTITUDE.enough_windows :]
        if most.size == ATTITUDE.enough_windows and most[0] > brisk[0]:
            brisk = most
    if brisk[0] < ATTITUDE.brisk_m_s2:
        return None
    lean = float(np.nanmax(np.abs(attitude[:, :2])))
    if lean >= ATTITUDE.least_lean_fraction * np.degrees(np.arctan2(brisk[0], GRAVITY_M_S2)):
        return None
    return lean, float(brisk[-1])
