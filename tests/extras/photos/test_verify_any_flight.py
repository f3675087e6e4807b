"""``verify`` of flights by their pictures, and of flights that nobody planned here."""

import csv
import json
import shutil

import pytest

from tests.extras.photos.test_judge_photos import AREA, DEM, shots
from tests.verification.honest import flown_by_the_mock
from uavcover.extras.photos.any_flight import evidence_of
from uavcover.model.track import TrackSample
from uavcover.new.command import new_scenario
from uavcover.new.elevation_questions import NewRequest
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.run.track_file import TrackWriter
from uavcover.run.user import Unattended
from uavcover.scenario.areas.area_file import AreaQuery

ANY = ("--area", AREA, "--dem", DEM, "--camera", "dji-m3e")


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A folder with a flight's track and a table of its pictures; the place of no plan."""
    folder = tmp_path_factory.mktemp("flight")
    request = NewRequest(
        area=AreaQuery(source=AREA), dem=(DEM,), camera="dji-m3e", gsd="2.5cm", home="36.4770,-84.2172"
    )
    site = new_scenario(request, Unattended(), folder=folder).site
    route = fly_layout(site, plain_boustrophedon(site))
    track = flown_by_the_mock(site, route)
    with TrackWriter(folder / "flight.csv") as writer:
        for k in range(len(track)):
            row = [track.time_s[k], *track.geodetic[k], *track.enu_m[k], *track.attitude_deg[k]]
            # No number of a waypoint: nobody knows what was planned.
            writer.write(TrackSample(*map(float, row), current_waypoint=-1))
    write_photos(folder / "pictures.csv", shots(site, route))
    return folder


def write_photos(path, photos):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "latitude", "longitude", "altitude", "yaw", "time", "pitch", "roll"])
        for number, (lat, lon, alt, yaw, time_s) in enumerate(photos):
            writer.writerow([f"p{number}", lat, lon, alt, yaw, time_s, -90.0, 0.0])


