"""Compile a route into a mission: take-off, transit, planned waypoints, transit home, landing; every leg is checked.

Heights are above home, so a wrong home would shift all of them; ``fly`` and ``plan-upload`` compare it first.

Camera items follow each autopilot. ArduPilot takes gimbal angles as DO_GIMBAL_MANAGER_PITCHYAW, in whole degrees, and can hold a
heading; its DO_MOUNT_CONTROL would turn a vehicle whose gimbal has no yaw axis. PX4 refuses DO_GIMBAL_MANAGER_PITCHYAW in a
mission unless the mission controls the gimbal, so it gets DO_MOUNT_CONTROL, as ground stations send it, and holds a heading by
its waypoints. A photo at a waypoint is DO_DIGICAM_CONTROL for all versions of ArduPilot, and IMAGE_START_CAPTURE for PX4.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import shapely

from mission_io.autopilots import autopilot as autopilots
from mission_io.autopilots.mission_lists import MissionList, check_for_autopilot, items_of, mission_type_of
from mission_io.model.actions import PointGimbal, PointMount, StartPictures, TakePicture, item_of
from mission_io.model.items import (
    Fence,
    Frame,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    change_speed,
    land,
    takeoff,
    trigger_camera_every,
    waypoint,
)
from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.kernels.flight_time import flight_time, landing_time, leg_time, takeoff_time
from uavcover.missions.leg_checks import find_corner_problems, find_problems
from uavcover.missions.path_cost import (
    FlightEnergy,
    battery_text,
    battery_used_s,
    longest_flight_text,
    usable_s,
)
from uavcover.missions.return_advice import OwnReturns, ReturnAdvice, with_rally
from uavcover.missions.transit import (
    check_climb_out,
    check_outbound,
    check_return,
    check_transit,
    fence_of,
    frame_and_home,
    refuse,
    transit,
)
from uavcover.model.route import Route
from uavcover.model.sensor import Sensor
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.airspace.flyable import is_wall
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of
from uavcover.sensing.sensors import trigger_distance_m
from uavcover.terrain.frames import LocalFrame

_HEIGHT_DECIMALS = 3
"""Heights are compiled to the millimetre: degrees reach a vehicle in steps of 1e-7, which are a centimetre."""
_YAW_LOCK = 16
"""GIMBAL_MANAGER_FLAGS: yaw is a heading, not an angle relative to the vehicle."""


def pointing_items(sensor: Sensor, autopilot: AutopilotName) -> list[MissionItem]:
    """Items that point a stabilised camera as the scenario requires; empty for other sensors.

    Raises:
        InfeasibleError: the autopilot cannot keep the angle.
    """
    pitch_deg, heading_deg = sensor.pitch_deg, sensor.heading_deg
    if pitch_deg is None or sensor.mount != "stabilised":
        return []
    if autopilot == "px4":
        return [item_of(PointMount(pitch_deg))]
    for key, angle in (("pitch_deg", pitch_deg), ("heading_deg", heading_deg)):
        if angle is not None and not angle.is_integer():
            raise InfeasibleError(
                f"sensor.{key}: ArduPilot stores gimbal angles in whole degrees and would change {angle:g}; use "
                f"{round(angle)}"
            )
    flags = 0 if heading_deg is None else _YAW_LOCK
    yaw_deg = 0.0 if heading_deg is None else heading_deg
    return [item_of(PointGimbal(pitch_deg, yaw_deg, 0.0, 0.0, flags=flags))]


def headed(item: MissionItem, sensor: Sensor, autopilot: AutopilotName) -> MissionItem:
    """The waypoint, for PX4 with the heading to hold on the way to it if the scenario sets one."""
    if autopilot != "px4" or sensor.heading_deg is None:
        return item
    return replace(item, params=(*item.params[:3], sensor.heading_deg))


def photo_at_waypoint(number: int, autopilot: AutopilotName) -> MissionItem:
    """Take one photo at planned waypoint ``number``, from 0: carried out once the waypoint before it is reached."""
    return item_of(StartPictures(count=1, first_number=number + 1) if autopilot == "px4" else TakePicture())


def items_per_waypoint(sensor: Sensor) -> int:
    """Number of mission items of a planned waypoint: itself, and a photo where the sensor looks from the waypoints."""
    return 2 if not sensor.looks_along_path else 1


AUTOPILOTS = {"ardupilot": autopilots.ARDUPILOT, "px4": autopilots.PX4}


class MissionTooLongError(InfeasibleError):
    """One flight is not enough: it exceeds the endurance, or the autopilot's number of items."""


