"""``uavcover fly``: arm, start, follow, record, land."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def fly(
    run: Annotated[Path, typer.Argument(help="Run folder whose mission the vehicle holds.")],
    to: options.To,
    sortie: options.Sortie = None,
    yes: Annotated[bool, typer.Option("--yes", help="Arm a vehicle that is not simulated.")] = False,
    timeout_s: options.Timeout = 10.0,
    system: options.System = None,
    component: options.Component = None,
    signing_key: options.SigningKeyFile = None,
    client: options.ClientKind = "native",
    mock_speed: Annotated[
        float, typer.Option(metavar="X", help="How fast the vehicle of mock: flies, times real time.")
    ] = 20.0,
    live: Annotated[bool, typer.Option("--live", help="Show the flight in the rerun viewer while it goes on.")] = False,
    deadman_s: Annotated[
        float, typer.Option("--deadman", metavar="S", help="Tell when there is no position for so long.")
    ] = 3.0,
    link_lost_s: Annotated[
        float, typer.Option("--link-lost", metavar="S", help="Give the vehicle up after so long a silence.")
    ] = 30.0,
    on_breach: options.OnBreachAction = None,
    apply_limits: Annotated[
        bool,
        typer.Option(
            "--apply-limits",
            help="Set the parameters that the plan needs, after asking (--yes: without), and put the old ones back at the end.",
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with the flight that was not finished, from the ground or in the air."),
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace the track, recording and verdict of an older flight.")
    ] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Wait until ready, arm, start, follow, record, land.

    Ctrl-C: hold, then home along checked legs, and land; twice: hold, and leave it there; both end with 130. The key p (without
    a terminal: SIGUSR1) pauses: the vehicle holds; p again, and it goes on. --resume goes on with a flight that ended early,
    whatever ended it, in a folder of its own inside RUN; verify counts both.
    """
    from uavcover.cli.console import Console
    from uavcover.cli.precautions import precautions_for
    from uavcover.errors import INTERRUPTED
    from uavcover.run.fly import ENDED_BY_USER, FlightOptions, fly_run, resume_run
    from uavcover.run.folder import RunFolder
    from uavcover.run.plan_files import read_planned
    from uavcover.run.session import VehicleLink
    from uavcover.vehicle.flight_plan import FlightTimeouts

    client_name = options.client_name(client, link="default", signed=signing_key is not None)
    key = options.signing_key(signing_key)
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    folder = RunFolder(run).flight(sortie)
    precautions = precautions_for(
        folder, console, on_breach=options.on_breach(on_breach), apply_limits=apply_limits, agreed=yes
    )
    timeouts = FlightTimeouts(deadman_s=deadman_s, link_lost_s=link_lost_s)
    viewer_url = None
    if live:
        from uavcover.recording.viewer import open_live_viewer

        viewer_url = open_live_viewer()
    link = VehicleLink(
        url=to, timeout_s=timeout_s, mock_speed=mock_speed, signing_key=key, client_name=client_name, system_id=system,
        component_id=component,
    )  # fmt: skip
    asked = FlightOptions(
        confirmed=yes, force=force, viewer_url=viewer_url, timeouts=timeouts, precautions=precautions,
        upload_first=to.startswith("mock:"),  # a vehicle that begins with this process holds nothing yet
    )  # fmt: skip
    if resume:
        resumed, document = resume_run(folder, link, console, asked, command=sys.argv)
        if resumed is not None:
            console.suggest(f"uavcover verify {run}")
        console.result(document)
        return INTERRUPTED if resumed is not None and resumed.ending in ENDED_BY_USER else 0
    site, planned = read_planned(folder)
    outcome, document = fly_run(folder, site, planned.route, link, console, asked)
    console.suggest(f"uavcover verify {folder}")
    console.result(document)
    return INTERRUPTED if outcome.ending in ENDED_BY_USER else 0
