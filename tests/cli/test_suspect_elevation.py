"""Elevation data that does not look like ground: ``check`` proves nothing over it, ``new`` and ``plan`` ask."""

import io
import json
import tomllib
from pathlib import Path

import pytest
import rasterio

from tests.cli.conftest import Cli
from tests.extras.check.test_command import DEM, GOOD, mission
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import terrain_source
from uavcover.scenario.site import load_site
from uavcover.terrain.suspect_heights import confirmed_trust

CAMERA = ("--camera", "dji-mavic-3e", "--gsd", "3cm")


def dem_with(folder: Path, *, value: float, lat: tuple[float, float], lon: tuple[float, float]) -> Path:
    """The bundled data with a block of one value, as a program leaves it that fills voids."""
    path = folder / "filled.tif"
    with rasterio.open(DEM) as whole:
        heights, profile = whole.read(1), whole.profile
        (top, left), (bottom, right) = whole.index(lon[0], lat[1]), whole.index(lon[1], lat[0])
    heights[top : bottom + 1, left : right + 1] = value
    with rasterio.open(path, "w", **profile) as file:
        file.write(heights, 1)
    return path


HILL = (22, 0, 0, 40), (16, 36.4770, -84.2160, 70), (16, 36.4850, -84.2240, 70), (20, 0, 0, 0)
"""A leg into a hill of the bundled data: ``test_a_hill_in_the_way`` of tests/extras/check/test_command.py."""


def hill(folder: Path) -> Path:
    return mission(folder, *(" ".join(map(str, row)) for row in HILL))


@pytest.mark.parametrize("value", [0, 200])
def test_a_void_hides_no_hill(cli: Cli, tmp_path: Path, value: float) -> None:
    dem = dem_with(tmp_path, value=value, lat=(36.4800, 36.4890), lon=(-84.2300, -84.2190))
    for limit in ("none", "120m"):
        ended = cli(
            "check", hill(tmp_path), "--dem", dem, "--max-height", limit, "--return-height", "70m", "--json", code=1
        )
        assert ended.document["verdict"] == "not proved", ended.document
        over = [one for one in ended.document["findings"] if one["kind"] == "suspect-ground"]
        assert any(one["items"][0] <= 2 and one["items"][1] >= 3 for one in over)
        assert f"exactly {value} m whose rim is at" in over[0]["what"]
        assert "--trust-dem" in over[0]["do"]
        # No height over the void is the base of advice.
        assert not [one for one in ended.document["findings"] if "lower" in one["do"]]
        assert "filled.tif contains a block" in ended.err
    ended = cli("check", hill(tmp_path), "--dem", dem, "--return-height", "70m", "--trust-dem", "--json")
    assert ended.document["verdict"] == "failed"
    assert any("lower there" in one["do"] for one in ended.document["findings"])


def test_the_part_of_a_leg_beside_a_void_is_judged(cli: Cli, tmp_path: Path) -> None:
    # The void begins behind the hill that the leg hits.
    dem = dem_with(tmp_path, value=0, lat=(36.4900, 36.4960), lon=(-84.2360, -84.2260))
    file = mission(tmp_path, "22 0 0 40", "16 36.4770 -84.2160 70", "16 36.4940 -84.2330 70", "20 0 0 0")
    ended = cli("check", file, "--dem", dem, "--json")
    assert ended.document["verdict"] == "failed"
    (doubt,) = [one for one in ended.document["findings"] if one["kind"] == "suspect-ground"]
    assert doubt["items"][0] == 2
    (hit,) = [one for one in ended.document["findings"] if one["kind"] == "ground" and one["items"] == [2, 3]]
    assert hit["lat_deg"] < 36.4900


def test_home_on_a_void_is_not_the_base_of_heights(cli: Cli, tmp_path: Path) -> None:
    dem = dem_with(tmp_path, value=0, lat=(36.4735, 36.4768), lon=(-84.2190, -84.2140))
    ended = cli("check", mission(tmp_path, *GOOD), "--dem", dem, "--return-height", "70m", "--json")
    assert ended.document["verdict"] == "not proved"
    (finding,) = [one for one in ended.document["findings"] if one["weight"] != "look"]
    assert finding["kind"] == "suspect-ground"
    assert finding["what"].startswith("home, the reference of the heights, is on a block")


def test_a_void_far_from_the_mission_does_not_matter(cli: Cli, tmp_path: Path) -> None:
    dem = dem_with(tmp_path, value=0, lat=(36.53, 36.54), lon=(-84.30, -84.28))
    cli("check", mission(tmp_path, *GOOD), "--dem", dem, "--return-height", "70m", code=0)


class Terminal(io.StringIO):
    """Somebody who types."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def filled(tmp_path: Path) -> tuple[Path, Path]:
    """An area, and elevation data with a filled void in it."""
    area = tmp_path / "area.geojson"
    ring = [[-84.222, 36.476], [-84.214, 36.476], [-84.214, 36.482], [-84.222, 36.482], [-84.222, 36.476]]
    area.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return area, dem_with(tmp_path, value=0, lat=(36.478, 36.481), lon=(-84.219, -84.216))


def test_new_asks_and_a_script_must_say_so(cli: Cli, tmp_path: Path, filled, monkeypatch) -> None:
    area, dem = filled
    new = ("new", area, "--dem", dem, *CAMERA, "--force", "-o", tmp_path / "s.toml")
    ended = cli(*new, code=2)
    assert "exactly 0 m whose rim is at" in ended.err
    assert "use --trust-dem (terrain.trust_heights = true)" in ended.err
    assert not (tmp_path / "s.toml").exists()
    for answer, code in (("n\n", 2), ("\n", 2), ("y\n", 0)):
        monkeypatch.setattr("sys.stdin", Terminal(answer))
        ended = cli(*new)
        assert ended.code == code, ended.err
        assert "check that the terrain has this shape [y/N]" in ended.err
    assert tomllib.loads((tmp_path / "s.toml").read_text())["terrain"]["trust_heights"] is True


def test_plan_asks_for_a_scenario_and_for_an_area(cli: Cli, tmp_path: Path, filled) -> None:
    area, dem = filled
    ended = cli("new", area, "--dem", dem, *CAMERA, "--trust-dem", "-o", tmp_path / "s.toml", code=0)
    text = (tmp_path / "s.toml").read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("trust_heights")]
    (tmp_path / "asked.toml").write_text(text.replace(line, ""))
    ended = cli("plan", tmp_path / "asked.toml", "-o", tmp_path / "run", "--evaluations", "10", code=2)
    assert "--trust-dem" in ended.err
    assert not (tmp_path / "run" / "plan.json").exists()
    ended = cli("plan", area, "--dem", dem, *CAMERA, "-o", tmp_path / "run", "--evaluations", "10", code=2)
    assert "--trust-dem" in ended.err


def test_a_scenario_whose_heights_are_confirmed_is_not_asked_about() -> None:
    site = load_site("jacksboro")
    source = terrain_source(site.scenario.terrain)
    assert confirmed_trust(source, "EGM96", site.fence, site.frame, Unattended(), trusted=True)
    assert not confirmed_trust(source, "EGM96", site.fence, site.frame, Unattended(), trusted=False)
