"""The verdict on a flight: one track, or several that count together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.report import VerificationReport
from uavcover.model.track import Track
from uavcover.site import Site
from uavcover.verification.cell_figures import cell_statistics, coverage_by_time
from uavcover.verification.deciding import decide, judged_requirements
from uavcover.verification.flown_coverage import FlownCoverage, joined_looks, joining_shifts_s, tally_looks
from uavcover.verification.gaps import GapRegion, find_gaps
from uavcover.verification.judged_track import JudgedTrack, judge_track, largest, track_positions_m
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.same_flight import SameFlight, has_near, same_flight

__all__ = ["FlownTrack", "Verdict", "flown_coverage", "track_positions_m", "verify_flight", "verify_track"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrack:
    """A track and the plan it followed.

    Attributes:
        track: what was flown.
        planned: what was planned for it, if anything.
    """

    track: Track
    planned: PlannedRoute | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Everything that verification found out.

    Attributes:
        coverage: the cells that were judged.
        report: the verdict in figures.
        flown: what was seen, cell by cell.
        gaps: what was not seen, with the cells.
        shifts_s: what was added to the vehicle times of each track so that all run on one clock, as those of ``flown`` and of
            the report's ``coverage_by_time`` do.
    """

    coverage: CoverageMap
    report: VerificationReport
    flown: FlownCoverage
    gaps: tuple[GapRegion, ...]
    shifts_s: tuple[float, ...]


def flown_coverage(coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> FlownCoverage:
    """What a track saw between its first and last planned waypoint, by the sensor of the scenario.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    site = coverage.site
    return tally_looks(coverage, judge_track(site, track, planned).looks(site))


def verify_track(site: Site, coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> VerificationReport:
    """The verdict on one track; see :func:`verify_flight`."""
    return verify_flight(site, coverage, [FlownTrack(track, planned)]).report


def verify_flight(site: Site, coverage: CoverageMap, tracks: Sequence[FlownTrack]) -> Verdict:
    """Coverage and safety of what was flown, from the tracks alone; the plans are only compared with.

    Several tracks, of several sorties or vehicles, count as one flight: what any of them saw was seen, and each has to keep
    the limits. What two records of one flight both observed counts once.

    Args:
        site: the scenario on its ground.
        coverage: on the cells that results are judged on.
        tracks: at least one, the first with the plan whose coverage was promised.

    Raises:
        TrackError: a track is empty, or has a position that is no place on Earth.
    """
    judged = [judge_track(site, flown.track, flown.planned) for flown in tracks]
    records = _records_of_one_flight(judged)
    # A pause longer than what separates two passes: the tracks' looks are passes of their own.
    pause_s = 2.0 * site.scenario.requirements.max_gap_s
    same_clock = {record.second: (record.first, record.same.shift_s) for record in records}
    shifts_s = joining_shifts_s([flown.track.time_s for flown in tracks], pause_s=pause_s, same_clock=same_clock)
    parts = [track.looks(site) for track in judged]
    for record in records:
        first, looks = parts[record.first], parts[record.second]
        told = has_near(first.times_s[first.known], looks.times_s + record.same.shift_s)
        parts[record.second] = looks.where(~told)
    together = joined_looks(parts, shifts_s)
    flown = tally_looks(coverage, together)
    gaps = tuple(find_gaps(coverage, flown))
    decision = decide(coverage, flown, judged, unknown_attitude_looks=int((~together.known).sum()))
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
        ),
        max_deviation_m=_largest([j.deviations_m for j in judged if j.deviations_m is not None]),
        max_ground_speed_m_s=_largest([j.speeds_m_s[j.phases.route] for j in judged]),
        gaps=tuple(region.gap for region in gaps),
        cells=cell_statistics(coverage, flown),
        coverage_by_time=coverage_by_time(coverage, flown, together.times_s),
        samples=sum(len(flown.track) for flown in tracks),
        unknown_attitude_looks=int((~together.known).sum()),
        unobserved=decision.unobserved,
        unobserved_s=sum(stretch.duration_s for stretch in decision.unobserved if stretch.in_flight),
        unobserved_m=sum(stretch.length_m for stretch in decision.unobserved if stretch.in_flight),
        unobserved_route_fraction=decision.unobserved_route_fraction,
        verdict=decision.verdict,
        passed=decision.verdict == "passed",
        reasons=decision.reasons,
        doubts=decision.doubts,
        findings=(*decision.findings, *map(str, records)),
        requirements=judged_requirements(site.scenario),
    )
    return Verdict(coverage, report, flown, gaps, shifts_s)


@dataclass(frozen=True, slots=True)
class _Records:
    """Two tracks, by their places in the list, that are records of one flight."""

    first: int
    second: int
    same: SameFlight

    def __str__(self) -> str:
        """What was found, for people."""
        return (
            f"tracks {self.first + 1} and {self.second + 1} are records of one flight: they agree within "
            f"{self.same.median_m:.2f} m (median) for {self.same.duration_s:.0f} s; what both observed counts once"
        )


def _records_of_one_flight(judged: Sequence[JudgedTrack]) -> list[_Records]:
    """For each track the first one before it that is a record of the same flight."""
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
