"""The commands of the benchmarks."""

import json
import select
import signal
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, command, in_process, started
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.extras.benchmarks.mmf.runs import CONTENDERS

SMALL = ("--population", 12, "--iterations", 4, "--archive", 8)


def sets(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.glob("sets/*/*/*.csv"))}


def test_list_names_everything(cli: Cli) -> None:
    ended = cli("bench", "mmf", "--list", "--json")
    assert ended.document == {"functions": list(PROBLEMS), "algorithms": list(CONTENDERS)}
    assert "MMF16_l3" in cli("bench", "mmf", "--list").out


def test_leaves_the_layout_that_was_promised(cli: Cli, tmp_path: Path) -> None:
    ended = cli(
        "bench", "mmf", "--functions", "MMF4,MMF1", "--algorithms", "imodbo,random", "--runs", 2, "-o", tmp_path / "out",
        *SMALL, "--json",
     code=0)  # fmt: skip
    assert (ended.document["runs"], ended.document["made"]) == (8, 8)
    lines = (tmp_path / "out" / "summary.csv").read_text().splitlines()
    assert lines[0] == "function,algorithm,metric,mean,std,median,runs"
    assert len(lines) == 1 + 2 * 2 * 5
    assert list(sets(tmp_path / "out")) == [
        f"sets/{function}/{algorithm}/{run}.csv"
        for function in ("MMF1", "MMF4")
        for algorithm in ("imodbo", "random")
        for run in (1, 2)
    ]


def test_the_same_command_again_makes_nothing(cli: Cli, tmp_path: Path) -> None:
    arguments = ("bench", "mmf", "--functions", "MMF2", "--algorithms", "uniform", "--runs", 1, "-o", tmp_path, *SMALL)
    assert f"runs: 1; already in {tmp_path}: 0" in cli(*arguments).out
    assert f"runs: 1; already in {tmp_path}: 1" in cli(*arguments).out


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("--functions", "MMF1,MMF99"), "--functions: unknown: 'MMF99'; choose from MMF1"),
        (("--algorithms", ","), "--algorithms: no name is given; choose from imodbo"),
        ((), "-o/--out: specify a folder"),
    ],
)
def test_bad_usage_is_one_line(cli: Cli, arguments: tuple[str, ...], reported: str) -> None:
    assert reported in cli("bench", "mmf", *arguments, code=2).error


def test_population_too_small_for_an_algorithm(cli: Cli, tmp_path: Path) -> None:
    ended = cli(
        "bench", "mmf", "--functions", "MMF1", "--algorithms", "imodbo", "-o", tmp_path, "--population", 2, code=2
    )
    assert "population_size" in ended.error


