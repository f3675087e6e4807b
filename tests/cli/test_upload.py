import re
import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest

from mission_io.autopilots import PX4
from mission_io.formats import wpl
from mission_io.items import Frame, GeoPoint, Mission, waypoint
from mission_io.link import UdpLink
from tests.cli.conftest import Cli, command, mock_vehicle, started
from tests.cli.relay import Relay
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


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


def test_ctrl_c_says_what_the_vehicle_holds(planned: Path) -> None:
    """An ArduPilot writes over its list item by item: the user is told which items are new, and sees the list."""
    with mock_vehicle() as (port, _), ExitStack() as stack:
        upload: list[subprocess.Popen[str]] = []

        def interrupt(items: int) -> None:
            if items == 5:
                upload[0].send_signal(signal.SIGINT)

        relay = stack.enter_context(Relay(port, interrupt))
        arguments = command("upload", planned / "mission.waypoints", "--to", f"udpout://127.0.0.1:{relay.port}")
        upload.append(stack.enter_context(started(arguments)))
        _, err = upload[0].communicate(timeout=60.0)
    assert upload[0].returncode == 130
    assert "this side cancelled" in err
    assert re.search(r"list is now mixed \(\d+ items, of which the first \d+ are new\); upload again, or clear it", err)
    assert re.search(r"held now: 0: NAV_WAYPOINT \(16\) at 36\.\d+, -84\.\d+", err)
    assert err.rstrip().endswith("interrupted")
    assert "Traceback" not in err


def test_a_refused_list_is_told(cli: Cli, tmp_path: Path) -> None:
    link = UdpLink.listening()
    peer = VehiclePeer(PX4, capacity=3)
    with flying_on(link, peer):
        file = tmp_path / "four.waypoints"
        items = tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(4))
        file.write_text(wpl.write_mission(Mission(GeoPoint(46.5, -7.25, 500.0), items)))
        ended = cli("upload", file, "--to", f"udpout://127.0.0.1:{link.local_port}", "--link", "telemetry-radio")
    assert ended.code == 3
    assert "NO_SPACE" in ended.err
    assert "list is now unchanged" in ended.err
