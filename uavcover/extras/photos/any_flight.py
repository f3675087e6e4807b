"""Verify any flight by its log, its photos, or both, with or without a run folder."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from mission_io.errors import FormatError
from mission_io.formats.csv_tables import header_of
from mission_io.formats.text import text_from_bytes
from uavcover.errors import InputError
from uavcover.extras.photos.judge_photos import judge_photos
from uavcover.extras.photos.lists import LOGS, reports_photos
from uavcover.extras.photos.photo import survey_as_flown
from uavcover.extras.photos.photo_judgement import PhotoRequest
from uavcover.extras.photos.photo_verdict import PhotoVerdict
from uavcover.extras.photos.placing import Assumptions
from uavcover.extras.photos.readers import ENDINGS, LISTS, read_photos
from uavcover.kernels.arrays import FloatArray
from uavcover.model.verdict import Requirement, noted
from uavcover.new.elevation_questions import NewRequest
from uavcover.new.quantities import length_m
from uavcover.run.folder import SCHEMA_VERSION, VERDICT_FILES, RunFolder
from uavcover.run.judged_inputs import inspect_inputs, was_flown
from uavcover.run.provenance import with_entry
from uavcover.run.user import User, percent, to_paste
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site
from uavcover.sensing.photos import PhotoCounts
from uavcover.sensing.sensors import frame_camera
from uavcover.verification.command import JudgedPhotos, verify_run
from uavcover.verification.flown_coverage import GivenEvidence, PhotoEvidence
from uavcover.verification.judged_track import track_positions_m
from uavcover.verification.run_logs import LOG_ENDINGS, read_log

__all__ = [
    "Assumptions",
    "PhotoRequest",
    "evidence_for_flight",
    "evidence_of",
    "judge_photos",
    "run_of_flight",
    "verify_evidence",
]

PHOTOS = "photos"
"""Folder inside a run folder for the verdict on photos."""
_IN_FLIGHT_M = 5.0


def evidence_of(logs: Sequence[Path], photos: Sequence[Path], *, system: int | None = None) -> GivenEvidence:
    """Separate tracks from photos among the given logs; the given photos remain photos."""
    photo_lists = [path for path in logs if _is_of_photos(path)]
    return GivenEvidence(tuple(path for path in logs if path not in photo_lists), (*photo_lists, *photos), system)


def _is_of_photos(path: Path) -> bool:
    ending = path.suffix.lower()
    if path.is_dir() or ending in ENDINGS:
        return True
    if ending == ".json":
        return _is_list(path)
    return ending in LISTS and (ending != ".csv" or not _is_track(path))


def _is_list(path: Path) -> bool:
    """Whether a JSON file is a list, as ODM's images.json is; plans and missions are objects."""
    if not path.is_file():
        return False
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return file.read(1000).lstrip().startswith("[")


def _is_track(path: Path) -> bool:
    """Whether a table is a flown track: it has a time in each row and no names."""
    if not path.is_file():
        return True
    with path.open("rb") as file:
        start = file.read(20_000)
    try:
        return "time_s" in header_of(text_from_bytes(start).text)
    except FormatError:
        return False


def verify_evidence(
    run: RunFolder,  # with a scenario
    evidence: GivenEvidence,  # with photos; without logs, the run's own track counts, if any
    request: PhotoRequest,  # settings for photos; its sources and its scenario are those of the run
    user: User,  # receives the verdict
    *,
    command: Sequence[str],  # the command line, for ``run.json``
    accepted: Sequence[str] = (),  # changes since planning that are accepted
) -> dict[str, Any]:
    """The verdict on a flight of a run folder: the coverage from its photos, everything else from its track.

    Returns:
        The content of ``verification.json``, or of ``photos/photos.json`` without a track.

    Raises:
        InputError: something cannot be read or used.
    """
    run.existing("scenario.toml", made_by="uavcover plan")
    with run.reserved((), force=True):
        run.remove(VERDICT_FILES)  # if the photos cannot be read, no older verdict must remain
    requested = replace(request, photos=evidence.photos, area=None, scenario=run.path, refly=False, force=True)
    verdict, document = judge_photos(requested, RunFolder(run.file(PHOTOS)), user, command=command)
    if not evidence.logs and not was_flown(run):
        user.warn("without a track, only the photo coverage is judged, not heights, limits or no-fly zones")
        return document
    photos = JudgedPhotos(evidence_for_flight(verdict), document)
    _, whole = verify_run(
        run, user, command=command, logs=evidence.logs, accepted=accepted, photos=photos, system=evidence.system
    )
    return whole


