"""The verdict on photos: their positions, the ground that they show, and whether it suffices."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import InfeasibleError, InputError
from uavcover.extras.photos.photo import FILM_DIAGONAL_MM, LENS_DIFFERS, Photo
from uavcover.extras.photos.photo_verdict import PhotoVerdict, blur_px, clocks_of, frame_of
from uavcover.extras.photos.placing import (
    Assumptions,
    LocatedPhotos,
    direction_doubts,
    height_doubts,
    locate_photos,
    missing_stretches,
)
from uavcover.extras.photos.readers import PhotoSet
from uavcover.extras.photos.showing import detection_document, detection_doubts, shown_cells
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.sensor import FrameCamera
from uavcover.model.verdict import Effect, Finding, Holds, Judgement, Requirement
from uavcover.new.catalog import DetectionCurve
from uavcover.new.elevation_questions import NewRequest
from uavcover.run.user import User
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import OVERLAP_FRACTION, drawn_cells, photos_required
from uavcover.sensing.sensors import frame_camera
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.gaps import find_gaps

USUAL_COVERAGE = 0.98
_SAME_SHAPE = 0.03
BLUR_PX = 1.0
"""Motion of the ground during the exposure above which photos are reported."""
_FARTHEST_M = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoRequest:
    """Requirements on photos."""

    photos: Sequence[Path]  # folders, photo files, lists
    area: NewRequest | None  # the required area, with elevation data and camera; None with ``scenario``
    scenario: Path | None  # of the survey, instead
    # defaults for missing metadata; the height of take-off comes from ``takeoff``
    assumed: Assumptions
    # latitude and longitude; if given, heights above it count instead of those above the sea
    takeoff: tuple[float, float] | None
    # required coverage of the visible ground; None: the scenario's value, or 0.98
    coverage: float | None
    # whether the sensor's mount applies to photos that contain only the vehicle's attitude
    mount_known: bool
    refly: bool  # whether to plan a flight for missing photos
    budget_s: float | None  # time for its search; None: the scenario's number of evaluations
    force: bool  # whether to replace files
    detection: DetectionCurve | None = None  # probability that one look finds the object; None: there is no search
    # least mean probability, over the area, that the photos find it; None: it is only reported
    pod: float | None = None
    # largest motion of the ground during the exposure; photos with more, or with unknown blur, do not count; None: all count
    max_blur_px: float | None = None


def placed_in(request: PhotoRequest, found: PhotoSet, site: Site, frame: LocalFrame) -> LocatedPhotos:
    """The photos of the site's camera in its frame.

    Raises:
        InputError: none is from that camera or can be placed, or the take-off position has no ground.
    """
    assumed = request.assumed
    if request.takeoff is not None:
        lat, lon = request.takeoff
        position = frame.enu_from_geodetic(lat, lon, 0.0)
        ground_m = float(site.ground.heights_m(position[:, :2])[0])
        if not math.isfinite(ground_m):
            raise InputError(f"--takeoff: {lat:g}, {lon:g} is outside the elevation data; write latitude first")
        position[0, 2] = ground_m
        _, _, alt = frame.geodetic_from_enu(position)
        assumed = replace(assumed, takeoff_alt_amsl_m=float(alt[0]))
    sensor = frame_camera(site.scenario.sensor, source=f"scenario {site.scenario.name}")
    if request.mount_known:
        assumed = replace(assumed, mounted=sensor)
    others = _of_other_cameras(found.photos, sensor)
    same = [p for p in found.photos if p.name not in others]
    if not same:
        name, why = next(iter(others.items()))
        raise InputError(
            f"no photo was taken with this camera ({name}: {why}); specify another --camera, or omit it to derive "
            "the camera from the photos"
        )
    placed = locate_photos(same, frame, assumed)
    if np.isnan(site.ground.heights_agl_m(placed.eyes_m)).all():
        away = shapely.distance(site.area, shapely.points(placed.eyes_m[:, :2])) / 1000.0
        raise InputError(
            f"all {len(placed.photos)} photos were taken outside the elevation data, {float(away.min()):.0f} km or "
            "more from the area; are latitude and longitude swapped, or do the photos belong to another area?"
        )
    return replace(placed, left_out=others | placed.left_out)


def _of_other_cameras(photos: Sequence[Photo], sensor: FrameCamera) -> dict[str, str]:
    """Reasons why photos are not of a camera, by their names: other pixels, another shape, another lens or zoom."""
    across, along = (math.tan(math.radians(0.5 * fov)) for fov in (sensor.fov_across_deg, sensor.fov_along_deg))
    film_mm = 0.5 * FILM_DIAGONAL_MM / math.hypot(across, along)
    shape = max(across, along) / min(across, along)
    found: dict[str, str] = {}
    for photo in photos:
        if photo.pixels is not None:
            long, short = photo.pixels
            if sensor.pixels_across is not None and long != sensor.pixels_across:
                found[photo.name] = (
                    f"{long} x {short} pixels: the photo is from a different camera; the specified one has "
                    f"{sensor.pixels_across} pixels across"
                )
            elif not abs(long / max(short, 1) / shape - 1.0) <= _SAME_SHAPE:
                found[photo.name] = f"{long} x {short} pixels: the photo is cropped (camera: {shape:.2f} to 1)"
        lens_mm = photo.focal_length_35mm
        if lens_mm is not None and not abs(lens_mm / film_mm - 1.0) <= LENS_DIFFERS:
            found.setdefault(
                photo.name,
                f"its focal length corresponds to {lens_mm:.0f} mm on 35 mm film, but the camera's to {film_mm:.0f} "
                "mm: the lens or zoom differs",
            )
    return found


def judged(request: PhotoRequest, found: PhotoSet, site: Site, user: User) -> PhotoVerdict:
    """The verdict on photos of a site.

    Raises:
        InputError: none can be placed, or the site's sensor takes no photos.
        InfeasibleError: nothing of the area can be seen.
    """
    frame = frame_of(site)
    placed = placed_in(request, found, site, frame)
    heights_m = site.ground.heights_agl_m(placed.eyes_m)
    of_heights = height_doubts(
        placed, frame, site.ground, by_takeoff=request.takeoff is not None, error_m=request.assumed.vertical_m,
        home_en_m=None if request.scenario is None or site.home_m is None else np.asarray(site.home_m, dtype=float)[:2],
    )  # fmt: skip
    doubts = _warned([*of_heights, *direction_doubts(placed)], user)
    sensor = frame_camera(site.scenario.sensor, source=f"scenario {site.scenario.name}")
    if request.detection is not None and sensor.pixels_across is None:
        raise InputError(
            "--detection: the scenario's sensor has no pixels_across, so the resolution of the photos is unknown; add this key"
        )
    seeing = _whole(request, site, sensor, placed)
    coverage = judging_map(replace(site, scenario=replace(site.scenario, sensor=seeing)))
    blur = blur_px(placed, sensor, heights_m)
    blurred, unknown = _too_blurred(request, placed, blur)
    with user.progress("counting the photos of each cell"):
        verdict = _counted(request, coverage, site, placed, blur, blurred | unknown)
    missing = {"missing_photos": [asdict(stretch) for stretch in missing_stretches(placed)]}
    document = _document(request, found, verdict, heights_m, len(unknown)) | missing
    judgement = _judgement(document)
    if unknown and judgement.verdict == "failed":
        # Photos of unknown blur may be sharp enough.
        with_them = _counted(request, coverage, site, placed, blur, blurred)
        of_all = _document(request, found, with_them, heights_m, len(unknown))
        if _judgement(of_all).verdict != "failed":
            holds = _answer(document["surely"], of_all["possibly"], document["required"])
            document |= {"possibly": of_all["possibly"], "coverage_holds": holds}
            judgement = Judgement(
                tuple(replace(each, effect="not proved") for each in judgement.findings if each.effect != "noted")
            )
            observed, perhaps = verdict.shown.coverage, with_them.shown.coverage.possible_cells
            shown = replace(verdict.shown, coverage=replace(observed, possible_cells=observed.possible_cells | perhaps))
            verdict = replace(verdict, shown=shown)
    if verdict.shown.detection is not None:
        doubts += _warned(detection_doubts(verdict.shown.detection, verdict.shown.coverage.ground_sample_m), user)
    decided = {"passed": judgement.verdict == "passed", "verdict": judgement.verdict}
    document |= decided | {"doubts": doubts}
    return replace(verdict, judgement=judgement, document=document, too_blurred=len(blurred))


def _judgement(document: Mapping[str, Any]) -> Judgement:
    """The decision on photos by their figures."""
    findings: list[Finding] = []
    effects: dict[Holds, Effect] = {"no": "fails", "not proved": "not proved", "yes": "noted"}
    searched = document["detection"]
    answers: dict[Requirement, Holds] = {
        "coverage": document["coverage_holds"],
        "overlap": "no" if document["overlap_holds"] is False else "yes",
        "detection": "no" if searched is not None and searched["holds"] is False else "yes",
    }
    for requirement, answer in answers.items():
        findings.append(Finding(effects[answer], (requirement,), f"{requirement}: {answer}"))
    return Judgement(tuple(findings))


def _too_blurred(
    request: PhotoRequest, placed: LocatedPhotos, blur: FloatArray
) -> tuple[dict[str, str], dict[str, str]]:
    """Reasons against photos that are too blurred or whose blur is not known, by their names."""
    limit = request.max_blur_px
    if limit is None:
        return {}, {}
    unknown = f"the blur is unknown (no exposure time, or no speed), but --max-blur allows at most {limit:g} pixels"
    return (
        {
            p.name: f"blurred by {b:.2f} pixels; --max-blur allows at most {limit:g}"
            for p, b in zip(placed.photos, blur, strict=True)
            if b > limit
        },
        {p.name: unknown for p, b in zip(placed.photos, blur, strict=True) if math.isnan(b)},
    )


def _counted(
    request: PhotoRequest,
    coverage: CoverageMap,
    site: Site,
    placed: LocatedPhotos,
    blur: FloatArray,
    left_out: Mapping[str, str],
) -> PhotoVerdict:
    """Coverage by photos, without some of them; the document is not written yet."""
    kept = np.array([photo.name not in left_out for photo in placed.photos])
    placed = placed.without(left_out)
    shown = shown_cells(coverage, placed, request.detection)
    overlaps = request.area is None or request.area.overlap is not None
    needed = photos_required(site.scenario.sensor) if overlaps else None
    verdict = PhotoVerdict(
        site, coverage, placed, shown, drawn_cells(coverage), needed, blur[kept], [], Judgement(), {}
    )
    return replace(verdict, gaps=find_gaps(coverage, verdict.coverage_as_required))


def _warned(doubts: list[str], user: User) -> list[str]:
    for doubt in doubts:
        user.warn(doubt)
    return doubts


def _whole(request: PhotoRequest, site: Site, sensor: FrameCamera, placed: LocatedPhotos) -> FrameCamera:
    """The camera with its whole photo at any distance; only the user's requirements limit it."""
    grid = judging_map(site).grid
    highest = float(placed.eyes_m[:, 2].max() - grid.cells.centre_m[:, 2].min())
    reach_m = min(
        _FARTHEST_M, max(sensor.range_m, highest / max(math.cos(math.radians(sensor.max_incidence_deg)), 0.05))
    )
    limited = request.area is None or request.area.gsd is not None
    return replace(
        sensor, side_overlap=0.0, range_m=reach_m, max_ground_sample_m=sensor.max_ground_sample_m if limited else None
    )


