"""Transit legs between the column above home and the planned route, and the fence around a mission.

Fences of ArduPilot and PX4 have no floors and no ceilings for single polygons or circles: an exclusion holds at every height. So
a zone that the mission passes over or under is omitted. The keep-in fence is one polygon, the union of those the scenario gives:
ArduPilot wants a vehicle inside of all its inclusions unless FENCE_OPTIONS says otherwise, PX4 inside of any.
"""

import dataclasses
import math
from dataclasses import dataclass
from functools import partial
from itertools import chain
from threading import Lock

import numpy as np
import shapely

from mission_io.model.items import Fence, FenceCircle, FencePolygon, LatLon
from uavcover.errors import InfeasibleError, InputError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.profile import shortest_profile
from uavcover.missions.leg_checks import LegProblem, climb_angles_deg, find_problems
from uavcover.scenario.airspace.flyable import transit_area, transit_area_between_walls
from uavcover.scenario.airspace.lattice import Lattice
from uavcover.scenario.airspace.zones import PathAround, Polygons, Zone, ZoneCheck
from uavcover.scenario.obstacles import leg_breaches
from uavcover.scenario.site import Site, once, prepared
from uavcover.terrain.frames import LocalFrame

_ROOM_M = 5.0
"""How far a transit stays inside its limits of height where it can, so that a few straight legs do."""
_TRANSIT_SLACK_M = 1.0
"""Added to the target height of a transit, for ground between two samples and for rounding."""
_SAMPLE_SPACING_M = 5.0
_SPOTS = 900
"""Points on the map of the lattice of transits."""

_COLUMN_POSITIONS = 6
"""Positions of the columns at the ends of such a path, from which it may leave."""

_VERTICAL_M = 0.1
"""Legs with less horizontal distance than this are vertical columns, exempt from the climb limit."""


def frame_and_home(site: Site) -> tuple[LocalFrame, FloatArray]:
    """The local frame and the (3,) ENU home of a site that can be flown.

    Raises:
        InputError: the scenario has no position on Earth or no home.
    """
    if site.frame is None:
        raise InputError(f"scenario {site.scenario.name} has no position on Earth; add an [origin] and a [home]")
    if site.home_m is None:
        raise InputError(f"scenario {site.scenario.name} has no [home], where a mission takes off and lands")
    return site.frame, site.home_m


def home_of(site: Site) -> FloatArray:
    """The (3,) ENU home of a site.

    Raises:
        InfeasibleError: it has none.
    """
    if site.home_m is None:
        raise InfeasibleError(f"scenario {site.scenario.name} has no [home]")
    return site.home_m


def transit(site: Site, home_en_m: FloatArray, end_m: FloatArray, *, ground_end_height_m: float) -> FloatArray:
    """Plan a transit over the terrain between the column above home and a point.

    It keeps the transit clearance plus the height margin, which allows for tracking errors in flight, and passes over
    obstacles. Within these limits and below its ceiling it climbs as little as it can. It is straight on the map where no
    no-fly zone and no bay of the fence is in the way, and else leads around them.

    Args:
        site: the scenario on its ground.
        home_en_m: (2,) position of the column.
        end_m: (3,) ENU point at the other end, kept exactly; if the terrain demands more height there, a vertical leg is added.
        ground_end_height_m: height above home of the column's top, raised where the transit requires it.

    Returns:
        (k, 3) ENU from the column's top to the point.
    """
    direct_m = direct_transit(site, home_en_m, end_m, ground_end_height_m=ground_end_height_m)
    return low_enough(site, direct_m, end_m, ground_end_height_m=ground_end_height_m)


