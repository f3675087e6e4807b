"""Two records of one flight are not two flights: their observations must not count twice.

A vehicle that flies a mission again is metres away from its position at the same time of the first flight. Two records of one
flight agree to centimetres throughout, whatever their clocks and rates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.judging.judged_track import JudgedTrack
from uavcover.kernels.arrays import FloatArray

AGREE_M = 0.3
"""Tolerance between logs of one flight: rounding of positions, and interpolation between samples."""
ENOUGH_FRACTION = 0.9
"""Fraction of the time covered by both records that has to agree."""
LEAST_S = 20.0
LEAST_SHARE = 0.25
"""Fraction of the time in which the shorter record moves: less may be a single leg that both flew at the same speed."""

_STEP_S = 0.5
_MOVES_M_S = 1.0
_PROBES = 40
_CANDIDATES = 5
_BIN_S = 0.5
_MAX_GAP_S = 2.5
_NEAR_S = 1.0
"""Shorter than the time between two passes: where one record ends, the pass continues in the other."""


@dataclass(frozen=True, slots=True)
class SameFlight:
    """How two records of one flight agree.

    Attributes:
        duration_s: how long they agree while moving.
        shift_s: seconds to add to the times of the second record.
        median_m: median distance between their positions.
    """

    duration_s: float
    shift_s: float
    median_m: float


def same_flight(one_s: FloatArray, one_m: FloatArray, other_s: FloatArray, other_m: FloatArray) -> SameFlight | None:
    """The agreement of two tracks that record one flight; None for two flights.

    Args:
        one_s: (n,) increasing times of the first.
        one_m: (n, 3) its ENU positions.
        other_s: (k,) increasing times of the second, on a clock of its own.
        other_m: (k, 3) its ENU positions.
    """
    if len(one_s) < 2 or len(other_s) < 2:
        return None
    one, other = _Moving.of(one_s, one_m), _Moving.of(other_s, other_m)
    least_s = max(LEAST_S, LEAST_SHARE * _STEP_S * min(len(one.times_s), len(other.times_s)))
    for shift_s in [0.0, *_likely_shifts_s(one, other)]:
        times_s = other.times_s + shift_s
        both = _observed_at(one_s, times_s)
        duration_s = _STEP_S * float(both.sum())
        if duration_s < least_s:
            continue
        apart_m = np.linalg.norm(_at(one_s, one_m, times_s[both]) - other.places_m[both], axis=1)
        if (apart_m <= AGREE_M).mean() >= ENOUGH_FRACTION:
            return SameFlight(duration_s, shift_s, float(np.median(apart_m)))
    return None


@dataclass(frozen=True, slots=True)
class Records:
    """Two tracks that record one flight.

    Attributes:
        first: number of the first one, from 0.
        second: of the other.
        same: how they agree.
    """

    first: int
    second: int
    same: SameFlight

    def __str__(self) -> str:
        """Description for people."""
        return (
            f"tracks {self.first + 1} and {self.second + 1} are records of one flight: they agree within "
            f"{self.same.median_m:.2f} m (median) for {self.same.duration_s:.0f} s; what both observed counts once"
        )


def records_of_one_flight(judged: Sequence[JudgedTrack]) -> list[Records]:
    """For each track the first earlier one that records the same flight."""
    records = []
    for second, other in enumerate(judged):
        for first, one in enumerate(judged[:second]):
            same = same_flight(one.track.time_s, one.enu_m, other.track.time_s, other.enu_m)
            if same is not None:
                records.append(Records(first, second, same))
                break
    return records


def has_near(times_s: FloatArray, asked_s: FloatArray) -> NDArray[np.bool_]:
    """(k,) whether each of (k,) times has one of (n,) increasing times near it."""
    if times_s.size == 0:
        return np.zeros(asked_s.shape, dtype=bool)
    after = np.searchsorted(times_s, asked_s)
    before_s, after_s = times_s[np.maximum(after - 1, 0)], times_s[np.minimum(after, times_s.size - 1)]
    return np.asarray(np.minimum(np.abs(asked_s - before_s), np.abs(after_s - asked_s)) <= _NEAR_S)


def _observed_at(time_s: FloatArray, times_s: FloatArray) -> NDArray[np.bool_]:
    """Which of (k,) times lie between two of (n,) samples close to each other in time."""
    after = np.clip(np.searchsorted(time_s, times_s), 1, len(time_s) - 1)
    inside = (times_s >= time_s[0]) & (times_s <= time_s[-1])
    return np.asarray(inside & (time_s[after] - time_s[after - 1] <= _MAX_GAP_S))


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """Positions of a track at regular times while it moves."""

    times_s: FloatArray
    places_m: FloatArray
    velocities_m_s: FloatArray

    @classmethod
    def of(cls, time_s: FloatArray, enu_m: FloatArray) -> "_Moving":
        times_s = np.arange(time_s[0], time_s[-1], _STEP_S)
        times_s = times_s[_observed_at(time_s, times_s) & _observed_at(time_s, times_s + _STEP_S)]
        places_m = _at(time_s, enu_m, times_s)
        velocities_m_s = (_at(time_s, enu_m, times_s + _STEP_S) - places_m) / _STEP_S
        moves = np.hypot(velocities_m_s[:, 0], velocities_m_s[:, 1]) > _MOVES_M_S
        return cls(times_s[moves], places_m[moves], velocities_m_s[moves])


def _at(time_s: FloatArray, enu_m: FloatArray, times_s: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(times_s, time_s, axis) for axis in enu_m.T])


def _likely_shifts_s(one: _Moving, other: _Moving) -> list[float]:
    """Clock shifts for which most of some sampled positions of the second track coincide with the first."""
    if not (len(one.times_s) and len(other.times_s)):
        return []
    found: list[FloatArray] = []
    for probe in np.unique(np.linspace(0, len(other.times_s) - 1, _PROBES).astype(int)):
        off_m = other.places_m[probe] - one.places_m
        # Nearest approach within each half second of the first track.
        speed2 = (one.velocities_m_s**2).sum(axis=1)
        along_s = np.clip((off_m * one.velocities_m_s).sum(axis=1) / speed2, 0.0, _STEP_S)
        near = np.linalg.norm(off_m - along_s[:, None] * one.velocities_m_s, axis=1) <= AGREE_M
        found.append((one.times_s + along_s - other.times_s[probe])[near])
    shifts_s = np.concatenate(found)
    if not shifts_s.size:
        return []
    _, inverse, votes = np.unique(np.round(shifts_s / _BIN_S), return_inverse=True, return_counts=True)
    best = np.argsort(-votes, kind="stable")[:_CANDIDATES]
    return [float(np.median(shifts_s[inverse == k])) for k in best]
