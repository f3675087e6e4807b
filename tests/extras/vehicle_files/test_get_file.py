from pathlib import Path
from random import Random

import pytest

from mission_io.formats.files import read_mission
from mission_io.formats.wpl import read_mission_dat, write_mission, write_mission_dat
from mission_io.model.items import Frame, GeoPoint, Mission, MissionItem, MissionType
from tests.cli.conftest import Cli, mock_vehicle


def test_what_was_sent_is_listed_and_comes_back(cli: Cli, tmp_path: Path) -> None:
    sent, got = tmp_path / "N36W085.DAT", tmp_path / "got.DAT"
    sent.write_bytes(Random(1).randbytes(20_000))
    with mock_vehicle("-q", "--loss", "0.1") as (port, _):
        to = ("--to", f"udpout://127.0.0.1:{port}")
        cli("send-file", sent, *to, "--window", 20, code=0)
        listed = cli("get-file", "/APM/TERRAIN/", *to, "--json")
        assert listed.document["entries"] == [{"name": "N36W085.DAT", "folder": False, "bytes": 20_000}]
        assert cli("get-file", "/APM/TERRAIN/N36W085.DAT", *to, "-o", got, "--json").document["bytes"] == 20_000
        assert got.read_bytes() == sent.read_bytes()
        assert "FILE_NOT_FOUND" in cli("get-file", "/nowhere", *to, "-o", got, "--force", code=3).error
        assert got.read_bytes() == sent.read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["N36W085.DAT", "got.DAT"]


@pytest.mark.parametrize(
    ("path", "out", "telling"),
    [
        ("/a/there", "there", "already exists; use --force"),
        ("/a/there", "", "this is a folder; specify a file"),
        ("/a/x", "nowhere/x", "this is not a folder; create it first"),
        ("/a/..", "x", "is not a file name"),
        ("/a/", "x", "this is a folder, which is only listed"),
    ],
)
def test_bad_input_is_one_line(cli: Cli, tmp_path: Path, path: str, out: str, telling: str) -> None:
    (tmp_path / "there").write_bytes(b"kept")
    assert telling in cli("get-file", path, "--to", "mock:", "-o", tmp_path / out, code=2).error
    assert (tmp_path / "there").read_bytes() == b"kept"


def test_the_file_of_a_mission_becomes_waypoints(cli: Cli, tmp_path: Path) -> None:
    home, far = GeoPoint(36.48, -84.22, 500.0), 36.49
    items = [
        MissionItem(command=22, frame=Frame.ABOVE_HOME, alt_m=40.0),
        MissionItem(command=16, frame=Frame.ABOVE_HOME, lat_deg=far, lon_deg=-84.21, alt_m=60.0),
    ]  # fmt: skip
    first = MissionItem(command=16, frame=Frame.AMSL, lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_m=home.alt_amsl_m)
    dat = tmp_path / "mission.dat"
    dat.write_bytes(write_mission_dat([first, *items], MissionType.MISSION))
    with mock_vehicle("-q") as (port, _):
        to = ("--to", f"udpout://127.0.0.1:{port}")
        sent = cli("send-file", dat, *to, "--folder", "@MISSION")
        cli("get-file", "@MISSION/mission.dat", *to, "-o", tmp_path / "m.waypoints", "--json", code=0)
        cli("get-file", "@MISSION/mission.dat", *to, "-o", tmp_path / "raw.dat", code=0)
    assert sent.code == 3  # ArduPilot makes a list of it: what is read afterwards has the vehicle's own home
    assert "arrived with a different CRC" in sent.error
    assert read_mission_dat((tmp_path / "raw.dat").read_bytes(), MissionType.MISSION)[1:] == items
    mission = read_mission(tmp_path / "m.waypoints")
    assert [(item.command, item.lat_deg, item.alt_m) for item in mission.items] == [(22, 0.0, 40.0), (16, far, 60.0)]


@pytest.mark.parametrize(("autopilot", "telling"), [("ardupilot", ""), ("px4", "PX4 does not accept lists as files")])
def test_the_command_says_which_way_it_went(cli: Cli, tmp_path: Path, autopilot: str, telling: str) -> None:
    file = tmp_path / "m.waypoints"
    home, above = GeoPoint(36.48, -84.22, 500.0), Frame.ABOVE_HOME
    items = [MissionItem(16, above, (0.0, 0.0, 0.0, 0.0), 36.48 + 1e-4 * k, -84.22, 40.0) for k in range(12)]
    file.write_text(write_mission(Mission(home, tuple(items))))
    with mock_vehicle("-q", "--autopilot", autopilot) as (port, _):
        ended = cli("upload", file, "--as-file", "--to", f"udpout://127.0.0.1:{port}", "--json")
    assert ended.code == 0, ended.err
    assert ended.document["passed"]
    assert telling in ended.err
    assert ("item by item" in ended.err) == bool(telling)
