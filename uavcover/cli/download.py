"""``uavcover download``: what a vehicle holds, as a file."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def download(
    url: Annotated[str, typer.Option("--from", help="URL of the vehicle; see plan-upload --to.", metavar="URL")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help=("Output file: .waypoints for one list, or .plan for all three lists."))
    ],
    *,
    kind: Annotated[
        str, typer.Option("--type", help=("The list to download: mission, fence, rally or all (.plan only)."))
    ] = "mission",
    vehicle: options.TransferOptions,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Download the mission, fence or rally points of a vehicle to a file."""
    from mission_io.model.items import MissionType
    from uavcover.cli.mission_files import check_output, text_of
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
    console.say(f"written: {out} ({items} items)")
    console.result({"file": str(out), "type": kind, "items": items})
    return 0
