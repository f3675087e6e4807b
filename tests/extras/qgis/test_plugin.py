"""The plugin's zip, its runner without QGIS, and the whole inside QGIS where it is installed."""

import ast
import io
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from tests.extras.photos.test_judge_photos import shots, take
from uavcover.extras.app.scene import Scenes
from uavcover.extras.qgis.command import PLUGIN, plugin_zip
from uavcover.extras.qgis.plugin import runner
from uavcover.scenario.site import load_site

QGIS = shutil.which("qgis_process.bin") or shutil.which(
    "qgis_process"
)  # Debian puts a wrapper in front of it that fails
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
ALGORITHMS = ("new", "plan", "check", "verify", "judgephotos", "export")


class Feedback:
    """What Processing shows."""

    def __init__(self, cancel_at: str = "") -> None:
        self.progress: list[float] = []
        self.lines: list[str] = []
        self._cancel_at = cancel_at

    def setProgress(self, value: float) -> None:
        self.progress.append(value)

    def pushInfo(self, line: str) -> None:
        self.lines.append(line)

    def pushWarning(self, line: str) -> None:
        self.lines.append(f"warning: {line}")

    def isCanceled(self) -> bool:
        return bool(self._cancel_at) and any(self._cancel_at in line for line in self.lines)


def program_of(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / "program.py"
    path.write_text(text)
    return [sys.executable, str(path)]


def test_the_zip_is_the_same_for_the_same_version(cli: Any, tmp_path: Path) -> None:
    cli("qgis-plugin", "-o", tmp_path / "uavcover.zip", "--json", code=0)
    content = (tmp_path / "uavcover.zip").read_bytes()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = set(archive.namelist())
        program: dict[str, list[str]] = {}
        exec(archive.read("uavcover/program.py"), program)
        assert b"@" not in archive.read("uavcover/metadata.txt").replace(b"none@example.org", b"")
    assert names == {f"uavcover/{path.name}" for path in PLUGIN.iterdir() if path.is_file()}
    assert content == plugin_zip(program=program["PROGRAM"])
    cli("qgis-plugin", "-o", tmp_path / "uavcover.zip", code=2)
    cli("qgis-plugin", "-o", tmp_path / "uavcover.zip", "--force", code=0)


def test_the_runner_shows_events_and_returns_the_answer(tmp_path: Path) -> None:
    feedback = Feedback()
    command = program_of(
        tmp_path,
        "import json, sys\n"
        'print(\'{"say": "begins"}\', file=sys.stderr)\n'
        'print(\'{"progress": {"what": "x", "done": 3, "total": 4, "note": ""}}\', file=sys.stderr)\n'
        'print(\'{"warn": "careful"}\', file=sys.stderr)\n'
        "print('plain', file=sys.stderr)\n"
        "print(json.dumps({'words': sys.argv[1:]}))\n",
    )
    assert runner.run(command, ["plan", "a b.toml"], feedback) == {"words": ["plan", "a b.toml", "--json", "--events"]}
    assert feedback.progress == [75.0]
    assert feedback.lines[1:] == ["begins", "warning: careful", "plain"]


ERRORS = (
    "print('error: no such file', file=sys.stderr)",
    'print(\'{"say": "error: no such file"}\', file=sys.stderr)',
    'print(\'{"error": "no such file"}\')',
)


@pytest.mark.parametrize("text", ERRORS)
def test_an_error_is_the_programs_own_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(runner.UavcoverError, match="no such file"):
        runner.run(program_of(tmp_path, f"import sys\n{text}\nsys.exit(2)\n"), [], Feedback())


def test_cancelling_stops_as_ctrl_c(tmp_path: Path) -> None:
    command = program_of(
        tmp_path,
        "import signal, sys\n"
        'def end(*_):\n    print(\'{"run": "kept"}\', flush=True)\n    sys.exit(130)\n'
        "signal.signal(signal.SIGINT, end)\n"
        'print(\'{"say": "begun"}\', file=sys.stderr, flush=True)\n'
        "signal.pause()\n",
    )
    feedback = Feedback(cancel_at="begun")
    assert runner.run(command, [], feedback) == {"run": "kept"}
    assert "stopped" in feedback.lines[-1]


def test_a_program_that_is_missing_is_said_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(runner.UavcoverError, match="was not found"):
        runner.find_program(["/no/such/uavcover"], None)
    assert runner.find_program([sys.executable, "-m", "uavcover"], None) == [sys.executable, "-m", "uavcover"]


def style_of(layer: Path) -> tuple[str, str]:
    """What a style beside a layer is for: vector or raster, and its kind of symbol or renderer."""
    style = ElementTree.parse(layer.with_suffix(".qml")).getroot()
    symbol, raster = style.find(".//renderer-v2//symbol"), style.find(".//rasterrenderer")
    if raster is not None:
        return "raster", str(raster.get("type"))
    assert symbol is not None
    return "vector", str(symbol.get("type"))


def planned_photos(run: Path, folder: Path) -> None:
    """Photos as the plan takes them, but the last third."""
    content = Scenes().of(run).content
    assert content is not None
    photos = shots(content.site, content.planned.route)
    take(folder, photos[: 2 * len(photos) // 3])


@pytest.mark.parametrize(("items", "shown"), [([2, 3], ["", "look", "look"]), (None, ["", "", ""])], ids=str)
def test_a_leg_shows_the_findings_of_its_items(tmp_path: Path, items: list[int] | None, shown: list[str]) -> None:
    """The functions on files need no QGIS."""
    functions = [
        node for node in ast.parse((PLUGIN / "styles.py").read_text()).body if isinstance(node, ast.FunctionDef)
    ]
    names: dict[str, Any] = {"json": json, "os": os}
    wanted = [node for node in functions if node.name in {"split", "write", "mark_legs"}]
    exec(compile(ast.Module(wanted, []), "styles.py", "exec"), names)
    path = tmp_path / "map.geojson"
    line = {"type": "LineString", "coordinates": [[0, 0], [1, 1]]}
    features = [{"type": "Feature", "geometry": line, "properties": {"item": k, "phase": "route"}} for k in (1, 2, 3)]
    point = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}, "properties": {}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [point, *features]}))
    legs = names["split"](str(path), ("Point",), "legs")
    assert json.loads(path.read_text())["features"] == [point]
    names["mark_legs"](legs, [{"items": items, "weight": "look", "what": "slow"}])
    assert [leg["properties"]["shown"] for leg in json.loads(Path(legs).read_text())["features"]] == shown


