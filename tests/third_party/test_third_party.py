"""A third party's package adds a command, an exporter, a sensor and a log reader through entry points alone."""

import csv
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.planner.sites import make_site
from tests.third_party.surveykit import TwinCamera
from uavcover.sensing.coverage_map import CoverageMap

ENTRY_POINTS = """[uavcover.commands]
surveykit = surveykit:COMMANDS
[uavcover.exporters]
points = surveykit:write_points
broken = surveykit:there_is_no_such_function
wpml = surveykit:write_points
[uavcover.sensors]
line-scanner = surveykit:line_scanner
twin-camera = surveykit:TwinCamera
not-derived = surveykit:Path
[uavcover.log_readers]
xyzt = surveykit:read_xyzt
bin = surveykit:read_xyzt
"""


@pytest.fixture(scope="module")
def run_with(tmp_path_factory):
    """Runs a command where the package is installed: its module and its metadata are on the path."""
    site = tmp_path_factory.mktemp("site-packages")
    shutil.copy(Path(__file__).parent / "surveykit.py", site)
    about = site / "surveykit-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: surveykit\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    path = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "uavcover", *map(str, words)]
        return subprocess.run(
            command, capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": path}, check=False
        )

    return run


@pytest.fixture(scope="module")
def planned(run_with, tmp_path_factory):
    """A run folder planned for the line scanner."""
    folder = tmp_path_factory.mktemp("planned")
    text = Path("docs/examples/valley.toml").read_text(encoding="utf-8")
    text = text.replace('kind = "nadir-camera"\nfov_deg = 70.0', 'kind = "line-scanner"\nswath_deg = 70.0')
    (folder / "scan.toml").write_text(
        text.replace("valley.geojson", str(Path("docs/examples/valley.geojson").resolve()))
    )
    ended = run_with("plan", folder / "scan.toml", "-o", folder / "run", "--evaluations", 60, "--seed", 1, "--json")
    assert ended.returncode == 0, ended.stderr
    return folder


def test_a_command_is_listed_and_runs(run_with, tmp_path):
    (tmp_path / "points.json").write_text("[1, 2, 3]")
    assert "says hello to a file" in run_with("--help").stdout
    ended = run_with("hello", tmp_path / "points.json")
    assert ended.stdout == "3 points\n", ended.stderr


def test_a_sensor_plans_flies_and_is_verified(run_with, planned, tmp_path):
    shutil.copytree(planned / "run", tmp_path / "run")
    sensor = (tmp_path / "run" / "scenario.toml").read_text()
    assert 'kind = "frame-camera"' in sensor  # the run folder can be read where the package is not installed
    assert "fov_across_deg = 70.0" in sensor
    flown = run_with("fly", tmp_path / "run", "--to", "mock:", "--mock-speed", 20, "--yes", "--json")
    assert flown.returncode == 0, flown.stderr
    judged = run_with("verify", tmp_path / "run", "--json")
    assert json.loads(judged.stdout)["coverage_of_coverable"] > 0.9, judged.stderr


def test_a_mistake_in_a_sensor_is_one_line(run_with, planned, tmp_path):
    text = (planned / "scan.toml").read_text().replace("swath_deg = 70.0", "swath_deg = 190.0")
    (tmp_path / "scan.toml").write_text(text)
    ended = run_with("plan", tmp_path / "scan.toml", "-o", tmp_path / "run")
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "sensor: line-scanner: swath_deg: must be between 0 and 180 degrees, not 190" in ended.stderr


TWIN = 'kind = "twin-camera"\ntilt_deg = 30.0\nfov_across_deg = 40.0\nfov_along_deg = 40.0\nmount = "stabilised"\n'


