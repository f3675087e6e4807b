"""Verifying a run folder, as ``verify`` and ``demo`` do it."""

from pathlib import Path
from typing import Any

from uavcover import pipeline
from uavcover.cli.console import Console, metres, percent
from uavcover.documents import read_plan_document, verification_document
from uavcover.errors import InputError
from uavcover.flight.track_file import read_track_with_warnings
from uavcover.model.report import VerificationReport
from uavcover.model.track import Track
from uavcover.run_folder import RunFolder
from uavcover.verification.phases import PlannedRoute


def read_log(path: Path, console: Console) -> Track:
    """A flown track from a file, by its ending.

    Raises:
        InputError: an ending that is not known, or a file that is not there.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; a track is recorded by: uavcover fly")
    if path.suffix == ".rrd":
        from uavcover.recording.reader import read_recorded_track

        return read_recorded_track(path)
    if path.suffix != ".csv":
        raise InputError(f"{path}: {path.suffix or 'no ending'} is not a track that can be read; use .csv or .rrd")
    loaded = read_track_with_warnings(path)
    for warning in loaded.warnings:
        console.warn(warning)
    return loaded.track


def verify_run(run: RunFolder, console: Console, *, log: Path | None = None) -> dict[str, Any]:
    """Verify the track of a run folder, write ``verification.json`` and say the verdict; returns the document."""
    site = pipeline.load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    planned = None
    if run.file("plan.json").exists():
        document = read_plan_document(
            run.read_json("plan.json", made_by="uavcover plan"), source=str(run.file("plan.json"))
        )
        planned = PlannedRoute(document.route.waypoints_m, document.coverage_fraction)
    path = log if log is not None else run.existing("track.csv", made_by="uavcover fly")
    track = read_log(path, console)
    with console.progress("verifying"):
        report = pipeline.verify(site, track, planned)
    pipeline.save_verification(run, report, source=path.name)
    _say(console, run, report)
    return verification_document(report, source=path.name)


def _say(console: Console, run: RunFolder, report: VerificationReport) -> None:
    console.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of what can be seen"
    )
    if report.planned_coverage_fraction is not None:
        console.say(f"coverage planned  {percent(report.planned_coverage_fraction)} of the area")
    console.say(
        f"height on route   {metres(report.min_height_agl_m)} to {metres(report.max_height_agl_m)} above ground; "
        f"clearance in transit {metres(report.min_transit_clearance_m)}"
    )
    if report.max_deviation_m is not None:
        console.say(f"deviation         at most {metres(report.max_deviation_m)} from the planned route")
    missed = sum(gap.area_m2 for gap in report.gaps)
    console.say(f"gaps              {len(report.gaps)}, {missed:.0f} square metres in all")
    for violation in report.violations[:5]:
        console.say(
            f"violation         {violation.kind} from {violation.start_s:.1f} s to {violation.end_s:.1f} s: "
            f"{violation.worst:.1f} against {violation.limit:.1f} at {violation.lat_deg:.6f}, {violation.lon_deg:.6f}"
        )
    if len(report.violations) > 5:
        console.say(f"                  and {len(report.violations) - 5} more in {run.file('verification.json')}")
    console.say("verdict           " + ("passed" if report.passed else "NOT passed: " + "; ".join(report.reasons)))
