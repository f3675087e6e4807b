"""Compare the accelerations of a track with its lean, to check that attitude and motion were measured together.

Drag, wind and other slow changes are removed from both. The rest of a measured flight is the same acceleration twice. Gusts make
the vehicle lean without acceleration, and noise of the positions accelerates it without lean. External limits bound both, and
each makes one of the two slopes smaller.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from mission_io.data_tables import data_table
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.verification.measured_motion import FITTED_STEP_S, NOISE_MEDIANS, Windows
from uavcover.verification.possible_motion import GRAVITY_M_S2, MAX_LEAN_DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lean:
    sure_deviations: float
    smallest_signal: float
    gust_lean_m_s2: float
    model_fraction: float
    most_late_s: float
    most_apart_s: float
    least_axis_m_s2: float
    slow_s: float
    step_s: float
    noise_ratio: float
    least_m_s: float
    longest_half_s: float
    window_s: float
    enough_windows: int
    least_fraction: float
    model_error: float
    axes_from_s: float
    quiet_s: float
    quiet_percent: float


LEAN = data_table(_Lean, "uavcover/data/verification.toml", "lean")


LEAST_ACCELERATION_OF_LEAN, MOST_ACCELERATION_OF_LEAN = 0.5, 1.4
"""Acceleration of the track in that of the lean. Simulated autopilots: 0.8 to 1.0, 0.5 in gusts, 0.3 if reversed in time."""
LEAST_LEAN_OF_ACCELERATION, MOST_LEAN_OF_ACCELERATION = 0.25, 1.4
"""The same the other way round."""
_BLOCK = 50_000
_LATE_S = np.arange(-3.0, 3.1, 0.5)
_POINTS = np.linspace(-1.0, 1.0, 9)
_WEIGHTS = (1.0 - np.abs(_POINTS)) / (1.0 - np.abs(_POINTS)).sum()
"""A divided difference of positions is the mean of the accelerations with these weights."""


def thrust_m_s2(attitude_deg: FloatArray) -> FloatArray:
    """(n, 2) east and north acceleration by a thrust that holds height, for (n, 3) roll, pitch and yaw."""
    thrust = np.empty((len(attitude_deg), 2))
    for block in range(0, len(attitude_deg), _BLOCK):  # to save memory
        radians = np.radians(attitude_deg[block : block + _BLOCK])
        sin_roll, sin_pitch, sin_yaw = np.sin(radians).T
        cos_roll, cos_pitch, cos_yaw = np.cos(radians).T
        up = cos_roll * cos_pitch
        north = -(cos_roll * sin_pitch * cos_yaw + sin_roll * sin_yaw)
        east = -(cos_roll * sin_pitch * sin_yaw - sin_roll * cos_yaw)
        thrust[block : block + _BLOCK] = GRAVITY_M_S2 * np.column_stack([east, north]) / up[:, None]
    return thrust


def mean_over(time_s: FloatArray, values: FloatArray, middles_s: FloatArray, half_s: FloatArray) -> FloatArray:
    """(k, 2) weighted means of (n, 2) values over windows; NaN where any value is."""
    means = np.zeros((len(middles_s), 2))
    for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
        at_s = middles_s + point * half_s
        means += weight * np.column_stack([np.interp(at_s, time_s, axis) for axis in values.T])
    return means


@dataclass(frozen=True, slots=True, eq=False)
class LeanFit:
    """Dependence of a track's accelerations on its lean."""

    correlation: float  # of both
    signal: float  # the correlation in its standard errors, after Fisher
    acceleration_of_lean: tuple[float, float]  # slope of the acceleration over that of the lean, and its standard error
    steady: float  # fraction of the lean's energy that leaning against gusts does not explain
    lean_of_acceleration: tuple[float, float]  # slope the other way, and its standard error
    known: float  # fraction of the acceleration's energy that noise of the positions does not explain
    count: float  # number of independent accelerations

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
            1.0 - len(lean) * LEAN.gust_lean_m_s2**2 / ll,
            (al / aa, float(left * np.sqrt(ll / aa))),
            1.0 - len(acceleration) * noise_m_s2**2 / aa,
            count,
        )

    @property
    def contradiction(self) -> str | None:
        """In what the lean contradicts the accelerations."""
        slope, error = self.acceleration_of_lean
        # Leaning against gusts makes this slope smaller, and never larger.
        if (
            self.steady > LEAN.least_fraction
            and slope + LEAN.sure_deviations * error < LEAST_ACCELERATION_OF_LEAN * self.steady
        ):
            return "the vehicle leans, but does not accelerate accordingly"
        if slope - LEAN.sure_deviations * error > MOST_ACCELERATION_OF_LEAN:
            return f"the acceleration is {slope:.1f} times what the lean explains"
        slope, error = self.lean_of_acceleration
        # Noise of the positions makes this slope smaller, and never larger.
        if (
            self.known > LEAN.least_fraction
            and slope + LEAN.sure_deviations * error < LEAST_LEAN_OF_ACCELERATION * self.known
        ):
            return "the vehicle accelerates, but does not lean accordingly"
        if slope - LEAN.sure_deviations * error > MOST_LEAN_OF_ACCELERATION:
            return f"the lean is {slope:.1f} times what the acceleration explains"
        return None

    @property
    def confirms(self) -> bool:
        """Whether lean and acceleration are related, and as closely as gusts and noise of the positions leave them."""
        return self.signal >= LEAN.smallest_signal and not self.loose

    @property
    def loose(self) -> bool:
        """Whether lean and acceleration are surely less related than gusts and noise of the positions leave them."""
        expected = LEAN.model_fraction * np.sqrt(max(0.0, self.known) * max(0.0, self.steady))
        # Fisher's transform: its standard error does not depend on the correlation.
        less = np.arctanh(expected) - np.arctanh(self.correlation)
        return bool(less * np.sqrt(max(0.0, self.count - 3.0)) > LEAN.sure_deviations)