def test_a_sensor_with_a_view_of_its_own_plans_flies_and_is_verified_by_it(run_with, planned, tmp_path):
    text = (planned / "scan.toml").read_text().replace('kind = "line-scanner"\nswath_deg = 70.0\n', TWIN)
    (tmp_path / "twin.toml").write_text(text.replace("cell_size_m = 5.0", "cell_size_m = 20.0\nfewest_places = 0"))
    run = tmp_path / "run"
    ended = run_with(
        "plan", tmp_path / "twin.toml", "-o", run, "--algorithm", "lines", "--evaluations", 60, "--seed", 1, "--json"
    )
    assert ended.returncode == 0, ended.stderr
    kept = tomllib.loads((run / "scenario.toml").read_text())["sensor"]
    assert (kept["kind"], kept["tilt_deg"], kept["fov_across_deg"]) == ("twin-camera", 30.0, 40.0)
    flown = run_with("fly", run, "--to", "mock:", "--mock-speed", 20, "--yes", "--json")
    assert flown.returncode == 0, flown.stderr
    judged = json.loads(run_with("verify", run, "--json").stdout)
    planned_coverage = json.loads((run / "plan.json").read_text())["metrics"]["coverage_of_coverable"]
    assert judged["verdict"] == "passed"
    assert judged["coverage_of_coverable"] == pytest.approx(planned_coverage, abs=0.02)


def test_twin_cameras_see_to_both_sides_and_not_the_middle():
    twin = TwinCamera(kind="twin-camera", tilt_deg=30.0, fov_across_deg=40.0, fov_along_deg=40.0, range_m=200.0)
    coverage = CoverageMap(make_site(sensor=twin, cell_m=2.0), cell_size_m=2.0)
    observed = coverage.observed(np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]]))
    middle = np.abs(coverage.grid.middles_m[:, 0] - 150.0) < 20.0
    off_deg = np.degrees(np.arctan2(np.abs(coverage.grid.middles_m[:, 1] - 100.0), 80.0))
    assert observed[middle & (off_deg > 11.0) & (off_deg < 49.0)].all()
    assert not observed[(off_deg < 9.0) | (off_deg > 51.0)].any()


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("twin-camera", "sensor: twin-camera: tilt_deg: 60 is outside 0..45 degrees"),
        ("not-derived", "sensor: not-derived: Path is not derived from a built-in sensor (uavcover.model.sensor)"),
    ],
)
def test_a_mistake_in_a_class_of_a_sensor_is_one_line(run_with, planned, tmp_path, kind, message):
    table = TWIN.replace("twin-camera", kind).replace("tilt_deg = 30.0", "tilt_deg = 60.0")
    text = (planned / "scan.toml").read_text().replace('kind = "line-scanner"\nswath_deg = 70.0\n', table)
    (tmp_path / "twin.toml").write_text(text)
    ended = run_with("plan", tmp_path / "twin.toml", "-o", tmp_path / "run")
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert message in ended.stderr


def test_an_exporter_is_a_format(run_with, planned, tmp_path):
    ended = run_with("export", planned / "run", "--format", "points", "-o", tmp_path / "points.json", "--json")
    assert ended.returncode == 0, ended.stderr
    assert len(json.loads((tmp_path / "points.json").read_text())["points"]) > 3


def test_a_broken_exporter_is_named_and_breaks_nothing_else(run_with, planned, tmp_path):
    ended = run_with("export", planned / "run", "--format", "broken", "-o", tmp_path / "x", "--json")
    assert ended.returncode == 2
    assert "surveykit:there_is_no_such_function of package surveykit cannot be loaded" in ended.stderr
    rows = json.loads(run_with("doctor", "--no-imports", "--json").stdout)
    assert "update or uninstall that package" in str(rows)


def test_own_names_cannot_be_taken(run_with, planned, tmp_path):
    ended = run_with("export", planned / "run", "--format", "wpml", "-o", tmp_path / "x.kmz", "--json")
    assert "requires an aircraft" in ended.stderr


def test_a_log_is_read(run_with, planned, tmp_path):
    shutil.copytree(planned / "run", tmp_path / "run")
    mission = (tmp_path / "run" / "mission.waypoints").read_text().splitlines()[1:]
    points = [row.split("\t")[8:11] for row in mission if row.split("\t")[3] == "16"]
    with (tmp_path / "flight.xyzt").open("w", newline="") as file:
        csv.writer(file).writerows([10.0 * k, *point] for k, point in enumerate(points))
    ended = run_with("verify", tmp_path / "run", "--log", tmp_path / "flight.xyzt", "--json")
    assert ended.returncode == 1, ended.stderr
    assert json.loads(ended.stdout)["samples"] == len(points)
