"""What happens before a command has begun, and when nobody reads what it says."""

import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from uavcover.cli.main import _GROUPS, app

_INTERRUPTED_WHILE_IT_LOADS = """
import sys

module = sys.argv.pop(1)

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupt())
from uavcover.__main__ import main
main()
"""


@pytest.mark.parametrize("module", ["uavcover.cli.main", "uavcover.cli.after_flight"])
def test_ctrl_c_while_it_loads_is_one_line(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _INTERRUPTED_WHILE_IT_LOADS, module, "verify", "RUN"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


@pytest.mark.skipif(sys.platform == "win32", reason="redirections of a POSIX shell")
@pytest.mark.parametrize("redirection", [">&-", "2>&-", ">&- 2>&-", "| true", ">/dev/full"])
@pytest.mark.parametrize("arguments", ["--help", "--version", "bench --help", "nosuch"])
def test_nobody_reads(arguments: str, redirection: str) -> None:
    """A stream that is closed, a pipe that ends, a disk that is full: no trace."""
    command = f'"{sys.executable}" -m uavcover {arguments} {redirection}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=300, check=False)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


_WHAT_IT_LOADS = """
import sys
sys.argv = ["uavcover", *sys.argv[1:]]
from uavcover.__main__ import main
try:
    main()
except SystemExit:
    pass
print(*sorted(sys.modules), file=sys.stderr)
"""
_HEAVY = {
    "numpy", "scipy", "numba", "pymavlink", "rerun", "rasterio", "pyproj", "shapely", "pydantic", "matplotlib", "asyncio",
}  # fmt: skip


def _loaded(code: str, *arguments: str) -> set[str]:
    """The modules that a process names on stderr when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=300, check=True
    )
    return set(done.stderr.split())


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]])
def test_the_overview_loads_no_command_and_no_numbers(arguments: list[str]) -> None:
    loaded = _loaded(_WHAT_IT_LOADS, *arguments)
    assert not loaded & _HEAVY
    commands = {module for entries in _GROUPS.values() for module, _, _ in entries.values()}
    assert not loaded & commands


def test_help_of_a_command_loads_that_command_and_no_numbers() -> None:
    loaded = _loaded(_WHAT_IT_LOADS, "plan", "--help")
    assert not loaded & (_HEAVY - {"pydantic", "asyncio"})  # typer loads these two
    commands = {module for entries in _GROUPS.values() for module, _, _ in entries.values()}
    assert loaded & commands == {"uavcover.cli.plan", "uavcover.cli.new"}  # new has the options of a survey


_WORKFLOWS = (
    (("uavcover.recording.layout",), {"rerun", "numpy"}),
    (("uavcover.run.folder", "uavcover.verification.command"), {"numba", "rasterio", "pyproj", "shapely"}),
    (("uavcover.extras.exports.export",), {"uavcover.missions.mission_compiler"}),
    (("uavcover.flight.connect",), {"pymavlink", "uavcover.flight.fly"}),
)
"""Modules that commands begin with, and what shows that they were loaded."""
_NOT_FOR = {
    "uavcover.recording.layout": {"numba", "scipy", "rasterio", "pymavlink", "uavcover.scenario.site"},
    "uavcover.verification.command": {
        "scipy.spatial",
        "scipy.ndimage",
        "scipy.interpolate",
        "pymavlink",
        "matplotlib",
        "asyncio",
    },
    "uavcover.extras.exports.export": {"scipy.spatial", "scipy.sparse", "pymavlink", "uavcover.optimizers"},
    "uavcover.flight.connect": {"scipy.spatial", "scipy.sparse", "asyncio", "uavcover.optimizers"},
}
"""What they must not load: it takes longer than their work, and this work needs none of it."""


def test_workflows_load_no_planner_and_no_library_that_they_do_not_need() -> None:
    code = "import sys\nfor name in sys.argv[1:]:\n    __import__(name)\nprint(*sys.modules, file=sys.stderr)"
    for modules, needed in _WORKFLOWS:
        loaded = _loaded(code, *modules)
        assert needed <= loaded
        assert not loaded & (_NOT_FOR[modules[-1]] | {"uavcover.planner.planner"}), modules


_NOT_FOR_A_PLAN = {
    "rerun", "pymavlink", "matplotlib", "pyogrio", "asyncio", "scipy.fft", "scipy.linalg", "scipy.ndimage", "scipy.optimize",
    "scipy.sparse", "scipy.spatial", "scipy.special", "scipy.stats",
    "uavcover.flight", "uavcover.mock", "uavcover.recording", "uavcover.verification.verify", "uavcover.report",
    "mission_io.client", "mission_io.links", "mission_io.protocol",
}  # fmt: skip


def test_the_python_api_loads_no_stage_before_it_is_called() -> None:
    code = "import sys, uavcover\nassert callable(uavcover.plan)\nprint(*sys.modules, file=sys.stderr)"
    assert _loaded(code) & (_HEAVY | _NOT_FOR_A_PLAN | {"uavcover.planner"}) == set()


def test_a_plan_loads_no_vehicle_no_recording_and_no_library_that_it_does_not_need(tmp_path: Path) -> None:
    text = Path("uavcover/scenarios/jacksboro.toml").read_text(encoding="utf-8")
    tiny = text.replace("-84.22684", "-84.21700").replace("36.48492", "36.47700")
    (tmp_path / "tiny.toml").write_text(tiny, encoding="utf-8")
    scenario, run = tmp_path / "tiny.toml", tmp_path / "run"
    loaded = _loaded(_WHAT_IT_LOADS, "plan", str(scenario), "--evaluations", "40", "-o", str(run), "--quiet")
    assert (run / "mission.waypoints").is_file()
    assert {"numba", "rasterio", "uavcover.planner.planner"} <= loaded
    assert loaded & _NOT_FOR_A_PLAN == set()


@pytest.mark.parametrize(
    ("name", "example"), [(n, e) for group in _GROUPS.values() for n, c in group.items() for e in c[2]]
)
def test_examples_of_the_help_texts_parse(name: str, example: str) -> None:
    program, command, *arguments = shlex.split(example)
    assert (program, command) == ("uavcover", name)
    group: Any = typer.main.get_command(app)
    with group.commands[name].make_context(name, arguments) as context:
        assert context.args == []
    assert example in group.commands[name].epilog