@dataclass(frozen=True, eq=False)
class CompiledMission:
    """The complete mission for the vehicle, with the facts that checks and reports need.

    The autopilot's own returns are judged on demand, because most flights are compiled only for their size or time.
    """

    mission: Mission  # home and items
    fence: Fence  # one inclusion polygon, then its holes and no-fly zones as exclusions
    first_waypoint_item: int  # index in ``mission.items`` of the first planned waypoint
    waypoint_count: int  # number of planned waypoints from it on
    items_per_waypoint: int  # number of items of each of them, itself first
    # (k, 3) ENU: top of the column at home (or the vehicle's position), transit, planned waypoints, transit home, top
    # of the column
    path_m: FloatArray
    bare_returns: OwnReturns  # the autopilot's own returns, before rally points
    # highest point of the whole path above home: what the autopilot's maximum altitude must allow
    max_height_above_home_m: float
    flight_time_s: float  # of the whole path, take-off and landing included
    # fraction of a full battery, in the worst of the winds that it is planned for; None without an endurance
    battery_used: float | None = None
    zones_in_fence: tuple[Zone, ...] = ()  # the no-fly zones that are exclusions of the fence
    # those that are not, because the path passes over or under them and a fence has no floors
    zones_left_out: tuple[Zone, ...] = ()

    @property
    def own_returns(self) -> OwnReturns:
        """Judges the autopilot's own returns by a vehicle's parameters."""
        return self._returns[0]

    @property
    def return_advice(self) -> ReturnAdvice:
        """Whether they are safe by the scenario's values."""
        return self._returns[1]

    @property
    def rally(self) -> RallyPoints:
        """Home at a safe height, if known; then proposed points if the scenario asks for them."""
        return RallyPoints(self.own_returns.rally)

    @cached_property
    def _returns(self) -> tuple[OwnReturns, ReturnAdvice]:
        returns, advice = with_rally(self.bare_returns)
        _check_autopilot(RallyPoints(returns.rally), AUTOPILOTS[returns.autopilot], item_limit=None)
        return returns, advice


def compile_mission(site: Site, route: Route, *, autopilot: AutopilotName | None = None) -> CompiledMission:
    """Compile the planned route of a site, from take-off at home to landing there; default: the scenario's autopilot.

    Raises:
        InputError: the scenario has no position on Earth or no home.
        InfeasibleError: a leg exceeds a limit (the message names it), or the autopilot would refuse the mission.
    """
    frame, home = frame_and_home(site)
    _check_planned(site, route)
    autopilot = autopilot or site.scenario.vehicle.autopilot
    takeoff_height_m = site.scenario.vehicle.takeoff_height_m
    there = transit(site, home[:2], route.waypoints_m[0], ground_end_height_m=takeoff_height_m)
    opening = [
        _item(takeoff, frame, there[0], home),
        change_speed(site.scenario.vehicle.cruise_speed_m_s),
        *(_item(waypoint, frame, point, home) for point in there[1:-1]),
    ]
    check_climb_out(site, home, there[0])
    climb_m = float(there[0, 2] - home[2])
    climb = _Begin(takeoff_time(pace_of(site, autopilot), climb_m), FlightEnergy(site, autopilot).takeoff_s(climb_m))
    return _compiled(site, route, opening, there, begin=climb, flown_s=0.0, autopilot=autopilot)


def compile_continuation(
    site: Site,  # the scenario on its ground
    route: Route,  # the planned route
    *,
    lat_deg: float,  # latitude of the vehicle
    lon_deg: float,  # longitude of the vehicle
    alt_amsl_m: float,  # height of the vehicle
    flown_s: float,  # time in the air so far, which counts towards the endurance
    autopilot: AutopilotName,  # the autopilot that flies it
) -> CompiledMission:
    """Compile a planned route for a vehicle in flight.

    A vertical leg at its position replaces the take-off; the transit follows.

    Raises:
        InputError: the scenario has no position on Earth or no home.
        InfeasibleError: the vehicle is not in the air, a leg exceeds a limit, the flight takes too long, or the autopilot would
            refuse the mission.
    """
    frame, home = frame_and_home(site)
    _check_planned(site, route)
    limits = site.scenario.limits
    here = frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    height_agl_m = float(site.ground.heights_agl_m(here)[0])
    if not height_agl_m >= min(limits.transit_clearance_m, limits.min_height_agl_m):
        raise InfeasibleError(
            f"the vehicle is {height_agl_m:.1f} m above ground at {lat_deg:.6f}, {lon_deg:.6f}, outside the flight "
            "limits; to begin a mission in the air, the vehicle must be within them"
        )
    there = transit(site, here[:2], route.waypoints_m[0], ground_end_height_m=height_agl_m)
    opening = [
        change_speed(site.scenario.vehicle.cruise_speed_m_s),
        *(_item(waypoint, frame, point, home) for point in there[:-1]),
    ]
    climb_s = leg_time(pace_of(site, autopilot), _position(here), _position(there[0]))
    climb = _Begin(climb_s, FlightEnergy(site, autopilot).path_s(np.vstack([here, there[0]])))
    return _compiled(site, route, opening, there, begin=climb, flown_s=flown_s, autopilot=autopilot)


