"""Judging a flight: its logs against its plan, the verdict, and its files in the run folder."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from uavcover.errors import InputError
from uavcover.model.active_times import window_in_words
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.run import provenance
from uavcover.run.documents import verification_document
from uavcover.run.flown_by import site_for
from uavcover.run.folder import PLAN_FILES, VERDICT_FILES, RunFolder, json_text
from uavcover.run.judged_inputs import (
    JudgedInputs,
    check_accepted,
    inspect_inputs,
    judged_logs,
    refuse_changes,
    unsealed_in_words,
)
from uavcover.run.provenance import note_files
from uavcover.run.user import User, metres, percent
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import looks_singly
from uavcover.sensing.site_maps import fleet_map, judging_map
from uavcover.verification.elevation_bias import elevation_biases, widened, with_measured_ground
from uavcover.verification.flown_coverage import CountObservations, FlownCoverage, count_observations, counter_of
from uavcover.verification.gaps import REASONS, reason_codes
from uavcover.verification.geotiff import cells_geotiff
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.photo_evidence import NOTHING_KNOWN, PictureEvidence
from uavcover.verification.requirements import requirement_rows
from uavcover.verification.run_logs import date_bounds, planned_for, read_log
from uavcover.verification.shared_clock import UNKNOWN_DATES, DateBounds
from uavcover.verification.verify import FlownTrack, Verdict, verify_flight, verify_track

LAYER_REASONS = ", ".join(f"{code} {reason}" for code, reason in enumerate(("seen", *REASONS)))
"""Meaning of the numbers in the raster's layer of reasons."""


def judge_tracks(
    site: Site,
    tracks: Sequence[tuple[Track, PlannedRoute | None]],
    *,
    evidence: PictureEvidence = NOTHING_KNOWN,
    count: CountObservations = count_observations,
    sites: Sequence[Site] | None = None,
    dates: Sequence[DateBounds] | None = None,
) -> Verdict:
    """Judge one or several tracks as one flight, each with the plan it followed, on the cells of the area.

    ``sites`` are those of the vehicles that flew them, where these differ; ``dates`` bound those of the tracks. Ground that they
    measured in flight widens the uncertainty of heights where it shows more than the scenario states.
    """
    biases = elevation_biases(site, [track for track, _ in tracks])
    site, found = widened(site, biases)
    sites = None if sites is None else [widened(own, biases)[0] for own in sites]
    unknown = [UNKNOWN_DATES] * len(tracks)
    flown = [
        FlownTrack(track, planned, own, between)
        for (track, planned), own, between in zip(tracks, sites or [site] * len(tracks), dates or unknown, strict=True)
    ]
    verdict = verify_flight(site, fleet_map(site), flown, evidence=evidence, count=count)
    return replace(verdict, report=with_measured_ground(verdict.report, site.scenario.limits, biases, found))


def save_verdict(
    run: RunFolder,
    verdict: Verdict,
    *,
    sources: Sequence[str],
    inputs: JudgedInputs,
    command: Sequence[str],
    also: Mapping[str, Any],
) -> dict[str, Any]:
    """Write ``verification.json`` and, for a site on Earth, ``coverage.tif``, together.

    Args:
        run: whose verdict it is.
        verdict: what was found.
        sources: names of the logs.
        inputs: what was judged; its changes were accepted.
        command: the command line, for ``verification.json``.
        also: what else ``verification.json`` has to say.

    Returns:
        what ``verification.json`` says.
    """
    document = verification_document(verdict.report, source=", ".join(sources)) | {
        "inputs": inputs.hashes,
        "accepted_changes": [asdict(change) for change in inputs.changes],
        "unsealed_tracks": list(inputs.unsealed),
        **also,
    }
    files: dict[str, str | bytes] = {"verification.json": json_text(document)}
    raster = coverage_raster(verdict.coverage, verdict.flown)
    if raster is not None:
        files["coverage.tif"] = raster
    run.write_together(files)
    note_files(run, "verify", list(files), command=command, read=inputs.hashes)
    return document


def coverage_raster(coverage: CoverageMap, flown: FlownCoverage) -> bytes | None:
    """Write the observations of each cell as a GeoTIFF; None for a site without a position on Earth."""
    site = coverage.site
    if site.frame is None:
        return None
    sureness = flown.seen.astype(float) + flown.possibly_seen + flown.surely_seen
    layers: list[tuple[str, str, NDArray[Any]]] = [
        ("looks", "separate passes that observed the cell", flown.passes),
        ("first_seen_s", "vehicle time in seconds", flown.first_seen_s),
        ("ground_sample_m", "smallest ground sample distance in metres", flown.ground_sample_m),
        ("incidence_deg", "smallest incidence angle in degrees", flown.incidence_deg),
        ("distance_m", "shortest distance in metres", flown.nearest_m),
        ("sureness", "0 not observed, 1 possibly, 2 observed if measurements are exact, 3 surely", sureness),
        ("reason", LAYER_REASONS, reason_codes(coverage, flown)),
    ]
    return cells_geotiff(coverage, site.frame, layers)


