"""Agreement of the velocity that a vehicle reports with the change of its positions.

An estimator makes both from the same measurements. Over any window of time the integral of the velocity is therefore the
displacement, but for what is known from outside: the error of the positions wanders (Gauss and Markov), the velocity has an
error of its own, the two need not be of exactly the same moment, and times are rounded. None of these bounds is measured on the
track, so no noise of the positions excuses a velocity that contradicts them. Wind does not matter: both are over ground.

Reported velocities are also smooth: they change by no more than the vehicle can accelerate, even if the positions are noisy.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.verification.tuning import VELOCITY

AGREEMENT_WINDOWS_S = (2.0, 5.0, 10.0, 20.0, 40.0)
"""Short ones find jumps and turns; in long ones the error of the positions counts least."""
CHANGE_WINDOWS_S = (0.2, 0.5, 1.0)
VELOCITY_ERROR_M_S = (0.2, 0.5)
"""Lasting error of an estimator's velocity over ground and vertically, where a barometer drifts and accelerometers clip."""
_BLOCK = 50_000
"""Windows that are compared at a time, to save memory."""


@dataclass(frozen=True, slots=True)
class PositionError:
    """Error of positions as known from outside: a wandering one."""

    deviation_m: tuple[float, float]  # standard deviation on each axis over ground, and vertically
    time_s: float  # its time constant

    def change_m(self, seconds: FloatArray, axis: int) -> FloatArray:
        """Standard deviation of its change over these times, on each axis over ground (0) or vertically (1)."""
        return np.asarray(self.deviation_m[axis] * np.sqrt(2.0 * -np.expm1(-seconds / self.time_s)))


@dataclass(frozen=True, slots=True, eq=False)
class WindowFigures:
    """Windows of samples first..last with one figure each, and its limit."""

    first: IntArray  # (k,) number of the first sample
    last: IntArray  # (k,) of the last one
    values: FloatArray  # (k,) a velocity or an acceleration
    limits: FloatArray  # (k,) the largest possible value

    @classmethod
    def larger(cls, first: IntArray, last: IntArray, parts: list[tuple[FloatArray, FloatArray]]) -> Self:
        """The one of several pairs of value and limit that is furthest beyond its limit, in each window."""
        values, limits = (np.array(each) for each in zip(*parts, strict=True))
        worst = np.argmax(values / limits, axis=0)[None]
        return cls(first, last, np.take_along_axis(values, worst, 0)[0], np.take_along_axis(limits, worst, 0)[0])

    def taken(self, among: BoolArray) -> Self:
        """Some of the windows."""
        return type(self)(self.first[among], self.last[among], self.values[among], self.limits[among])


ContradictionKind = Literal["acceleration", "velocity"]


def contradictions(
    time_s: FloatArray, enu_m: FloatArray, velocity_m_s: FloatArray, *, error: PositionError, acceleration_m_s2: float
) -> Iterator[tuple[ContradictionKind, WindowFigures]]:
    """Windows in which a reported velocity is impossible, the shortest ones first.

    Args:
        time_s: (n,) vehicle time, increasing.
        enu_m: (n, 3) positions.
        velocity_m_s: (n, 3) reported velocity, east, north, up; NaN where it is not reported. Such samples are left out, and
            windows in which it is unknown for longer than ``VELOCITY.longest_step_s``.
        error: of the positions.
        acceleration_m_s2: the most of the vehicle.
    """
    known = np.flatnonzero(np.isfinite(velocity_m_s).all(axis=1))
    if not known.size:
        return
    if known.size < len(time_s):
        time_s, enu_m, velocity_m_s = time_s[known], enu_m[known], velocity_m_s[known]
    silent = np.append(np.int32(0), np.cumsum(np.diff(time_s) > VELOCITY.longest_step_s, dtype=np.int32))
    reported = _Reported.of(time_s, enu_m, velocity_m_s)
    kinds: tuple[tuple[ContradictionKind, tuple[float, ...]], ...] = (
        ("acceleration", CHANGE_WINDOWS_S),
        ("velocity", AGREEMENT_WINDOWS_S),
    )
    for kind, windows_s in kinds:
        for window_s in windows_s:
            longest_s = None if kind == "acceleration" else _longest_in_windows_s(time_s, window_s)
            parts = [WindowFigures(*np.zeros((2, 0), dtype=np.int64), *np.zeros((2, 0)))]
            for block in range(0, len(time_s), _BLOCK):
                first, last = _windows(time_s, window_s, slice(block, block + _BLOCK))
                whole = silent[first] == silent[last]
                first, last = first[whole], last[whole]
                if not first.size:
                    continue
                if longest_s is None:
                    compared = _changes(time_s, velocity_m_s, first, last, acceleration_m_s2)
                else:
                    compared = _against_positions(reported, first, last, longest_s[first], error, acceleration_m_s2)
                parts.append(compared.taken(compared.values > compared.limits))
            first, last, values, limits = (
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("first", "last", "values", "limits")
            )
            yield kind, WindowFigures(known[first], known[last], values, limits)


