"""``uavcover plan-upload``: plan if needed, check, upload, read back, compare."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def plan_upload(
    source: Annotated[str, typer.Argument(help="A scenario (planned first), or a run folder.", metavar="SCENARIO|RUN")],
    to: options.To,
    sortie: options.Sortie = None,
    run: Annotated[
        Path | None, typer.Option("-o", "--out", help="Run folder to plan into; default: the scenario's name.")
    ] = None,
    select: Annotated[str | None, typer.Option(help="Selection rule, when planning.", metavar="RULE")] = None,
    budget: Annotated[str | None, typer.Option(help="Search this long, when planning.")] = None,
    evaluations: Annotated[int | None, typer.Option(help="Evaluations, when planning.")] = None,
    seed: options.Seed = None,
    timeout_s: options.Timeout = 10.0,
    system: options.System = None,
    component: options.Component = None,
    signing_key: options.SigningKeyFile = None,
    client: options.ClientKind = "native",
    link: options.LinkKind = "default",
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Upload to a vehicle that is armed.")] = False,
    force: options.ForcePlan = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Plan if needed, check every leg, upload mission, fence and rally points, read back and compare.

    upload.json tells of the last upload; an older one is replaced.
    """
    from mission_io.links.simulated import link_preset
    from uavcover.cli.console import Console
    from uavcover.errors import InputError
    from uavcover.run.folder import RunFolder
    from uavcover.run.plan import PlanRequest, plan_into
    from uavcover.run.plan_files import read_planned
    from uavcover.run.session import VehicleLink, require_home
    from uavcover.run.upload import upload_run

    client_name = options.client_name(client, link=link, signed=signing_key is not None)
    key = options.signing_key(signing_key)  # a bad key is known before an hour of planning
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    if Path(source).is_dir():
        given = {"-o": run, "--select": select, "--budget": budget, "--evaluations": evaluations, "--seed": seed}
        unused = [name for name, value in given.items() if value is not None]
        if unused:
            raise InputError(
                f"{source}: is a run folder and has its plan already; {', '.join(unused)} would do nothing"
            )
        folder = RunFolder(source).flight(sortie)
        site, planned = read_planned(folder)
    else:
        folder = RunFolder(run if run is not None else Path(source).stem)
        request = PlanRequest(
            scenario=source, folder=folder.path, command=sys.argv, force=force, seed=seed, evaluations=evaluations,
            budget_s=options.seconds(budget), select=select,
        )  # fmt: skip
        outcome = plan_into(request, console, check_site=require_home)
        if outcome.exit_code:
            console.warn("nothing was uploaded")
            console.result(outcome.document)
            return outcome.exit_code
        folder = folder.flight(sortie)
        site, planned = read_planned(folder)
    link_of = VehicleLink(
        url=to, timeout_s=timeout_s, timing=link_preset(link).timing, signing_key=key, client_name=client_name,
        system_id=system, component_id=component,
    )  # fmt: skip
    document = upload_run(folder, site, planned.route, link_of, console, in_flight=in_flight)
    console.say(f"written: {folder.file('upload.json')}")
    if document["passed"]:
        console.suggest(f"uavcover fly {folder} --to {to}")
    console.result({"run": str(folder), **document})
    return 0 if document["passed"] else 1
