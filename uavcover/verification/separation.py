"""Measure the distances between the vehicles of a fleet, from their tracks; ``tests/naive/separation.py`` tries every moment."""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.model.verdict import Finding, PairSeparation, Violation, fails, unproved
from uavcover.scenario.site import Site
from uavcover.verification.possible_motion import MotionLimits, motion_limits
from uavcover.verification.run_logs import SharedTimes, shared_times
from uavcover.verification.tuning import SAFETY


@dataclass(frozen=True, slots=True)
class Separation:
    """Distances between the vehicles according to their tracks."""

    pairs: tuple[PairSeparation, ...]  # of tracks that overlap in time
    violations: tuple[Violation, ...]  # stretches on which two vehicles were too near to each other
    findings: tuple[Finding, ...]  # why the flight failed, or is not proved


NOT_ASKED = Separation((), (), ())


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
        return NOT_ASKED
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
    a, b = _places(track, times, moments), _places(second, second_times, moments)
    nearest_m, nearest_utc_s = _nearest(a, b, moments)
    least = np.where(pieces, nearest_m, np.inf)
    limits = motion_limits(site.scenario.vehicle, site.scenario.wind)
    slack = _unknown_m(track, times, moments, limits) + _unknown_m(second, second_times, moments, limits)
    possible = least
    for shift_s in np.linspace(-error_s, error_s, SAFETY.shifts):
        possible = np.minimum(possible, _nearest(a, _places(second, second_times, moments + shift_s), moments)[0])
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


def _places(track: Track, times: SharedTimes, moments: FloatArray) -> FloatArray:
    """(n, 3) ENU, where a vehicle was at (n,) moments."""
    return np.column_stack([np.interp(moments, times.taken_utc_s, axis) for axis in track.enu_m.T])


def _stands(track: Track, times: SharedTimes, moments: FloatArray) -> BoolArray:
    """(n,) whether a vehicle has not left the ground yet, or is back on it, at (n,) moments."""

    def near(place_m: FloatArray) -> BoolArray:
        off = track.enu_m - place_m
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
    share = np.clip(-np.einsum("ij,ij->i", begin, change) / np.where(squared > 0.0, squared, np.inf), 0.0, 1.0)
    return np.linalg.norm(begin + share[:, None] * change, axis=1), moments[:-1] + share * np.diff(moments)


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
        place = _places(track, times, nearest_utc_s[k : k + 1])[0]
        lat, lon = (np.zeros(1), np.zeros(1)) if site.frame is None else site.frame.geodetic_from_enu(place)[:2]
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
                east_m=float(place[0]),
                north_m=float(place[1]),
                phase="route",
                worst_utc_s=float(nearest_utc_s[k]),
            )
        )
    return found
