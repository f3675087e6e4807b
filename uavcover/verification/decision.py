"""The decision on a flight (passed, failed or not proved), its reasons in figures, and the table of requirements.

Failed: an observation exceeds a limit, or a requirement is missed under any motion in the unobserved time. Not proved: neither is
the case, but something essential was not observed. Passed: everything holds, and was observed.

The findings of the verdict decide whether a requirement holds; the table decides nothing.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.limits import window_of
from uavcover.model.scenario import Scenario
from uavcover.model.verdict import (
    LIMIT_OF,
    Finding,
    Holds,
    Judgement,
    Requirement,
    Unobserved,
    VerificationReport,
    fails,
    noted,
    percent_beside,
    unproved,
)
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import PhotoCounts, overlap_fraction, overlap_shortfall, photo_statistics
from uavcover.verification.flown_coverage import NOTHING_KNOWN, FlownCoverage, PhotoEvidence, possible_cells
from uavcover.verification.flown_route import (
    TRACK,
    length_of_m,
    path_after_m,
    path_before_m,
    paths_between_m,
    position_of,
    stretch_at,
)
from uavcover.verification.judged_track import JudgedTrack
from uavcover.verification.observations import level_observations
from uavcover.verification.possible_motion import motion_limits
from uavcover.verification.several_flights import NOT_REQUIRED, Separation
from uavcover.verification.track_doubts import FlightContinuation, continuations


@dataclass(frozen=True, slots=True)
class Decision:
    """The decision and its grounds; see :class:`uavcover.model.verdict.VerificationReport`."""

    judgement: Judgement  # passed, failed or not proved, and why
    unobserved: tuple[Unobserved, ...]  # unobserved stretches of all tracks
    unobserved_route_fraction: float | None  # fraction of the time on the route; None without a route


def judged_requirements(scenario: Scenario) -> Mapping[str, Any]:
    """The requirements and limits of a flight, by their names in the scenario, without the rings of the fence."""
    limits = {name: value for name, value in asdict(scenario.limits).items() if not name.startswith("fence_")}
    limits["max_transit_height_agl_m"] = scenario.transit_ceiling_agl_m
    return {**asdict(scenario.requirements), **limits}


def decide(
    coverage: CoverageMap,  # the cells
    flown: FlownCoverage,  # their coverage
    judged: Sequence[JudgedTrack],  # each track judged by itself
    photos: PhotoCounts | None,  # number of photos of each cell; None for a sensor without photos
    *,
    unknown_attitude_looks: int,  # number of observations without a known direction
    # from real photos; if they decide the coverage, unobserved parts of the flight cannot add to it
    evidence: PhotoEvidence = NOTHING_KNOWN,
    separation: Separation = NOT_REQUIRED,  # of the vehicles
    # the cells as each of several sensors observes them; default: those of the site
    eyes: Sequence[CoverageMap] = (),
) -> Decision:
    """Decide on tracks that count as one flight."""
    site = coverage.site
    requirements = site.scenario.requirements
    links = continuations([(j.begin, j.end) for j in judged], motion_limits(site.scenario.vehicle, site.scenario.wind))
    unobserved, paths = _all_unobserved(site, judged, links)
    findings: list[Finding] = []
    for number, j in enumerate(judged):
        which = f"track {number + 1}: " if len(judged) > 1 else ""
        found = [*(unproved("ends", line) for line in _end_doubts(site, number, j, links)), *j.findings]
        for line in j.attitude_problems:
            text = f"{line}; uavcover treats the attitude there as unknown"
            found.append(unproved("coverage", text) if unknown_attitude_looks else noted(text))
        findings += [replace(finding, text=which + finding.text) for finding in found]
    fraction, transit_fraction = _fractions(judged, unobserved)
    if fraction is None:
        findings.append(unproved("unobserved-fraction", "no part of the track is on the route"))
    elif fraction > requirements.max_unobserved_fraction:
        text = (
            f"{100 * fraction:.1f} % of the time on the route was not observed; the limit is "
            f"{100 * requirements.max_unobserved_fraction:g} %{_longest(site, unobserved, 'route')}"
        )
        findings.append(unproved("unobserved-fraction", text))
    if transit_fraction > TRACK.max_unobserved_transit_fraction:
        text = (
            f"{100 * transit_fraction:.0f} % of the outbound and return transits was not observed; the limit is "
            f"{100 * TRACK.max_unobserved_transit_fraction:g} %{_longest(site, unobserved, 'transit')}"
        )
        findings.append(unproved("transit-observed", text))
    long = [s for s in unobserved if s.in_flight and s.duration_s > requirements.max_unobserved_gap_s]
    gaps = [
        f"the flight was unobserved for {_describe_interval(site, stretch)}; the limit is {requirements.max_unobserved_gap_s:g} s"
        for stretch in long[: TRACK.shown]
    ]
    if len(long) > TRACK.shown:
        gaps.append(f"{len(long) - TRACK.shown} more unobserved intervals exceed the limit")
    findings += [unproved("unobserved-gap", text) for text in gaps]

    @cache
    def perhaps() -> BoolArray:
        """(cells,) whether unobserved stretches, or looks of unknown direction, may have observed each cell."""
        found = flown.possible_by_attitude.copy()
        for path in paths:
            for eye in eyes or (coverage,):
                found |= possible_cells(eye, level_observations(eye.site, path, 0.0))
        return found

    if evidence.shown is None:
        findings += _judge_coverage(coverage, flown, perhaps)
        findings += _judge_overlap(coverage, photos, perhaps)
        if evidence.photos_required and any(j.photos is not None and j.photos.source == "predicted" for j in judged):
            findings.append(unproved("photos", "photos are required (--require-photos), but the vehicle reported none"))
    else:
        # Cells that photos may show within their errors, or that only photos of unknown sharpness show.
        findings += _judge_coverage(coverage, flown, lambda: flown.possible_cells)
    findings += [*evidence.findings, *separation.findings]
    return Decision(Judgement(tuple(findings)), tuple(unobserved), fraction)


def _judge_overlap(
    coverage: CoverageMap, photos: PhotoCounts | None, perhaps: Callable[[], BoolArray]
) -> list[Finding]:
    """A missed required overlap fails, unless unobserved photos may make up for it."""
    scenario = coverage.site.scenario
    short = overlap_shortfall(scenario, None if photos is None else photo_statistics(coverage, photos))
    if short is None:
        return []
    at_most = None if photos is None else overlap_fraction(coverage, photos, perhaps())
    required = scenario.requirements.min_overlap_fraction or 0.0
    if at_most is None or at_most < required:
        return [fails("overlap", short)]
    more = f"unobserved intervals could increase it to {percent_beside(at_most, required)}"
    return [unproved("overlap", f"{short}; {more}")]


def _judge_coverage(coverage: CoverageMap, flown: FlownCoverage, perhaps: Callable[[], BoolArray]) -> list[Finding]:
    """Insufficient coverage fails, unless unobserved stretches may make up for it: then it is not proved."""
    requirements = coverage.site.scenario.requirements
    fraction, sure = coverage.fraction_of_coverable(flown.observed), coverage.fraction_of_coverable(flown.certain_cells)
    wanted, wanted_sure = requirements.min_coverage_of_coverable, requirements.min_sure_coverage_of_coverable
    short: list[tuple[float, Requirement, float, BoolArray]] = []
    if fraction < wanted:
        short.append((fraction, "coverage", wanted, flown.observed))
    if wanted_sure is not None and sure < wanted_sure:
        short.append((sure, "sure-coverage", wanted_sure, flown.certain_cells))
    findings = []
    for found, what, required, observed in short:
        at_most = coverage.fraction_of_coverable(observed | perhaps())
        words = what.replace("-", " ")
        text = f"{words} {percent_beside(found, required)} of the visible ground is below the required {100 * required:.2f} %"
        if at_most < required:
            findings.append(fails(what, text))
        else:
            more = f"unobserved intervals could increase it to {percent_beside(at_most, required)}"
            findings.append(unproved(what, f"{text}; {more}"))
    return findings


def _all_unobserved(
    site: Site, judged: Sequence[JudgedTrack], links: Sequence[FlightContinuation]
) -> tuple[list[Unobserved], list[FloatArray]]:
    """Stretches without evidence, within the tracks and at their ends, and the parts of the route they may have covered."""
    found: list[Unobserved] = []
    paths: list[FloatArray] = []
    for number, j in enumerate(judged):
        before, after = path_before_m(j.planned, j.passed), path_after_m(j.planned, j.passed)
        if not j.begin.on_ground and not any(link.after == number for link in links):
            found.append(_missing(site, j, number, before, first=True))
            paths.append(before)
        found += [replace(stretch, track=number) for stretch in j.unobserved]
        paths += paths_between_m(j.enu_m, j.joined, j.phases.route, j.planned, j.passed)
        paths += [] if j.photos is None else j.photos.perhaps_m
        link = next((link for link in links if link.before == number), None)
        if link is not None:
            other = judged[link.after]
            start_s, end_s = j.end.time_s, other.begin.time_s
            detail = f"{end_s - start_s:.1f} s lie between track {number + 1} and its continuation, {link.after + 1}"
            path = np.vstack([j.end.enu_m, other.begin.enu_m])
            on_route = bool(j.phases.route[-1] or other.phases.route[0])
            if end_s - start_s > site.scenario.requirements.max_gap_s:
                stretch = stretch_at(
                    site, j.end.enu_m, reason="no samples", detail=detail, span_s=(start_s, end_s),
                    length_m=length_of_m(path), on_route=on_route,
                )  # fmt: skip
                found.append(replace(stretch, track=number))
                paths += [path] if on_route else []
        elif not j.end.on_ground:
            found.append(_missing(site, j, number, after, first=False))
            paths.append(after)
    return found, [path for path in paths if len(path) > 0]


def _missing(site: Site, j: JudgedTrack, number: int, path_m: FloatArray, *, first: bool) -> Unobserved:
    end = j.begin if first else j.end
    stretch = stretch_at(
        site, end.enu_m, reason="before the first sample" if first else "after the last sample", detail=str(end),
        span_s=(end.time_s, end.time_s), length_m=length_of_m(path_m), on_route=len(path_m) > 1,
    )  # fmt: skip
    return replace(stretch, track=number)


def _end_doubts(site: Site, number: int, j: JudgedTrack, links: Sequence[FlightContinuation]) -> list[str]:
    doubts = []
    if not j.begin.on_ground and not any(link.after == number for link in links):
        doubts.append(f"{j.begin}, at {position_of(site, j.begin.enu_m)}, {j.begin.time_s:.1f} s; its start is missing")
    if not j.end.on_ground and not any(link.before == number for link in links):
        doubts.append(f"{j.end}, at {position_of(site, j.end.enu_m)}, {j.end.time_s:.1f} s; its end is missing")
    return doubts


def _fractions(judged: Sequence[JudgedTrack], unobserved: Sequence[Unobserved]) -> tuple[float | None, float]:
    """Unobserved fractions of the time on the route and in transit."""
    route_s, transit_s = 0.0, 0.0
    for j in judged:
        chosen = np.flatnonzero(j.phases.route)
        on_route_s = float(j.track.time_s[chosen[-1]] - j.track.time_s[chosen[0]]) if chosen.size else 0.0
        route_s += on_route_s
        transit_s += float(j.track.time_s[-1] - j.track.time_s[0]) - on_route_s
    missing = {
        phase: sum(s.duration_s for s in unobserved if s.phase == phase and s.in_flight)
        for phase in ("route", "transit")
    }
    route_s = max(route_s, missing["route"])
    transit_s = max(transit_s, missing["transit"])
    of_transits = missing["transit"] / transit_s if transit_s > 0.0 else 0.0
    return missing["route"] / route_s if route_s > 0.0 else None, of_transits


def _longest(site: Site, unobserved: Sequence[Unobserved], phase: str) -> str:
    stretches = [s for s in unobserved if s.phase == phase and s.in_flight and s.duration_s > 0.0]
    if not stretches:
        return ""
    return f"; longest of {len(stretches)} such intervals: {_describe_interval(site, max(stretches, key=lambda s: s.duration_s))}"


def _describe_interval(site: Site, stretch: Unobserved) -> str:
    position = position_of(site, np.array([stretch.east_m, stretch.north_m, 0.0]))
    return f"{stretch.duration_s:.1f} s, from {stretch.start_s:.1f} s at {position} ({stretch.detail})"


_OTHERS: Mapping[Requirement, str] = {
    "photos": "Photos taken",
    "detection": "Probability of detection",
    "transit-observed": "Evidence on outbound and return transit",
    "separation": "Separation of the vehicles",
    "evidence": "Plausible record",
}
"""Requirements without a figure, which have a row if they do not hold."""


@dataclass(frozen=True, slots=True)
class RequirementRow:
    """A row of the table."""

    name: str  # the requirement
    required: str  # its limit, as text
    found: str  # what the flight did, as text
    holds: Holds  # whether it holds; "not proved" if nothing contradicts it, but too little was observed


def requirement_rows(scenario: Scenario, report: VerificationReport) -> list[RequirementRow]:
    """Rows that compare every requirement and limit of a scenario with the verdict on a flight."""
    limits, requirements = scenario.limits, scenario.requirements
    judge = _Judge(report)
    least, sure = requirements.min_coverage_of_coverable, requirements.min_sure_coverage_of_coverable
    rows = [judge.fraction("coverage", "Coverage of visible ground", least, report.coverage_of_coverable)]
    if sure is not None:
        found = report.surely_covered_of_coverable
        rows.append(judge.fraction("sure-coverage", "Certainly observed visible ground", sure, found))
    if requirements.min_overlap_fraction is not None:
        rows.append(_overlap_row(requirements.min_overlap_fraction, report, judge))
    rows += _observed_rows(scenario, report, judge)
    wanted = f"{limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m"
    flown = f"{_metres(report.min_height_agl_m)} to {_metres(report.max_height_agl_m)}"
    rows.append(judge.limit("height-band", "Height above ground on the route", wanted, flown))
    wanted, flown = f"at least {limits.transit_clearance_m:g} m", _metres(report.min_transit_clearance_m)
    rows.append(judge.limit("transit-clearance", "Clearance on outbound and return transit", wanted, flown))
    wanted, flown = f"at most {scenario.transit_ceiling_agl_m:g} m", _metres(report.max_transit_height_agl_m)
    rows.append(judge.limit("transit-height", "Height above ground on transit legs", wanted, flown))
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        low = "" if limits.min_alt_amsl_m is None else f"from {limits.min_alt_amsl_m:g} m "
        high = "" if limits.max_alt_amsl_m is None else f"to {limits.max_alt_amsl_m:g} m"
        rows.append(judge.kept("sea-level", "Altitude above sea level", (low + high).strip()))
    rows.append(judge.kept("fence", "Inside the fence", "always"))
    if scenario.obstacles.prisms:
        apart = scenario.obstacles
        wanted = f"{apart.clearance_beside_m:g} m beside or {apart.clearance_above_m:g} m above"
        rows.append(judge.kept("obstacles", "Clearance from obstacles", wanted))
    if scenario.no_fly:
        window = scenario.flight_window if report.flown_utc is None else window_of(*report.flown_utc, "flown_utc")
        counting = sum(zone.in_force(window) for zone in scenario.no_fly)
        wanted = counted(counting, "zone")
        rows.append(judge.kept("no-fly-zones", "Outside no-fly zones", wanted))
    if requirements.max_ground_speed_m_s is not None:
        fastest = report.max_ground_speed_m_s
        wanted = f"at most {requirements.max_ground_speed_m_s:g} m/s"
        flown = "unknown" if fastest is None else f"{fastest:.1f} m/s"
        rows.append(judge.limit("ground-speed", "Ground speed on the route", wanted, flown))
    if requirements.max_deviation_m is not None:
        wanted, flown = f"at most {requirements.max_deviation_m:g} m", _metres(report.max_deviation_m)
        rows.append(judge.limit("deviation", "Deviation from the planned route", wanted, flown))
    return [*rows, *judge.others()]


def _overlap_row(required: float, report: VerificationReport, judge: "_Judge") -> RequirementRow:
    photos = report.pictures
    found = None if photos is None else photos.overlap_fraction
    number = "" if photos is None or photos.asked is None else f" {photos.asked}"
    name = f"Area in at least{number} photos (required overlap)"
    return judge.row("overlap", name, f"at least {100.0 * required:g} %", _fraction(found, required))


def _observed_rows(scenario: Scenario, report: VerificationReport, judge: "_Judge") -> list[RequirementRow]:
    """Rows about the observed fraction of the flight."""
    requirements = scenario.requirements
    missing = report.unobserved_route_fraction
    longest_s = max((stretch.duration_s for stretch in report.unobserved if stretch.in_flight), default=0.0)
    outer = ("before the first sample", "after the last sample")
    ends = "; ".join(stretch.detail for stretch in report.unobserved if stretch.reason in outer) or "yes"
    most, most_s = requirements.max_unobserved_fraction, f"at most {requirements.max_unobserved_gap_s:g} s"
    gap, most_of_it = "Longest interval in flight without evidence", f"at most {100.0 * most:g} %"
    return [
        judge.row("unobserved-fraction", "Route time without evidence", most_of_it, _fraction(missing, most)),
        judge.row("unobserved-gap", gap, most_s, f"{longest_s:.1f} s"),
        judge.row("ends", "Track starts and ends on the ground", "always", ends),
    ]


class _Judge:
    """Answers each requirement from the findings."""

    def __init__(self, report: VerificationReport) -> None:
        self._report = report
        self._reported: set[Requirement] = set()

    def row(self, requirement: Requirement, name: str, required: str, found: str) -> RequirementRow:
        """A requirement with the result of the flight."""
        self._reported.add(requirement)
        return RequirementRow(name, required, found, self._report.judgement.holds(requirement))

    @property
    def _observed(self) -> bool:
        return self._report.judgement.holds("unobserved-fraction", "unobserved-gap", "ends") == "yes"

    def limit(self, requirement: Requirement, name: str, required: str, found: str) -> RequirementRow:
        """A limit, which is kept only if the flight was observed."""
        row = self.row(requirement, name, required, found)
        return row if row.holds != "yes" or self._observed else replace(row, holds="not proved")

    def kept(self, requirement: Requirement, name: str, required: str) -> RequirementRow:
        """A limit without a figure."""
        number = sum(LIMIT_OF[violation.kind] == requirement for violation in self._report.violations)
        kept = "kept" if self._observed else "kept wherever observed"
        found = kept if number == 0 else f"left {counted(number, 'time')}"
        return self.limit(requirement, name, required, found)

    def fraction(self, requirement: Requirement, name: str, required: float, found: float) -> RequirementRow:
        """A fraction of the area."""
        return self.row(requirement, name, f"at least {100.0 * required:g} %", _fraction(found, required))

    def others(self) -> list[RequirementRow]:
        """Findings that decided the verdict and have no row yet, so that the table and the verdict say the same."""
        findings = [finding for finding in self._report.judgement.findings if finding.effect != "noted"]
        concerned = dict.fromkeys(
            name for finding in findings for name in finding.concerns if name not in self._reported
        )
        texts = {name: "; ".join(f.text for f in findings if name in f.concerns) for name in concerned}
        return [self.row(name, _OTHERS.get(name, name), "always", text) for name, text in texts.items()]


def _fraction(found: float | None, required: float) -> str:
    return "unknown" if found is None else percent_beside(found, required)


def _metres(value: float | None) -> str:
    return "not known" if value is None else f"{value:.1f} m"
