"""Lay a line on the map over the terrain, around no-fly zones and tall obstacles; join routes by such lines.

A line over steep ground may exceed the climb limit or leave the height band. Its feasible stretches are joined by paths over a
lattice of positions inside the height band. Such a path follows a contour or climbs in zigzags.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial

import numpy as np
import scipy
import shapely
from shapely.ops import nearest_points, substring

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.profile import follow_terrain
from uavcover.kernels.search_problem import SearchProblem, allowed_legs
from uavcover.kernels.tours import nearest, shorten
from uavcover.model.route import Route
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.airspace.lattice import Lattice
from uavcover.scenario.airspace.zones import PathAround
from uavcover.scenario.obstacles import Prism
from uavcover.scenario.site import Site, once

PLAIN_TOLERANCE_M = 10.0
"""Default deviation of straight legs from their height over the terrain."""

_MARGIN_M = 0.05
"""Tolerance for rounding."""
_SHORTEST_CROSSING_M = 1e-6
_SAMPLES = 64


def around_obstacles(
    site: Site, polyline_m: FloatArray, wanted_agl_m: FloatArray, *, apart_m: float
) -> tuple[FloatArray, FloatArray]:
    """Route a line on the map around obstacles that cannot be overflown, along the shorter side of each.

    Corners inside the clearance of such an obstacle move to its edge. Where nothing is too tall, the line as it is.

    Args:
        site: the scenario on its ground.
        polyline_m: (n, 2) east, north corners.
        wanted_agl_m: (n,) wanted height above ground at the corners, linear between them.
        apart_m: additional distance beyond the clearance.

    Returns:
        (m, 2) corners, and (m,) wanted heights.
    """
    zone = _keep_out(site, apart_m)
    if zone.is_empty or not zone.intersects(shapely.LineString(polyline_m)):
        return polyline_m, wanted_agl_m
    corners = [_outside(zone, corner) for corner in polyline_m]
    positions, heights = [corners[0]], [float(wanted_agl_m[0])]
    for k in range(1, len(corners)):
        detour = _detour(zone, corners[k - 1], corners[k])
        legs = np.hypot(*np.diff(detour, axis=0).T)
        along = np.cumsum(legs) / max(float(legs.sum()), _SHORTEST_CROSSING_M)
        positions += list(detour[1:])
        heights += list(wanted_agl_m[k - 1] + along * (wanted_agl_m[k] - wanted_agl_m[k - 1]))
    return np.array(positions), np.array(heights)


@lru_cache(maxsize=8)
def _keep_out(site: Site, apart_m: float) -> shapely.MultiPolygon:
    """Zones to fly around: footprints with their clearance, merged, without courtyards."""
    beside_m = site.scenario.obstacles.clearance_beside_m + apart_m + _MARGIN_M
    # Mitred corners keep the clearance everywhere; the chords of round corners would not.
    grown = [prism.footprint.polygon.buffer(beside_m, join_style="mitre") for prism in site.prisms]
    tall = [polygon for polygon, prism in zip(grown, site.prisms, strict=True) if _is_too_tall(site, prism, polygon)]
    parts = shapely.get_parts(shapely.union_all(tall))
    return shapely.MultiPolygon([shapely.Polygon(part.exterior) for part in parts])


def _is_too_tall(site: Site, prism: Prism, grown: shapely.Polygon) -> bool:
    """Whether part of the height band around an obstacle is too low to clear it."""
    limits = site.scenario.limits
    ring = shapely.get_coordinates(shapely.segmentize(grown.exterior, grown.exterior.length / _SAMPLES))
    lowest_ground = float(np.nanmin(site.ground.heights_m(ring), initial=np.inf))
    ceiling = lowest_ground + limits.max_height_agl_m - limits.height_margin_m
    return prism.top_m + site.scenario.obstacles.clearance_above_m > ceiling


def _outside(zone: shapely.MultiPolygon, corner: FloatArray) -> FloatArray:
    point = shapely.Point(corner)
    if not zone.contains(point):
        return corner
    return np.asarray(nearest_points(zone.boundary, point)[0].coords[0])


def _detour(zone: shapely.MultiPolygon, a: FloatArray, b: FloatArray) -> FloatArray:
    """(k, 2) corners from a to b, both outside the zone, along the edges of the polygons in between."""
    line = shapely.LineString([a, b])
    path = [np.asarray(a)]
    crossed = [part for part in zone.geoms if part.intersection(line).length > _SHORTEST_CROSSING_M]
    for part in sorted(crossed, key=lambda part: line.project(shapely.Point(part.intersection(line).bounds[:2]))):
        inside = shapely.get_coordinates(part.intersection(line))
        order = np.argsort(np.hypot(*(inside - a).T))
        ring = shapely.LineString(part.exterior.coords)
        path += list(_along(ring, inside[order[0]], inside[order[-1]]))
    return np.array([*path, np.asarray(b)])


def _along(ring: shapely.LineString, entry: FloatArray, exit_: FloatArray) -> FloatArray:
    """The shorter way (k, 2) along a ring between two places on it."""
    begin, end = (ring.project(shapely.Point(position)) for position in (entry, exit_))
    direct = shapely.get_coordinates(substring(ring, begin, end))
    low, high = sorted((begin, end))
    rest = np.vstack(
        [
            shapely.get_coordinates(substring(ring, high, ring.length)),
            shapely.get_coordinates(substring(ring, 0.0, low)),
        ]
    )
    rest = rest if begin > end else rest[::-1]
    return direct if high - low <= 0.5 * ring.length else rest


def inside_flyable_area(site: Site, polyline_m: FloatArray, wanted_agl_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Route a line on the map around no-fly zones that meet the height band, and around the bays of the fence.

    Corners outside the permitted area move to its edge. A line without obstacles does not change.

    Args:
        site: the scenario on its ground.
        polyline_m: (n, 2) east, north corners.
        wanted_agl_m: (n,) wanted height above ground at the corners, linear between them.

    Returns:
        (m, 2) corners, and (m,) wanted heights.
    """
    if not _has_bays(site):
        return polyline_m, wanted_agl_m
    paths = flyable_paths(site)
    corners = [paths.inside(corner) for corner in polyline_m]
    positions, heights = [corners[0]], [float(wanted_agl_m[0])]
    for k in range(1, len(corners)):
        if np.array_equal(corners[k], corners[k - 1]) and not np.array_equal(polyline_m[k], polyline_m[k - 1]):
            continue
        path = paths.along(corners[k - 1], corners[k])
        if path is None:
            path = np.array([corners[k - 1], corners[k]])
        legs = np.hypot(*np.diff(path, axis=0).T)
        along = np.cumsum(legs) / max(float(legs.sum()), _SHORTEST_CROSSING_M)
        positions += list(path[1:])
        heights += list(wanted_agl_m[k - 1] + along * (wanted_agl_m[k] - wanted_agl_m[k - 1]))
    return np.array(positions), np.array(heights)