@dataclass(frozen=True, slots=True)
class BadStretch:
    """A stretch of a flight whose lean contradicts its accelerations."""

    begin_s: float  # vehicle time
    end_s: float  # vehicle time
    why: str  # in what, as text


@dataclass(frozen=True, slots=True, eq=False)
class LeanFits:
    """The fits of a track."""

    # by the seconds by which the lean is taken from later; without 0 where too little is known
    late: Mapping[float, LeanFit]
    bad: tuple[BadStretch, ...]  # the shortest stretches that contradict, in order of time
    by_axis: tuple[Mapping[float, LeanFit], Mapping[float, LeanFit]]  # as ``late``, eastward alone and northward alone

    @property
    def axes_apart_s(self) -> float:
        """Time between the moments whose lean fits best eastward and northward; 0 where one moment may fit both."""
        east, north = self.by_axis
        if not (east and north and east.keys() == north.keys()):
            return 0.0
        of_east, of_north = (max(fits, key=lambda late_s: fits[late_s].signal) for fits in self.by_axis)
        worse = (east[of_east].signal - east[of_north].signal, north[of_north].signal - north[of_east].signal)
        return abs(of_east - of_north) if min(worse) > LEAN.smallest_signal else 0.0


def lean_fits(time_s: FloatArray, enu_m: FloatArray, joined: BoolArray, attitude_deg: FloatArray) -> LeanFits:
    """Fit the accelerations of a track by the lean of its attitudes, and by that of other moments.

    Args:
        time_s: (n,) vehicle time.
        enu_m: (n, 3) positions.
        joined: (n - 1,) legs that were observed.
        attitude_deg: (n, 3) roll, pitch and yaw, NaN if unknown.
    """
    windows = Windows.of(time_s, enu_m, window_s=LEAN.window_s, joined=joined, step_s=FITTED_STEP_S)
    some = np.diff(np.floor(time_s[windows.middle] / LEAN.step_s), prepend=-np.inf) > 0.0
    before, middle, after = windows.before[some], windows.middle[some], windows.after[some]
    velocity, acceleration = windows.velocity_m_s[some, :2], windows.acceleration_m_s2[some, :2]
    half_s = np.maximum(time_s[middle] - time_s[before], time_s[after] - time_s[middle])
    good = (half_s <= LEAN.longest_half_s) & (np.hypot(velocity[:, 0], velocity[:, 1]) > LEAN.least_m_s)
    good &= np.hypot(acceleration[:, 0], acceleration[:, 1]) <= GRAVITY_M_S2 * np.tan(np.radians(MAX_LEAN_DEG))
    thrust = thrust_m_s2(attitude_deg)
    noise_m_s2 = float(
        LEAN.noise_ratio * min(windows.noise_m[0], windows.most_noise_m[0] / NOISE_MEDIANS) / LEAN.window_s**2
    )
    fits: dict[float, LeanFit] = {}
    by_axis: tuple[dict[float, LeanFit], dict[float, LeanFit]] = ({}, {})
    bad: tuple[BadStretch, ...] = ()
    for late_s in _LATE_S:
        lean = mean_over(time_s, thrust, time_s[middle] + late_s, half_s)
        known = good & np.isfinite(lean).all(axis=1) & np.isfinite(attitude_deg[middle, 2])
        if known.sum() < LEAN.enough_windows:
            continue
        at_s, yaw = time_s[middle][known], np.radians(attitude_deg[middle, 2][known])
        a, b = _without_drag(at_s, velocity[known], yaw, acceleration[known], lean[known])
        each = max(1.0, 2.0 * float(np.median(half_s[known])) / max(LEAN.step_s, float(np.median(np.diff(at_s)))))
        fits[float(late_s)] = LeanFit.of(a, b, count=len(a) / each, noise_m_s2=noise_m_s2)
        for axis, of_axis in enumerate(by_axis):
            along, lean_along = a[:, [axis]], b[:, [axis]]
            if np.sqrt((along**2).mean()) > LEAN.least_axis_m_s2:
                of_axis[float(late_s)] = LeanFit.of(along, lean_along, count=len(a) / each, noise_m_s2=noise_m_s2)
        if late_s == 0.0:
            bad = _bad_stretches(at_s, a, b, yaw, each=each, noise_m_s2=noise_m_s2)
    return LeanFits(fits, bad, by_axis)


