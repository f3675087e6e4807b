"""A few of the flights of ``scripts/attack/honest_flights.py``: a judge that refuses everything proves nothing."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "attack" / "honest_flights.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("honest_flights", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["honest_flights"] = module
    spec.loader.exec_module(module)
    return module


def test_draws_are_the_same_every_time_and_of_all_kinds(script: ModuleType) -> None:
    drawn = [script.draw(flight, seed=0) for flight in range(200)]
    assert drawn == [script.draw(flight, seed=0) for flight in range(200)]
    assert {one.autopilot for one in drawn} == {"ardupilot", "px4"}
    assert {one.judged_by for one in drawn} == {script.TRACK, script.THINNED, script.TELEMETRY}
    assert {one.record_hz or one.position_hz for one in drawn} == {1.0, 2.0, 5.0, 6.25, 10.0, 25.0, 50.0}
    assert {one.sensor for one in drawn} == {*script.SENSORS, script.SURVEYED}
    assert {one.photos for one in drawn} == {"none", "reported", "required", "silent"}
    assert all((one.photos == "none") == (one.sensor != script.SURVEYED) for one in drawn)
    assert {fault.split(":")[0] for one in drawn for fault in one.faults} == {
        "heartbeat-loss", "link-outage", "stuck", "strong-wind", "gps-loss",
    }  # fmt: skip
    assert sum(one.pause_s is not None for one in drawn) > 10
    assert sum(one.stop_s is not None for one in drawn) > 10


# One that was gone on with, one with a fault, one with a pause, and one that is judged by its telemetry log.
@pytest.mark.parametrize("flight", [0, 1, 2, 28])
def test_it_passes(script: ModuleType, flight: int, tmp_path: Path) -> None:
    row = script.measure(tmp_path, flight, seed=0)
    assert (row.verdict, row.reasons) == ("passed", "")
    assert row.endings.split()[-1] == "landed"
    assert row.samples > 100
    if flight == 1:
        assert script.measure(tmp_path, flight, seed=0) == row


def test_the_page(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "fly", lambda *_: ["landed"])
    verdicts = iter([("passed", "", 900), ("not proved", "an odd move", 800)])
    monkeypatch.setattr(script, "judged", lambda *_: next(verdicts))
    out = tmp_path / "honest.md"
    assert script.main(["--flights", "2", "--runs", str(tmp_path / "runs"), "-o", str(out)]) == 1
    page = out.read_text()
    assert "1 of 2 honest flights passed, 1 not proved." in page
    assert "not proved: an odd move" in page
    assert len(out.with_name("honest_flights.csv").read_text().splitlines()) == 3


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_all_200_pass(script: ModuleType, tmp_path: Path) -> None:
    rows = [script.measure(tmp_path / str(flight), flight, seed=1) for flight in range(200)]
    assert [row for row in rows if row.verdict != "passed"] == []
