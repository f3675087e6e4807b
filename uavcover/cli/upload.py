"""``uavcover upload``: any mission file to a vehicle."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options

if TYPE_CHECKING:
    from collections.abc import Callable

    from mission_io.autopilots.autopilot import MissionList
    from mission_io.client.client import Client
    from mission_io.client.read_back import ReadBack
    from uavcover.cli.console import Console


def upload(
    file: Annotated[Path, typer.Argument(help="File to upload: .waypoints, .plan, .csv or .fen.")],
    to: options.To,
    *,
    kind: Annotated[
        str | None,
        typer.Option(
            "--type", help=("The list to upload: mission, fence, rally or all; default: the content of the file.")
        ),
    ] = None,
    vehicle: options.TransferOptions,
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Allow the upload to an armed vehicle.")] = False,
    as_file: Annotated[
        bool,
        typer.Option(
            "--as-file",
            help=("Upload the list as one file with MAVLink FTP (ArduPilot). If this fails, upload it item by item."),
        ),
    ] = False,
    output: options.Output,
) -> int:
    """Upload a mission, fence or rally file, read it back and compare it. The terrain is not checked."""
    from uavcover.cli.mission_files import home_of, read_contents, warn_of_home
    from uavcover.flight.connect import connect
    from uavcover.flight.upload import say_comparison, telling_what_is_held
    from uavcover.run.user import to_paste

    at = vehicle.transfer_link(to)
    console = output.console()
    contents, remarks = read_contents(file, kind)
    for remark in remarks:
        console.warn(f"{file}: {remark}")
    console.warn(f"{file}: the terrain was not checked (a mission file has no terrain; plan-upload checks every leg)")
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
        console.warn("the vehicle read a different list from the file; the list was sent item by item")
    return result if result.passed else None
