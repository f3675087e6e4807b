"""``--algorithm module:Class``: a file in the current folder plans a run."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, corner_of_the_demo
from tests.optimizers.test_own import EXAMPLE


def test_the_example_of_the_page_by_the_command(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = corner_of_the_demo(tmp_path)
    monkeypatch.chdir(tmp_path)
    Path("search_of_command_test.py").write_text(EXAMPLE)
    arguments = ("plan", scenario, "--evaluations", 100, "--seed", 3, "-o", tmp_path / "run", "--algorithm")
    cli(*arguments, "search_of_command_test:MySearch", code=0)
    document = json.loads((tmp_path / "run" / "plan.json").read_text())
    assert document["algorithm"] == "search_of_command_test:MySearch"
    ended = cli(*arguments, "search_of_command_test:Missing", "--force", code=2)
    assert "has no Missing; choose one of MySearch" in ended.err
    assert json.loads((tmp_path / "run" / "plan.json").read_text()) == document
