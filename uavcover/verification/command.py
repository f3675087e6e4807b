"""Judge a flight: its logs against its plan, the verdict, and its files in the run folder."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import FlightLimits, window_text
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport, noted, unproved
from uavcover.run import provenance
from uavcover.run.documents import site_for, verification_document
from uavcover.run.folder import PLAN_FILES, VERDICT_FILES, RunFolder, json_text
from uavcover.run.judged_inputs import (
    JudgedInputs,
    check_accepted,
    inspect_inputs,
    judged_logs,
    refuse_changes,
    unsealed_text,
)
from uavcover.run.provenance import note_files
from uavcover.run.user import User, metres, percent
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import looks_singly
from uavcover.sensing.site_maps import fleet_map, judging_map
from uavcover.verification.decision import requirement_rows
from uavcover.verification.flown_coverage import (
    NOTHING_KNOWN,
    CountObservations,
    FlownCoverage,
    PhotoEvidence,
    count_observations,
    counter_of,
)
from uavcover.verification.flown_route import TRACK, PlannedRoute
from uavcover.verification.gaps import REASONS, cells_geotiff, reason_codes
from uavcover.verification.run_logs import UNKNOWN_DATES, DateBounds, date_bounds, flights_of_logs
from uavcover.verification.verify import FlownTrack, Verdict, verify_flight, verify_track

# Check the elevation data against the ground that vehicles measured in flight.


@dataclass(frozen=True, slots=True)
class ElevationBias:
    """Difference between the ground as a vehicle knows it and the elevation data."""

    source: str  # "rangefinder", or "terrain data of the vehicle" (another model)
    count: int  # readings over known ground
    bias_m: float  # median of measured less modelled height
    spread_m: float  # half the range of the middle 68 %

    @property
    def bound_m(self) -> float:
        """Largest plausible error of a height of the elevation data."""
        return abs(self.bias_m) + TRACK.spreads * self.spread_m

    def __str__(self) -> str:
        side = "above" if self.bias_m >= 0.0 else "below"
        return (
            f"according to the {self.source}, the ground is {abs(self.bias_m):.1f} m {side} the elevation data "
            f"(median of {self.count}, spread {self.spread_m:.1f} m)"
        )


def elevation_biases(site: Site, tracks: Sequence[Track]) -> tuple[ElevationBias, ...]:
    """Compare the ground that tracks report with that of a site; empty with too few reports.

    With a surface model, a rangefinder reading is compared with the nearer of ground and surface, because a beam can hit either
    of them through leaves.
    """
    found = []
    for source, readings in (
        ("rangefinder", [track.ranged for track in tracks]),
        ("terrain data of the vehicle", [track.stored for track in tracks]),
    ):
        differences = _differences_m(
            site, np.concatenate([np.empty((0, 3)), *readings]), with_surface=source == "rangefinder"
        )
        if len(differences) < TRACK.fewest_samples:
            continue
        low, middle, high = np.percentile(differences, (16.0, 50.0, 84.0))
        found.append(ElevationBias(source, len(differences), float(middle), float(0.5 * (high - low))))
    return tuple(found)


def widened(site: Site, biases: Sequence[ElevationBias]) -> tuple[Site, tuple[str, ...]]:
    """The site with the measured height uncertainty if it exceeds the stated one, and the notes on it.

    The vehicle's own terrain data is not a measurement and widens nothing.
    """
    words = [str(bias) for bias in biases]
    stated = site.scenario.uncertainty
    shown_m = max((bias.bound_m for bias in biases if bias.source == "rangefinder"), default=0.0)
    if shown_m <= stated.vertical_m:
        return site, tuple(words)
    words.append(
        f"the height uncertainty is {shown_m:.1f} m according to the rangefinder, instead of the stated "
        f"{stated.vertical_m:.1f} m"
    )
    uncertainty = replace(stated, terrain_m=shown_m - stated.height_m)
    return replace(site, scenario=replace(site.scenario, uncertainty=uncertainty)), tuple(words)


def with_measured_ground(
    report: VerificationReport, limits: FlightLimits, biases: Sequence[ElevationBias], found: Sequence[str]
) -> VerificationReport:
    """The report with these findings; a height that the measured ground moves beyond its limit is not proved."""
    findings = list(map(noted, found))
    for bias in biases:
        low, high = report.min_height_agl_m, report.max_height_agl_m
        if bias.source != "rangefinder" or low is None or high is None:
            continue
        for seems_m, limit_m, beyond in (
            (low, limits.min_height_agl_m, low - bias.bias_m < limits.min_height_agl_m <= low),
            (high, limits.max_height_agl_m, high - bias.bias_m > limits.max_height_agl_m >= high),
        ):
            if beyond:
                text = (
                    f"a height above ground of {seems_m:.1f} m was {seems_m - bias.bias_m:.1f} m if the rangefinder "
                    f"is right and the elevation data is wrong; the limit is {limit_m:g} m"
                )
                findings.append(unproved("height-band", text))
    return report.with_findings(findings)


def _differences_m(site: Site, readings: FloatArray, *, with_surface: bool) -> FloatArray:
    if site.frame is None or not len(readings):
        return np.empty(0)
    positions = site.frame.enu_from_geodetic(*readings.T)
    above = site.bare_ground.heights_agl_m(positions)
    if with_surface and site.ground_model is not None:
        over = site.ground.heights_agl_m(positions)
        above = np.where(np.abs(over) < np.abs(above), over, above)
    return np.asarray(above[np.isfinite(above)])


LAYER_REASONS = ", ".join(f"{code} {reason}" for code, reason in enumerate(("seen", *REASONS)))
"""Meaning of the numbers in the raster's layer of reasons."""


