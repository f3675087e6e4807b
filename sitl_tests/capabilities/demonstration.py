"""The demo's mission by the commands that a user types: planned coverage against what the flown track has seen."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from sitl_tests.case import Case, Finding, Judge
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.matrix import WORKS

SCENARIO = "jacksboro"
PLAN = "demo-plan"
MOST_LOST_POINTS = 3.0
_LOG_POINTS = 0.5
_PLAN_WALL_S = 1800.0
_FLIGHT_WALL_S = 3600.0


def fly_demo(case: Case) -> Judge:
    """The demo's plan is uploaded and flown; it is judged when the vehicle has been stopped, since that takes a while."""
    run = case.folder / "run"
    shutil.copytree(planned_run(case.folder.parent), run)
    url = case.vehicle.url
    client = ("--client", case.client) if case.client != "native" else ()
    uploaded = _uavcover(case, "plan-upload", str(run), "--to", url, *client)
    require(uploaded["passed"], "mission, fence or rally points were read back changed")
    flown = _uavcover(case, "fly", str(run), "--to", url, "--yes", "--timeout", "60", *client)
    return lambda: _judged(case, run, flown)


def _judged(case: Case, run: Path, flown: dict[str, Any]) -> Finding:
    """At most 3 points of coverage lost, the band kept; the autopilot's own log says the same as our track.

    Raises:
        CheckFailedError: not so.
    """
    logs = case.vehicle.log_files()
    by_log = _uavcover(case, "verify", str(run), "--log", str(logs[-1])) if logs else None
    verdict = _uavcover(case, "verify", str(run))
    planned, observed = 100.0 * verdict["planned_coverage_fraction"], 100.0 * verdict["coverage_fraction"]
    require(planned - observed <= MOST_LOST_POINTS, f"planned {planned:.2f} %, flown {observed:.2f} % of the area")
    violations = [violation["kind"] for violation in verdict["violations"]]
    require(not violations, f"violations: {', '.join(violations)}")
    own_log = ""
    if by_log is not None:
        by_log_percent = 100.0 * by_log["coverage_fraction"]
        require(
            abs(by_log_percent - observed) <= _LOG_POINTS,
            f"flown {observed:.2f} % by the track, {by_log_percent:.2f} % by the log",
        )
        own_log = f" ({by_log_percent:.2f} % by the autopilot's own log)"
    return Finding(
        WORKS,
        f"coverage planned {planned:.2f} %, flown {observed:.2f} %{own_log}; {verdict['min_height_agl_m']:.1f} to "
        f"{verdict['max_height_agl_m']:.1f} m above ground on the route, deviation at most "
        f"{verdict['max_deviation_m']:.1f} m; {flown['duration_s']:.0f} s of vehicle time, {flown['samples']} samples",
    )


def planned_run(folder: Path) -> Path:
    """A run folder with the demo's plan, inside the folder of all cases; made when it is not there yet."""
    run = folder / PLAN
    if not run.exists():
        with tempfile.TemporaryDirectory(dir=folder) as made:
            _run(["plan", SCENARIO, "-o", f"{made}/{PLAN}"], folder / f"{PLAN}.txt", _PLAN_WALL_S)
            Path(made, PLAN).rename(run)
    return run


def _uavcover(case: Case, command: str, *arguments: str) -> dict[str, Any]:
    return _run([command, *arguments, "--json"], case.folder / f"{command}.txt", _FLIGHT_WALL_S)


def _run(arguments: list[str], log: Path, wall_s: float) -> dict[str, Any]:
    """Run a command of ours; what it says on stderr goes to a log.

    Raises:
        CheckFailedError: it fails, or takes too long.
    """
    with log.open("w") as said:
        try:
            done = subprocess.run(
                [sys.executable, "-m", "uavcover", *arguments],
                stdout=subprocess.PIPE, stderr=said, stdin=subprocess.DEVNULL, text=True, timeout=wall_s, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise CheckFailedError(f"uavcover {arguments[0]} took more than {wall_s:g} s; see {log.name}") from None
    lines = log.read_text().strip().splitlines()
    if done.returncode not in (0, 1):
        raise CheckFailedError(f"uavcover {arguments[0]} ended with {done.returncode}: {lines[-1] if lines else ''}")
    document: dict[str, Any] = json.loads(done.stdout) if done.stdout.strip().startswith("{") else {}
    return document