@once
def _has_bays(site: Site) -> bool:
    """Whether a line between two places inside the flyable area may leave it."""
    polygon = flyable_area(site).polygon
    return not polygon.is_empty and (bool(site.zones) or polygon.convex_hull.area - polygon.area >= _MARGIN_M)


@once
def flyable_paths(site: Site) -> PathAround:
    """Paths inside the flyable area."""
    return PathAround(flyable_area(site).polygon)


SAMPLE_SPACING_M = 5.0
HAIR_M = 1e-6
"""Free part of the band at both ends, for rounding."""


def lay_over_terrain(
    site: Site,  # the scenario on its ground
    polyline_m: FloatArray,  # (n, 2) east, north corners
    wanted_agl_m: FloatArray,  # (n,) wanted height above ground at the corners
    *,
    tolerance_m: float,  # permitted deviation of the straight chords from the wanted height
    # of the samples of the ground. At a cliff close ones leave more of the band: each gives up what the ground between
    # it and the next one rises or falls beside their chord.
    spacing_m: float = SAMPLE_SPACING_M,
) -> FloatArray:
    """Waypoints over the terrain along a line on the map, inside the scenario's band and climb limit if possible.

    They lead over obstacles, around obstacles taller than the band, and around no-fly zones that meet the band.

    Returns:
        (m, 3) ENU waypoints, corners among them. Heights without data are read from the neighbours, so that they are finite
        and the route can be compared with others; the leg checks report the missing data.
    """
    if len(polyline_m) == 0:
        return np.empty((0, 3))
    polyline_m, wanted_agl_m = inside_flyable_area(site, polyline_m, wanted_agl_m)
    only_one = len(polyline_m) == 1
    if only_one:
        # The whole line has moved to one corner of the permitted area.
        polyline_m, wanted_agl_m = np.repeat(polyline_m, 2, axis=0), np.repeat(wanted_agl_m, 2)
    # One sample farther away, nothing is raised over an obstacle.
    polyline_m, wanted_agl_m = around_obstacles(site, polyline_m, wanted_agl_m, apart_m=SAMPLE_SPACING_M)
    limits = site.scenario.limits
    # Here, heights are checked between samples; the evaluation checks whole legs.
    hair_m = HAIR_M + site.ground.cut_error_m
    points = follow_terrain(
        site.ground.surface,
        np.ascontiguousarray(polyline_m, dtype=float),
        np.ascontiguousarray(wanted_agl_m, dtype=float),
        limits.min_height_agl_m + limits.height_margin_m + hair_m,
        limits.max_height_agl_m - limits.height_margin_m - hair_m,
        # Slightly below the limit, for rounding.
        math.tan(math.radians(limits.max_climb_angle_deg)) * (1.0 - 1e-9),
        max(tolerance_m, 0.0),
        spacing_m,
        site.scenario.obstacles.clearance_beside_m,
        site.scenario.obstacles.clearance_above_m,
    )
    return finite_heights(points[:1] if only_one else points)


