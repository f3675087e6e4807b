"""``uavcover verify``: coverage and safety of what was flown."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def verify(
    run: Annotated[
        Path, typer.Argument(help="Run folder with scenario.toml; plan.json and track.csv where there are.")
    ],
    log: Annotated[
        Path | None, typer.Option("--log", help="The flown track: a .csv or .rrd of uavcover; default RUN/track.csv.")
    ] = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Recompute coverage and safety from the flown track; exit 1 when it does not pass."""
    from uavcover.cli.console import Console
    from uavcover.cli.verifying import verify_run
    from uavcover.run_folder import RunFolder

    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    report = verify_run(RunFolder(run), console, log=log)
    console.result(report)
    return 0 if report["passed"] else 1
