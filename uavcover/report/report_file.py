"""Writing the report of a run, as ``report`` and ``demo`` do it."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from uavcover.errors import OutputError
from uavcover.report.content import ReportContent, read_run
from uavcover.report.page import render_report
from uavcover.run.folder import RunFolder, write_text
from uavcover.run.judged_inputs import (
    accepted_in,
    inspect_inputs,
    judged_logs,
    refuse_changes,
    same_inputs,
    unsealed_in_words,
    was_flown,
)
from uavcover.run.provenance import note_files
from uavcover.run.user import Unattended, User

REPORT, VERDICT = "report.html", "verification.json"


def write_report(run: str | Path, path: str | Path | None = None, *, logs: Sequence[str | Path] = ()) -> Path:
    """Write the report of a run folder, one HTML file that opens offline, as ``uavcover report`` does.

    Args:
        run: the run folder.
        path: the file. Default: ``report.html`` in the run folder.
        logs: what was flown. Default: the run's tracks.

    Returns:
        The file.
    """
    folder = RunFolder(run)
    to = folder.file(REPORT) if path is None else Path(path)
    save_report(folder, to, Unattended(), logs=[Path(log) for log in logs])
    return to


def save_report(run: RunFolder, path: Path, user: User, *, logs: Sequence[Path] = ()) -> ReportContent:
    """Write the report of a run folder to a file; it follows from other files, so it may replace an older one.

    Raises:
        InputError: a file of the run is missing or broken.
        OutputError: the report cannot be written.
    """
    of_run = path.resolve() == run.file(REPORT).resolve()
    if of_run and run.file(REPORT).exists():
        run.remove([REPORT])  # a report that is refused leaves no older one behind
    notices = _standing(run, logs)
    with user.progress("reporting"):
        content = read_run(run, logs=logs, notices=notices)
        text = render_report(content)
    for warning in (*content.notices, *content.warnings):
        user.warn(warning)
    write_text(path, text)
    if of_run:
        note_files(run, "report", [REPORT], command=sys.argv)
    user.say(f"written: {path} ({len(text.encode()) / 1e6:.1f} MB)")
    return content


def _standing(run: RunFolder, logs: Sequence[Path]) -> list[str]:
    """How the report stands to ``verification.json``: what has to be said of it.

    Raises:
        InputError: something changed since planning or flight, and no verdict has accepted it.
    """
    flown = judged_logs(run, logs) if logs or was_flown(run) else []
    inputs = inspect_inputs(run, flown)
    verdict = run.read_json(VERDICT, made_by="uavcover verify") if run.file(VERDICT).is_file() else None
    accepted = set() if verdict is None else accepted_in(verdict)
    refuse_changes(run, replace(inputs, changes=tuple(c for c in inputs.changes if c not in accepted)), ())
    notices = [f"accepted although it changed since planning or flight: {change}" for change in inputs.changes]
    notices += [unsealed_in_words(name) for name in inputs.unsealed]
    if flown and verdict is None:
        notices.append(
            "there is no verdict of uavcover verify in the run folder; this was judged for this report alone"
        )
    elif verdict is not None and not same_inputs(verdict, inputs):
        notices.append("verification.json judged other inputs than this report; uavcover verify makes it anew")
    return notices


def draw_figures(content: ReportContent, folder: Path, user: User, *, force: bool) -> list[Path]:
    """Draw the figures of a run into a folder.

    Raises:
        OutputError: a figure is there already and ``force`` was not said, or cannot be written.
    """
    from uavcover.report.figures import FIGURE_NAMES, save_figures

    there = [name for name in FIGURE_NAMES if (folder / name).exists()]
    if there and not force:
        raise OutputError(f"{folder}: {', '.join(there)} would be overwritten; use --force, or another folder")
    drawn = save_figures(content, folder)
    user.say(f"written: {', '.join(str(path) for path in drawn)}")
    return drawn
