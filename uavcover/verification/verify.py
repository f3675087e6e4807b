"""The verdict on a flight: one track, or several that count together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import TrackError
from uavcover.model.report import CellStatistics, CoverageMoment, VerificationReport, Violation
from uavcover.model.track import Track
from uavcover.site import Site
from uavcover.verification.flown_coverage import (
    FlownCoverage,
    joined_looks,
    joining_shifts_s,
    tally_looks,
)
from uavcover.verification.gaps import GapRegion, find_gaps
from uavcover.verification.looks import REACHED_RADII, looks_of
from uavcover.verification.motion import deviations_m, ground_speeds_m_s
from uavcover.verification.phases import PlannedRoute, on_route
from uavcover.verification.safety import (
    TOLERANCE,
    Figures,
    Heights,
    Phases,
    ViolationFinder,
    find_violations,
    track_heights,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

MAX_CONTRADICTION_M = 1.0
"""Largest difference between a track's local columns and its latitudes and longitudes."""

_PLACE_MARGIN_M = 2.0
"""A place is kept within two acceptance radii, and a little for wind: home while climbing and landing, a waypoint."""

_MOMENTS = 200
"""Coverage over time is told at this many moments, evenly spread over the looks' time."""


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


def track_positions_m(site: Site, track: Track) -> FloatArray:
    """(n, 3) ENU positions of a track: from its latitudes, longitudes and heights where the site has a place on Earth."""
    if site.frame is None:
        return track.enu_m
    return site.frame.enu_from_geodetic(*track.geodetic.T)


def flown_coverage(coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> FlownCoverage:
    """What a track saw between its first and last planned waypoint, by the sensor of the scenario.

    Raises:
        TrackError: the sensor looks from waypoints only, and there is no plan that says where they are.
    """
    site = coverage.site
    enu = track_positions_m(site, track)
    return tally_looks(coverage, looks_of(site, track, enu, _route(site, track, enu, planned), planned))


def verify_track(site: Site, coverage: CoverageMap, track: Track, planned: PlannedRoute | None) -> VerificationReport:
    """The verdict on one track; see :func:`verify_flight`."""
    return verify_flight(site, coverage, [FlownTrack(track, planned)]).report


def verify_flight(site: Site, coverage: CoverageMap, tracks: Sequence[FlownTrack]) -> Verdict:
    """Coverage and safety of what was flown, from the tracks alone; the plans are only compared with.

    Several tracks, of several sorties or vehicles, count as one flight: what any of them saw was seen, and each has to keep
    the limits.

    Args:
        site: the scenario on its ground.
        coverage: on the cells that results are judged on.
        tracks: at least one, the first with the plan whose coverage was promised.

    Raises:
        TrackError: a track is empty, or has a position that is no place on Earth.
    """
    requirements = site.scenario.requirements
    judged = [_JudgedTrack.of(site, flown.track, flown.planned) for flown in tracks]
    looks = [
        looks_of(site, flown.track, j.enu_m, j.phases.route, flown.planned)
        for flown, j in zip(tracks, judged, strict=True)
    ]
    # A pause longer than what separates two passes: the tracks' looks are passes of their own.
    shifts_s = joining_shifts_s([flown.track.time_s for flown in tracks], pause_s=2.0 * requirements.max_gap_s)
    together = joined_looks(looks, shifts_s)
    flown = tally_looks(coverage, together)
    gaps = tuple(find_gaps(coverage, flown))
    promised = tracks[0].planned
    share = coverage.share_of_coverable(flown.seen)
    sure_share = coverage.share_of_coverable(flown.surely_seen)
    violations = tuple(
        replace(violation, track=number) for number, j in enumerate(judged) for violation in j.violations
    )
    reasons = []
    if share < requirements.min_coverage_of_coverable:
        reasons.append(
            f"coverage {100 * share:.2f} % of the coverable area is below the required "
            f"{100 * requirements.min_coverage_of_coverable:.2f} %"
        )
    wanted = requirements.min_sure_coverage_of_coverable
    if wanted is not None and sure_share < wanted:
        reasons.append(
            f"sure coverage {100 * sure_share:.2f} % of the coverable area is below the required {100 * wanted:.2f} %"
        )
    for number, j in enumerate(judged):
        which = f"track {number + 1}: " if len(tracks) > 1 else ""
        reasons += [which + reason for reason in j.reasons]
    report = VerificationReport(
        coverage_fraction=coverage.share(flown.seen),
        coverage_of_coverable=share,
        surely_covered_fraction=coverage.share(flown.surely_seen),
        surely_covered_of_coverable=sure_share,
        possibly_covered_fraction=coverage.share(flown.possibly_seen),
        planned_coverage_fraction=None if promised is None else promised.coverage_fraction,
        min_height_agl_m=_smallest([j.heights.lowest.values[j.phases.route] for j in judged]),
        max_height_agl_m=_largest([j.heights.highest.values[j.phases.route] for j in judged]),
        min_transit_clearance_m=_smallest([j.heights.lowest.values[j.phases.transit] for j in judged]),
        violations=violations,
        max_deviation_m=_largest([j.deviations_m for j in judged if j.deviations_m is not None]),
        max_ground_speed_m_s=_largest([j.speeds_m_s[j.phases.route] for j in judged]),
        gaps=tuple(region.gap for region in gaps),
        cells=_statistics(coverage, flown),
        coverage_by_time=_coverage_by_time(coverage, flown, together.times_s),
        samples=sum(len(flown.track) for flown in tracks),
        level_assumed=together.level_assumed,
        unobserved_s=sum(j.unobserved_s for j in judged),
        passed=not reasons,
        reasons=tuple(reasons),
    )
    return Verdict(coverage, report, flown, gaps, shifts_s)


@dataclass(frozen=True, slots=True, eq=False)
class _JudgedTrack:
    """What one track says by itself.

    Attributes:
        enu_m: (n, 3) its positions.
        phases: of its samples.
        heights: above ground.
        speeds_m_s: (n,) over ground.
        deviations_m: (n,) from the planned route, none without a plan.
        violations: limits that were not kept.
        unobserved_s: time without samples.
        reasons: why it cannot pass, whatever was seen.
    """

    enu_m: FloatArray
    phases: Phases
    heights: Heights
    speeds_m_s: FloatArray
    deviations_m: FloatArray | None
    violations: tuple[Violation, ...]
    unobserved_s: float
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, site: Site, track: Track, planned: PlannedRoute | None) -> "_JudgedTrack":
        """Judge a track.

        Raises:
            TrackError: it is empty, or has a position that is no place on Earth.
        """
        enu = _checked_positions_m(site, track)
        requirements = site.scenario.requirements
        joined = np.diff(track.time_s) <= requirements.max_gap_s
        phases = _phases(site, track, enu, planned)
        heights = track_heights(site, enu, joined, phases)
        speeds = ground_speeds_m_s(track, enu, max_gap_s=requirements.max_gap_s)
        deviations = deviations_m(enu, phases.route, planned)
        limits = find_violations(site, track, enu, heights, phases, joined)
        off = _requirement_violations(site, track, enu, phases, speeds, deviations)
        return cls(
            enu_m=enu,
            phases=phases,
            heights=heights,
            speeds_m_s=speeds,
            deviations_m=deviations,
            violations=tuple(sorted([*limits, *off], key=lambda violation: violation.start_s)),
            unobserved_s=float(np.diff(track.time_s)[~joined].sum()),
            reasons=tuple(_reasons(site, track, enu, phases, heights, speeds, deviations, limits)),
        )


