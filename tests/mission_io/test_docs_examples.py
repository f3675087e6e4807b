"""The examples of docs/reference/mission_formats.md and docs/reference/mission_checks.md run and do what their pages say."""

import json
import re
from pathlib import Path

import pytest

from mission_io.formats import wpl
from mission_io.model.items import fence_from_items
from tests.mission_io.formats.test_plan_complex import LANDING, SURVEY, document

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
