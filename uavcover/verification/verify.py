"""The verdict on a flight: one track, or several that count together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.observation_counting import SensorPoses
from uavcover.model.area import svg_map
from uavcover.model.limits import Window, flown_window, window_text
from uavcover.model.track import Track
from uavcover.model.verdict import Judgement, PhotoSource, PhotoStatistics, VerificationReport, noted, unproved
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import (
    OVERLAP_FRACTION,
    PhotoCounts,
    count_photos,
    drawn_cells,
    look_distance_m,
    looks_of,
    overlap_shortfall,
    photo_statistics,
    takes_photos,
)
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.decision import decide, judged_requirements
from uavcover.verification.flown_coverage import (
    NOTHING_KNOWN,
    CountObservations,
    FlownCoverage,
    PhotoEvidence,
    cell_statistics,
    count_observations,
    coverage_by_time,
    joined_observations,
    joining_shifts_s,
    observed_by_any,
)
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.gaps import GapRegion, find_gaps
from uavcover.verification.judged_track import JudgedTrack, judge_track, largest
from uavcover.verification.observations import Observations, reports_photos
from uavcover.verification.run_logs import UNKNOWN_DATES, DateBounds, clocks_apart, dated
from uavcover.verification.several_flights import (
    Records,
    at_two_positions,
    has_near,
    judge_separation,
    records_of_one_flight,
)


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrack:
    """A track and the plan it followed."""

    track: Track  # the flown track
    planned: PlannedRoute | None = None  # its plan, if any
    # of its vehicle, where the vehicles differ: the same ground, another home; None: that of all
    site: Site | None = None
    dates: DateBounds = UNKNOWN_DATES  # between what its date lies


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """The complete result of verification.

    Attributes:
        coverage: the cells that were judged.
        report: decision and figures.
        flown: coverage by cell.
        gaps: the coverage gaps and their cells.
        photos: how many photos show each cell; None for a sensor that takes no single photos.
        observations: all observations of the flight, in order of time, each once.
        shifts_s: seconds added to the vehicle times of each track to put all on one clock, which ``flown`` and the report's
            ``coverage_by_time`` use.
    """

    coverage: CoverageMap
    report: VerificationReport
    flown: FlownCoverage
    gaps: tuple[GapRegion, ...]
    photos: PhotoCounts | None
    observations: Observations
    shifts_s: tuple[float, ...]

    def __repr__(self) -> str:
        r = self.report
        return (
            f"<Verdict: {r.verdict}; {100.0 * r.coverage_fraction:.2f} % of the area and "
            f"{100.0 * r.coverage_of_coverable:.2f} % of the visible ground; {counted(len(r.gaps), 'gap')}, "
            f"{counted(len(r.violations), 'violation')}>"
        )

    def _repr_html_(self) -> str:
        cells, area = self.coverage.grid.cells, self.coverage.site.area
        corners = cells.size_m / 2.0 * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        parts = [area] if isinstance(area, shapely.Polygon) else list(area.geoms)
        shapes = [("area", np.array(part.exterior.coords)) for part in parts]
        middles = self.coverage.grid.middles_m
        # cells of a gap in a notebook's map
        shapes += [("gap", middles[cell] + corners) for region in self.gaps for cell in region.cells[:2000]]
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
    site: Site,  # the scenario on its ground
    coverage: CoverageMap,  # on the cells that results are judged on
    tracks: Sequence[FlownTrack],  # at least one, the first with the plan whose coverage was promised
    *,
    # of real photos; where they tell no coverage, it follows from the tracks
    evidence: PhotoEvidence = NOTHING_KNOWN,
    count: CountObservations = count_observations,  # who counts the observations
) -> Verdict:
    """Verify coverage and safety from the flown tracks alone; plans serve for comparison only.

    Several tracks, of several sorties or vehicles, count as one flight: a cell that any of them observes is observed, and each
    must keep the limits. Observations present in two records of one flight count once.

    Raises:
        TrackError: a track is empty, or has a position that is not on Earth.
    """
    steps = [clocks_apart(flown.track) for flown in tracks]
    judged_dates = [dated(flown.track, flown.dates) for flown in tracks]
    tracks = [replace(flown, track=track) for flown, (track, _) in zip(tracks, judged_dates, strict=True)]
    which = [f"track {k + 1}: " if len(tracks) > 1 else "" for k in range(len(tracks))]
    dates = [f"{name}{text}" for name, (_, found) in zip(which, judged_dates, strict=True) for text in found]
    source: PhotoSource = "reported" if any(reports_photos(flown.track) for flown in tracks) else "predicted"
    judged = [judge_track(flown.site or site, flown.track, flown.planned, photo_source=source) for flown in tracks]
    records = records_of_one_flight(judged)
    # The pause is longer than the time between two passes, so each track's observations are separate passes.
    pause_s = 2.0 * site.scenario.requirements.max_gap_s
    same_clock = {record.second: (record.first, record.same.shift_s) for record in records}
    shifts_s = joining_shifts_s([flown.track.time_s for flown in tracks], pause_s=pause_s, same_clock=same_clock)
    parts = [track.observations(flown.site or site) for track, flown in zip(judged, tracks, strict=True)]
    for record in records:
        _count_once(judged, parts, record)
    together = joined_observations(parts, shifts_s)
    if unsure := [record.same for record in records if record.same.disagrees]:
        coverage = coverage.less_certain(
            position_m=max(same.aside_m for same in unsure), height_m=max(same.above_m for same in unsure)
        )
    eyes = _eyes(coverage, tracks)
    if evidence.shown is not None:
        flown = evidence.shown
    elif len(eyes) == 1:
        flown = count(eyes[0][0], together)
    else:
        flown = observed_by_any(
            [count(eye, joined_observations([parts[k] for k in who], [shifts_s[k] for k in who])) for eye, who in eyes]
        )
    unknown_looks = int((~together.known).sum()) if evidence.shown is None else 0
    photos = evidence.counts
    if evidence.shown is None and len(eyes) == 1 and takes_photos(eyes[0][0].site.scenario):
        photos = _photos(eyes[0][0], together)
    statistics = None if photos is None else photo_statistics(eyes[0][0], photos)
    gaps = tuple(find_gaps(coverage, _as_required(coverage, flown, photos, statistics)))
    window = flown_window(np.concatenate([j.track.unix_time_s for j in judged]))
    separation = judge_separation(
        site, [track.track for track in judged], same_flight={(record.first, record.second) for record in records}
    )
    decision = decide(
        coverage, flown, judged, photos,
        unknown_attitude_looks=unknown_looks, evidence=evidence, separation=separation, eyes=[eye for eye, _ in eyes],
    )  # fmt: skip
    more = (*map(str, records), *_overlap_findings(site, statistics), *dates, *_time_findings(site, window))
    doubts = [f"{name}{step}" for name, step in zip(which, steps, strict=True) if step is not None]
    doubts += at_two_positions(judged, records) if site.scenario.fleet.vehicles == 1 else []
    judgement = Judgement(
        (*decision.judgement.findings, *(unproved("evidence", text) for text in doubts), *map(noted, more))
    )
    report = VerificationReport(
        coverage_fraction=coverage.fraction(flown.observed),
        coverage_of_coverable=coverage.fraction_of_coverable(flown.observed),
        surely_covered_fraction=coverage.fraction(flown.certain_cells),
        surely_covered_of_coverable=coverage.fraction_of_coverable(flown.certain_cells),
        possibly_covered_fraction=coverage.fraction(flown.possible_cells),
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
        judgement=judgement,
        requirements=judged_requirements(site.scenario),
        flown_utc=None if window is None else (window[0].isoformat(), window[1].isoformat()),
        separation=separation.pairs,
        photo_source=None if evidence.shown is not None or all(j.photos is None for j in judged) else source,
        missing_photos=tuple(
            replace(stretch, track=number)
            for number, j in enumerate(judged)
            for stretch in ([] if j.photos is None else j.photos.missing)
        ),
    )
    return Verdict(coverage, report, flown, gaps, photos, together, shifts_s)


def _count_once(judged: Sequence[JudgedTrack], parts: list[Observations], record: Records) -> None:
    """Take out of two records of one flight what both observed.

    Photos stay with the record that has more of them: of the other, those at times that it observed are no more looks.
    """
    first, second, shift_s = record.first, record.second, record.same.shift_s
    if judged[first].photos is not None and parts[second].known.sum() > parts[first].known.sum():
        first, second, shift_s = second, first, -shift_s
    kept, other = parts[first], parts[second]
    times_s = kept.times_s[kept.known]
    if judged[first].photos is not None and times_s.size:
        times_s = judged[first].track.time_s
    parts[second] = other.where(~has_near(times_s, other.times_s + shift_s))


def _as_required(
    coverage: CoverageMap, flown: FlownCoverage, photos: PhotoCounts | None, statistics: PhotoStatistics | None
) -> FlownCoverage:
    """The coverage; where a required overlap is missed, cells as drawn in too few photos do not count as seen."""
    required = None if statistics is None else statistics.asked
    if photos is None or required is None or overlap_shortfall(coverage.site.scenario, statistics) is None:
        return flown
    return replace(flown, observed=flown.observed & ((photos.photos >= required) | ~drawn_cells(coverage)))


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
    """Findings on the time of day for no-fly zones with times."""
    timed = sum(zone.entry.has_times for zone in (*site.zones, *site.other_zones))
    if not timed:
        return []
    planned = site.scenario.flight_window
    if window is None:
        judged = "as always active" if planned is None else "as in flight_window_utc"
        zones = counted(timed, "no-fly zone with times is", "no-fly zones with times are")
        return [f"the track has no time of day, so {zones} judged {judged}"]
    if planned is None or (planned[0] <= window[0] and window[1] <= planned[1]):
        return []
    return [
        f"flown from {window_text(window)}, planned for {window_text(planned)}; the verdict uses the no-fly "
        "zones that were active during the flight"
    ]


def _photos(coverage: CoverageMap, together: Observations) -> PhotoCounts:
    """Looks whose direction is known; the others show nothing for certain."""
    known, scenario = together.where(together.known), coverage.site.scenario
    closer_m = look_distance_m(scenario, np.full(len(known), scenario.uncertainty.position_m))
    looks = looks_of(known.positions_m, known.axes, closer_m)
    return count_photos(coverage, SensorPoses(known.positions_m, known.axes, known.tops, known.times_s), looks)


def _overlap_findings(site: Site, photos: PhotoStatistics | None) -> list[str]:
    """Overlap that does not hold, where nothing requires it."""
    if photos is None or photos.overlap_fraction is None or photos.overlap_holds:
        return []
    if site.scenario.requirements.min_overlap_fraction is not None:
        return []
    return [
        f"the required overlap, {photos.asked} photos of every point, is achieved on "
        f"{100.0 * photos.overlap_fraction:.2f} % of the area; {100.0 * OVERLAP_FRACTION:g} % is required"
    ]


def _smallest(parts: Sequence[FloatArray]) -> float | None:
    known = largest(-np.concatenate(parts))
    return None if known is None else -known


def _largest(parts: Sequence[FloatArray]) -> float | None:
    return largest(np.concatenate(parts) if parts else None)