def _requirement_violations(
    site: Site, track: Track, enu_m: FloatArray, phases: Phases, speeds_m_s: FloatArray, deviations: FloatArray | None
) -> list[Violation]:
    """Stretches of the route that were too fast, or too far from the planned one."""
    requirements = site.scenario.requirements
    numbers = np.arange(len(track), dtype=float)
    find = ViolationFinder(track, enu_m)
    found: list[Violation] = []
    if requirements.max_ground_speed_m_s is not None:
        found += find.above(
            "ground-speed", phases.route, Figures(speeds_m_s, numbers), requirements.max_ground_speed_m_s,
            phase="route", unit="m/s",
        )  # fmt: skip
    if requirements.max_deviation_m is not None and deviations is not None:
        found += find.above(
            "deviation", phases.route, Figures(deviations, numbers), requirements.max_deviation_m, phase="route"
        )
    return found


def _reasons(
    site: Site,
    track: Track,
    enu_m: FloatArray,
    phases: Phases,
    heights: Heights,
    speeds_m_s: FloatArray,
    deviations: FloatArray | None,
    violations: Sequence[Violation],
) -> list[str]:
    """Why a track cannot pass, a line each."""
    requirements = site.scenario.requirements
    reasons = []
    if violations:
        kinds = sorted({violation.kind for violation in violations})
        reasons.append(f"{len(violations)} violations of the limits ({', '.join(kinds)})")
    unknown = np.isnan(heights.lowest.values) & ~phases.column
    if unknown.any():
        first = float(track.time_s[int(np.argmax(unknown))])
        reasons.append(
            f"no elevation data under {int(unknown.sum())} samples of the flight, first at {first:.1f} s: their height "
            "above ground cannot be judged (if that is far away, latitude and longitude may be swapped)"
        )
    off = None if deviations is None else _largest([deviations])
    if requirements.max_deviation_m is not None and (off is None or off > requirements.max_deviation_m + TOLERANCE):
        flown_off = "unknown" if off is None else f"{off:.1f} m"
        reasons.append(f"the deviation from the planned route, {flown_off}, is above {requirements.max_deviation_m} m")
    fastest, allowed = _largest([speeds_m_s[phases.route]]), requirements.max_ground_speed_m_s
    if allowed is not None and fastest is not None and fastest > allowed + TOLERANCE:
        reasons.append(f"the speed over ground, {fastest:.1f} m/s, is above {allowed} m/s")
    contradiction = float(np.max(np.linalg.norm(enu_m - track.enu_m, axis=1)))
    if not contradiction <= MAX_CONTRADICTION_M:
        reasons.append(
            "the track contradicts itself: east, north, up differ from latitude, longitude, height by up to "
            f"{contradiction:.1f} m"
        )
    return reasons


