"""``uavcover demo``: the whole chain on real terrain, against a mock vehicle in another process."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def demo(
    *,
    run: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the results (the run folder).", metavar="RUN")
    ] = Path("out"),
    scenario: Annotated[str, typer.Option(help="Scenario to fly.")] = "jacksboro",
    evaluations: Annotated[
        int | None, typer.Option(help=("Number of route evaluations; default: that of the scenario."))
    ] = None,
    seed: options.Seed = None,
    autopilot: options.Autopilot = None,
    speed: Annotated[float, typer.Option(help="Speed of the mock vehicle, as a multiple of real time.")] = 100.0,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Plan a mission, upload it to a mock vehicle over UDP, fly it, record it and verify it."""
    from uavcover.cli.whole_chain import demonstrate
    from uavcover.planner.command import PlanRequest

    console = output.console()
    request = PlanRequest(
        scenario=scenario, folder=run, command=sys.argv, force=force, seed=seed, evaluations=evaluations,
        autopilot=autopilot,
    )  # fmt: skip
    return demonstrate(request, scenario, console, speed=speed)