def evidence_for_flight(verdict: PhotoVerdict) -> PhotoEvidence:
    """Findings of a verdict on photos for the flight that took them."""
    document, shown = verdict.document, verdict.shown
    found = (
        f"coverage of the visible ground by photos: {percent(document['coverage_of_coverable'])} (certain: "
        f"{percent(document['surely'])}; possible: {percent(document['possibly'])}); required: "
        f"{percent(document['required'])}"
    )
    texts: dict[Requirement, str] = {
        "coverage": found,
        "overlap": f"the required overlap, {document['pictures_asked']} photos of every point, is achieved on "
        f"{percent(document['overlap_fraction'] or 0.0)} of the area, which is below the required "
        f"{percent(document['overlap_required'] or 0.0)}",
    }
    if (searched := document["detection"]) is not None:
        texts["detection"] = (
            f"the probability of detection is {percent(searched['pod'])} over the area, which is below the required "
            f"{percent(searched['asked'] or 0.0)}"
        )
    missed = [
        replace(finding, text=texts[finding.concerns[0]])
        for finding in verdict.judgement.findings
        if finding.effect != "noted"
    ]
    counts = PhotoCounts(shown.photos, shown.coverage.ground_sample_m, document["counted"], shown.looks)
    finding = f"coverage was computed from {document['counted']} photos, not from the track"
    return PhotoEvidence(shown.coverage, counts, (*missed, noted(finding)))


