"""``uavcover report``: one HTML file about a run."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options
from uavcover.cli.options import option

# ``uavcover inspect``: look at the recording of a flight.


def inspect(
    run: Annotated[Path, typer.Argument(help="Run folder with flight.rrd, or a .rrd file.")],
    *,
    text: Annotated[bool, option("--text", "Print the contents of the recording.")] = False,
    screenshot: Annotated[Path | None, option("Write a screenshot. This works without a display.", "FILE.png")] = None,
    at: Annotated[float, option("Time of the screenshot, from 0 (start of the flight) to 1 (end).", "SHARE")] = 1.0,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Open the recording in the rerun viewer, print its content, or write a screenshot."""
    import dataclasses

    from uavcover.errors import OutputError
    from uavcover.recording import layout, viewer
    from uavcover.run.folder import RunFolder

    console = output.console()
    path = run if run.suffix == ".rrd" else RunFolder(run).existing("flight.rrd", made_by="uavcover fly")
    if text or output.as_json:
        rows = layout.describe_recording(path)
        console.say(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
        for row in rows:
            span = "static" if row.start_s is None else f"{row.samples} rows, {row.start_s:.1f} s to {row.end_s:.1f} s"
            console.say(f"  {row.entity:40} {span}")
        console.result({"recording": str(path), "entities": [dataclasses.asdict(row) for row in rows]})
    if screenshot is not None:
        if screenshot.exists() and not force:
            raise OutputError(f"{screenshot} already exists; use --force to overwrite it, or choose another name")
        viewer.screenshot(path, screenshot, at_share=at)
        console.say(f"wrote {screenshot}")
    if not text and not output.as_json and screenshot is None:
        viewer.open_viewer(path)
        console.say(f"the viewer shows {path}")
    return 0


def report(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan, and with track.csv if it was flown.")],
    *,
    page: Annotated[
        Path | None, option("-o", "--output", "Output file; default: RUN/report.html.", "FILE.html")
    ] = None,
    log: Annotated[
        list[Path] | None,
        option("Track of the flight (same formats as verify). Can be repeated. Default: RUN/track.csv."),
    ] = None,
    figures: Annotated[
        Path | None,
        option("Folder for figures that show the ground and the routes from the side and from above.", "DIR"),
    ] = None,
    background: Annotated[Path | None, option("Your own background map: GeoTIFF or MBTiles.", "FILE")] = None,
    show: Annotated[bool, option("--open", "Open the report in your browser.")] = False,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Write an HTML report with map, 3D view, heights, coverage, requirements and alternatives. It opens offline."""
    from uavcover.errors import OutputError
    from uavcover.report.page import draw_figures, save_report
    from uavcover.run.folder import REPORT_FILE, RunFolder

    console = output.console()
    path = RunFolder(run).file(REPORT_FILE) if page is None else page
    if page is not None and path.exists() and not force:
        raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name")
    content = save_report(RunFolder(run), path, console, logs=log or [], background=background)
    drawn = [] if figures is None else draw_figures(content, figures, console, force=force)
    judged = None if content.verdict is None else content.verdict.report
    passed, verdict = (None, None) if judged is None else (judged.passed, judged.verdict)
    if show and not _opened(path):
        console.warn(f"{path}: cannot start a browser; open the file manually")
    if not show:
        console.suggest(f"open {path} in a browser, or add --open")
    console.result(
        {"report": str(path), "passed": passed, "verdict": verdict, "figures": [str(figure) for figure in drawn]}
    )
    return 0


def _opened(path: Path) -> bool:
    """Whether a browser was started on a file."""
    import webbrowser

    try:
        return webbrowser.open(path.resolve().as_uri())
    except (webbrowser.Error, OSError):
        return False