STRETCHES_S = (40.0, 80.0, 160.0, np.inf)
"""Lengths of the stretches that are tested, each overlapping the next by half."""
MOST_LEAN, LEAST_LEAN = 1.35, 0.7
"""Lean in that of the accelerations, after two standard errors. Honest: 0.80 to 1.26 on the mock, 0.97 to 1.18 in simulations."""


def _bad_stretches(
    time_s: FloatArray, acceleration: FloatArray, lean: FloatArray, yaw: FloatArray, *, each: float, noise_m_s2: float
) -> tuple[BadStretch, ...]:
    """The shortest stretches whose lean contradicts the (k, 2) accelerations: as a vector, ahead, or to the right.

    Lean and acceleration have the same energy, beside gusts and noise. So twice their product in that energy (Lin's concordance)
    is 1, and 0 for an attitude of another time or place. Gusts come and go, so any stretch may have as much of them as is known
    from outside; the noise of the positions comes from the quiet stretches, and is bounded. What a gentle stretch does not tell,
    a longer one does.
    """
    ahead, right = np.column_stack([np.sin(yaw), np.cos(yaw)]), np.column_stack([np.cos(yaw), -np.sin(yaw)])
    found: list[BadStretch] = []
    for name, axes in (("", np.ones((len(yaw), 2))), (" ahead", ahead), (" to the right", right)):
        a, b = (acceleration, lean) if not name else ((v * axes).sum(axis=1)[:, None] for v in (acceleration, lean))
        sums = np.vstack([np.zeros(3), np.cumsum([(a * a).sum(1), (b * b).sum(1), (a * b).sum(1)], axis=1).T])
        gusts, noise = (0.5 * a.shape[1] * rms**2 for rms in (LEAN.gust_lean_m_s2, noise_m_s2))
        first, last = _stretches(time_s, LEAN.quiet_s)
        aa, bb, ab = ((sums[last] - sums[first]) / (last - first)[:, None]).T
        unrelated = float(np.clip(np.percentile(aa + bb - 2.0 * ab, LEAN.quiet_percent), gusts, gusts + noise))
        for length_s in STRETCHES_S:
            if name and length_s < LEAN.axes_from_s:
                continue
            first, last = _stretches(time_s, length_s)
            enough = last - first >= LEAN.enough_windows
            first, last = first[enough], last[enough]
            aa, bb, ab = ((sums[last] - sums[first]) / (last - first)[:, None]).T
            count = np.maximum(1.0, a.shape[1] * (last - first) / each)
            energy = np.maximum(0.5 * (aa + bb - unrelated), 1e-9)
            error = np.sqrt((energy * unrelated + unrelated**2 / 4.0) / count) / energy
            apart = (1.0 - ab / energy) / np.hypot(error, LEAN.model_error) > LEAN.sure_deviations
            whys = np.where(apart, f"the vehicle does not lean{name} as the acceleration requires", "")
            if not name:
                # Gusts and noise make the first slope smaller, and the second larger.
                wide = 1.0 + 2.0 * error
                clear = ~apart & (error < 1.0 / LEAN.sure_deviations) & (ab > 0.0)
                whys = np.where(
                    clear & (ab > MOST_LEAN * wide * aa), "the vehicle leans more than the acceleration explains", whys
                )
                whys = np.where(
                    clear & (bb * wide < LEAST_LEAN * ab), "the vehicle leans less than the acceleration requires", whys
                )
            for k in np.flatnonzero(whys != ""):
                part = BadStretch(float(time_s[first[k]]), float(time_s[last[k] - 1]), str(whys[k]))
                if not any(other.begin_s < part.end_s and part.begin_s < other.end_s for other in found):
                    found.append(part)
    return tuple(sorted(found, key=lambda part: part.begin_s))


def _stretches(time_s: FloatArray, length_s: float) -> tuple[IntArray, IntArray]:
    """First samples, and those after the last, of overlapping stretches; of the whole where it is shorter."""
    length_s = min(length_s, float(time_s[-1] - time_s[0]) + LEAN.step_s)
    begin_s = np.arange(time_s[0], max(time_s[-1] - 0.7 * length_s, time_s[0] + LEAN.step_s), 0.5 * length_s)
    first, last = np.searchsorted(time_s, begin_s), np.searchsorted(time_s, begin_s + length_s)
    return first[last > first], last[last > first]


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
    begin, end = np.maximum(time_s - LEAN.slow_s, time_s[0]), np.minimum(time_s + LEAN.slow_s, time_s[-1])
    means = [
        (np.interp(end, time_s, axis) - np.interp(begin, time_s, axis)) / np.maximum(end - begin, 1e-9)
        for axis in sums.T
    ]
    return np.asarray(values - np.column_stack(means))
