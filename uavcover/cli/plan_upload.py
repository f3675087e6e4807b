"""``uavcover plan-upload``: plan if needed, check, upload, read back, compare."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from collections.abc import Callable

    from mission_io.autopilots.mission_lists import MissionList
    from mission_io.client.client import Client
    from mission_io.client.transfer_outcome import ReadBack
    from uavcover.cli.console import Console
    from uavcover.flight.connect import VehicleLink
    from uavcover.run.folder import RunFolder

# ``uavcover upload``: any mission file to a vehicle.


def upload(
    file: Annotated[Path, typer.Argument(help="File to upload: .waypoints, .plan, .csv or .fen.")],
    to: options.To,
    *,
    kind: Annotated[
        str | None, option("--type", "List to upload: mission, fence, rally or all; default: every list in the file.")
    ] = None,
    vehicle: options.TransferOptions,
    in_flight: Annotated[bool, option("--in-flight", "Upload even if the vehicle is armed.")] = False,
    as_file: Annotated[
        bool,
        option(
            "--as-file",
            "Upload the list as one file over MAVLink FTP (ArduPilot). If this fails, upload it item by item.",
        ),
    ] = False,
    output: options.Output,
) -> int:
    """Upload a mission, fence or rally file, read it back and compare it. The terrain is not checked."""
    from uavcover.cli.mission_files import home_of, read_contents, warn_of_home
    from uavcover.flight.compiled_flight import say_comparison, telling_what_is_held
    from uavcover.flight.connect import connect
    from uavcover.run.user import to_paste

    at = vehicle.transfer_link(to)
    console = output.console()
    contents, remarks = read_contents(file, kind)
    for remark in remarks:
        console.warn(f"{file}: {remark}")
    console.warn(f"{file}: terrain not checked, because a mission file contains none; plan-upload checks every leg")
    results = []
    home = home_of(contents)
    with connect(at, home=home) as connected:
        client = connected.client
        console.say(f"vehicle {client.vehicle.system_id} at {to}: {client.vehicle.described}")
        warn_of_home(client, home, console)
        for content in contents:
            with telling_what_is_held(console), console.progress("uploading") as bar:
                result = _sent_as_file(client, content, bar.count, in_flight, console) if as_file else None
                results.append(result or client.upload_and_verify(content, progress=bar.count, in_flight=in_flight))
            say_comparison(console, results[-1])
    passed = all(result.passed for result in results)
    if passed:
        console.suggest(to_paste("download", "--from", to, "-o", "FILE"))
    console.result(
        {"file": str(file), "terrain_checked": False, "passed": passed, "lists": [r.as_json() for r in results]}
    )
    return 0 if passed else 1


def _sent_as_file(
    client: "Client",
    content: "MissionList",
    progress: "Callable[[int, int], None]",
    in_flight: bool,
    console: "Console",
) -> "ReadBack | None":
    """A list sent as one file, if the vehicle holds it afterwards."""
    from mission_io.client.files import FileUploads
    from mission_io.errors import TransferError

    if not client.vehicle.autopilot.lists_as_files:
        console.warn(f"{client.vehicle.autopilot.name} does not accept lists as files; the list was sent item by item")
        return None
    try:
        result = FileUploads(client).upload_list(content, progress=progress, in_flight=in_flight)
    except TransferError as error:
        console.warn(f"{error}; the list was sent item by item")
        return None
    if not result.passed:
        console.warn("the vehicle's list differs from the uploaded file; the list was sent item by item")
    return result if result.passed else None


@dataclass(frozen=True, slots=True)
class EachTransfer(options.EachVehicleOptions):
    """Which vehicles the missions are sent to, by which client, over what kind of link."""

    client: options.ClientKind = "native"
    link: options.LinkKind = "default"


@dataclass(frozen=True, slots=True)
class Planning:
    """Planning options, for a run without a plan."""

    run: Annotated[
        Path | None, option("-o", "--out", "Run folder for the plan; default: a folder named after the scenario.")
    ] = None
    select: Annotated[str | None, option("Rule that selects the route of the plan.", "RULE")] = None
    budget: Annotated[str | None, option("Time limit for planning.")] = None
    evaluations: Annotated[int | None, option("Number of route evaluations during planning.")] = None
    seed: options.Seed = None

    def given(self) -> list[str]:
        """The options that were given."""
        values = {
            "-o": self.run, "--select": self.select, "--budget": self.budget, "--evaluations": self.evaluations,
            "--seed": self.seed,
        }  # fmt: skip
        return [name for name, value in values.items() if value is not None]


def plan_upload(
    source: Annotated[
        str, typer.Argument(help="A scenario, which is planned first, or a run folder.", metavar="SCENARIO|RUN")
    ],
    to: options.ToEach = None,
    *,
    sortie: options.Sortie = None,
    planning: Planning,
    vehicle: EachTransfer,
    in_flight: Annotated[bool, option("--in-flight", "Upload even if the vehicle is armed.")] = False,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Check the mission, upload it with its fence and rally points, read them back and compare them.

    A scenario is planned first. With several --to, all vehicles are checked before anything is sent, and a scenario is
    planned for this number of vehicles. upload.json describes the latest upload.
    """
    from uavcover.errors import InputError
    from uavcover.flight.compiled_flight import upload_run
    from uavcover.flight.connect import links_of_run, links_of_scenario, require_home
    from uavcover.planner.command import PlanRequest, plan_into
    from uavcover.plugins import load
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import to_paste

    # A bad link or key is known before an hour of planning.
    is_run = Path(source).is_dir()
    given = vehicle.places(to)
    places = (
        links_of_run(RunFolder(source), given, sortie=sortie)
        if is_run
        else links_of_scenario(source, given, sortie=sortie)
    )
    links = vehicle.links_at(places, client=vehicle.client, link=vehicle.link)
    if len(links) > 1 and sortie is not None:
        raise InputError(
            "--sortie cannot be combined with more than one --to: each vehicle gets its own first sortie; remove --sortie"
        )
    console = output.console()
    if is_run:
        if unused := planning.given():
            raise InputError(
                f"{source}: this run folder already has a plan, so {', '.join(unused)} would have no effect; omit it"
            )
        folder = RunFolder(source)
    else:
        folder = RunFolder(planning.run if planning.run is not None else Path(source).stem)
        request = PlanRequest(
            scenario=source, folder=folder.path, command=sys.argv, force=force, seed=planning.seed,
            evaluations=planning.evaluations, budget_s=options.seconds(planning.budget), select=planning.select,
            vehicles=len(links) if len(links) > 1 else None,
        )  # fmt: skip
        outcome = plan_into(request, console, check_site=require_home)
        if outcome.exit_code:
            console.warn("nothing was uploaded")
            console.result(outcome.document)
            return outcome.exit_code
    if len(links) > 1:
        if not is_run:
            links = load("uavcover.fleets", "vehicles").links_that_fly(folder, links, console)
        return _upload_each(folder, links, console, in_flight=in_flight)
    folder = folder.flight(sortie)
    site, planned = read_planned(folder)
    document = upload_run(folder, site, planned.route, links[0], console, in_flight=in_flight)
    console.say(f"wrote {folder.file('upload.json')}")
    if document["passed"]:
        console.suggest(to_paste("fly", folder, *options.words_of(links)))
    console.result({"run": str(folder), **document})
    return 0 if document["passed"] else 1


def _upload_each(run: "RunFolder", links: "list[VehicleLink]", console: "Console", *, in_flight: bool) -> int:
    from uavcover.plugins import load
    from uavcover.run.user import to_paste

    documents = load("uavcover.fleets", "vehicles").upload_fleet(run, links, console, in_flight=in_flight)
    passed = all(document["passed"] for document in documents)
    if passed:
        console.suggest(to_paste("fly", run if len(links) > 1 else documents[0]["run"], *options.words_of(links)))
    console.result({"run": str(run), "passed": passed, "vehicles": documents})
    return 0 if passed else 1
