"""``uavcover clear``: empty a vehicle's lists."""

from typing import Annotated

import typer

from uavcover.cli import options


def clear(
    to: options.To,
    kind: Annotated[str, typer.Option("--type", help="mission, fence, rally or all.")] = "mission",
    timeout_s: options.Timeout = 10.0,
    system: options.System = None,
    component: options.Component = None,
    signing_key: options.SigningKeyFile = None,
    link: options.LinkKind = "default",
    in_flight: Annotated[bool, typer.Option("--in-flight", help="Clear a vehicle that is armed.")] = False,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Empty a vehicle's mission, fence or rally points, and read back that they are empty."""
    from mission_io.links.simulated import link_preset
    from mission_io.model.items import MissionType
    from uavcover.cli.console import Console
    from uavcover.cli.mission_files import KINDS
    from uavcover.errors import InputError
    from uavcover.run.session import VehicleLink, connect

    key = options.signing_key(signing_key)
    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    if kind not in KINDS:
        raise InputError(f"--type: {kind!r} is not one of {', '.join(KINDS)}")
    lists = list(MissionType) if kind == "all" else [MissionType[kind.upper()]]
    cleared: list[str] = []
    at = VehicleLink(
        url=to, timeout_s=timeout_s, timing=link_preset(link).timing, signing_key=key, system_id=system,
        component_id=component,
    )  # fmt: skip
    with connect(at) as vehicle:
        try:
            for mission_type in lists:
                vehicle.client.clear(mission_type, in_flight=in_flight)
                cleared.append(mission_type.name.lower())
                console.say(f"{cleared[-1]}: empty, read back")
        except KeyboardInterrupt:
            left = [t.name.lower() for t in lists if t.name.lower() not in cleared]
            console.warn(f"cleared: {', '.join(cleared) or 'nothing'}; not known to be cleared: {', '.join(left)}")
            raise
    console.result({"cleared": cleared})
    return 0
