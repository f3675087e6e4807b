"""Random terrains: the cases of their numbers, and the script that plans and checks them."""

import dataclasses
import math
from pathlib import Path

import pytest

from scripts.bench.kinds import Row, read_rows
from scripts.bench.random_cases import faults, main, summary
from tests.random_kinds import AREAS, GROUNDS, SENSORS, random_case
from uavcover.scenario.site import load_site

KEPT = Row(
    terrain="box", sensor="nadir", seed=0, asked=0.95, claimed=0.951, recomputed=0.9515, of_coverable=0.951, met=True,
    waypoints=4, mission_s=100.0, made_by="memetic", lines_s=120.0, out_of_band_m=0.0, flown=0.9505, ending="landed", cpu_s=1.0,
)  # fmt: skip


def test_a_number_has_one_case(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        random_case(3).write(tmp_path / name)
    for file in ("scenario.toml", "area.geojson", "dem.tif"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()


def test_cases_are_of_every_ground_area_and_sensor_and_load(tmp_path: Path) -> None:
    cases = [random_case(number) for number in range(60)]
    assert {case.ground for case in cases} == set(GROUNDS)
    assert {case.area for case in cases} == set(AREAS)
    assert {case.sensor for case in cases} == set(SENSORS)
    first_of = {case.sensor: case for case in reversed(cases)}
    for case in [*first_of.values(), next(case for case in cases if case.kind.prisms)]:
        folder = tmp_path / str(case.number)
        folder.mkdir(exist_ok=True)
        site = load_site(str(case.write(folder)))
        assert site.area.area == pytest.approx(case.kind.area.area, rel=1e-3)
        assert bool(site.prisms) == bool(case.kind.prisms)


def test_what_does_not_hold_is_named() -> None:
    assert faults(KEPT) == []
    broken = dataclasses.replace(KEPT, met=False, recomputed=0.94, flown=0.94, mission_s=130.0, out_of_band_m=0.5)
    assert faults(broken) == [
        "not reached", "claim +1.10", "flown -1.10", "8.3 % longer", "0.50 m out of its band",
    ]  # fmt: skip
    assert faults(dataclasses.replace(KEPT, flown=math.nan, ending="held")) == ["flight: held"]
    lines = summary([KEPT, dataclasses.replace(KEPT, claimed=math.nan)])
    assert lines[0] == "- 1 of 2 were planned, 1 of them reach what was asked."
    assert "-0.05 to -0.05 points" in lines[2]


def test_the_script_goes_on_with_what_is_missing(tmp_path: Path) -> None:
    """The first small area of a sensor that is planned quickly."""
    number = next(
        n for n in range(200) if (c := random_case(n)).area == "small" and c.ground == "rolling" and c.sensor == "nadir"
    )
    out = tmp_path / "random.md"
    command = ["-o", str(out), "--first", str(number), "--cases", "1", "--evaluations", "60"]
    assert main(command) == 0
    (row,) = read_rows(out.with_suffix(".csv"))
    assert row.seed == number
    assert row.flown >= row.claimed - 0.003
    assert f"| {number} | rolling, small, " in out.read_text()
    out.write_text("")
    assert main(command) == 0
    assert not out.read_text()
