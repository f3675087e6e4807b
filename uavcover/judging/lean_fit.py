"""How the accelerations of a track depend on its lean: whether attitude and motion were measured together.

Drag, wind and everything else that changes slowly is taken out of both. What is left of a measured flight is the same
acceleration twice. Gusts make the vehicle lean without accelerating, noise of the positions accelerates it without a lean; both
are bounded from outside, and make one of the two slopes smaller.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from uavcover.judging.possible_motion import GRAVITY_M_S2, MAX_LEAN_DEG, NOISE_MEDIANS, Windows
from uavcover.kernels.arrays import BoolArray, FloatArray

SURE = 3.0
"""Standard errors by which a figure has to differ."""
SMALLEST_SIGNAL = 3.0
"""The signal level: the correlation of lean and acceleration, in standard errors, above which an attitude is confirmed. Mock
flights in gusts of 2 m/s with errors of 2 m reach 7, simulated autopilots in a storm 5, attitudes of another time 0 to 3."""
LEAST_ACCELERATION_OF_LEAN, MOST_ACCELERATION_OF_LEAN = 0.5, 1.4
"""Acceleration of the track in that of the lean. Simulated autopilots: 0.8 to 1.0, in gusts 0.5, reversed in time 0.3."""
LEAST_LEAN_OF_ACCELERATION, MOST_LEAN_OF_ACCELERATION = 0.25, 1.4
"""The same the other way round."""
GUST_LEAN_M_S2 = 0.45
"""Root mean square of the lean against gusts of 2 m/s, which accelerates nothing; mock flights reach 0.38."""
MODEL = 0.9
"""Correlation that drag leaves which is not as it is modelled."""
MOST_LATE_S = 1.0
"""An attitude may be as old as ``MAX_AGE_S``."""
PART_S = 120.0
_LATE_S = np.arange(-3.0, 3.1, 0.5)
_SLOW_S = 5.0
"""Wind and drag that change over longer times than twice this are left out."""
_STEP_S = 0.1
_NOISE = 1.2
"""Root mean square of a Rayleigh distribution, in medians."""
_LEAST_M_S = 0.5
_LONGEST_HALF_S = 2.1
_WINDOW_S = 1.0
_ENOUGH = 20
_LEAST_SHARE = 0.3
_POINTS = np.linspace(-1.0, 1.0, 9)
_WEIGHTS = (1.0 - np.abs(_POINTS)) / (1.0 - np.abs(_POINTS)).sum()
"""A divided difference of positions is the mean of the accelerations with these weights."""


def thrust_m_s2(attitude_deg: FloatArray) -> FloatArray:
    """(n, 2) east and north acceleration by a thrust that holds height, for (n, 3) roll, pitch and yaw."""
    sin_roll, sin_pitch, sin_yaw = np.sin(np.radians(attitude_deg)).T
    cos_roll, cos_pitch, cos_yaw = np.cos(np.radians(attitude_deg)).T
    up = cos_roll * cos_pitch
    north = -(cos_roll * sin_pitch * cos_yaw + sin_roll * sin_yaw)
    east = -(cos_roll * sin_pitch * sin_yaw - sin_roll * cos_yaw)
    return np.asarray(GRAVITY_M_S2 * np.column_stack([east, north]) / up[:, None])


def mean_over(time_s: FloatArray, values: FloatArray, middles_s: FloatArray, half_s: FloatArray) -> FloatArray:
    """(k, 2) weighted means of (n, 2) values over windows; NaN where any value is."""
    means = np.zeros((len(middles_s), 2))
    for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
        at_s = middles_s + point * half_s
        means += weight * np.column_stack([np.interp(at_s, time_s, axis) for axis in values.T])
    return means


@dataclass(frozen=True, slots=True, eq=False)
class LeanFit:
    """How the accelerations of a track depend on the lean.

    Attributes:
        correlation: of both.
        signal: the correlation in its standard errors, after Fisher.
        acceleration_of_lean: slope of the acceleration over that of the lean, and its standard error.
        steady: fraction of the lean's energy that leaning against gusts does not explain.
        lean_of_acceleration: slope the other way, and its standard error.
        known: fraction of the acceleration's energy that noise of the positions does not explain.
        count: number of independent accelerations.
    """

    correlation: float
    signal: float
    acceleration_of_lean: tuple[float, float]
    steady: float
    lean_of_acceleration: tuple[float, float]
    known: float
    count: float

    @classmethod
    def of(cls, acceleration: FloatArray, lean: FloatArray, *, count: float, noise_m_s2: float) -> Self:
        """The fit of (k, 2) accelerations without drag, of which ``count`` are independent."""
        aa, ll, al = float((acceleration**2).sum()), float((lean**2).sum()), float((acceleration * lean).sum())
        if not (aa > 0.0 and ll > 0.0 and count > 4.0):
            return cls(0.0, 0.0, (0.0, np.inf), 0.0, (0.0, np.inf), 0.0, count)
        correlation = float(np.clip(al / np.sqrt(aa * ll), -0.9999, 0.9999))
        left = np.sqrt((1.0 - correlation**2) / count)
        return cls(
            correlation,
            float(np.arctanh(correlation) * np.sqrt(count - 3.0)),
            (al / ll, float(left * np.sqrt(aa / ll))),
            1.0 - len(lean) * GUST_LEAN_M_S2**2 / ll,
            (al / aa, float(left * np.sqrt(ll / aa))),
            1.0 - len(acceleration) * noise_m_s2**2 / aa,
            count,
        )

    @property
    def contradiction(self) -> str | None:
        """In what the lean contradicts the accelerations."""
        slope, error = self.acceleration_of_lean
        # Leaning against gusts makes this slope smaller, and never larger.
        if self.steady > _LEAST_SHARE and slope + SURE * error < LEAST_ACCELERATION_OF_LEAN * self.steady:
            return "the vehicle leans and does not accelerate as it leans"
        if slope - SURE * error > MOST_ACCELERATION_OF_LEAN:
            return f"the vehicle accelerates {slope:.1f} times as much as it leans"
        slope, error = self.lean_of_acceleration
        # Noise of the positions makes this slope smaller, and never larger.
        if self.known > _LEAST_SHARE and slope + SURE * error < LEAST_LEAN_OF_ACCELERATION * self.known:
            return "the vehicle accelerates and does not lean as it accelerates"
        if slope - SURE * error > MOST_LEAN_OF_ACCELERATION:
            return f"the vehicle leans {slope:.1f} times as much as it accelerates"
        return None

    @property
    def confirms(self) -> bool:
        """Whether lean and acceleration are related, and as closely as gusts and noise of the positions leave them."""
        return self.signal >= SMALLEST_SIGNAL and not self.loose

    @property
    def loose(self) -> bool:
        """Whether lean and acceleration are surely less related than gusts and noise of the positions leave them."""
        expected = MODEL * np.sqrt(max(0.0, self.known) * max(0.0, self.steady))
        # Fisher's transform: its standard error does not depend on the correlation.
        less = np.arctanh(expected) - np.arctanh(self.correlation)
        return bool(less * np.sqrt(max(0.0, self.count - 3.0)) > SURE)


@dataclass(frozen=True, slots=True, eq=False)
class LeanFits:
    """The fits of a track.

    Attributes:
        late: by the seconds by which the lean is taken from later; without 0 where too little is known.
        bad_parts: numbers of the parts of ``PART_S`` whose lean contradicts their accelerations, or has little to do with them.
        part: (n,) number of the part of each sample.
    """

    late: Mapping[float, LeanFit]
    bad_parts: tuple[float, ...]
    part: FloatArray


def lean_fits(time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude_deg: FloatArray) -> LeanFits:
    """Fit the accelerations of a track by the lean of its attitudes, and by that of other moments.

    Args:
        time_s: (n,) vehicle time.
        enu_m: (n, 3) positions.
        joined: (n - 1,) legs that were observed.
        attitude_deg: (n, 3) roll, pitch and yaw, NaN where they are not known.
    """
    windows = Windows.of(time_s, enu_m, window_s=_WINDOW_S, joined=joined)
    some = np.diff(np.floor(time_s[windows.middle] / _STEP_S), prepend=-np.inf) > 0.0
    before, middle, after = windows.before[some], windows.middle[some], windows.after[some]
    velocity, acceleration = windows.velocity_m_s[some, :2], windows.acceleration_m_s2[some, :2]
    half_s = np.maximum(time_s[middle] - time_s[before], time_s[after] - time_s[middle])
    good = (half_s <= _LONGEST_HALF_S) & (np.hypot(velocity[:, 0], velocity[:, 1]) > _LEAST_M_S)
    good &= np.hypot(acceleration[:, 0], acceleration[:, 1]) <= GRAVITY_M_S2 * np.tan(np.radians(MAX_LEAN_DEG))
    thrust = thrust_m_s2(attitude_deg)
    fits: dict[float, LeanFit] = {}
    part = np.minimum((time_s - time_s[0]) // PART_S, max(0.0, (time_s[-1] - time_s[0]) // PART_S - 1.0))
    bad: tuple[float, ...] = ()
    for late_s in _LATE_S:
        lean = mean_over(time_s, thrust, time_s[middle] + late_s, half_s)
        known = good & np.isfinite(lean).all(axis=1) & np.isfinite(attitude_deg[middle, 2])
        if known.sum() < _ENOUGH:
            continue
        at_s, yaw = time_s[middle][known], np.radians(attitude_deg[middle, 2][known])
        a, b = _without_drag(at_s, velocity[known], yaw, acceleration[known], lean[known])
        noise_m_s2 = float(_NOISE * min(windows.noise_m[0], windows.most_noise_m[0] / NOISE_MEDIANS) / _WINDOW_S**2)
        each_s = 2.0 * float(np.median(half_s[known])) / max(_STEP_S, float(np.median(np.diff(at_s))))

        def fit(
            chosen: BoolArray, a: FloatArray = a, b: FloatArray = b, noise: float = noise_m_s2, each: float = each_s
        ) -> LeanFit:
            return LeanFit.of(a[chosen], b[chosen], count=float(chosen.sum()) / max(1.0, each), noise_m_s2=noise)

        fits[float(late_s)] = fit(np.ones(len(a), dtype=bool))
        if late_s == 0.0:
            of_each = part[middle][known]
            numbers = np.unique(of_each).tolist()
            bad = tuple(k for k in numbers if (own := fit(of_each == k)).contradiction is not None or own.loose)
    return LeanFits(fits, bad, part)


def _without_drag(
    time_s: FloatArray, velocity: FloatArray, yaw: FloatArray, acceleration: FloatArray, lean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(k, 2) accelerations of the track and of the lean, without what drag explains and without slow changes."""
    ahead = np.column_stack([np.sin(yaw), np.cos(yaw)])
    along = (velocity * ahead).sum(axis=1)[:, None] * ahead
    squared = np.hypot(velocity[:, 0], velocity[:, 1])[:, None] * velocity
    drag = np.stack([_fast(time_s, each) for each in (velocity, along, squared)], axis=-1)
    columns = drag.reshape(-1, drag.shape[-1])
    found = []
    for values in (acceleration, lean):
        fast = _fast(time_s, values)
        found.append(fast - drag @ np.linalg.lstsq(columns, fast.reshape(-1), rcond=None)[0])
    return found[0], found[1]


def _fast(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """(k, 2) values less their means over the seconds around each."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time_s)[:, None]
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(steps, axis=0)])
    begin, end = np.maximum(time_s - _SLOW_S, time_s[0]), np.minimum(time_s + _SLOW_S, time_s[-1])
    means = [
        (np.interp(end, time_s, axis) - np.interp(begin, time_s, axis)) / np.maximum(end - begin, 1e-9)
        for axis in sums.T
    ]
    return np.asarray(values - np.column_stack(means))
