"""Clearance of every segment at its full length: heights above the ground, fence, no-fly zones, obstacles, distance."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
import shapely.ops
from shapely.geometry.base import BaseGeometry

from uavcover.errors import InputError
from uavcover.extras.check.findings import CheckFinding, FlownPath, Segment, joined
from uavcover.extras.check.item_checks import OTHER_DATA
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import Limits, LocalFence, Surroundings, World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.new.quantities import TERRAIN
from uavcover.scenario.airspace.zones import ZoneCheck
from uavcover.scenario.obstacles import Footprint, Prism, leg_breaches, stand_on
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground


def height_findings(path: FlownPath, world: World, limits: Limits) -> list[CheckFinding]:
    """Segments too near to the ground or in it, too high, or over unknown ground."""
    low, high, unknown, above_home = [], [], [], []
    for whole in path.distinct:
        segment = _cut_at_doubts(whole, world)
        ranges = world.leg_height_ranges_m(segment.enu_m)
        if not np.isfinite(ranges).all():
            unknown.append(_unknown(segment, world, ranges))
        if np.isfinite(ranges).any():
            low += _too_low(segment, world, limits, ranges)
            high += _too_high(segment, world, limits, ranges)
        above_home += _above_home(segment, world, limits)
    return [
        *_worst_of_each(low),
        *joined(high, lambda one: one.kind),
        *joined(above_home, lambda one: one.kind),
        *joined(unknown, lambda one: (one.kind, one.what)),
    ]


def _worst_of_each(findings: list[CheckFinding]) -> list[CheckFinding]:
    """One finding for each pair of items; a leg that is flown again may come from elsewhere."""
    worst: dict[tuple[int, int] | None, CheckFinding] = {}
    for one in findings:
        if one.items not in worst or one.by > worst[one.items].by:
            worst[one.items] = one
    return list(worst.values())


def position_of(segment: Segment, piece: int, at: float) -> FloatArray:
    """The place (3,) at a parameter 0..1 of a piece of a segment."""
    begin, end = segment.enu_m[piece], segment.enu_m[piece + 1]
    return np.asarray(begin + at * (end - begin))


def _too_low(segment: Segment, world: World, limits: Limits, ranges: FloatArray) -> list[CheckFinding]:
    piece = int(np.nanargmin(ranges[:, 0]))
    lowest_m = float(ranges[piece, 0])
    where = position_of(segment, piece, float(ranges[piece, 1]))
    # Take-off and landing touch the ground at their ends, and nowhere else.
    landed_m = CHECKS.landed_m if world.surface is None else TERRAIN.hides_m
    limit_m = limits.min_height_agl_m if segment.phase in ("route", "return") else -landed_m
    if lowest_m >= limit_m - CHECKS.clearance_tolerance_m:
        return []
    short_m = limit_m - lowest_m
    words = height_text(lowest_m, where, world)
    a, b = segment.items
    points = f"item {b}" if a in (0, b) or segment.phase != "route" else f"items {a} and {b}"
    what = f"{words}; the limit is {max(limit_m, 0.0):g} m"
    do = _remedy(segment, world, points, short_m)
    return [segment.found("ground", short_m, what=what, do=do).at(world.geodetic(where))]


def _remedy(segment: Segment, world: World, points: str, short_m: float) -> str:
    if segment.phase == "return":
        return "use a greater return height (--return-height), or end the mission with a return transit"
    if segment.phase in ("take-off", "landing") and world.surface is not None:
        return "choose take-off and landing positions away from obstacles"
    return f"raise {points} by {short_m:.0f} m or more, or insert a waypoint"


def height_text(lowest_m: float, position_m: FloatArray, world: World) -> str:
    """A least height, above what it is, as text; also above the ground where trees or roofs stand on it."""
    side = f"{-lowest_m:.1f} m below" if lowest_m < 0.0 else f"{lowest_m:.1f} m above"
    bare_m = float(world.ground.heights_agl_m(position_m)[0])
    if world.surface is None or not bare_m - lowest_m > TERRAIN.hides_m:
        return f"{side} the ground"
    return f"{side} the top of trees or roofs ({bare_m:.1f} m above the ground)"


def _too_high(segment: Segment, world: World, limits: Limits, ranges: FloatArray) -> list[CheckFinding]:
    piece = int(np.nanargmax(ranges[:, 2]))
    highest_m = float(ranges[piece, 2])
    if limits.max_height_agl_m is None or highest_m <= limits.max_height_agl_m + CHECKS.clearance_tolerance_m:
        return []
    if segment.phase in ("return", "landing"):
        return []  # the band is that of the route; an autopilot's own return is high on purpose
    over_m = highest_m - limits.max_height_agl_m
    what = f"{highest_m:.0f} m above the ground; the limit is {limits.max_height_agl_m:g} m"
    do = f"fly {over_m:.0f} m lower there, or raise --max-height"
    position = position_of(segment, piece, float(ranges[piece, 3]))
    return [segment.found("height", over_m, what=what, do=do).at(world.geodetic(position))]


def _above_home(segment: Segment, world: World, limits: Limits) -> list[CheckFinding]:
    if limits.max_above_home_m is None:
        return []
    alts = world.alts_amsl_m(segment.enu_m)
    if not np.isfinite(alts).any():
        return []
    k = int(np.nanargmax(alts))
    over_m = float(alts[k]) - world.home_alt_amsl_m - limits.max_above_home_m
    if over_m <= CHECKS.clearance_tolerance_m:
        return []
    what = f"{over_m + limits.max_above_home_m:.0f} m above home; the limit is {limits.max_above_home_m:g} m"
    found = segment.found("above-home", over_m, what=what, do=f"fly {over_m:.0f} m lower there")
    return [found.at(world.geodetic(segment.enu_m[k]))]


def _cut_at_doubts(segment: Segment, world: World) -> Segment:
    """The segment with more places, where it enters or leaves ground that is not believed: the rest is judged."""
    line = segment.enu_m
    doubtful = [shape.buffer(2.0 * world.ground.surface.step_m) for shape, _ in world.ground.left_out]
    if not doubtful or not np.isfinite(line).all():
        return segment
    positions = [line[:1]]
    for begin, end in pairwise(line):
        leg = shapely.LineString([begin[:2], end[:2]])
        length_m = leg.length
        cuts = [
            leg.project(shapely.Point(corner)) / length_m
            for shape in doubtful
            if length_m > 0.0 and shape.intersects(leg)
            for corner in shapely.get_coordinates(shape.intersection(leg))
        ]
        inner = np.array(sorted({cut for cut in cuts if 1e-6 < cut < 1.0 - 1e-6})).reshape(-1, 1)
        positions += [begin + inner * (end - begin), end[None, :]]
    return replace(segment, enu_m=np.vstack(positions))


def _unknown(segment: Segment, world: World, ranges: FloatArray) -> CheckFinding:
    piece = int(np.argmin(np.isfinite(ranges).all(axis=1)))
    position = segment.enu_m[piece]
    leg = shapely.LineString(segment.enu_m[piece : piece + 2, :2])
    reach_m = 2.0 * world.ground.surface.step_m
    for shape, words in world.ground.left_out:
        if np.isfinite(position).all() and shape.distance(leg) <= reach_m:
            nearest = shapely.ops.nearest_points(leg, shape)[0]
            at = np.array([nearest.x, nearest.y, position[2]])
            what = f"the elevation data is implausible here: {words}"
            return CheckFinding(
                kind="suspect-ground", weight="unknown", items=segment.items, what=what, do=OTHER_DATA
            ).at(world.geodetic(at))
    found = CheckFinding(
        kind="no-elevation", weight="unknown", items=segment.items, what="the elevation data contains no height here",
        do="use elevation data that covers the whole flight",
    )  # fmt: skip
    return found.at(world.geodetic(position)) if np.isfinite(position).all() else found


# Fence, no-fly zones and distance from home, along every segment at its full length.


def fence_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that leave the fence or enter its exclusions."""
    found = []
    for segment in path.distinct:
        if not np.isfinite(segment.enu_m).all():
            continue
        beyond = beyond_fence(segment.enu_m[:, :2], around.fence)
        if beyond is None:
            continue
        depth_m, position = beyond
        lat, lon, _ = world.geodetic([*position, 0.0])
        what = f"{depth_m:.1f} m beyond the fence"
        one = segment.found("fence", depth_m, what=what, do="move the items inside the fence, or enlarge it")
        found.append(replace(one, lat_deg=lat, lon_deg=lon))
    return joined(found, lambda one: one.kind)