def _required(request: PhotoRequest, site: Site) -> tuple[float, float]:
    """The required fraction of the visible ground, and that of the area in which the overlap has to hold."""
    if request.area is not None:
        return request.coverage or USUAL_COVERAGE, OVERLAP_FRACTION
    requirements = site.scenario.requirements
    overlap = requirements.min_overlap_fraction or OVERLAP_FRACTION
    return request.coverage or requirements.min_coverage_of_coverable, overlap


def _answer(sure: float, possible: float, wanted: float) -> Holds:
    return "yes" if sure >= wanted else "no" if possible < wanted else "not proved"


def _document(
    request: PhotoRequest, found: PhotoSet, verdict: PhotoVerdict, heights_m: FloatArray, blur_unknown: int
) -> dict[str, Any]:
    placed, shown, coverage, drawn = verdict.placed, verdict.shown, verdict.coverage, verdict.drawn
    needed = verdict.required
    weight = coverage.grid.weight_m2
    can_be = drawn & (coverage.coverable | shown.coverage.observed)
    if not can_be.any():
        raise InfeasibleError("this camera cannot observe any part of the area within the limits")

    def fraction(cells: BoolArray) -> float:
        return float(weight[cells & can_be].sum() / weight[can_be].sum())

    flown = shown.coverage
    observed, sure, possible = fraction(flown.observed), fraction(flown.certain_cells), fraction(flown.possible_cells)
    overlap = None if needed is None else float(weight[drawn & (shown.photos >= needed)].sum() / weight[drawn].sum())
    required, overlap_required = _required(request, verdict.site)
    holds = None if overlap is None else overlap >= overlap_required
    answer = _answer(sure, possible, required)
    samples = flown.ground_sample_m[drawn]
    samples = samples[np.isfinite(samples)]
    blur = verdict.blur_px
    sharp = blur[np.isfinite(blur)]
    found_by = None
    if shown.detection is not None:
        found_by = detection_document(shown.detection, drawn, weight, request.pod)
    return {
        "pictures": len(found.photos),
        "inputs": {"pictures": found.sha256},
        "clocks": clocks_of(found.photos),
        "counted": len(placed.photos),
        "looks": shown.looks,
        "left_out": placed.left_out,
        "direction_known": int(placed.direction_known.sum()),
        "height_agl_m": {"lowest": float(np.nanmin(heights_m)), "median": float(np.nanmedian(heights_m)),
                         "highest": float(np.nanmax(heights_m))},
        "area_m2": float(weight[drawn].sum()),
        "coverable_area_m2": float(weight[can_be].sum()),
        "coverage_of_coverable": observed,
        "surely": sure,
        "possibly": possible,
        "required": required,
        "coverage_holds": answer,
        "pictures_asked": needed,
        "overlap_fraction": overlap,
        "overlap_required": None if overlap is None else overlap_required,
        "overlap_holds": holds,
        "detection": found_by,
        "pictures_median": float(np.median(shown.photos[drawn])),
        "directions_median": float(np.median(shown.directions[drawn])),
        "ground_sample_median_m": float(np.median(samples)) if samples.size else None,
        "ground_sample_p95_m": float(np.percentile(samples, 95.0)) if samples.size else None,
        "max_blur_px": request.max_blur_px,
        "blur_not_known": blur_unknown,
        "blur_median_px": float(np.median(sharp)) if sharp.size else None,
        "blur_largest_px": float(sharp.max()) if sharp.size else None,
        "blurred": [p.name for p, b in zip(placed.photos, blur, strict=True) if b > BLUR_PX],
        "gaps": [asdict(region.gap) for region in verdict.gaps],
    }  # fmt: skip
