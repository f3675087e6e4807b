import signal
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, command, started


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
