"""``uavcover bench paper`` as a user gives it."""

from pathlib import Path

from tests.cli.conftest import Cli

SMALL = ("--population", 20, "--iterations", 2, "--runs", 1, "--processes", 1)


def test_list(cli: Cli) -> None:
    assert cli("bench", "paper", "--list", "--json").document["readings"] == [
        "R2-ray",
        "R2-midpoint",
        "r1-ray",
        "r1-midpoint",
        "planar",
    ]


def test_writes_the_tables_and_makes_nothing_twice(cli: Cli, tmp_path: Path) -> None:
    arguments = ("bench", "paper", "--readings", "planar", "-o", tmp_path / "out", *SMALL, "--json")
    first, second = cli(*arguments), cli(*arguments)
    assert (first.code, first.document["made"]) == (0, 2)
    assert (second.code, second.document["made"]) == (0, 0)
    assert "## Which reading fits" in (tmp_path / "out" / "tables.md").read_text()
    assert (tmp_path / "out" / "figure7.png").read_bytes().startswith(b"\x89PNG")


def test_bad_usage_is_one_line(cli: Cli, tmp_path: Path) -> None:
    assert "--readings: unknown: 'R3'" in cli("bench", "paper", "--readings", "R3", "-o", tmp_path).error
    assert "-o/--out: specify a folder" in cli("bench", "paper").error
