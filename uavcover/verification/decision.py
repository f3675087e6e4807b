"""The decision on a flight, passed, failed or not proved, and statistics of how well the cells were seen.

Failed: something observed breaks a limit, or a requirement is missed under any motion in the unobserved time. Not proved:
neither is the case, but something essential was not observed. Passed: everything holds, and was observed.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.scenario import Scenario
from uavcover.model.verdict import (
    CellStatistics,
    CoverageMoment,
    Finding,
    Judgement,
    Requirement,
    Unobserved,
    fails,
    noted,
    percent_beside,
    unproved,
)
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.pictures import PictureCounts, overlap_fraction, overlap_shortfall, picture_statistics
from uavcover.verification.ends import FlightContinuation, continuations
from uavcover.verification.flown_coverage import NOTHING_KNOWN, FlownCoverage, PictureEvidence, possibly_seen
from uavcover.verification.judged_track import JudgedTrack
from uavcover.verification.observations import level_observations
from uavcover.verification.possible_motion import motion_limits
from uavcover.verification.separation import NOT_ASKED, Separation
from uavcover.verification.tuning import TRACK
from uavcover.verification.unobserved import (
    length_of_m,
    place_of,
    stretch_at,
    way_after_m,
    way_before_m,
    ways_between_m,
)


def cell_statistics(coverage: CoverageMap, flown: FlownCoverage) -> CellStatistics:
    """Statistics of observations, ground sample distance and incidence over all cells."""
    seen = flown.seen

    def percentile(values: FloatArray, share: float) -> float | None:
        known = values[seen & np.isfinite(values)]
        return float(np.percentile(known, share)) if known.size else None

    return CellStatistics(
        count=coverage.grid.count,
        seen=int(seen.sum()),
        looks_mean=float(flown.passes[seen].mean()) if seen.any() else None,
        looks_max=int(flown.passes.max()),
        seen_twice_fraction=coverage.share(flown.passes >= 2),
        ground_sample_median_m=percentile(flown.ground_sample_m, 50.0),
        ground_sample_p95_m=percentile(flown.ground_sample_m, 95.0),
        incidence_median_deg=percentile(flown.incidence_deg, 50.0),
        incidence_p95_deg=percentile(flown.incidence_deg, 95.0),
    )


def coverage_by_time(coverage: CoverageMap, flown: FlownCoverage, times_s: FloatArray) -> tuple[CoverageMoment, ...]:
    """Coverage reached by selected moments of the (k,) observation times."""
    if times_s.size == 0:
        return ()
    order = np.flatnonzero(flown.seen)
    order = order[np.argsort(flown.first_seen_s[order], kind="stable")]
    weight = coverage.grid.weight_m2
    so_far = np.append(0.0, np.cumsum(weight[order])) / coverage.grid.area_m2
    moments = np.linspace(times_s[0], times_s[-1], TRACK.moments) if times_s[-1] > times_s[0] else times_s[:1]
    shares = so_far[np.searchsorted(flown.first_seen_s[order], moments, side="right")]
    return tuple(CoverageMoment(float(t), float(share)) for t, share in zip(moments, shares, strict=True))


@dataclass(frozen=True, slots=True)
class Decision:
    """The decision and its grounds; see :class:`uavcover.model.verdict.VerificationReport`."""

    judgement: Judgement  # passed, failed or not proved, and why
    unobserved: tuple[Unobserved, ...]  # unobserved stretches of all tracks
    unobserved_route_fraction: float | None  # fraction of the time on the route; none without a route


def judged_requirements(scenario: Scenario) -> Mapping[str, Any]:
    """The requirements and limits of a flight, by their names in the scenario, without the rings of the fence."""
    limits = {name: value for name, value in asdict(scenario.limits).items() if not name.startswith("fence_")}
    limits["max_transit_height_agl_m"] = scenario.transit_ceiling_agl_m
    return {**asdict(scenario.requirements), **limits}


def decide(
    coverage: CoverageMap,  # the cells
    flown: FlownCoverage,  # their coverage
    judged: Sequence[JudgedTrack],  # each track judged by itself
    pictures: PictureCounts | None,  # how many show each cell; none for a sensor that takes none
    *,
    unknown_attitude_looks: int,  # number of observations without a known direction
    # from real photos; where these decide the coverage, unobserved parts of the flight cannot add to it
    evidence: PictureEvidence = NOTHING_KNOWN,
    separation: Separation = NOT_ASKED,  # of the vehicles
    # the cells as each sensor that flew sees them, where there are several; default: those of the site
    eyes: Sequence[CoverageMap] = (),
) -> Decision:
    """Decide on tracks that count as one flight."""
    site = coverage.site
    requirements = site.scenario.requirements
    links = continuations([(j.begin, j.end) for j in judged], motion_limits(site.scenario.vehicle, site.scenario.wind))
    unobserved, ways = _all_unobserved(site, judged, links)
    findings: list[Finding] = []
    for number, j in enumerate(judged):
        which = f"track {number + 1}: " if len(judged) > 1 else ""
        found = [*(unproved("ends", line) for line in _end_doubts(site, number, j, links)), *j.findings]
        for line in j.attitude_problems:
            text = f"{line}; uavcover treats the attitude there as unknown"
            found.append(unproved("coverage", text) if unknown_attitude_looks else noted(text))
        findings += [replace(finding, text=which + finding.text) for finding in found]
    fraction, ways_fraction = _fractions(judged, unobserved)
    if fraction is None:
        findings.append(unproved("unobserved-fraction", "no part of the track is on the route"))
    elif fraction > requirements.max_unobserved_fraction:
        text = (
            f"{100 * fraction:.1f} % of the time on the route was not observed; the limit is "
            f"{100 * requirements.max_unobserved_fraction:g} %{_longest(site, unobserved, 'route')}"
        )
        findings.append(unproved("unobserved-fraction", text))
    if ways_fraction > TRACK.max_unobserved_ways_fraction:
        text = (
            f"{100 * ways_fraction:.0f} % of the outbound and return transits was not observed; the limit is "
            f"{100 * TRACK.max_unobserved_ways_fraction:g} %{_longest(site, unobserved, 'transit')}"
        )
        findings.append(unproved("transit-observed", text))
    long = [s for s in unobserved if s.in_flight and s.duration_s > requirements.max_unobserved_gap_s]
    gaps = [
        f"the flight was unobserved for {_told(site, stretch)}; the limit is {requirements.max_unobserved_gap_s:g} s"
        for stretch in long[: TRACK.shown]
    ]
    if len(long) > TRACK.shown:
        gaps.append(f"{len(long) - TRACK.shown} more unobserved intervals exceed the limit")
    findings += [unproved("unobserved-gap", text) for text in gaps]

    @cache
    def perhaps() -> BoolArray:
        """(cells,) what unobserved stretches, and looks of unknown direction, may have seen."""
        found = flown.possibly_by_attitude.copy()
        for way in ways:
            for eye in eyes or (coverage,):
                found |= possibly_seen(eye, level_observations(eye.site, way, 0.0))
        return found

    if evidence.shown is None:
        findings += _judge_coverage(coverage, flown, perhaps)
        findings += _judge_overlap(coverage, pictures, perhaps)
        if evidence.photos_required and any(j.photos is not None and j.photos.source == "predicted" for j in judged):
            findings.append(unproved("photos", "photos are required (--require-photos), but the vehicle reported none"))
    else:
        # Cells that photos may show within their errors, or that only photos of unknown sharpness show.
        findings += _judge_coverage(coverage, flown, lambda: flown.possibly_seen)
    findings += [*evidence.findings, *separation.findings]
    return Decision(Judgement(tuple(findings)), tuple(unobserved), fraction)


def _judge_overlap(
    coverage: CoverageMap, pictures: PictureCounts | None, perhaps: Callable[[], BoolArray]
) -> list[Finding]:
    """Overlap that is required and missed fails, unless photos that were not observed may make up for it."""
    scenario = coverage.site.scenario
    short = overlap_shortfall(scenario, None if pictures is None else picture_statistics(coverage, pictures))
    if short is None:
        return []
    at_most = None if pictures is None else overlap_fraction(coverage, pictures, perhaps())
    required = scenario.requirements.min_overlap_fraction or 0.0
    if at_most is None or at_most < required:
        return [fails("overlap", short)]
    more = f"unobserved intervals could increase it to {percent_beside(at_most, required)}"
    return [unproved("overlap", f"{short}; {more}")]


def _judge_coverage(
    coverage: CoverageMap,
    flown: FlownCoverage,
    perhaps: Callable[[], BoolArray],
) -> list[Finding]:
    """Insufficient coverage fails, unless unobserved stretches may make up for it: then it is not proved."""
    requirements = coverage.site.scenario.requirements
    share, sure = coverage.share_of_coverable(flown.seen), coverage.share_of_coverable(flown.surely_seen)
    wanted, wanted_sure = requirements.min_coverage_of_coverable, requirements.min_sure_coverage_of_coverable
    short: list[tuple[float, Requirement, float, BoolArray]] = []
    if share < wanted:
        short.append((share, "coverage", wanted, flown.seen))
    if wanted_sure is not None and sure < wanted_sure:
        short.append((sure, "sure-coverage", wanted_sure, flown.surely_seen))
    findings = []
    for found, what, asked, seen in short:
        at_most = coverage.share_of_coverable(seen | perhaps())
        words = what.replace("-", " ")
        text = f"{words} {percent_beside(found, asked)} of the visible ground is below the required {100 * asked:.2f} %"
        if at_most < asked:
            findings.append(fails(what, text))
        else:
            more = f"unobserved intervals could increase it to {percent_beside(at_most, asked)}"
            findings.append(unproved(what, f"{text}; {more}"))
    return findings


def _all_unobserved(
    site: Site, judged: Sequence[JudgedTrack], links: Sequence[FlightContinuation]
) -> tuple[list[Unobserved], list[FloatArray]]:
    """Stretches without evidence, within the tracks and at their ends, and the parts of the route they may have covered."""
    found: list[Unobserved] = []
    ways: list[FloatArray] = []
    for number, j in enumerate(judged):
        before, after = way_before_m(j.planned, j.passed), way_after_m(j.planned, j.passed)
        if not j.begin.on_ground and not any(link.after == number for link in links):
            found.append(_missing(site, j, number, before, first=True))
            ways.append(before)
        found += [replace(stretch, track=number) for stretch in j.unobserved]
        ways += ways_between_m(j.enu_m, j.joined, j.phases.route, j.planned, j.passed)
        ways += [] if j.photos is None else j.photos.perhaps_m
        link = next((link for link in links if link.before == number), None)
        if link is not None:
            other = judged[link.after]
            start_s, end_s = j.end.time_s, other.begin.time_s
            detail = f"{end_s - start_s:.1f} s lie between track {number + 1} and its continuation, {link.after + 1}"
            way = np.vstack([j.end.enu_m, other.begin.enu_m])
            on_route = bool(j.phases.route[-1] or other.phases.route[0])
            if end_s - start_s > site.scenario.requirements.max_gap_s:
                stretch = stretch_at(
                    site, j.end.enu_m, reason="no samples", detail=detail, span_s=(start_s, end_s),
                    length_m=length_of_m(way), on_route=on_route,
                )  # fmt: skip
                found.append(replace(stretch, track=number))
                ways += [way] if on_route else []
        elif not j.end.on_ground:
            found.append(_missing(site, j, number, after, first=False))
            ways.append(after)
    return found, [way for way in ways if len(way) > 0]


def _missing(site: Site, j: JudgedTrack, number: int, way_m: FloatArray, *, first: bool) -> Unobserved:
    end = j.begin if first else j.end
    stretch = stretch_at(
        site, end.enu_m, reason="before the first sample" if first else "after the last sample", detail=str(end),
        span_s=(end.time_s, end.time_s), length_m=length_of_m(way_m), on_route=len(way_m) > 1,
    )  # fmt: skip
    return replace(stretch, track=number)


def _end_doubts(site: Site, number: int, j: JudgedTrack, links: Sequence[FlightContinuation]) -> list[str]:
    doubts = []
    if not j.begin.on_ground and not any(link.after == number for link in links):
        doubts.append(f"{j.begin}, at {place_of(site, j.begin.enu_m)}, {j.begin.time_s:.1f} s; its start is missing")
    if not j.end.on_ground and not any(link.before == number for link in links):
        doubts.append(f"{j.end}, at {place_of(site, j.end.enu_m)}, {j.end.time_s:.1f} s; its end is missing")
    return doubts


def _fractions(judged: Sequence[JudgedTrack], unobserved: Sequence[Unobserved]) -> tuple[float | None, float]:
    """Unobserved fractions of the time on the route and in transit."""
    route_s, ways_s = 0.0, 0.0
    for j in judged:
        chosen = np.flatnonzero(j.phases.route)
        on_route_s = float(j.track.time_s[chosen[-1]] - j.track.time_s[chosen[0]]) if chosen.size else 0.0
        route_s += on_route_s
        ways_s += float(j.track.time_s[-1] - j.track.time_s[0]) - on_route_s
    missing = {
        phase: sum(s.duration_s for s in unobserved if s.phase == phase and s.in_flight)
        for phase in ("route", "transit")
    }
    route_s = max(route_s, missing["route"])
    ways_s = max(ways_s, missing["transit"])
    return (missing["route"] / route_s if route_s > 0.0 else None, missing["transit"] / ways_s if ways_s > 0.0 else 0.0)


def _longest(site: Site, unobserved: Sequence[Unobserved], phase: str) -> str:
    stretches = [s for s in unobserved if s.phase == phase and s.in_flight and s.duration_s > 0.0]
    if not stretches:
        return ""
    return f"; longest of {len(stretches)} such intervals: {_told(site, max(stretches, key=lambda s: s.duration_s))}"


def _told(site: Site, stretch: Unobserved) -> str:
    place = place_of(site, np.array([stretch.east_m, stretch.north_m, 0.0]))
    return f"{stretch.duration_s:.1f} s, from {stretch.start_s:.1f} s at {place} ({stretch.detail})"