@pytest.mark.skipif(QGIS is None, reason="no qgis_process; Debian has it in the package qgis")
@pytest.mark.timeout(900)
def test_inside_qgis_area_and_dem_layers_become_the_command_lines_mission(tmp_path: Path, cli: Any) -> None:
    profile = tmp_path / "home"
    plugins = profile / ".local/share/QGIS/QGIS3/profiles/default/python/plugins"
    plugins.mkdir(parents=True)
    with zipfile.ZipFile(io.BytesIO(plugin_zip(program=[sys.executable, "-m", "uavcover"]))) as archive:
        archive.extractall(plugins)
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith("PYTHON")},
        "HOME": str(profile), "XDG_RUNTIME_DIR": str(tmp_path), "QT_QPA_PLATFORM": "offscreen",
    }  # fmt: skip

    def process(*words: object) -> dict[str, Any]:
        done = subprocess.run(
            [str(QGIS), *map(str, words)], env=environment, capture_output=True, text=True, timeout=600, check=False
        )
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return dict(json.loads(done.stdout[done.stdout.find("{") :])) if "--json" in words else {}

    process("plugins", "enable", "uavcover")
    listed = process("--json", "list")["providers"]["uavcover"]["algorithms"]
    assert {name.removeprefix("uavcover:") for name in listed} == set(ALGORITHMS)
    dem = Path(load_site.__code__.co_filename).parents[1] / "data" / "jacksboro.tif"
    scenario, run, typed = tmp_path / "qgis.toml", tmp_path / "run", tmp_path / "typed"
    process(
        "--json", "run", "uavcover:new", "--", f"AREA={EXAMPLES / 'valley.geojson'}", f"DEM={dem}", "VERTICAL_DATUM=EGM96",
        "CAMERA=dji-m3e", "GSD=4cm", "OVERLAP=40/30", f"SCENARIO={scenario}",
    )  # fmt: skip
    route = tmp_path / "route.geojson"
    process(
        "--json",
        "run",
        "uavcover:plan",
        "--",
        f"SCENARIO={scenario}",
        "EVALUATIONS=60",
        "SEED=1",
        f"RUN={run}",
        f"ROUTE={route}",
    )
    assert cli("plan", scenario, "-o", typed, "--evaluations", "60", "--seed", "1").code in (0, 1)
    assert (run / "mission.plan").read_bytes() == (typed / "mission.plan").read_bytes()
    assert json.loads(route.read_text())["type"] == "FeatureCollection"
    # Each layer has one kind of geometry, and its style beside it.
    assert style_of(route) == ("vector", "line")
    assert style_of(route.with_name("route-waypoints.geojson")) == ("vector", "marker")
    findings = tmp_path / "findings.geojson"
    process(
        "--json", "run", "uavcover:check", "--", f"MISSION={run / 'mission.plan'}", f"DEM={dem}", "VERTICAL_DATUM=EGM96",
        f"FINDINGS={findings}",
    )  # fmt: skip
    legs = findings.with_name("findings-legs.geojson")
    shown = {leg["properties"]["shown"] for leg in json.loads(legs.read_text())["features"]}
    assert "transit" in shown
    assert style_of(legs) == ("vector", "line")
    photos = tmp_path / "photos"
    planned_photos(run, photos)
    process(
        "--json",
        "run",
        "uavcover:judgephotos",
        "--",
        f"PHOTOS={photos}",
        f"SCENARIO={scenario}",
        f"OUT={tmp_path / 'out'}",
    )
    assert style_of(tmp_path / "out" / "footprints.geojson") == ("vector", "fill")
    assert style_of(tmp_path / "out" / "photos.tif") == ("raster", "paletted")
    out = tmp_path / "mission.kml"
    process("--json", "run", "uavcover:export", "--", f"RUN={run}", "FORMAT=2", f"FILE={out}")
    assert out.read_bytes().startswith(b"<?xml")
