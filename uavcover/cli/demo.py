"""``uavcover demo``: the whole chain on real terrain, against a mock vehicle in another process."""

import json
import math
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

from uavcover.cli import options
from uavcover.cli.console import Console
from uavcover.cli.options import option
from uavcover.errors import INTERRUPTED, InputError, VehicleError
from uavcover.flight.command import ENDED_BY_USER, FlightOptions, fly_run
from uavcover.flight.compiled_flight import upload_run
from uavcover.flight.connect import VehicleLink, require_home
from uavcover.model.track import Ending
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.report.page import save_report
from uavcover.run.folder import REPORT_FILE, RunFolder
from uavcover.run.provenance import add_stage
from uavcover.run.user import metres, percent, to_paste
from uavcover.verification.command import verify_run

_MOCK_START_S = 60.0
_WIND = ("--wind", "3", "--wind-from", "250", "--gust", "0.7")


def demo(
    *,
    run: Annotated[Path, option("-o", "--out", "Folder for the results (the run folder).", "RUN")] = Path("out"),
    scenario: Annotated[str, option("Scenario to fly.")] = "jacksboro",
    evaluations: Annotated[int | None, option("Number of route evaluations; default: the scenario's number.")] = None,
    seed: options.Seed = None,
    autopilot: options.Autopilot = None,
    speed: Annotated[float, option("Speed of the mock vehicle, as a multiple of real time.")] = 100.0,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Plan a mission, upload it to a mock vehicle over UDP, fly it, record it and verify it."""
    console = output.console()
    request = PlanRequest(
        scenario=scenario, folder=run, command=sys.argv, force=force, seed=seed, evaluations=evaluations,
        autopilot=autopilot,
    )  # fmt: skip
    started = time.monotonic()
    if not 0.0 < speed < math.inf:
        raise InputError(f"--speed: must be greater than 0, not {speed:g}")
    folder = RunFolder(run)
    console.say("1 of 4  plan")
    outcome = plan_into(request, console, check_site=require_home)
    if outcome.exit_code == INTERRUPTED:
        console.say(f"stopped; the plan is in {folder}")
        console.result({"run": str(folder), "plan": outcome.document})
        return INTERRUPTED
    site, route = outcome.site, outcome.plan.chosen.route
    with mock_process(scenario, autopilot or site.scenario.vehicle.autopilot, speed, seed) as url:
        console.say("2 of 4  upload to a mock vehicle in another process and read back")
        at = time.monotonic()
        uploaded = upload_run(folder, site, route, VehicleLink(url=url), console)
        _stage(folder, "upload", at)
        console.say(f"3 of 4  fly in wind, at {speed:g} times real time")
        at = time.monotonic()
        flight, flown = fly_run(folder, site, route, VehicleLink(url=url), console, FlightOptions(force=True))
        _stage(folder, "fly and record", at)
    if flight.ending is Ending.NOT_FLOWN:
        console.result(
            {"run": str(folder), "plan": outcome.document, "upload_passed": uploaded["passed"], "flight": flown}
        )
        return INTERRUPTED
    console.say("4 of 4 verify the flown track")
    at = time.monotonic()
    _, verdict = verify_run(folder, console, command=sys.argv)
    _stage(folder, "verify", at)
    save_report(folder, folder.file(REPORT_FILE), console)
    console.say()
    _print_end(console, folder, outcome.document, verdict, time.monotonic() - started)
    console.result({"run": str(folder), "plan": outcome.document, "upload_passed": uploaded["passed"], "flight": flown,
                    "verification": verdict, "wall_s": time.monotonic() - started})  # fmt: skip
    if flight.ending in ENDED_BY_USER:
        return INTERRUPTED
    return 0 if outcome.exit_code == 0 and uploaded["passed"] and verdict["passed"] else 1


def _stage(run: RunFolder, name: str, started_s: float) -> None:
    add_stage(run, name, time.monotonic() - started_s)


def _print_end(console: Console, run: RunFolder, plan: dict[str, Any], verdict: dict[str, Any], wall_s: float) -> None:
    console.say(
        f"coverage of the area: planned {percent(plan['coverage_fraction'])}, flown "
        f"{percent(verdict['coverage_fraction'])}; height above ground: {metres(verdict['min_height_agl_m'])} to "
        f"{metres(verdict['max_height_agl_m'])} on the route, at least {metres(verdict['min_transit_clearance_m'])} "
        "on the transit legs"
    )
    console.say(
        f"{verdict['verdict'] if verdict['passed'] else verdict['verdict'].upper()} in {wall_s:.0f} s. Open next:"
    )
    console.say(f"  {run.file(REPORT_FILE)}           map, 3D view, heights and coverage, for any browser")
    console.say(f"  {to_paste('inspect', run)}              the flight in 3D ({run.file('flight.rrd')})")
    console.say(f"  {run.file('mission.waypoints')}     for Mission Planner; mission.plan for QGroundControl")
    console.say(f"  {run.file('verification.json')}     coverage, clearance and gaps of the flight")


@contextmanager
def mock_process(scenario: str, autopilot: str, speed: float, seed: int | None) -> Iterator[str]:
    """A mock vehicle in its own process on a free port of 127.0.0.1; yields its URL, and ends it.

    Raises:
        VehicleError: it does not start.
    """
    arguments = [
        sys.executable, "-m", "uavcover", "mock-vehicle", "--listen", "udpin://127.0.0.1:0", "--scenario", scenario,
        "--autopilot", autopilot, "--speed", repr(speed), "--seed", str(seed or 0), "--json", "-q", "--until-eof", *_WIND,
    ]  # fmt: skip
    # A session of its own: Ctrl-C is for us, and we bring the vehicle home before it ends. Our end of its standard input closes
    # with us, so that it ends when we are killed.
    process = subprocess.Popen(
        arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        if process.stdout is None or not select.select([process.stdout], [], [], _MOCK_START_S)[0]:
            raise VehicleError(f"the mock vehicle did not start within {_MOCK_START_S:g} s")
        line = process.stdout.readline()
        if not line:
            raise VehicleError(f"the mock vehicle ended immediately with exit code {process.wait()}")
        yield f"udpout://127.0.0.1:{json.loads(line)['port']}"
    finally:
        process.terminate()
        try:
            process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
