"""``uavcover export``: the chosen route of a run as a file for other software."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def export(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    file_format: Annotated[str, typer.Option("--format", help="waypoints, plan, kml, geojson or csv.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="File to write.", metavar="FILE")],
    *,
    sortie: options.Sortie = None,
    autopilot: options.Autopilot = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Write one mission file for other software."""
    from mission_io.formats.files import FORMATS
    from uavcover.errors import InputError, OutputError
    from uavcover.model.vehicle import autopilot_name
    from uavcover.run.folder import RunFolder, write_text
    from uavcover.run.mission import compile_plan, export_text
    from uavcover.run.plan_files import read_planned

    console = output.console()
    if file_format not in FORMATS:
        raise InputError(f"--format: {file_format!r} is not one of {', '.join(FORMATS)}")
    site, planned = read_planned(RunFolder(run).flight(sortie))
    name = autopilot_name(autopilot, site.scenario.vehicle.autopilot)
    compiled = compile_plan(site, planned.route, autopilot=name)
    text = export_text(compiled, file_format, autopilot=name, name=site.scenario.name)
    if out.exists() and not force:
        raise OutputError(f"{out}: would be overwritten; use --force, or another name")
    write_text(out, text)
    console.say(f"written: {out}")
    console.result({"file": str(out), "format": file_format, "items": len(compiled.mission.items)})
    return 0
