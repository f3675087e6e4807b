"""``uavcover download``: what a vehicle holds, as a file."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def download(
    url: Annotated[str, typer.Option("--from", help="Where the vehicle is; see plan-upload --to.", metavar="URL")],
    out: Annotated[Path, typer.Option("-o", "--out", help="A .waypoints file (one list) or a .plan file (all three).")],
    kind: Annotated[str, typer.Option("--type", help="mission, fence, rally or all (.plan).")] = "mission",
    timeout_s: options.Timeout = 10.0,
    system: options.System = None,
    component: options.Component = None,
    signing_key: options.SigningKeyFile = None,
    client: options.ClientKind = "native",
    link: options.LinkKind = "default",
    force: options.Force = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Download a vehicle's mission, fence or rally points into a file."""
    from mission_io.links.simulated import link_preset
    from mission_io.model.items import MissionType
    from uavcover.cli.console import Console
    from uavcover.cli.mission_files import check_output, text_of
    from uavcover.run.folder import write_text
    from uavcover.run.session import VehicleLink, connect

    client_name = options.client_name(client, link=link, signed=signing_key is not None)
    key = options.signing_key(signing_key)
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    check_output(out, kind, force=force)
    wanted = list(MissionType) if kind == "all" else [MissionType.MISSION, MissionType[kind.upper()]]
    at = VehicleLink(
        url=url, timeout_s=timeout_s, timing=link_preset(link).timing, signing_key=key, client_name=client_name,
        system_id=system, component_id=component,
    )  # fmt: skip
    with connect(at) as vehicle, console.progress("downloading") as bar:
        # A file needs home, which comes with the mission or from the vehicle.
        lists = {t: vehicle.client.download_list(t, progress=bar.count) for t in dict.fromkeys(wanted)}
        text, items = text_of(vehicle.client, lists, out, kind)
    write_text(out, text)
    console.say(f"written: {out} ({items} items)")
    console.result({"file": str(out), "type": kind, "items": items})
    return 0
