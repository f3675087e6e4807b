"""Judge photos, and plan a flight for missing ones (``judge-photos``)."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from mission_io.model.plain_text import counted
from uavcover.errors import InfeasibleError, InputError
from uavcover.extras.photos.photo import CAMERA_FILE, survey_as_flown
from uavcover.extras.photos.photo_judgement import BLUR_PX, PhotoRequest, judged, placed_in
from uavcover.extras.photos.photo_verdict import PhotoVerdict, footprints_geojson, frame_of, photo_raster, photo_table
from uavcover.extras.photos.readers import PhotoSet, read_photos
from uavcover.model.area import Area
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.folder import RunFolder, json_text
from uavcover.run.user import User, percent
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.photos import overlap_rule
from uavcover.sensing.sensors import frame_camera
from uavcover.verification.gaps import cells_outline, gaps_geojson

FILES = ("scenario.toml", "photos.json", "pictures.csv", "footprints.geojson", "photos.tif", "gaps.geojson")
REFLY = "refly"
_SHOWN_NAMES = 3


def judge_photos(
    request: PhotoRequest, out: RunFolder, user: User, *, command: Sequence[str]
) -> tuple[PhotoVerdict, dict[str, Any]]:
    """Judge photos, write the files of the verdict, plan a flight for missing photos, and print the result.

    Raises:
        InputError: an area, a photo, a list or an option cannot be used.
    """
    if request.coverage is not None and not 0.0 < request.coverage <= 1.0:
        raise InputError(f"--coverage: must be above 0 and at most 1, not {request.coverage:g}")
    with user.progress("reading photos") as bar:
        found = read_photos(request.photos, progress=bar.count)
    for note in found.notes:
        user.say(f"{'photos read':18}{note}")
    with out.reserved((*FILES, CAMERA_FILE, f"{REFLY}/plan.json"), force=request.force):
        site, text = _site(request, found, out, user)
        verdict = judged(request, found, site, user)
        files: dict[str, str | bytes] = {
            "scenario.toml": text,
            "photos.json": json_text(verdict.document),
            "pictures.csv": photo_table(verdict, site),
            "gaps.geojson": json_text(_gaps(verdict)),
            "footprints.geojson": json_text(footprints_geojson(verdict)),
            "photos.tif": photo_raster(verdict),
        }
        out.write_together(files)
    _print(verdict, user)
    document = verdict.document | {"files": [str(out.file(name)) for name in FILES], "refly": None}
    if request.refly and verdict.lacking.any():
        document["refly"] = _refly(verdict, out, request, user, command=command)
    user.say(f"wrote {', '.join(str(out.file(name)) for name in FILES)}")
    return verdict, document


def _gaps(verdict: PhotoVerdict) -> dict[str, Any]:
    """The gaps as polygons, and the stretches without photos as lines."""
    collection = gaps_geojson(verdict.coverage, verdict.gaps)
    for stretch in verdict.document["missing_photos"]:
        properties = {
            "reason": "photos-missing",
            **{key: stretch[key] for key in ("after", "before", "photos", "length_m")},
        }
        line = {"type": "LineString", "coordinates": stretch["lon_lat_deg"]}
        feature = {"type": "Feature", "id": len(collection["features"]), "geometry": line, "properties": properties}
        collection["features"].append(feature)
    return collection


def _site(request: PhotoRequest, found: PhotoSet, out: RunFolder, user: User) -> tuple[Site, str]:
    """The survey on its ground, and the text of its scenario."""
    if request.scenario is not None:
        path = request.scenario / "scenario.toml" if request.scenario.is_dir() else request.scenario
        site = load_site(path)
        frame_camera(site.scenario.sensor, source=str(path))
        return site, dump_scenario(site.scenario)
    if request.area is None:
        raise InputError("judge-photos: specify --area with --dem, or --scenario with a scenario file or run folder")

    def height_agl_m(site: Site) -> float:
        placed = placed_in(request, found, site, frame_of(site))
        height_m = float(np.nanmedian(site.ground.heights_agl_m(placed.eyes_m)))
        if not height_m > 0.0:
            raise InputError(
                f"half of the photos lie {-height_m:.0f} m or more below the ground: their heights do not match the "
                "elevation data; use --takeoff LAT,LON if their heights are above take-off, or --geoid-height"
            )
        return height_m

    scenario = survey_as_flown(request.area, found.photos, height_agl_m, user, out=out)
    return scenario.site, scenario.text


def _refly(
    verdict: PhotoVerdict, out: RunFolder, request: PhotoRequest, user: User, *, command: Sequence[str]
) -> dict[str, Any] | None:
    """Plan the flight for the gaps as a separate survey. None if no flight inside the limits closes them."""
    site = missing_site(verdict)
    missing_m2 = float(verdict.coverage.grid.weight_m2[verdict.lacking].sum())
    user.say(f"{'missing':18}{missing_m2:.0f} square metres of visible ground")
    try:
        outcome = plan_into(
            PlanRequest(
                scenario=site, folder=out.file(REFLY), command=command, force=request.force, budget_s=request.budget_s
            ),
            user,
            check_site=lambda _: None,
        )
    except InfeasibleError as error:
        user.warn(f"cannot plan a flight for the missing photos: {error}")
        return None
    return {"missing_m2": missing_m2, **outcome.document}


def missing_site(verdict: PhotoVerdict) -> Site:
    """The survey for the gaps. Its area is the visible ground in too few photos; its margin is that of the survey."""
    site = verdict.site
    frame, own = frame_of(site), site.scenario.area
    stairs = cells_outline(verdict.coverage, np.flatnonzero(verdict.lacking))
    # The outline of cells has steps, so extend it by one step.
    region = shapely.simplify(stairs.buffer(own.cell_size_m), 0.5 * own.cell_size_m)
    level_m = float(verdict.coverage.grid.cells.centre_m[:, 2].mean())

    def ring(line: shapely.LinearRing) -> tuple[tuple[float, float], ...]:
        positions = shapely.get_coordinates(line)[:-1]
        lat, lon, _ = frame.geodetic_from_enu(np.column_stack([positions, np.full(len(positions), level_m)]))
        return tuple((round(float(x), 8), round(float(y), 8)) for x, y in zip(lon, lat, strict=True))

    parts = tuple((ring(part.exterior), *(ring(hole) for hole in part.interiors)) for part in shapely.get_parts(region))
    area = Area(
        cell_size_m=own.cell_size_m, fewest_places=own.fewest_places, polygons_lon_lat_deg=parts, margin_m=own.margin_m
    )
    name = f"{site.scenario.name}-missing"
    return load_site(replace(site.scenario, name=name, description="gaps in the photos", area=area))


def _print(verdict: PhotoVerdict, user: User) -> None:
    document = verdict.document
    user.say(
        f"{'photos':18}{document['pictures']}, {document['counted']} count; {document['direction_known']} have camera angles"
    )
    if document["looks"] < document["counted"]:
        user.say(
            f"{'looks':18}{document['looks']}: photos of one capture, or from one position in a similar direction, are one look"
        )
    for name, why in list(verdict.placed.left_out.items())[:_SHOWN_NAMES]:
        user.warn(f"{name}: {why}; this photo is not counted")
    if len(verdict.placed.left_out) > _SHOWN_NAMES:
        more = counted(len(verdict.placed.left_out) - _SHOWN_NAMES, "more photo is", "more photos are")
        user.warn(f"{more} not counted; see pictures.csv")
    heights = document["height_agl_m"]
    user.say(
        f"{'height':18}{heights['lowest']:.0f} to {heights['highest']:.0f} m above ground, {heights['median']:.0f} m (median)"
    )
    user.say(
        f"{'shown':18}{percent(document['coverage_of_coverable'])} of the visible ground (certain: "
        f"{percent(document['surely'])}; possible: {percent(document['possibly'])}); required: "
        f"{percent(document['required'])}; {document['coverage_holds']}"
    )
    if document["pictures_asked"] is not None:
        rule = overlap_rule(verdict.site.scenario.sensor)
        user.say(
            f"{'overlap':18}{percent(document['overlap_fraction'])} of the area "
            f"is in at least {counted(document['pictures_asked'], 'photo')}: "
            f"{'met' if document['overlap_holds'] else 'NOT MET'}" + ("" if rule is None else f" ({rule})")
        )
    user.say(
        f"{'a point':18}appears in {document['pictures_median']:g} photos from {document['directions_median']:g} "
        f"direction{'' if document['directions_median'] == 1 else 's'} (median)"
    )
    if document["detection"] is not None:
        for line in _detection_lines(document["detection"]):
            user.say(line)
    if document["ground_sample_median_m"] is not None:
        user.say(
            f"{'ground sample':18}{100.0 * document['ground_sample_median_m']:.2f} cm (median), 95 % below "
            f"{100.0 * document['ground_sample_p95_m']:.2f} cm"
        )
    if document["blur_median_px"] is not None:
        user.say(
            f"{'blur':18}{document['blur_median_px']:.2f} pixels (median), {document['blur_largest_px']:.2f} at most; "
            f"{counted(len(document['blurred']), 'photo')} above {BLUR_PX:g}"
        )
    if document["max_blur_px"] is not None:
        user.say(
            f"{'blur limit':18}{document['max_blur_px']:g} pixels: "
            f"{counted(verdict.too_blurred, 'photo exceeds', 'photos exceed')} it; the blur of "
            f"{document['blur_not_known']} is unknown"
        )
    if document["missing_photos"]:
        longest = max(document["missing_photos"], key=lambda stretch: stretch["length_m"])
        user.say(
            f"{'missing photos':18}{sum(stretch['photos'] for stretch in document['missing_photos'])} on "
            f"{counted(len(document['missing_photos']), 'stretch', 'stretches')}; the longest is "
            f"{longest['length_m']:.0f} m (usual distance: {longest['usual_m']:.0f} m), from "
            f"{longest['after']} to {longest['before']}"
        )
    areas: Counter[str] = Counter()
    for gap in document["gaps"]:
        areas[gap["reason"]] += gap["area_m2"]
    user.say(f"{'gaps':18}{len(document['gaps'])}, {sum(areas.values()):.0f} square metres in total")
    for reason, area_m2 in areas.most_common():
        user.say(f"{'':18}{reason}: {area_m2:.0f} square metres")
    user.say(f"{'verdict':18}{document['verdict'].upper() if not document['passed'] else document['verdict']}")


def _detection_lines(document: dict[str, Any]) -> list[str]:
    fractions = document["pod_percentiles"]
    required, words = document["asked"], ""
    if required is not None:
        words = f"; required {percent(required)}: {'met' if document['holds'] else 'NOT MET'}"
    lines = [
        f"{'detection':18}{percent(document['pod'])} over the area ({document['title']}){words}",
        f"{'':18}with only the best photo: {percent(document['pod_best_look'])}; with all photos as independent: "
        f"{percent(document['pod_every_picture'])}",
        f"{'':18}{percent(fractions['5'])} or less on 5 % of the area, {percent(fractions['50'])} or less on half of it",
    ]
    if required is not None:
        lines.append(f"{'':18}{document['area_below_m2']:.0f} square metres below {percent(required)}")
    return lines
