"""``uavcover verify``: coverage and safety of what was flown."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def verify(
    run: Annotated[
        Path, typer.Argument(help="Run folder with scenario.toml; plan.json and track.csv where there are.")
    ],
    *,
    logs: options.Logs = None,
    accept_changed: options.AcceptChanged = None,
    output: options.Output,
) -> int:
    """Recompute coverage and safety from the flown track; exit 1 when it does not pass.

    Several logs count as one flight: what any of them saw was seen, and each has to keep the limits. What changed since it was
    planned or flown (scenario, terrain, obstacles, plan, mission files, track, version) is named and not judged, unless accepted.
    """
    from uavcover.run.folder import RunFolder
    from uavcover.run.judge import verify_run

    console = output.console()
    _, report = verify_run(RunFolder(run), console, command=sys.argv, logs=logs or (), accepted=accept_changed or ())
    console.suggest(f"uavcover report {run}", *([f"uavcover gaps {run}"] if report["gaps"] else []))
    console.result(report)
    return 0 if report["passed"] else 1