def beyond_fence(line: FloatArray, fence: LocalFence) -> tuple[float, tuple[float, float]] | None:
    """Largest distance of a line (n, 2) beyond a fence, and its position."""
    worst: list[tuple[float, tuple[float, float]]] = []
    keep_in: list[tuple[float, tuple[float, float]]] = []
    course = shapely.LineString(line)
    flown = course if course.length > 0.0 else shapely.Point(line[0])  # of a line without length nothing would be left
    for polygon in fence.inside:
        keep_in.append(_farthest(flown.difference(polygon), polygon))
    for polygon in fence.outside:
        worst.append(_farthest(flown.intersection(polygon), polygon.boundary))
    for east, north, radius, stay_inside in fence.circles:
        distances = np.hypot(line[:, 0] - east, line[:, 1] - north)
        if stay_inside:  # the farthest place of straight pieces is one of their ends
            k = int(np.argmax(distances))
            keep_in.append((float(distances[k]) - radius, (float(line[k, 0]), float(line[k, 1]))))
        else:
            at = course.interpolate(course.project(shapely.Point(east, north)))
            worst.append((radius - math.hypot(at.x - east, at.y - north), (at.x, at.y)))
    if keep_in:
        worst.append(_beyond_all(flown, fence) if fence.any_inside and len(keep_in) > 1 else max(keep_in))
    depth = max(worst, default=(0.0, (0.0, 0.0)))
    return depth if depth[0] > CHECKS.boundary_tolerance_m else None


