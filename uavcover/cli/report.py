"""``uavcover report``: one HTML file about a run."""

from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def report(
    run: Annotated[Path, typer.Argument(help="Run folder with a plan, and with track.csv if it was flown.")],
    *,
    page: Annotated[
        Path | None, typer.Option("-o", "--output", help="Output file; default: RUN/report.html.", metavar="FILE.html")
    ] = None,
    log: Annotated[
        list[Path] | None,
        typer.Option(
            "--log", help="Track of the flight (same formats as verify). Can be repeated. Default: RUN/track.csv."
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(help="Folder for figures of the ground and routes, from the side and from above.", metavar="DIR"),
    ] = None,
    background: Annotated[
        Path | None, typer.Option(help="Your own background map: GeoTIFF or MBTiles.", metavar="FILE")
    ] = None,
    show: Annotated[bool, typer.Option("--open", help="Open the report in your browser.")] = False,
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
        raise OutputError(f"{path}: this file would be overwritten; use --force, or another name")
    content = save_report(RunFolder(run), path, console, logs=log or [], background=background)
    drawn = [] if figures is None else draw_figures(content, figures, console, force=force)
    judged = None if content.verdict is None else content.verdict.report
    passed, verdict = (None, None) if judged is None else (judged.passed, judged.verdict)
    if show and not _opened(path):
        console.warn(f"{path}: no browser could be started; open the file yourself")
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
