"""Lists of a vehicle: ``uavcover plan-upload`` and ``upload``, read back and compared; ``download`` and ``clear``."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission_io.autopilots.mission_lists import MissionList
from mission_io.client.client import Client
from mission_io.errors import MissionIoError, TransferError
from mission_io.formats import plan, wpl
from mission_io.formats.files import DRAWING_SUFFIXES, EVERY_LIST, ONLY_LIST, read_file
from mission_io.model.items import (
    Fence,
    GeoPoint,
    Mission,
    MissionType,
    RallyPoints,
    items_from_fence,
    items_from_rally,
)
from mission_io.model.plain_text import counted
from mission_io.wire.messages import HomePosition
from uavcover.cli import options
from uavcover.cli.console import Console
from uavcover.cli.options import option
from uavcover.errors import InputError, OutputError
from uavcover.terrain.frames import LocalFrame

if TYPE_CHECKING:
    from mission_io.client.transfer_outcome import ReadBack
    from uavcover.flight.connect import VehicleLink
    from uavcover.run.folder import RunFolder

KINDS = ("mission", "fence", "rally", "all")


def read_contents(file: Path, kind: str | None) -> tuple[list[MissionList], tuple[str, ...]]:
    """Read the lists of a ``.waypoints``, ``.plan``, ``.csv`` or ``.fen`` file.

    Returns:
        The lists, and one line for each repair and each probable mistake.

    Raises:
        InputError: the file cannot be read, or does not hold the requested list.
    """
    if kind is not None and kind not in KINDS:
        raise InputError(f"--type: {kind!r} is not one of {', '.join(KINDS)}")
    suffix = file.suffix.lower()
    if suffix in DRAWING_SUFFIXES:
        raise InputError(
            f"{file}: a {suffix} file contains positions but no mission items; use it as an area for planning, or "
            "save the mission as .waypoints"
        )
    only = ONLY_LIST.get(suffix)
    if only is not None and kind not in {None, only.name.lower()}:
        raise InputError(f"{file}: a {suffix} file contains only a {only.name.lower()} list; omit --type {kind}")
    try:
        read = read_file(file, mission_type=None if kind in {None, "all"} else MissionType[str(kind).upper()])
        contents = read.filled_lists if suffix == ".plan" and kind is None else read.lists
    except MissionIoError as error:
        raise InputError(str(error)) from error
    if kind == "all" and suffix != ".plan":
        raise InputError(
            f"{file}: a .waypoints file contains only one list; specify it with --type mission, fence or rally"
        )
    if not contents:
        raise InputError(
            f"{file}: the file contains no mission, fence or rally points; use --type all to empty the vehicle's lists"
        )
    return list(contents), (
        *(f"repaired: {repair}" for repair in read.repairs),
        *(f"doubtful: {doubt}" for doubt in read.doubts()),
    )


def home_of(contents: Sequence[MissionList]) -> GeoPoint | None:
    """The home of the mission among some lists, if there is one."""
    return next((content.home for content in contents if isinstance(content, Mission)), None)


def warn_of_home(client: Client, home: GeoPoint | None, console: Console) -> None:
    """Warn when the vehicle's home differs from the file's home: heights above home are wrong by the difference."""
    if home is None:
        return
    try:
        here = client.request_message(HomePosition, timeout_s=3.0)
    except MissionIoError:
        console.warn("the vehicle does not report its home, so it was not compared with the home in the file")
        return
    east, north, up = LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m).enu_from_geodetic(
        here.lat_deg, here.lon_deg, here.alt_amsl_m
    )[0]
    if max(abs(east), abs(north), abs(up)) > 10.0:
        console.warn(
            f"the vehicle's home is {math.hypot(east, north):.0f} m from the home in the file and {abs(up):.0f} m "
            f"{'above' if up > 0 else 'below'} it; the mission's heights are relative to the vehicle's home"
        )


def check_output(out: Path, kind: str, *, force: bool) -> None:
    """Refuse a file that cannot hold the requested lists, or that would be overwritten."""
    if kind not in KINDS:
        raise InputError(f"--type: {kind!r} is not one of {', '.join(KINDS)}")
    if out.suffix not in EVERY_LIST:
        raise InputError(f"{out}: the file name must end in {' or '.join(EVERY_LIST)}")
    if kind == "all" and out.suffix != ".plan":
        raise InputError(f"{out}: a .waypoints file contains only one list; use a .plan file for --type all")
    if out.exists() and not force:
        raise OutputError(f"{out} already exists; use --force to overwrite it, or choose another name")


def text_of(client: Client, lists: Mapping[MissionType, MissionList], out: Path, kind: str) -> tuple[str, int]:
    """The text of a file with the downloaded lists, and how many items it has."""
    mission = lists[MissionType.MISSION]
    if not isinstance(mission, Mission):
        raise InputError("the vehicle's mission contains invalid items; upload a valid mission first")
    home = mission.home
    if home is None:
        position = client.request_message(HomePosition)
        home = GeoPoint(position.lat_deg, position.lon_deg, position.alt_amsl_m)
    mission = Mission(home, mission.items)
    fence, rally = lists.get(MissionType.FENCE, Fence()), lists.get(MissionType.RALLY, RallyPoints())
    if not isinstance(fence, Fence) or not isinstance(rally, RallyPoints):
        raise InputError("the vehicle's fence or rally points contain invalid items; use --type mission")
    if out.suffix == ".plan":
        kept = mission if kind in {"mission", "all"} else Mission(home, ())
        items = len(kept.items) + len(items_from_fence(fence)) + len(items_from_rally(rally))
        return plan.write(plan.PlanFile(kept, fence, rally, mav_autopilot=client.vehicle.mav_autopilot)), items
    if kind == "fence":
        return wpl.write_fence(fence, home), len(items_from_fence(fence))
    if kind == "rally":
        return wpl.write_rally(rally, home), len(rally.points)
    return wpl.write_mission(mission), len(mission.items)


# ``uavcover clear``: empty a vehicle's lists.


def clear(
    to: options.To,
    *,
    kind: Annotated[str, option("--type", "List to clear: mission, fence, rally or all.")] = "mission",
    vehicle: options.VehicleOptions,
    link: options.LinkKind = "default",
    in_flight: Annotated[bool, option("--in-flight", "Clear the lists even if the vehicle is armed.")] = False,
    output: options.Output,
) -> int:
    """Clear the mission, fence or rally points on a vehicle, and verify that they are empty."""
    from uavcover.flight.connect import connect

    at = vehicle.link_to(to, link=link)
    console = output.console()
    if kind not in KINDS:
        raise InputError(f"--type: {kind!r} is not one of {', '.join(KINDS)}")
    lists = list(MissionType) if kind == "all" else [MissionType[kind.upper()]]
    cleared: list[str] = []
    with connect(at) as connected:
        try:
            for mission_type in lists:
                connected.client.clear(mission_type, in_flight=in_flight)
                cleared.append(mission_type.name.lower())
                console.say(f"{cleared[-1]}: cleared (read back as empty)")
        except KeyboardInterrupt:
            left = [t.name.lower() for t in lists if t.name.lower() not in cleared]
            console.warn(f"cleared: {', '.join(cleared) or 'nothing'}; possibly not cleared: {', '.join(left)}")
            raise
    console.result({"cleared": cleared})
    return 0


def download(
    url: Annotated[str, option("--from", "URL of the vehicle; see plan-upload --to.", "URL")],
    out: Annotated[Path, option("-o", "--out", "Output file: .waypoints for one list, or .plan for all three lists.")],
    *,
    kind: Annotated[str, option("--type", "List to download: mission, fence, rally or all (.plan only).")] = "mission",
    vehicle: options.TransferOptions,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Download the mission, fence or rally points of a vehicle to a file."""
    from uavcover.flight.connect import connect
    from uavcover.run.folder import write_text

    at = vehicle.transfer_link(url)
    console = output.console()
    check_output(out, kind, force=force)
    wanted = list(MissionType) if kind == "all" else [MissionType.MISSION, MissionType[kind.upper()]]
    with connect(at) as connected, console.progress("downloading") as bar:
        # A file needs home, which comes with the mission or from the vehicle.
        lists = {t: connected.client.download_list(t, progress=bar.count) for t in dict.fromkeys(wanted)}
        text, items = text_of(connected.client, lists, out, kind)
    write_text(out, text)
    console.say(f"wrote {out} ({counted(items, 'item')})")
    console.result({"file": str(out), "type": kind, "items": items})
    return 0


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
    from uavcover.flight.compiled_flight import print_comparison, telling_what_is_held
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
            print_comparison(console, results[-1])
    passed = all(result.passed for result in results)
    if passed:
        console.suggest(to_paste("download", "--from", to, "-o", "FILE"))
    console.result(
        {"file": str(file), "terrain_checked": False, "passed": passed, "lists": [r.as_json() for r in results]}
    )
    return 0 if passed else 1