def _beyond_all(flown: BaseGeometry, fence: LocalFence) -> tuple[float, tuple[float, float]]:
    """Largest distance of a line beyond the union of the areas it may be inside of (PX4)."""
    circles = [shapely.Point(e, n).buffer(r, quad_segs=256) for e, n, r, stays in fence.circles if stays]
    union = shapely.union_all([*fence.inside, *circles])
    return _farthest(flown.difference(union), union)


def _farthest(part: BaseGeometry, shape: shapely.Geometry) -> tuple[float, tuple[float, float]]:
    """The place of a part of a line that is farthest from a shape."""
    if part.is_empty:
        return 0.0, (0.0, 0.0)
    positions = shapely.get_coordinates(shapely.segmentize(part, CHECKS.boundary_step_m) if part.length > 0.0 else part)
    depths = np.atleast_1d(shapely.distance(shapely.points(positions), shape))
    k = int(np.argmax(depths))
    return float(depths[k]), (float(positions[k, 0]), float(positions[k, 1]))


def zone_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that enter no-fly zones between their floor and ceiling."""
    check = ZoneCheck(around.zones, world.ground, world.frame)
    found: dict[int, list[CheckFinding]] = {}
    for segment in path.distinct:
        worst: dict[int, tuple[float, FloatArray]] = {}
        for breach in check.leg_breaches(segment.enu_m):
            begin, end = segment.enu_m[breach.leg], segment.enu_m[breach.leg + 1]
            if breach.depth_m > worst.get(breach.zone, (0.0, None))[0]:
                worst[breach.zone] = breach.depth_m, begin + breach.at * (end - begin)
        for number, (depth_m, position) in worst.items():
            zone = around.zones[number]
            what = f"{depth_m:.1f} m inside no-fly zone {zone.name} ({zone.heights_text()})"
            one = segment.found("no-fly", depth_m, what=what, do="move the path around the zone")
            found.setdefault(number, []).append(one.at(world.geodetic(position)))
    return [one for number in sorted(found) for one in joined(found[number], lambda one: one.kind)]


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
        short_m, name, position = nearest
        clearance_m = around.obstacle_clearance_m
        side = "through" if short_m >= clearance_m else f"{clearance_m - short_m:.1f} m from"
        what = f"{side} obstacle {name}; the limit is {clearance_m:g} m"
        do = "move the path around or over the obstacle, or reduce --obstacle-clearance"
        found.append(segment.found("obstacle", short_m, what=what, do=do).at(world.geodetic(position)))
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
