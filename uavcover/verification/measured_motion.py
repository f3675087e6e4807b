"""Motion of a track, measured: speeds and accelerations over windows, noise, and agreement with the reported velocity.

Position noise adds to speeds and accelerations over windows of three samples, more so in short windows. It is measured on the
track itself, by the median of its second differences over the windows of that length in which it moved. What it may excuse is
bounded from outside: a receiver's error, or the one that the scenario states, wanders with the time constant of an estimator, so
over short windows it changes little. Errors of neighbouring samples that have nothing to do with each other (white noise) are
those of no estimator.

An estimator makes velocities and positions from the same measurements. Over any window of time the integral of the velocity is
therefore the displacement, but for what is known from outside: the error of the positions wanders (Gauss and Markov), the
velocity has an error of its own, the two need not be of exactly the same moment, and times are rounded. None of these bounds is
measured on the track, so no noise of the positions excuses a velocity that contradicts them. Wind does not matter: both are over
ground. Reported velocities are also smooth: they change by no more than the vehicle can accelerate, even if the positions are
noisy.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from mission_io.data_tables import data_table
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Velocity:
    deviations: float
    reset_m_s: float
    skew_s: float
    height_skew_s: float
    climbs_m_s: float
    lag_window_s: float
    lag_turn_m_s: float
    lag_overlap: int
    stamp_s: float
    longest_step_s: float
    rounding_m: float
    rounding_s: float


VELOCITY = data_table(_Velocity, "uavcover/data/verification.toml", "velocity")


NOISE_MEDIANS = 6.0
"""The noise allowance, in medians of the second differences: random errors of a million samples stay below it."""
POSITION_ERROR_M = 2.0
"""Standard deviation of a receiver's error, east and north each, where the scenario states none that is larger."""
UPWARD = 1.5
"""Its error in height, in those over ground."""
ERROR_TIME_S = 30.0
"""An estimator's error wanders with at least this time constant."""
ROUNDING_M = 0.25
"""Second differences of positions with six decimals of a degree, in which logs round."""
_RAYLEIGH_MEDIAN = 1.18
WHITE = 0.8
"""Second differences in those over windows four times as long. Independent errors: 1; an estimator's: 0.5; motion: below 0.3."""
_LONGER = 4.0
_SHORTEST_STEP_S, _ENOUGH_WINDOWS = 0.1, 50
COARSE_STEP_S = 1.25
"""Samples further apart do not tell a turn that a vehicle flies from one that was drawn."""
MOVING_M_S = 1.0
"""Noise is measured above this speed: at rest on the ground, logs often show none."""
ROUNDING_S = 1e-6
FITTED_STEP_S = 0.02
"""Windows nearer to each other tell a fit, or a median, nothing new; limits of motion need all of them."""
_BLOCK = 50_000
"""Windows that are computed or compared at a time, to save memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of three samples: one, and the nearest ones at least the window length before and after it."""

    time_s: FloatArray  # (n,) times of all samples
    enu_m: FloatArray  # (n, 3) their positions
    before: NDArray[np.signedinteger[Any]]  # (k,) number of the first sample
    middle: NDArray[np.signedinteger[Any]]  # (k,) of the middle one
    after: NDArray[np.signedinteger[Any]]  # (k,) of the last one
    level_m_s2: FloatArray  # (k,) horizontal part of the mean acceleration around the middle sample
    vertical_m_s2: FloatArray  # (k,) its vertical part, unsigned
    # medians of the horizontal and vertical second differences over windows in which the vehicle moved
    noise_m: tuple[float, float]
    # the largest second differences that an estimator's error can have over these windows
    most_noise_m: tuple[float, float]

    @classmethod
    def of(
        cls,
        time_s: FloatArray,  # vehicle time
        enu_m: FloatArray,  # positions
        *,
        window_s: float,  # length of each half
        joined: BoolArray | None = None,  # (n - 1,) legs that may lie in a window; default: all
        position_error_m: float = POSITION_ERROR_M,  # standard deviation of the positions, known from elsewhere
        # least time between the middles, for what is fitted to all windows; default: one window for each sample
        step_s: float = 0.0,
    ) -> Self:
        """The windows of (n, 3) ENU positions at (n,) increasing times."""
        gaps = np.zeros(len(time_s), dtype=np.int32)
        if joined is not None:
            gaps[1:] = np.cumsum(~joined)
        some = np.flatnonzero(np.diff(np.floor(time_s / step_s), prepend=-np.inf)) if step_s else None
        blocks = []
        for begin in range(0, len(time_s) if some is None else len(some), _BLOCK):
            middle = (
                np.arange(begin, min(begin + _BLOCK, len(time_s))) if some is None else some[begin : begin + _BLOCK]
            )
            after = np.searchsorted(time_s, time_s[middle] + window_s - ROUNDING_S)
            before = np.searchsorted(time_s, time_s[middle] - window_s + ROUNDING_S, side="right") - 1
            whole = (after < len(time_s)) & (before >= 0)
            whole[whole] = gaps[after[whole]] == gaps[before[whole]]
            numbers = before[whole], middle[whole], after[whole]
            change = _accelerations(time_s, enu_m, *numbers)
            blocks.append((
                *(each.astype(np.int32) for each in numbers),
                np.hypot(change[:, 0], change[:, 1]), np.abs(change[:, 2]), _moving(time_s, enu_m, numbers[1]),
            ))  # fmt: skip
        if not blocks:
            blocks.append((*np.zeros((3, 0), dtype=np.int32), *np.zeros((2, 0)), np.zeros(0, dtype=bool)))
        before, middle, after, level, vertical, moving = (np.concatenate(each) for each in zip(*blocks, strict=True))
        blocks.clear()
        noise, spans = (0.0, 0.0), (time_s[middle] - time_s[before]) * (time_s[after] - time_s[middle])
        if moving.any():
            noise = (float(np.median((level * spans)[moving])), float(np.median((vertical * spans)[moving])))
        half_s = float(np.sqrt(np.median(spans))) if spans.size else window_s
        # Of a wandering error (Gauss and Markov), the variance of a second difference is 4 sigma^2 h / T for short h.
        wander_m = _RAYLEIGH_MEDIAN * 2.0 * position_error_m * float(np.sqrt(min(half_s / ERROR_TIME_S, 1.5)))
        most = (NOISE_MEDIANS * wander_m + ROUNDING_M, UPWARD * NOISE_MEDIANS * wander_m + ROUNDING_M)
        return cls(time_s, enu_m, before, middle, after, level, vertical, noise, most)

    @property
    def velocity_m_s(self) -> FloatArray:
        """(k, 3) mean velocity of the two halves."""
        return np.asarray(sum(_halves(self.time_s, self.enu_m, self.before, self.middle, self.after)) * 0.5)

    @property
    def acceleration_m_s2(self) -> FloatArray:
        """(k, 3) divided difference of the positions: the mean acceleration around the middle sample."""
        return _accelerations(self.time_s, self.enu_m, self.before, self.middle, self.after)

    @property
    def spans_s2(self) -> FloatArray:
        """(k,) product of the two time steps."""
        time_s, middle = self.time_s, self.middle
        return np.asarray((time_s[middle] - time_s[self.before]) * (time_s[self.after] - time_s[middle]))

    def allowance_m(self, axis: Literal[0, 1]) -> float:
        """Noise allowance for a second difference, horizontal (0) or vertical (1)."""
        return min(NOISE_MEDIANS * self.noise_m[axis], self.most_noise_m[axis])

    def allowance_m_s2(self, axis: Literal[0, 1]) -> FloatArray:
        """(k,) noise allowance for the accelerations."""
        return np.asarray(self.allowance_m(axis) / self.spans_s2)


