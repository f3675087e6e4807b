"""Tracks of several flights: which record the same flight, and how far the vehicles were from each other.

Two records of one flight are recognised with any clocks and rates, so that observations do not count twice.
``tests/naive/separation.py`` tries every moment.
"""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mission_io.data_tables import data_table
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.model.verdict import Finding, PairSeparation, Violation, fails, unproved
from uavcover.scenario.site import Site
from uavcover.verification.flown_route import SAFETY
from uavcover.verification.judged_track import JudgedTrack
from uavcover.verification.possible_motion import MotionLimits, motion_limits
from uavcover.verification.run_logs import SharedTimes, shared_times


@dataclass(frozen=True, slots=True, kw_only=True)
class _SameFlight:
    agree_m: float
    receiver_m: float
    one_vehicle_m: float
    percentile: float
    enough_fraction: float
    least_s: float
    least_fraction: float
    step_s: float
    moves_m_s: float
    probes: int
    candidates: int
    bin_s: float
    max_gap_s: float
    near_s: float


SAME_FLIGHT = data_table(_SameFlight, "uavcover/data/verification.toml", "same_flight")


@dataclass(frozen=True, slots=True)
class SameFlight:
    """Agreement of two records of one flight."""

    duration_s: float  # duration of their agreement while moving
    shift_s: float  # seconds to add to the times of the second record
    median_m: float  # median distance between their positions
    aside_m: float  # horizontal distance, less most of the time
    above_m: float  # difference in height, less most of the time

    @property
    def disagrees(self) -> bool:
        """Whether they differ by more than rounding."""
        return max(self.aside_m, self.above_m) > SAME_FLIGHT.agree_m


def same_flight(one: Track, one_m: FloatArray, other: Track, other_m: FloatArray) -> SameFlight | None:
    """The agreement of two tracks that record one flight; None for two flights.

    Tracks that overlap in time, or have the same time stamps, are of one flight where they are nearer to each other than two
    vehicles fly. Where no common time is known, the places decide: a vehicle that flies a mission again is not within the errors
    of a receiver of where it was at the same time. Where the times exclude one another, only a copy is one flight.

    Args:
        one: the first track.
        one_m: (n, 3) its ENU positions.
        other: the second one.
        other_m: (k, 3) its ENU positions.
    """
    if len(one) < 2 or len(other) < 2:
        return None
    common = common_time(one, other)
    shifts_s: list[tuple[float, float]] = []
    excluded = common is not None and not common.overlaps
    if common is not None and common.overlaps:
        shifts_s.append((common.shift_s, SAME_FLIGHT.one_vehicle_m))
    if not excluded and _same_stamps(one.time_s, other.time_s):
        shifts_s.append((0.0, SAME_FLIGHT.one_vehicle_m))
    near_m = SAME_FLIGHT.agree_m if excluded else SAME_FLIGHT.receiver_m
    first, second = _Moving.of(one.time_s, one_m), _Moving.of(other.time_s, other_m)
    shifts_s += [(shift_s, near_m) for shift_s in [0.0, *_likely_shifts_s(first, second, near_m)]]
    least_s = max(
        SAME_FLIGHT.least_s,
        SAME_FLIGHT.least_fraction * SAME_FLIGHT.step_s * min(len(first.times_s), len(second.times_s)),
    )
    for shift_s, within_m in shifts_s:
        times_s = second.times_s + shift_s
        both = _observed_at(one.time_s, times_s)
        duration_s = SAME_FLIGHT.step_s * float(both.sum())
        if duration_s < least_s:
            continue
        off_m = _at(one.time_s, one_m, times_s[both]) - second.positions_m[both]
        apart_m = np.linalg.norm(off_m, axis=1)
        if (apart_m <= within_m).mean() >= SAME_FLIGHT.enough_fraction:
            aside_m, above_m = np.hypot(off_m[:, 0], off_m[:, 1]), np.abs(off_m[:, 2])
            return SameFlight(
                duration_s, shift_s, float(np.median(apart_m)),
                float(np.percentile(aside_m, SAME_FLIGHT.percentile)), float(np.percentile(above_m, SAME_FLIGHT.percentile)),
            )  # fmt: skip
    return None


