"""The table of requirements says of each what verification found."""

import dataclasses

import pytest

from uavcover.model.obstacles import Obstacle, Obstacles
from uavcover.model.report import Violation, ViolationKind
from uavcover.report.content import ReportContent
from uavcover.report.requirements import RequirementRow, requirement_rows


def rows_of(content: ReportContent, *violations: Violation, **requirements: object) -> dict[str, RequirementRow]:
    assert content.verdict is not None
    scenario = content.site.scenario
    asked = dataclasses.replace(scenario.requirements, **requirements)  # type: ignore[arg-type]
    limits = dataclasses.replace(scenario.limits, max_alt_amsl_m=2000.0)
    shed = Obstacle(height_m=5.0, rings_east_north_m=(((0.0, 0.0), (5.0, 0.0), (5.0, 5.0)),))
    scenario = dataclasses.replace(
        scenario, requirements=asked, limits=limits, obstacles=Obstacles(prisms=(shed,), clearance_above_m=7.0)
    )
    report = dataclasses.replace(content.verdict.report, violations=violations)
    return {row.name: row for row in requirement_rows(scenario, report)}


def violation(kind: ViolationKind) -> Violation:
    return Violation(
        kind=kind, start_s=1.0, end_s=2.0, worst_s=1.5, worst=9.0, limit=8.0, excess=1.0, unit="m", lat_deg=36.0,
        lon_deg=-84.0, east_m=0.0, north_m=0.0, phase="route",
    )  # fmt: skip


def test_a_share_is_compared_with_what_was_asked(content: ReportContent) -> None:
    assert content.verdict is not None
    found = content.verdict.report.coverage_of_coverable
    assert 0.2 < found < 0.6
    name = "Seen, of what can be seen"
    assert rows_of(content, min_coverage_of_coverable=found)[name].passed
    row = rows_of(content, min_coverage_of_coverable=0.7)[name]
    assert not row.passed
    assert (row.asked, row.found) == ("at least 70 %", f"{100.0 * found:.2f} %")


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("below-band", "Height above ground on the route"),
        ("above-band", "Height above ground on the route"),
        ("clearance", "Clearance on the ways there and home"),
        ("above-sea-level-limit", "Height above sea level"),
        ("fence", "Inside the fence"),
        ("obstacle", "Clear of obstacles"),
        ("ground-speed", "Speed over ground on the route"),
        ("deviation", "Distance from the planned route"),
    ],
)
def test_a_violation_fails_its_own_line(content: ReportContent, kind: ViolationKind, name: str) -> None:
    asked: dict[str, object] = {
        "min_coverage_of_coverable": 0.0, "max_ground_speed_m_s": 30.0, "max_deviation_m": 50.0,
    }  # fmt: skip
    assert all(row.passed for row in rows_of(content, **asked).values())
    rows = rows_of(content, violation(kind), **asked)
    assert [row.name for row in rows.values() if not row.passed] == [name]


def test_what_is_not_required_has_no_line(content: ReportContent) -> None:
    assert "Speed over ground on the route" not in rows_of(content)
    assert "Distance from the planned route" not in rows_of(content)
    assert "Surely seen, of what can be seen" in rows_of(content, min_sure_coverage_of_coverable=0.1)
