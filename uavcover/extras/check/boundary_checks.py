"""Fence, no-fly zones and distance from home, along every segment at its full length."""

import math

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from uavcover.extras.check.findings import CheckFinding, joined
from uavcover.extras.check.limits import Limits, LocalFence, Surroundings
from uavcover.extras.check.segments import FlownPath, Segment
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import ZoneCheck


def fence_findings(path: FlownPath, world: World, fence: LocalFence) -> list[CheckFinding]:
    """Segments that leave the fence, or enter what it keeps out."""
    found = []
    for segment in path.distinct:
        if not np.isfinite(segment.enu_m).all():
            continue
        beyond = beyond_fence(segment.enu_m[:, :2], fence)
        if beyond is None:
            continue
        depth_m, place = beyond
        lat, lon, _ = world.geodetic([*place, 0.0])
        found.append(
            CheckFinding(
                kind="fence", weight="breaks", items=segment.items, lat_deg=lat, lon_deg=lon, by=depth_m, unit="m",
                what=f"{depth_m:.1f} m beyond the fence", do="move the items inside, or enlarge the fence",
            )
        )  # fmt: skip
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


def zone_findings(path: FlownPath, world: World, surroundings: Surroundings) -> list[CheckFinding]:
    """Segments that enter no-fly zones between their floor and ceiling."""
    check = ZoneCheck(surroundings.zones, world.ground, world.frame)
    found = []
    for segment in path.distinct:
        worst: dict[int, tuple[float, FloatArray]] = {}
        for breach in check.leg_breaches(segment.enu_m):
            begin, end = segment.enu_m[breach.leg], segment.enu_m[breach.leg + 1]
            if breach.depth_m > worst.get(breach.zone, (0.0, None))[0]:
                worst[breach.zone] = breach.depth_m, begin + breach.at * (end - begin)
        found += [_in_zone(segment, world, surroundings, zone, *deep) for zone, deep in sorted(worst.items())]
    return joined(sorted(found, key=lambda one: one.what.split(" into ")[-1]), lambda one: one.what.split(" into ")[-1])


def _in_zone(
    segment: Segment, world: World, surroundings: Surroundings, number: int, depth_m: float, place: FloatArray
) -> CheckFinding:
    zone = surroundings.zones[number]
    return CheckFinding(
        kind="no-fly", weight="breaks", items=segment.items, by=depth_m, unit="m",
        what=f"{depth_m:.1f} m into no-fly zone {zone.name} ({zone.heights_in_words()})", do="fly around it",
    ).at(world.geodetic(place))  # fmt: skip


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
            found.append(
                CheckFinding(
                    kind="distance", weight="breaks", items=segment.items, by=over_m,
                    unit="m", what=f"{distances[k]:.0f} m from home; the limit is {limits.max_distance_m:g} m",
                    do="take off closer to the mission, or raise --max-distance",
                ).at(world.geodetic(segment.enu_m[k]))
            )  # fmt: skip
    return joined(found, lambda one: one.kind)