@dataclass(frozen=True, slots=True)
class CommonTime:
    """Relation of the times of two tracks."""

    overlaps: bool  # whether both were recorded at the same time for a while
    shift_s: float  # seconds to add to the times of the second to get those of the first


def common_time(one: Track, other: Track) -> CommonTime | None:
    """The time that two tracks share: arrival times of positions, otherwise satellite time; None without either."""
    for name in ("received_utc_s", "unix_time_s"):
        utc = [getattr(track, name) for track in (one, other)]
        known = [np.isfinite(each) for each in utc]
        if not all(each.sum() >= 2 and (np.diff(at[each]) >= 0.0).all() for each, at in zip(known, utc, strict=True)):
            continue
        (first, second), (one_s, other_s) = (
            [at[each] for each, at in zip(known, utc, strict=True)],
            [track.time_s[each] for each, track in zip(known, (one, other), strict=True)],
        )
        inside = (second >= first[0]) & (second <= first[-1])
        if not inside.any():
            return CommonTime(False, 0.0)
        shifts_s = np.interp(second[inside], first, one_s) - other_s[inside]
        return CommonTime(float(np.ptp(other_s[inside])) >= SAME_FLIGHT.least_s, float(np.median(shifts_s)))
    return None


def _same_stamps(one_s: FloatArray, other_s: FloatArray) -> bool:
    """Whether nearly all times of the shorter track are times of the other, to the digit."""
    shared = np.intersect1d(one_s, other_s).size
    return bool(shared >= SAME_FLIGHT.enough_fraction * min(len(one_s), len(other_s)))


@dataclass(frozen=True, slots=True)
class Records:
    """Two tracks that record one flight."""

    first: int  # number of the first one, from 0
    second: int  # of the other
    same: SameFlight  # how they agree

    def __str__(self) -> str:
        """Description as text."""
        text = (
            f"tracks {self.first + 1} and {self.second + 1} are records of one flight: they agree within "
            f"{self.same.median_m:.2f} m (median) for {self.same.duration_s:.0f} s; observations in both count once"
        )
        if not self.same.disagrees:
            return text
        return (
            f"{text}; they disagree by up to {self.same.aside_m:.1f} m horizontally and {self.same.above_m:.1f} m in "
            f"height ({SAME_FLIGHT.percentile:g} % of the time by less), so the positions are at least this uncertain"
        )


def records_of_one_flight(judged: Sequence[JudgedTrack]) -> list[Records]:
    """For each track the first earlier one that records the same flight."""
    records = []
    for second, other in enumerate(judged):
        for first, one in enumerate(judged[:second]):
            same = same_flight(one.track, one.enu_m, other.track, other.enu_m)
            if same is not None:
                records.append(Records(first, second, same))
                break
    return records


def at_two_positions(judged: Sequence[JudgedTrack], records: Sequence[Records]) -> list[str]:
    """Overlapping tracks of one vehicle that are different flights, one line each."""
    same = {(record.first, record.second) for record in records}
    found = []
    for second, other in enumerate(judged):
        for first, one in enumerate(judged[:second]):
            common = None if (first, second) in same else common_time(one.track, other.track)
            if common is not None and common.overlaps:
                found.append(
                    f"tracks {first + 1} and {second + 1} overlap in time at different positions, so one vehicle "
                    "cannot have flown both; if there were several vehicles, set fleet.vehicles"
                )
    return found


def has_near(times_s: FloatArray, requested_s: FloatArray) -> NDArray[np.bool_]:
    """(k,) whether each of (k,) times has one of (n,) increasing times near it."""
    if times_s.size == 0:
        return np.zeros(requested_s.shape, dtype=bool)
    after = np.searchsorted(times_s, requested_s)
    before_s, after_s = times_s[np.maximum(after - 1, 0)], times_s[np.minimum(after, times_s.size - 1)]
    return np.asarray(np.minimum(np.abs(requested_s - before_s), np.abs(after_s - requested_s)) <= SAME_FLIGHT.near_s)


