"""``uavcover report`` and ``inspect``."""

import os
import shutil
import webbrowser
from pathlib import Path

import pytest

from tests.cli.conftest import Cli
from tests.report.test_background import extent_of, write_mbtiles
from uavcover.scenario.site import load_site


def test_a_flown_run(cli: Cli, flown: Path, tmp_path: Path) -> None:
    (flown / "report.html").unlink(missing_ok=True)
    document = cli("report", flown, "--json", "--figures", tmp_path / "figures").document
    assert document["report"] == str(flown / "report.html")
    assert document["passed"] in {True, False}
    assert {Path(figure).name for figure in document["figures"]} == {"side-view.png", "top-view.png"}
    first = (flown / "report.html").read_text()
    assert len(first.encode()) < 3_000_000
    cli("report", flown, code=0)
    assert (flown / "report.html").read_text() == first
    assert "--force" in cli("report", flown, "--figures", tmp_path / "figures", code=2).err


def test_a_plan_alone_and_another_file(cli: Cli, planned: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    document = cli("report", planned, "-o", page, "--json").document
    assert document["passed"] is None
    assert "not flown yet" in page.read_text()
    assert "already exists" in cli("report", planned, "-o", page, code=2).error
    cli("report", planned, "-o", page, "--force", code=0)


@pytest.mark.parametrize("starts", [True, False, webbrowser.Error("none"), OSError("none")])
def test_open_starts_the_browser(
    cli: Cli, planned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, starts: bool | Exception
) -> None:
    requested = []

    def opened(url: str) -> bool:
        requested.append(url)
        if isinstance(starts, Exception):
            raise starts
        return starts

    monkeypatch.setattr(webbrowser, "open", opened)
    monkeypatch.setattr("uavcover.report.page.render_report", lambda *_: "the page, which takes a second to draw")
    page = tmp_path / "a page #1.html"
    ended = cli("report", planned, "-o", page, "--open", code=0)
    assert requested == [page.resolve().as_uri()]
    assert ("cannot start a browser; open the file manually" in ended.err) == (starts is not True)
    cli("report", planned, "-o", page, "--force", code=0)
    assert len(requested) == 1


def test_another_log(cli: Cli, flown: Path) -> None:
    cli("report", flown, "--log", flown / "flight.rrd", "--log", flown / "track.csv", code=0)
    assert "observed, of the area, flight.rrd" in (flown / "report.html").read_text()


def test_errors(cli: Cli, tmp_path: Path, flown: Path) -> None:
    assert "uavcover plan" in cli("report", tmp_path).error
    (flown / "plan.json").write_text("{}")
    cli("report", flown, code=2)


def test_a_map_of_the_users_own(cli: Cli, flown: Path, tmp_path: Path) -> None:
    site = load_site(flown / "scenario.toml")
    behind = write_mbtiles(tmp_path / "map.mbtiles", extent_of(site), zooms=(14,))
    page = tmp_path / "with.html"
    cli("report", flown, "-o", page, "--background", behind, code=0)
    assert "Background: map.mbtiles (the file states no source)" in page.read_text(encoding="utf-8")
    ended = cli("report", flown, "-o", tmp_path / "other.html", "--background", tmp_path / "no.tif", code=2)
    assert "no.tif: no such file" in ended.error
    assert not (tmp_path / "other.html").exists()


def test_it_judges_the_logs_that_the_verdict_judged(cli: Cli, flown: Path) -> None:
    """After ``verify --log`` of a flight and of its gap mission the report was stale."""
    other = Path(shutil.copy(flown / "track.csv", flown.parent / "gaps.csv"))
    cli("verify", flown, "--log", flown / "track.csv", "--log", other, code=0)
    cli("report", flown, code=0)
    assert "was computed from different inputs" not in (flown / "report.html").read_text()
    other.unlink()
    assert "gaps.csv, which is missing" in cli("report", flown, code=0).err
    assert "was computed from different inputs" in (flown / "report.html").read_text()


def test_text_and_json(cli: Cli, flown: Path) -> None:
    assert "/world/vehicle" in cli("inspect", flown, "--text", code=0).out
    document = cli("inspect", flown, "--json").document
    assert {row["entity"] for row in document["entities"]} >= {"/track", "/world/terrain", "/world/planned"}


def test_a_file_instead_of_a_folder(cli: Cli, flown: Path) -> None:
    cli("inspect", flown / "flight.rrd", "--text", code=0)


def test_inspect_errors(cli: Cli, flown: Path, tmp_path: Path) -> None:
    assert "uavcover fly" in cli("inspect", tmp_path, "--text").error
    photo = tmp_path / "x.png"
    photo.write_text("mine")
    cli("inspect", flown, "--screenshot", photo, code=2)
    assert photo.read_text() == "mine"
    (tmp_path / "x.rrd").write_bytes(b"no recording")
    cli("inspect", tmp_path / "x.rrd", "--text", code=2)


def test_no_screen_is_told(flown: Path, cli: Cli) -> None:
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return
    assert "--screenshot" in cli("inspect", flown, code=2).error


def test_pictures_of_moments(cli: Cli, flown: Path, tmp_path: Path) -> None:
    ended = cli("inspect", flown, "--screenshot", tmp_path / "x.png", "--at", "1.5", code=2)
    assert "must be between 0 and 1" in ended.error
    early = cli("inspect", flown, "--screenshot", tmp_path / "early.png", "--at", "0.1")
    if "no graphics driver" in early.err:
        pytest.skip("no graphics driver here")
    assert early.code == 0
    cli("inspect", flown, "--screenshot", tmp_path / "late.png", code=0)
    assert (tmp_path / "early.png").read_bytes() != (tmp_path / "late.png").read_bytes()
