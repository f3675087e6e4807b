"""Obstacles, along every segment at its full length: beside them or above them there is room, or there is not."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from uavcover.errors import InputError
from uavcover.extras.check.findings import CheckFinding, FlownPath, joined
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import Limits, LocalFence, Surroundings, World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.scenario.airspace.zones import ZoneCheck
from uavcover.scenario.obstacles import Footprint, Prism, leg_breaches, stand_on
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground

# Fence, no-fly zones and distance from home, along every segment at its full length.


def fence_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that leave the fence, or enter what it keeps out."""
    found = []
    for segment in path.distinct:
        if not np.isfinite(segment.enu_m).all():
            continue
        beyond = beyond_fence(segment.enu_m[:, :2], around.fence)
        if beyond is None:
            continue
        depth_m, place = beyond
        lat, lon, _ = world.geodetic([*place, 0.0])
        what = f"{depth_m:.1f} m beyond the fence"
        one = segment.found("fence", depth_m, what=what, do="move the items inside the fence, or enlarge it")
        found.append(replace(one, lat_deg=lat, lon_deg=lon))
    return joined(found, lambda one: one.kind)


def beyond_fence(line: FloatArray, fence: LocalFence) -> tuple[float, tuple[float, float]] | None:
    """Largest distance of a line (n, 2) beyond a fence, and its position."""
    worst: list[tuple[float, tuple[float, float]]] = []
    keep_in: list[tuple[float, tuple[float, float]]] = []
    for polygon in fence.inside:
        keep_in.append(_farthest(shapely.LineString(line).difference(polygon), polygon))
    for polygon in fence.outside:
        worst.append(_farthest(shapely.LineString(line).intersection(polygon), polygon.boundary))
    for east, north, radius, stay_inside in fence.circles:
        distances = np.hypot(line[:, 0] - east, line[:, 1] - north)
        if stay_inside:  # the farthest place of straight pieces is one of their ends
            k = int(np.argmax(distances))
            keep_in.append((float(distances[k]) - radius, (float(line[k, 0]), float(line[k, 1]))))
        else:
            course = shapely.LineString(line)
            at = course.interpolate(course.project(shapely.Point(east, north)))
            worst.append((radius - math.hypot(at.x - east, at.y - north), (at.x, at.y)))
    if keep_in:
        worst.append(_beyond_all(line, fence) if fence.any_inside and len(keep_in) > 1 else max(keep_in))
    depth = max(worst, default=(0.0, (0.0, 0.0)))
    return depth if depth[0] > CHECKS.boundary_tolerance_m else None


def _beyond_all(line: FloatArray, fence: LocalFence) -> tuple[float, tuple[float, float]]:
    """Largest distance of a line beyond the union of the areas it may be inside of (PX4)."""
    circles = [shapely.Point(e, n).buffer(r, quad_segs=256) for e, n, r, stays in fence.circles if stays]
    union = shapely.union_all([*fence.inside, *circles])
    return _farthest(shapely.LineString(line).difference(union), union)


def _farthest(part: BaseGeometry, shape: shapely.Geometry) -> tuple[float, tuple[float, float]]:
    """The place of a part of a line that is farthest from a shape."""
    if part.is_empty:
        return 0.0, (0.0, 0.0)
    places = shapely.get_coordinates(shapely.segmentize(part, CHECKS.boundary_step_m) if part.length > 0.0 else part)
    depths = np.atleast_1d(shapely.distance(shapely.points(places), shape))
    k = int(np.argmax(depths))
    return float(depths[k]), (float(places[k, 0]), float(places[k, 1]))


