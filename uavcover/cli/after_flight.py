"""After a flight: ``uavcover verify`` and ``gaps`` judge its coverage and safety, ``report`` and ``inspect`` show it."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from uavcover.cli import options
from uavcover.cli.new import PhotoOptions, SearchOptions, SurveyOptions
from uavcover.cli.options import option

# ``uavcover gaps``: the unobserved cells, and a mission that flies only them.


def gaps(
    run: Annotated[Path, typer.Argument(help="Run folder with a flight.")],
    *,
    logs: options.Logs = None,
    system: options.LogSystem = None,
    accept_changed: options.AcceptChanged = None,
    target: Annotated[
        float | None, option("Required coverage of the visible ground, such as 0.98; default: 1.", "SHARE")
    ] = None,
    min_area_m2: Annotated[float, option("--min-area", "Ignore gaps smaller than this, in square metres.", "M2")] = 0.0,
    start: Annotated[
        str, option("Start of the mission: home, or the last position in the log (last).", "home|last")
    ] = "home",
    force: Annotated[bool, option("--force", "Replace an existing gap mission and its flight.")] = False,
    output: options.Output,
) -> int:
    """List the gaps in coverage with their reasons, and plan a mission that closes them.

    The command writes gaps.geojson, gap_mission.waypoints, and the run folder RUN/gaps, which you can upload, fly and
    verify. The exit code is 1 if the mission cannot reach the required coverage.
    """
    from uavcover.errors import InputError
    from uavcover.planner.close_gaps import GapRequest, GapStart, close_gaps, commands_after_gaps
    from uavcover.run.folder import RunFolder

    if start not in list(GapStart):
        raise InputError(f"--start: must be home or last, not {start!r}")
    console = output.console()
    request = GapRequest(
        logs=logs or (), target=target, min_area_m2=min_area_m2, start=GapStart(start), force=force,
        accepted=accept_changed or (), system=system,
    )  # fmt: skip
    mission, document = close_gaps(RunFolder(run), console, request, command=sys.argv)
    if mission is not None:
        console.suggest(*commands_after_gaps(RunFolder(run), request))
    console.result(document)
    return 0 if document["target_met"] else 1


def verify(
    run: Annotated[Path | None, typer.Argument(help="Run folder. With --area: a flight log or photos.")] = None,
    *,
    logs: options.Logs = None,
    system: options.LogSystem = None,
    photos: Annotated[
        list[Path] | None,
        option(
            "--photos",
            "Photos of the flight (same sources as judge-photos). Coverage is then computed from the photos. Can be repeated.",
            "FOLDER",
        ),
    ] = None,
    area: Annotated[
        str | None, option("Area to observe, for a flight without a run folder (same formats as uavcover new).")
    ] = None,
    out: Annotated[
        Path | None,
        option("-o", "--out", "Folder for the verdict of a flight without a run folder; default: verdict.", "FOLDER"),
    ] = None,
    survey: SurveyOptions,
    belief: PhotoOptions,
    search: SearchOptions,
    accept_changed: options.AcceptChanged = None,
    require_photos: options.RequirePhotos = False,
    scheduler: options.Scheduler = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Compute coverage and safety from the flown track. The exit code is 1 unless the flight passes.

    Several logs count as one flight. A cell is observed if any log observes it, and each log must meet the limits. If
    the scenario, terrain, obstacles, plan, mission files, track or version changed since planning or flight, the
    command refuses to judge unless you accept the change.

    To verify a flight without a run folder, use verify FLIGHT.bin --area A --dem DEM --camera C, or --photos FOLDER.
    """
    from uavcover.errors import InputError
    from uavcover.plugins import loaded
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import to_paste
    from uavcover.verification.command import JudgedPhotos, verify_run
    from uavcover.verification.flown_coverage import NO_PHOTOS, GivenEvidence, PhotoEvidence

    console = output.console()
    if area is None:
        if run is None:
            raise InputError("verify: specify a run folder; or a log or photos with --area, --dem and --camera")
        if given := survey.given():
            raise InputError(f"verify: {given[0]} requires --area; omit it, because {run} defines it")
        if out is not None:
            raise InputError("verify: -o requires --area; for a run, omit -o, which keeps its verdict itself")
    of_photos = loaded("uavcover.evidence").get("photos")
    if of_photos is None and (area is not None or photos):
        raise InputError("verify: --area and --photos require the photos extra; reinstall uavcover")
    tracks = [*([run] if area and run else []), *(logs or [])]
    evidence = GivenEvidence(tuple(tracks), (), system)
    request: Any = None
    if of_photos is not None:
        evidence = of_photos.evidence_of(tracks, photos or [], system=system)
        request = of_photos.PhotoRequest(
            photos=evidence.photos, area=None if area is None else survey.request(area, autopilot=None), scenario=None,
            assumed=of_photos.Assumptions(**belief.assumed()), takeoff=belief.position(), coverage=None,
            mount_known=area is None or survey.mount is not None, refly=False, budget_s=None, force=force,
            detection=search.curve(), pod=search.pod, max_blur_px=belief.max_blur,
        )  # fmt: skip
    folder = RunFolder(run) if area is None and run is not None else RunFolder(out or Path("verdict"))
    if of_photos is not None and request.area is not None:
        if not evidence.logs and not evidence.photos:
            raise InputError(
                "verify: --area needs a flight: a log (.bin, .tlog, .ulg, .csv, .gpx), or photos (--photos)"
            )
        if not evidence.logs:
            _, report = of_photos.judge_photos(request, folder, console, command=sys.argv)
            console.result(report)
            return 0 if report["passed"] else 1
        evidence = of_photos.run_of_flight(request.area, evidence, console, out=folder, command=sys.argv, force=force)
    if not evidence.photos:
        for option, requested in (("--detection", search.detection), ("--max-blur", belief.max_blur)):
            if requested is not None:
                raise InputError(f"{option}: this option applies only to photos: add --photos")
    if evidence.photos and scheduler is not None:
        raise InputError("--scheduler: this option distributes the coverage of a track; omit it with --photos")
    photo_verdict = JudgedPhotos(PhotoEvidence(photos_required=require_photos) if area is None else NO_PHOTOS)
    if of_photos is not None and evidence.photos:
        report = of_photos.verify_evidence(
            folder, evidence, request, console, command=sys.argv, accepted=accept_changed or ()
        )
    else:
        _, report = verify_run(
            folder, console, command=sys.argv, logs=evidence.logs, accepted=accept_changed or () if area is None else (),
            photos=photo_verdict, scheduler=scheduler, system=system,
        )  # fmt: skip
        if area is None:
            console.suggest(to_paste("report", run), *([to_paste("gaps", run)] if report["gaps"] else []))
    console.result(report)
    return 0 if report["passed"] else 1


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