def test_a_folder_of_something_else_is_left_alone(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    assert "use another folder" in cli("bench", "mmf", "-o", tmp_path, *SMALL, code=2).error
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


TWELVE = (
    "bench", "mmf", "--functions", "MMF1,MMF15", "--algorithms", "imodbo,nsga2", "--runs", 3,
    "--population", 40, "--iterations", 30, "--archive", 20,
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve runs that nothing disturbed."""
    folder = tmp_path_factory.mktemp("mmf") / "whole"
    assert in_process(*TWELVE, "-o", folder).code == 0
    return folder


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_stopped_hard_in_the_middle_and_resumed_gives_the_same_sets(
    cli: Cli, tmp_path: Path, whole: Path, how: signal.Signals
) -> None:
    broken = tmp_path / "broken"
    with started(command(*TWELVE, "-o", broken)) as process:
        while len(sets(broken)) < 3:
            assert process.poll() is None
            select.select([], [], [], 0.02)
        process.send_signal(how)
        _, errors = process.communicate()
    before = sets(broken)
    assert 3 <= len(before) < 12
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "run the command again to continue" in errors
    stamps = {name: (broken / name).stat().st_mtime_ns for name in before}
    assert json.loads(cli(*TWELVE, "-o", broken, "--json", code=0).out)["made"] <= 12 - len(before)
    assert sets(broken) == sets(whole)
    assert {name: (broken / name).stat().st_mtime_ns for name in before} == stamps
    assert (broken / "summary.csv").read_bytes() == (whole / "summary.csv").read_bytes()
    assert not list(broken.glob("sets/*/*/.*"))


def test_a_missing_package_is_refused_before_anything_is_computed(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pymoo.core.problem", None)
    ended = cli("bench", "mmf", "-o", tmp_path / "mmf", "--functions", "MMF1", "--algorithms", "imodbo,nsga2", code=2)
    assert "requires pymoo" in ended.error
    assert not (tmp_path / "mmf").exists()


SMALL_PAPER = ("--population", 20, "--iterations", 2, "--runs", 1, "--processes", 1)


def test_list_of_readings(cli: Cli) -> None:
    assert cli("bench", "paper", "--list", "--json").document["readings"] == [
        "R2-ray",
        "R2-midpoint",
        "r1-ray",
        "r1-midpoint",
        "planar",
    ]


def test_writes_the_tables_and_makes_nothing_twice(cli: Cli, tmp_path: Path) -> None:
    arguments = ("bench", "paper", "--readings", "planar", "-o", tmp_path / "out", *SMALL_PAPER, "--json")
    first, second = cli(*arguments), cli(*arguments)
    assert (first.code, first.document["made"]) == (0, 2)
    assert (second.code, second.document["made"]) == (0, 0)
    assert "## Which reading fits" in (tmp_path / "out" / "tables.md").read_text()
    assert (tmp_path / "out" / "figure7.png").read_bytes().startswith(b"\x89PNG")


def test_bad_usage_of_paper_is_one_line(cli: Cli, tmp_path: Path) -> None:
    assert "--readings: unknown: 'R3'" in cli("bench", "paper", "--readings", "R3", "-o", tmp_path).error
    assert "-o/--out: specify a folder" in cli("bench", "paper").error


def test_list_of_scenarios(cli: Cli) -> None:
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
    assert "--time:" in cli("bench", "coverage", "--time", times, "-o", tmp_path, code=2).error


def test_bad_usage_of_coverage_is_one_line(cli: Cli) -> None:
    assert "-o/--out: specify a folder" in cli("bench", "coverage").error
    assert "--algorithms: unknown: 'spiral'" in cli("bench", "coverage", "--algorithms", "spiral").error


def test_simulated_transfers_are_tabulated_and_kept(cli: Cli, tmp_path: Path) -> None:
    wanted = ("bench", "link", "-o", tmp_path / "link", "--clients", "simulated", "--losses", "0,0.2", "--seeds", 2)
    first = cli(*wanted, "--json")
    assert (first.code, first.document) == (0, {"transfers": 16, "made": 16, "wrong_unnoticed": 0})
    table = (tmp_path / "link" / "link.md").read_text()
    assert "| px4 | download | 1 ms | 20% | 2/2 |" in table
    assert len((tmp_path / "link" / "link.csv").read_text().splitlines()) == 1 + 8
    again = cli(*wanted)
    assert "transfers: 16; already in" in again.out
    assert again.out.endswith(table)


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        ((), "-o/--out"),
        (("-o", "x", "--clients", "pigeon"), "choose from simulated, native, mavsdk"),
        (("-o", "x", "--losses", "some"), "must be a list of numbers"),
        (("-o", "x", "--losses", "0,1"), "below 1"),
        (("-o", "x", "--losses", "nan"), "below 1"),
    ],
)
def test_bad_usage(cli: Cli, arguments: tuple[str, ...], telling: str) -> None:
    ended = cli("bench", "link", *arguments)
    assert (ended.code, telling in ended.error) == (2, True)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_stopped_and_resumed(cli: Cli, tmp_path: Path, how: signal.Signals) -> None:
    wanted = ("bench", "link", "-o", tmp_path, "--clients", "simulated", "--losses", "0.3", "--seeds", 8)
    outcomes = tmp_path / "outcomes.csv"
    with started(command(*wanted)) as process:
        while not outcomes.exists() or outcomes.read_text().count("\n") < 5:
            assert process.poll() is None
        process.send_signal(how)
        _, errors = process.communicate()
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "run the command again to continue" in errors
    done = outcomes.read_text().count("\n") - 1
    assert 4 <= done < 32
    resumed = cli(*wanted, "--json")
    assert (resumed.code, resumed.document["made"]) == (0, 32 - done)
    assert outcomes.read_text().count("\n") == 33
