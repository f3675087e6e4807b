"""Physically possible motion: what a vehicle cannot have flown joins no samples and is no evidence.

Speed is evaluated over windows of 0.2, 1 and 3 s, acceleration by divided differences of three samples 0.2 to 2 s apart. For a
vehicle that accelerates by at most ``a``, no divided difference exceeds ``a``, at any spacing of the samples. A track at
1 Hz is therefore judged as fairly as one at 50 Hz, and the rounding of a log at 50 Hz is no acceleration.

Where a velocity is reported, it has to agree with the positions (:mod:`uavcover.verification.measured_motion`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.verification.measured_motion import (
    ERROR_TIME_S,
    POSITION_ERROR_M,
    ROUNDING_S,
    UPWARD,
    ContradictionKind,
    PositionError,
    WindowFigures,
    Windows,
    contradictions,
    position_lag,
    white_noise_m,
)

_BLOCK = 50_000
"""Windows that are computed at a time, to save memory."""
SPEED_WINDOWS_S = (0.2, 1.0, 3.0)
ACCELERATION_WINDOWS_S = (0.2, 0.5, 1.0, 2.0)

MAX_LEAN_DEG = 35.0
"""Largest lean of a mission: ArduPilot's maximum is 30 degrees, PX4 uses up to about 30."""
GRAVITY_M_S2 = 9.80665

MAX_JUMP_M = 5.0
"""After a position jump of at most this, as when a receiver regains its fix, later samples remain evidence."""
SAME_POSITION_S = 1.0
"""Impossible moves closer to each other than this are merged."""

MAX_CONTRADICTED = 0.1
"""Where a reported velocity contradicts the positions over more of the time, it is no passing fault of the estimator."""

STEP_WINDOW_S = 0.5
"""Averaging time of the velocities before and after an impossible move."""

MoveKind = Literal["speed", "climb", "acceleration", "velocity", "out of reach"]


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """The physical limits of a vehicle."""

    speed_m_s: float  # over ground
    climb_m_s: float  # upwards
    descent_m_s: float  # downwards
    acceleration_m_s2: float  # over ground, and vertically


def motion_limits(vehicle: Vehicle, wind: Wind) -> MotionLimits:
    """Generous physical limits of a scenario's vehicle: autopilots overshoot, and wind adds to ground speed.

    Ground speed: maximum airspeed plus wind, or without an airspeed 1.5 times the cruise speed plus 8 m/s for wind. Vertical
    speed: twice the scenario's plus 2 m/s. Acceleration: that of a lean of 35 degrees, or twice the scenario's if larger.
    """
    most_m_s = 1.5 * vehicle.cruise_speed_m_s + max(8.0, wind.speed_m_s)
    if vehicle.max_airspeed_m_s is not None:
        most_m_s = max(1.5 * vehicle.cruise_speed_m_s, vehicle.max_airspeed_m_s) + max(2.0, wind.speed_m_s)
    lean_m_s2 = GRAVITY_M_S2 * float(np.tan(np.radians(MAX_LEAN_DEG)))
    return MotionLimits(
        speed_m_s=most_m_s,
        climb_m_s=2.0 * vehicle.max_climb_m_s + 2.0,
        descent_m_s=2.0 * vehicle.max_descent_m_s + 2.0,
        acceleration_m_s2=max(lean_m_s2, 2.0 * _finite(vehicle.acceleration_m_s2)),
    )


def _finite(acceleration_m_s2: float | None) -> float:
    """The scenario's acceleration; 0 where it names none, or counts none."""
    return 0.0 if acceleration_m_s2 is None or np.isinf(acceleration_m_s2) else acceleration_m_s2


