"""Route to mission: take-off, the way there, the planned waypoints, the way home, landing; every leg checked.

Heights are given above home, so a wrong home would move all of them: ``fly`` and ``plan-upload`` compare it first.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from mission_io.autopilots import autopilot as autopilots
from mission_io.autopilots.checks import check_for_autopilot
from mission_io.autopilots.lists import MissionList, items_of, mission_type_of
from mission_io.model.areas import Fence, FencePolygon, FramedPoint, LatLon, RallyPoints
from mission_io.model.items import (
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    change_speed,
    land,
    takeoff,
    waypoint,
)
from uavcover.errors import InfeasibleError, InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.coverage import sample_path
from uavcover.kernels.obstacle_breach import tops_near_m
from uavcover.kernels.route import follow_terrain
from uavcover.kernels.way_cost import flight_time
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.routes.camera_items import headed, pointing_items, start_pictures, stop_pictures
from uavcover.routes.leg_checks import LegProblem, find_problems
from uavcover.routes.way_cost import pace_of
from uavcover.scenario.frames import LocalFrame
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m

AUTOPILOTS = {"ardupilot": autopilots.ARDUPILOT, "px4": autopilots.PX4}

_NO_CEILING_M = 5_000.0
_TRANSIT_TOLERANCE_M = 15.0
_TRANSIT_SLACK_M = 1.0
"""Added to the height that a transit aims at, for the ground between two samples and for rounding."""
_TRANSIT_TRIES = 5
_SAMPLE_SPACING_M = 5.0
_COLUMN_M = 0.1
"""Legs with less horizontal way than this are vertical columns, which the climb limit does not speak of."""


class MissionTooLongError(InfeasibleError):
    """One flight cannot do it: it takes longer than the endurance, or more items than the autopilot holds."""


@dataclass(frozen=True, slots=True)
class ReturnAdvice:
    """Whether the autopilot's own return, straight home at one height, is safe from every waypoint.

    Checked from all along the legs, not only from the waypoints: a ridge can stand between home and the middle of a leg.

    Attributes:
        return_height_m: height above home that was checked.
        unsafe_waypoints: numbers of the planned waypoints at which, or on the leg to which, it is not. The way there
            counts as the leg to waypoint 0, the way home as the last waypoint's.
        worst_clearance_m: lowest point of all straight lines above ground; NaN when some ground is not known.
        safe_return_height_m: height above home from which every straight line keeps the transit clearance; infinite when
            some ground is not known.
    """

    return_height_m: float
    unsafe_waypoints: tuple[int, ...]
    worst_clearance_m: float
    safe_return_height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class CompiledMission:
    """Everything that goes to the vehicle.

    Attributes:
        mission: home and items.
        fence: one inclusion polygon.
        rally: home at a safe height; empty when no height is known to be safe.
        first_waypoint_item: index in ``mission.items`` of the first planned waypoint.
        waypoint_count: how many planned waypoints follow it, one item each.
        path_m: (k, 3) ENU: column top at home or where the vehicle is, way there, planned waypoints, way home, column top.
        return_advice: on the autopilot's own return.
        max_height_above_home_m: highest point of the whole path above home: what the autopilot's maximum altitude must allow.
        flight_time_s: of the whole path, take-off and landing included.
    """

    mission: Mission
    fence: Fence
    rally: RallyPoints
    first_waypoint_item: int
    waypoint_count: int
    path_m: FloatArray
    return_advice: ReturnAdvice
    max_height_above_home_m: float
    flight_time_s: float


def compile_mission(site: Site, route: Route, *, autopilot: AutopilotName) -> CompiledMission:
    """Compile the planned route of a site, from take-off at home to landing there.

    Raises:
        InputError: the scenario has no place on Earth or no home.
        InfeasibleError: a leg breaks a limit (the message names it), or the autopilot would refuse the mission.
    """
    frame, home = _place(site)
    _check_planned(site, route)
    takeoff_height_m = site.scenario.vehicle.takeoff_height_m
    there = transit(site, home[:2], route.waypoints_m[0], ground_end_height_m=takeoff_height_m)
    opening = [
        _item(takeoff, frame, there[0], home),
        change_speed(site.scenario.vehicle.cruise_speed_m_s),
        *(_item(waypoint, frame, point, home) for point in there[1:-1]),
    ]
    return _compiled(site, route, opening, there, start_m=home, flown_s=0.0, autopilot=autopilot)


def compile_continuation(
    site: Site,
    route: Route,
    *,
    lat_deg: float,
    lon_deg: float,
    alt_amsl_m: float,
    flown_s: float,
    autopilot: AutopilotName,
) -> CompiledMission:
    """Compile a planned route for a vehicle that is in the air: no take-off; straight up or down where it is, then there.

    Args:
        site: the scenario on its ground.
        route: the planned route.
        lat_deg: where the vehicle is.
        lon_deg: where it is.
        alt_amsl_m: where it is.
        flown_s: how long it has been flying, which its endurance has to bear too.
        autopilot: which one flies it.

    Raises:
        InputError: the scenario has no place on Earth or no home.
        InfeasibleError: the vehicle is not in the air, a leg breaks a limit, the flight takes too long, or the autopilot
            would refuse the mission.
    """
    frame, home = _place(site)
    _check_planned(site, route)
    limits = site.scenario.limits
    here = frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    height_agl_m = float(site.ground.heights_agl_m(here)[0])
    if not height_agl_m >= min(limits.transit_clearance_m, limits.min_height_agl_m):
        raise InfeasibleError(
            f"the vehicle is {height_agl_m:.1f} m above ground at {lat_deg:.6f}, {lon_deg:.6f}, which is no flight inside the "
            "limits; a mission that begins in the air needs a vehicle that is there"
        )
    there = transit(site, here[:2], route.waypoints_m[0], ground_end_height_m=height_agl_m)
    opening = [
        change_speed(site.scenario.vehicle.cruise_speed_m_s),
        *(_item(waypoint, frame, point, home) for point in there[:-1]),
    ]
    return _compiled(site, route, opening, there, start_m=here, flown_s=flown_s, autopilot=autopilot)


def _check_planned(site: Site, route: Route) -> None:
    """Refuse a planned route that is empty or breaks a limit."""
    if len(route.waypoints_m) == 0:
        raise InfeasibleError("the route has no waypoints")
    limits = site.scenario.limits
    problems = find_problems(
        site, route.waypoints_m, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m
    )
    _refuse("the planned route", problems)


def _compiled(
    site: Site, route: Route, opening: list[MissionItem], there_m: FloatArray,
    *, start_m: FloatArray, flown_s: float, autopilot: AutopilotName,
) -> CompiledMission:  # fmt: skip
    """The whole mission behind its opening items, which lead along ``there_m`` to the first planned waypoint."""
    frame, home = _place(site)
    planned, vehicle = route.waypoints_m, site.scenario.vehicle
    back = transit(site, home[:2], planned[-1], ground_end_height_m=vehicle.takeoff_height_m)[::-1]
    check_way_there(site, there_m)
    check_way_home(site, back)

    sensor = site.scenario.sensor
    first, *_ = sensing = [headed(_item(waypoint, frame, point, home), sensor, autopilot) for point in planned]
    opening = [*opening, *pointing_items(sensor, autopilot)]
    picture_distance_m = trigger_distance_m(site.scenario)
    if picture_distance_m is not None:
        # A command is carried out once the waypoint in front of it is reached: so the first one stands there twice.
        opening += [first, start_pictures(picture_distance_m)]
        sensing.append(stop_pictures())
    items = [*opening, *sensing]
    items += [_item(waypoint, frame, point, home) for point in back[1:]]
    items.append(_item(land, frame, home, home))
    mission = Mission(_geo_point(frame, home), tuple(items))
    path = np.vstack([there_m[:-1], planned, back[1:]])
    time_s = _flight_time_s(site, path, start_m, home)
    if vehicle.endurance_s is not None and flown_s + time_s > vehicle.endurance_s:
        before = f" after {flown_s:.0f} s in the air" if flown_s > 0.0 else ""
        raise MissionTooLongError(
            f"the flight takes {time_s:.0f} s with the ways there and home{before}, vehicle.endurance_s is "
            f"{vehicle.endurance_s:.0f} s; ask for less coverage (--select), or plan a smaller area"
        )
    advice = check_straight_return(site, path, first_waypoint=len(there_m) - 1, waypoint_count=len(planned))
    fence, rally = _fence(site, frame), _rally(frame, home, advice)
    for content in (mission, fence, rally):
        _check_autopilot(content, AUTOPILOTS[autopilot], item_limit=vehicle.max_mission_items)
    return CompiledMission(
        mission=mission,
        fence=fence,
        rally=rally,
        first_waypoint_item=len(opening),
        waypoint_count=len(planned),
        path_m=path,
        return_advice=advice,
        max_height_above_home_m=float(site.alts_amsl_m(path).max() - site.alts_amsl_m(home)[0]),
        flight_time_s=time_s,
    )


def compile_return(site: Site, *, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
    """A mission home from where the vehicle is, over the terrain, every leg checked.

    Raises:
        InfeasibleError: no checked way home from there.
    """
    frame, home = _place(site)
    here = frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    back = transit(site, home[:2], here, ground_end_height_m=site.scenario.vehicle.takeoff_height_m)[::-1]
    # The vehicle may be lower than the clearance right now, wherever that is: then it goes straight up from there first.
    # It may also be higher than the ceiling: to keep it there because of that would be the worse of two.
    _check_transit(site, "the way home", back, far_end=0, far_end_lowest_agl_m=-math.inf, highest_agl_m=None)
    items = [_item(waypoint, frame, point, home) for point in back[1:]]
    return Mission(_geo_point(frame, home), (*items, _item(land, frame, home, home)))


def transit(site: Site, home_en_m: FloatArray, end_m: FloatArray, *, ground_end_height_m: float) -> FloatArray:
    """A way between the column above home and a point, over the terrain.

    It aims at the transit clearance and the height margin above it, for what the vehicle adds in flight, and leads over
    obstacles.

    Args:
        site: the scenario on its ground.
        home_en_m: (2,) where the column stands.
        end_m: (3,) ENU point at the other end, kept exactly; if the terrain demands more height there, a vertical leg is added.
        ground_end_height_m: height above home of the column's top, raised where the way needs more.

    Returns:
        (k, 3) ENU from the column's top to the point.
    """
    limits, obstacles = site.scenario.limits, site.scenario.obstacles
    wanted_m = limits.transit_clearance_m + limits.height_margin_m
    if math.hypot(*(end_m[:2] - home_en_m)) < _COLUMN_M:
        home_ground = float(site.ground.heights_m(home_en_m)[0])
        top = home_ground + max(ground_end_height_m, wanted_m + _TRANSIT_SLACK_M)
        return np.vstack([[*home_en_m, max(end_m[2], top)], end_m])
    aim_m = wanted_m + _TRANSIT_SLACK_M
    for attempt in range(_TRANSIT_TRIES):
        points = follow_terrain(
            site.ground.surface,
            np.vstack([home_en_m, end_m[:2]]),
            np.array([ground_end_height_m, max(float(site.ground.heights_agl_m(end_m)[0]), aim_m)]),
            aim_m,
            _NO_CEILING_M,
            math.tan(math.radians(limits.max_climb_angle_deg)) * (1.0 - 1e-9),
            _TRANSIT_TOLERANCE_M,
            _SAMPLE_SPACING_M / 2.0**attempt,
            obstacles.clearance_beside_m,
            obstacles.clearance_above_m + (limits.height_margin_m if site.prisms else 0.0),
        )
        lowest = float(site.ground.leg_height_ranges_m(points)[:, 0].min())
        if not lowest < wanted_m:
            break
        # The ground rises between two samples by more than the slack: once more, as much higher and looking closer.
        aim_m += wanted_m - lowest + _TRANSIT_SLACK_M
    if abs(points[-1, 2] - end_m[2]) <= _COLUMN_M:
        # So close: end in the point itself, at the price of a hair of slope.
        points[-1] = end_m
        return points
    return np.vstack([points, end_m])


def check_straight_return(site: Site, path_m: FloatArray, *, first_waypoint: int, waypoint_count: int) -> ReturnAdvice:
    """Check the autopilot's own return from all along a path: up to the return height, then straight home.

    Args:
        site: the scenario on its ground.
        path_m: (k, 3) ENU, the whole flight between the columns above home.
        first_waypoint: row of the first planned waypoint in it.
        waypoint_count: how many planned waypoints follow.
    """
    _, home = _place(site)
    height = site.scenario.vehicle.return_height_m
    clearance = site.scenario.limits.transit_clearance_m
    spacing = min(_SAMPLE_SPACING_M, site.ground.surface.step_m)
    lowest = np.full(len(path_m), np.inf)
    highest_ground = -math.inf
    for row in range(len(path_m)):
        starts = sample_path(np.ascontiguousarray(path_m[max(row - 1, 0) : row + 1]), spacing)
        ups = np.maximum(starts[:, 2], home[2] + height)
        clear = np.minimum(
            _lowest_on_the_way_home_m(site, starts, ups, home), _clear_of_tops_m(site, starts, ups, home) + clearance
        )
        lowest[row] = np.min(clear, initial=np.inf)
        # A level line: the highest ground below it is where it is lowest above ground.
        highest_ground = float(np.maximum(highest_ground, np.max(ups - clear, initial=-np.inf)))
    unsafe = np.flatnonzero(~(lowest >= clearance)) - first_waypoint
    known = math.isfinite(highest_ground)
    safe_up_m = highest_ground + clearance
    # At another height than the lines that were looked at, the ground below along plumb lines lies a little aside.
    safe_up_m += site.ground.lean_error_m(abs(safe_up_m - float(home[2]) - height)) if known else 0.0
    return ReturnAdvice(
        return_height_m=height,
        unsafe_waypoints=tuple(int(k) for k in np.unique(np.clip(unsafe, 0, waypoint_count - 1))),
        worst_clearance_m=float(lowest.min()),
        safe_return_height_m=max(0.0, safe_up_m - float(home[2])) if known else math.inf,
    )


def _lowest_on_the_way_home_m(site: Site, starts_m: FloatArray, ups_m: FloatArray, home_m: FloatArray) -> FloatArray:
    """(n,) lowest height above ground of level lines from above (n, 3) places to the landing column; NaN if not known."""
    to_home = home_m[:2] - starts_m[:, :2]
    distance = np.hypot(to_home[:, 0], to_home[:, 1])
    # The last metres are the landing column.
    share = np.maximum(0.0, 1.0 - site.scenario.vehicle.acceptance_radius_m / np.maximum(distance, 1e-9))
    ends = starts_m[:, :2] + share[:, None] * to_home
    # There and back in one line of (2 n) points: every second leg is one way home.
    line = np.empty((2 * len(starts_m), 3))
    line[0::2] = np.column_stack([starts_m[:, :2], ups_m])
    line[1::2] = np.column_stack([ends, ups_m])
    return site.ground.leg_height_ranges_m(line)[0::2, 0]


def _clear_of_tops_m(site: Site, starts_m: FloatArray, ups_m: FloatArray, home_m: FloatArray) -> FloatArray:
    """(n,) how much higher than asked for the same lines pass over obstacles; infinite where there is none, negative: too low."""
    lines = np.hstack([starts_m[:, :2], np.tile(home_m[:2], (len(starts_m), 1))])
    limits = site.scenario.obstacles
    tops = tops_near_m(site.ground.surface.obstacles, np.ascontiguousarray(lines), limits.clearance_beside_m)
    return np.asarray(ups_m - tops - limits.clearance_above_m)


def _place(site: Site) -> tuple[LocalFrame, FloatArray]:
    if site.frame is None:
        raise InputError(
            f"scenario {site.scenario.name}: has no place on Earth, so there is no mission to fly; "
            "give it an [origin] and a [home]"
        )
    if site.home_m is None:
        raise InputError(
            f"scenario {site.scenario.name}: has no [home]; a mission needs the place to take off and land"
        )
    return site.frame, site.home_m


def _refuse(what: str, problems: list[LegProblem]) -> None:
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InfeasibleError(f"{what}: {problems[0]}{more}")


def check_way_there(site: Site, way_m: FloatArray) -> None:
    """Refuse a way (k, 3) to the first planned waypoint, its last point, that breaks a limit.

    Raises:
        InfeasibleError: it does; the message names the leg.
    """
    _check_transit(
        site, "the way there", way_m, far_end=len(way_m) - 1, far_end_lowest_agl_m=_end_lowest_agl_m(site),
        highest_agl_m=_planned_highest_agl_m(site),
    )  # fmt: skip


def check_way_home(site: Site, way_m: FloatArray) -> None:
    """Refuse a way (k, 3) from the last planned waypoint, its first point, that breaks a limit.

    Raises:
        InfeasibleError: it does; the message names the leg.
    """
    _check_transit(
        site, "the way home", way_m, far_end=0, far_end_lowest_agl_m=_end_lowest_agl_m(site),
        highest_agl_m=_planned_highest_agl_m(site),
    )  # fmt: skip


def _end_lowest_agl_m(site: Site) -> float:
    """Straight above or below a planned waypoint the band of the route applies, which may be lower than the clearance."""
    return min(site.scenario.limits.transit_clearance_m, site.scenario.limits.min_height_agl_m)


def _planned_highest_agl_m(site: Site) -> float:
    """What the vehicle adds in flight: the margin that keeps it above the clearance keeps it below the ceiling too."""
    return site.scenario.transit_ceiling_agl_m - site.scenario.limits.height_margin_m


def _check_transit(
    site: Site,
    what: str,
    points_m: FloatArray,
    *,
    far_end: int,
    far_end_lowest_agl_m: float,
    highest_agl_m: float | None,
) -> None:
    """Refuse a transit that breaks a limit at any place.

    The leg at its far end, point number ``far_end``, may go straight up or down; then it has its own lowest height, and the
    climb limit does not speak of it. Nor does the lower sea-level limit of transits: home may lie below it.
    """
    leg = max(far_end, 1)
    ignored = {"below sea-level limit"}
    lowest_agl_m = site.scenario.limits.transit_clearance_m
    if math.hypot(*(points_m[leg, :2] - points_m[leg - 1, :2])) < _COLUMN_M:
        column = points_m[leg - 1 : leg + 1]
        problems = find_problems(site, column, lowest_agl_m=far_end_lowest_agl_m, highest_agl_m=None)
        _refuse(what, [dataclasses.replace(p, leg=leg) for p in problems if p.kind not in {*ignored, "climb"}])
        points_m = np.delete(points_m, far_end, axis=0)
    limits = site.scenario.limits
    problems = find_problems(site, points_m, lowest_agl_m=lowest_agl_m, highest_agl_m=highest_agl_m)
    problems = [problem for problem in problems if problem.kind not in ignored]
    if any(problem.kind == "too high" for problem in problems) and limits.max_transit_height_agl_m is None:
        what += " (limits.max_transit_height_agl_m allows more)"
    _refuse(what, problems)


def _check_autopilot(content: MissionList, autopilot: autopilots.Autopilot, *, item_limit: int | None) -> None:
    """Refuse a list that the autopilot would not take or would understand otherwise."""
    items = items_of(content, autopilot)
    problems = check_for_autopilot(items, autopilot, mission_type_of(content))
    if problems:
        # Too many items are said of the list as a whole.
        refused = MissionTooLongError if problems[0].item is None else InfeasibleError
        raise refused(f"{autopilot.name} would not take this {mission_type_of(content).name.lower()}: {problems[0]}")
    if item_limit is not None and mission_type_of(content) is MissionType.MISSION and len(items) > item_limit:
        raise MissionTooLongError(f"the mission has {len(items)} items, vehicle.max_mission_items is {item_limit}")


def _item(make: Callable[..., MissionItem], frame: LocalFrame, point_m: FloatArray, home_m: FloatArray) -> MissionItem:
    """An item at a place. Its heading is left to the vehicle, whose nose follows the path: for PX4 a 0 would be north."""
    place = _geo_point(frame, point_m)
    home_alt = _geo_point(frame, home_m).alt_amsl_m
    item = make(place.lat_deg, place.lon_deg, place.alt_amsl_m - home_alt, frame=Frame.ABOVE_HOME)
    return dataclasses.replace(item, params=(*item.params[:3], math.nan))


def _geo_point(frame: LocalFrame, point_m: FloatArray) -> GeoPoint:
    lat, lon, alt = frame.geodetic_from_enu(point_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def _fence(site: Site, frame: LocalFrame) -> Fence:
    corners = np.asarray(shapely.orient_polygons(site.fence).exterior.coords)[:-1]
    lat, lon, _ = frame.geodetic_from_enu(np.column_stack([corners, np.zeros(len(corners))]))
    return Fence((FencePolygon(tuple(LatLon(float(a), float(o)) for a, o in zip(lat, lon, strict=True))),))


def _rally(frame: LocalFrame, home_m: FloatArray, advice: ReturnAdvice) -> RallyPoints:
    if not math.isfinite(advice.safe_return_height_m):
        return RallyPoints(())
    place = _geo_point(frame, home_m)
    height = max(advice.return_height_m, math.ceil(advice.safe_return_height_m))
    return RallyPoints((FramedPoint(place.lat_deg, place.lon_deg, float(height), Frame.ABOVE_HOME),))


def _flight_time_s(site: Site, path_m: FloatArray, start_m: FloatArray, home_m: FloatArray) -> float:
    return float(flight_time(pace_of(site), np.vstack([start_m, path_m, home_m])))
