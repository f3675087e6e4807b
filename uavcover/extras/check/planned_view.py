"""Coverage of an area by a checked mission's photos, counted as the planner and verification count."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from mission_io.model.items import Mission
from uavcover.errors import InputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.findings import CheckFinding
from uavcover.extras.check.flown_path import CONDITIONAL, DO_IT_AT_ONCE
from uavcover.extras.check.planned_photos import PlannedPhotos, Series, planned_photos
from uavcover.extras.check.tuning import PATH
from uavcover.extras.check.world import Aircraft, World
from uavcover.kernels.arrays import BoolArray
from uavcover.kernels.observation_counting import SensorPoses
from uavcover.model.area import Area, RasterTerrain, Rings
from uavcover.model.limits import FlightLimits, Home
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import FrameCamera
from uavcover.model.verdict import percent_beside
from uavcover.new.catalog import CAMERAS, CameraBody
from uavcover.new.quantities import overlaps
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import (
    OVERLAP_FRACTION,
    PhotoCounts,
    camera_axes,
    count_photos,
    drawn_cells,
    overlap_fraction,
    photos_required,
)
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.frames import Bounds, LocalFrame
from uavcover.terrain.ground import Ground
from uavcover.verification.gaps import cells_outline

GroundReader = Callable[[LocalFrame, Bounds], tuple[Ground, Ground | None]]
"""Reader of the occluding surface within west, south, east, north, and of the bare ground below a surface model."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewQuery:
    """Required coverage."""

    area: AreaQuery  # the ground
    camera: str  # name or file
    gsd_m: float | None = None  # largest ground sample distance that counts as observed; None: any
    overlap: str | None = None  # forward and side, as "75/70"; None: not judged
    coverage: float | None = None  # fraction of the area that has to be observed; None: not judged
    pitch_deg: float = -90.0  # of the camera where the mission does not say it
    always: Series | None = None  # photos that are taken beside those of the mission's items


@dataclass(frozen=True, slots=True, eq=False)
class MissionView:
    """Expected coverage."""

    document: dict[str, Any]  # figures for programs
    lines: tuple[str, ...]  # the same as text
    findings: tuple[CheckFinding, ...]  # what lacks
    unobserved_m: shapely.MultiPolygon  # (east, north) metres of what no photo shows
    photos: PlannedPhotos  # where they are taken


def planned_view(
    query: ViewQuery,
    mission: Mission,
    checked: Checked,
    aircraft: Aircraft,
    read_ground: GroundReader,
) -> MissionView | None:
    """Count what a checked mission's photos show; None where the mission has no path.

    Raises:
        UavcoverError: area, camera or elevation data cannot be used.
    """
    if checked.path is None or checked.world is None:
        return None
    camera = CAMERAS.named(query.camera)
    area = read_area(query.area)
    photos = planned_photos(
        mission, checked.path, checked.world, aircraft, pitch_deg=query.pitch_deg, always=query.always
    )
    coverage = _map(query, camera, area.parts, checked.world, photos, read_ground)
    axes, tops = camera_axes(photos.yaw_deg, photos.pitch_deg, np.zeros(len(photos.yaw_deg)))
    poses = SensorPoses(photos.positions_m, axes, tops, np.arange(len(axes), dtype=float))
    counts = count_photos(coverage, poses)
    observed = counts.photos > 0
    if query.gsd_m is not None:
        observed &= counts.ground_sample_m <= query.gsd_m
    return _view(query, camera, coverage, counts, photos, observed)


