import json
import re
import signal
import subprocess
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.formats import plan, wpl
from mission_io.formats.csv_tables import write_csv
from mission_io.links.datagrams import UdpLink
from mission_io.model.items import (
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    GeoPoint,
    LatLon,
    Mission,
    RallyPoints,
    waypoint,
)
from tests.cli.conftest import WATCHDOG_S, Cli, command, mock_vehicle, started
from tests.cli.relay import Relay
from tests.mission_io.formats.samples import fen_text
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer
from uavcover.cli.transfers import read_contents
from uavcover.errors import InputError


@pytest.mark.parametrize("name", ["mission.waypoints", "mission.plan", "fence.waypoints", "rally.waypoints"])
def test_files_of_ours(cli: Cli, planned: Path, name: str) -> None:
    ended = cli("upload", planned / name, "--to", "mock:", "--json", "-q", code=0)
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
    assert re.search(r"home is 111 m from the home in the file and 100 m below it", ended.err)


@pytest.mark.parametrize(
    ("name", "content", "telling"),
    [
        ("empty.waypoints", b"", "line 1"),
        ("other.waypoints", b"hello\n", "line 1"),
        ("binary.waypoints", b"\xff\xfe\x00", "invalid UTF-16"),
        ("zero.plan", b"\x7fELF\0", "the file has a zero byte, so it is not text"),
        ("places.kml", b"<kml/>", "a .kml file contains positions but no mission items"),
        ("table.csv", b"a,b\n", "line 1"),
        ("short.fen", b"46.5 -7.25\n", "short.fen"),
        ("broken.plan", b"{", "broken.plan"),
        ("nothing.plan", b"{}", "nothing.plan"),
        ("cut.waypoints", b"QGC WPL 110\n0\t1\t0\t16\t0\t0\n", "cut.waypoints: line 2"),
    ],
)
def test_bad_files(cli: Cli, tmp_path: Path, name: str, content: bytes, telling: str) -> None:
    (tmp_path / name).write_bytes(content)
    assert telling in cli("upload", tmp_path / name, "--to", "mock:", code=2).error


def test_bad_usage(cli: Cli, planned: Path) -> None:
    assert "cannot read the file" in cli("upload", planned / "nope.plan", "--to", "mock:").error
    assert "--type" in cli("upload", planned / "mission.plan", "--to", "mock:", "--type", "geofence").error
    assert "one list" in cli("upload", planned / "mission.waypoints", "--to", "mock:", "--type", "all").error


ROUTE = Mission(
    GeoPoint(46.5, -7.25, 500.0),
    tuple(waypoint(46.5 + i * 1e-4, -7.25, 30.0, frame=Frame.ABOVE_HOME) for i in range(3)),
)
FENCE = Fence((FencePolygon((LatLon(46.4, -7.4), LatLon(46.6, -7.4), LatLon(46.6, -7.1))),), (), None)


@pytest.mark.parametrize(
    ("name", "text", "kind", "count"),
    [
        ("route.csv", write_csv(ROUTE), "mission", 4),
        ("route.plan", plan.write(plan.PlanFile(ROUTE, Fence(), RallyPoints(), mav_autopilot=3)), "mission", 4),
        ("route.txt", wpl.write_mission(ROUTE), "mission", 4),
        ("field.fen", fen_text(replace(FENCE, return_point=FramedPoint(46.5, -7.3, 0.0))), "fence", 4),
    ],
)
def test_every_format_that_holds_items(cli: Cli, tmp_path: Path, name: str, text: str, kind: str, count: int) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    ended = cli("upload", tmp_path / name, "--to", "mock:", "--json", code=0)
    assert [(part["mission_type"], len(part["sent"])) for part in ended.document["lists"]] == [(kind, count)]
    assert "repaired" not in ended.err
    assert "doubtful" not in ended.err


@pytest.mark.parametrize(("name", "kind"), [("route.csv", "rally"), ("field.fen", "mission")])
def test_a_list_that_the_format_cannot_hold(tmp_path: Path, name: str, kind: str) -> None:
    (tmp_path / name).write_text("")
    with pytest.raises(InputError, match=f"omit --type {kind}"):
        read_contents(tmp_path / name, kind)


def _swapped(mission: Mission) -> Mission:
    items = tuple(replace(item, lat_deg=item.lon_deg, lon_deg=item.lat_deg) for item in mission.items)
    return replace(mission, items=items)


WRITERS: dict[str, Callable[[Mission], str]] = {
    "waypoints": wpl.write_mission,
    "plan": lambda mission: plan.write(plan.PlanFile(mission, Fence(), RallyPoints(), mav_autopilot=3)),
    "csv": write_csv,
}


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize(
    ("mission", "doubt"),
    [
        (_swapped(ROUTE), "latitude and longitude seem to be swapped"),
        (replace(ROUTE, home=GeoPoint(0.0, 0.0, 0.0)), "home is at latitude 0, longitude 0"),
        (replace(ROUTE, home=GeoPoint(48.5, -7.25, 500.0)), "km from home"),
    ],
    ids=["swapped", "no home", "far"],
)
def test_what_is_probably_a_mistake_is_told_of_every_format(
    tmp_path: Path, suffix: str, mission: Mission, doubt: str
) -> None:
    file = tmp_path / f"route.{suffix}"
    file.write_text(WRITERS[suffix](mission), encoding="utf-8")
    contents, remarks = read_contents(file, None)
    assert len(contents) == 1
    assert any(remark.startswith("doubtful: ") and doubt in remark for remark in remarks), remarks


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize(
    ("encoding", "repair"),
    [
        ("utf-16", "decoded from UTF-16"),
        ("utf-32", "decoded from UTF-32"),
        ("utf-8-sig", "removed a byte order mark"),
        ("utf-8", "changed the line ends to LF"),
    ],
)
def test_text_of_other_programs_is_read(tmp_path: Path, suffix: str, encoding: str, repair: str) -> None:
    file = tmp_path / f"route.{suffix}"
    file.write_bytes(WRITERS[suffix](ROUTE).replace("\n", "\r\n").encode(encoding))
    contents, remarks = read_contents(file, None)
    assert contents == [ROUTE]
    assert f"repaired: {repair}" in remarks
    assert "repaired: changed the line ends to LF" in remarks


def test_what_was_repaired_and_what_is_doubtful_are_warnings(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "route.plan"
    file.write_text(WRITERS["plan"](_swapped(ROUTE)), encoding="utf-16")
    ended = cli("upload", file, "--to", "mock:", "-q", code=0)
    assert "route.plan: repaired: decoded from UTF-16" in ended.err
    assert "latitude and longitude seem to be swapped" in ended.err


def test_what_a_plan_lacks_is_told(tmp_path: Path) -> None:
    document = json.loads(WRITERS["plan"](ROUTE))
    del document["rallyPoints"]
    file = tmp_path / "route.plan"
    file.write_text(json.dumps(document), encoding="utf-8")
    assert read_contents(file, None)[1] == ("repaired: plan.rallyPoints is missing; the plan was read without it",)


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
        _, err = upload[0].communicate(timeout=WATCHDOG_S)
    assert upload[0].returncode == 130
    assert "the client cancelled the transfer" in err
    assert re.search(
        r"list is now mixed \(\d+ items, the first \d+ of which are new\); upload the list again, or clear it", err
    )
    assert re.search(r"now on the vehicle: 0: NAV_WAYPOINT \(16\) at 36\.\d+, -84\.\d+", err)
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