def a_quarter(folder):
    rows = (folder / "pictures.csv").read_text().splitlines(keepends=True)
    (folder / "quarter.csv").write_text("".join(rows[: len(rows) // 4]))
    return folder / "quarter.csv"


def test_a_flight_without_plan_is_judged_by_its_log_and_its_pictures(cli, tmp_path, flight):
    ended = cli(
        "verify",
        flight / "flight.csv",
        "--photos",
        flight / "pictures.csv",
        *ANY,
        "-o",
        tmp_path / "a",
        "--json",
        code=0,
    )
    assert ended.document["verdict"] == "passed"
    assert ended.document["photos"]["coverage_holds"] == "yes"
    assert ended.document["inputs"]["photos"] == ended.document["photos"]["inputs"]["pictures"]
    # The same files as a run folder's own: what the scenario says is judged once more.
    again = cli("verify", tmp_path / "a", "--log", flight / "flight.csv", "--log", flight / "pictures.csv", "--json")
    assert again.document["coverage_of_coverable"] == ended.document["coverage_of_coverable"]
    assert again.code == 0


def test_a_quarter_of_the_pictures_is_judged_whatever_the_track_says(cli, tmp_path, flight):
    few = a_quarter(flight)
    whole = cli("verify", flight / "flight.csv", *ANY, "-o", tmp_path / "a", "--json").document
    assert whole["coverage_of_coverable"] == pytest.approx(1.0, abs=0.01)
    assert whole["verdict"] == "not proved", "nobody knows whether the camera took anything"
    assert "the log reports no photos" in whole["doubts"][0]
    ended = cli("verify", flight / "flight.csv", "--photos", few, *ANY, "-o", tmp_path / "b", "--json", code=1)
    assert ended.document["verdict"] == "failed"
    assert ended.document["coverage_of_coverable"] < 0.9
    assert any(gap["area_m2"] > 100.0 for gap in ended.document["gaps"])


def test_pictures_whose_blur_nobody_tells_leave_the_verdict_open(cli, tmp_path, flight):
    arguments = ("verify", flight / "flight.csv", "--photos", flight / "pictures.csv", *ANY, "--max-blur", "1")
    ended = cli(*arguments, "-o", tmp_path / "a", "--json", code=1)
    assert ended.document["verdict"] == "not proved"
    assert ended.document["reasons"] == []
    assert "coverage 0.00 %" in ended.document["doubts"][0]
    without = cli("verify", flight / "flight.csv", *ANY, "--max-blur", "1", "-o", tmp_path / "b", code=2)
    assert "--max-blur: this option applies only to photos" in without.error


def test_limits_that_the_user_gave_are_judged_and_others_are_told(cli, tmp_path, flight):
    arguments = ("verify", flight / "flight.csv", "--photos", flight / "pictures.csv", *ANY)
    low = cli(*arguments, "--max-height", "60m", "-o", tmp_path / "a", "--json", code=1)
    assert {violation["kind"] for violation in low.document["violations"]} == {"above-band", "above-transit-height"}
    assert "not judged, because not specified: --max-height, --no-fly" in cli(*arguments, "-o", tmp_path / "b").out
    overlap = cli(*arguments, "--overlap", "90/90", "-o", tmp_path / "c", "--json", code=1)
    assert any(reason.startswith("the required overlap, 100 photos") for reason in overlap.document["reasons"])


def test_pictures_alone_are_judged_and_the_flight_is_not(cli, tmp_path, flight):
    ended = cli("verify", flight / "pictures.csv", *ANY, "-o", tmp_path / "a", "--json", code=0)
    assert "violations" not in ended.document
    run = tmp_path / "run"
    run.mkdir()
    shutil.copy(tmp_path / "a/scenario.toml", run)
    assert "without a track" in cli("verify", run, "--photos", flight / "pictures.csv").err
    assert json.loads((run / "photos/photos.json").read_text())["counted"] > 10
    assert not (run / "verification.json").exists()


def test_what_is_a_track_and_what_are_pictures(tmp_path, flight):
    (tmp_path / "DCIM").mkdir()
    unicode_text = tmp_path / "unicode.csv"
    unicode_text.write_text((flight / "flight.csv").read_text(), encoding="utf-16")
    given = [flight / "flight.csv", flight / "pictures.csv", tmp_path / "DCIM", tmp_path / "a.MRK", tmp_path / "x.bin"]
    evidence = evidence_of([*given, unicode_text], [tmp_path / "y.bin"])
    assert evidence.logs == (flight / "flight.csv", tmp_path / "x.bin", unicode_text)
    assert evidence.photos == (flight / "pictures.csv", tmp_path / "DCIM", tmp_path / "a.MRK", tmp_path / "y.bin")


def test_a_changed_scenario_is_noticed(cli, tmp_path, flight):
    cli("verify", flight / "flight.csv", *ANY, "-o", tmp_path / "a")
    file = tmp_path / "a/scenario.toml"
    file.write_text(file.read_text().replace("min_coverage_of_coverable = 0.98", "min_coverage_of_coverable = 0.1"))
    assert "scenario.toml was" in cli("verify", tmp_path / "a", "--log", flight / "flight.csv", code=2).error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "specify a run folder"),
        (("--area", AREA, "--dem", DEM), "--area needs a flight"),
        (("RUN", "--gsd", "2cm"), "--gsd requires --area"),
        (("RUN", "-o", "x"), "-o requires --area"),
        (("FLIGHT", "--area", AREA, "--dem", DEM), "specify --camera"),
        (("FLIGHT", "--area", AREA, "--camera", "dji-m3e"), "--dem"),
        (("FLIGHT", "--area", "36.6,-84.3,60", "--dem", DEM, "--camera", "dji-m3e"), "km from the area"),
        (("ELSEWHERE", "--area", AREA, "--dem", DEM, "--camera", "dji-m3e"), "latitude and longitude swapped"),
        (("gone.bin", "--area", AREA, "--dem", DEM, "--camera", "dji-m3e"), "no such file"),
    ],
)
def test_what_cannot_be_judged_is_one_line(cli, tmp_path, flight, arguments, words):
    track = (flight / "flight.csv").read_text()
    (tmp_path / "elsewhere.csv").write_text(track.replace(",36.4", ",46.4"))
    names = {"FLIGHT": flight / "flight.csv", "RUN": flight, "ELSEWHERE": tmp_path / "elsewhere.csv"}
    out = () if "-o" in arguments or "--area" not in arguments else ("-o", tmp_path / "out")
    ended = cli("verify", *[names.get(argument, argument) for argument in arguments], *out, code=2)
    assert words in ended.err.splitlines()[-1]
    assert "Traceback" not in ended.err
    assert not (tmp_path / "out").exists()
