"""``uavcover bench coverage`` as a user gives it."""

from pathlib import Path

import pytest

from tests.cli.conftest import Cli


def test_list(cli: Cli) -> None:
    document = cli("bench", "coverage", "--list", "--json").document
    assert "ridge-25km2" in document["scenarios"]
    assert document["algorithms"][0] == "boustrophedon"


def test_writes_the_table_and_makes_nothing_twice(cli: Cli, tmp_path: Path) -> None:
    arguments = (
        "bench", "coverage", "--scenarios", "paper-planar", "--algorithms", "boustrophedon,modbo", "--seeds", 1,
        "--time", "0.2", "--no-equal-evaluations", "--processes", 1, "-o", tmp_path / "out", "--json",
    )  # fmt: skip
    first, second = cli(*arguments), cli(*arguments)
    assert (first.code, first.document["made"]) == (0, 2)
    assert (second.code, second.document["made"]) == (0, 0)
    assert "| boustrophedon | once | 1 |" in (tmp_path / "out" / "table.md").read_text()
    assert (
        "--algorithms boustrophedon,modbo --seeds 1 --seeds-long 3 --time 0.2 --no-equal-evaluations -o DIR"
        in (tmp_path / "out" / "table.md").read_text()
    )


@pytest.mark.parametrize("times", ["0", "ten", "10,-3", ""])
def test_bad_times_are_one_line(cli: Cli, tmp_path: Path, times: str) -> None:
    ended = cli("bench", "coverage", "--time", times, "-o", tmp_path)
    assert ended.code == 2
    assert "--time:" in ended.error


def test_bad_usage_is_one_line(cli: Cli) -> None:
    assert "-o/--out: specify a folder" in cli("bench", "coverage").error
    assert "--algorithms: unknown: 'spiral'" in cli("bench", "coverage", "--algorithms", "spiral").error