def verify(site: Site, track: Track, planned: PlannedRoute | None = None) -> VerificationReport:
    """Coverage and safety of what was flown, on the cells of the area; see :mod:`uavcover.verification`."""
    return verify_track(site, judging_map(site), track, planned)


_SHOWN_VIOLATIONS = 5
_SHOWN_STRETCHES = 3
_HOLDS = {"yes": "met", "no": "NOT met", "not proved": "not proved"}


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPictures:
    """Result of judging a flight's photos.

    Attributes:
        evidence: what that means for the flight.
        document: the verdict on them alone; none where there are no photos.
    """

    evidence: PictureEvidence = NOTHING_KNOWN
    document: Mapping[str, Any] | None = None


_NO_PICTURES = JudgedPictures()


def verify_run(
    run: RunFolder,
    user: User,
    *,
    command: Sequence[str],
    logs: Sequence[Path] = (),
    accepted: Sequence[str] = (),
    pictures: JudgedPictures = _NO_PICTURES,
    scheduler: str | None = None,
    system: int | None = None,
) -> tuple[Verdict, dict[str, Any]]:
    """Verify the tracks of a run folder, write its files and say the verdict; returns it, and ``verification.json``.

    The verdict that is there, and what follows from it, is removed first: it would not be one of what is there now. Where
    there are ``pictures`` that tell the coverage, it is theirs. With a ``scheduler`` its workers count what was seen. ``system``
    chooses the vehicle of telemetry logs that have several.
    """
    check_accepted(accepted)
    if not any(run.file(name).exists() for name in (*PLAN_FILES, "verification.json")):
        run.existing("scenario.toml", made_by="uavcover plan")  # no run folder: nothing is written or removed in it
    with run.reserved((), force=True), counter_of(scheduler) as count:
        run.remove(VERDICT_FILES)
        site, verdict, sources, inputs = judge_run(
            run, user, logs=logs, accepted=accepted, evidence=pictures.evidence, count=count, system=system
        )
        also: dict[str, Any] = {}
        if pictures.document is not None:
            inputs = replace(inputs, hashes={**inputs.hashes, "photos": pictures.document["inputs"]["pictures"]})
            also = {"photos": pictures.document}
        document = save_verdict(run, verdict, sources=sources, inputs=inputs, command=command, also=also)
    say_inputs(user, inputs)
    _say(user, run, site, verdict.report)
    return verdict, document


def judge_run(
    run: RunFolder,
    user: User,
    *,
    logs: Sequence[Path],
    accepted: Sequence[str],
    evidence: PictureEvidence = NOTHING_KNOWN,
    count: CountObservations = count_observations,
    system: int | None = None,
) -> tuple[Site, Verdict, list[str], JudgedInputs]:
    """Return the verdict on the logs of a run (default: its own track), their names and the judged inputs; write nothing.

    Raises:
        InputError: something changed since planning or flight, and was not accepted.
    """
    path = run.existing("scenario.toml", made_by="uavcover plan")
    paths = judged_logs(run, logs)
    inputs = inspect_inputs(run, paths)
    refuse_changes(run, inputs, accepted)
    site = inputs.site or load_site(path)
    sites = [site_for(path, run, site) for path in paths]
    if evidence.photos_required and not any(looks_singly(each.scenario) for each in sites):
        raise InputError(
            f"--require-photos: the sensor of {run} does not take single photos (sensing {site.scenario.sensor.sensing}); omit it"
        )
    if any(provenance.photos_required(RunFolder(folder)) for folder in {run.path, *(path.parent for path in paths)}):
        evidence = replace(evidence, photos_required=True)
    for number, sortie in enumerate(run.sorties(), start=1):
        if not logs and not sortie.file("track.csv").is_file():
            user.warn(f"sortie {number} was not flown yet: fly it with --sortie {number}")
    tracks: list[tuple[Track, PlannedRoute | None]] = []
    for path in paths:
        loaded = read_log(path, site, system=system)
        for warning in loaded.warnings:
            user.warn(warning)
        tracks.append((loaded.track, planned_for(path, run, loaded.track)))
    with user.progress("verifying"):
        dates = [date_bounds(path, run) for path in paths]
        verdict = judge_tracks(site, tracks, evidence=evidence, count=count, sites=sites, dates=dates)
    return site, verdict, [_name(path, run) for path in paths], inputs


def say_inputs(user: User, inputs: JudgedInputs) -> None:
    """Say which changes were accepted, and which tracks have no recorded end."""
    for change in inputs.changes:
        user.say(f"accepted change   {change.what}: {change}")
    for name in inputs.unsealed:
        user.say(f"no hash           {unsealed_in_words(name)}")


def _name(path: Path, run: RunFolder) -> str:
    """A log's path inside the run folder, or its name alone: no path of this machine."""
    inside = path.resolve().is_relative_to(run.path.resolve())
    return path.resolve().relative_to(run.path.resolve()).as_posix() if inside else path.name


