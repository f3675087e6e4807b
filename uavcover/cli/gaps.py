"""``uavcover gaps``: the unobserved cells, and a mission that flies only them."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def gaps(
    run: Annotated[Path, typer.Argument(help="Run folder of a flight.")],
    *,
    logs: options.Logs = None,
    system: options.LogSystem = None,
    accept_changed: options.AcceptChanged = None,
    target: Annotated[
        float | None,
        typer.Option(
            help="Required coverage of the visible ground, such as 0.98; default: all of it.", metavar="SHARE"
        ),
    ] = None,
    min_area_m2: Annotated[
        float, typer.Option("--min-area", help="Leave smaller gaps open, square metres.", metavar="M2")
    ] = 0.0,
    start: Annotated[
        str,
        typer.Option(
            help="Where the mission begins: home, or the last sample of the last log, in the air.", metavar="home|last"
        ),
    ] = "home",
    force: Annotated[bool, typer.Option("--force", help="Replace an older gap mission, and its flight.")] = False,
    output: options.Output,
) -> int:
    """Group the unobserved cells by position and reason, and plan the mission that closes the gaps.

    Writes gaps.geojson, gap_mission.waypoints, and RUN/gaps, a run folder to upload, fly and verify. Exit 1 when the mission
    cannot reach the required coverage.
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