@dataclass(frozen=True, slots=True)
class ImpossibleMove:
    """A stretch of a track that no vehicle of the scenario can have flown."""

    first: int  # number of the sample at which it begins
    last: int  # number of the sample at which it ends
    # the first impossibility: speed, climb (or descent), acceleration, a reported velocity that contradicts the
    # positions, or a position out of reach
    kind: MoveKind
    worst: float  # its worst value; for a position out of reach, the speed required
    limit: float  # the limit of that value
    # excess of the velocity change across it over what is possible. A receiver's jump changes the position but not the
    # velocity; where the velocity has changed, an unknown part of the flight is missing.
    step_m_s: float = 0.0

    def __str__(self) -> str:
        """Description with the figures."""
        if self.kind == "velocity":
            return (
                f"the reported velocity differs from the change of position by {self.worst:.1f} m/s; at most "
                f"{self.limit:.1f} m/s is possible"
            )
        unit = "m/s2" if self.kind == "acceleration" else "m/s"
        what = "speed" if self.kind == "out of reach" else self.kind
        return f"{what} {self.worst:.1f} {unit}; at most {self.limit:.1f} {unit} is possible"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Possible part of a track's motion."""

    # (n - 1,) whether the straight line between two neighbours is evidence: close enough in time, and possible
    joined: BoolArray
    evidence: BoolArray  # (n,) whether a sample is evidence: possible motion reaches it from the others
    moves: tuple[ImpossibleMove, ...]  # the impossible moves, in order of time
    # (2,) measured horizontal and vertical position noise: medians of second differences over 0.2 s
    noise_m: tuple[float, float]
    white_m: float  # see :func:`white_noise_m`
    # part of the time over which the reported velocity contradicts the positions, where that is too much to leave it
    # out: one of the two was not measured, and it is not known which
    contradicted_fraction: float = 0.0
    # the stretch from the first to the last of these contradictions, with the worst
    contradiction: ImpossibleMove | None = None
    # seconds by which the positions are later than the reported velocity, where that is more than possible, and on which axis
    lag: tuple[float, str] | None = None


def judge_motion(
    time_s: FloatArray,  # vehicle time
    enu_m: FloatArray,  # positions
    limits: MotionLimits,  # limits of the vehicle
    *,
    max_gap_s: float,  # largest time between joined neighbours
    position_error_m: float = POSITION_ERROR_M,  # standard deviation of the positions, known from elsewhere
    # (n, 3) reported velocity, east, north, up; NaN or none where it is not reported
    velocity_m_s: FloatArray | None = None,
) -> Motion:
    """Judge which part of the motion through (n, 3) ENU positions at (n,) increasing times is possible."""
    joined = np.diff(time_s) <= max_gap_s
    white_m = white_noise_m(time_s, enu_m, joined)
    found = _Found(joined)
    shortest, *longer = (
        partial(Windows.of, time_s, enu_m, window_s=length, joined=joined, position_error_m=position_error_m)
        for length in ACCELERATION_WINDOWS_S
    )
    windows = shortest()
    noise_m, allowance_m = windows.noise_m, (windows.allowance_m(0), windows.allowance_m(1))
    for window_s in SPEED_WINDOWS_S:
        _mark_speeds(found, time_s, enu_m, limits, allowance_m, window_s)
    _mark_accelerations(found, limits, windows)
    del windows
    for of_length in longer:
        _mark_accelerations(found, limits, of_length())
    fraction, contradiction, lag = 0.0, None, None
    if velocity_m_s is not None:
        error = PositionError((position_error_m, UPWARD * position_error_m), ERROR_TIME_S)
        possible = joined & ~found.marked
        lag = position_lag(time_s, enu_m, possible, velocity_m_s, error=error)
        new = _Found(possible)
        _mark_velocities(
            new, contradictions(time_s, enu_m, velocity_m_s, error=error, acceleration_m_s2=limits.acceleration_m_s2)
        )
        fraction = float(np.diff(time_s) @ new.marked) / max(float(time_s[-1] - time_s[0]), ROUNDING_S)
        if fraction > MAX_CONTRADICTED:
            legs = np.flatnonzero(new.marked)
            first, last = int(legs[0]), int(legs[-1]) + 1
            contradiction = ImpossibleMove(first, last, *new.worst(first, last))
        else:
            fraction = 0.0
            found.add(new)
    joined = joined & ~found.marked
    evidence, unreachable = _reachable(time_s, enu_m, joined, limits)
    # a single sample with only impossible motion around it is no evidence.
    alone = ~np.append(joined, False) & ~np.insert(joined, 0, False)
    evidence &= ~(alone & (np.append(found.marked, False) | np.insert(found.marked, 0, False)))
    # The flight needs at least one sample even where none of its motion is possible.
    evidence[0] |= not evidence.any()
    joined &= evidence[:-1] & evidence[1:]
    moves = tuple(
        replace(move, step_m_s=_velocity_step_m_s(time_s, enu_m, joined, allowance_m, limits, move))
        for move in _moves(time_s, found, unreachable, limits)
    )
    return Motion(joined, evidence, moves, noise_m, white_m, fraction, contradiction, lag)