def white_noise_m(time_s: FloatArray, enu_m: FloatArray, joined: BoolArray) -> float:
    """Independent position noise of neighbouring samples; 0 where it is no more than rounding.

    Second differences of independent errors do not depend on the length of the window, those of an estimator's error grow with
    its root, and those of motion with its square.
    """
    step_s = max(float(np.median(np.diff(time_s))), _SHORTEST_STEP_S) if len(time_s) > 1 else np.inf
    if step_s > COARSE_STEP_S:
        return 0.0
    short, long = (
        Windows.of(time_s, enu_m, window_s=length, joined=joined, step_s=FITTED_STEP_S)
        for length in (step_s, _LONGER * step_s)
    )
    if len(long.middle) < _ENOUGH_WINDOWS:
        return 0.0
    white = [a for a, b in zip(short.noise_m, long.noise_m, strict=True) if a > ROUNDING_M and a > WHITE * b]
    return max(white, default=0.0) / (_RAYLEIGH_MEDIAN * float(np.sqrt(6.0)))


def _halves(
    time_s: FloatArray, enu_m: FloatArray, before: NDArray[Any], middle: NDArray[Any], after: NDArray[Any]
) -> tuple[FloatArray, FloatArray]:
    """(k, 3) mean velocities before and after the middle."""
    came = (enu_m[middle] - enu_m[before]) / (time_s[middle] - time_s[before])[:, None]
    return came, (enu_m[after] - enu_m[middle]) / (time_s[after] - time_s[middle])[:, None]


def _accelerations(
    time_s: FloatArray, enu_m: FloatArray, before: NDArray[Any], middle: NDArray[Any], after: NDArray[Any]
) -> FloatArray:
    came, went = _halves(time_s, enu_m, before, middle, after)
    return np.asarray(2.0 * (went - came) / (time_s[after] - time_s[before])[:, None])