def run_of_flight(
    area: NewRequest, evidence: GivenEvidence, user: User, *, out: RunFolder, command: Sequence[str], force: bool
) -> GivenEvidence:
    """Write the scenario of a flight that was not planned here, and add the photos in its logs to the evidence.

    The scenario contains only the user's requirements: no overlap without ``--overlap``, no ground sample distance without
    ``--gsd``, no ceiling without ``--max-height``, and no fence.

    Args:
        area: the required area, with elevation data and camera.
        evidence: with at least one log.
        user: receives notes on unchecked requirements.
        out: folder of ``scenario.toml``.
        command: the command line, for ``run.json``.
        force: whether to replace it.

    Raises:
        InputError: something is missing or cannot be used; the flight was elsewhere.
    """
    if out.file("plan.json").exists():
        raise InputError(
            f"{out}: this folder contains a plan; specify another folder with -o, or verify the flight of this plan: "
            f"{to_paste('verify', out)}"
        )
    for log in evidence.logs:
        if not log.is_file():
            raise InputError(f"{log}: no such file; use a flight log ({', '.join(LOG_ENDINGS)}), or photos")
        if log.with_name("plan.json").exists():
            raise InputError(
                f"{log}: this log is in the folder of its plan; omit --area: "
                f"{to_paste('verify', log.parent, '--log', log)}, or copy it"
            )
    own = tuple(log for log in evidence.logs if log.suffix.lower() in LOGS and reports_photos(log))
    photos = evidence.photos or own
    overlaps = area.overlap is not None and bool(photos)
    found = read_photos(evidence.photos).photos if evidence.photos else ()

    def heights_m(site: Site) -> FloatArray:
        heights = np.concatenate(
            [site.ground.heights_agl_m(_positions_m(log, site, evidence.system)) for log in evidence.logs]
        )
        if np.isnan(heights).all():
            raise InputError(
                f"{evidence.logs[0]}: the flight is outside the elevation data, "
                f"{_away_km(evidence.logs[0], site, evidence.system):.0f} km from the area; are latitude and "
                "longitude swapped, or does the log belong to another area?"
            )
        flying: FloatArray = heights[heights > _IN_FLIGHT_M]
        if not flying.size:
            raise InputError(
                f"{evidence.logs[0]}: the flight is never more than {_IN_FLIGHT_M:g} m above the ground of the "
                "elevation data: the vehicle did not fly, or its heights refer to a different datum"
            )
        return flying

    with out.reserved(("scenario.toml", "run.json"), force=force):
        site = survey_as_flown(
            area, found, lambda site: float(np.median(heights_m(site))), user, out=out,
            take_off=lambda site: _take_off(evidence.logs[0], site, evidence.system),
        ).site  # fmt: skip
        ceiling_m = None
        if area.max_height is not None:
            ceiling_m = length_m(area.max_height, option="--max-height", example="120m")
        highest_m = float(heights_m(site).max())
        scenario = site.scenario
        sensor = frame_camera(scenario.sensor, source=scenario.name)
        sensor = replace(
            sensor,
            range_m=max(sensor.range_m, 2.0 * highest_m),
            max_ground_sample_m=None if area.gsd is None else sensor.max_ground_sample_m,
            forward_overlap=sensor.forward_overlap if overlaps else None,
            side_overlap=sensor.side_overlap if overlaps else 0.0,
        )
        limits = replace(
            scenario.limits, transit_clearance_m=0.0, min_height_agl_m=0.01, height_margin_m=0.0,
            fence_margin_m=30_000.0,
            # without a height limit, the band reaches from the ground to this height above the flight
            max_height_agl_m=highest_m + 10.0 if ceiling_m is None else ceiling_m,
            max_transit_height_agl_m=ceiling_m,
        )  # fmt: skip
        requested = scenario.requirements
        requirements = replace(requested, min_overlap_fraction=requested.min_overlap_fraction if overlaps else None)
        drawn = scenario.area if area.margin else replace(scenario.area, margin_m=0.0)
        text = dump_scenario(replace(scenario, area=drawn, sensor=sensor, limits=limits, requirements=requirements))
        out.write_text("scenario.toml", text)
        _record(out, evidence.logs, command)
    if area.overlap is not None and not overlaps:
        user.warn(f"--overlap cannot be judged: {evidence.logs[0].name} records no photos; add --photos")
    untold = [name for name, given in (("--max-height", area.max_height), ("--no-fly", area.no_fly)) if not given]
    user.say(f"{'scenario':18}{out.file('scenario.toml')}; no plan or fence is known, so these are not judged")
    if untold:
        user.say(f"{'':18}not judged, because not specified: {', '.join(untold)}")
    return replace(evidence, photos=photos)


def _record(out: RunFolder, logs: Sequence[Path], command: Sequence[str]) -> None:
    """``run.json``, so that later changes of the inputs are detected."""
    hashes = inspect_inputs(out, logs).hashes
    inputs = {
        name: {"sha256": hashes[name]} for name in ("scenario", "terrain", "surface", "obstacles") if name in hashes
    }
    start = {"schema_version": SCHEMA_VERSION, "command": list(command), "inputs": inputs}
    wrote = {"scenario.toml": hashes["scenario"]}
    out.write_json("run.json", with_entry(start, "verify", command=command, inputs=inputs, wrote=wrote))


def _positions_m(log: Path, site: Site, system: int | None) -> FloatArray:
    return track_positions_m(site, read_log(log, site, system=system).track)


def _away_km(log: Path, site: Site, system: int | None) -> float:
    return float(shapely.distance(site.area, shapely.points(_positions_m(log, site, system)[:, :2])).min()) / 1000.0


def _take_off(log: Path, site: Site, system: int | None) -> str:
    lat_deg, lon_deg = read_log(log, site, system=system).track.geodetic[0, :2]
    return f"{lat_deg:.8f},{lon_deg:.8f}"
