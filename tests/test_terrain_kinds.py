"""Terrains of many kinds: the script that plans and checks them, on one of the smallest."""

import math
from pathlib import Path

import pytest

from scripts.bench.kinds import main, measure, read_rows
from tests.terrain_kinds import KINDS, SENSORS, write_scenario
from uavcover.scenario.site import load_site


def test_there_are_twelve_kinds_and_at_least_five_sensors() -> None:
    assert len(KINDS) == 12
    assert len(SENSORS) >= 5


@pytest.mark.parametrize("terrain", KINDS)
def test_every_scenario_loads(terrain: str, tmp_path: Path) -> None:
    site = load_site(str(write_scenario(tmp_path, terrain, "nadir")))
    assert site.home_m is not None
    # The frame's metres are of home's height: a little larger than those at sea level.
    assert site.area.area == pytest.approx(KINDS[terrain].area.area, rel=1e-3)
    assert bool(site.prisms) == bool(KINDS[terrain].prisms)


@pytest.mark.parametrize("sensor", ["nadir", "pictures"])
def test_a_plan_keeps_its_word(sensor: str, tmp_path: Path) -> None:
    row = measure(tmp_path, "hectare", sensor, 1, evaluations=60, flown=False)
    assert row.met
    assert row.claimed == pytest.approx(row.recomputed, abs=0.004)
    assert row.out_of_band_m < 0.05
    assert row.mission_s <= row.lines_s * 1.001
    assert math.isnan(row.flown)


def test_the_script_goes_on_with_what_is_missing(tmp_path: Path) -> None:
    out = tmp_path / "kinds.md"
    command = ["-o", str(out), "--seeds", "1", "--evaluations", "60", "--fly", "0", "--only", "40 m:sphere"]
    assert main(command) == 0
    rows = read_rows(out.with_suffix(".csv"))
    assert [(row.terrain, row.sensor, row.seed) for row in rows] == [("40 m", "sphere", 1)]
    written = out.read_text()
    assert "1 of 1 were planned" in written
    out.write_text("")
    assert main(command) == 0
    assert not out.read_text()  # nothing was missing, nothing was planned again