def _map(
    query: ViewQuery,
    camera: CameraBody,
    parts: tuple[Rings, ...],
    world: World,
    photos: PlannedPhotos,
    read_ground: GroundReader,
) -> CoverageMap:
    """The area's cells in the mission's frame, with the ground under area and photos."""
    ring = world.frame.en_from_lon_lat
    outline = shapely.union_all(
        [shapely.Polygon(ring(outer), [ring(hole) for hole in holes]) for outer, *holes in parts]
    )
    if not isinstance(outline, shapely.Polygon | shapely.MultiPolygon) or outline.is_empty:
        raise InputError("--area: the file contains no area; use a file with polygons")
    away_m = float(shapely.distance(outline, shapely.Point(0.0, 0.0)))
    if away_m > 50_000.0:
        raise InputError(f"--area: the area is {away_m / 1000.0:.0f} km from home; are latitude and longitude swapped?")
    cell_m = round(max(math.sqrt(outline.area / PATH.cells), PATH.finest_cell_m), 1)
    west, south, east, north = shapely.union_all([outline, shapely.MultiPoint(photos.positions_m[:, :2])]).bounds
    around_m = PATH.view_around_m
    bounds = (west - around_m, south - around_m, east + around_m, north + around_m)
    ground, bare = read_ground(world.frame, bounds)
    forward, side = (None, 0.0) if query.overlap is None else overlaps(query.overlap)
    sensor = FrameCamera(
        kind="frame-camera", fov_across_deg=camera.fov_across_deg, fov_along_deg=camera.fov_along_deg,
        range_m=_range_m(camera, photos, bare or ground), max_incidence_deg=PATH.most_oblique_deg, mount="stabilised",
        pixels_across=camera.pixels_across, forward_overlap=forward, side_overlap=side,
    )  # fmt: skip
    scenario = Scenario(
        name="area",
        area=Area(cell_size_m=cell_m, fewest_places=0, polygons_lon_lat_deg=parts),
        terrain=RasterTerrain(kind="raster", file="-", vertical_datum="EGM96"),
        sensor=sensor,
        limits=FlightLimits(min_height_agl_m=0.0, max_height_agl_m=sensor.range_m),
        home=Home(lat_deg=world.frame.lat_deg, lon_deg=world.frame.lon_deg),
    )
    return judging_map(Site(scenario, world.frame, ground, outline, shapely.box(*bounds), None, ground_model=bare))


def _range_m(camera: CameraBody, photos: PlannedPhotos, ground: Ground) -> float:
    """Largest distance of any photo's farthest corner from the camera, over ground as low as any."""
    if not len(photos.positions_m):
        return 100.0
    highest_m = float(photos.positions_m[:, 2].max() - np.nanmin(ground.surface.up_m))
    half_angles = (0.5 * camera.fov_across_deg, 0.5 * camera.fov_along_deg)
    corner_deg = math.degrees(math.atan(math.hypot(*(math.tan(math.radians(each)) for each in half_angles))))
    lean_deg = min(float(np.max(90.0 + photos.pitch_deg)) + corner_deg, PATH.most_oblique_deg)
    return max(20.0, highest_m / math.cos(math.radians(lean_deg)))


def _view(
    query: ViewQuery,
    camera: CameraBody,
    coverage: CoverageMap,
    counts: PhotoCounts,
    photos: PlannedPhotos,
    observed: BoolArray,
) -> MissionView:
    drawn, weight = drawn_cells(coverage), coverage.grid.weight_m2
    hidden_m2 = coverage.grid.hidden_m2
    area_m2 = float(weight[drawn].sum()) + hidden_m2
    fraction = float(weight[drawn & observed].sum() / area_m2) if drawn.any() else 0.0
    number = counts.photos[drawn]
    sample_m = counts.ground_sample_m[drawn & (counts.photos > 0)]
    sample_m = sample_m[np.isfinite(sample_m)]
    required = None if query.overlap is None else photos_required(coverage.site.scenario.sensor)
    enough = None if required is None else overlap_fraction(coverage, counts)
    document = {
        "camera": camera.name, "pictures": counts.taken, "area_m2": area_m2, "hidden_m2": hidden_m2,
        "cell_size_m": coverage.site.scenario.area.cell_size_m,
        "coverage_fraction": fraction, "unseen_m2": float(weight[drawn & ~observed].sum()) + hidden_m2,
        "pictures_fewest": int(number.min(initial=np.iinfo(np.int32).max)) if number.size else 0,
        "pictures_median": float(np.median(number)) if number.size else 0.0,
        "ground_sample_median_m": float(np.median(sample_m)) if sample_m.size else None,
        "ground_sample_p95_m": float(np.percentile(sample_m, 95.0)) if sample_m.size else None,
        "pictures_asked": required, "overlap_fraction": enough,
        "overlap_holds": None if enough is None else enough >= OVERLAP_FRACTION,
        "notes": list(photos.notes),
    }  # fmt: skip
    unobserved = np.flatnonzero(drawn & ~observed)
    outline = cells_outline(coverage, unobserved) if len(unobserved) else shapely.MultiPolygon()
    findings = _findings(query, camera, document, photos, outline, coverage.site.frame)
    return MissionView(document, _lines(document), tuple(findings), outline, photos)


