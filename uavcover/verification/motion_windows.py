"""Speeds and accelerations of a track over windows of three samples, and the noise of its positions.

Position noise adds to these figures, more so in short windows. It is measured on the track itself, by the median of its second
differences over the windows of that length in which it moved. What it may excuse is bounded from outside: a receiver's error, or
the one that the scenario states, wanders with the time constant of an estimator, so over short windows it changes little. Errors
of neighbouring samples that have nothing to do with each other (white noise) are those of no estimator.
"""

from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import BoolArray, FloatArray

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
"""Windows that are computed at a time, to save memory."""


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
    way = np.linalg.norm(enu_m[end] - enu_m[begin], axis=1)
    return np.asarray(way > MOVING_M_S * (time_s[end] - time_s[begin]))
