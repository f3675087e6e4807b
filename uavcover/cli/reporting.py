"""Writing the report of a run, as ``report`` and ``demo`` do it."""

from collections.abc import Sequence
from pathlib import Path

from uavcover.cli.console import Console
from uavcover.errors import OutputError
from uavcover.report.content import ReportContent, read_run
from uavcover.report.page import render_report
from uavcover.run_folder import RunFolder, write_text


def write_report(run: RunFolder, path: Path, console: Console, *, logs: Sequence[Path] = ()) -> ReportContent:
    """Write the report of a run folder to a file; it follows from other files, so it may replace an older one.

    Raises:
        InputError: a file of the run is missing or broken.
        OutputError: the report cannot be written.
    """
    with console.progress("reporting"):
        content = read_run(run, logs=logs)
        text = render_report(content)
    for warning in content.warnings:
        console.warn(warning)
    write_text(path, text)
    console.say(f"written: {path} ({len(text.encode()) / 1e6:.1f} MB)")
    return content


def draw_figures(content: ReportContent, folder: Path, console: Console, *, force: bool) -> list[Path]:
    """Draw the figures of a run into a folder.

    Raises:
        OutputError: a figure is there already and ``force`` was not said, or cannot be written.
    """
    from uavcover.report.figures import FIGURE_NAMES, save_figures

    there = [name for name in FIGURE_NAMES if (folder / name).exists()]
    if there and not force:
        raise OutputError(f"{folder}: {', '.join(there)} would be overwritten; use --force, or another folder")
    drawn = save_figures(content, folder)
    console.say(f"written: {', '.join(str(path) for path in drawn)}")
    return drawn
