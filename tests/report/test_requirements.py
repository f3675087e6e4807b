"""The table of requirements says of each what verification found."""

import dataclasses
from typing import Any, get_args

import numpy as np
import pytest

from uavcover.model.limits import Obstacle, Obstacles
from uavcover.model.verdict import (
    LIMIT_OF,
    Effect,
    Finding,
    Holds,
    Judgement,
    Requirement,
    Violation,
    ViolationKind,
    combined,
    fails,
    unproved,
)
from uavcover.report.content import ReportContent
from uavcover.verification.decision import RequirementRow, requirement_rows


def rows_of(
    content: ReportContent,
    *violations: Violation,
    found: dict[str, Any] | None = None,
    findings: tuple[Finding, ...] = (),
    **requirements: object,
) -> dict[str, RequirementRow]:
    found = {} if found is None else found
    assert content.verdict is not None
    scenario = content.site.scenario
    required = dataclasses.replace(scenario.requirements, **requirements)  # type: ignore[arg-type]
    limits = dataclasses.replace(scenario.limits, max_alt_amsl_m=2000.0)
    shed = Obstacle(height_m=5.0, rings_east_north_m=(((0.0, 0.0), (5.0, 0.0), (5.0, 5.0)),))
    scenario = dataclasses.replace(
        scenario, requirements=required, limits=limits, obstacles=Obstacles(prisms=(shed,), clearance_above_m=7.0)
    )
    # As if all of the flight had been observed.
    observed: dict[str, Any] = {"unobserved": (), "unobserved_route_fraction": 0.0}
    findings = (*findings, *(fails(LIMIT_OF[each.kind], "a limit was left") for each in violations))
    report = dataclasses.replace(
        content.verdict.report, violations=violations, judgement=Judgement(findings), **(observed | found)
    )
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
    name = "Coverage of visible ground"
    assert rows_of(content, min_coverage_of_coverable=found)[name].holds == "yes"
    short = (fails("coverage", "short"),)
    row = rows_of(content, findings=short, min_coverage_of_coverable=0.7)[name]
    assert row.holds == "no"
    assert (row.required, row.found) == ("at least 70 %", f"{100.0 * found:.2f} %")


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("below-band", "Height above ground on the route"),
        ("above-band", "Height above ground on the route"),
        ("clearance", "Clearance on outbound and return transit"),
        ("above-transit-height", "Height above ground on transit legs"),
        ("above-sea-level-limit", "Altitude above sea level"),
        ("fence", "Inside the fence"),
        ("obstacle", "Clearance from obstacles"),
        ("ground-speed", "Ground speed on the route"),
        ("deviation", "Deviation from the planned route"),
    ],
)
def test_a_violation_fails_its_own_line(content: ReportContent, kind: ViolationKind, name: str) -> None:
    required: dict[str, object] = {
        "min_coverage_of_coverable": 0.0, "max_ground_speed_m_s": 30.0, "max_deviation_m": 50.0,
    }  # fmt: skip
    assert all(row.holds == "yes" for row in rows_of(content, **required).values())
    rows = rows_of(content, violation(kind), **required)
    assert [row.name for row in rows.values() if row.holds != "yes"] == [name]
    assert rows[name].holds == "no"


def test_what_is_not_required_has_no_line(content: ReportContent) -> None:
    assert "Ground speed on the route" not in rows_of(content)
    assert "Deviation from the planned route" not in rows_of(content)
    assert "Certainly observed visible ground" in rows_of(content, min_sure_coverage_of_coverable=0.1)


def test_where_too_little_was_observed_no_limit_is_said_to_hold(content: ReportContent) -> None:
    missing = {"unobserved_route_fraction": 0.02}
    little = (unproved("unobserved-fraction", "2 % were not observed"),)
    rows = rows_of(content, violation("clearance"), found=missing, findings=little, min_coverage_of_coverable=0.0)
    assert rows["Route time without evidence"].holds == "not proved"
    assert rows["Route time without evidence"].found == "2.00 %"
    fence = rows["Inside the fence"]
    assert (fence.holds, fence.found) == ("not proved", "kept wherever observed")
    # What was seen to be broken is broken all the same.
    assert rows["Clearance on outbound and return transit"].holds == "no"
    allowed = rows_of(content, found=missing, min_coverage_of_coverable=0.0, max_unobserved_fraction=0.02)
    assert allowed["Inside the fence"].holds == "yes"


@pytest.mark.parametrize("seed", range(40))
def test_the_table_says_what_the_verdict_says(content: ReportContent, seed: int) -> None:
    """Whatever is found: failed with a row that does not hold, not proved with one that is not, passed when all hold."""
    rng = np.random.default_rng(seed)
    names = [name for name in get_args(Requirement) if name != "mission"]
    effects: list[Effect] = ["fails", "not proved", "noted"]
    findings = tuple(
        Finding(
            effects[rng.choice(3, p=(0.2, 0.4, 0.4))],
            tuple(rng.choice(names, rng.integers(1, 4), replace=False).tolist()),
            "the coverage and the overlap asked for",
        )
        for _ in range(rng.integers(4))
    )
    rows = rows_of(content, findings=findings).values()
    answers: dict[Holds, Effect] = {"yes": "noted", "no": "fails", "not proved": "not proved"}
    assert combined(answers[row.holds] for row in rows) == Judgement(findings).verdict


def test_words_of_a_finding_decide_nothing(content: ReportContent) -> None:
    rows = rows_of(content, findings=(fails("separation", "coverage: the overlap asked for is missed"),))
    assert rows["Coverage of visible ground"].holds == "yes"
    assert rows["Separation of the vehicles"].holds == "no"
