from pathlib import Path
from random import Random

import pytest

from tests.cli.conftest import Cli, mock_vehicle


def test_what_was_sent_is_listed_and_comes_back(cli: Cli, tmp_path: Path) -> None:
    sent, got = tmp_path / "N36W085.DAT", tmp_path / "got.DAT"
    sent.write_bytes(Random(1).randbytes(20_000))
    with mock_vehicle("-q", "--loss", "0.1") as (port, _):
        to = ("--to", f"udpout://127.0.0.1:{port}")
        assert cli("send-file", sent, *to, "--window", 20).code == 0
        listed = cli("get-file", "/APM/TERRAIN/", *to, "--json")
        assert listed.document["entries"] == [{"name": "N36W085.DAT", "folder": False, "bytes": 20_000}]
        ended = cli("get-file", "/APM/TERRAIN/N36W085.DAT", *to, "-o", got, "--json")
        assert ended.document["bytes"] == 20_000
        assert got.read_bytes() == sent.read_bytes()
        missing = cli("get-file", "/nowhere", *to, "-o", got, "--force")
        assert missing.code == 3
        assert "FILE_NOT_FOUND" in missing.error
        assert got.read_bytes() == sent.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["N36W085.DAT", "got.DAT"]


@pytest.mark.parametrize(
    ("path", "out", "telling"),
    [
        ("/a/there", "there", "would be overwritten; use --force"),
        ("/a/there", "", "is a folder; name a file"),
        ("/a/x", "nowhere/x", "is no folder; make it first"),
        ("/a/..", "x", "names no file"),
        ("/a/", "x", "a folder is listed, not written"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, tmp_path: Path, path: str, out: str, telling: str) -> None:
    (tmp_path / "there").write_bytes(b"kept")
    ended = cli("get-file", path, "--to", "mock:", "-o", tmp_path / out)
    assert ended.code == 2
    assert telling in ended.error
    assert (tmp_path / "there").read_bytes() == b"kept"