def direct_transit(site: Site, home_en_m: FloatArray, end_m: FloatArray, *, ground_end_height_m: float) -> FloatArray:
    """The (k, 3) :func:`transit` that is straight or goes around zones, which may be above its ceiling."""
    if math.hypot(*(end_m[:2] - home_en_m)) < _VERTICAL_M:
        limits = site.scenario.limits
        wanted_m = limits.transit_clearance_m + limits.height_margin_m
        home_ground = float(site.ground.heights_m(home_en_m)[0])
        top = home_ground + max(ground_end_height_m, wanted_m + _TRANSIT_SLACK_M)
        return np.vstack([[*home_en_m, max(end_m[2], top)], end_m])
    straight = _along(site, np.vstack([home_en_m, end_m[:2]]), end_m, ground_end_height_m)
    is_convex = site.fence.convex_hull.area - site.fence.area <= _VERTICAL_M
    if (is_convex and not site.zones) or _is_clear(site, straight, site.planned_zones):
        return straight
    found = [straight]
    for paths in _paths_around(site):
        # A vehicle in flight may have come into the margin of a zone, or outside the fence: from there straight back.
        inside = paths.inside(end_m[:2])
        corners = paths.between(home_en_m, inside)
        if corners is None:
            continue
        if not np.array_equal(inside, end_m[:2]):
            corners = np.vstack([corners, end_m[:2]])
        found.append(_along(site, corners, end_m, ground_end_height_m))
        if _is_clear(site, found[-1], site.planned_zones):
            return found[-1]
    # The check of the transit tells what is in its way.
    return next((points for points in found if _is_clear(site, points, site.flown_zones)), straight)


def low_enough(site: Site, path_m: FloatArray, end_m: FloatArray, *, ground_end_height_m: float) -> FloatArray:
    """The (k, 3) transit, or, if it is too high, the shortest path below the ceiling over a lattice, if there is one.

    On ground that is steeper than a leg may climb, such a path follows contours, or climbs in zigzags.
    """
    if not is_too_high(site, path_m):
        return path_m
    # Not where the straight path had to begin, which is different for each end: paths from one column are found faster.
    begin_m = np.array([*path_m[0, :2], float(site.ground.heights_m(path_m[0, :2])[0]) + ground_end_height_m])
    found_m = _lattice(site).path(_climb_out_m(site, begin_m), _climb_out_m(site, end_m))
    return path_m if found_m is None else np.vstack([found_m[:-1], end_m])


def _climb_out_m(site: Site, position_m: FloatArray) -> FloatArray:
    """(k, 3) a position and those above it that transits may have, up to their ceiling; the lowest of these if it is none."""
    low_m, high_m = _band_m(site, position_m[None, :2])
    ups_m = np.linspace(np.clip(position_m[2], low_m, high_m), high_m, _COLUMN_POSITIONS)
    return np.vstack([position_m, np.column_stack([np.repeat(position_m[None, :2], len(ups_m), axis=0), ups_m])])