def judge_tracks(
    site: Site,
    tracks: Sequence[tuple[Track, PlannedRoute | None]],
    *,
    evidence: PhotoEvidence = NOTHING_KNOWN,
    count: CountObservations = count_observations,
    sites: Sequence[Site] | None = None,
    dates: Sequence[DateBounds] | None = None,
) -> Verdict:
    """Judge one or several tracks as one flight, each with its plan, on the cells of the area.

    ``sites`` are those of different vehicles; ``dates`` bound those of the tracks. Ground measured in flight widens the
    uncertainty of heights if it exceeds the scenario's.
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
    run: RunFolder,  # of the verdict
    verdict: Verdict,  # the result
    *,
    sources: Sequence[str],  # names of the logs
    inputs: JudgedInputs,  # the judged inputs; their changes were accepted
    command: Sequence[str],  # the command line, for ``verification.json``
    also: Mapping[str, Any],  # additional content of ``verification.json``
) -> dict[str, Any]:
    """Write ``verification.json`` and, for a site on Earth, ``coverage.tif``, together.

    Returns:
        the content of ``verification.json``.
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
    sureness = flown.observed.astype(float) + flown.possible_cells + flown.certain_cells
    layers: list[tuple[str, str, NDArray[Any]]] = [
        ("looks", "number of separate passes that observed the cell", flown.passes),
        ("first_seen_s", "vehicle time in seconds", flown.first_observed_s),
        ("ground_sample_m", "smallest ground sample distance in metres", flown.ground_sample_m),
        ("incidence_deg", "smallest incidence angle in degrees", flown.incidence_deg),
        ("distance_m", "minimum distance in metres", flown.nearest_m),
        (
            "sureness",
            "0: not observed, 1: possibly observed, 2: observed if measurements are exact, 3: certainly observed",
            sureness,
        ),
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
class JudgedPhotos:
    """Result of judging a flight's photos."""

    evidence: PhotoEvidence = NOTHING_KNOWN  # what that means for the flight
    document: Mapping[str, Any] | None = None  # the verdict on them alone; None where there are no photos


_NO_PHOTOS = JudgedPhotos()


def verify_run(
    run: RunFolder,
    user: User,
    *,
    command: Sequence[str],
    logs: Sequence[Path] = (),
    accepted: Sequence[str] = (),
    photos: JudgedPhotos = _NO_PHOTOS,
    scheduler: str | None = None,
    system: int | None = None,
) -> tuple[Verdict, dict[str, Any]]:
    """Verify the tracks of a run folder, write its files and print the verdict; return it, and ``verification.json``.

    An existing verdict and its consequences are removed first, because they would not match the current files. ``photos`` with
    a coverage replace that of the track. The workers of a ``scheduler`` count the observations. ``system`` chooses the vehicle of
    telemetry logs with several.
    """
    check_accepted(accepted)
    if not any(run.file(name).exists() for name in (*PLAN_FILES, "verification.json")):
        run.existing("scenario.toml", made_by="uavcover plan")  # no run folder: nothing is written or removed in it
    with run.reserved((), force=True), counter_of(scheduler) as count:
        run.remove(VERDICT_FILES)
        site, verdict, sources, inputs = judge_run(
            run, user, logs=logs, accepted=accepted, evidence=photos.evidence, count=count, system=system
        )
        also: dict[str, Any] = {}
        if photos.document is not None:
            inputs = replace(inputs, hashes={**inputs.hashes, "photos": photos.document["inputs"]["pictures"]})
            also = {"photos": photos.document}
        document = save_verdict(run, verdict, sources=sources, inputs=inputs, command=command, also=also)
    print_inputs(user, inputs)
    _print(user, run, site, verdict.report)
    return verdict, document


def judge_run(
    run: RunFolder,
    user: User,
    *,
    logs: Sequence[Path],
    accepted: Sequence[str],
    evidence: PhotoEvidence = NOTHING_KNOWN,
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
            f"--require-photos: the sensor of {run} does not take single photos (sensing "
            f"{site.scenario.sensor.sensing}); omit this option"
        )
    if any(provenance.photos_required(RunFolder(folder)) for folder in {run.path, *(path.parent for path in paths)}):
        evidence = replace(evidence, photos_required=True)
    for number, sortie in enumerate(run.sorties(), start=1):
        if not logs and not sortie.file("track.csv").is_file():
            user.warn(f"sortie {number} was not flown yet; fly it with --sortie {number}")
    flown = flights_of_logs(paths, run, site, system=system)
    for warning in flown.warnings:
        user.warn(warning)
    with user.progress("verifying"):
        dates = [date_bounds(path, run) for path in flown.paths]
        sites = [site_for(path, run, site) for path in flown.paths]
        verdict = judge_tracks(site, flown.tracks, evidence=evidence, count=count, sites=sites, dates=dates)
        verdict = replace(verdict, report=verdict.report.with_findings(map(noted, flown.notes)))
    return site, verdict, [log_name(path, run) for path in paths], inputs


def print_inputs(user: User, inputs: JudgedInputs) -> None:
    """Print the accepted changes, and the tracks without a recorded end."""
    for change in inputs.changes:
        user.say(f"accepted change   {change.what}: {change}")
    for name in inputs.unsealed:
        user.say(f"no hash           {unsealed_text(name)}")


def log_name(path: Path, run: RunFolder) -> str:
    """A log's path inside the run folder, otherwise only its name, without a path of this machine."""
    inside = path.resolve().is_relative_to(run.path.resolve())
    return path.resolve().relative_to(run.path.resolve()).as_posix() if inside else path.name


def _print(user: User, run: RunFolder, site: Site, report: VerificationReport) -> None:
    user.say(
        f"coverage flown    {percent(report.coverage_fraction)} of the area, "
        f"{percent(report.coverage_of_coverable)} of the visible ground"
    )
    if report.surely_covered_fraction != report.possibly_covered_fraction:
        user.say(
            f"                  of the area: {percent(report.surely_covered_fraction)} certainly, "
            f"{percent(report.possibly_covered_fraction)} possibly"
        )
    if report.planned_coverage_fraction is not None:
        user.say(f"coverage planned  {percent(report.planned_coverage_fraction)} of the area")
    _print_cells(user, report)
    _print_photos(user, report)
    user.say(
        f"height on route   {metres(report.min_height_agl_m)} to {metres(report.max_height_agl_m)} above ground; "
        f"in transit {metres(report.min_transit_clearance_m)} to {metres(report.max_transit_height_agl_m)}"
    )
    if report.flown_utc is not None:
        begin, end = (datetime.fromisoformat(moment) for moment in report.flown_utc)
        user.say(f"flown             {window_text((begin, end))}")
    _print_unobserved(user, report)
    if report.max_deviation_m is not None:
        user.say(f"deviation         at most {metres(report.max_deviation_m)} from the planned route")
    if report.separation:
        nearest = min(report.separation, key=lambda pair: pair.least_m)
        user.say(
            f"separation        at least {metres(nearest.least_m)}; required "
            f"{metres(site.scenario.fleet.separation_m)} ({counted(len(report.separation), 'pair')} of flights at the same time)"
        )
    missed = sum(gap.area_m2 for gap in report.gaps)
    user.say(f"gaps              {len(report.gaps)}, {missed:.0f} square metres in total")
    for violation in report.violations[:_SHOWN_VIOLATIONS]:
        position = (
            f"{violation.lat_deg:.6f}, {violation.lon_deg:.6f}"
            if site.frame is not None
            else f"{violation.east_m:.0f} m east, {violation.north_m:.0f} m north"
        )
        name = f" {violation.name!r}" if violation.name else ""
        user.say(
            f"violation         {violation.kind}{name} from {violation.start_s:.1f} s to {violation.end_s:.1f} s: "
            f"worst {violation.worst:.1f} {violation.unit} at {position}, {violation.worst_s:.1f} s; limit "
            f"{violation.limit:.1f} {violation.unit}"
        )
    if len(report.violations) > _SHOWN_VIOLATIONS:
        more = len(report.violations) - _SHOWN_VIOLATIONS
        user.say(f"                  and {more} more in {run.file('verification.json')}")
    if report.unknown_attitude_looks:
        unsure = counted(report.unknown_attitude_looks, "observation, which is", "observations, which are")
        user.say(f"attitude          unknown for {unsure} only possible")
    for row in requirement_rows(site.scenario, report):
        user.say(f"required          {row.name}: {row.required}; found {row.found}: {_HOLDS[row.holds]}")
    for finding in report.findings:
        user.say(f"finding           {finding}")
    lines = report.reasons + report.doubts
    user.say(f"verdict           {report.verdict.upper() if lines else report.verdict}" + (":" if lines else ""))
    for reason in report.reasons:
        user.say(f"                  {reason}")
    for doubt in report.doubts:
        user.say(f"                  not proved: {doubt}")


def _print_unobserved(user: User, report: VerificationReport) -> None:
    fraction = report.unobserved_route_fraction
    of_route = "" if fraction is None else f"; {percent(fraction)} of the route time"
    user.say(f"no evidence       {report.unobserved_s:.1f} s and {report.unobserved_m:.0f} m of the flight{of_route}")
    flown = [stretch for stretch in report.unobserved if stretch.in_flight]
    for stretch in sorted(flown, key=lambda stretch: -stretch.duration_s)[:_SHOWN_STRETCHES]:
        user.say(f"                  from {stretch.start_s:.1f} s to {stretch.end_s:.1f} s: {stretch.detail}")
    if len(flown) > _SHOWN_STRETCHES:
        user.say(f"                  and {counted(len(flown) - _SHOWN_STRETCHES, 'more interval')}")


def _print_photos(user: User, report: VerificationReport) -> None:
    photos = report.pictures
    if photos is None:
        return
    user.say(
        f"photos            {photos.taken}, {counted(photos.looks, 'observation')}; photos per point: at least "
        f"{photos.fewest}, {photos.median:g} (median)"
    )
    if photos.asked is not None and photos.overlap_fraction is not None:
        holds = "met" if photos.overlap_holds else "NOT MET"
        user.say(
            f"required overlap {holds}: {percent(photos.overlap_fraction)} of the area is in at least "
            f"{photos.asked} photos"
        )


def _print_cells(user: User, report: VerificationReport) -> None:
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
