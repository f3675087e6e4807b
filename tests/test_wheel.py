import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.cli.conftest import corner_of_the_demo
from tests.compiled_kernels import lend_compiled_kernels

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, timeout=300)
    (built,) = folder.glob("*.whl")
    return built


def test_it_has_data_scenarios_and_type_markers(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    assert held >= {
        "uavcover/data/jacksboro.tif", "uavcover/scenarios/jacksboro.toml", "uavcover/scenarios/paper-R2.toml",
        "uavcover/report/page/report.html", "uavcover/report/vendor/leaflet/LICENSE", "uavcover/py.typed", "mission_io/py.typed",
    }  # fmt: skip
    assert not [name for name in held if name.startswith(("tests", "scripts")) or "__pycache__" in name]


def test_installed_elsewhere_it_flies_the_demo(wheel: Path, tmp_path: Path) -> None:
    target, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index",
         "--no-compile", "--target", target, wheel],
        check=True, capture_output=True, timeout=300,
    )  # fmt: skip
    lend_compiled_kernels(target)
    environment = {**os.environ, "PYTHONPATH": str(target)}
    environment.pop("COV_CORE_SOURCE", None)

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments], cwd=elsewhere, env=environment, capture_output=True, text=True, timeout=600,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    where = run("-c", "import uavcover, mission_io; print(uavcover.__file__); print(mission_io.__file__)").split()
    assert all(Path(path).is_relative_to(target) for path in where)
    # A part of its area, whose terrain is the file in the wheel.
    corner = str(corner_of_the_demo(elsewhere))
    assert "bundled:jacksboro.tif" in Path(corner).read_text()
    out = run(
        "-m", "uavcover", "demo", "-o", "run", "--scenario", corner, "--evaluations", "40", "--speed", "50", "--json", "-q",
    )  # fmt: skip
    assert json.loads(out)["verification"]["passed"] is True
    assert (elsewhere / "run" / "flight.rrd").exists()
