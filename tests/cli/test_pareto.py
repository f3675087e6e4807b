from pathlib import Path

from tests.cli.conftest import Cli


def test_table_json_and_picture(cli: Cli, planned: Path, tmp_path: Path) -> None:
    text = cli("pareto", planned)
    assert text.code == 0
    rows = (planned / "pareto.csv").read_text().splitlines()[1:]
    *table, legend, bound, following = text.out.splitlines()
    assert len(table) == len(rows) + 1
    assert sum(line.startswith("*") for line in table) == 1
    assert legend.startswith("*: the route in plan.json")
    assert bound.startswith("shortest path for 98.00 %: at least ")
    assert following == f"Next: uavcover select {planned} RULE"
    picture = tmp_path / "front.png"
    document = cli("pareto", planned, "--plot", picture, "--json").document
    assert len(document["members"]) == len(rows)
    assert document["bounds"]["shortest_path_m"]["at_least"] > 0.0
    assert sum(member["chosen"] for member in document["members"]) == 1
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_errors(cli: Cli, planned: Path, tmp_path: Path) -> None:
    picture = tmp_path / "front.png"
    picture.write_text("mine")
    assert cli("pareto", planned, "--plot", picture).code == 2
    assert picture.read_text() == "mine"
    assert "uavcover plan" in cli("pareto", tmp_path).error
    (planned / "pareto.csv").write_text("index\n1\n")
    assert "has no column" in cli("pareto", planned).error