def _observed_at(time_s: FloatArray, times_s: FloatArray) -> NDArray[np.bool_]:
    """Select those of (k,) times that lie between two of (n,) samples close to each other in time."""
    after = np.clip(np.searchsorted(time_s, times_s), 1, len(time_s) - 1)
    inside = (times_s >= time_s[0]) & (times_s <= time_s[-1])
    return np.asarray(inside & (time_s[after] - time_s[after - 1] <= SAME_FLIGHT.max_gap_s))


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """Positions of a track at regular times while it moves."""

    times_s: FloatArray
    positions_m: FloatArray
    velocities_m_s: FloatArray

    @classmethod
    def of(cls, time_s: FloatArray, enu_m: FloatArray) -> "_Moving":
        times_s = np.arange(time_s[0], time_s[-1], SAME_FLIGHT.step_s)
        times_s = times_s[_observed_at(time_s, times_s) & _observed_at(time_s, times_s + SAME_FLIGHT.step_s)]
        positions_m = _at(time_s, enu_m, times_s)
        velocities_m_s = (_at(time_s, enu_m, times_s + SAME_FLIGHT.step_s) - positions_m) / SAME_FLIGHT.step_s
        moves = np.hypot(velocities_m_s[:, 0], velocities_m_s[:, 1]) > SAME_FLIGHT.moves_m_s
        return cls(times_s[moves], positions_m[moves], velocities_m_s[moves])


def _at(time_s: FloatArray, enu_m: FloatArray, times_s: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(times_s, time_s, axis) for axis in enu_m.T])


def _likely_shifts_s(one: _Moving, other: _Moving, near_m: float) -> list[float]:
    """Clock shifts for which most of some sampled positions of the second track coincide with the first."""
    if not (len(one.times_s) and len(other.times_s)):
        return []
    found: list[FloatArray] = []
    for probe in np.unique(np.linspace(0, len(other.times_s) - 1, SAME_FLIGHT.probes).astype(int)):
        off_m = other.positions_m[probe] - one.positions_m
        # Nearest approach within each half second of the first track.
        speed2 = (one.velocities_m_s**2).sum(axis=1)
        along_s = np.clip((off_m * one.velocities_m_s).sum(axis=1) / speed2, 0.0, SAME_FLIGHT.step_s)
        near = np.linalg.norm(off_m - along_s[:, None] * one.velocities_m_s, axis=1) <= near_m
        found.append((one.times_s + along_s - other.times_s[probe])[near])
    shifts_s = np.concatenate(found)
    if not shifts_s.size:
        return []
    _, inverse, votes = np.unique(np.round(shifts_s / SAME_FLIGHT.bin_s), return_inverse=True, return_counts=True)
    best = np.argsort(-votes, kind="stable")[: SAME_FLIGHT.candidates]
    return [float(np.median(shifts_s[inverse == k])) for k in best]


@dataclass(frozen=True, slots=True)
class Separation:
    """Distances between the vehicles according to their tracks."""

    pairs: tuple[PairSeparation, ...]  # of tracks that overlap in time
    violations: tuple[Violation, ...]  # stretches on which two vehicles were too near to each other
    findings: tuple[Finding, ...]  # why the flight failed, or is not proved


NOT_REQUIRED = Separation((), (), ())


