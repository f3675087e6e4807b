"""The static parts of a recording: the scene, in the local frame and on the map, and the layout of the views.

The ground is a mesh with a relief map on it.
"""

import math
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import shapely
from numpy.typing import NDArray

from uavcover.kernels.arrays import ByteArray, FloatArray
from uavcover.model.route import Route
from uavcover.recording import layout
from uavcover.recording.layout import SCENE, VIEWS, log_static, ui_points
from uavcover.scenario.airspace.flyable import zone_lines_m
from uavcover.scenario.obstacles import rings_m
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.ground import Ground, relief_grid


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """A triangle mesh of the ground."""

    vertices_m: FloatArray  # (n, 3) ENU metres
    triangles: NDArray[np.uint32]  # (m, 3) uint32 numbers of vertices, counter-clockwise seen from above
    texture_positions: FloatArray  # (n, 2) position of each vertex in the texture, 0..1 from its left and top
    texture: ByteArray  # (rows, columns, 3) uint8 RGB, north on top


def scene_bounds_m(site: Site) -> tuple[float, float, float, float]:
    """West, south, east, north of the displayed bounds: those of the fence."""
    west, south, east, north = site.fence.bounds
    return float(west), float(south), float(east), float(north)


def extent_m(bounds_m: tuple[float, float, float, float]) -> float:
    """Length of the longer side."""
    return max(bounds_m[2] - bounds_m[0], bounds_m[3] - bounds_m[1])


def lift_m(coverage: CoverageMap) -> float:
    """Height above ground at which cells are drawn, above the drawn terrain; lines use twice that."""
    return 0.1 * coverage.grid.cells.size_m + 0.001 * extent_m(scene_bounds_m(coverage.site))


def relief_mesh(ground: Ground, bounds_m: tuple[float, float, float, float]) -> ReliefMesh:
    """Sample the ground over a rectangle; squares that touch missing data are omitted.

    Args:
        ground: any surface.
        bounds_m: west, south, east, north, metres.
    """
    west, south, east, north = bounds_m
    step_m = extent_m(bounds_m) / (SCENE.max_nodes_per_side - 1)
    e = np.linspace(west, east, max(2, math.ceil((east - west) / step_m) + 1))
    n = np.linspace(south, north, max(2, math.ceil((north - south) / step_m) + 1))
    grid_e, grid_n = np.meshgrid(e, n)
    positions = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up = ground.heights_m(positions)
    number = np.arange(up.size, dtype=np.uint32).reshape(grid_e.shape)
    sw, se, nw, ne = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    triangles = np.concatenate([np.stack([sw, se, ne], -1).reshape(-1, 3), np.stack([sw, ne, nw], -1).reshape(-1, 3)])
    known = np.isfinite(up)
    triangles = triangles[known[triangles].all(axis=1)]
    texture = relief_grid(ground, bounds_m, nodes=SCENE.texture_pixels).rgb[::-1]
    # The centres of the texture's outer pixels lie on the edge of the rectangle.
    rows, columns = texture.shape[:2]
    across = (0.5 + (grid_e - west) / (east - west) * (columns - 1)) / columns
    down = (0.5 + (north - grid_n) / (north - south) * (rows - 1)) / rows
    vertices = np.column_stack([positions, np.where(known, up, 0.0)])
    return ReliefMesh(vertices, triangles, np.column_stack([across.ravel(), down.ravel()]), texture)