def finite_heights(points_m: FloatArray) -> FloatArray:
    """(n, 3) points with every missing height read from its neighbours in the row; 0 when all are missing."""
    known = np.isfinite(points_m[:, 2])
    if known.all():
        return points_m
    filled = points_m.copy()
    numbers = np.arange(len(points_m))
    filled[:, 2] = np.interp(numbers, numbers[known], points_m[known, 2]) if known.any() else 0.0
    return filled


def allowed_band_m(site: Site, positions_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest permitted up coordinate (n,) at (n, 2) positions; lowest exceeds highest if none is permitted."""
    limits = site.scenario.limits
    low = site.ground.ups_m(positions_m, limits.min_height_agl_m + limits.height_margin_m)
    high = site.ground.ups_m(positions_m, limits.max_height_agl_m - limits.height_margin_m)
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        ground = site.ground.heights_m(positions_m)
        sea = ground - site.alts_amsl_m(np.column_stack([positions_m, ground]))
        if limits.min_alt_amsl_m is not None:
            low = np.maximum(low, limits.min_alt_amsl_m + sea)
        if limits.max_alt_amsl_m is not None:
            high = np.minimum(high, limits.max_alt_amsl_m + sea)
    return low, high


_KICKS_PER_END = 40
_NEAR = 20
_STEEP = 4.0
"""Extra cost of a link that is too steep, as a multiple of the longest link."""


def joined(site: Site, routes_m: Sequence[FloatArray]) -> FloatArray:
    """(n, 3) waypoints of routes in their order, with links between them that follow the terrain.

    Args:
        site: the scenario on its ground.
        routes_m: one at least, each (k, 3) ENU.
    """
    out = [routes_m[0]]
    for before, behind in itertools.pairwise(routes_m):
        ends = np.vstack([before[-1], behind[0]])
        link = lay_over_terrain(site, ends[:, :2], site.ground.heights_agl_m(ends), tolerance_m=PLAIN_TOLERANCE_M)
        out += [link[1:-1], behind]
    return np.vstack(out)


def in_good_order(
    routes_m: Sequence[FloatArray], home_m: FloatArray | None, *, max_climb_angle_deg: float = 90.0
) -> list[FloatArray]:
    """The routes in an order, and each in a direction, that makes the links between them short.

    With a home, a flight may end between two routes; a link then costs itself and the transit from the nearer of its ends. The
    open tour through all ends, with each route as a fixed link, is shortened by :func:`uavcover.kernels.tours.shorten`. Flights
    begin and end close together around home at different heights, so a link that is too steep is used only without an
    alternative.

    Args:
        routes_m: each (k, 3) ENU.
        home_m: (3,) take-off position; None without one.
        max_climb_angle_deg: steepest link.
    """
    count = len(routes_m)
    if count == 1:
        return list(routes_m)
    ends = np.array([route[k] for route in routes_m for k in (0, -1)])
    distance = np.linalg.norm(ends[:, None] - ends[None], axis=2)
    if home_m is not None:
        away = np.linalg.norm(ends - home_m, axis=1)
        distance = distance + 2.0 * np.minimum(away[:, None], away[None])
    level_m = np.linalg.norm(ends[:, None, :2] - ends[None, :, :2], axis=2)
    climb_m = np.abs(ends[:, None, 2] - ends[None, :, 2])
    steep = climb_m > level_m * math.tan(math.radians(max_climb_angle_deg))
    distance[steep] += _STEEP * (1.0 + float(distance.max()))
    free = 2 * count  # a position near all others, where the tour is open
    links = np.zeros((free + 1, free + 1))
    links[:free, :free] = distance
    if home_m is not None:
        links[:free, free] = links[free, :free] = away
    stay = -10.0 * (float(links.max()) + 1.0)
    for k in range(count):
        links[2 * k, 2 * k + 1] = links[2 * k + 1, 2 * k] = stay
    np.fill_diagonal(links, 0.0)
    near = nearest(links, min(_NEAR, free))
    tour = shorten(links, near, np.arange(free + 1), _KICKS_PER_END * free, np.random.default_rng(0))
    at = int(np.flatnonzero(tour == free)[0])
    order = np.roll(tour, -at)[1:]
    return [routes_m[first // 2] if first % 2 == 0 else routes_m[first // 2][::-1] for first in order[::2].tolist()]


_SPOTS = 1600
"""Points of the lattice of mended routes on the map."""


def repaired_routes(
    site: Site, problem: SearchProblem, routes: Sequence[Route], is_over: Callable[[], bool] = lambda: False
) -> Iterator[Route]:
    """For each route, its feasible stretches, joined; nothing for a route without any.

    Args:
        site: the scenario on its ground; its limits apply to legs.
        problem: with these limits.
        routes: in the order in which they are repaired.
        is_over: whether the time is over; the first route is always repaired.
    """
    if flyable_area(site).polygon.is_empty:
        return
    lattice = route_lattice(site, problem)
    for number, route in enumerate(routes):
        if number > 0 and is_over():
            return
        stretches = _stretches(problem, route.waypoints_m)
        if stretches:
            yield Route(joined_over(lattice, stretches))


def route_lattice(site: Site, problem: SearchProblem) -> Lattice:
    """Positions of a route inside the height band of a site, with the legs that keep the limits of a search on it."""
    polygon = flyable_area(site).polygon
    return Lattice(polygon, site.area.bounds, partial(allowed_band_m, site), partial(_allowed, problem), spots=_SPOTS)


def _stretches(problem: SearchProblem, points_m: FloatArray) -> list[FloatArray]:
    """The longest sequences of (k, 3) waypoints, k >= 2, of an (n, 3) route whose legs keep the limits."""
    kept = np.concatenate([[False], _allowed(problem, points_m[:-1], points_m[1:]), [False]])
    begins, ends = np.flatnonzero(~kept[:-1] & kept[1:]), np.flatnonzero(kept[:-1] & ~kept[1:])
    return [points_m[begin : end + 1] for begin, end in zip(begins, ends, strict=True)]


def _allowed(problem: SearchProblem, begins_m: FloatArray, ends_m: FloatArray) -> BoolArray:
    """(n,) whether the legs between (n, 3) positions keep the limits."""
    return np.asarray(allowed_legs(problem, np.ascontiguousarray(np.hstack([begins_m, ends_m]))))


def joined_over(lattice: Lattice, stretches: Sequence[FloatArray]) -> FloatArray:
    """(n, 3) stretches in their order, each (k, 3), joined by the shortest ways over the lattice.

    Where no way leads from some stretches to others, those that are the longest together.
    """
    ends_m = np.vstack([stretch[[0, -1]] for stretch in stretches])
    first = len(lattice.positions_m)
    own = first + np.arange(len(ends_m))
    next_to = np.column_stack([own[1:-1:2], own[2::2]])
    positions_m, links, length = lattice.linked_with(ends_m, next_to)
    stays = own.reshape(-1, 2)
    whole = np.array([np.linalg.norm(np.diff(stretch, axis=0), axis=1).sum() for stretch in stretches])
    both, lengths = np.vstack([links, stays]), np.concatenate([length, whole])
    graph = scipy.sparse.csr_matrix((lengths, (both[:, 0], both[:, 1])), shape=(len(positions_m), len(positions_m)))
    _, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
    parts = part[stays[:, 0]]
    kept = np.flatnonzero(parts == np.argmax(np.bincount(parts, weights=whole))).tolist()
    out = [stretches[kept[0]]]
    _, before = scipy.sparse.csgraph.dijkstra(
        graph, directed=False, indices=stays[kept[:-1], 1], return_predecessors=True
    )
    for row, (last, k) in enumerate(itertools.pairwise(kept)):
        path = [int(stays[k, 0])]
        while path[-1] != stays[last, 1]:
            path.append(int(before[row, path[-1]]))
        between = [positions_m[path[-1:]]]
        for a, b in itertools.pairwise(path[::-1]):
            if min(a, b) >= first and (a - first) // 2 == (b - first) // 2:
                # The path leads along another stretch.
                between.append(stretches[(a - first) // 2][1:-1][:: 1 if a < b else -1])
            between.append(positions_m[[b]])
        out += [lattice.with_few_corners(np.vstack(between))[1:-1], stretches[k]]
    return np.vstack(out)