def _lines(document: dict[str, Any]) -> tuple[str, ...]:
    lines = [
        f"{document['pictures']} photos would show {100.0 * document['coverage_fraction']:.1f} % "
        f"of {document['area_m2'] / 1e4:.4g} ha"
    ]
    if document["hidden_m2"] > 0.0:
        lines.append(
            f"trees and roofs hide {100.0 * document['hidden_m2'] / document['area_m2']:.1f} % of the area from all photos"
        )
    if document["ground_sample_median_m"] is not None:
        lines.append(
            f"photos of a point: {document['pictures_median']:g} (median), at least {document['pictures_fewest']}; "
            f"ground sample distance: {100.0 * document['ground_sample_median_m']:.2f} cm (median), 95 % below "
            f"{100.0 * document['ground_sample_p95_m']:.2f} cm"
        )
    if document["overlap_fraction"] is not None:
        holds = "is achieved" if document["overlap_holds"] else "is not achieved"
        lines.append(
            f"the required overlap {holds}: {100.0 * document['overlap_fraction']:.1f} % of the area is in "
            f"{document['pictures_asked']} photos or more"
        )
    return (*lines, *document["notes"])


def _findings(
    query: ViewQuery, camera: CameraBody, document: dict[str, Any], photos: PlannedPhotos, unobserved: shapely.MultiPolygon,
    frame: LocalFrame | None,
) -> list[CheckFinding]:  # fmt: skip
    found = []
    if document["pictures"] == 0:
        what = "no item of the mission takes a photo"
        do = "insert camera items, or specify the camera's own interval with --picture-every"
        found.append(CheckFinding(kind="pictures", weight="breaks", what=what, do=do))
    if numbers := photos.conditional:
        ends = min(numbers), max(numbers)
        found.append(CheckFinding(kind="pictures", weight="unknown", items=ends, what=CONDITIONAL, do=DO_IT_AT_ONCE))
    if query.coverage is not None and document["coverage_fraction"] < query.coverage:
        would = percent_beside(document["coverage_fraction"], query.coverage)
        what = f"{would} of the area would be covered; {100.0 * query.coverage:g} % is required"
        do = "add swaths over the missing areas (see --map)"
        one = CheckFinding(kind="coverage", weight="breaks", what=what, do=do)
        if frame is not None and not unobserved.is_empty:
            widest = max(unobserved.geoms, key=lambda part: part.area).representative_point()
            lat, lon, _ = frame.geodetic_from_enu(np.array([[widest.x, widest.y, 0.0]]))
            one = replace(one, lat_deg=float(lat[0]), lon_deg=float(lon[0]))
        found.append(one)
    if document["overlap_holds"] is False:
        what = (
            f"{percent_beside(document['overlap_fraction'], OVERLAP_FRACTION)} of the area is in "
            f"{document['pictures_asked']} photos or more; {100.0 * OVERLAP_FRACTION:g} % is required for an overlap "
            f"of {query.overlap}"
        )
        do = "fly swaths closer together, or take photos more often"
        found.append(CheckFinding(kind="overlap", weight="breaks", what=what, do=do))
    if camera.min_interval_s is not None and photos.least_gap_s < camera.min_interval_s - 1e-6:
        items, short_s = (photos.least_gap_item,) * 2, camera.min_interval_s - photos.least_gap_s
        what = f"a photo every {photos.least_gap_s:.2f} s, but {camera.name} needs {camera.min_interval_s:g} s between photos"
        do = "fly slower, or take fewer photos"
        found.append(
            CheckFinding(kind="pictures", weight="breaks", items=items, by=short_s, unit="s", what=what, do=do)
        )
    return found
