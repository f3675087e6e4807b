import json
import re
import subprocess
from pathlib import Path

import pytest

from mission_io.formats import wpl
from mission_io.formats.files import FORMATS
from tests.cli.conftest import Cli, command, limited_to
from tests.mission_io.formats.wpml_tables import check_kmz
from uavcover.extras.exports.print_page import clock


@pytest.mark.parametrize("file_format", FORMATS)
def test_every_format(cli: Cli, planned: Path, tmp_path: Path, file_format: str) -> None:
    out = tmp_path / f"mission.{file_format}"
    ended = cli("export", planned, "--format", file_format, "-o", out, "--json", code=0)
    assert ended.document["format"] == file_format
    assert ended.document["items"] > 10
    assert out.stat().st_size > (60 if file_format.startswith("mavproxy") else 500)


def test_same_as_the_mission_files(cli: Cli, planned: Path, tmp_path: Path) -> None:
    for name in ("waypoints", "plan", "kml"):
        cli("export", planned, "--format", name, "-o", tmp_path / f"x.{name}", code=0)
        assert (tmp_path / f"x.{name}").read_bytes() == (planned / f"mission.{name}").read_bytes()


def test_autopilot_goes_into_the_plan(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.plan"
    cli("export", planned, "--format", "plan", "-o", out, "--autopilot", "px4", code=0)
    assert json.loads(out.read_text())["mission"]["firmwareType"] == 12


def test_a_file_for_djis_apps(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "survey.kmz"
    ended = cli("export", planned, "--format", "wpml", "--drone", "DJI Mavic 3T", "-o", out, code=0)
    assert "start on the ground at the plan's home" in ended.out
    assert "it lands from the last point" in ended.out
    assert "trigger the camera manually" in ended.out
    read = check_kmz(out.read_bytes())
    assert (read.config["droneEnumValue"], read.config["droneSubEnumValue"]) == ("77", "1")
    home = wpl.read((planned / "mission.waypoints").read_text()).home
    assert home is not None
    for point in (read.points[0], read.points[-1]):
        assert abs(point.lat_deg - home.lat_deg) < 1e-7
        assert abs(point.lon_deg - home.lon_deg) < 1e-7


def test_a_split_export_has_numbers(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "survey.csv"
    ended = cli("export", planned, "--format", "litchi", "-o", out, "--max-waypoints-per-file", 12, "--json", code=0)
    written = [Path(row["file"]) for row in ended.document["files"]]
    assert len(written) > 1
    assert written == [tmp_path / f"survey-{k + 1}.csv" for k in range(len(written))]
    assert set(tmp_path.glob("survey*")) == set(written)
    assert [len(path.read_text().splitlines()) - 1 for path in written] == [
        row["items"] for row in ended.document["files"]
    ]
    again = cli("export", planned, "--format", "litchi", "-o", out, "--max-waypoints-per-file", 12, code=2)
    assert "already contains survey-1.csv, survey-2.csv; use --force" in again.error
    whole = cli("export", planned, "--format", "litchi", "-o", out, "--force", code=2)
    assert "survey-1.csv: this file belongs to another export" in whole.error
    assert not out.exists()


def test_the_table_of_aircraft(cli: Cli) -> None:
    assert "dji-m3e" in cli("export", "--drone", "list", code=0).out
    assert "dji-m4t" in cli("export", "--drone", "list", "--json").document["aircraft"]


OWN = """title = "My drone"
drone = [77, 0]
payload = 66
payload_position = 0
image_format = "wide,zoom"
pitch_range_deg = [-90, 35]
max_speed_m_s = 15
"""


def test_an_aircraft_of_ones_own(cli: Cli, planned: Path, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(OWN)
    cli("export", planned, "--format", "wpml", "--drone", tmp_path / "own.toml", "-o", tmp_path / "x.kmz", code=0)
    check_kmz((tmp_path / "x.kmz").read_bytes())


@pytest.mark.parametrize(
    ("before", "after", "match"),
    [
        ("drone = [77, 0]", "drone = [77]", "drone: expected two numbers"),
        ("drone = [77, 0]", "drone = [77, -1]", "drone: expected a whole number"),
        ("drone = [77, 0]", "drone = [77, 0.5]", "drone: expected a whole number"),
        ("payload = 66", "payload = true", "payload: expected a whole number"),
        ("payload = 66\n", "", "payload: the key is missing"),
        ("payload = 66", "payloads = 66", "payloads: unknown key"),
        ('"wide,zoom"', '"wide,<b>"', "image_format: '<b>' is not one of"),
        ("[-90, 35]", "[35, -90]", "pitch_range_deg: write the lower angle"),
        ("[-90, 35]", '["a", 3]', "pitch_range_deg: expected a number, not 'a'"),
        ("max_speed_m_s = 15", "max_speed_m_s = 0", "max_speed_m_s: must be a number above 0"),
    ],
)
def test_an_aircraft_that_is_none(cli: Cli, planned: Path, tmp_path: Path, before: str, after: str, match: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(OWN.replace(before, after))
    ended = cli("export", planned, "--format", "wpml", "--drone", path, "-o", tmp_path / "x.kmz", code=2)
    assert re.search(match, ended.error)
    assert not (tmp_path / "x.kmz").exists()


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (["--format", "wpml", "-o", "x.kmz"], "requires an aircraft, such as --drone dji-m3e"),
        (["--format", "wpml", "--drone", "m3x", "-o", "x.kmz"], "'m3x'; did you mean"),
        (["--format", "wpml", "--drone", "m3e", "-o", "x.zip"], "x.zip is not a .kmz file"),
        (["--format", "gpx", "--drone", "m3e", "-o", "x.gpx"], "--drone: this option requires --format wpml"),
        (
            ["--format", "litchi", "-o", "x.csv", "--max-waypoints-per-file", "100"],
            "--max-waypoints-per-file: Litchi supports",
        ),
        (["--format", "litchi", "-o", "x.csv", "--max-waypoints-per-file", "3"], "are too few"),
        (["--format", "litchi", "-o", "x.csv", "--max-waypoints-per-file", "-1"], "are too few"),
        (["--format", "litchi", "-o", "x.csv", "--sortie", "1"], "without sorties"),
        (
            ["--format", "print", "-o", "x.pdf"],
            "-o: x.pdf: the format print writes an HTML page; use the suffix .html, and save the page as PDF",
        ),
        (
            ["--format", "gpx", "-o", "x.gpx", "--contact", "me"],
            "--contact: this option requires --format print, not gpx",
        ),
        (["--format", "litchi"], "specify a run folder, --format and -o"),
    ],
)
def test_options_that_do_not_fit(cli: Cli, planned: Path, options: list[str], match: str) -> None:
    assert match in cli("export", planned, *options, code=2).error


@pytest.mark.parametrize("file_format", ["wpml", "litchi", "gpx", "print"])
def test_a_plan_without_a_place_has_no_flight(cli: Cli, nowhere_run: Path, tmp_path: Path, file_format: str) -> None:
    drone = ["--drone", "m3e"] if file_format == "wpml" else []
    out = tmp_path / ("x.html" if file_format == "print" else "x.kmz")
    ended = cli("export", nowhere_run, "--format", file_format, "-o", out, *drone, code=2)
    assert "no position on Earth" in ended.error
    assert list(tmp_path.iterdir()) == []


def test_a_page_for_paper(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "sheet.html"
    ended = cli("export", planned, "--format", "print", "-o", out, "--contact", "Tower <118.5>", "--json", code=0)
    assert ended.document["file"] == str(out)
    assert ended.document["flights"] == 1
    assert "Tower &lt;118.5&gt;" in out.read_text()
    cli("export", planned, "--format", "print", "-o", out, code=2)
    split = cli("export", planned, "--format", "print", "-o", out, "--force", "--max-waypoints-per-file", 12, "--json")
    assert split.document["flights"] > 1


def test_the_page_of_an_aircraft_has_the_flights_of_its_files(cli: Cli, planned: Path, tmp_path: Path) -> None:
    """An endurance that needs several flights, more of them with a stop at each point."""
    run = tmp_path / "short"
    scenario = (planned / "scenario.toml").read_text().replace("[vehicle]", "[vehicle]\nendurance_s = 260.0")
    (tmp_path / "short.toml").write_text(scenario)
    cli("plan", tmp_path / "short.toml", "-o", run, "--evaluations", 40, "--seed", 1, code=0)
    drone = ["--drone", "dji-m3e"]
    files = cli("export", run, "--format", "wpml", *drone, "-o", tmp_path / "x.kmz", "--json").document["files"]
    page = cli("export", run, "--format", "print", *drone, "-o", tmp_path / "x.html", "--json").document
    assert page["flights"] == len(files) > 1
    text = (tmp_path / "x.html").read_text()
    assert all(f'<td class="n">{clock(file["flight_time_s"])}</td>' in text for file in files)
    sorties = sorted(run.glob("sortie-*"))
    missions = cli("export", run, "--format", "plan", "-o", tmp_path / "x.plan", "--json").document["files"]
    assert len(missions) == len(sorties) > 1
    for mission, sortie in zip(missions, sorties, strict=True):
        assert Path(mission["file"]).read_bytes() == (sortie / "mission.plan").read_bytes()


def test_a_full_disk_leaves_nothing(planned: Path, tmp_path: Path) -> None:
    folder = tmp_path / "card"
    arguments = command("export", planned, "--format", "litchi", "-o", folder / "x.csv", "--max-waypoints-per-file", 12)
    ended = subprocess.run([*limited_to(1), *arguments], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 2
    assert "cannot be written" in ended.stderr
    assert not folder.exists() or list(folder.iterdir()) == []


def test_errors(cli: Cli, planned: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.kml"
    assert "--format" in cli("export", planned, "--format", "shp", "-o", out).error
    assert "no such run folder" in cli("export", tmp_path / "nope", "--format", "kml", "-o", out).error
    out.write_text("mine")
    assert "--force" in cli("export", planned, "--format", "kml", "-o", out, code=2).error
    assert out.read_text() == "mine"
    cli("export", planned, "--format", "kml", "-o", out, "--force", code=0)
    cli("export", planned, "--format", "kml", "-o", "/proc/x.kml", code=2)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema_version": 99}', '{"schema_version": 1}'])
def test_broken_plan(cli: Cli, planned: Path, tmp_path: Path, text: str) -> None:
    (planned / "plan.json").write_text(text)
    assert "plan.json" in cli("export", planned, "--format", "kml", "-o", tmp_path / "x.kml", code=2).error
