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
    from uavcover.cli.ending import INTERRUPTED
    from uavcover.cli.flying import ENDED_BY_USER, fly_run
    from uavcover.cli.precautions import precautions_for
    from uavcover.run.folder import RunFolder
    from uavcover.run.plan_files import read_planned
    from uavcover.vehicle.flight_plan import Patience

    client_name = options.client_name(client, link="default", signed=signing_key is not None)
    key = options.signing_key(signing_key)
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    folder = RunFolder(run).flight(sortie)
    precautions = precautions_for(
        folder, console, on_breach=options.on_breach(on_breach), apply_limits=apply_limits, agreed=yes
    )
    patience = Patience(deadman_s=deadman_s, link_lost_s=link_lost_s)
    viewer_url = None
    if live:
        from uavcover.recording.viewer import open_live_viewer

        viewer_url = open_live_viewer()
    if resume:
        from uavcover.cli.resuming import resume_run

        resumed, document = resume_run(
            folder, to, console, timeout_s=timeout_s, confirmed=yes, mock_speed=mock_speed, viewer_url=viewer_url,
            signing_key=key, client_name=client_name, patience=patience, precautions=precautions, command=sys.argv,
            system_id=system,
            component_id=component,
        )  # fmt: skip
        console.result(document)
        return INTERRUPTED if resumed is not None and resumed.ending in ENDED_BY_USER else 0
    site, planned = read_planned(folder)
    # A vehicle that begins with this process holds nothing yet.
    outcome, document = fly_run(
        folder, site, planned.route, to, console,
        timeout_s=timeout_s, confirmed=yes, force=force, mock_speed=mock_speed, upload_first=to.startswith("mock:"),
        viewer_url=viewer_url, signing_key=key, client_name=client_name, patience=patience, precautions=precautions,
        system_id=system,
        component_id=component,
    )  # fmt: skip
    console.result(document)
    return INTERRUPTED if outcome.ending in ENDED_BY_USER else 0