@dataclass(frozen=True, slots=True, eq=False)
class _Begin:
    """Start of a mission, before its path: seconds, and (w,) hovering seconds in the planned winds."""

    time_s: float
    energy_s: FloatArray


def _check_planned(site: Site, route: Route) -> None:
    """Refuse a planned route that is empty or exceeds a limit."""
    if len(route.waypoints_m) == 0:
        raise InfeasibleError("the route has no waypoints")
    limits = site.scenario.limits
    problems = find_problems(
        site, route.waypoints_m, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m
    )
    refuse("the planned route", problems or find_corner_problems(site, route.waypoints_m, with_ends=False))


def _compiled(
    site: Site, route: Route, opening: list[MissionItem], there_m: FloatArray,
    *, begin: _Begin, flown_s: float, autopilot: AutopilotName,
) -> CompiledMission:  # fmt: skip
    """Complete a mission from its opening items; these follow ``there_m`` to the first waypoint, after what it begins with."""
    frame, home = frame_and_home(site)
    planned, vehicle = route.waypoints_m, site.scenario.vehicle
    back = transit(site, home[:2], planned[-1], ground_end_height_m=vehicle.takeoff_height_m)[::-1]
    check_outbound(site, there_m)
    check_return(site, back)
    check_climb_out(site, home, back[-1])

    sensor = site.scenario.sensor
    first, *_ = sensing = [headed(_item(waypoint, frame, point, home), sensor, autopilot) for point in planned]
    opening = [*opening, *pointing_items(sensor, autopilot)]
    photo_distance_m = trigger_distance_m(site.scenario)
    if photo_distance_m is not None:
        # a command is executed once the waypoint before it is reached, so the first waypoint appears twice.
        opening += [first, trigger_camera_every(photo_distance_m)]
        sensing.append(trigger_camera_every(0.0))
    if not sensor.looks_along_path:
        photos = [photo_at_waypoint(number, autopilot) for number in range(len(planned))]
        sensing = [item for pair in zip(sensing, photos, strict=True) for item in pair]
    items = [*opening, *sensing]
    items += [_item(waypoint, frame, point, home) for point in back[1:]]
    items.append(_item(land, frame, home, home))
    mission = Mission(_home_point(frame, home), tuple(items))
    path = np.vstack([there_m[:-1], planned, back[1:]])
    # Waypoints that stand twice in the mission stop the vehicle.
    stops = 0 if photo_distance_m is None else 1
    timed = np.vstack([there_m[:-1], *[planned[:1]] * stops, planned, back[1:]])
    pace = pace_of(site, autopilot)
    time_s = begin.time_s + flight_time(pace, read_only(timed)) + landing_time(pace, timed[-1, 2] - home[2])
    before = f" after {flown_s:.0f} s in the air" if flown_s > 0.0 else ""
    if vehicle.longest_flight_s is not None and flown_s + time_s > vehicle.longest_flight_s:
        raise MissionTooLongError(
            f"the flight takes {time_s:.0f} s including transits{before}, but {longest_flight_text(vehicle)}; "
            "require less coverage (--select), or plan a smaller area"
        )
    used_s = battery_used_s(FlightEnergy(site, autopilot), begin.energy_s, timed, home)
    # The energy used so far is unknown; estimate it by the planned mean, at least that of hovering.
    before_s = flown_s * max(1.0, used_s / time_s)
    if before_s + used_s > usable_s(vehicle):
        raise MissionTooLongError(
            f"the flight{before} uses {battery_text(site, before_s + used_s)}; require less coverage (--select), plan a "
            "smaller area, or fly in less wind"
        )
    returns = OwnReturns(
        site=site, path_m=path, first_waypoint=len(there_m) - 1, waypoint_count=len(planned), autopilot=autopilot,
        begin_s=begin.time_s,
    )  # fmt: skip
    fence = fence_of(site, frame, path)
    _check_autopilot(mission, AUTOPILOTS[autopilot], item_limit=vehicle.max_mission_items)
    _check_fence(fence.fence, autopilot)
    return CompiledMission(
        mission=mission,
        fence=fence.fence,
        first_waypoint_item=len(opening),
        waypoint_count=len(planned),
        items_per_waypoint=items_per_waypoint(sensor),
        path_m=path,
        bare_returns=returns,
        zones_in_fence=fence.zones,
        zones_left_out=fence.left_out,
        max_height_above_home_m=float(site.alts_amsl_m(path).max() - site.alts_amsl_m(home)[0]),
        flight_time_s=time_s,
        battery_used=None if vehicle.hover_s is None else used_s / vehicle.hover_s,
    )


