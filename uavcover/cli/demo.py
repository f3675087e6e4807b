"""``uavcover demo``: the whole chain on real terrain, against a mock vehicle in another process."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def demo(
    *,
    run: Annotated[Path, typer.Option("-o", "--out", help="Run folder to write.", metavar="RUN")] = Path("out"),
    scenario: Annotated[str, typer.Option(help="Another scenario.")] = "jacksboro",
    evaluations: Annotated[int | None, typer.Option(help="Evaluations of the optimizer.")] = None,
    seed: options.Seed = None,
    autopilot: options.Autopilot = None,
    speed: Annotated[float, typer.Option(help="How fast the mock vehicle flies, times real time.")] = 100.0,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Plan on real terrain, upload to a mock vehicle over UDP, read back, fly, record, verify."""
    from uavcover.cli.whole_chain import demonstrate
    from uavcover.planner.command import PlanRequest

    console = output.console()
    request = PlanRequest(
        scenario=scenario, folder=run, command=sys.argv, force=force, seed=seed, evaluations=evaluations,
        autopilot=autopilot,
    )  # fmt: skip
    return demonstrate(request, scenario, console, speed=speed)
