"""``uavcover inspect``: look at the recording of a flight."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def inspect(
    run: Annotated[Path, typer.Argument(help="Run folder with flight.rrd, or a .rrd file.")],
    *,
    text: Annotated[bool, typer.Option("--text", help="Print the content of the recording.")] = False,
    screenshot: Annotated[
        Path | None, typer.Option(help="Write a screenshot. This works without a display.", metavar="FILE.png")
    ] = None,
    at: Annotated[
        float, typer.Option(help="Time of the screenshot, from 0 (start of the flight) to 1 (end).", metavar="SHARE")
    ] = 1.0,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Open the recording in the rerun viewer, print its content, or write a screenshot."""
    import dataclasses

    from uavcover.errors import OutputError
    from uavcover.recording import reader, viewer
    from uavcover.run.folder import RunFolder

    console = output.console()
    path = run if run.suffix == ".rrd" else RunFolder(run).existing("flight.rrd", made_by="uavcover fly")
    if text or output.as_json:
        rows = reader.describe_recording(path)
        console.say(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
        for row in rows:
            span = "static" if row.start_s is None else f"{row.samples} rows, {row.start_s:.1f} s to {row.end_s:.1f} s"
            console.say(f"  {row.entity:40} {span}")
        console.result({"recording": str(path), "entities": [dataclasses.asdict(row) for row in rows]})
    if screenshot is not None:
        if screenshot.exists() and not force:
            raise OutputError(f"{screenshot}: this file would be overwritten; use --force, or another name")
        viewer.screenshot(path, screenshot, at_share=at)
        console.say(f"written: {screenshot}")
    if not text and not output.as_json and screenshot is None:
        viewer.open_viewer(path)
        console.say(f"the viewer shows {path}")
    return 0
