"""The autopilot's own return from every part of the path: against the ground, obstacles, the fence and no-fly zones."""

import math

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from uavcover.checking.aircraft import Aircraft
from uavcover.checking.boundary_checks import TOLERANCE_M as BOUNDARY_TOLERANCE_M
from uavcover.checking.boundary_checks import beyond_fence
from uavcover.checking.findings import CheckFinding, joined
from uavcover.checking.ground_checks import TOLERANCE_M, height_in_words
from uavcover.checking.limits import Limits, LocalFence, Surroundings
from uavcover.checking.obstacle_checks import nearest_obstacle
from uavcover.checking.return_lines import ReturnWays, lowest_of, places_along, return_ways
from uavcover.checking.segments import FlownPath, Segment
from uavcover.checking.world import World
from uavcover.scenario.airspace.zones import ZoneCheck

_HAIR_M = np.array([[0.0, 0.0], [1e-3, 0.0]])
"""A place as a line of a millimetre: a line without length is nowhere."""


def return_findings(
    path: FlownPath, world: World, limits: Limits, aircraft: Aircraft, around: Surroundings
) -> list[CheckFinding]:
    """Segments from where the autopilot's own return hits or leaves something."""
    low, out, entered, near = [], [], [], []
    zones = ZoneCheck(around.zones, world.ground, world.frame)
    for segment in path.distinct:
        if segment.phase != "route":
            continue
        places = places_along(segment)
        if not len(places):
            continue
        ways = return_ways(world, places, world.alts_amsl_m(places), aircraft)
        low += _too_low(segment, ways, world, limits)
        out += _out_of_fence(segment, ways, world, around.fence)
        entered += _into_zone(segment, ways, world, zones)
        near += _near_obstacle(segment, ways, world, around)
    return [
        *joined(low, lambda one: one.kind),
        *joined(out, lambda one: one.kind),
        *joined(near, lambda one: one.what.split(" obstacle ")[-1]),
        *joined(entered, lambda one: one.what.split(" m into ")[-1]),
    ]


def _too_low(segment: Segment, ways: ReturnWays, world: World, limits: Limits) -> list[CheckFinding]:
    lowest, where, begin = lowest_of(world, ways.home)
    if lowest >= limits.min_height_agl_m - TOLERANCE_M:
        return []
    short_m = limits.min_height_agl_m - lowest
    words = height_in_words(lowest, where, world)
    height_m = float(ways.heights_m[begin])
    enough_m = math.ceil(height_m + short_m)
    return [
        CheckFinding(
            kind="return", weight="breaks", items=segment.items, by=short_m, unit="m",
            what=f"the straight return {height_m:.0f} m above home comes {words}",
            do=f"set the return altitude to {enough_m} m above home or more, and give it with --return-height",
        ).at(world.geodetic(where))
    ]  # fmt: skip


def _out_of_fence(segment: Segment, ways: ReturnWays, world: World, fence: LocalFence) -> list[CheckFinding]:
    if fence == LocalFence():
        return []
    lines = np.stack([ways.places_m[:, :2], np.zeros((len(ways.places_m), 2))], axis=1)
    hull = shapely.MultiPoint(lines.reshape(-1, 2)).convex_hull
    if _holds(fence, hull):
        return []
    worst = None
    for line in lines:
        begins_beyond = beyond_fence(line[0] + _HAIR_M, fence)
        beyond = (
            beyond_fence(line, fence) if begins_beyond is None else None
        )  # what lies outside itself is told as such
        if beyond is not None and (worst is None or beyond[0] > worst[0]):
            worst = beyond
    if worst is None:
        return []
    depth_m, place = worst
    lat, lon, _ = world.geodetic([*place, 0.0])
    return [
        CheckFinding(
            kind="return-fence", weight="breaks", items=segment.items, lat_deg=lat, lon_deg=lon, by=depth_m, unit="m",
            what=f"the straight return comes {depth_m:.1f} m beyond the fence",
            do="draw the fence wider, or end with legs home and let nothing but the pilot make it return",
        )
    ]  # fmt: skip


def _holds(fence: LocalFence, hull: BaseGeometry) -> bool:
    """Whether all of a convex shape is surely inside a fence: then so is every line in it."""
    grown = hull.buffer(0.0)
    apart = all(polygon.disjoint(grown) for polygon in fence.outside)
    corners = shapely.get_coordinates(hull)
    for east, north, radius, stays in fence.circles:
        if stays:
            apart &= bool((np.hypot(corners[:, 0] - east, corners[:, 1] - north) <= radius).all())
        else:
            apart &= hull.distance(shapely.Point(east, north)) >= radius
    return apart and all(polygon.buffer(BOUNDARY_TOLERANCE_M).contains(hull) for polygon in fence.inside)


def _near_obstacle(segment: Segment, ways: ReturnWays, world: World, around: Surroundings) -> list[CheckFinding]:
    if not around.prisms:
        return []
    found = nearest_obstacle((ways.home + ways.columns).points_m, world, around)
    if found is None:
        return []
    short_m, name, place = found
    return [
        CheckFinding(
            kind="return-obstacle", weight="breaks", items=segment.items, by=short_m,
            unit="m", what=f"the straight return lacks {short_m:.1f} m of clearance from obstacle {name}",
            do="set a higher return altitude and give it with --return-height, or take off elsewhere",
        ).at(world.geodetic(place))
    ]  # fmt: skip


def _into_zone(segment: Segment, ways: ReturnWays, world: World, zones: ZoneCheck) -> list[CheckFinding]:
    if not zones.zones:
        return []
    inside = {(breach.leg, breach.zone) for breach in zones.place_breaches(ways.places_m)}
    lines = ways.home + ways.columns
    points, owner = lines.points_m, lines.owner
    worst: dict[int, tuple[float, np.ndarray]] = {}
    for breach in zones.leg_breaches(points):
        if (owner[breach.leg], breach.zone) in inside:
            continue  # the path itself is in the zone there, and told
        if breach.depth_m > worst.get(breach.zone, (0.0, points[0]))[0]:
            begin, end = points[breach.leg], points[breach.leg + 1]
            worst[breach.zone] = breach.depth_m, begin + breach.at * (end - begin)
    found = []
    for number, (depth_m, place) in sorted(worst.items()):
        zone = zones.zones[number]
        found.append(
            CheckFinding(
                kind="return-no-fly", weight="breaks", items=segment.items, by=depth_m,
                unit="m", do="take off elsewhere, choose another return altitude, or end with legs home",
                what=f"the straight return comes {depth_m:.1f} m into no-fly zone {zone.name} ({zone.heights_in_words()})",
            ).at(world.geodetic(place))
        )  # fmt: skip
    return found
