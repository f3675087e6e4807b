"""``uavcover pareto`` and ``select``."""

import csv
import json
from pathlib import Path

from tests.cli.conftest import Cli
from uavcover.missions.flights import export_text
from uavcover.missions.mission_compiler import compile_mission
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder


def test_table_json_and_picture(cli: Cli, planned: Path, tmp_path: Path) -> None:
    text = cli("pareto", planned, code=0)
    rows = (planned / "pareto.csv").read_text().splitlines()[1:]
    *table, legend, bound, following = text.out.splitlines()
    assert len(table) == len(rows) + 1
    assert sum(line.startswith("*") for line in table) == 1
    assert legend.startswith("*: the route in plan.json")
    assert bound.startswith("shortest path for 98.00 %: at least ")
    assert following == f"Next: uavcover select {planned} RULE"
    photo = tmp_path / "front.png"
    document = cli("pareto", planned, "--plot", photo, "--json").document
    assert len(document["members"]) == len(rows)
    assert document["bounds"]["shortest_path_m"]["at_least"] > 0.0
    assert sum(member["chosen"] for member in document["members"]) == 1
    assert photo.read_bytes().startswith(b"\x89PNG")


def test_errors(cli: Cli, planned: Path, tmp_path: Path) -> None:
    photo = tmp_path / "front.png"
    photo.write_text("mine")
    cli("pareto", planned, "--plot", photo, code=2)
    assert photo.read_text() == "mine"
    assert "uavcover plan" in cli("pareto", tmp_path).error
    (planned / "pareto.csv").write_text("index\n1\n")
    assert "has no column" in cli("pareto", planned).error


def set_of(run: Path) -> list[dict[str, str]]:
    with (run / "pareto.csv").open() as file:
        return list(csv.DictReader(file))


def test_another_member_and_back_again(cli: Cli, planned: Path) -> None:
    kept = {name: (planned / name).read_text() for name in ("pareto.csv", "mission.waypoints", "mission.plan")}
    before = json.loads((planned / "plan.json").read_text())
    rows = set_of(planned)
    (first,) = (int(row["index"]) for row in rows if row["chosen"] == "1")
    longest = max(rows, key=lambda row: float(row["path_length_m"]))
    assert int(longest["index"]) != first
    ended = cli("select", planned, f"index:{longest['index']}", "--json", code=0)
    assert ended.document["index"] == int(longest["index"])
    after = json.loads((planned / "plan.json").read_text())
    assert after["metrics"]["path_length_m"] == float(longest["path_length_m"])
    assert after["metrics"]["coverage_fraction"] == float(longest["coverage_fraction"])
    assert len(after["waypoints"]) == int(longest["waypoint_count"])
    same = ("seed", "algorithm", "evaluations", "wall_s", "bounds", "baselines", "origin")
    assert {name: after[name] for name in same} == {name: before[name] for name in same}
    assert [row["index"] for row in set_of(planned) if row["chosen"] == "1"] == [longest["index"]]
    assert (planned / "mission.waypoints").read_text() != kept["mission.waypoints"]
    site, document = read_planned(RunFolder(planned))
    compiled = compile_mission(site, document.route)
    assert (planned / "mission.waypoints").read_text() == export_text(
        compiled, "waypoints", autopilot="ardupilot", name=site.scenario.name
    )
    cli("select", planned, before["select"], code=0)
    assert {name: (planned / name).read_text() for name in kept} == kept
    assert json.loads((planned / "plan.json").read_text()) == before


def test_a_rule_that_no_member_meets(cli: Cli, planned: Path) -> None:
    ended = cli("select", planned, "coverage>=1", "--json")
    best = max(set_of(planned), key=lambda row: float(row["coverage_of_coverable"]))
    if float(best["coverage_of_coverable"]) == 1.0:
        assert ended.code == 0
        return
    assert ended.code == 1
    assert "no route meets coverage>=1" in ended.err
    assert ended.document["metrics"]["coverage_of_coverable"] == float(best["coverage_of_coverable"])


def test_the_report_of_a_plan_that_was_not_flown_goes_with_its_route(cli: Cli, planned: Path) -> None:
    """It was taken for something flown, and --force was asked for."""
    (planned / "report.html").write_text("of the route before")
    cli("select", planned, "max-coverage", code=0)
    assert not (planned / "report.html").exists()
    (planned / "report.html").write_text("of a flight")
    (planned / "verification.json").write_text("{}")
    assert "already contains report.html, verification.json" in cli("select", planned, "max-coverage").error


def test_errors_change_nothing(cli: Cli, planned: Path, tmp_path: Path) -> None:
    kept = {path.name: path.read_bytes() for path in planned.iterdir()}
    assert "unknown rule" in cli("select", planned, "best").error
    assert "does not exist; the set" in cli("select", planned, "index:999").error
    assert "uavcover plan" in cli("select", tmp_path / "nowhere", "knee").error
    assert {path.name: path.read_bytes() for path in planned.iterdir()} == kept
    (planned / "track.csv").write_text("flown")
    assert "track.csv" in cli("select", planned, "max-coverage", code=2).error
    assert (planned / "track.csv").read_text() == "flown"
    cli("select", planned, "max-coverage", "--force", code=0)
    assert not (planned / "track.csv").exists()
    assert (planned / "older-1" / "track.csv").read_text() == "flown"
    assert (planned / "older-1" / "plan.json").read_bytes() == kept["plan.json"]
    routes = planned / "pareto_routes.csv"
    lines = routes.read_text().splitlines()
    routes.write_text("\n".join([lines[0], *lines[2:]]))
    assert "pareto_routes.csv: line 2: this is not the next waypoint" in cli("select", planned, "knee", code=2).error
    routes.unlink()
    assert "has no pareto_routes.csv" in cli("select", planned, "knee").error
