"""``uavcover plan-upload``: plan if needed, check, upload, read back, compare."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def plan_upload(
    source: Annotated[str, typer.Argument(help="A scenario (planned first), or a run folder.", metavar="SCENARIO|RUN")],
    to: options.To,
    run: Annotated[
        Path | None, typer.Option("-o", "--out", help="Run folder to plan into; default: the scenario's name.")
    ] = None,
    select: Annotated[str | None, typer.Option(help="Selection rule, when planning.", metavar="RULE")] = None,
    budget: Annotated[str | None, typer.Option(help="Search this long, when planning.")] = None,
    evaluations: Annotated[int | None, typer.Option(help="Evaluations, when planning.")] = None,
    seed: options.Seed = None,
    timeout_s: options.Timeout = 10.0,
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Upload to a vehicle that is armed.")] = False,
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Plan if needed, check every leg, upload mission, fence and rally points, read back and compare."""
    from uavcover.cli.console import Console
    from uavcover.cli.planning import plan_into
    from uavcover.cli.vehicle import planned_run, upload_run
    from uavcover.run_folder import RunFolder

    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    if Path(source).is_dir():
        folder, site, route = planned_run(Path(source))
    else:
        out = run if run is not None else Path(Path(source).stem)
        outcome = plan_into(
            out, source, console,
            seed=seed, evaluations=evaluations, budget_s=options.seconds(budget), algorithm=None, max_waypoints=None,
            select=select, autopilot=None, workers=None, force=force, command=sys.argv,
        )  # fmt: skip
        if outcome.exit_code:
            console.warn("nothing was uploaded")
            console.result(outcome.document)
            return outcome.exit_code
        folder, site, route = RunFolder(out), outcome.site, outcome.plan.chosen.route
    document = upload_run(folder, site, route, to, console, timeout_s=timeout_s, in_flight=in_flight)
    console.say(f"written: {folder.file('upload.json')}")
    console.result({"run": str(folder), **document})
    return 0 if document["passed"] else 1
