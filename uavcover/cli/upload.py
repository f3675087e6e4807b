"""``uavcover upload``: any mission file to a vehicle."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def upload(
    file: Annotated[Path, typer.Argument(help="A .waypoints, .plan, .csv or .fen file.")],
    to: options.To,
    *,
    kind: Annotated[
        str | None, typer.Option("--type", help="mission, fence, rally or all; default: what the file holds.")
    ] = None,
    vehicle: options.TransferOptions,
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Upload to a vehicle that is armed.")] = False,
    output: options.Output,
) -> int:
    """Upload a mission, fence or rally file, read it back and compare; the terrain is not checked."""
    from uavcover.cli.mission_files import home_of, read_contents, warn_of_home
    from uavcover.run.session import connect
    from uavcover.run.upload import say_comparison, telling_what_is_held

    at = vehicle.transfer_link(to)
    console = output.console()
    contents, remarks = read_contents(file, kind)
    for remark in remarks:
        console.warn(f"{file}: {remark}")
    console.warn(f"{file}: terrain not checked (the file carries none; plan-upload checks every leg)")
    results = []
    home = home_of(contents)
    with connect(at, home=home) as connected:
        client = connected.client
        console.say(f"vehicle {client.vehicle.system_id} at {to}: {client.vehicle.described}")
        warn_of_home(client, home, console)
        for content in contents:
            with telling_what_is_held(console), console.progress("uploading") as bar:
                results.append(client.upload_and_verify(content, progress=bar.count, in_flight=in_flight))
            say_comparison(console, results[-1])
    passed = all(result.passed for result in results)
    if passed:
        console.suggest(f"uavcover download --from {to} -o FILE")
    console.result(
        {"file": str(file), "terrain_checked": False, "passed": passed, "lists": [r.as_json() for r in results]}
    )
    return 0 if passed else 1
