"""Verifying a run folder, as ``verify``, ``gaps`` and ``demo`` do it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uavcover.cli.console import Console, metres, percent
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.verify import Verdict
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.report.requirements import requirement_rows
from uavcover.run import files, judge
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import (
    JudgedInputs,
    check_accepted,
    inspect_inputs,
    judged_logs,
    refuse_changes,
    unsealed_in_words,
)
from uavcover.scenario.site import Site, load_site

_SHOWN_VIOLATIONS = 5
_SHOWN_STRETCHES = 3
_HOLDS = {"yes": "holds", "no": "does NOT hold", "not proved": "not proved"}


def verify_run(
    run: RunFolder, console: Console, *, command: Sequence[str], logs: Sequence[Path] = (), accepted: Sequence[str] = ()
) -> dict[str, Any]:
    """Verify the tracks of a run folder, write its files and say the verdict; returns ``verification.json``.

    The verdict that is there, and what follows from it, is removed first: it would not be one of what is there now.
    """
    check_accepted(accepted)
    if not any(run.file(name).exists() for name in (*files.PLAN_FILES, "verification.json")):
        run.existing("scenario.toml", made_by="uavcover plan")  # no run folder: nothing is written or removed in it
    with run.reserved((), force=True):
        run.remove(files.VERDICT_FILES)
        site, verdict, sources, inputs = judge_run(run, console, logs=logs, accepted=accepted)
        document = judge.save_verdict(run, verdict, sources=sources, inputs=inputs, command=command)
    say_inputs(console, inputs)
    _say(console, run, site, verdict.report)
    return document


def judge_run(
    run: RunFolder, console: Console, *, logs: Sequence[Path], accepted: Sequence[str]
) -> tuple[Site, Verdict, list[str], JudgedInputs]:
    """The verdict on the logs of a run, by default its own track, the logs' names, and what was judged; nothing is written.

    Raises:
        InputError: something changed since planning or flight, and was not accepted.
    """
    path = run.existing("scenario.toml", made_by="uavcover plan")
    paths = judged_logs(run, logs)
    inputs = inspect_inputs(run, paths)
    refuse_changes(run, inputs, accepted)
    site = load_site(path)
    for number, sortie in enumerate(run.sorties(), start=1):
        if not logs and not sortie.file("track.csv").is_file():
            console.warn(f"sortie {number} was not flown yet: fly it with --sortie {number}")
    tracks: list[tuple[Track, PlannedRoute | None]] = []
    for path in paths:
        loaded = judge.read_log(path, site)
        for warning in loaded.warnings:
            console.warn(warning)
        tracks.append((loaded.track, judge.planned_for(path, run)))
    with console.progress("verifying"):
        verdict = judge.judge_tracks(site, tracks)
    return site, verdict, [_name(path, run) for path in paths], inputs


def say_inputs(console: Console, inputs: JudgedInputs) -> None:
    """Say which changes were accepted, and which tracks have no recorded end."""
    for change in inputs.changes:
        console.say(f"accepted change   {change.what}: {change}")
    for name in inputs.unsealed:
        console.say(f"no hash           {unsealed_in_words(name)}")


def _name(path: Path, run: RunFolder) -> str:
    """A log's path inside the run folder, or its name alone: no path of this machine."""
    inside = path.resolve().is_relative_to(run.path.resolve())
    return path.resolve().relative_to(run.path.resolve()).as_posix() if inside else path.name


def _say(console: Console, run: RunFolder, site: Site, report: VerificationReport) -> None:
    console.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of what can be seen"
    )
    if report.surely_covered_fraction != report.possibly_covered_fraction:
        console.say(
            f"                  surely {percent(report.surely_covered_fraction)}, "
            f"possibly {percent(report.possibly_covered_fraction)} of the area"
        )
    if report.planned_coverage_fraction is not None:
        console.say(f"coverage planned  {percent(report.planned_coverage_fraction)} of the area")
    _say_cells(console, report)
    console.say(
        f"height on route   {metres(report.min_height_agl_m)} to {metres(report.max_height_agl_m)} above ground; "
        f"in transit {metres(report.min_transit_clearance_m)} to {metres(report.max_transit_height_agl_m)}"
    )
    _say_unobserved(console, report)
    if report.max_deviation_m is not None:
        console.say(f"deviation         at most {metres(report.max_deviation_m)} from the planned route")
    missed = sum(gap.area_m2 for gap in report.gaps)
    console.say(f"gaps              {len(report.gaps)}, {missed:.0f} square metres in all")
    for violation in report.violations[:_SHOWN_VIOLATIONS]:
        place = (
            f"{violation.lat_deg:.6f}, {violation.lon_deg:.6f}"
            if site.frame is not None
            else f"{violation.east_m:.0f} m east, {violation.north_m:.0f} m north"
        )
        console.say(
            f"violation         {violation.kind} from {violation.start_s:.1f} s to {violation.end_s:.1f} s: "
            f"{violation.worst:.1f} against {violation.limit:.1f} {violation.unit} at {place}, {violation.worst_s:.1f} s"
        )
    if len(report.violations) > _SHOWN_VIOLATIONS:
        more = len(report.violations) - _SHOWN_VIOLATIONS
        console.say(f"                  and {more} more in {run.file('verification.json')}")
    if report.unknown_attitude_looks:
        console.say(
            f"attitude          not known for {report.unknown_attitude_looks} looks: what they saw is possibly seen, not seen"
        )
    for row in requirement_rows(site.scenario, report):
        console.say(f"required          {row.name}: {row.asked}; found {row.found}: {_HOLDS[row.holds]}")
    for finding in report.findings:
        console.say(f"noticed           {finding}")
    lines = report.reasons + report.doubts
    console.say(f"verdict           {report.verdict.upper() if lines else report.verdict}" + (":" if lines else ""))
    for reason in report.reasons:
        console.say(f"                  {reason}")
    for doubt in report.doubts:
        console.say(f"                  not proved: {doubt}")


def _say_unobserved(console: Console, report: VerificationReport) -> None:
    share = report.unobserved_route_fraction
    of_route = "" if share is None else f"; {percent(share)} of the route's time"
    console.say(
        f"not observed      {report.unobserved_s:.1f} s and {report.unobserved_m:.0f} m of the flight{of_route}"
    )
    flown = [stretch for stretch in report.unobserved if stretch.in_flight]
    for stretch in sorted(flown, key=lambda stretch: -stretch.duration_s)[:_SHOWN_STRETCHES]:
        console.say(f"                  from {stretch.start_s:.1f} s to {stretch.end_s:.1f} s: {stretch.detail}")
    if len(flown) > _SHOWN_STRETCHES:
        console.say(f"                  and {len(flown) - _SHOWN_STRETCHES} more stretches")


def _say_cells(console: Console, report: VerificationReport) -> None:
    cells = report.cells
    if cells.looks_mean is None or cells.incidence_median_deg is None:
        return
    line = f"looks             {cells.looks_mean:.1f} a cell, {percent(cells.seen_twice_fraction)} of the area twice or more"
    line += f"; incidence {cells.incidence_median_deg:.0f} degrees (median)"
    if cells.ground_sample_median_m is not None and cells.ground_sample_p95_m is not None:
        line += (
            f"; ground sample {100 * cells.ground_sample_median_m:.1f} cm (median), "
            f"95 % below {100 * cells.ground_sample_p95_m:.1f} cm"
        )
    console.say(line)