def _log_scene(recording: rr.RecordingStream, coverage: CoverageMap, planned: Route | None) -> None:
    """Log everything static except the cells."""
    site, line_lift_m = coverage.site, 2.0 * lift_m(coverage)
    bounds_m = scene_bounds_m(site)
    mesh = relief_mesh(site.ground, bounds_m)
    log_static(recording, layout.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log_static(
        recording,
        layout.TERRAIN,
        rr.Mesh3D(
            vertex_positions=mesh.vertices_m,
            triangle_indices=mesh.triangles,
            vertex_texcoords=mesh.texture_positions,
            albedo_texture=mesh.texture,
        ),
    )
    outlines = (
        (layout.AREA, "area", shapely.get_parts(site.area), layout.AREA_RGB),
        (layout.FENCE, "fence", [site.fence], layout.FENCE_RGB),
    )
    for entity, name, polygons, rgb in outlines:
        rings = [ring for polygon in polygons for ring in rings_m(polygon)]
        draped = [_draped(site, ring, bounds_m, line_lift_m) for ring in rings]
        log_static(recording, entity, rr.LineStrips3D(draped, colors=[rgb], radii=ui_points(1.5)))
        _log_map_lines(recording, site, name, draped, rgb, width=1.5)
    if site.zones:
        _log_zones(recording, site, bounds_m)
    if site.prisms:
        _log_obstacles(recording, site)
    if site.home_m is not None:
        log_static(
            recording,
            layout.HOME,
            rr.Points3D([site.home_m], colors=[layout.HOME_RGB], radii=ui_points(7.0), labels=["home"]),
        )
        _log_map_points(recording, site, "home", site.home_m[None, :], layout.HOME_RGB, size=7.0)
    if planned is not None and len(planned) > 0:
        _log_planned(recording, site, planned)


def lat_lon_deg(site: Site, enu_m: FloatArray) -> FloatArray | None:
    """(n, 2) latitude and longitude of (n, 3) ENU positions; None for a site that is not georeferenced."""
    return None if site.frame is None else np.column_stack(site.frame.geodetic_from_enu(enu_m)[:2])


def waypoint_labels(count: int) -> list[str]:
    """Numbers as in ``plan.json``, thinned out when there are too many."""
    step = next(s for m in range(10) for s in (10**m, 2 * 10**m, 5 * 10**m) if math.ceil(count / s) <= SCENE.max_labels)
    return [str(i) if i % step == 0 or i == count - 1 else "" for i in range(count)]


def _log_planned(recording: rr.RecordingStream, site: Site, planned: Route) -> None:
    points, lines = planned.waypoints_m, [part.waypoints_m for part in planned.parts]
    rgb = layout.PLANNED_RGB
    log_static(recording, layout.PLANNED, rr.LineStrips3D(lines, colors=[rgb], radii=ui_points(0.8)))
    log_static(
        recording,
        layout.WAYPOINTS,
        rr.Points3D(points, colors=[rgb], radii=ui_points(3.0), labels=waypoint_labels(len(points)), show_labels=True),
    )
    _log_map_lines(recording, site, "planned", lines, rgb, width=1.0)
    _log_map_points(recording, site, "planned/waypoints", points, rgb, size=3.0)


def obstacle_triangles_m(site: Site) -> FloatArray:
    """(3 k, 3) corners of the triangles of every obstacle: its flat roof, and its walls from the ground up."""
    corners: list[FloatArray] = []
    for prism in site.prisms:
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(prism.footprint.polygon)):
            corners.append(_at_height(np.asarray(triangle.exterior.coords)[:3], prism.top_m))
        for positions in rings_m(prism.footprint.polygon):
            foot, roof = _at_height(positions, 0.0), _at_height(positions, prism.top_m)
            foot[:, 2] = site.ground.heights_m(positions)
            for k in range(len(positions) - 1):
                corners.append(np.stack([foot[k], foot[k + 1], roof[k]]))
                corners.append(np.stack([roof[k], foot[k + 1], roof[k + 1]]))
    return np.concatenate(corners)


def _log_obstacles(recording: rr.RecordingStream, site: Site) -> None:
    """Obstacles as blocks, and their outlines on the map."""
    vertices, rgb = obstacle_triangles_m(site), layout.OBSTACLE_RGB
    log_static(
        recording,
        layout.OBSTACLES,
        rr.Mesh3D(
            vertex_positions=vertices,
            triangle_indices=np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3),
            vertex_colors=np.tile(np.array(rgb, dtype=np.uint8), (len(vertices), 1)),
        ),
    )
    roofs = [_at_height(ring, prism.top_m) for prism in site.prisms for ring in rings_m(prism.footprint.polygon)]
    _log_map_lines(recording, site, "obstacles", roofs, rgb, width=1.0)


