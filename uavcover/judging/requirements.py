"""The table of requirements: what was required, what was found, and whether that is enough."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from uavcover.model.active_times import window_of
from uavcover.model.scenario import Scenario
from uavcover.model.verdict import Unobserved, VerificationReport, ViolationKind, percent_beside

Holds = Literal["yes", "no", "not proved"]


@dataclass(frozen=True, slots=True)
class RequirementRow:
    """A row of the table.

    Attributes:
        name: the requirement.
        asked: its limit, for people.
        found: what the flight did, for people.
        holds: whether it holds; "not proved" where nothing breaks it, but not enough was observed.
    """

    name: str
    asked: str
    found: str
    holds: Holds


def requirement_rows(scenario: Scenario, report: VerificationReport) -> list[RequirementRow]:
    """Rows that compare every requirement and limit of a scenario with the verdict on a flight."""
    limits, requirements = scenario.limits, scenario.requirements
    judge = _Judge(scenario, report)
    rows = [
        judge.share("Seen, of what can be seen", requirements.min_coverage_of_coverable, report.coverage_of_coverable)
    ]
    if requirements.min_sure_coverage_of_coverable is not None:
        rows.append(
            judge.share(
                "Surely seen, of what can be seen",
                requirements.min_sure_coverage_of_coverable,
                report.surely_covered_of_coverable,
            )
        )
    if requirements.min_overlap_fraction is not None:
        rows.append(_overlap_row(requirements.min_overlap_fraction, report))
    rows += _observed_rows(scenario, report)
    rows.append(
        RequirementRow(
            "Height above ground on the route",
            f"{limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m",
            f"{_metres(report.min_height_agl_m)} to {_metres(report.max_height_agl_m)}",
            judge.none("below-band", "above-band", known=report.min_height_agl_m is not None),
        )
    )
    rows.append(
        RequirementRow(
            "Clearance on the ways there and home",
            f"at least {limits.transit_clearance_m:g} m",
            _metres(report.min_transit_clearance_m),
            judge.none("clearance"),
        )
    )
    rows.append(
        RequirementRow(
            "Height above ground on the ways there and home",
            f"at most {scenario.transit_ceiling_agl_m:g} m",
            _metres(report.max_transit_height_agl_m),
            judge.none("above-transit-height"),
        )
    )
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        low = "" if limits.min_alt_amsl_m is None else f"from {limits.min_alt_amsl_m:g} m "
        high = "" if limits.max_alt_amsl_m is None else f"to {limits.max_alt_amsl_m:g} m"
        kinds: tuple[ViolationKind, ...] = ("below-sea-level-limit", "above-sea-level-limit")
        rows.append(
            RequirementRow("Height above sea level", (low + high).strip(), judge.words(*kinds), judge.none(*kinds))
        )
    rows.append(RequirementRow("Inside the fence", "always", judge.words("fence"), judge.none("fence")))
    if scenario.obstacles.prisms:
        apart = scenario.obstacles
        wanted = f"{apart.clearance_beside_m:g} m beside or {apart.clearance_above_m:g} m above"
        rows.append(RequirementRow("Clear of obstacles", wanted, judge.words("obstacle"), judge.none("obstacle")))
    if scenario.no_fly:
        window = scenario.flight_window if report.flown_utc is None else window_of(*report.flown_utc, "flown_utc")
        counting = sum(zone.in_force(window) for zone in scenario.no_fly)
        wanted = f"{counting} zone{'s' if counting != 1 else ''}"
        rows.append(
            RequirementRow("Outside of no-fly zones", wanted, judge.words("no-fly-zone"), judge.none("no-fly-zone"))
        )
    if requirements.max_ground_speed_m_s is not None:
        fastest = report.max_ground_speed_m_s
        rows.append(
            RequirementRow(
                "Speed over ground on the route",
                f"at most {requirements.max_ground_speed_m_s:g} m/s",
                "not known" if fastest is None else f"{fastest:.1f} m/s",
                judge.none("ground-speed", known=fastest is not None),
            )
        )
    if requirements.max_deviation_m is not None:
        deviation = report.max_deviation_m
        rows.append(
            RequirementRow(
                "Distance from the planned route",
                f"at most {requirements.max_deviation_m:g} m",
                _metres(deviation),
                judge.none("deviation", known=deviation is not None),
            )
        )
    return rows


def _overlap_row(asked: float, report: VerificationReport) -> RequirementRow:
    pictures = report.pictures
    found = None if pictures is None else pictures.overlap_fraction
    number = "" if pictures is None or pictures.asked is None else f" {pictures.asked}"
    short: Holds = (
        "no" if any(reason.startswith("the overlap asked for") for reason in report.reasons) else "not proved"
    )
    return RequirementRow(
        f"Ground in at least{number} pictures, as the overlap asks",
        f"at least {100.0 * asked:g} %",
        "not known" if found is None else percent_beside(found, asked),
        "yes" if found is not None and found >= asked else short,
    )


def _observed_rows(scenario: Scenario, report: VerificationReport) -> list[RequirementRow]:
    """Rows about how much of the flight was observed."""
    requirements = scenario.requirements
    missing = report.unobserved_route_fraction
    longest_s = max((stretch.duration_s for stretch in report.unobserved if stretch.in_flight), default=0.0)
    open_ends = [stretch for stretch in report.unobserved if _is_open_end(stretch)]
    return [
        RequirementRow(
            "Not observed, of the route's time",
            f"at most {100.0 * requirements.max_unobserved_fraction:g} %",
            "not known" if missing is None else percent_beside(missing, requirements.max_unobserved_fraction),
            "yes" if missing is not None and missing <= requirements.max_unobserved_fraction else "not proved",
        ),
        RequirementRow(
            "Longest stretch in the air that was not observed",
            f"at most {requirements.max_unobserved_gap_s:g} s",
            f"{longest_s:.1f} s",
            "yes" if longest_s <= requirements.max_unobserved_gap_s else "not proved",
        ),
        RequirementRow(
            "Observed from the ground to the ground",
            "always",
            "; ".join(stretch.detail for stretch in open_ends) or "yes",
            "not proved" if open_ends else "yes",
        ),
    ]


def _is_open_end(stretch: Unobserved) -> bool:
    return stretch.reason in {"before the first sample", "after the last sample"}


class _Judge:
    """Judges whether a limit was kept, as far as it was observed."""

    def __init__(self, scenario: Scenario, report: VerificationReport) -> None:
        self._report = report
        self._observed = all(row.holds == "yes" for row in _observed_rows(scenario, report))

    def _of(self, kinds: Iterable[str]) -> int:
        return sum(violation.kind in kinds for violation in self._report.violations)

    def none(self, *kinds: ViolationKind, known: bool = True) -> Holds:
        """Whether there is no violation of these kinds."""
        if self._of(kinds):
            return "no"
        return "yes" if known and self._observed else "not proved"

    def words(self, *kinds: ViolationKind) -> str:
        """Number of violations, in words."""
        number = self._of(kinds)
        kept = "kept" if self._observed else "kept where it was observed"
        return kept if number == 0 else f"left {number} time{'s' if number > 1 else ''}"

    def share(self, name: str, asked: float, found: float) -> RequirementRow:
        """Insufficient coverage is not proved when the verdict has no other reason to fail."""
        short: Holds = "no" if any("coverage" in reason for reason in self._report.reasons) else "not proved"
        holds: Holds = "yes" if found >= asked else short
        return RequirementRow(name, f"at least {100.0 * asked:g} %", percent_beside(found, asked), holds)


def _metres(value: float | None) -> str:
    return "not known" if value is None else f"{value:.1f} m"