def _band_m(site: Site, positions_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest planned up coordinates (n,) of a transit at (n, 2) positions."""
    limits = site.scenario.limits
    low_m = site.ground.ups_m(positions_m, limits.transit_clearance_m + limits.height_margin_m + _TRANSIT_SLACK_M)
    return low_m, site.ground.ups_m(positions_m, _planned_highest_agl_m(site) - _TRANSIT_SLACK_M)


def is_too_high(site: Site, points_m: FloatArray) -> bool:
    """Whether a (k, 3) transit is over unknown ground or above its ceiling, except in the climb-out column at its end."""
    level_m = np.hypot(*np.diff(points_m[:, :2], axis=0).T)
    legs = site.ground.leg_height_ranges_m(points_m)[level_m >= _VERTICAL_M]
    return not bool((legs[:, 2] <= _planned_highest_agl_m(site)).all())


def _is_clear(site: Site, points_m: FloatArray, zones: ZoneCheck) -> bool:
    """Whether a (k, 3) transit keeps out of the no-fly zones and inside the fence."""
    line = shapely.LineString(points_m[:, :2])
    inside = line.length == 0.0 or shapely.length(line.difference(site.fence)) <= _VERTICAL_M
    return bool(inside and not zones.leg_breaches(points_m))


@once
def _paths_around(site: Site) -> list[PathAround]:
    """Ways around everything that any height of a transit meets; then around what every height meets."""
    return [PathAround(transit_area(site)), PathAround(transit_area_between_walls(site))]


def _along(site: Site, corners_m: FloatArray, end_m: FloatArray, ground_end_height_m: float) -> FloatArray:
    """(m, 3) ENU of a transit along (k, 2) corners from the column to a point."""
    points = _over_terrain(
        site, corners_m, (float(site.ground.heights_m(corners_m[0])[0]) + ground_end_height_m, float(end_m[2]))
    )
    if abs(points[-1, 2] - end_m[2]) <= _VERTICAL_M:
        # Close enough: end at the point itself; the slope changes negligibly.
        points[-1] = end_m
        return points
    return np.vstack([points, end_m])


def _over_terrain(site: Site, corners_m: FloatArray, ups_m: tuple[float, float]) -> FloatArray:
    """(m, 3) ENU along (k, 2) corners with the least climb, at these up coordinates at its ends where the limits allow them."""
    limits, obstacles = site.scenario.limits, site.scenario.obstacles
    wanted_m = limits.transit_clearance_m + limits.height_margin_m
    aim_m = wanted_m + _TRANSIT_SLACK_M
    for attempt in range(5):
        points = shortest_profile(
            site.ground.surface,
            np.ascontiguousarray(corners_m),
            ups_m,
            aim_m,
            max(_planned_highest_agl_m(site), aim_m),
            math.tan(math.radians(limits.max_climb_angle_deg)) * (1.0 - 1e-9),
            _ROOM_M,
            _SAMPLE_SPACING_M / 2.0**attempt,
            obstacles.clearance_beside_m,
            obstacles.clearance_above_m + (limits.height_margin_m if site.prisms else 0.0),
        )
        lowest = float(site.ground.leg_height_ranges_m(points)[:, 0].min())
        if not lowest < wanted_m:
            break
        # The ground rises between two samples by more than the slack: try again, higher and with denser samples.
        aim_m += wanted_m - lowest + _TRANSIT_SLACK_M
    return points


@once
def _lattice(site: Site) -> Lattice:
    """Positions of transits between the area and home."""
    limits, area, one_at_a_time = site.scenario.limits, prepared(transit_area(site)), Lock()
    wanted_m = limits.transit_clearance_m + limits.height_margin_m
    around = site.area.envelope
    if site.home_m is not None:
        around = around.union(shapely.Point(site.home_m[:2]))

    def allowed(begins_m: FloatArray, ends_m: FloatArray) -> BoolArray:
        # The path from leg to leg is checked as well: neighbours are next to each other.
        path_m = np.stack([begins_m, ends_m], axis=1).reshape(-1, 3)
        ranges = site.ground.leg_height_ranges_m(path_m)[::2]
        climbs = climb_angles_deg(path_m)[::2] < limits.max_climb_angle_deg
        kept = climbs & (ranges[:, 0] >= wanted_m) & (ranges[:, 2] <= _planned_highest_agl_m(site))
        with one_at_a_time:
            kept &= shapely.covers(area, shapely.linestrings(path_m[:, :2].reshape(-1, 2, 2)))
        if limits.max_alt_amsl_m is not None:
            kept &= site.alts_amsl_m(path_m).reshape(-1, 2).max(axis=1) <= limits.max_alt_amsl_m
        if site.prisms:
            obstacles = site.scenario.obstacles
            above_m = obstacles.clearance_above_m + limits.height_margin_m
            clear = leg_breaches(site.ground, path_m, dataclasses.replace(obstacles, clearance_above_m=above_m))[::2]
            kept &= clear[:, 1] <= 0.0
        return np.asarray(kept)

    return Lattice(area, around.bounds, partial(_band_m, site), allowed, spots=_SPOTS)


def check_outbound(site: Site, path_m: FloatArray) -> None:
    """Refuse a (k, 3) transit to the first planned waypoint that exceeds a limit.

    Raises:
        InfeasibleError: it breaks one; the message names the leg.
    """
    _check_planned_transit(site, "the outbound transit", path_m, far_end=len(path_m) - 1)


def check_return(site: Site, path_m: FloatArray) -> None:
    """Refuse a (k, 3) transit home from the last planned waypoint that exceeds a limit.

    Raises:
        InfeasibleError: it breaks one; the message names the leg.
    """
    _check_planned_transit(site, "the return transit", path_m, far_end=0)


def _check_planned_transit(site: Site, what: str, path_m: FloatArray, *, far_end: int) -> None:
    """Directly above or below a planned waypoint, the height band of the route applies."""
    lowest_agl_m = min(site.scenario.limits.transit_clearance_m, site.scenario.limits.min_height_agl_m)
    check_transit(
        site, what, path_m, far_end=far_end, far_end_lowest_agl_m=lowest_agl_m,
        highest_agl_m=_planned_highest_agl_m(site),
    )  # fmt: skip


def check_transit(
    site: Site,
    what: str,
    points_m: FloatArray,
    *,
    far_end: int,
    far_end_lowest_agl_m: float,
    highest_agl_m: float | None,
    zones: ZoneCheck | None = None,
) -> None:
    """Refuse a transit that exceeds a limit anywhere.

    The leg at its far end, point number ``far_end``, may be vertical; then it has its own lowest height and is exempt from the
    climb limit. The lower sea-level limit does not apply to transits: home may lie below it. ``zones`` are the no-fly zones to
    keep out of, by default with their margins.
    """
    leg = max(far_end, 1)
    ignored = {"below sea-level limit"}
    lowest_agl_m = site.scenario.limits.transit_clearance_m
    if math.hypot(*(points_m[leg, :2] - points_m[leg - 1, :2])) < _VERTICAL_M:
        climb_out = points_m[leg - 1 : leg + 1]
        problems = find_problems(site, climb_out, lowest_agl_m=far_end_lowest_agl_m, highest_agl_m=None, zones=zones)
        refuse(what, [dataclasses.replace(p, leg=leg) for p in problems if p.kind not in {*ignored, "climb"}])
        points_m = np.delete(points_m, far_end, axis=0)
    limits = site.scenario.limits
    problems = find_problems(site, points_m, lowest_agl_m=lowest_agl_m, highest_agl_m=highest_agl_m, zones=zones)
    problems = [problem for problem in problems if problem.kind not in ignored]
    if any(problem.kind == "too high" for problem in problems) and limits.max_transit_height_agl_m is None:
        what += " (to allow this height, raise limits.max_transit_height_agl_m)"
    refuse(what, problems)


def check_climb_out(site: Site, home_m: FloatArray, top_m: FloatArray) -> None:
    """Refuse a take-off or landing column between (3,) home and its top that enters a no-fly zone.

    Raises:
        InfeasibleError: it does; the message names the zone.
    """
    for breach in site.planned_zones.leg_breaches(np.vstack([home_m, top_m])):
        zone = site.zones[breach.zone]
        raise InfeasibleError(
            f"the climb-out above home climbs {top_m[2] - home_m[2]:.0f} m, into no-fly zone {zone.name!r} "
            f"({zone.heights_text()}) or its margin; move [home], or lower vehicle.takeoff_height_m"
        )


def _planned_highest_agl_m(site: Site) -> float:
    """Planned ceiling of transits: the margin for tracking errors applies below the ceiling as well."""
    return site.scenario.transit_ceiling_agl_m - site.scenario.limits.height_margin_m


def refuse(what: str, problems: list[LegProblem]) -> None:
    """Raise an InfeasibleError that names the first problem, if there is any."""
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InfeasibleError(f"{what}: {problems[0]}{more}")


_MOST_CORNERS = 70
"""Corners of an exclusion zone: ArduPilot keeps few hundred corners of a fence in all, and at most 255 of a polygon."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionFence:
    """A fence for a mission."""

    fence: Fence  # one inclusion polygon, then exclusions
    zones: tuple[Zone, ...]  # the no-fly zones among the exclusions
    left_out: tuple[Zone, ...]  # those that the mission passes over or under, or inside whose hole it is


def fence_of(site: Site, frame: LocalFrame, path_m: FloatArray) -> MissionFence:
    """The fence for a mission along a (k, 3) ENU path from and to the column above home."""
    exclusions = _exclusions(site)
    path = shapely.LineString(path_m[:, :2])
    passed = np.zeros(len(site.zones), dtype=bool)
    near = exclusions.index.query(path, predicate="intersects")
    # What meets the outline of a circle, which is the polygon around it, need not meet the zone.
    circles = [site.zones[number].circle for number in near]
    passed[near] = [one is None or path.distance(shapely.Point(one[:2])) <= one[2] for one in circles]
    key = passed.tobytes()
    if key not in exclusions.fences:
        keep_in = shapely.orient_polygons(site.fence)
        polygons = [_polygon(frame, keep_in.exterior, inclusion=True)]
        polygons += [_polygon(frame, ring, inclusion=False) for ring in keep_in.interiors]
        kept = [number for number in range(len(site.zones)) if not passed[number]]
        exclusions.fences[key] = MissionFence(
            Fence(
                tuple(chain(polygons, *(exclusions.polygons[number] for number in kept))),
                tuple(chain(*(exclusions.circles[number] for number in kept))),
            ),
            tuple(site.zones[number] for number in kept),
            tuple(zone for zone, is_passed in zip(site.zones, passed, strict=True) if is_passed),
        )
    return exclusions.fences[key]


@dataclass(frozen=True, slots=True, eq=False)
class _Exclusions:
    """The zones of a site as exclusions of a fence."""

    index: shapely.STRtree  # of their outlines without holes; of circles, of the polygons around them
    polygons: list[tuple[FencePolygon, ...]]  # of each zone
    circles: list[tuple[FenceCircle, ...]]  # of each zone
    fences: dict[bytes, MissionFence]  # those that were made, by the zones that a mission passes over or under


@once
def _exclusions(site: Site) -> _Exclusions:
    """The exclusions of a site, for all its missions."""
    solids: list[shapely.Geometry] = []
    polygons: list[tuple[FencePolygon, ...]] = []
    circles: list[tuple[FenceCircle, ...]] = []
    for zone in site.zones:
        solid = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(zone.outline)])
        solids.append(solid)
        if zone.circle is not None and site.frame is not None:
            east, north, radius = zone.circle
            (center,) = _positions(site.frame, np.array([[east, north]]))
            circles.append((FenceCircle(center, radius, inclusion=False),))
            polygons.append(())
        elif site.frame is not None:
            parts = shapely.get_parts(shapely.orient_polygons(_with_few_corners(zone, solid)))
            circles.append(())
            polygons.append(
                tuple(
                    _polygon(site.frame, part.exterior, inclusion=False)
                    for part in parts
                    if isinstance(part, shapely.Polygon)
                )
            )
    return _Exclusions(shapely.STRtree(solids), polygons, circles, {})


def _with_few_corners(zone: Zone, solid: shapely.Geometry) -> shapely.Geometry:
    """A zone with fewer corners, grown to hold the whole zone, by less than the margin that the mission keeps."""
    reach_m = 0.4 * zone.entry.margin_m
    if shapely.get_num_coordinates(solid) <= _MOST_CORNERS or reach_m <= 0.0 or not isinstance(solid, Polygons):
        return solid
    return solid.buffer(reach_m, join_style="mitre", mitre_limit=1.5).simplify(reach_m)


def _polygon(frame: LocalFrame, ring: shapely.LinearRing, *, inclusion: bool) -> FencePolygon:
    return FencePolygon(tuple(_positions(frame, np.asarray(ring.coords)[:-1, :2])), inclusion)


def _positions(frame: LocalFrame, corners_m: FloatArray) -> list[LatLon]:
    return [LatLon(float(lat), float(lon)) for lon, lat in frame.lon_lat_from_en(corners_m)]
