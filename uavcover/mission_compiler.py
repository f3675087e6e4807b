"""Route to mission: take-off, the way there, the planned waypoints, the way home, landing; every leg checked.

Heights are given above home, so a wrong home would move all of them: ``fly`` and ``plan-upload`` compare it first.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from mission_io import autopilots
from mission_io.areas import Fence, FencePolygon, FramedPoint, LatLon, RallyPoints
from mission_io.checks import check_for_autopilot
from mission_io.items import Frame, GeoPoint, Mission, MissionItem, MissionType, change_speed, land, takeoff, waypoint
from uavcover.errors import InfeasibleError, InputError
from uavcover.frames import LocalFrame
from uavcover.kernels.route import flight_time, follow_terrain
from uavcover.leg_checks import LegProblem, find_problems
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.site import Site

FloatArray = NDArray[np.float64]

AUTOPILOTS = {"ardupilot": autopilots.ARDUPILOT, "px4": autopilots.PX4}

_NO_CEILING_M = 1e5
_TRANSIT_TOLERANCE_M = 15.0
_TRANSIT_SLACK_M = 1.0
_SAMPLE_SPACING_M = 5.0
_COLUMN_M = 0.1
"""Legs with less horizontal way than this are vertical columns, which the climb limit does not speak of."""


@dataclass(frozen=True, slots=True)
class ReturnAdvice:
    """Whether the autopilot's own return, straight home at one height, is safe from every waypoint.

    Attributes:
        return_height_m: height above home that was checked.
        unsafe_waypoints: numbers of the planned waypoints from which it is not.
        worst_clearance_m: lowest point of all straight lines above ground.
        safe_return_height_m: height above home from which every straight line keeps the transit clearance.
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
        rally: empty, or home at a safe height.
        first_waypoint_item: index in ``mission.items`` of the first planned waypoint.
        waypoint_count: how many planned waypoints follow it, one item each.
        path_m: (k, 3) ENU: column top at home, way there, planned waypoints, way home, column top.
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
    """Compile the planned route of a site.

    Raises:
        InputError: the scenario has no place on Earth or no home.
        InfeasibleError: a leg breaks a limit (the message names it), or the autopilot would refuse the mission.
    """
    frame, home = _place(site)
    planned = route.waypoints_m
    if len(planned) == 0:
        raise InfeasibleError("the route has no waypoints")
    limits, vehicle = site.scenario.limits, site.scenario.vehicle
    _refuse(
        "the planned route",
        find_problems(site, planned, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m),
    )
    there = transit(site, home[:2], planned[0], ground_end_height_m=vehicle.takeoff_height_m)
    back = transit(site, home[:2], planned[-1], ground_end_height_m=vehicle.takeoff_height_m)[::-1]
    _check_transit(site, "the way there", there)
    _check_transit(site, "the way home", back)

    items = [_item(takeoff, frame, there[0], home), change_speed(vehicle.cruise_speed_m_s)]
    items += [_item(waypoint, frame, point, home) for point in there[1:-1]]
    first = len(items)
    items += [_item(waypoint, frame, point, home) for point in planned]
    items += [_item(waypoint, frame, point, home) for point in back[1:]]
    items.append(_item(land, frame, home, home))
    mission = Mission(_geo_point(frame, home), tuple(items))
    problems = check_for_autopilot(mission.items, AUTOPILOTS[autopilot], MissionType.MISSION)
    if problems:
        raise InfeasibleError(f"{AUTOPILOTS[autopilot].name} would not take this mission: {problems[0]}")
    path = np.vstack([there[:-1], planned, back[1:]])
    time_s = _flight_time_s(site, path, home)
    if vehicle.endurance_s is not None and time_s > vehicle.endurance_s:
        raise InfeasibleError(
            f"the flight takes {time_s:.0f} s with the ways there and home, vehicle.endurance_s is {vehicle.endurance_s:.0f} s; "
            "ask for less coverage (--select), or plan a smaller area"
        )
    advice = check_straight_return(site, planned)
    return CompiledMission(
        mission=mission,
        fence=_fence(site, frame),
        rally=RallyPoints((_rally(frame, home, advice),)),
        first_waypoint_item=first,
        waypoint_count=len(planned),
        path_m=path,
        return_advice=advice,
        max_height_above_home_m=float(path[:, 2].max() - home[2]),
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
    # The vehicle may be lower than the clearance right now; from the next point on the way is checked.
    _check_transit(site, "the way home", back if len(back) < 3 else back[1:])
    items = [_item(waypoint, frame, point, home) for point in back[1:]]
    return Mission(_geo_point(frame, home), (*items, _item(land, frame, home, home)))


def transit(site: Site, home_en_m: FloatArray, end_m: FloatArray, *, ground_end_height_m: float) -> FloatArray:
    """A way between the column above home and a point, over the terrain.

    Args:
        site: the scenario on its ground.
        home_en_m: (2,) where the column stands.
        end_m: (3,) ENU point at the other end, kept exactly; if the terrain demands more height there, a vertical leg is added.
        ground_end_height_m: height above home of the column's top, raised where the way needs more.

    Returns:
        (k, 3) ENU from the column's top to the point.
    """
    limits = site.scenario.limits
    end_ground = float(site.ground.heights_m(end_m[:2])[0])
    if math.hypot(*(end_m[:2] - home_en_m)) < _COLUMN_M:
        return np.vstack(
            [[*home_en_m, max(end_m[2], site.ground.heights_m(home_en_m)[0] + ground_end_height_m)], end_m]
        )
    points = follow_terrain(
        site.ground.surface,
        np.vstack([home_en_m, end_m[:2]]),
        np.array([ground_end_height_m, max(end_m[2] - end_ground, limits.transit_clearance_m)]),
        limits.transit_clearance_m + _TRANSIT_SLACK_M,
        _NO_CEILING_M,
        math.tan(math.radians(limits.max_climb_angle_deg)) * (1.0 - 1e-9),
        _TRANSIT_TOLERANCE_M,
        _SAMPLE_SPACING_M,
    )
    if abs(points[-1, 2] - end_m[2]) <= _COLUMN_M:
        # So close: end in the point itself, at the price of a hair of slope.
        points[-1] = end_m
        return points
    return np.vstack([points, end_m])


def check_straight_return(site: Site, planned_m: FloatArray) -> ReturnAdvice:
    """Check the autopilot's own return from every planned waypoint: up to the return height, then straight home."""
    _, home = _place(site)
    height = site.scenario.vehicle.return_height_m
    clearance = site.scenario.limits.transit_clearance_m
    lowest = np.empty(len(planned_m))
    highest_ground = -math.inf
    for k, point in enumerate(planned_m):
        up = max(point[2], home[2] + height)
        # The last metres are the landing column.
        along = home[:2] - point[:2]
        distance = max(float(np.hypot(*along)), 1e-9)
        end = point[:2] + along * max(0.0, 1.0 - site.scenario.vehicle.acceptance_radius_m / distance)
        line = np.array([[*point[:2], up], [*end, up]])
        lowest[k] = site.ground.leg_height_ranges_m(line)[0, 0]
        highest_ground = max(highest_ground, up - lowest[k])
    return ReturnAdvice(
        return_height_m=height,
        unsafe_waypoints=tuple(int(k) for k in np.flatnonzero(lowest < clearance)),
        worst_clearance_m=float(lowest.min()),
        safe_return_height_m=float(max(0.0, highest_ground + clearance - home[2])),
    )


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


def _check_transit(site: Site, what: str, points_m: FloatArray) -> None:
    problems = find_problems(site, points_m, lowest_agl_m=site.scenario.limits.transit_clearance_m, highest_agl_m=None)
    columns = {
        leg for leg in range(1, len(points_m)) if math.hypot(*(points_m[leg, :2] - points_m[leg - 1, :2])) < _COLUMN_M
    }
    _refuse(
        what,
        [p for p in problems if not (p.kind == "climb" and p.leg in columns) and p.kind != "below sea-level limit"],
    )


def _item(make: object, frame: LocalFrame, point_m: FloatArray, home_m: FloatArray) -> MissionItem:
    place = _geo_point(frame, point_m)
    home_alt = _geo_point(frame, home_m).alt_amsl_m
    return make(place.lat_deg, place.lon_deg, place.alt_amsl_m - home_alt, frame=Frame.ABOVE_HOME)  # type: ignore[operator, no-any-return]


def _geo_point(frame: LocalFrame, point_m: FloatArray) -> GeoPoint:
    lat, lon, alt = frame.geodetic_from_enu(point_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def _fence(site: Site, frame: LocalFrame) -> Fence:
    corners = np.asarray(shapely.orient_polygons(site.fence).exterior.coords)[:-1]
    lat, lon, _ = frame.geodetic_from_enu(np.column_stack([corners, np.zeros(len(corners))]))
    return Fence((FencePolygon(tuple(LatLon(float(a), float(o)) for a, o in zip(lat, lon, strict=True))),))


def _rally(frame: LocalFrame, home_m: FloatArray, advice: ReturnAdvice) -> FramedPoint:
    place = _geo_point(frame, home_m)
    height = max(advice.return_height_m, math.ceil(advice.safe_return_height_m))
    return FramedPoint(place.lat_deg, place.lon_deg, height, Frame.ABOVE_HOME)


def _flight_time_s(site: Site, path_m: FloatArray, home_m: FloatArray) -> float:
    vehicle = site.scenario.vehicle
    whole = np.vstack([home_m, path_m, home_m])
    return float(flight_time(whole, vehicle.cruise_speed_m_s, vehicle.max_climb_m_s, vehicle.max_descent_m_s))
