"""``uavcover gaps``: the unobserved cells, and a mission that flies only them."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def gaps(
    run: Annotated[Path, typer.Argument(help="Run folder with a flight.")],
    *,
    logs: options.Logs = None,
    system: options.LogSystem = None,
    accept_changed: options.AcceptChanged = None,
    target: Annotated[
        float | None,
        typer.Option(help="Required coverage of the visible ground, such as 0.98; default: 1.", metavar="SHARE"),
    ] = None,
    min_area_m2: Annotated[
        float, typer.Option("--min-area", help="Ignore gaps smaller than this, in square metres.", metavar="M2")
    ] = 0.0,
    start: Annotated[
        str,
        typer.Option(help="Start of the mission: home, or the last position in the log (last).", metavar="home|last"),
    ] = "home",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing gap mission and its flight.")] = False,
    output: options.Output,
) -> int:
    """List the gaps in coverage with their reasons, and plan a mission that closes them.

    The command writes gaps.geojson, gap_mission.waypoints, and the run folder RUN/gaps, which you can upload, fly and
    verify. The exit code is 1 if the mission cannot reach the required coverage.
    """
    from uavcover.errors import InputError
    from uavcover.planner.close_gaps import GapRequest, GapStart, close_gaps, commands_after_gaps
    from uavcover.run.folder import RunFolder

    if start not in list(GapStart):
        raise InputError(f"--start: {start!r} is neither home nor last")
    console = output.console()
    request = GapRequest(
        logs=logs or (), target=target, min_area_m2=min_area_m2, start=GapStart(start), force=force,
        accepted=accept_changed or (), system=system,
    )  # fmt: skip
    mission, document = close_gaps(RunFolder(run), console, request, command=sys.argv)
    if mission is not None:
        console.suggest(*commands_after_gaps(RunFolder(run), request))
    console.result(document)
    return 0 if document["target_met"] else 1
