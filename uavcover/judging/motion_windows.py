"""Accelerations of a track over windows of one length, and the share of position noise in them."""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray

NOISE_MEDIANS = 6.0
"""The noise allowance, in medians of the second differences: random errors of a million samples stay below it."""
MAX_NOISE_M = 24.0
"""Upper bound of the allowance: the largest second difference of random errors with a standard deviation of 2 m in each axis."""
MOVING_M_S = 1.0
"""Noise is measured above this speed: at rest on the ground, logs often show none."""
ROUNDING_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Windows of three samples: one, and the nearest ones at least the window length before and after it.

    Attributes:
        before: (k,) number of the first sample.
        middle: (k,) of the middle one.
        after: (k,) of the last one.
        velocity_m_s: (k, 3) mean velocity of its two halves.
        acceleration_m_s2: (k, 3) divided difference of the positions: the mean acceleration around the middle sample.
        level_m_s2: (k,) its horizontal part.
        vertical_m_s2: (k,) its vertical part, unsigned.
        spans_s2: (k,) product of the two time steps.
        noise_m: medians of the horizontal and vertical second differences over windows in which the vehicle moved.
    """

    before: IntArray
    middle: IntArray
    after: IntArray
    velocity_m_s: FloatArray
    acceleration_m_s2: FloatArray
    level_m_s2: FloatArray
    vertical_m_s2: FloatArray
    spans_s2: FloatArray
    noise_m: tuple[float, float]

    @classmethod
    def of(cls, time_s: FloatArray, enu_m: FloatArray, *, window_s: float, joined: BoolArray | None = None) -> Self:
        """The windows of (n, 3) ENU positions at (n,) increasing times.

        Args:
            time_s: vehicle time.
            enu_m: positions.
            window_s: length of each half.
            joined: (n - 1,) legs that may lie in a window; default: all.
        """
        gaps = np.zeros(len(time_s), dtype=np.int64)
        if joined is not None:
            gaps[1:] = np.cumsum(~joined)
        middle = np.arange(len(time_s))
        after = np.searchsorted(time_s, time_s + window_s - ROUNDING_S)
        before = np.searchsorted(time_s, time_s - window_s + ROUNDING_S, side="right") - 1
        whole = (after < len(time_s)) & (before >= 0)
        whole[whole] = gaps[after[whole]] == gaps[before[whole]]
        before, middle, after = before[whole], middle[whole], after[whole]
        back, ahead = time_s[middle] - time_s[before], time_s[after] - time_s[middle]
        came = (enu_m[middle] - enu_m[before]) / back[:, None]
        went = (enu_m[after] - enu_m[middle]) / ahead[:, None]
        change = 2.0 * (went - came) / (back + ahead)[:, None]
        level, vertical = np.hypot(change[:, 0], change[:, 1]), np.abs(change[:, 2])
        spans = back * ahead
        moving = _moving(time_s, enu_m)[middle]
        noise = (0.0, 0.0)
        if moving.any():
            noise = (float(np.median((level * spans)[moving])), float(np.median((vertical * spans)[moving])))
        return cls(before, middle, after, 0.5 * (came + went), change, level, vertical, spans, noise)

    def allowance_m(self, axis: Literal[0, 1]) -> float:
        """Noise allowance for a second difference, horizontal (0) or vertical (1)."""
        return min(NOISE_MEDIANS * self.noise_m[axis], MAX_NOISE_M)

    def allowance_m_s2(self, axis: Literal[0, 1]) -> FloatArray:
        """(k,) noise allowance for the accelerations."""
        return np.asarray(self.allowance_m(axis) / self.spans_s2)


def _moving(time_s: FloatArray, enu_m: FloatArray) -> BoolArray:
    """(n,) whether the vehicle moves, over the 2 s around each sample."""
    begin = np.searchsorted(time_s, time_s - 1.0)
    end = np.minimum(np.searchsorted(time_s, time_s + 1.0), len(time_s) - 1)
    way = np.linalg.norm(enu_m[end] - enu_m[begin], axis=1)
    return np.asarray(way > MOVING_M_S * (time_s[end] - time_s[begin]))