def _log_zones(recording: rr.RecordingStream, site: Site, bounds_m: tuple[float, float, float, float]) -> None:
    """No-fly zones as outlines, in the world and on the map."""
    lines = [line for zone in site.zones for line in zone_lines_m(site, zone, bounds_m)]
    if not lines:
        return
    log_static(recording, layout.NO_FLY, rr.LineStrips3D(lines, colors=[layout.NO_FLY_RGB], radii=ui_points(1.5)))
    _log_map_lines(recording, site, "no_fly", lines, layout.NO_FLY_RGB, width=2.0)


def _at_height(positions_m: FloatArray, up_m: float) -> FloatArray:
    """(n, 3) positions at one height."""
    return np.column_stack([positions_m[:, :2], np.full(len(positions_m), up_m)])


def _draped(site: Site, ring_m: FloatArray, bounds_m: tuple[float, float, float, float], lift_m: float) -> FloatArray:
    """An (n, 2) ring draped over the ground in short pieces, slightly above it: (m, 3). Parts without data are omitted."""
    line = shapely.LineString(ring_m).segmentize(extent_m(bounds_m) / SCENE.outline_pieces_per_side)
    positions = np.asarray(line.coords)
    up = site.ground.heights_m(positions)
    known = np.isfinite(up)
    return np.column_stack([positions, up + lift_m])[known]


def _log_map_lines(
    recording: rr.RecordingStream,
    site: Site,
    name: str,
    lines_m: list[FloatArray],
    rgb: layout.Rgb,
    *,
    width: float,
) -> None:
    if site.frame is None:
        return
    strings = [np.column_stack(site.frame.geodetic_from_enu(line)[:2]) for line in lines_m]
    log_static(
        recording,
        f"{layout.MAP}/{name}",
        rr.GeoLineStrings(lat_lon=strings, colors=[rgb], radii=ui_points(width)),
    )


def _log_map_points(
    recording: rr.RecordingStream, site: Site, name: str, points_m: FloatArray, rgb: layout.Rgb, *, size: float
) -> None:
    positions = lat_lon_deg(site, points_m)
    if positions is not None:
        log_static(
            recording,
            f"{layout.MAP}/{name}",
            rr.GeoPoints(lat_lon=positions, colors=[rgb], radii=ui_points(size)),
        )


_NAMESPACE = uuid.UUID("6f1c1a52-6d0b-4a55-8f3d-6b1a1c0e7d11")
_BACKGROUND_RGB = (18, 20, 26)
_EARTH_CIRCUMFERENCE_M = 40_075_016.0

LEGEND_TEXT = """
| colour | meaning |
|---|---|
| green | observed cells |
| grey | cells not observed yet |
| purple | cells not visible from any allowed position |
| white line, numbers | the planned route and its waypoints |
| yellow line | the path flown so far |
| red arrow | the vehicle and its yaw |
| pale cone | the camera's view, turned with the vehicle unless it is stabilised |
| cyan ring | ground inside the sensor's field of view |
| blue outline | the area |
| orange outline | the fence |
| violet blocks | obstacles |
| magenta outlines | no-fly zones: floor, ceiling, corners |
| red line over the heights | the maximum height above ground |
| violet line over the heights | the minimum height above ground |
"""