class _Found:
    """Windows of samples with impossible motion, and the legs in them.

    Attributes:
        marked: (n - 1,) legs that lie in such a window.
    """

    def __init__(self, joined: BoolArray) -> None:
        self.marked = np.zeros(len(joined), dtype=bool)
        self._broken = ~joined
        self._windows: list[tuple[NDArray[Any], NDArray[Any], FloatArray, float, MoveKind]] = []

    def unbroken(self, first: NDArray[Any], last: NDArray[Any]) -> BoolArray:
        """Whether windows of samples first..last contain neither a gap nor a marked leg."""
        bad = self.broken_before()
        return np.asarray(bad[last] == bad[first])

    def broken_before(self) -> NDArray[np.int32]:
        """(n,) number of gaps and marked legs before each sample."""
        return np.append(np.int32(0), np.cumsum(self._broken | self.marked, dtype=np.int32))

    def mark(self, first: NDArray[Any], last: NDArray[Any], values: FloatArray, limit: float, kind: MoveKind) -> None:
        """Mark all legs of windows of samples first..last that have these values."""
        if first.size == 0:
            return
        changes = np.zeros(len(self.marked) + 1, dtype=np.int32)
        np.add.at(changes, first, 1)
        np.add.at(changes, last, -1)
        self.marked |= np.cumsum(changes, dtype=np.int32)[:-1] > 0
        self._windows.append((first, last, values, limit, kind))

    def add(self, other: "_Found") -> None:
        """Add the marks of another result."""
        self.marked |= other.marked
        self._windows += other._windows

    def worst(self, first: int, last: int) -> tuple[MoveKind, float, float]:
        """Kind, value and limit of the window inside samples first..last that is furthest beyond its limit."""
        best: tuple[float, MoveKind, float, float] = (0.0, "speed", 0.0, 1.0)
        for starts, ends, values, limit, kind in self._windows:
            inside = np.flatnonzero((starts >= first) & (ends <= last))
            if inside.size and (top := float(values[inside].max())) / limit > best[0]:
                best = (top / limit, kind, top, limit)
        return best[1:]


def _mark_speeds(
    found: _Found,
    time_s: FloatArray,
    enu_m: FloatArray,
    limits: MotionLimits,
    allowance_m: tuple[float, float],
    window_s: float,
) -> None:
    # a second difference contains up to four times the position error, a distance twice.
    level_m, vertical_m = (0.5 * each_m for each_m in allowance_m)
    limits_of: tuple[tuple[MoveKind, float], ...] = (
        ("speed", limits.speed_m_s), ("climb", limits.climb_m_s), ("climb", limits.descent_m_s)
    )  # fmt: skip
    bad = found.broken_before()
    parts: list[list[tuple[IntArray, IntArray, FloatArray]]] = [[], [], []]
    for block in range(0, len(time_s), _BLOCK):
        first = np.arange(block, min(block + _BLOCK, len(time_s)))
        last = np.searchsorted(time_s, time_s[first] + window_s - ROUNDING_S)
        inside = last < len(time_s)
        first, last = first[inside], last[inside]
        moved, unbroken = enu_m[last] - enu_m[first], bad[last] == bad[first]
        metres = (np.hypot(moved[:, 0], moved[:, 1]) - level_m, moved[:, 2] - vertical_m, -moved[:, 2] - vertical_m)
        for part, each_m, (_, limit) in zip(parts, metres, limits_of, strict=True):
            speeds = each_m / (time_s[last] - time_s[first])
            k = np.flatnonzero(unbroken & (speeds > limit))
            part.append((first[k], last[k], speeds[k]))
    for part, (kind, limit) in zip(parts, limits_of, strict=True):
        first, last, values = (np.concatenate(each) for each in zip(*part, strict=True))
        found.mark(first, last, values, limit, kind)


def _mark_accelerations(found: _Found, limits: MotionLimits, windows: Windows) -> None:
    unbroken = found.unbroken(windows.before, windows.after)
    worst = np.maximum(
        windows.level_m_s2 - windows.allowance_m_s2(0), windows.vertical_m_s2 - windows.allowance_m_s2(1)
    )
    k = np.flatnonzero(unbroken & (worst > limits.acceleration_m_s2))
    found.mark(windows.before[k], windows.after[k], worst[k], limits.acceleration_m_s2, "acceleration")


def _mark_velocities(found: _Found, compared: Iterator[tuple[ContradictionKind, WindowFigures]]) -> None:
    """Mark where reported velocities change too fast, or contradict the positions: in the shortest window that shows it."""
    for kind, windows in compared:
        off = windows.taken(found.unbroken(windows.first, windows.last))
        if off.first.size:
            ratios = off.values / off.limits
            limit = float(off.limits[int(np.argmax(ratios))])
            found.mark(off.first, off.last, ratios * limit, limit, kind)


