"""``uavcover upload``: any mission file to a vehicle."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def upload(
    file: Annotated[Path, typer.Argument(help="A .waypoints, .plan, .csv or .fen file.")],
    to: options.To,
    kind: Annotated[
        str | None, typer.Option("--type", help="mission, fence, rally or all; default: what the file holds.")
    ] = None,
    timeout_s: options.Timeout = 10.0,
    system: options.System = None,
    component: options.Component = None,
    signing_key: options.SigningKeyFile = None,
    client: options.ClientKind = "native",
    link: options.LinkKind = "default",
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Upload to a vehicle that is armed.")] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Upload a mission, fence or rally file, read it back and compare; the terrain is not checked."""
    from mission_io.links.simulated import link_preset
    from uavcover.cli.console import Console
    from uavcover.cli.mission_files import home_of, read_contents, warn_of_home
    from uavcover.run.session import VehicleLink, connect
    from uavcover.run.upload import say_comparison, telling_what_is_held

    client_name = options.client_name(client, link=link, signed=signing_key is not None)
    key = options.signing_key(signing_key)
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    contents, remarks = read_contents(file, kind)
    for remark in remarks:
        console.warn(f"{file}: {remark}")
    console.warn(f"{file}: terrain not checked (the file carries none; plan-upload checks every leg)")
    results = []
    timing = link_preset(link).timing
    home = home_of(contents)
    at = VehicleLink(
        url=to, timeout_s=timeout_s, timing=timing, signing_key=key, client_name=client_name, system_id=system,
        component_id=component,
    )  # fmt: skip
    with connect(at, home=home) as vehicle:
        console.say(f"vehicle {vehicle.client.vehicle.system_id} at {to}: {vehicle.client.vehicle.described}")
        warn_of_home(vehicle.client, home, console)
        for content in contents:
            with telling_what_is_held(console), console.progress("uploading") as bar:
                results.append(vehicle.client.upload_and_verify(content, progress=bar.count, in_flight=in_flight))
            say_comparison(console, results[-1])
    passed = all(result.passed for result in results)
    if passed:
        console.suggest(f"uavcover download --from {to} -o FILE")
    console.result(
        {"file": str(file), "terrain_checked": False, "passed": passed, "lists": [r.as_json() for r in results]}
    )
    return 0 if passed else 1
