import re
from pathlib import Path

import pytest

from tests.cli.conftest import Cli, mock_vehicle


@pytest.mark.parametrize("name", ["mission.waypoints", "mission.plan", "fence.waypoints", "rally.waypoints"])
def test_files_of_ours(cli: Cli, planned: Path, name: str) -> None:
    ended = cli("upload", planned / name, "--to", "mock:", "--json", "-q")
    assert ended.code == 0
    assert ended.document["passed"] is True
    assert ended.document["terrain_checked"] is False
    assert "terrain not checked" in ended.error, "is said even under -q"
    types = [part["mission_type"] for part in ended.document["lists"]]
    assert types == (["mission", "fence", "rally"] if name.endswith(".plan") else [name.split(".")[0]])


def test_type_picks_a_list(cli: Cli, planned: Path) -> None:
    ended = cli("upload", planned / "mission.plan", "--to", "mock:", "--type", "fence", "--json")
    assert [part["mission_type"] for part in ended.document["lists"]] == ["fence"]


def test_home_of_another_place_is_told(cli: Cli, planned: Path) -> None:
    with mock_vehicle("--home", "36.4772,-84.2160,385.4") as (port, _):
        ended = cli("upload", planned / "mission.waypoints", "--to", f"udpout://127.0.0.1:{port}")
    assert ended.code == 0
    assert re.search(r"home is 111 m from the file's, 100 m below it", ended.err)


@pytest.mark.parametrize(
    ("name", "content", "telling"),
    [
        ("empty.waypoints", b"", "line 1"),
        ("other.waypoints", b"hello\n", "line 1"),
        ("binary.waypoints", b"\xff\xfe\x00", "not a text file"),
        ("broken.plan", b"{", "broken.plan"),
        ("nothing.plan", b"{}", "nothing.plan"),
        ("cut.waypoints", b"QGC WPL 110\n0\t1\t0\t16\t0\t0\n", "cut.waypoints: line 2"),
    ],
)
def test_bad_files(cli: Cli, tmp_path: Path, name: str, content: bytes, telling: str) -> None:
    (tmp_path / name).write_bytes(content)
    ended = cli("upload", tmp_path / name, "--to", "mock:")
    assert ended.code == 2
    assert telling in ended.error


def test_bad_usage(cli: Cli, planned: Path) -> None:
    assert "cannot be read" in cli("upload", planned / "nope.plan", "--to", "mock:").error
    assert "--type" in cli("upload", planned / "mission.plan", "--to", "mock:", "--type", "geofence").error
    assert "one list" in cli("upload", planned / "mission.waypoints", "--to", "mock:", "--type", "all").error