def _checked_positions_m(site: Site, track: Track) -> FloatArray:
    if len(track) == 0:
        raise TrackError("the track has no samples: nothing was flown, or nothing was recorded")
    enu = track_positions_m(site, track)
    if not np.isfinite(enu).all():
        bad = int(np.argmin(np.isfinite(enu).all(axis=1)))
        raise TrackError(
            f"sample {bad} of the track, at {track.time_s[bad]} s, is no place on Earth; are latitude and longitude swapped?"
        )
    return enu


def _phases(site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> Phases:
    route = _route(site, track, enu_m, planned)
    radius = REACHED_RADII * site.scenario.vehicle.acceptance_radius_m + _PLACE_MARGIN_M

    def at(place_m: FloatArray) -> BoolArray:
        return np.asarray(np.hypot(enu_m[:, 0] - place_m[0], enu_m[:, 1] - place_m[1]) <= radius)

    nowhere = np.zeros(len(enu_m), dtype=bool)
    column = nowhere if site.home_m is None else at(site.home_m)
    junction = nowhere
    if planned is not None and len(planned.waypoints_m):
        junction = at(planned.waypoints_m[0]) | at(planned.waypoints_m[-1])
    return Phases(route=route, column=column & ~route, junction=junction & ~route & ~column)


def _route(site: Site, track: Track, enu_m: FloatArray, planned: PlannedRoute | None) -> BoolArray:
    return on_route(track, enu_m, planned, acceptance_radius_m=site.scenario.vehicle.acceptance_radius_m)


def _statistics(coverage: CoverageMap, flown: FlownCoverage) -> CellStatistics:
    seen = flown.seen

    def percentile(values: FloatArray, share: float) -> float | None:
        known = values[seen & np.isfinite(values)]
        return float(np.percentile(known, share)) if known.size else None

    return CellStatistics(
        count=coverage.grid.count,
        seen=int(seen.sum()),
        looks_mean=float(flown.looks[seen].mean()) if seen.any() else None,
        looks_max=int(flown.looks.max()),
        seen_twice_fraction=coverage.share(flown.looks >= 2),
        ground_sample_median_m=percentile(flown.ground_sample_m, 50.0),
        ground_sample_p95_m=percentile(flown.ground_sample_m, 95.0),
        incidence_median_deg=percentile(flown.incidence_deg, 50.0),
        incidence_p95_deg=percentile(flown.incidence_deg, 95.0),
    )


def _coverage_by_time(coverage: CoverageMap, flown: FlownCoverage, times_s: FloatArray) -> tuple[CoverageMoment, ...]:
    if times_s.size == 0:
        return ()
    order = np.flatnonzero(flown.seen)
    order = order[np.argsort(flown.first_seen_s[order], kind="stable")]
    weight = coverage.grid.weight_m2
    so_far = np.append(0.0, np.cumsum(weight[order])) / weight.sum()
    moments = np.linspace(times_s[0], times_s[-1], _MOMENTS) if times_s[-1] > times_s[0] else times_s[:1]
    shares = so_far[np.searchsorted(flown.first_seen_s[order], moments, side="right")]
    return tuple(CoverageMoment(float(t), float(share)) for t, share in zip(moments, shares, strict=True))


def _smallest(parts: Sequence[FloatArray]) -> float | None:
    values = np.concatenate(parts) if parts else np.empty(0)
    known = values[np.isfinite(values)]
    return float(known.min()) if known.size else None


def _largest(parts: Sequence[FloatArray]) -> float | None:
    values = np.concatenate(parts) if parts else np.empty(0)
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None