def judge_separation(
    site: Site, tracks: Sequence[Track], *, same_flight: Collection[tuple[int, int]] = ()
) -> Separation:
    """Judge the distances between all vehicles that were in the air at the same time.

    Args:
        site: the scenario on its ground, with the required separation.
        tracks: what each flight recorded.
        same_flight: pairs of tracks, by number, that record one flight.
    """
    if site.scenario.fleet.vehicles == 1 or len(tracks) < 2:
        return NOT_REQUIRED
    shared = [shared_times(track) for track in tracks]
    without = [number + 1 for number, times in enumerate(shared) if times is None]
    doubts = []
    if without:
        listed = ", ".join(map(str, without))
        doubts.append(f"the separation is unknown: track {listed} does not record when its positions arrived")
    pairs: list[PairSeparation] = []
    violations: list[Violation] = []
    for a, b in itertools.combinations(range(len(tracks)), 2):
        one, other = shared[a], shared[b]
        if one is None or other is None or (a, b) in same_flight or (b, a) in same_flight:
            continue
        found = _judge_pair(site, (tracks[a], one), (tracks[b], other))
        if found is None:
            continue
        pair, stretches = found
        pairs.append(replace(pair, first=a, second=b))
        violations += [replace(stretch, track=a, other_track=b) for stretch in stretches]
    limit_m = site.scenario.fleet.separation_m
    reasons = [
        f"tracks {pair.first + 1} and {pair.second + 1}: {pair.least_m:.1f} m apart at {pair.first_s:.1f} s of the "
        f"first, but fleet.separation_m is {limit_m:g} m"
        for pair in pairs
        if pair.least_m < limit_m
    ]
    doubts += [
        f"tracks {pair.first + 1} and {pair.second + 1}: {pair.least_m:.1f} m apart according to their clocks, but "
        f"possibly {max(pair.possibly_m, 0.0):.1f} m; fleet.separation_m is {limit_m:g} m"
        for pair in pairs
        if pair.possibly_m < limit_m <= pair.least_m
    ]
    findings = [*(fails("separation", text) for text in reasons), *(unproved("separation", text) for text in doubts)]
    return Separation(tuple(pairs), tuple(violations), tuple(findings))


def _judge_pair(
    site: Site, one: tuple[Track, SharedTimes], other: tuple[Track, SharedTimes]
) -> tuple[PairSeparation, list[Violation]] | None:
    """Judge one pair of tracks. None when they do not overlap in time, or one vehicle always stands while the other does."""
    fleet = site.scenario.fleet
    (track, times), (second, second_times) = one, other
    pace = max(times.pace, second_times.pace)
    error_s = fleet.clock_error_s * pace
    begin = max(times.taken_utc_s[0], second_times.taken_utc_s[0])
    end = min(times.taken_utc_s[-1], second_times.taken_utc_s[-1])
    if not begin < end:
        return None
    moments = np.unique(np.concatenate([[begin, end], times.taken_utc_s, second_times.taken_utc_s]))
    moments = moments[(moments >= begin) & (moments <= end)]
    aloft = ~(_stands(track, times, moments) & _stands(second, second_times, moments))
    pieces = aloft[:-1] | aloft[1:]
    if not pieces.any():
        return None
    a, b = _positions(track, times, moments), _positions(second, second_times, moments)
    nearest_m, nearest_utc_s = _nearest(a, b, moments)
    least = np.where(pieces, nearest_m, np.inf)
    limits = motion_limits(site.scenario.vehicle, site.scenario.wind)
    slack = _unknown_m(track, times, moments, limits) + _unknown_m(second, second_times, moments, limits)
    possible = least
    for shift_s in np.linspace(-error_s, error_s, SAFETY.shifts):
        possible = np.minimum(possible, _nearest(a, _positions(second, second_times, moments + shift_s), moments)[0])
    # Between two shifts that are tried the other vehicle moves on by half their distance at most.
    between_m = limits.speed_m_s * (error_s / pace) / (SAFETY.shifts - 1) if fleet.clock_error_s > 0.0 else 0.0
    possible = np.where(pieces, possible - slack, np.inf) - between_m - 2.0 * site.scenario.uncertainty.position_m
    k = int(np.argmin(least))
    pair = PairSeparation(
        first=0,
        second=1,
        least_m=float(least[k]),
        possibly_m=float(possible.min()),
        utc_s=float(nearest_utc_s[k]),
        first_s=float(np.interp(nearest_utc_s[k], times.taken_utc_s, track.time_s)),
        second_s=float(np.interp(nearest_utc_s[k], second_times.taken_utc_s, second.time_s)),
        together_s=float((end - begin) / pace),
    )
    return pair, _stretches(site, track, times, moments, (least, nearest_utc_s))


