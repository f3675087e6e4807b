"""The verdict on a flight: one track, or several that count together.

Two records of one flight are not two flights: their observations must not count twice. A vehicle that flies a mission again
is metres away from its position at the same time of the first flight. Two records of one flight agree to centimetres
throughout, whatever their clocks and rates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.judging.decision import cell_statistics, coverage_by_time, decide, judged_requirements
from uavcover.judging.flown_coverage import (
    FlownCoverage,
    count_observations,
    joined_observations,
    joining_shifts_s,
    seen_by_any,
)
from uavcover.judging.gaps import GapRegion, find_gaps
from uavcover.judging.judged_track import JudgedTrack, judge_track, largest, track_positions_m
from uavcover.judging.observations import Observations
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.photos.evidence import NOTHING_KNOWN, PictureEvidence
from uavcover.judging.separation import judge_separation
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.observation_counting import SensorPoses
from uavcover.model.active_times import Window, flown_window, window_in_words
from uavcover.model.outline import svg_map
from uavcover.model.track import Track
from uavcover.model.verdict import PictureStatistics, VerificationReport
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, judging_map
from uavcover.sensing.pictures import (
    OVERLAP_FRACTION,
    PictureCounts,
    count_pictures,
    picture_statistics,
    takes_pictures,
)

CountObservations = Callable[[CoverageMap, Observations], FlownCoverage]
"""Counts every observation of every cell of the area."""

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


__all__ = ["FlownTrack", "Verdict", "flown_coverage", "track_positions_m", "verify_flight", "verify_track"]


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrack:
    """A track and the plan it followed.

    Attributes:
        track: the flown track.
        planned: its plan, if any.
        site: of its vehicle, where the vehicles differ: the same ground, another home; none: that of all.
    """

    track: Track
    planned: PlannedRoute | None = None
    site: Site | None = None


_DRAWN_CELLS = 2000
"""Of a gap in a notebook's map."""


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """The complete result of verification.

    Attributes:
        coverage: the cells that were judged.
        report: decision and figures.
        flown: coverage by cell.
        gaps: the coverage gaps and their cells.
        pictures: how many pictures show each cell; none for a sensor that takes no single pictures.
        observations: all observations of the flight, in order of time, each once.
        shifts_s: seconds added to the vehicle times of each track to put all on one clock, which ``flown`` and the report's
            ``coverage_by_time`` use.
    """

    coverage: CoverageMap
    report: VerificationReport
    flown: FlownCoverage
    gaps: tuple[GapRegion, ...]
    pictures: PictureCounts | None
    observations: Observations
    shifts_s: tuple[float, ...]

    def __repr__(self) -> str:
        r = self.report
        return (
            f"<Verdict: {r.verdict}; {100.0 * r.coverage_fraction:.2f} % of the area and "
            f"{100.0 * r.coverage_of_coverable:.2f} % of what can be seen; {len(r.gaps)} gaps, {len(r.violations)} violations>"
        )

    def _repr_html_(self) -> str:
        cells, area = self.coverage.grid.cells, self.coverage.site.area
        corners = cells.size_m / 2.0 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        parts = [area] if isinstance(area, shapely.Polygon) else list(area.geoms)
        shapes = [("area", np.array(part.exterior.coords)) for part in parts]
        middles = self.coverage.grid.middles_m
        shapes += [("gap", middles[cell] + corners) for region in self.gaps for cell in region.cells[:_DRAWN_CELLS]]
        return svg_map(shapes, repr(self)[1:-1])


