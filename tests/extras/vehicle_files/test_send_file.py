from pathlib import Path
from random import Random

import pytest

from tests.cli.conftest import Cli, mock_vehicle


def test_files_are_sent_and_compared(cli: Cli, tmp_path: Path) -> None:
    files = [tmp_path / "N36W085.DAT", tmp_path / "empty.txt"]
    files[0].write_bytes(Random(1).randbytes(20_000))
    files[1].write_bytes(b"")
    with mock_vehicle("-q", "--loss", "0.1") as (port, _):
        ended = cli("send-file", *files, "--to", f"udpout://127.0.0.1:{port}", "--window", 20, "--json")
    assert ended.code == 0
    assert ended.document["files"] == {"/APM/TERRAIN/N36W085.DAT": 20_000, "/APM/TERRAIN/empty.txt": 0}


@pytest.mark.parametrize(
    ("names", "telling"),
    [
        (["nowhere.DAT"], "nowhere.DAT: the file cannot be read"),
        (["a/x", "b/x"], "the same name"),
        (["."], "cannot be read"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, tmp_path: Path, names: list[str], telling: str) -> None:
    for name in names:
        if "/" in name:
            (tmp_path / name).parent.mkdir()
            (tmp_path / name).write_bytes(b"1")
    assert telling in cli("send-file", *(tmp_path / name for name in names), "--to", "mock:", code=2).error


def test_a_path_that_no_vehicle_has_is_an_error(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"1")
    ended = cli("send-file", tmp_path / "x", "--folder", "/" + "a" * 250, "--to", "mock:")
    assert ended.code != 0
    assert "not a vehicle path" in ended.error
