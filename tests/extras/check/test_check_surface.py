"""``uavcover check --dsm``: trees and roofs beside the ground."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from tests.cli.conftest import Cli
from tests.scenario.surface_files import WOOD_M, ground_height_m, lon_lat, stands_m, write_models

Row = tuple[int, int, tuple[float, float] | None, float]
"""Frame, command, metres east and north of the corner of the files, height."""
HOME = (100.0, 100.0)
OVER_THE_WOOD: tuple[Row, ...] = (
    (3, 22, None, 60.0), (3, 16, (200.0, 200.0), 80.0), (3, 16, (400.0, 300.0), 80.0), (3, 16, (100.0, 120.0), 80.0),
    (3, 20, None, 0.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return write_models(tmp_path_factory.mktemp("models"))


def mission(folder: Path, rows: tuple[Row, ...], home: tuple[float, float] = HOME) -> Path:
    def position(metres: tuple[float, float] | None) -> str:
        lon, lat = (0.0, 0.0) if metres is None else lon_lat(*metres)
        return f"{lat:.9f}\t{lon:.9f}"

    lines = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{position(home)}\t{ground_height_m(*home):.3f}\t1"]
    for number, (frame, command, at, height) in enumerate(rows, 1):
        lines.append(f"{number}\t0\t{frame}\t{command}\t0\t0\t0\t0\t{position(at)}\t{height}\t1")
    file = folder / "m.waypoints"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_clearance_is_judged_against_trees_and_not_only_the_ground(cli: Cli, tmp_path: Path, models: Any) -> None:
    file = mission(tmp_path, OVER_THE_WOOD)
    limits = ("--dem", models.ground, "--return-height", "100m", "--max-height", "none", "--min-height", "12m")
    cli("check", file, *limits, code=0)
    ended = cli("check", file, *limits, "--dsm", models.surface, "--json")
    legs = [one for one in ended.document["findings"] if one["kind"] == "ground"]
    assert [one["items"] for one in legs] == [[2, 3], [3, 4]]
    assert "trees or roofs" in legs[0]["what"]
    # Along both legs, by the files themselves: what is flown over is the higher of both.
    with rasterio.open(models.surface) as dataset:
        pixels = dataset.read(1)
    alt = ground_height_m(*HOME) + 80.0
    lowest = np.inf
    for a, b in (((200.0, 200.0), (400.0, 300.0)), ((400.0, 300.0), (100.0, 120.0))):
        along = np.linspace(0.0, 1.0, 5000)[:, None] * (np.array(b) - a) + a
        column, row = along[:, 0] / 2.0 - 0.5, (600.0 - along[:, 1]) / 2.0 - 0.5
        j, i = np.floor(column).astype(int), np.floor(row).astype(int)
        u, v = column - j, row - i
        top = (1 - v) * ((1 - u) * pixels[i, j] + u * pixels[i, j + 1]) + v * (
            (1 - u) * pixels[i + 1, j] + u * pixels[i + 1, j + 1]
        )
        lowest = min(lowest, float((alt - np.maximum(top, ground_height_m(*along.T))).min()))
    assert ended.document["figures"]["min_height_agl_m"] == pytest.approx(lowest, abs=0.1)


def test_heights_above_the_terrain_count_from_the_ground(cli: Cli, tmp_path: Path, models: Any) -> None:
    """A vehicle's terrain data is a coarse ground: nobody may count on it to lift the flight over trees."""
    rows = ((3, 22, None, 25.0), (10, 16, (200.0, 200.0), 25.0), (10, 16, (400.0, 300.0), 25.0), (3, 20, None, 0.0))
    ended = cli(
        "check", mission(tmp_path, rows), "--dem", models.ground, "--dsm", models.surface, "--return-height", "120m",
        "--max-height", "30m", "--json",
    )  # fmt: skip
    legs = [one for one in ended.document["findings"] if one["kind"] == "ground"]
    # The return begins between the trees, too.
    assert [one["items"] for one in legs] == [[2, 3], [3, 4]]
    assert legs[0]["by"] == pytest.approx(10.0 - (25.0 - WOOD_M), abs=0.4)
    # 25 m above the ground are no more than 30, and less above the trees: the largest height is above the ground.
    assert not [one for one in ended.document["findings"] if one["kind"] == "height" and one["items"] == [2, 3]]


def test_a_home_and_a_pilot_under_trees(cli: Cli, tmp_path: Path, models: Any) -> None:
    rows = ((3, 22, None, 60.0), (3, 16, (200.0, 200.0), 80.0), (3, 20, None, 0.0))
    file = mission(tmp_path, rows, home=(300.0, 300.0))
    ended = cli("check", file, "--dem", models.ground, "--dsm", models.surface, "--return-height", "100m", "--json")
    found = {(one["kind"], one["weight"]): one for one in ended.document["findings"]}
    assert "landing positions away from obstacles" in found["ground", "breaks"]["do"]
    assert "under trees" in found["sight", "look"]["what"]


def test_what_trees_hide_is_not_seen(cli: Cli, tmp_path: Path, models: Any) -> None:
    rows = (
        (3, 22, None, 80.0), (0, 16, (150.0, 200.0), 650.0), (0, 16, (400.0, 200.0), 650.0),
        (3, 20, None, 0.0),
    )  # fmt: skip
    file = mission(tmp_path, rows)
    west, south, east, north = (*lon_lat(210.0, 190.0), *lon_lat(290.0, 210.0))
    observed = []
    for more in ((), ("--dsm", models.surface)):
        ended = cli(
            "check", file, "--dem", models.ground, *more, "--area", f"{west},{south},{east},{north}", "--camera",
            "dji-m3e", "--picture-every", "5m", "--json",
        )  # fmt: skip
        observed.append(ended.document["view"])
    assert observed[0]["coverage_fraction"] == pytest.approx(1.0, abs=0.01)
    assert observed[0]["hidden_m2"] == 0.0
    # The wood begins at 250 m: half of the area lies under it, and a strip beside it behind it.
    assert observed[1]["hidden_m2"] / observed[1]["area_m2"] == pytest.approx(0.5, abs=0.04)
    assert stands_m(np.array([260.0]), np.array([200.0]))[0] == WOOD_M
    assert 0.35 <= observed[1]["coverage_fraction"] <= 0.52


def test_surface_models_that_cannot_be_meant(cli: Cli, tmp_path: Path, models: Any) -> None:
    file = mission(tmp_path, OVER_THE_WOOD)
    for dem, dsm, said in (
        (models.surface, models.ground, "swapped"),
        (models.ground, models.ground, "is the same file"),
        (models.ground, tmp_path / "none.tif", "no such file"),
    ):
        error = cli("check", file, "--dem", dem, "--dsm", dsm, code=2).err.splitlines()[-1]
        assert said in error
        assert "--dsm" in error
        assert "terrain." not in error
