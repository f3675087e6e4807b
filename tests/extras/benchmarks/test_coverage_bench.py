"""The coverage benchmark: judging, baselines, order, tables, on small budgets."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from pymoo.indicators.hv import HV

from tests.planner.sites import hills, make_site
from uavcover.extras.benchmarks.coverage.judging import (
    CASES,
    CHOICES,
    Case,
    Chosen,
    HoldOut,
    Judge,
    JudgedMoment,
    Point,
    hypervolume_fraction,
    moment_document,
    read_moment,
)
from uavcover.extras.benchmarks.coverage.results import (
    CoverageOutcome,
    Outcomes,
    is_no_worse,
    mean_between,
    read_outcomes,
    runs_csv,
    tables_markdown,
    write_results,
)
from uavcover.extras.benchmarks.coverage.runs import (
    CONTENDERS,
    EVALUATIONS,
    ONCE,
    OURS,
    PLANNERS,
    CoverageRun,
    Tried,
    effort_of,
    length_at,
    make_runs,
    plan_for,
    run_of_key,
    scan,
    short_families,
    wanted_runs,
)
from uavcover.extras.benchmarks.runs import KeptRuns
from uavcover.missions.leg_checks import corner_excess_m
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import best_height_agl_m, fly_layout, long_side_angle_rad, regular_layout
from uavcover.planner.baselines.initial_routes import NodeRows, fly_rows, scanned_rows
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M
from uavcover.scenario.scenario_file import bundled_scenarios
from uavcover.scenario.site import load_site

PLANAR = CASES["paper-planar"]


@pytest.fixture(scope="module")
def judge() -> Judge:
    return Judge(PLANAR, load_site("paper-planar"))


class TestHypervolume:
    def test_as_pymoo_tells_it(self) -> None:
        rng = np.random.default_rng(2)
        front = [Point(*values) for values in rng.uniform([0.2, 1, 5], [1.0, 70, 130], (30, 3)).tolist()]
        values = np.array([[-p.coverage, p.waypoints, p.length_m] for p in front])
        case = Case("x", "knee", 1.0, 61.0, 120.0)
        theirs = HV(ref_point=np.array([0.0, 61.0, 120.0]))(values) / (61.0 * 120.0)
        assert hypervolume_fraction(case, front) == pytest.approx(theirs)
        high = HV(ref_point=np.array([-0.8, 61.0, 120.0]))(values) / (0.2 * 61.0 * 120.0)
        assert hypervolume_fraction(case, front, from_coverage=0.8) == pytest.approx(high)

    def test_the_ideal_is_one_and_nothing_is_nothing(self) -> None:
        assert hypervolume_fraction(PLANAR, [Point(1.0, 0.0, 0.0)]) == 1.0
        assert hypervolume_fraction(PLANAR, []) == 0.0
        assert hypervolume_fraction(PLANAR, [Point(1.0, 61.0, 1.0)]) == 0.0


class TestJudge:
    def test_choices(self, judge: Judge) -> None:
        routes = [
            (fly_rows(judge.site, layout), name)
            for name, layout in (
                ("few", NodeRows(4, 4, 0.0, 0.5)),
                ("all", NodeRows(8, 8, 0.0, 0.5)),
                ("too many", NodeRows(9, 9, 0.0, 0.5)),
            )
        ]
        moment, route = judge.moment(3.0, routes)
        assert moment.at_s == 3.0
        assert [p.waypoints for p in moment.front] == [16.0, 64.0]
        assert moment.chosen["asked"].made_by == moment.chosen["max-coverage"].made_by == "all"
        assert moment.chosen["asked"].met
        assert moment.chosen["asked"].violation == 0.0
        assert route is not None
        assert len(route.route) == moment.chosen["rule"].waypoints == 64
        hold_out = HoldOut(judge.site).coverage_of_coverable(routes[1][0].waypoints_m)
        assert moment.chosen["asked"].hold_out == hold_out

    def test_what_breaks_a_limit_is_not_there(self, judge: Judge) -> None:
        under = Route(np.array([[1.0, 1.0, -3.0], [5.0, 5.0, -3.0]]))
        moment, route = judge.moment(1.0, [(under, "mole")])
        assert (moment.front, moment.chosen, route) == ((), {}, None)

    def test_corners_are_mended_as_before_a_planner_chooses(self) -> None:
        """Its route does not count otherwise: over 25 km² there are hundreds of corners to mend."""
        site = make_site(
            lambda east, north: np.where((east > 105.0) & (north > 105.0), -60.0, 0.0), limits={"height_margin_m": 0.0}
        )
        judge = Judge(Case("pit", "coverage>=0.2", 0.2, 100.0, 20_000.0), site)
        turning = Route(np.array([[100.0, 190.0, 119.5], [100.0, 100.0, 119.5], [290.0, 100.0, 119.5]]))
        assert corner_excess_m(site, turning.waypoints_m).sum() > 0.0
        moment, member = judge.moment(1.0, [(turning, "turning")])
        assert member is not None
        assert moment.chosen["asked"].met
        assert corner_excess_m(site, member.route.waypoints_m).sum() == 0.0

    def test_out_of_reach_is_said(self, judge: Judge) -> None:
        moment, _ = judge.moment(1.0, [(fly_rows(judge.site, NodeRows(2, 2, 0.0, 0.5)), "few")])
        assert not moment.chosen["asked"].met
        assert moment.chosen["max-coverage"].met

    def test_through_json_and_back(self, judge: Judge) -> None:
        moment, _ = judge.moment(1.5, [(fly_rows(judge.site, NodeRows(5, 5, 0.5, 0.5)), "x")])
        assert read_moment(moment_document(moment)) == moment


class TestLengthAt:
    def test_between_numbers_of_lines_of_one_family(self) -> None:
        def one(family: str, lines: int, hold_out: float, length_m: float, violation: float = 0.0) -> Tried:
            return Tried(family, lines, hold_out, hold_out, 2 * lines, length_m, violation)

        tried = [
            one("north", 10, 0.90, 1000.0), one("north", 11, 0.94, 1100.0), one("north", 13, 0.99, 1300.0),
            one("east", 10, 0.95, 1400.0), one("east", 9, 0.80, 900.0, 5.0),
        ]  # fmt: skip
        assert length_at(tried, 0.92) == pytest.approx(1050.0)
        assert length_at(tried, 0.94) == 1100.0
        assert length_at(tried, 0.96) == 1300.0  # 12 lines were not tried: nothing between 11 and 13
        assert length_at(tried, 0.5) == 1000.0  # what breaks a limit does not count
        assert math.isnan(length_at(tried, 0.999))

    def test_only_families_that_are_short_somewhere_are_judged(self) -> None:
        def family(name: str, *pairs: tuple[float, float]) -> list[Tried]:
            return [Tried(name, k, observed, observed, 2, length, 0.0) for k, (observed, length) in enumerate(pairs)]

        tried = [
            *family("short", (0.9, 100.0), (1.0, 200.0)),
            *family("short at last", (0.9, 150.0), (1.0, 209.0)),
            *family("long", (0.9, 106.0), (1.0, 211.0)),
            *family("sees too little", (0.8, 10.0)),
        ]
        assert short_families(tried, [0.9, 1.0]) == {"short", "short at last"}
        assert short_families(tried, [0.8]) == {"sees too little"}
        assert "long" in short_families(tried, [0.9], longer=1.06)

    def test_the_shortest_lines_over_hills_are_tried_closer_to_the_terrain_too(self) -> None:
        site = make_site(hills, ring=((0.0, 0.0), (600.0, 0.0), (600.0, 500.0), (0.0, 500.0)))
        judge = Judge(Case("hills", "coverage>=0.98", 0.98, 100.0, 20_000.0), site)
        tried, routes = scan(judge)
        assert len(tried) == len(routes)
        assert {"1", "2"} <= {one.family.split()[-2] for one in tried}
        height_m, angle_rad = best_height_agl_m(site), long_side_angle_rad(site.area)
        loose = [
            (fly_layout(site, regular_layout(
                angle_rad=angle_rad, lines=lines, height_agl_m=height_m, inset=0.8, tolerance_m=PLAIN_TOLERANCE_M
            )), "x")
            for lines in range(3, 9)
        ]  # fmt: skip
        moment, _ = judge.moment(0.0, loose)
        assert moment.chosen["asked"].met
        assert length_at(tried, 0.98) < moment.chosen["asked"].length_m

    def test_a_scan_has_what_a_scan_of_everything_would_choose(self, judge: Judge) -> None:
        tried, routes = scan(judge)
        assert len(tried) == len(routes) > 50
        moment, _ = judge.moment(0.0, routes)
        assert moment.chosen["asked"].met
        whole = [(fly_rows(judge.site, rows), "x") for rows in scanned_rows(judge.site, most_nodes=60)]
        best, _ = judge.moment(0.0, whole)
        assert moment.chosen["asked"].length_m <= best.chosen["asked"].length_m


class TestOrder:
    def test_most_telling_first(self) -> None:
        runs = wanted_runs(
            scenarios=["jacksboro", "paper-r1"], algorithms=CONTENDERS, seeds=10, seeds_long=2, times_s=[300, 10, 60]
        )
        efforts = list(dict.fromkeys(run.effort for run in runs))
        assert efforts == [ONCE, "10s", EVALUATIONS, "60s", "300s"]
        shortest = [run for run in runs if run.effort == "10s"]
        assert len(shortest) == 10 * 2 * len(PLANNERS)
        assert [run.number for run in shortest[: 2 * len(PLANNERS)]] == [1] * 2 * len(PLANNERS)
        assert max(run.number for run in runs if run.effort == "300s") == 2
        assert len({str(run) for run in runs}) == len(runs)

    def test_a_key_tells_its_run(self) -> None:
        run = CoverageRun("jacksboro", OURS, effort_of(0.5), 7)
        assert str(run) == "jacksboro/memetic/0.5s/7"
        assert run_of_key(str(run)) == run
        assert run.budget_s == 0.5
        assert CoverageRun("jacksboro", OURS, ONCE, 1).budget_s is None

    def test_scenarios_are_bundled(self) -> None:
        assert set(CASES) - {"ridge-obstacles"} <= set(bundled_scenarios())


class TestPlanners:
    def test_a_rival_counts_only_what_it_found_itself(self) -> None:
        site = load_site("jacksboro")
        case = CASES["jacksboro"]
        found = plan_for(site, case, "imodbo", seed=1, evaluations=80, moments_s=[])
        assert {name for routes in found.moments.values() for _, name in routes} == {"imodbo"}
        assert found.evaluations == 80

    def test_moments_of_one_run(self) -> None:
        site = load_site("paper-planar")
        found = plan_for(site, PLANAR, "modbo", seed=2, evaluations=50, moments_s=[0.1, 0.4])
        assert sorted(found.moments) == [0.1, 0.4]
        assert found.cpu_s > 0.3, "CPU seconds of the search to its last moment, 0.4, less what it began with"


def outcome(
    run: CoverageRun, moments: list[tuple[float, float, float]], tried: tuple[Tried, ...] = ()
) -> CoverageOutcome:
    """Moments as (time, coverage, length)."""
    return CoverageOutcome(
        run,
        tuple(
            JudgedMoment(
                at_s,
                (Point(coverage, 30.0, length),),
                {name: Chosen(coverage >= 1.0, coverage, 0.9, 30, length, 0.0, run.algorithm) for name in CHOICES},
            )
            for at_s, coverage, length in moments
        ),
        100,
        1.0,
        tried,
    )


class TestTables:
    def outcomes(self) -> Outcomes:
        tried = (Tried("a", 5, 0.9, 0.9, 10, 80.0, 0.0),)
        runs = [
            outcome(CoverageRun("paper-r1", "boustrophedon", ONCE, 1), [(0.1, 0.9, 70.0)]),
            outcome(CoverageRun("paper-r1", "boustrophedon-tuned", ONCE, 1), [(5.0, 1.0, 80.0)], tried),
        ]
        for number, length in ((1, 60.0), (2, 90.0)):
            runs.append(outcome(CoverageRun("paper-r1", OURS, "10s", number), [(10.0, 1.0, length)]))
            runs.append(outcome(CoverageRun("paper-r1", "nsga2", "10s", number), [(10.0, 0.5, length + 7)]))
        runs.append(outcome(CoverageRun("paper-r1", OURS, "60s", 1), [(10.0, 0.7, 99.0), (60.0, 1.0, 55.0)]))
        runs.append(outcome(CoverageRun("paper-r1", OURS, "60s", 3), [(10.0, 1.0, 77.0), (60.0, 1.0, 56.0)]))
        return Outcomes(runs)

    def test_a_shorter_budget_is_told_by_its_own_runs_else_by_longer_ones(self) -> None:
        lengths = [sample.required_m for sample in self.outcomes().at("paper-r1", OURS, 10.0)]
        assert lengths == [60.0, 90.0, 77.0]
        assert self.outcomes().times_s() == [10.0, 60.0]

    def test_best_baseline_and_no_worse(self) -> None:
        outcomes = self.outcomes()
        assert outcomes.best_baseline_m("paper-r1") == 80.0
        assert [is_no_worse(length, 80.0) for length in (79.0, 80.0, 80.1, math.nan)] == [True, True, False, False]
        assert is_no_worse(99.0, math.nan)
        assert math.isnan(outcomes.best_baseline_m("jacksboro"))

    def test_the_table(self) -> None:
        text = tables_markdown(self.outcomes(), version="0", command="c", date="d")
        assert "the best baseline has it with 80.0" in text
        line = next(one for one in text.splitlines() if one.startswith("| **memetic** | 10 s |"))
        cells = [cell.strip() for cell in line.split("|")]
        assert cells[3:5] == ["3", "100.00 (100.00)"]
        assert cells[7] == "75.7 (90.0)"
        assert cells[8] == "5.4 %"  # 80 at the same hold-out coverage
        assert cells[9:11] == ["75.7 (3/3)", "2/3"]
        nsga2 = next(one for one in text.splitlines() if one.startswith("| nsga2 | 10 s |"))
        assert "none (0/2)" in nsga2
        assert "## HV at 10 s: memetic against the others" in text

    def test_rows_are_unrounded(self) -> None:
        rows = list(csv.DictReader(runs_csv(self.outcomes()).splitlines()))
        assert len(rows) == (2 + 4 + 4) * len(CHOICES)
        assert {row["boustrophedon_m"] for row in rows} == {"80.0"}


def test_from_runs_to_files_and_nothing_twice(tmp_path: Path) -> None:
    folder = KeptRuns(tmp_path, {"benchmark": "coverage"})
    wanted = wanted_runs(
        scenarios=["paper-planar"],
        algorithms=["boustrophedon", OURS, "nsga2"],
        seeds=1,
        seeds_long=1,
        times_s=[0.2, 0.4],
        equal_evaluations=False,
    )
    assert {run.effort for run in wanted} == {ONCE, "0.2s", "0.4s"}
    made = list(make_runs(folder, wanted, times_s=[0.2, 0.4], processes=1))
    assert made == wanted
    names = [path.name for path in write_results(folder, command="uavcover bench coverage")]
    assert names == ["runs.csv", "table.md", "coverage.png"]
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")
    outcomes = read_outcomes(folder)
    for algorithm in (OURS, "nsga2"):
        early, late = outcomes.at("paper-planar", algorithm, 0.2), outcomes.at("paper-planar", algorithm, 0.4)
        assert (len(early), len(late)) == (1, 1)
        assert late[0].hypervolume() > 0.2
        assert late[0].chosen("rule") is not None
    ours = outcomes.at("paper-planar", OURS, 0.4)[0]
    assert ours.outcome.cpu_s < 5.0
    route = np.array(folder.read("paper-planar/memetic/0.4s/1")["route"])
    chosen = ours.chosen("rule")
    assert chosen is not None
    assert HoldOut(load_site("paper-planar")).coverage_of_coverable(route) == chosen.hold_out


def test_a_planner_that_finds_nothing_has_found_nothing() -> None:
    site = load_site("paper-planar")
    limits = dataclasses.replace(site.scenario.limits, min_height_agl_m=1.9, max_alt_amsl_m=0.5)
    narrow = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, limits=limits))
    found = plan_for(narrow, PLANAR, "nsga2", seed=1, evaluations=100, moments_s=[])
    moment, _ = Judge(PLANAR, narrow).moment(1.0, next(iter(found.moments.values())))
    assert moment.front == ()


def test_the_mean_of_equal_values_is_that_value() -> None:
    for count in range(1, 12):
        for value in (0.1, 0.7, 149136.16405, 1e-3 / 3.0):
            assert mean_between([value] * count) == value
    assert mean_between([1.0, 2.0, 6.0]) == 3.0
