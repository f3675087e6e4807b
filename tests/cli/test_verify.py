import csv
import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Cli, files
from tests.verification.test_flown_blocks import Elsewhere


def shifted(run: Path, north_m: float) -> None:
    with (run / "track.csv").open() as file:
        rows = list(csv.DictReader(file))
    with (run / "track.csv").open("w") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            row["lat_deg"] = repr(float(row["lat_deg"]) + float(np.degrees(north_m / 6.36e6)))
            row["north_m"] = repr(float(row["north_m"]) + north_m)
            writer.writerow(row)


def test_recomputed_from_the_track(cli: Cli, flown: Path) -> None:
    before = json.loads((flown / "verification.json").read_text())
    ended = cli("verify", flown, "--json")
    assert ended.code == 0
    assert ended.document == before == json.loads((flown / "verification.json").read_text())


def test_workers_give_the_same_verdict(cli: Cli, flown: Path, monkeypatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(
        "uavcover.verification.flown_coverage.workers_of", lambda name: asked.append(name) or nullcontext(Elsewhere())
    )
    before = json.loads((flown / "verification.json").read_text())
    ended = cli("verify", flown, "--scheduler", "tcp://there:8786", "--json")
    assert asked == ["tcp://there:8786"]
    assert ended.document == before


def test_shifted_by_200_m_does_not_pass(cli: Cli, flown: Path) -> None:
    shifted(flown, 200.0)
    refused = cli("verify", flown)
    assert refused.code == 2
    assert "track.csv was" in refused.error
    assert "--accept-changed track" in refused.error
    assert not {"verification.json", "report.html", "coverage.tif"} & files(flown), "no older verdict stays"
    assert cli("report", flown).code == 2
    ended = cli("verify", flown, "--accept-changed", "track")
    assert ended.code == 1
    assert "accepted change   track: track.csv was" in ended.out
    assert cli("report", flown).code == 0
    assert "accepted change since planning or flight: track.csv was" in (flown / "report.html").read_text()
    assert "FAILED" in ended.out
    verdict = json.loads((flown / "verification.json").read_text())
    assert verdict["passed"] is False
    assert verdict["verdict"] == "failed"
    assert verdict["max_deviation_m"] > 50.0


def test_recording_gives_the_same_verdict(cli: Cli, flown: Path) -> None:
    by_csv = cli("verify", flown, "--json").document
    by_rrd = cli("verify", flown, "--log", flown / "flight.rrd", "--json").document
    assert by_rrd.pop("track") == "flight.rrd"
    assert by_csv.pop("track") == "track.csv"
    assert list(by_rrd.pop("inputs")["track"]) == ["flight.rrd"]
    assert list(by_csv.pop("inputs")["track"]) == ["track.csv"]
    assert by_rrd == by_csv


def test_needs_no_plan(cli: Cli, flown: Path) -> None:
    (flown / "plan.json").unlink()
    assert "plan.json was" in cli("verify", flown).error
    ended = cli("verify", flown, "--accept-changed", "plan", "--json")
    assert ended.document["planned_coverage_fraction"] is None
    assert [(change["what"], change["now"]) for change in ended.document["accepted_changes"]] == [("plan", None)]


def test_last_line_cut_off(cli: Cli, flown: Path) -> None:
    text = (flown / "track.csv").read_text()
    (flown / "track.csv").write_text(text[:-20])
    assert cli("verify", flown).code == 2
    ended = cli("verify", flown, "--accept-changed", "track")
    assert "the last line is incomplete" in ended.err


@pytest.mark.parametrize("name", ["flight.log", "flight", "plan.json"])
def test_other_endings(cli: Cli, flown: Path, name: str) -> None:
    if not (flown / name).exists():
        shutil.copy(flown / "track.csv", flown / name)
    ended = cli("verify", flown, "--log", flown / name)
    assert ended.code == 2
    assert "use .csv, .rrd, .bin, .tlog, .ulg, .gpx" in ended.error


@pytest.mark.parametrize(
    ("name", "content"),
    [("x.csv", b""), ("x.csv", b"a,b\n1,2\n"), ("x.rrd", b"no recording"), ("x.csv", b"\xff\xfe"), ("gone.csv", None)],
)
def test_files_that_are_no_track(cli: Cli, flown: Path, tmp_path: Path, name: str, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    ended = cli("verify", flown, "--log", tmp_path / name)
    assert ended.code == 2
    assert name in ended.error
    assert not {"verification.json", "report.html"} & files(flown), "a verdict that failed leaves no older one"


def test_nothing_flown(cli: Cli, planned: Path) -> None:
    ended = cli("verify", planned)
    assert ended.code == 2
    assert "uavcover fly" in ended.error


def test_what_is_no_run_folder_is_left_alone(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    assert "has no scenario.toml" in cli("verify", tmp_path).error
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_word_that_names_nothing(cli: Cli, flown: Path) -> None:
    before = files(flown)
    assert "'everything' is not one of scenario" in cli("verify", flown, "--accept-changed", "everything").error
    assert files(flown) == before


def test_a_report_without_a_verdict_or_with_another_one_says_so(cli: Cli, flown: Path) -> None:
    assert cli("report", flown, "--log", flown / "flight.rrd").code == 0
    assert "verification.json was computed from different inputs" in (flown / "report.html").read_text()
    (flown / "verification.json").unlink()
    assert cli("report", flown).code == 0
    assert "the run folder contains no verdict from uavcover verify" in (flown / "report.html").read_text()
    (flown / "scenario.toml").write_text((flown / "scenario.toml").read_text() + "\n")
    assert f"uavcover verify {flown} --accept-changed scenario" in cli("report", flown).error
    assert not (flown / "report.html").exists()
    assert "--accept-changed scenario" in cli("gaps", flown).error


def test_photos_can_only_be_required_of_a_sensor_that_takes_some(cli: Cli, flown: Path) -> None:
    refused = cli("verify", flown, "--require-photos")
    assert refused.code == 2
    assert "--require-photos: the sensor of" in refused.error