def make_blueprint(
    site: Site, *, span_s: tuple[float, float] | None, paths: Sequence[str] = (layout.FLOWN,)
) -> rrb.Blueprint:
    """The default blueprint of a recording.

    Args:
        site: determines the camera, and whether there is a map.
        span_s: vehicle time at the start and at the end of the flight; None for an ongoing flight, whose latest moment is shown.
        paths: entities of flown paths, which are drawn as far as they are flown.
    """
    words: list[rrb.ContainerLike] = [
        _events_view(),
        rrb.TextDocumentView(origin=layout.LEGEND, name="Colours"),
    ]
    below: rrb.ContainerLike = rrb.Tabs(*words, active_tab=0)
    if site.frame is not None:
        below = rrb.Horizontal(_map_view(site), below)
    whole = None
    if span_s is not None:
        start, end = (rrb.TimeRangeBoundary.absolute(seconds=at_s) for at_s in span_s)
        whole = rr.TimeRange(start=start, end=end)
    root = rrb.Horizontal(
        _scene_view(site, paths),
        rrb.Vertical(
            _series_view("height", "Height above ground", whole),
            _series_view("coverage", "Coverage, percent", whole, (0.0, 102.0)),
            rrb.Tabs(
                _series_view("speed", "Speed", whole),
                _series_view("battery", "Battery", whole),
                _series_view("link", "Link", whole),
                active_tab=0,
            ),
            below,
            row_shares=[3.0, 3.0, 2.0, 4.0],
        ),
        column_shares=[3.0, 2.0],
    )
    for number, part in enumerate(_parts(root)):
        # Random by default, so two recordings of one flight would differ.
        part.id = uuid.uuid5(_NAMESPACE, str(number))
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=layout.TIMELINE,
            playback_speed=1.0 if span_s is None else max(1.0, (span_s[1] - span_s[0]) / VIEWS.played_in_s),
            play_state="following" if span_s is None else "playing",
        ),
        auto_layout=False,
        auto_views=False,
    )


def begin_recording(
    recording: rr.RecordingStream, coverage: CoverageMap, planned: Route | None, *, name: str,
    span_s: tuple[float, float] | None, paths: Sequence[str] = (layout.FLOWN,),
) -> None:  # fmt: skip
    """Log the layout, the name, the legend and the scene of a recording; see :func:`make_blueprint`."""
    site = coverage.site
    recording.send_blueprint(make_blueprint(site, span_s=span_s, paths=paths), make_active=False, make_default=True)
    recording.send_recording_name(name)
    layout.log_static(recording, layout.LEGEND, rr.TextDocument(LEGEND_TEXT, media_type="text/markdown"))
    _log_scene(recording, coverage, planned)


def _parts(part: rrb.Container | rrb.View) -> Iterator[rrb.Container | rrb.View]:
    yield part
    if isinstance(part, rrb.Container):
        for inner in part.contents:
            yield from _parts(inner)


def _so_far() -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(
        timeline=layout.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _scene_view(site: Site, paths: Sequence[str]) -> rrb.Spatial3DView:
    west, south, east, north = bounds = scene_bounds_m(site)
    rim = np.array([[e, n] for e in np.linspace(west, east, 9) for n in np.linspace(south, north, 9)])
    up = site.ground.heights_m(rim)
    middle = np.array([(west + east) / 2.0, (south + north) / 2.0, float(np.nanmean(up))])
    reach = extent_m(bounds)
    return rrb.Spatial3DView(
        origin=layout.WORLD,
        name=site.scenario.name,
        background=_BACKGROUND_RGB,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=middle + reach * np.array([-0.42, -1.0, 0.9]),
            look_target=middle,
            eye_up=(0.0, 0.0, 1.0),
        ),
        overrides={path: _so_far() for path in paths},
    )


def _series_view(
    folder: str, name: str, whole: rr.TimeRange | None, value_range: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"{layout.SERIES}/{folder}",
        name=name,
        axis_x=None if whole is None else rrb.TimeAxis(view_range=whole),
        axis_y=None if value_range is None else rrb.ScalarAxis(range=value_range),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightBottom),
    )


def _events_view() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin=layout.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[layout.TIMELINE], text_log_columns=["loglevel", "body"]),
    )


def _map_view(site: Site) -> rrb.MapView:
    lat_deg = 0.0 if site.frame is None else site.frame.lat_deg
    circle_m = _EARTH_CIRCUMFERENCE_M * math.cos(math.radians(lat_deg))
    zoom = math.log2(circle_m / VIEWS.tile_pixels * VIEWS.map_pixels / extent_m(scene_bounds_m(site)))
    return rrb.MapView(
        origin=layout.MAP,
        name="Map",
        zoom=min(zoom, 19.0),
        background=rrb.MapProvider.OpenStreetMap,
        overrides={layout.MAP_FLOWN: _so_far()},
    )
