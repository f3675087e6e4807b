"""What was asked, what was found, and whether that is enough: the table of requirements."""

from collections.abc import Iterable
from dataclasses import dataclass

from uavcover.model.report import VerificationReport, ViolationKind
from uavcover.model.scenario import Scenario


@dataclass(frozen=True, slots=True)
class RequirementRow:
    """A line of the table.

    Attributes:
        name: what is required.
        asked: the limit, for people.
        found: what the flight did, for people.
        passed: whether it holds.
    """

    name: str
    asked: str
    found: str
    passed: bool


def requirement_rows(scenario: Scenario, report: VerificationReport) -> list[RequirementRow]:
    """Every requirement and limit of a scenario against the verdict on a flight."""
    limits, requirements = scenario.limits, scenario.requirements
    count = _Counts(report)
    rows = [
        _share_row("Seen, of what can be seen", requirements.min_coverage_of_coverable, report.coverage_of_coverable)
    ]
    if requirements.min_sure_coverage_of_coverable is not None:
        rows.append(
            _share_row(
                "Surely seen, of what can be seen",
                requirements.min_sure_coverage_of_coverable,
                report.surely_covered_of_coverable,
            )
        )
    rows.append(
        RequirementRow(
            "Height above ground on the route",
            f"{limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m",
            f"{_metres(report.min_height_agl_m)} to {_metres(report.max_height_agl_m)}",
            count.none("below-band", "above-band") and report.min_height_agl_m is not None,
        )
    )
    rows.append(
        RequirementRow(
            "Clearance on the ways there and home",
            f"at least {limits.transit_clearance_m:g} m",
            _metres(report.min_transit_clearance_m),
            count.none("clearance"),
        )
    )
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        low = "" if limits.min_alt_amsl_m is None else f"from {limits.min_alt_amsl_m:g} m "
        high = "" if limits.max_alt_amsl_m is None else f"to {limits.max_alt_amsl_m:g} m"
        kinds: tuple[ViolationKind, ...] = ("below-sea-level-limit", "above-sea-level-limit")
        rows.append(
            RequirementRow("Height above sea level", (low + high).strip(), count.words(*kinds), count.none(*kinds))
        )
    rows.append(RequirementRow("Inside the fence", "always", count.words("fence"), count.none("fence")))
    if scenario.obstacles.prisms:
        apart = scenario.obstacles
        wanted = f"{apart.clearance_beside_m:g} m beside or {apart.clearance_above_m:g} m above"
        rows.append(RequirementRow("Clear of obstacles", wanted, count.words("obstacle"), count.none("obstacle")))
    if requirements.max_ground_speed_m_s is not None:
        fastest = report.max_ground_speed_m_s
        rows.append(
            RequirementRow(
                "Speed over ground on the route",
                f"at most {requirements.max_ground_speed_m_s:g} m/s",
                "not known" if fastest is None else f"{fastest:.1f} m/s",
                fastest is not None and count.none("ground-speed"),
            )
        )
    if requirements.max_deviation_m is not None:
        deviation = report.max_deviation_m
        rows.append(
            RequirementRow(
                "Distance from the planned route",
                f"at most {requirements.max_deviation_m:g} m",
                _metres(deviation),
                deviation is not None and count.none("deviation") and deviation <= requirements.max_deviation_m,
            )
        )
    return rows


class _Counts:
    def __init__(self, report: VerificationReport) -> None:
        self._report = report

    def _of(self, kinds: Iterable[str]) -> int:
        return sum(violation.kind in kinds for violation in self._report.violations)

    def none(self, *kinds: ViolationKind) -> bool:
        return self._of(kinds) == 0

    def words(self, *kinds: ViolationKind) -> str:
        number = self._of(kinds)
        return "kept" if number == 0 else f"left {number} time{'s' if number > 1 else ''}"


def _share_row(name: str, asked: float, found: float) -> RequirementRow:
    return RequirementRow(name, f"at least {100.0 * asked:g} %", f"{100.0 * found:.2f} %", found >= asked)


def _metres(value: float | None) -> str:
    return "not known" if value is None else f"{value:.1f} m"