def _sent_as_file(
    client: Client,
    content: MissionList,
    progress: Callable[[int, int], None],
    in_flight: bool,
    console: Console,
) -> "ReadBack | None":
    """A list sent as one file, if the vehicle holds it afterwards."""
    from mission_io.client.files import FileUploads

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
    """The vehicles of a transfer, the client, and the kind of link."""

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

    If you give a scenario, uavcover plans it first, for the number of --to options. With several --to options, uavcover
    checks all vehicles before it sends anything. upload.json describes the latest upload.
    """
    from uavcover.flight.compiled_flight import upload_run
    from uavcover.flight.connect import links_of_run, links_of_scenario, require_home
    from uavcover.planner.command import PlanRequest, plan_into
    from uavcover.plugins import load
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import to_paste

    # A bad link or key is known before an hour of planning.
    is_run = Path(source).is_dir()
    given = vehicle.addresses(to)
    addresses = (
        links_of_run(RunFolder(source), given, sortie=sortie)
        if is_run
        else links_of_scenario(source, given, sortie=sortie)
    )
    links = vehicle.links_at(addresses, client=vehicle.client, link=vehicle.link)
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


def _upload_each(run: "RunFolder", links: "list[VehicleLink]", console: Console, *, in_flight: bool) -> int:
    from uavcover.plugins import load
    from uavcover.run.user import to_paste

    documents = load("uavcover.fleets", "vehicles").upload_fleet(run, links, console, in_flight=in_flight)
    passed = all(document["passed"] for document in documents)
    if passed:
        console.suggest(to_paste("fly", run if len(links) > 1 else documents[0]["run"], *options.words_of(links)))
    console.result({"run": str(run), "passed": passed, "vehicles": documents})
    return 0 if passed else 1
