"""docs/mission_io.md: its example runs, and its diagram is the table's."""

import re
from pathlib import Path

import pytest

from mission_io.autopilots import ARDUPILOT
from mission_io.diagrams import main, with_diagram
from mission_io.items import MissionType
from mission_io.link import UdpLink
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer

DOCUMENT = Path(__file__).parents[2] / "docs" / "mission_io.md"


def test_the_ten_line_upload_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    with UdpLink.listening() as probe:
        port = probe.local_port
    peer = VehiclePeer(ARDUPILOT)
    with flying_on(UdpLink.connecting("127.0.0.1", port), peer):
        exec(compile(code.replace("14550", str(port)), str(DOCUMENT), "exec"), {})
    printed = capsys.readouterr().out
    assert printed.startswith("True [")
    assert "ArduPilot returns commands without a position in this frame" in printed
    assert len(peer.server.items(MissionType.MISSION)) == 4


def test_the_diagram_is_up_to_date() -> None:
    assert with_diagram(DOCUMENT.read_text()) == DOCUMENT.read_text(), "run: python -m mission_io.diagrams FILE"


def test_a_document_without_its_marks_is_refused(tmp_path: Path) -> None:
    empty = tmp_path / "empty.md"
    empty.write_text("# nothing")
    assert main([str(empty)]) == 2
    empty.write_text("a\n<!-- upload table: begin -->\nold\n<!-- upload table: end -->\nb\n")
    assert main([str(empty)]) == 0
    text = empty.read_text()
    assert text.startswith("a\n<!-- upload table: begin -->\n```mermaid\nstateDiagram-v2\n")
    assert text.endswith("```\n<!-- upload table: end -->\nb\n")
