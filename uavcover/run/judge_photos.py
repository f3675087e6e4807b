"""Judging pictures that were taken, and planning the flight for what is missing, as ``judge-photos`` does it."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely

from uavcover.errors import InfeasibleError, InputError
from uavcover.intake.cameras import CameraBody, camera_named
from uavcover.judging.flown_coverage import FlownCoverage
from uavcover.judging.gaps import GapRegion, cells_outline, find_gaps, gaps_geojson
from uavcover.judging.photos.picture import Picture
from uavcover.judging.photos.placing import Assumptions, PlacedPictures, place_pictures
from uavcover.judging.photos.readers import PictureSet, read_pictures
from uavcover.judging.photos.showing import ShownCells, shown_cells
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.area import Area
from uavcover.model.sensor import FrameCamera
from uavcover.run.folder import RunFolder, json_text
from uavcover.run.new import NewRequest, new_scenario
from uavcover.run.photo_verdict import (
    PhotoVerdict,
    blur_px,
    footprints_geojson,
    frame_of,
    photo_raster,
    picture_table,
)
from uavcover.run.plan import PlanRequest, plan_into
from uavcover.run.user import Unattended, User, percent
from uavcover.scenario.frames import LocalFrame
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap, judging_map
from uavcover.sensing.pictures import OVERLAP_FRACTION, drawn_cells, overlap_rule, pictures_asked

FILES = ("scenario.toml", "photos.json", "pictures.csv", "footprints.geojson", "photos.tif", "gaps.geojson")
REFLY = "refly"
CAMERA_FILE = "camera.toml"
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_LENS_DIFFERS = 0.1
_FIRST_HEIGHT_M = 80.0
_FARTHEST_M = 5000.0
_SHOWN_NAMES = 3
_BLUR_PX = 1.0
_NEVER = Unattended()

Answer = Literal["yes", "no", "not proved"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoRequest:
    """What is asked.

    Attributes:
        photos: folders, picture files, lists.
        area: what should be seen, with elevation data and camera; none with ``scenario``.
        scenario: of the survey, instead.
        assumed: what is taken where pictures do not tell it; the height of take-off is filled in from ``takeoff``.
        takeoff: latitude and longitude: heights above it count, not those above the sea.
        coverage: share of what can be seen that some picture has to show.
        refly: whether to plan the flight for what is missing.
        budget_s: time for its search; none: the scenario's number of evaluations.
        force: whether files may be replaced.
    """

    photos: Sequence[Path]
    area: NewRequest | None
    scenario: Path | None
    assumed: Assumptions
    takeoff: tuple[float, float] | None
    coverage: float
    refly: bool
    budget_s: float | None
    force: bool


def judge_photos(
    request: PhotoRequest, out: RunFolder, user: User, *, command: Sequence[str]
) -> tuple[PhotoVerdict, dict[str, Any]]:
    """Judge pictures, write the files of the verdict, plan the flight for what is missing, and say it.

    Raises:
        InputError: an area, a picture, a list or an option cannot be used.
    """
    if not 0.0 < request.coverage <= 1.0:
        raise InputError(f"--coverage: {request.coverage:g} is a share, above 0 and at most 1")
    with user.progress("reading pictures") as bar:
        found = read_pictures(request.photos, progress=bar.count)
    for note in found.notes:
        user.say(f"{'pictures read':18}{note}")
    with out.reserved((*FILES, CAMERA_FILE, f"{REFLY}/plan.json"), force=request.force):
        site, text = _site(request, found, out, user)
        verdict = _judged(request, found, site, user)
        files: dict[str, str | bytes] = {
            "scenario.toml": text,
            "photos.json": json_text(verdict.document),
            "pictures.csv": picture_table(verdict, site),
            "gaps.geojson": json_text(gaps_geojson(verdict.coverage, verdict.gaps)),
            "footprints.geojson": json_text(footprints_geojson(verdict)),
            "photos.tif": photo_raster(verdict),
        }
        out.write_together(files)
    _say(verdict, user)
    document = verdict.document | {"files": [str(out.file(name)) for name in FILES], "refly": None}
    if request.refly and verdict.lacking.any():
        document["refly"] = _refly(verdict, out, request, user, command=command)
    user.say(f"written: {', '.join(str(out.file(name)) for name in FILES)}")
    return verdict, document


def _site(request: PhotoRequest, found: PictureSet, out: RunFolder, user: User) -> tuple[Site, str]:
    """The survey on its ground, and the text of its scenario."""
    if request.scenario is not None:
        path = request.scenario / "scenario.toml" if request.scenario.is_dir() else request.scenario
        site = load_site(path)
        if not isinstance(site.scenario.sensor, FrameCamera):
            raise InputError(f"{path}: its sensor is a {site.scenario.sensor.kind}; pictures need a frame-camera")
        return site, dump_scenario(site.scenario)
    area = request.area
    if area is None:
        raise InputError("judge-photos: give --area with --dem, or --scenario with the survey's file or run folder")
    if area.camera is None:
        body, name = _camera_of(found.pictures, out)
        area = replace(area, camera=name)
        user.say(f"{'camera':18}{body}, by what the pictures tell; kept in {name}")
    camera = camera_named(str(area.camera))
    _compare_lens(camera, found.pictures, user)
    if area.gsd is None:
        # The first scenario only places the pictures; the second is made for the height at which they were taken.
        first = new_scenario(replace(area, gsd=_gsd_text(_FIRST_HEIGHT_M / camera.focal_px)), _NEVER, folder=out.path)
        placed = _placed(request, found, first.site, frame_of(first.site))
        height_m = float(np.nanmedian(first.site.ground.heights_agl_m(placed.eyes_m)))
        if not height_m > 0.0:
            raise InputError(
                f"half of the pictures lie {-height_m:.0f} m or more under the ground, or outside the elevation data: their "
                "heights do not fit it; give --takeoff LAT,LON if they tell heights above take-off, or --geoid-height"
            )
        area = replace(area, gsd=_gsd_text(height_m / camera.focal_px))
        user.say(
            f"{'ground sample':18}no limit given; the flight for what is missing is planned for {area.gsd}, as the pictures "
            f"were taken from {height_m:.0f} m above ground (median)"
        )
    scenario = new_scenario(area, user, folder=out.path)
    return scenario.site, scenario.text


def _gsd_text(gsd_m: float) -> str:
    return f"{math.ceil(1000.0 * 100.0 * gsd_m) / 1000.0:g}cm"


def _camera_of(pictures: Sequence[Picture], out: RunFolder) -> tuple[str, str]:
    """A camera file by what the pictures tell; its title, and its path."""
    telling = [p for p in pictures if p.focal_length_mm and p.focal_length_35mm and p.pixels]
    if not telling:
        raise InputError(
            "the pictures do not tell their camera (focal length, the same for 35 mm film, pixels): give --camera NAME or a "
            "camera file (uavcover new --camera list)"
        )
    kinds = Counter((p.focal_length_mm, p.focal_length_35mm, p.pixels, p.camera) for p in telling)
    (focal_mm, film_mm, pixels, title), _ = kinds.most_common(1)[0]
    if focal_mm is None or film_mm is None or pixels is None:
        raise InputError("the pictures do not tell their camera: give --camera")
    diagonal_mm = _FILM_DIAGONAL_MM * focal_mm / film_mm
    pitch_mm = diagonal_mm / math.hypot(*pixels)
    lines = [
        f"title = {_quoted(title or 'camera of the pictures')}",
        f"sensor_mm = [{pitch_mm * pixels[0]:.4f}, {pitch_mm * pixels[1]:.4f}]",
        f"pixels = [{pixels[0]}, {pixels[1]}]",
        f"focal_length_mm = {focal_mm:g}",
        f'source = "the pictures\' own words: {focal_mm:g} mm, as {film_mm:g} mm on 35 mm film"',
    ]
    out.write_text(CAMERA_FILE, "\n".join(lines) + "\n")
    return title or "camera of the pictures", str(out.file(CAMERA_FILE))


def _quoted(text: str) -> str:
    """As TOML and JSON both have it."""
    return json.dumps("".join(letter for letter in text if letter.isprintable()))


def _compare_lens(camera: CameraBody, pictures: Sequence[Picture], user: User) -> None:
    """Warn of a camera whose field of view is not that which the pictures tell."""
    films_mm = [p.focal_length_35mm for p in pictures if p.focal_length_35mm]
    if not films_mm:
        return
    film_mm = float(np.median(films_mm))
    own_mm = _FILM_DIAGONAL_MM * camera.focal_length_mm / math.hypot(camera.sensor_across_mm, camera.sensor_along_mm)
    if abs(own_mm / film_mm - 1.0) > _LENS_DIFFERS:
        user.warn(
            f"--camera: {camera.name} sees as {own_mm:.0f} mm do on 35 mm film, the pictures say {film_mm:.0f} mm: another "
            "camera or zoom? Without --camera theirs is taken"
        )


def _placed(request: PhotoRequest, found: PictureSet, site: Site, frame: LocalFrame) -> PlacedPictures:
    assumed = request.assumed
    if request.takeoff is not None:
        lat, lon = request.takeoff
        place = frame.enu_from_geodetic(lat, lon, 0.0)
        ground_m = float(site.ground.heights_m(place[:, :2])[0])
        if not math.isfinite(ground_m):
            raise InputError(f"--takeoff: {lat:g}, {lon:g} is outside the elevation data; latitude first")
        place[0, 2] = ground_m
        _, _, alt = frame.geodetic_from_enu(place)
        assumed = replace(assumed, takeoff_alt_amsl_m=float(alt[0]))
    sensor = site.scenario.sensor
    pixels = sensor.pixels_across if isinstance(sensor, FrameCamera) else None
    others = {
        p.name: f"{p.pixels[0]} x {p.pixels[1]} pixels: of another camera"
        for p in found.pictures
        if pixels is not None and p.pixels is not None and p.pixels[0] != pixels
    }
    same = [p for p in found.pictures if p.name not in others]
    if not same:
        name, why = next(iter(others.items()))
        raise InputError(
            f"no picture is of the camera, which has {pixels} pixels across; {name}: {why}; give another --camera"
        )
    placed = place_pictures(same, frame, assumed)
    return replace(placed, left_out=others | placed.left_out)


def _judged(request: PhotoRequest, found: PictureSet, site: Site, user: User) -> PhotoVerdict:
    frame = frame_of(site)
    placed = _placed(request, found, site, frame)
    heights_m = site.ground.heights_agl_m(placed.eyes_m)
    _doubt_heights(heights_m, user)
    sensor = site.scenario.sensor
    if not isinstance(sensor, FrameCamera):
        raise InputError(f"scenario {site.scenario.name}: its sensor is a {sensor.kind}; pictures need a frame-camera")
    seeing = _whole(request, site, sensor, placed)
    coverage = judging_map(replace(site, scenario=replace(site.scenario, sensor=seeing)))
    with user.progress("counting what the pictures show"):
        shown = shown_cells(coverage, placed)
    drawn = drawn_cells(coverage)
    asked = pictures_asked(sensor) if _asks_overlap(request) else None
    needed = asked or 1
    enough = replace(shown.coverage, seen=shown.enough(needed) | ~drawn)
    gaps = find_gaps(coverage, enough)
    document = _document(request, found, placed, shown, coverage, drawn, asked, heights_m, gaps)
    return PhotoVerdict(site, coverage, placed, shown, drawn, needed, document, gaps)


def _asks_overlap(request: PhotoRequest) -> bool:
    return request.area is None or request.area.overlap is not None


def _whole(request: PhotoRequest, site: Site, sensor: FrameCamera, placed: PlacedPictures) -> FrameCamera:
    """The camera with its whole picture, however far: only what the user asked for limits it."""
    grid = judging_map(site).grid
    highest = float(placed.eyes_m[:, 2].max() - grid.cells.centre_m[:, 2].min())
    reach_m = min(
        _FARTHEST_M, max(sensor.range_m, highest / max(math.cos(math.radians(sensor.max_incidence_deg)), 0.05))
    )
    limited = request.area is None or request.area.gsd is not None
    return replace(
        sensor, side_overlap=0.0, range_m=reach_m, max_ground_sample_m=sensor.max_ground_sample_m if limited else None
    )


def _doubt_heights(heights_m: FloatArray, user: User) -> None:
    under = int((heights_m <= 0.0).sum())
    if under:
        user.warn(
            f"{under} of {heights_m.size} pictures lie under the ground (lowest {np.nanmin(heights_m):.0f} m): their heights do "
            "not fit the elevation data; heights above take-off are taken with --takeoff LAT,LON"
        )
    outside = int(np.isnan(heights_m).sum())
    if outside:
        user.warn(f"{outside} of {heights_m.size} pictures were taken outside the elevation data")


def _answer(sure: float, possible: float, wanted: float) -> Answer:
    return "yes" if sure >= wanted else "no" if possible < wanted else "not proved"


def _document(
    request: PhotoRequest,
    found: PictureSet,
    placed: PlacedPictures,
    shown: ShownCells,
    coverage: CoverageMap,
    drawn: BoolArray,
    asked: int | None,
    heights_m: FloatArray,
    gaps: Sequence[GapRegion],
) -> dict[str, Any]:
    weight = coverage.grid.weight_m2
    can_be = drawn & (coverage.coverable | shown.coverage.seen)
    if not can_be.any():
        raise InfeasibleError("no part of the area can be seen by this camera within the limits")

    def share(cells: BoolArray) -> float:
        return float(weight[cells & can_be].sum() / weight[can_be].sum())

    flown: FlownCoverage = shown.coverage
    seen, sure, possible = share(flown.seen), share(flown.surely_seen), share(flown.possibly_seen)
    overlap = None if asked is None else float(weight[drawn & (shown.pictures >= asked)].sum() / weight[drawn].sum())
    holds = None if overlap is None else overlap >= OVERLAP_FRACTION
    answer = _answer(sure, possible, request.coverage)
    samples = flown.ground_sample_m[drawn]
    samples = samples[np.isfinite(samples)]
    blur = blur_px(placed, coverage, heights_m)
    sharp = blur[np.isfinite(blur)]
    passed = answer == "yes" and holds is not False
    return {
        "pictures": len(found.pictures),
        "counted": len(placed.pictures),
        "left_out": placed.left_out,
        "direction_known": int(placed.direction_known.sum()),
        "height_agl_m": {"lowest": float(np.nanmin(heights_m)), "median": float(np.nanmedian(heights_m)),
                         "highest": float(np.nanmax(heights_m))},
        "area_m2": float(weight[drawn].sum()),
        "coverable_area_m2": float(weight[can_be].sum()),
        "coverage_of_coverable": seen,
        "surely": sure,
        "possibly": possible,
        "required": request.coverage,
        "coverage_holds": answer,
        "pictures_asked": asked,
        "overlap_fraction": overlap,
        "overlap_holds": holds,
        "pictures_median": float(np.median(shown.pictures[drawn])),
        "directions_median": float(np.median(shown.directions[drawn])),
        "ground_sample_median_m": float(np.median(samples)) if samples.size else None,
        "ground_sample_p95_m": float(np.percentile(samples, 95.0)) if samples.size else None,
        "blur_median_px": float(np.median(sharp)) if sharp.size else None,
        "blur_largest_px": float(sharp.max()) if sharp.size else None,
        "blurred": [p.name for p, b in zip(placed.pictures, blur, strict=True) if b > _BLUR_PX],
        "gaps": [asdict(region.gap) for region in gaps],
        "passed": passed,
        "verdict": "passed" if passed else "not proved" if answer == "not proved" and holds is not False else "failed",
    }  # fmt: skip


def _refly(
    verdict: PhotoVerdict, out: RunFolder, request: PhotoRequest, user: User, *, command: Sequence[str]
) -> dict[str, Any] | None:
    """The flight for what is missing, planned as a survey of its own; none where there is none inside the limits."""
    site = missing_site(verdict)
    missing_m2 = float(verdict.coverage.grid.weight_m2[verdict.lacking].sum())
    user.say(f"{'missing':18}{missing_m2:.0f} square metres that could be seen")
    try:
        outcome = plan_into(
            PlanRequest(
                scenario=site, folder=out.file(REFLY), command=command, force=request.force, budget_s=request.budget_s
            ),
            user,
            check_site=lambda _: None,
        )
    except InfeasibleError as error:
        user.warn(f"no flight for what is missing: {error}")
        return None
    return {"missing_m2": missing_m2, **outcome.document}


def missing_site(verdict: PhotoVerdict) -> Site:
    """The survey again, its area only what could be seen and is in too few pictures; its margin is that of the survey."""
    site = verdict.site
    frame, cells = frame_of(site), verdict.coverage.grid.cells
    stairs = cells_outline(verdict.coverage, np.flatnonzero(verdict.lacking))
    # The outline of cells is stairs: one step around it is flown as well.
    region = shapely.simplify(stairs.buffer(cells.size_m), 0.5 * cells.size_m)
    level_m = float(cells.centre_m[:, 2].mean())

    def ring(line: shapely.LinearRing) -> tuple[tuple[float, float], ...]:
        places = shapely.get_coordinates(line)[:-1]
        lat, lon, _ = frame.geodetic_from_enu(np.column_stack([places, np.full(len(places), level_m)]))
        return tuple((round(float(x), 8), round(float(y), 8)) for x, y in zip(lon, lat, strict=True))

    parts = tuple((ring(part.exterior), *(ring(hole) for hole in part.interiors)) for part in shapely.get_parts(region))
    own = site.scenario.area
    area = Area(cell_size_m=own.cell_size_m, polygons_lon_lat_deg=parts, margin_m=own.margin_m)
    name = f"{site.scenario.name}-missing"
    return load_site(replace(site.scenario, name=name, description="what pictures do not show", area=area))


def _say(verdict: PhotoVerdict, user: User) -> None:
    told = verdict.document
    user.say(
        f"{'pictures':18}{told['pictures']}, {told['counted']} count; the camera's angles are told by {told['direction_known']}"
    )
    for name, why in list(verdict.placed.left_out.items())[:_SHOWN_NAMES]:
        user.warn(f"{name}: {why}; it does not count")
    if len(verdict.placed.left_out) > _SHOWN_NAMES:
        user.warn(f"and {len(verdict.placed.left_out) - _SHOWN_NAMES} more do not count: pictures.csv says why")
    heights = told["height_agl_m"]
    user.say(
        f"{'height':18}{heights['lowest']:.0f} to {heights['highest']:.0f} m above ground, {heights['median']:.0f} m (median)"
    )
    user.say(
        f"{'shown':18}{percent(told['coverage_of_coverable'])} of what can be seen; surely {percent(told['surely'])}, possibly "
        f"{percent(told['possibly'])}; required {percent(told['required'])}: {told['coverage_holds']}"
    )
    if told["pictures_asked"] is not None:
        rule = overlap_rule(verdict.site.scenario.sensor)
        user.say(
            f"{'overlap':18}{percent(told['overlap_fraction'])} of the area is in at least {told['pictures_asked']} pictures: "
            f"{'holds' if told['overlap_holds'] else 'DOES NOT HOLD'}" + ("" if rule is None else f" ({rule})")
        )
    user.say(
        f"{'a point':18}is in {told['pictures_median']:g} pictures from {told['directions_median']:g} directions (median)"
    )
    if told["ground_sample_median_m"] is not None:
        user.say(
            f"{'ground sample':18}{100.0 * told['ground_sample_median_m']:.2f} cm (median), 95 % below "
            f"{100.0 * told['ground_sample_p95_m']:.2f} cm"
        )
    if told["blur_median_px"] is not None:
        user.say(
            f"{'blur':18}{told['blur_median_px']:.2f} pixels (median), {told['blur_largest_px']:.2f} at most; "
            f"{len(told['blurred'])} pictures above {_BLUR_PX:g}"
        )
    areas: Counter[str] = Counter()
    for gap in told["gaps"]:
        areas[gap["reason"]] += gap["area_m2"]
    user.say(f"{'gaps':18}{len(told['gaps'])}, {sum(areas.values()):.0f} square metres in all")
    for reason, area_m2 in areas.most_common():
        user.say(f"{'':18}{reason}: {area_m2:.0f} square metres")
    user.say(f"{'verdict':18}{told['verdict'].upper() if not told['passed'] else told['verdict']}")