def flown_coverage(coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> FlownCoverage:
    """Coverage of a track between its first and last planned waypoint.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    site = coverage.site
    return count_observations(coverage, judge_track(site, track, planned).observations(site))


def verify_track(site: Site, coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> VerificationReport:
    """Verify one track; see :func:`verify_flight`."""
    return verify_flight(site, coverage, [FlownTrack(track, planned)]).report


def verify_flight(
    site: Site,
    coverage: CoverageMap,
    tracks: Sequence[FlownTrack],
    *,
    evidence: PictureEvidence = NOTHING_KNOWN,
    count: CountObservations = count_observations,
) -> Verdict:
    """Verify coverage and safety from the flown tracks alone; plans serve for comparison only.

    Several tracks, of several sorties or vehicles, count as one flight: a cell seen by any of them is seen, and each has to
    keep the limits. Observations present in two records of one flight count once.

    Args:
        site: the scenario on its ground.
        coverage: on the cells that results are judged on.
        tracks: at least one, the first with the plan whose coverage was promised.
        evidence: of real pictures; where they tell no coverage, it follows from the tracks.
        count: who counts the observations.

    Raises:
        TrackError: a track is empty, or has a position that is not on Earth.
    """
    judged = [judge_track(flown.site or site, flown.track, flown.planned) for flown in tracks]
    records = _records_of_one_flight(judged)
    # The pause is longer than the time between two passes, so each track's observations are separate passes.
    pause_s = 2.0 * site.scenario.requirements.max_gap_s
    same_clock = {record.second: (record.first, record.same.shift_s) for record in records}
    shifts_s = joining_shifts_s([flown.track.time_s for flown in tracks], pause_s=pause_s, same_clock=same_clock)
    parts = [track.observations(flown.site or site) for track, flown in zip(judged, tracks, strict=True)]
    for record in records:
        first, observations = parts[record.first], parts[record.second]
        told = has_near(first.times_s[first.known], observations.times_s + record.same.shift_s)
        parts[record.second] = observations.where(~told)
    together = joined_observations(parts, shifts_s)
    eyes = _eyes(coverage, tracks)
    if evidence.shown is not None:
        flown = evidence.shown
    elif len(eyes) == 1:
        flown = count(eyes[0][0], together)
    else:
        flown = seen_by_any(
            [count(eye, joined_observations([parts[k] for k in who], [shifts_s[k] for k in who])) for eye, who in eyes]
        )
    gaps = tuple(find_gaps(coverage, flown))
    unknown_looks = int((~together.known).sum()) if evidence.shown is None else 0
    pictures = evidence.counts
    if evidence.shown is None and len(eyes) == 1 and takes_pictures(eyes[0][0].site.scenario):
        pictures = _pictures(eyes[0][0], together)
    statistics = None if pictures is None else picture_statistics(eyes[0][0], pictures)
    window = flown_window(np.concatenate([j.track.unix_time_s for j in judged]))
    separation = judge_separation(
        site, [track.track for track in judged], same_flight={(record.first, record.second) for record in records}
    )
    decision = decide(
        coverage, flown, judged, pictures,
        unknown_attitude_looks=unknown_looks, evidence=evidence, separation=separation, eyes=[eye for eye, _ in eyes],
    )  # fmt: skip
    report = VerificationReport(
        coverage_fraction=coverage.share(flown.seen),
        coverage_of_coverable=coverage.share_of_coverable(flown.seen),
        surely_covered_fraction=coverage.share(flown.surely_seen),
        surely_covered_of_coverable=coverage.share_of_coverable(flown.surely_seen),
        possibly_covered_fraction=coverage.share(flown.possibly_seen),
        planned_coverage_fraction=None if tracks[0].planned is None else tracks[0].planned.coverage_fraction,
        min_height_agl_m=_smallest([j.heights.lowest.values[j.phases.route] for j in judged]),
        max_height_agl_m=_largest([j.heights.highest.values[j.phases.route] for j in judged]),
        min_transit_clearance_m=_smallest([j.heights.lowest.values[j.phases.transit] for j in judged]),
        max_transit_height_agl_m=_largest([j.heights.highest.values[~j.phases.route] for j in judged]),
        violations=tuple(
            replace(violation, track=number) for number, j in enumerate(judged) for violation in j.violations
        )
        + separation.violations,
        max_deviation_m=_largest([j.deviations_m for j in judged if j.deviations_m is not None]),
        max_ground_speed_m_s=_largest([j.speeds_m_s[j.phases.route] for j in judged]),
        gaps=tuple(region.gap for region in gaps),
        cells=cell_statistics(coverage, flown),
        pictures=statistics,
        coverage_by_time=() if evidence.shown is not None else coverage_by_time(coverage, flown, together.times_s),
        samples=sum(len(flown.track) for flown in tracks),
        unknown_attitude_looks=unknown_looks,
        unobserved=decision.unobserved,
        unobserved_s=sum(stretch.duration_s for stretch in decision.unobserved if stretch.in_flight),
        unobserved_m=sum(stretch.length_m for stretch in decision.unobserved if stretch.in_flight),
        unobserved_route_fraction=decision.unobserved_route_fraction,
        verdict=decision.verdict,
        passed=decision.verdict == "passed",
        reasons=decision.reasons,
        doubts=decision.doubts,
        findings=(
            *decision.findings,
            *map(str, records),
            *_overlap_findings(site, statistics),
            *_time_findings(site, window),
        ),
        requirements=judged_requirements(site.scenario),
        flown_utc=None if window is None else (window[0].isoformat(), window[1].isoformat()),
        separation=separation.pairs,
    )
    return Verdict(coverage, report, flown, gaps, pictures, together, shifts_s)


def _eyes(coverage: CoverageMap, tracks: Sequence[FlownTrack]) -> list[tuple[CoverageMap, list[int]]]:
    """The cells as each sensor that flew sees them, with the numbers of the tracks that it flew on."""
    sensors: list[tuple[CoverageMap, list[int]]] = []
    for number, flown in enumerate(tracks):
        own = flown.site or coverage.site
        for eye, numbers in sensors:
            if eye.site.scenario.sensor == own.scenario.sensor:
                numbers.append(number)
                break
        else:
            same = own.scenario.sensor == coverage.site.scenario.sensor
            sensors.append((coverage if same else judging_map(own), [number]))
    return sensors


def _time_findings(site: Site, window: Window | None) -> list[str]:
    """What the time of day means for the no-fly zones with times."""
    timed = sum(zone.entry.has_times for zone in (*site.zones, *site.other_zones))
    if not timed:
        return []
    planned = site.scenario.flight_window
    if window is None:
        judged = "as in force all the time" if planned is None else "as in flight_window_utc"
        return [f"the track does not tell the time of day: {timed} no-fly zones with times are judged {judged}"]
    if planned is None or (planned[0] <= window[0] and window[1] <= planned[1]):
        return []
    return [
        f"flown from {window_in_words(window)}, planned for {window_in_words(planned)}: the no-fly zones that were in force when "
        "it was flown are judged"
    ]


def _pictures(coverage: CoverageMap, together: Observations) -> PictureCounts:
    """Pictures whose direction is known; the others show nothing for certain."""
    known = together.where(together.known)
    return count_pictures(coverage, SensorPoses(known.places_m, known.axes, known.tops, known.times_s))


def _overlap_findings(site: Site, pictures: PictureStatistics | None) -> list[str]:
    """Overlap that does not hold, where nothing requires it."""
    if pictures is None or pictures.overlap_fraction is None or pictures.overlap_holds:
        return []
    if site.scenario.requirements.min_overlap_fraction is not None:
        return []
    return [
        f"the overlap asked for, {pictures.asked} pictures of every point, holds on {100.0 * pictures.overlap_fraction:.2f} % of "
        f"the area as drawn, less than {100.0 * OVERLAP_FRACTION:g} %"
    ]


@dataclass(frozen=True, slots=True)
class _Records:
    """Two tracks, by index, that record one flight."""

    first: int
    second: int
    same: SameFlight

    def __str__(self) -> str:
        """Description for people."""
        return (
            f"tracks {self.first + 1} and {self.second + 1} are records of one flight: they agree within "
            f"{self.same.median_m:.2f} m (median) for {self.same.duration_s:.0f} s; what both observed counts once"
        )


def _records_of_one_flight(judged: Sequence[JudgedTrack]) -> list[_Records]:
    """For each track the first earlier one that records the same flight."""
    records = []
    for second, other in enumerate(judged):
        for first, one in enumerate(judged[:second]):
            same = same_flight(one.track.time_s, one.enu_m, other.track.time_s, other.enu_m)
            if same is not None:
                records.append(_Records(first, second, same))
                break
    return records


def _smallest(parts: Sequence[FloatArray]) -> float | None:
    known = largest(-np.concatenate(parts))
    return None if known is None else -known


def _largest(parts: Sequence[FloatArray]) -> float | None:
    return largest(np.concatenate(parts) if parts else None)
