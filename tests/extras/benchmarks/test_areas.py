"""Areas of the AreaCoverage dataset, on an area made up in its format."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.cli.conftest import Cli
from uavcover.extras.benchmarks.areas import cost_s, read_area, site_of

OUTER = [(0.0, 0.0), (30.0, 0.0), (30.0, 24.0), (0.0, 24.0)]
HOLE = [(10.0, 8.0), (20.0, 9.0), (18.0, 15.0), (11.0, 14.0)]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = tmp_path / "AC300" / "AC1_0000"
    folder.mkdir(parents=True)
    text = ["\n".join(f"{x} {y}" for x, y in ring) for ring in (OUTER, HOLE)]
    (folder / "outer_polygon").write_text(text[0])
    (folder / "holes").write_text(text[1] + "\n\n")
    corners = [*HOLE[:1], *((x, y) for y in np.arange(1.5, 24.0, 3.0) for x in (0.0, 30.0)), *HOLE[:1]]
    lines = "\n".join(f"{x} {y} 1" for x, y in corners)
    for flight in ("mem_inf/mem_inf_route_data0", "mem_90/mem_90_route_data0", "mem_90/mem_90_route_data1"):
        (folder / flight).parent.mkdir(exist_ok=True, parents=True)
        (folder / flight).write_text(lines + "\n")
    return folder.parent


def test_costs_are_those_of_legs_from_rest_to_rest() -> None:
    """By hand: 100 m take 100/3 s and 3 s for both ramps, 4 m two ramps of 2 s; 9 m are where both agree."""
    assert cost_s(np.array([[0.0, 0.0], [100.0, 0.0]])) == pytest.approx(100.0 / 3.0 + 3.0)
    assert cost_s(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]])) == pytest.approx(8.0)
    assert cost_s(np.array([[0.0, 0.0], [9.0, 0.0]])) == pytest.approx(6.0)


def test_an_area_is_read_with_its_hole(data: Path) -> None:
    area = read_area(data, "AC1_0000")
    assert area.outline.equals(shapely.Polygon(OUTER, [HOLE]))
    assert area.observed(area.routes_m) == pytest.approx(1.0, abs=1e-3)
    assert area.observed([np.array([[0.0, 12.0], [1e-9, 12.0]])]) == pytest.approx(
        0.5 * math.pi * 1.5**2 / area.outline.area, rel=1e-2
    )


def test_its_site_keeps_the_datasets_metres(data: Path, tmp_path: Path) -> None:
    area = read_area(data, "AC1_0000")
    site, home_m = site_of(area, tmp_path)
    assert site.home_m is not None
    moved = shapely.affinity.translate(site.area, *(home_m - site.home_m[:2]))
    assert moved.symmetric_difference(area.outline).area < 1e-3 * area.outline.area
    assert len(site.zones) == 1


def test_the_command_plans_keeps_and_goes_on(cli: Cli, data: Path, tmp_path: Path) -> None:
    arguments = ("bench", "areas", data, "--budget", 2, "--processes", 1, "-o", tmp_path / "out", "--json")
    first, second = cli(*arguments), cli(*arguments)
    assert (first.code, first.document["made"]) == (0, 1)
    assert (second.code, second.document["made"]) == (0, 0)
    row = (tmp_path / "out" / "areas.csv").read_text().splitlines()[1].split(",")
    assert row[0] == "AC1_0000"
    assert float(row[5]) > 0.99
    assert float(row[7]) < 0.01, "the route crosses the hole"


def test_flights_keep_the_capacity(cli: Cli, data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    cli("bench", "areas", data, "--budget", 2, "--processes", 1, "--capacity", 90, "-o", out, code=0)
    row = dict(zip(*(line.split(",") for line in (out / "areas.csv").read_text().splitlines()), strict=True))
    assert float(row["seen"]) > 0.99
    assert float(row["longest_s"]) < 90.0 < float(row["cost_s"])
    assert float(row["published_s"]) == pytest.approx(2.0 * cost_s(read_area(data, "AC1_0000").routes_m[0]), abs=0.01)


def test_bad_usage_is_one_line(cli: Cli, data: Path, tmp_path: Path) -> None:
    assert "no area with mem_inf" in cli("bench", "areas", tmp_path / "none", "-o", tmp_path / "out").error
    assert "--names: unknown: 'AC2'" in cli("bench", "areas", data, "--names", "AC2", "-o", tmp_path / "out").error
    assert (
        "mem_60 has no route"
        in cli("bench", "areas", data, "--capacity", 60, "-o", tmp_path / "other", "--processes", 1).error
    )
    (data / "AC1_0000" / "holes").write_text("10 x\n")
    assert (
        "AC1_0000: cannot read the area" in cli("bench", "areas", data, "-o", tmp_path / "out", "--processes", 1).error
    )
