"""The static scene, in the local frame and on the map: ground, area, fence, home, planned route.

The ground is a mesh with a relief map on it.
"""

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr
import shapely
from numpy.typing import NDArray

from uavcover.kernels.arrays import ByteArray, FloatArray
from uavcover.model.route import Route
from uavcover.recording import layout
from uavcover.recording.layout import SCENE, log_static, ui_points
from uavcover.scenario.airspace.flyable import zone_lines_m
from uavcover.scenario.site import Site
from uavcover.terrain.ground import Ground, relief_grid


@dataclass(frozen=True, eq=False)
class ReliefMesh:
    """A triangle mesh of the ground."""

    vertices_m: FloatArray  # (n, 3) ENU metres
    triangles: NDArray[np.uint32]  # (m, 3) uint32 numbers of vertices, counter-clockwise seen from above
    texture_places: FloatArray  # (n, 2) position of each vertex in the texture, 0..1 from its left and top
    texture: ByteArray  # (rows, columns, 3) uint8 RGB, north on top


def scene_bounds_m(site: Site) -> tuple[float, float, float, float]:
    """West, south, east, north of the displayed bounds: those of the fence."""
    west, south, east, north = site.fence.bounds
    return float(west), float(south), float(east), float(north)


def extent_m(bounds_m: tuple[float, float, float, float]) -> float:
    """Length of the longer side."""
    return max(bounds_m[2] - bounds_m[0], bounds_m[3] - bounds_m[1])


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
    places = np.column_stack([grid_e.ravel(), grid_n.ravel()])
    up = ground.heights_m(places)
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
    vertices = np.column_stack([places, np.where(known, up, 0.0)])
    return ReliefMesh(vertices, triangles, np.column_stack([across.ravel(), down.ravel()]), texture)


def log_scene(recording: rr.RecordingStream, site: Site, planned: Route | None, *, lift_m: float) -> None:
    """Log everything static except the cells; outlines are drawn ``lift_m`` above the ground."""
    bounds_m = scene_bounds_m(site)
    mesh = relief_mesh(site.ground, bounds_m)
    log_static(recording, layout.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    log_static(
        recording,
        layout.TERRAIN,
        rr.Mesh3D(
            vertex_positions=mesh.vertices_m,
            triangle_indices=mesh.triangles,
            vertex_texcoords=mesh.texture_places,
            albedo_texture=mesh.texture,
        ),
    )
    outlines = (
        (layout.AREA, "area", shapely.get_parts(site.area), layout.AREA_RGB),
        (layout.FENCE, "fence", [site.fence], layout.FENCE_RGB),
    )
    for entity, name, polygons, rgb in outlines:
        rings = [ring for polygon in polygons for ring in _rings_m(polygon)]
        draped = [_draped(site, ring, bounds_m, lift_m) for ring in rings]
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
    """(n, 2) latitude and longitude of (n, 3) ENU positions; none for a site that is not georeferenced."""
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
        for places in _rings_m(prism.footprint.polygon):
            foot, roof = _at_height(places, 0.0), _at_height(places, prism.top_m)
            foot[:, 2] = site.ground.heights_m(places)
            for k in range(len(places) - 1):
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
    roofs = [_at_height(ring, prism.top_m) for prism in site.prisms for ring in _rings_m(prism.footprint.polygon)]
    _log_map_lines(recording, site, "obstacles", roofs, rgb, width=1.0)


def _log_zones(recording: rr.RecordingStream, site: Site, bounds_m: tuple[float, float, float, float]) -> None:
    """No-fly zones as outlines, in the world and on the map."""
    lines = [line for zone in site.zones for line in zone_lines_m(site, zone, bounds_m)]
    if not lines:
        return
    log_static(recording, layout.NO_FLY, rr.LineStrips3D(lines, colors=[layout.NO_FLY_RGB], radii=ui_points(1.5)))
    _log_map_lines(recording, site, "no_fly", lines, layout.NO_FLY_RGB, width=2.0)


def _rings_m(polygon: shapely.Polygon) -> list[FloatArray]:
    """(n, 2) positions of the outline and of the holes."""
    return [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]


def _at_height(places_m: FloatArray, up_m: float) -> FloatArray:
    """(n, 3) positions at one height."""
    return np.column_stack([places_m[:, :2], np.full(len(places_m), up_m)])


def _draped(site: Site, ring_m: FloatArray, bounds_m: tuple[float, float, float, float], lift_m: float) -> FloatArray:
    """An (n, 2) ring draped over the ground in short pieces, slightly above it: (m, 3). Parts without data are omitted."""
    line = shapely.LineString(ring_m).segmentize(extent_m(bounds_m) / SCENE.outline_pieces_per_side)
    places = np.asarray(line.coords)
    up = site.ground.heights_m(places)
    known = np.isfinite(up)
    return np.column_stack([places, up + lift_m])[known]


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
    places = lat_lon_deg(site, points_m)
    if places is not None:
        log_static(
            recording,
            f"{layout.MAP}/{name}",
            rr.GeoPoints(lat_lon=places, colors=[rgb], radii=ui_points(size)),
        )
