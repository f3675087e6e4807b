"""``uavcover clear``: empty a vehicle's lists."""

from typing import Annotated

import typer

from uavcover.cli import options


def clear(
    to: options.To,
    *,
    kind: Annotated[str, typer.Option("--type", help="The list to clear: mission, fence, rally or all.")] = "mission",
    vehicle: options.VehicleOptions,
    link: options.LinkKind = "default",
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Allow the command on an armed vehicle.")] = False,
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
                console.say(f"{cleared[-1]}: empty, read back")
        except KeyboardInterrupt:
            left = [t.name.lower() for t in lists if t.name.lower() not in cleared]
            console.warn(f"cleared: {', '.join(cleared) or 'nothing'}; possibly not cleared: {', '.join(left)}")
            raise
    console.result({"cleared": cleared})
    return 0
