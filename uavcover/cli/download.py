"""``uavcover download``: what a vehicle holds, as a file."""

from pathlib import Path
from typing import Annotated

from mission_io.model.plain_text import counted
from uavcover.cli import options
from uavcover.cli.options import option

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
    from mission_io.model.items import MissionType
    from uavcover.cli.mission_files import KINDS
    from uavcover.errors import InputError
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
    console.say(f"wrote {out} ({counted(items, 'item')})")
    console.result({"file": str(out), "type": kind, "items": items})
    return 0
