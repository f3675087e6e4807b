import os
from pathlib import Path

import pytest

from tests.cli.conftest import Cli


def test_text_and_json(cli: Cli, flown: Path) -> None:
    text = cli("inspect", flown, "--text")
    assert text.code == 0
    assert "/world/vehicle" in text.out
    document = cli("inspect", flown, "--json").document
    assert {row["entity"] for row in document["entities"]} >= {"/track", "/world/terrain", "/world/planned"}


def test_a_file_instead_of_a_folder(cli: Cli, flown: Path) -> None:
    assert cli("inspect", flown / "flight.rrd", "--text").code == 0


def test_errors(cli: Cli, flown: Path, tmp_path: Path) -> None:
    assert "uavcover fly" in cli("inspect", tmp_path, "--text").error
    picture = tmp_path / "x.png"
    picture.write_text("mine")
    ended = cli("inspect", flown, "--screenshot", picture)
    assert ended.code == 2
    assert picture.read_text() == "mine"
    (tmp_path / "x.rrd").write_bytes(b"no recording")
    assert cli("inspect", tmp_path / "x.rrd", "--text").code == 2


def test_no_screen_is_told(flown: Path, cli: Cli) -> None:
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return
    ended = cli("inspect", flown)
    assert ended.code == 2
    assert "--screenshot" in ended.error


def test_pictures_of_moments(cli: Cli, flown: Path, tmp_path: Path) -> None:
    ended = cli("inspect", flown, "--screenshot", tmp_path / "x.png", "--at", "1.5")
    assert ended.code == 2
    assert "must be between 0 and 1" in ended.error
    early = cli("inspect", flown, "--screenshot", tmp_path / "early.png", "--at", "0.1")
    if "no graphics driver" in early.err:
        pytest.skip("no graphics driver here")
    assert early.code == 0
    assert cli("inspect", flown, "--screenshot", tmp_path / "late.png").code == 0
    assert (tmp_path / "early.png").read_bytes() != (tmp_path / "late.png").read_bytes()
