"""The table of requirements: what was required, what was found, and whether that is enough.

Whether a requirement holds is what the findings of the verdict say of it: the table decides nothing of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mission_io.model.plain_text import counted
from uavcover.model.active_times import window_of
from uavcover.model.scenario import Scenario
from uavcover.model.verdict import LIMIT_OF, Holds, Requirement, VerificationReport, percent_beside

_OTHERS: Mapping[Requirement, str] = {
    "photos": "Photos taken",
    "detection": "Probability of detection",
    "transit-observed": "Evidence on outbound and return transit",
    "separation": "Separation of the vehicles",
    "evidence": "Plausible record",
}
"""Requirements without a figure of their own, which have a row where they do not hold."""


@dataclass(frozen=True, slots=True)
class RequirementRow:
    """A row of the table."""

    name: str  # the requirement
    asked: str  # its limit, for people
    found: str  # what the flight did, for people
    holds: Holds  # whether it holds; "not proved" where nothing breaks it, but not enough was observed


def requirement_rows(scenario: Scenario, report: VerificationReport) -> list[RequirementRow]:
    """Rows that compare every requirement and limit of a scenario with the verdict on a flight."""
    limits, requirements = scenario.limits, scenario.requirements
    judge = _Judge(report)
    least, sure = requirements.min_coverage_of_coverable, requirements.min_sure_coverage_of_coverable
    rows = [judge.share("coverage", "Coverage of visible ground", least, report.coverage_of_coverable)]
    if sure is not None:
        found = report.surely_covered_of_coverable
        rows.append(judge.share("sure-coverage", "Certainly observed visible ground", sure, found))
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


def _overlap_row(asked: float, report: VerificationReport, judge: "_Judge") -> RequirementRow:
    pictures = report.pictures
    found = None if pictures is None else pictures.overlap_fraction
    number = "" if pictures is None or pictures.asked is None else f" {pictures.asked}"
    name = f"Area in at least{number} photos (required overlap)"
    return judge.row("overlap", name, f"at least {100.0 * asked:g} %", _share(found, asked))


def _observed_rows(scenario: Scenario, report: VerificationReport, judge: "_Judge") -> list[RequirementRow]:
    """Rows about how much of the flight was observed."""
    requirements = scenario.requirements
    missing = report.unobserved_route_fraction
    longest_s = max((stretch.duration_s for stretch in report.unobserved if stretch.in_flight), default=0.0)
    outer = ("before the first sample", "after the last sample")
    ends = "; ".join(stretch.detail for stretch in report.unobserved if stretch.reason in outer) or "yes"
    most, most_s = requirements.max_unobserved_fraction, f"at most {requirements.max_unobserved_gap_s:g} s"
    gap = "Longest interval in flight without evidence"
    return [
        judge.row(
            "unobserved-fraction", "Route time without evidence", f"at most {100.0 * most:g} %", _share(missing, most)
        ),
        judge.row("unobserved-gap", gap, most_s, f"{longest_s:.1f} s"),
        judge.row("ends", "Track starts and ends on the ground", "always", ends),
    ]


class _Judge:
    """Answers each requirement from the findings."""

    def __init__(self, report: VerificationReport) -> None:
        self._report = report
        self._told: set[Requirement] = set()

    def row(self, requirement: Requirement, name: str, asked: str, found: str) -> RequirementRow:
        """A requirement with what was found."""
        self._told.add(requirement)
        return RequirementRow(name, asked, found, self._report.judgement.holds(requirement))

    @property
    def _observed(self) -> bool:
        return self._report.judgement.holds("unobserved-fraction", "unobserved-gap", "ends") == "yes"

    def limit(self, requirement: Requirement, name: str, asked: str, found: str) -> RequirementRow:
        """A limit, which is kept only as far as the flight was observed."""
        row = self.row(requirement, name, asked, found)
        return row if row.holds != "yes" or self._observed else replace(row, holds="not proved")

    def kept(self, requirement: Requirement, name: str, asked: str) -> RequirementRow:
        """A limit without a figure."""
        number = sum(LIMIT_OF[violation.kind] == requirement for violation in self._report.violations)
        kept = "kept" if self._observed else "kept wherever observed"
        found = kept if number == 0 else f"left {counted(number, 'time')}"
        return self.limit(requirement, name, asked, found)

    def share(self, requirement: Requirement, name: str, asked: float, found: float) -> RequirementRow:
        """A share of the area."""
        return self.row(requirement, name, f"at least {100.0 * asked:g} %", _share(found, asked))

    def others(self) -> list[RequirementRow]:
        """Findings that decided the verdict and have no row yet, so that the table and the verdict say the same."""
        findings = [finding for finding in self._report.judgement.findings if finding.effect != "noted"]
        concerned = dict.fromkeys(name for finding in findings for name in finding.concerns if name not in self._told)
        texts = {name: "; ".join(f.text for f in findings if name in f.concerns) for name in concerned}
        return [self.row(name, _OTHERS.get(name, name), "always", text) for name, text in texts.items()]


def _share(found: float | None, asked: float) -> str:
    return "unknown" if found is None else percent_beside(found, asked)


def _metres(value: float | None) -> str:
    return "not known" if value is None else f"{value:.1f} m"