def _moving(time_s: FloatArray, enu_m: FloatArray, samples: NDArray[Any]) -> BoolArray:
    """(k,) whether the vehicle moves, over the 2 s around each of some samples."""
    begin = np.searchsorted(time_s, time_s[samples] - 1.0)
    end = np.minimum(np.searchsorted(time_s, time_s[samples] + 1.0), len(time_s) - 1)
    moved = np.linalg.norm(enu_m[end] - enu_m[begin], axis=1)
    return np.asarray(moved > MOVING_M_S * (time_s[end] - time_s[begin]))


AGREEMENT_WINDOWS_S = (2.0, 5.0, 10.0, 20.0, 40.0)
"""Short ones find jumps and turns; in long ones the error of the positions counts least."""
CHANGE_WINDOWS_S = (0.2, 0.5, 1.0)
VELOCITY_ERROR_M_S = (0.2, 0.5)
"""Lasting error of an estimator's velocity over ground and vertically, where a barometer drifts and accelerometers clip."""


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
        velocity_m_s: (n, 3) reported velocity, east, north, up; NaN where it is not reported. Such samples are omitted, and
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


def position_lag(
    time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, velocity_m_s: FloatArray, *, error: PositionError
) -> tuple[float, Literal["eastward", "northward", "upward"]] | None:
    """Seconds by which the positions are later than the reported velocity on an axis, where that is more than possible.

    Positions that are late by ``lag`` differ from the integral of the velocity by ``-lag`` times its change. The weighted median
    over all turns and stops (a regression in the L1 norm) tells less than a second where no single window does. An
    error of heights would hide that, so their limit is what honest flights never come near.

    Args:
        time_s: (n,) vehicle time, increasing.
        enu_m: (n, 3) positions.
        joined: (n - 1,) legs that were observed.
        velocity_m_s: (n, 3) reported velocity, east, north, up; NaN where it is not reported.
        error: of the positions.
    """
    known = np.isfinite(velocity_m_s).all(axis=1)
    gaps = np.append(0, np.cumsum(~joined))[known]
    time_s, enu_m, velocity_m_s = time_s[known], enu_m[known], velocity_m_s[known]
    if len(time_s) < 2:
        return None
    apart = gaps + np.append(0, np.cumsum(np.diff(time_s) > VELOCITY.longest_step_s))
    reported = _Reported.of(time_s, enu_m, velocity_m_s)
    begins = np.flatnonzero(np.diff(np.floor(time_s / (VELOCITY.lag_window_s / VELOCITY.lag_overlap)), prepend=-np.inf))
    first, last = _windows(time_s, VELOCITY.lag_window_s, slice(None))
    some = np.isin(first, begins) & (apart[first] == apart[last])
    first, last = first[some], last[some]
    off_m = (enu_m[last] - enu_m[first]) - (reported.integral_m[last] - reported.integral_m[first])
    change_m_s = velocity_m_s[last] - velocity_m_s[first]
    error_m = float(error.change_m(np.array(VELOCITY.lag_window_s), 0))
    names: tuple[Literal["eastward", "northward", "upward"], ...] = ("eastward", "northward", "upward")
    for axis, name in enumerate(names):
        turns = np.flatnonzero(np.abs(change_m_s[:, axis]) > VELOCITY.lag_turn_m_s)
        if not turns.size:
            continue
        change, lags_s = change_m_s[turns, axis], -off_m[turns, axis] / change_m_s[turns, axis]
        order = np.argsort(lags_s)
        weights = np.cumsum(np.abs(change)[order])
        lag_s = float(lags_s[order][int(np.searchsorted(weights, 0.5 * weights[-1]))])
        changes_m_s = float(np.sqrt((change**2).sum() / VELOCITY.lag_overlap))
        # The standard error of a median is 1.25 times that of a mean.
        limit_s = VELOCITY.skew_s + VELOCITY.deviations * 1.25 * error_m / changes_m_s
        if name == "upward":
            limit_s = VELOCITY.height_skew_s if changes_m_s >= VELOCITY.climbs_m_s else np.inf
        if abs(lag_s) > limit_s:
            return lag_s, name
    return None


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
    moved = reported.enu_m[last] - reported.enu_m[first]
    off = moved - (reported.integral_m[last] - reported.integral_m[first])
    turned = reported.velocity_m_s[last] - reported.velocity_m_s[first]
    parts = []
    for axis, columns in ((0, slice(0, 2)), (1, slice(2, 3))):
        trapezia_m = reported.trapezia_m[axis]
        most = (
            VELOCITY.deviations * error.change_m(seconds, axis)
            + VELOCITY_ERROR_M_S[axis] * seconds
            + VELOCITY.skew_s * np.linalg.norm(turned[:, columns], axis=1)
            + VELOCITY.stamp_s * np.linalg.norm(moved[:, columns], axis=1) / seconds
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