def compile_return(site: Site, *, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
    """Compile a mission home from the vehicle's position over the terrain, every leg checked.

    Raises:
        InfeasibleError: no transit home passes the checks.
    """
    frame, home = frame_and_home(site)
    here = frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    back = transit(site, home[:2], here, ground_end_height_m=site.scenario.vehicle.takeoff_height_m)[::-1]
    # The vehicle may be below the clearance now: then it climbs vertically first.
    # It may also be above the ceiling; keeping it there for that reason would be worse.
    # It may be in the margin of a no-fly zone; the zones themselves are kept out of.
    check_transit(
        site,
        "the return transit",
        back,
        far_end=0,
        far_end_lowest_agl_m=-math.inf,
        highest_agl_m=None,
        zones=site.flown_zones,
    )
    speed = change_speed(site.scenario.vehicle.cruise_speed_m_s)  # another station may have commanded a slower one
    items = [_item(waypoint, frame, point, home) for point in back[1:]]
    return Mission(_home_point(frame, home), (speed, *items, _item(land, frame, home, home)))


def check_fence(site: Site, *, autopilot: AutopilotName) -> None:
    """Refuse a fence that the autopilot would reject, before the search for a route.

    Only the inclusion polygon and the zones that no mission passes over or under count.

    Raises:
        InfeasibleError: it has too many items or corners.
    """
    if site.frame is None or site.home_m is None:
        return
    holed = [any(part.interiors for part in shapely.get_parts(zone.outline)) for zone in site.zones]
    always = [zone for zone, hole in zip(site.zones, holed, strict=True) if not hole and is_wall(site, zone)]
    least = fence_of(dataclasses.replace(site, zones=tuple(always)), site.frame, np.stack([site.home_m, site.home_m]))
    _check_fence(least.fence, autopilot)


@lru_cache(maxsize=32)
def _check_fence(fence: Fence, autopilot: AutopilotName) -> None:
    """Refuse a fence that the autopilot would reject; the same one, of many missions, is checked once."""
    _check_autopilot(fence, AUTOPILOTS[autopilot], item_limit=None)


def _check_autopilot(content: MissionList, autopilot: autopilots.Autopilot, *, item_limit: int | None) -> None:
    """Refuse a list that the autopilot would reject or misunderstand."""
    items = items_of(content, autopilot)
    problems = check_for_autopilot(items, autopilot, mission_type_of(content))
    if problems:
        # a problem without an item concerns the whole list: too many items, of which a mission can be split.
        is_mission = mission_type_of(content) is MissionType.MISSION
        refused = MissionTooLongError if problems[0].item is None and is_mission else InfeasibleError
        raise refused(f"{autopilot.name} would reject this {mission_type_of(content).name.lower()}: {problems[0]}")
    if item_limit is not None and mission_type_of(content) is MissionType.MISSION and len(items) > item_limit:
        raise MissionTooLongError(f"the mission has {len(items)} items, but vehicle.max_mission_items is {item_limit}")


def _item(make: Callable[..., MissionItem], frame: LocalFrame, point_m: FloatArray, home_m: FloatArray) -> MissionItem:
    """An item at a position. The heading is NaN, so the vehicle yaws along the path; for PX4, 0 would mean north."""
    position = _geo_point(frame, point_m)
    home_alt = _geo_point(frame, home_m).alt_amsl_m
    height_m = round(position.alt_amsl_m - home_alt, _HEIGHT_DECIMALS)
    item = make(position.lat_deg, position.lon_deg, height_m, frame=Frame.ABOVE_HOME)
    return dataclasses.replace(item, params=(*item.params[:3], math.nan))


def _geo_point(frame: LocalFrame, point_m: FloatArray) -> GeoPoint:
    lat, lon, alt = frame.geodetic_from_enu(point_m)
    return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))


def _home_point(frame: LocalFrame, home_m: FloatArray) -> GeoPoint:
    home = _geo_point(frame, home_m)
    return dataclasses.replace(home, alt_amsl_m=round(home.alt_amsl_m, _HEIGHT_DECIMALS))


def _position(point_m: FloatArray) -> tuple[float, float, float]:
    return float(point_m[0]), float(point_m[1]), float(point_m[2])


@dataclass(frozen=True, slots=True, eq=False)
class Sortie:
    """One flight of a planned route."""

    first: int  # number of its first waypoint in the whole route
    last: int  # number of its last waypoint; for sensing along the path, the next sortie begins there too
    route: Route  # its waypoints
    compiled: CompiledMission  # its mission, from take-off at home to landing there
    vehicle: int = 1  # number of its vehicle, from 1
    # its planned take-off, since the first take-off of all; None without a schedule
    start_s: float | None = None
