import csv
import json
import re

import numpy as np

from tests.cli.conftest import EVALUATIONS, Cli, DemoRun, files

EVERY_FILE = {
    "scenario.toml", "run.json", "pareto.csv", "pareto_routes.csv", "plan.json",
    "mission.waypoints", "mission.plan", "fence.waypoints",
    "rally.waypoints", "mission.kml", "upload.json", "track.csv", "flight.rrd", "flight.tlog", "verification.json",
    "coverage.tif", "report.html",
}  # fmt: skip


def test_demo_flies_what_it_planned(demo_run: DemoRun) -> None:
    assert demo_run.ended.code == 0, demo_run.ended.err
    assert files(demo_run.folder) == EVERY_FILE
    verdict = json.loads((demo_run.folder / "verification.json").read_text())
    plan = json.loads((demo_run.folder / "plan.json").read_text())
    assert verdict["passed"]
    assert verdict["coverage_of_coverable"] >= 0.95
    assert abs(verdict["coverage_fraction"] - plan["metrics"]["coverage_fraction"]) <= 0.03
    assert verdict["violations"] == []
    assert verdict["planned_coverage_fraction"] == plan["metrics"]["coverage_fraction"]
    assert plan["evaluations"] == int(EVALUATIONS)
    assert json.loads((demo_run.folder / "upload.json").read_text())["passed"]


def test_answer_is_one_object(demo_run: DemoRun) -> None:
    document = demo_run.ended.document
    assert document["upload_passed"] is True
    assert document["flight"]["ending"] == "landed"
    assert document["verification"]["passed"] is True
    for said in ("planned", "flown", "above ground", "Open next", "inspect", "mission.waypoints"):
        assert said in demo_run.ended.err


def test_track_has_five_samples_a_second(demo_run: DemoRun) -> None:
    with (demo_run.folder / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    times = np.array([float(row["time_s"]) for row in rows])
    assert (len(times) - 1) / (times[-1] - times[0]) >= 5.0
    # 20 s of vehicle time are 0.2 s here: pauses of a busy machine are no gaps of the record.
    assert np.max(np.diff(times)) < 20.0


def test_numbers_are_unrounded(demo_run: DemoRun) -> None:
    plan = (demo_run.folder / "plan.json").read_text()
    digits = [len(number) for number in re.findall(r'"(?:up_m|lat_deg|lon_deg)": -?\d+\.(\d+)', plan)]
    assert np.median(digits) >= 12
    with (demo_run.folder / "pareto.csv").open() as file:
        rows = list(csv.DictReader(file))
    chosen = next(row for row in rows if row["chosen"] == "1")
    assert float(chosen["coverage_fraction"]) == json.loads(plan)["metrics"]["coverage_fraction"]


def test_run_json_says_where_it_comes_from(demo_run: DemoRun) -> None:
    run = json.loads((demo_run.folder / "run.json").read_text())
    assert run["schema_version"] == 1
    assert "demo" in run["command"]
    assert run["seed"] == 1
    assert all(run["packages"].values())
    assert len(run["inputs"]["terrain"]["sha256"]) == len(run["inputs"]["scenario"]["sha256"]) == 64
    assert set(run["stages"]) == {"plan", "upload", "fly and record", "verify"}


def test_nothing_is_overwritten_without_force(cli: Cli, demo_run: DemoRun) -> None:
    assert "--force" in cli("demo", "-o", demo_run.folder, code=2).err


def test_scenario_without_a_place_is_refused_before_planning(cli: Cli, tmp_path: object) -> None:
    assert "no position on Earth" in cli("demo", "-o", f"{tmp_path}/run", "--scenario", "paper-R2", code=2).error


def test_bad_speed(cli: Cli, tmp_path: object) -> None:
    assert "--speed" in cli("demo", "-o", f"{tmp_path}/run", "--speed", 0).error