@dataclass(frozen=True, slots=True, eq=False)
class _Reported:
    """Samples with a reported velocity."""

    time_s: FloatArray  # (n,) times
    enu_m: FloatArray  # (n, 3) positions
    velocity_m_s: FloatArray  # (n, 3) velocities
    integral_m: FloatArray  # (n, 3) their integral, by trapezia
    # two (n,): its largest error, over ground and vertically. A trapezium is off by at most half of the change of
    # velocity in its step, or by a dip between two samples.
    trapezia_m: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, time_s: FloatArray, enu_m: FloatArray, velocity_m_s: FloatArray) -> Self:
        """Integrate velocities."""
        step_s, integral_m = np.diff(time_s), np.zeros_like(velocity_m_s)
        for axis in range(3):
            mean = 0.5 * (velocity_m_s[1:, axis] + velocity_m_s[:-1, axis])
            np.cumsum(mean * step_s, out=integral_m[1:, axis])
        squares = [np.diff(velocity_m_s[:, axis]) ** 2 for axis in range(3)]
        changes = (np.sqrt(squares[0] + squares[1]), np.sqrt(squares[2]))
        level, vertical = (np.append(0.0, np.cumsum(0.5 * step_s * change)) for change in changes)
        return cls(time_s, enu_m, velocity_m_s, integral_m, (level, vertical))


def _against_positions(
    reported: _Reported,
    first: IntArray,
    last: IntArray,
    longest_s: FloatArray,
    error: PositionError,
    acceleration_m_s2: float,
) -> WindowFigures:
    """Mean difference of reported velocity and change of position, in m/s, with the most that errors can make of it."""
    seconds = reported.time_s[last] - reported.time_s[first]
    way = reported.enu_m[last] - reported.enu_m[first]
    off = way - (reported.integral_m[last] - reported.integral_m[first])
    turned = reported.velocity_m_s[last] - reported.velocity_m_s[first]
    parts = []
    for axis, columns in ((0, slice(0, 2)), (1, slice(2, 3))):
        trapezia_m = reported.trapezia_m[axis]
        most = (
            VELOCITY.deviations * error.change_m(seconds, axis)
            + VELOCITY_ERROR_M_S[axis] * seconds
            + VELOCITY.skew_s * np.linalg.norm(turned[:, columns], axis=1)
            + VELOCITY.stamp_s * np.linalg.norm(way[:, columns], axis=1) / seconds
            + (trapezia_m[last] - trapezia_m[first])
            + 0.5 * acceleration_m_s2 * longest_s**2
            + VELOCITY.rounding_m
        )
        parts.append((np.linalg.norm(off[:, columns], axis=1) / seconds, most / seconds))
    return WindowFigures.larger(first, last, parts)


def _longest_in_windows_s(time_s: FloatArray, window_s: float) -> FloatArray:
    """(n,) longest step between neighbours in the window that begins at each sample; 0 where it does not end in the record.

    Of steps that double in number only one set is kept: two of a power of two cover a window.
    """
    found, longest = np.zeros(len(time_s)), np.diff(time_s, append=time_s[-1:])
    first, last = _windows(time_s, window_s, slice(None))
    power = np.log2(last - first).astype(np.int8)
    for level in range(int(power.max(initial=-1)) + 1):
        if level:
            reach = 1 << (level - 1)
            longest[:-reach] = np.maximum(longest[:-reach], longest[reach:])
        here = np.flatnonzero(power == level)
        found[first[here]] = np.maximum(longest[first[here]], longest[last[here] - (1 << level)])
    return found


def _changes(
    time_s: FloatArray, velocity_m_s: FloatArray, first: IntArray, last: IntArray, acceleration_m_s2: float
) -> WindowFigures:
    """Accelerations of the reported velocity in m/s2, with the most that the vehicle and a reset can make of it."""
    seconds = time_s[last] - time_s[first]
    change = (velocity_m_s[last] - velocity_m_s[first]) / seconds[:, None]
    most = acceleration_m_s2 + VELOCITY.reset_m_s / seconds
    return WindowFigures.larger(first, last, [(np.hypot(*change[:, :2].T), most), (np.abs(change[:, 2]), most)])


def _windows(time_s: FloatArray, window_s: float, begin: slice) -> tuple[IntArray, IntArray]:
    """Numbers of the first and the last sample of the windows of at least this length that begin at some of the samples."""
    first = np.arange(len(time_s))[begin]
    last = np.searchsorted(time_s, time_s[begin] + window_s - VELOCITY.rounding_s)
    inside = np.flatnonzero(last < len(time_s))
    return first[inside], last[inside]