def _say(user: User, run: RunFolder, site: Site, report: VerificationReport) -> None:
    user.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of the visible ground"
    )
    if report.surely_covered_fraction != report.possibly_covered_fraction:
        user.say(
            f"                  surely {percent(report.surely_covered_fraction)}, "
            f"possibly {percent(report.possibly_covered_fraction)} of the area"
        )
    if report.planned_coverage_fraction is not None:
        user.say(f"coverage planned  {percent(report.planned_coverage_fraction)} of the area")
    _say_cells(user, report)
    _say_pictures(user, report)
    user.say(
        f"height on route   {metres(report.min_height_agl_m)} to {metres(report.max_height_agl_m)} above ground; "
        f"in transit {metres(report.min_transit_clearance_m)} to {metres(report.max_transit_height_agl_m)}"
    )
    if report.flown_utc is not None:
        begin, end = (datetime.fromisoformat(moment) for moment in report.flown_utc)
        user.say(f"flown             {window_in_words((begin, end))}")
    _say_unobserved(user, report)
    if report.max_deviation_m is not None:
        user.say(f"deviation         at most {metres(report.max_deviation_m)} from the planned route")
    if report.separation:
        nearest = min(report.separation, key=lambda pair: pair.least_m)
        user.say(
            f"separation        at least {metres(nearest.least_m)} of {metres(site.scenario.fleet.separation_m)}, of "
            f"{len(report.separation)} pairs of flights at the same time"
        )
    missed = sum(gap.area_m2 for gap in report.gaps)
    user.say(f"gaps              {len(report.gaps)}, {missed:.0f} square metres in total")
    for violation in report.violations[:_SHOWN_VIOLATIONS]:
        place = (
            f"{violation.lat_deg:.6f}, {violation.lon_deg:.6f}"
            if site.frame is not None
            else f"{violation.east_m:.0f} m east, {violation.north_m:.0f} m north"
        )
        name = f" {violation.name!r}" if violation.name else ""
        user.say(
            f"violation         {violation.kind}{name} from {violation.start_s:.1f} s to {violation.end_s:.1f} s: "
            f"{violation.worst:.1f} instead of {violation.limit:.1f} {violation.unit} at {place}, {violation.worst_s:.1f} s"
        )
    if len(report.violations) > _SHOWN_VIOLATIONS:
        more = len(report.violations) - _SHOWN_VIOLATIONS
        user.say(f"                  and {more} more in {run.file('verification.json')}")
    if report.unknown_attitude_looks:
        user.say(
            f"attitude          unknown for {report.unknown_attitude_looks} observations, which are only possibly observed"
        )
    for row in requirement_rows(site.scenario, report):
        user.say(f"required          {row.name}: {row.asked}; found {row.found}: {_HOLDS[row.holds]}")
    for finding in report.findings:
        user.say(f"finding           {finding}")
    lines = report.reasons + report.doubts
    user.say(f"verdict           {report.verdict.upper() if lines else report.verdict}" + (":" if lines else ""))
    for reason in report.reasons:
        user.say(f"                  {reason}")
    for doubt in report.doubts:
        user.say(f"                  not proved: {doubt}")


def _say_unobserved(user: User, report: VerificationReport) -> None:
    share = report.unobserved_route_fraction
    of_route = "" if share is None else f"; {percent(share)} of the route time"
    user.say(f"no evidence       {report.unobserved_s:.1f} s and {report.unobserved_m:.0f} m of the flight{of_route}")
    flown = [stretch for stretch in report.unobserved if stretch.in_flight]
    for stretch in sorted(flown, key=lambda stretch: -stretch.duration_s)[:_SHOWN_STRETCHES]:
        user.say(f"                  from {stretch.start_s:.1f} s to {stretch.end_s:.1f} s: {stretch.detail}")
    if len(flown) > _SHOWN_STRETCHES:
        user.say(f"                  and {len(flown) - _SHOWN_STRETCHES} more intervals")


def _say_pictures(user: User, report: VerificationReport) -> None:
    pictures = report.pictures
    if pictures is None:
        return
    user.say(
        f"photos            {pictures.taken}, {pictures.looks} observations; photos per point: at least {pictures.fewest}, "
        f"{pictures.median:g} (median)"
    )
    if pictures.asked is not None and pictures.overlap_fraction is not None:
        holds = "met" if pictures.overlap_holds else "NOT MET"
        user.say(
            f"required overlap {holds}: {percent(pictures.overlap_fraction)} of the area is in at least "
            f"{pictures.asked} photos"
        )


def _say_cells(user: User, report: VerificationReport) -> None:
    cells = report.cells
    if cells.looks_mean is None or cells.incidence_median_deg is None:
        return
    line = f"observations      {cells.looks_mean:.1f} per cell, {percent(cells.seen_twice_fraction)} of the area at least twice"
    line += f"; incidence {cells.incidence_median_deg:.0f} degrees (median)"
    if cells.ground_sample_median_m is not None and cells.ground_sample_p95_m is not None:
        line += (
            f"; ground sample distance {100 * cells.ground_sample_median_m:.1f} cm (median), "
            f"95 % below {100 * cells.ground_sample_p95_m:.1f} cm"
        )
    user.say(line)
