"""docs/reference/mission_io.md and docs/explanation/mission_protocol.md: their examples run, and the diagrams are the tables'."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from mission_io import write_mission
from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.formats import wpl
from mission_io.links.datagrams import UdpLink
from mission_io.model.items import MissionType, fence_from_items
from tests.mission_io.formats.samples import MISSION
from tests.mission_io.formats.test_plan_complex import LANDING, SURVEY, document
from tests.mission_io.protocol.diagrams import TABLES, with_diagrams
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer

DOCUMENT = Path(__file__).parents[2] / "docs" / "reference" / "mission_io.md"
PROTOCOL = DOCUMENT.parents[1] / "explanation" / "mission_protocol.md"


@pytest.mark.parametrize("number", [0, 1], ids=["sync", "asyncio"])
def test_the_ten_lines_run(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)[number]
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(tmp_path)
    assert write_mission(MISSION, "survey.waypoints") == ()
    with UdpLink.listening() as probe:
        port = probe.local_port
    peer = VehiclePeer(ARDUPILOT)
    with flying_on(UdpLink.connecting("127.0.0.1", port), peer):
        exec(compile(code.replace("14550", str(port)), str(DOCUMENT), "exec"), {})
    printed = capsys.readouterr().out
    count = len(peer.server.items(MissionType.MISSION))
    assert count == len(MISSION.items) + 1
    if number == 0:
        # Home comes back in single precision.
        assert printed.startswith(
            "True - home 33.21875, -98.1234567, 345.678 m AMSL\n+ home 33.21875, -98.1234567, 345.67"
        )
        assert "- 1 NAV_TAKEOFF(0.0, 0.0, 0.0, 0.0) at 33.21875, -98.1234567, 30.0 m ABOVE_HOME\n" in printed
        assert "+ 1 NAV_TAKEOFF(0.0, 0.0, 0.0, 0.0) at 33.21875, -98.1234567, 40.0 m ABOVE_HOME\n" in printed
    else:
        assert f"{count} of {count}\nTrue " in printed


def test_the_diagrams_are_up_to_date() -> None:
    text = PROTOCOL.read_text()
    assert with_diagrams(text) == text, (
        "run: python -m tests.mission_io.protocol.diagrams docs/explanation/mission_protocol.md"
    )
    assert all(f"<!-- {name} table: begin -->" in text for name in TABLES)


def test_the_protocol_page_s_example_makes_a_client() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PROTOCOL.read_text(), re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code, str(PROTOCOL), "exec"), names)
    client = names["client_to"](VehiclePeer(ARDUPILOT))
    assert client.wait_for_vehicle(60.0).system_id == 1


DOCS = Path(__file__).parents[2] / "docs" / "reference"


def examples(name: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / name).read_text(), re.DOTALL)


def run(code: str) -> None:
    exec(compile(code, "example", "exec"), {})


def test_a_plan_becomes_waypoints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    plan = document(SURVEY, LANDING)
    plan["geoFence"]["circles"] = [
        {"inclusion": True, "version": 1, "circle": {"center": [33.2, -98.1], "radius": 900}}
    ]
    Path("survey.plan").write_bytes(json.dumps(plan).encode("utf-16"))
    (code,) = examples("mission_formats.md")
    run(code)
    mission = wpl.read(Path("survey.waypoints").read_text())
    assert [item.command for item in mission.items] == [22, 16, 206, 16, 189, 206, 2001, 2501, 31, 85]
    assert fence_from_items(wpl.read(Path("survey_fence.waypoints").read_text()).items).circles[0].radius_m == 900.0
    assert "row 1: 'any heading' is written as 0 (affected rows: 3)" in capsys.readouterr().out


def test_the_examples_of_the_checks(capsys: pytest.CaptureFixture[str]) -> None:
    (actions,) = examples("mission_checks.md")
    run(actions)
    assert "PointGimbal(pitch_deg=-90.0" in capsys.readouterr().out