def _positions(track: Track, times: SharedTimes, moments: FloatArray) -> FloatArray:
    """(n, 3) ENU, where a vehicle was at (n,) moments."""
    return np.column_stack([np.interp(moments, times.taken_utc_s, axis) for axis in track.enu_m.T])


def _stands(track: Track, times: SharedTimes, moments: FloatArray) -> BoolArray:
    """(n,) whether a vehicle is on the ground at (n,) moments, before take-off or after landing."""

    def near(position_m: FloatArray) -> BoolArray:
        off = track.enu_m - position_m
        return np.asarray((np.hypot(off[:, 0], off[:, 1]) <= SAFETY.ground_m) & (np.abs(off[:, 2]) <= SAFETY.ground_m))

    before, after = near(track.enu_m[0]), near(track.enu_m[-1])
    leaves = len(track) if before.all() else int(np.argmin(before))
    returns = 0 if after.all() else len(track) - int(np.argmin(after[::-1]))
    leaves_s = times.taken_utc_s[min(leaves, len(track) - 1)]
    returns_s = times.taken_utc_s[min(returns, len(track) - 1)]
    return np.asarray((moments < leaves_s) | (moments > returns_s))


def _nearest(a: FloatArray, b: FloatArray, moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n - 1,) least distances between two bodies that move evenly between (n, 3) positions, and their moments."""
    begin, change = (a - b)[:-1], np.diff(a - b, axis=0)
    squared = np.einsum("ij,ij->i", change, change)
    fraction = np.clip(-np.einsum("ij,ij->i", begin, change) / np.where(squared > 0.0, squared, np.inf), 0.0, 1.0)
    return np.linalg.norm(begin + fraction[:, None] * change, axis=1), moments[:-1] + fraction * np.diff(moments)


def _unknown_m(track: Track, times: SharedTimes, moments: FloatArray, limits: MotionLimits) -> FloatArray:
    """(n - 1,) possible metres beside the straight line between moments, where a vehicle's samples are rare."""
    after = np.clip(np.searchsorted(times.taken_utc_s, moments, side="right"), 1, len(track) - 1)
    gaps_s = np.diff(track.time_s)[after - 1]
    reach_m = np.where(
        gaps_s > SAFETY.separation_longest_s, 0.5 * gaps_s * np.hypot(limits.speed_m_s, limits.climb_m_s), 0.0
    )
    return np.asarray(np.maximum(reach_m[:-1], reach_m[1:]))


def _stretches(
    site: Site, track: Track, times: SharedTimes, moments: FloatArray, nearest: tuple[FloatArray, FloatArray]
) -> list[Violation]:
    """The stretches on which two vehicles were too near, as violations of the first one's track."""
    least, nearest_utc_s = nearest
    limit_m = site.scenario.fleet.separation_m
    near = np.concatenate([[False], least < limit_m, [False]])
    edges = np.flatnonzero(np.diff(near.astype(int)))
    found = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        k = first + int(np.argmin(least[first:last]))
        start_s, end_s, worst_s = (
            float(np.interp(utc_s, times.taken_utc_s, track.time_s))
            for utc_s in (moments[first], moments[last], nearest_utc_s[k])
        )
        position = _positions(track, times, nearest_utc_s[k : k + 1])[0]
        lat, lon = (np.zeros(1), np.zeros(1)) if site.frame is None else site.frame.geodetic_from_enu(position)[:2]
        found.append(
            Violation(
                kind="separation",
                start_s=start_s,
                end_s=end_s,
                worst_s=worst_s,
                worst=float(least[k]),
                limit=limit_m,
                excess=limit_m - float(least[k]),
                unit="m",
                lat_deg=float(lat[0]),
                lon_deg=float(lon[0]),
                east_m=float(position[0]),
                north_m=float(position[1]),
                phase="route",
                worst_utc_s=float(nearest_utc_s[k]),
            )
        )
    return found