def zone_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that enter no-fly zones between their floor and ceiling."""
    check = ZoneCheck(around.zones, world.ground, world.frame)
    found = []
    for segment in path.distinct:
        worst: dict[int, tuple[float, FloatArray]] = {}
        for breach in check.leg_breaches(segment.enu_m):
            begin, end = segment.enu_m[breach.leg], segment.enu_m[breach.leg + 1]
            if breach.depth_m > worst.get(breach.zone, (0.0, None))[0]:
                worst[breach.zone] = breach.depth_m, begin + breach.at * (end - begin)
        for number, (depth_m, place) in sorted(worst.items()):
            zone = around.zones[number]
            what = f"{depth_m:.1f} m inside no-fly zone {zone.name} ({zone.heights_in_words()})"
            found.append(
                segment.found("no-fly", depth_m, what=what, do="move the path around the zone").at(
                    world.geodetic(place)
                )
            )
    return joined(sorted(found, key=lambda one: one.what.split(" into ")[-1]), lambda one: one.what.split(" into ")[-1])


def distance_findings(path: FlownPath, world: World, limits: Limits) -> list[CheckFinding]:
    """Segments farther from home than allowed."""
    if limits.max_distance_m is None:
        return []
    found = []
    for segment in path.distinct:
        distances = np.hypot(segment.enu_m[:, 0], segment.enu_m[:, 1])
        k = int(np.argmax(distances))
        if distances[k] > limits.max_distance_m + CHECKS.boundary_tolerance_m:
            over_m = float(distances[k]) - limits.max_distance_m
            what = f"{distances[k]:.0f} m from home; the limit is {limits.max_distance_m:g} m"
            do = "take off closer to the mission, or raise --max-distance"
            found.append(segment.found("distance", over_m, what=what, do=do).at(world.geodetic(segment.enu_m[k])))
    return joined(found, lambda one: one.kind)


def with_obstacles(
    ground: Ground,
    obstacles: Sequence[Obstacle],
    frame: LocalFrame,
    bounds_m: tuple[float, float, float, float],
    clearance_m: float,
    *,
    foot: Ground | None = None,
) -> tuple[Ground, tuple[Prism, ...]]:
    """Obstacles in degrees on a ground, as far as they stand within west, south, east, north.

    ``foot`` is what they stand on where a surface model lies over it.

    Raises:
        InputError: one is in another frame, or its outline crosses itself.
        TerrainError: the ground under one is unknown.
    """
    if not obstacles:
        return ground, ()
    box = shapely.box(*bounds_m)
    footprints = []
    for number, one in enumerate(obstacles):
        name = one.name or str(number)
        if not one.rings_lon_lat_deg:
            raise InputError(f"--obstacles: {name} is in local metres; use longitudes and latitudes")
        rings = [frame.en_from_lon_lat(ring) for ring in one.rings_lon_lat_deg]
        polygon = shapely.Polygon(rings[0], rings[1:])
        if not polygon.is_valid:
            raise InputError(f"--obstacles: {name}: {shapely.is_valid_reason(polygon)}; draw it again")
        if box.intersects(polygon):
            footprints.append(Footprint(name, polygon, one.height_m))
    if not footprints:
        return ground, ()
    return stand_on(ground, footprints, largest_clearance_m=clearance_m, foot=foot)


def obstacle_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that come too near to an obstacle, or through it."""
    found = []
    for segment in path.distinct:
        nearest = nearest_obstacle(segment.enu_m, world, around)
        if nearest is None:
            continue
        short_m, name, place = nearest
        clearance_m = around.obstacle_clearance_m
        side = "through" if short_m >= clearance_m else f"{clearance_m - short_m:.1f} m from"
        what = f"{side} obstacle {name}; the limit is {clearance_m:g} m"
        do = "move the path around or over the obstacle, or reduce --obstacle-clearance"
        found.append(segment.found("obstacle", short_m, what=what, do=do).at(world.geodetic(place)))
    return joined(found, lambda one: one.what.split(" obstacle ")[-1])


def nearest_obstacle(points_m: FloatArray, world: World, around: Surroundings) -> tuple[float, str, FloatArray] | None:
    """Largest clearance deficit of lines (n, 3): metres, the obstacle's name, and the position; None where they keep it.

    Rows of NaN are gaps.
    """
    if not around.prisms or len(points_m) < 2:
        return None
    clearance_m = around.obstacle_clearance_m
    known = np.asarray(np.isfinite(points_m).all(axis=1))
    legs = np.flatnonzero(known[:-1] & known[1:])
    if not len(legs):
        return None
    wanted = Obstacles(clearance_beside_m=clearance_m, clearance_above_m=clearance_m)
    pairs = np.stack([points_m[legs], points_m[legs + 1]], axis=1).reshape(-1, 3)
    rows = leg_breaches(world.ground, pairs, wanted)[0::2]
    k = int(np.argmax(rows[:, 1]))
    if rows[k, 0] < 0 or rows[k, 1] <= CHECKS.clearance_tolerance_m:
        return None
    begin, end = points_m[legs[k]], points_m[legs[k] + 1]
    return float(rows[k, 1]), around.prisms[int(rows[k, 0])].footprint.name, begin + rows[k, 2] * (end - begin)
