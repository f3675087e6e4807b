"""Mission files on disk by suffix: what is written reads back, and what cannot be is one clear error."""

from dataclasses import replace
from pathlib import Path

import pytest

from mission_io import (
    PX4,
    FormatError,
    MissionFile,
    MissionIoError,
    MissionType,
    MisuseError,
    RallyPoints,
    read_file,
    read_mission,
    write_mission,
)
from mission_io.formats import wpl
from mission_io.model.items import Frame, FramedPoint
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, fen_text

RALLY = RallyPoints((FramedPoint(46.51, -7.26, 40.0, Frame.ABOVE_HOME),))


@pytest.mark.parametrize("name", ["a.waypoints", "a.txt", "A.PLAN", "a.csv", "a"])
def test_a_mission_reads_back(tmp_path: Path, name: str) -> None:
    assert write_mission(MISSION, tmp_path / name) == ()
    assert read_mission(str(tmp_path / name)) == MISSION
    assert read_file(tmp_path / name).filled_lists == (MISSION,)


def test_a_plan_holds_all_three(tmp_path: Path) -> None:
    path = tmp_path / "all.plan"
    fence = replace(FENCE, return_point=None)
    write_mission(MISSION, path, fence=fence, rally=RALLY, autopilot=PX4)
    assert read_file(path) == MissionFile(MISSION, fence, RALLY)
    assert read_file(path, mission_type=MissionType.RALLY) == MissionFile(rally=RALLY)
    assert '"firmwareType": 12' in path.read_text()


def test_waypoints_are_recognised_by_their_commands(tmp_path: Path) -> None:
    path = tmp_path / "some.waypoints"
    path.write_text(wpl.write_fence(FENCE, HOME))
    assert read_file(path).lists == (FENCE,)
    path.write_text(wpl.write_rally(RALLY, HOME))
    assert read_file(path).lists == (RALLY,)
    with pytest.raises(FormatError, match=r"some.waypoints: fence item 0: command 5100"):
        read_file(path, mission_type=MissionType.FENCE)


@pytest.mark.parametrize(
    ("name", "first"), [("a.kml", "<?xml"), ("a.GPX", "<?xml"), ("a.geojson", '{"type": "FeatureCollection"')]
)
def test_maps_are_written_and_not_read(tmp_path: Path, name: str, first: str) -> None:
    write_mission(MISSION, tmp_path / name)
    assert (tmp_path / name).read_text().replace('{\n "', '{"').startswith(first)
    with pytest.raises(MisuseError, match=r"file contains shapes, not mission items"):
        read_mission(tmp_path / name)


def test_what_a_format_rounds_is_told(tmp_path: Path) -> None:
    odd = replace(MISSION, home=replace(HOME, lat_deg=46.123456789123))
    (line,) = write_mission(odd, tmp_path / "a.waypoints")
    assert line.startswith("row 0: degrees were rounded to 8 decimals")


@pytest.mark.parametrize("name", ["a.waypoints", "a.plan"])
def test_an_error_leaves_the_older_file(tmp_path: Path, name: str) -> None:
    write_mission(MISSION, tmp_path / name)
    before = (tmp_path / name).read_bytes()
    with pytest.raises(FormatError, match="home"):
        write_mission(replace(MISSION, home=None), tmp_path / name)
    assert (tmp_path / name).read_bytes() == before


def test_what_cannot_be_done_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    fen = tmp_path / "a.fen"
    fen.write_text(fen_text(replace(FENCE, circles=(), return_point=FramedPoint(46.5, -7.3, 0.0))))
    for act, telling in (
        (lambda: read_mission(tmp_path / "none.plan"), r"none\.plan: cannot read the file \(No such file"),
        (lambda: read_mission(tmp_path), ": cannot read the file"),
        (lambda: read_mission(fen), r"a\.fen: a \.fen file contains only a fence"),
        (lambda: write_mission(MISSION, fen), r"a\.fen: a \.fen file cannot contain a mission"),
        (
            lambda: write_mission(MISSION, tmp_path / "a.csv", rally=RALLY),
            r"a\.csv: only a \.plan file can contain fence",
        ),
        (lambda: write_mission(MISSION, tmp_path / "no" / "a.csv"), r"a\.csv: cannot write the file \("),
    ):
        with pytest.raises(MissionIoError, match=telling):
            act()
    (tmp_path / "cut.waypoints").write_bytes(b"QGC WPL 110\n0\t1\t0\t16\n")
    with pytest.raises(FormatError, match=r"cut.waypoints: line 2: "):
        read_mission(tmp_path / "cut.waypoints")
    (tmp_path / "b.waypoints").write_text("\ufeff" + wpl.write_mission(MISSION))
    assert read_mission(tmp_path / "b.waypoints") == MISSION
    assert "b.waypoints: removed a byte order mark" in caplog.text