def _reachable(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, limits: MotionLimits
) -> tuple[BoolArray, list[tuple[int, int, float]]]:
    """Find the samples reachable from the longest stretch of joined samples, and the stretches that are not.

    From the longest stretch outwards, each next stretch counts when the vehicle can have reached it from the last one that
    counts, allowing for a small jump.

    Returns:
        (n,) whether a sample can be reached; first and last sample of the stretches that cannot, with the speed it would take.
    """
    count = len(time_s)
    starts = np.concatenate([[0], np.flatnonzero(~joined) + 1])
    ends = np.append(starts[1:], count) - 1
    evidence = np.ones(count, dtype=bool)
    lost: list[tuple[int, int, float]] = []
    longest = int(np.argmax(time_s[ends] - time_s[starts]))

    def needed_m_s(a: int, b: int) -> float:
        """Required ground speed, scaled up where the vertical speed exceeds its limit by more."""
        seconds = time_s[b] - time_s[a]
        moved = enu_m[b] - enu_m[a]
        level = max(0.0, float(np.hypot(moved[0], moved[1])) - MAX_JUMP_M) / seconds
        up = max(0.0, abs(float(moved[2])) - MAX_JUMP_M) / seconds
        vertical = up / (limits.climb_m_s if moved[2] > 0.0 else limits.descent_m_s) * limits.speed_m_s
        return float(max(level, vertical))

    for order in (range(longest + 1, len(starts)), range(longest - 1, -1, -1)):
        last = longest
        for stretch in order:
            a, b = (ends[last], starts[stretch]) if stretch > last else (ends[stretch], starts[last])
            speed_m_s = needed_m_s(int(a), int(b))
            if speed_m_s <= limits.speed_m_s:
                last = stretch
            else:
                evidence[starts[stretch] : ends[stretch] + 1] = False
                lost.append((int(starts[stretch]), int(ends[stretch]), speed_m_s))
    return evidence, lost


def _velocity_step_m_s(
    time_s: FloatArray,
    enu_m: FloatArray,
    joined: BoolArray,
    allowance_m: tuple[float, float],
    limits: MotionLimits,
    move: ImpossibleMove,
) -> float:
    """Excess of the velocity change across a move over what is possible, from samples right before and after it."""
    first, last = move.first, move.last
    while first > 0 and joined[first - 1] and time_s[move.first] - time_s[first] < STEP_WINDOW_S - ROUNDING_S:
        first -= 1
    while last < len(joined) and joined[last] and time_s[last] - time_s[move.last] < STEP_WINDOW_S - ROUNDING_S:
        last += 1
    came_s, went_s = float(time_s[move.first] - time_s[first]), float(time_s[last] - time_s[move.last])
    if came_s == 0.0 or went_s == 0.0:
        return 0.0
    change = (enu_m[last] - enu_m[move.last]) / went_s - (enu_m[move.first] - enu_m[first]) / came_s
    # The two means are the velocities at the middle of their intervals.
    most_m_s = (
        limits.acceleration_m_s2 * float(time_s[last] + time_s[move.last] - time_s[move.first] - time_s[first]) / 2.0
    )
    errors = [0.5 * each_m * (1.0 / came_s + 1.0 / went_s) for each_m in allowance_m]
    level, vertical = float(np.hypot(change[0], change[1])) - errors[0], abs(float(change[2])) - errors[1]
    return max(0.0, level - most_m_s, vertical - most_m_s)


def _moves(
    time_s: FloatArray, found: _Found, lost: list[tuple[int, int, float]], limits: MotionLimits
) -> list[ImpossibleMove]:
    """Marked legs as stretches, each reported once, and the stretches out of reach."""
    legs = np.flatnonzero(found.marked)
    moves: list[ImpossibleMove] = []
    if legs.size:
        apart = time_s[legs[1:]] - time_s[legs[:-1] + 1] > SAME_POSITION_S
        for run in np.split(legs, np.flatnonzero(apart) + 1):
            first, last = int(run[0]), int(run[-1]) + 1
            moves.append(ImpossibleMove(first, last, *found.worst(first, last)))
    for first, last, speed_m_s in lost:
        within = any(move.first <= first and last <= move.last for move in moves)
        if not within:
            moves.append(ImpossibleMove(first, last, "out of reach", speed_m_s, limits.speed_m_s))
    return sorted(moves, key=lambda move: move.first)


def within_reach(time_s: FloatArray, enu_m: FloatArray, at_m: FloatArray, speed_m_s: float) -> BoolArray:
    """(n - 1,) whether a vehicle can have been at a (3,) position between consecutive samples (n,)."""
    away_m = np.linalg.norm(enu_m - at_m, axis=1)
    return np.asarray(away_m[:-1] + away_m[1:] <= speed_m_s * np.diff(time_s))
