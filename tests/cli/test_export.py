import json
from pathlib import Path

import pytest

from mission_io.formats.files import FORMATS
from tests.cli.conftest import Cli


@pytest.mark.parametrize("file_format", FORMATS)
def test_every_format(cli: Cli, planned: Path, tmp_path: Path, file_format: str) -> None:
    out = tmp_path / f"mission.{file_format}"
    ended = cli("export", planned, "--format", file_format, "-o", out, "--json")
    assert ended.code == 0
    assert ended.document["format"] == file_format
    assert ended.document["items"] > 10
    assert out.stat().st_size > 500


def test_same_as_the_mission_files(cli: Cli, planned: Path, tmp_path: Path) -> None:
    for name in ("waypoints", "plan", "kml"):
        assert cli("export", planned, "--format", name, "-o", tmp_path / f"x.{name}").code == 0
        assert (tmp_path / f"x.{name}").read_bytes() == (planned / f"mission.{name}").read_bytes()


def test_autopilot_goes_into_the_plan(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.plan"
    assert cli("export", planned, "--format", "plan", "-o", out, "--autopilot", "px4").code == 0
    assert json.loads(out.read_text())["mission"]["firmwareType"] == 12


def test_errors(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.kml"
    assert "--format" in cli("export", planned, "--format", "shp", "-o", out).error
    assert "no such run folder" in cli("export", tmp_path / "nope", "--format", "kml", "-o", out).error
    out.write_text("mine")
    ended = cli("export", planned, "--format", "kml", "-o", out)
    assert ended.code == 2
    assert "--force" in ended.error
    assert out.read_text() == "mine"
    assert cli("export", planned, "--format", "kml", "-o", out, "--force").code == 0
    assert cli("export", planned, "--format", "kml", "-o", "/proc/x.kml").code == 2


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema_version": 99}', '{"schema_version": 1}'])
def test_broken_plan(cli: Cli, planned: Path, tmp_path: Path, text: str) -> None:
    (planned / "plan.json").write_text(text)
    ended = cli("export", planned, "--format", "kml", "-o", tmp_path / "x.kml")
    assert ended.code == 2
    assert "plan.json" in ended.error
