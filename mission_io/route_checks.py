"""Whether a mission keeps the limits of a vehicle and its surroundings, every leg at its full length.

Usable by itself: a mission, the limits that matter, and for heights above ground anything that knows the ground
(``Surface``). What was not asked for is not checked; what could not be checked is a problem, not a pass.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mission_io.areas import Fence
from mission_io.clearance import HeightsAlong, heights_along
from mission_io.fence_checks import FenceGround, Inclusion
from mission_io.flight_time import Performance, bearing_deg, flight_time_s
from mission_io.geodesy import ground_distance_m
from mission_io.items import Command, GeoPoint, Mission
from mission_io.legs import Climb, Leg, LegKind, legs_of
from mission_io.surface import Surface

_ANGLE_SLACK_DEG = 1e-6
_LENGTH_SLACK_M = 1e-6
_SAME_PLACE_M = 0.05
_STRAIGHT_BACK_DEG = 179.0


@dataclass(frozen=True, slots=True)
class RouteLimits:
    """What a route has to keep; None is no limit.

    Heights above ground count for flight and return legs, not for take-off and landing. They need a surface. Climb and
    descent count for legs with some way over ground, not for columns.
    """

    min_height_agl_m: float | None = None
    max_height_agl_m: float | None = None
    max_alt_above_home_m: float | None = None
    max_alt_amsl_m: float | None = None
    max_climb_deg: float | None = None
    max_descent_deg: float | None = None
    max_leg_m: float | None = None
    max_distance_from_home_m: float | None = None
    max_length_m: float | None = None
    endurance_s: float | None = None
    turn_radius_m: float | None = None


@dataclass(frozen=True, slots=True)
class RouteProblem:
    """A limit that a route breaks, or something that is hardly meant.

    Attributes:
        item: Number of the item at the end of the leg, from 1; None when it is about the whole route.
        what: What is wrong, with the figures, and what to do when that is not plain.
        lat_deg: Where it is worst; None when it has no place.
        lon_deg: Where it is worst.
    """

    item: int | None
    what: str
    lat_deg: float | None = None
    lon_deg: float | None = None

    def __str__(self) -> str:
        """One line for people."""
        where = "the route" if self.item is None else f"leg to item {self.item}"
        place = "" if self.lat_deg is None else f" at {self.lat_deg:.6f}, {self.lon_deg:.6f}"
        return f"{where}: {self.what}{place}"


@dataclass(frozen=True, slots=True)
class RouteReport:
    """What a route is like, and every limit that it breaks.

    Attributes:
        problems: In the order of the route, those of the whole route last; empty when every limit is kept.
        legs: Its legs.
        heights: For each leg, how high it is above the ground; empty without a surface.
        length_m: How long it is in space.
        time_s: How long it takes; None without a performance, infinite when it never ends.
        error_m: How far the extreme heights may be off; None when the surface does not bound its slope, and without one.
    """

    problems: tuple[RouteProblem, ...]
    legs: tuple[Leg, ...]
    heights: tuple[HeightsAlong, ...]
    length_m: float
    time_s: float | None
    error_m: float | None


def check_route(
    mission: Mission,
    limits: RouteLimits,
    *,
    surface: Surface | None = None,
    fence: Fence | None = None,
    inclusion: Inclusion = Inclusion.INSIDE_ALL,
    performance: Performance | None = None,
    climb: Climb = Climb.STRAIGHT_UP,
    return_alt_above_home_m: float | None = None,
    step_m: float = 10.0,
    tolerance_m: float = 0.1,
) -> RouteReport:
    """Check a mission against limits, terrain and fence, leg by leg.

    Heights are compared with ``tolerance_m`` against the route: a clearance within the error of its own measurement
    below the limit is a problem. See ``heights_along`` for what the measurement is worth.

    Raises:
        MisuseError: places that are none, heights that cannot be known, limits that need what was not given.
    """
    legs = legs_of(mission, surface=surface, climb=climb, return_alt_above_home_m=return_alt_above_home_m)
    problems: list[RouteProblem] = []
    heights: list[HeightsAlong] = []
    ground = None if fence is None else FenceGround(fence, inclusion)
    for leg in legs:
        problems += _altitude_problems(leg, limits, mission.home)
        problems += _slope_problems(leg, limits)
        problems += _distance_problems(leg, limits, mission.home)
        if surface is not None:
            along = heights_along(leg, surface, step_m=step_m, tolerance_m=tolerance_m)
            heights.append(along)
            problems += _height_problems(leg, along, limits)
        if ground is not None:
            problems += (
                RouteProblem(leg.item, f"{b.outside_m:.1f} m {b.what}", b.lat_deg, b.lon_deg)
                for b in ground.breaches(leg)
            )
    if surface is None and not (limits.min_height_agl_m is None and limits.max_height_agl_m is None):
        problems.append(RouteProblem(None, "heights above ground were not checked; give a surface"))
    problems += _duplicates(legs, mission)
    problems += _turn_problems(legs, limits)
    problems += _whole_route_problems(mission, return_alt_above_home_m)
    length_m = sum(leg.length_m for leg in legs)
    time_s = None if performance is None else flight_time_s(mission, legs, performance)
    problems += _total_problems(length_m, time_s, limits)
    errors = [along.error_m for along in heights]
    error_m = max((e for e in errors if e is not None), default=None) if None not in errors else None
    return RouteReport(tuple(dict.fromkeys(problems)), legs, tuple(heights), length_m, time_s, error_m)


def _altitude_problems(leg: Leg, limits: RouteLimits, home: GeoPoint | None) -> Iterator[RouteProblem]:
    top = max(leg.start, leg.end, key=lambda place: place.alt_amsl_m)
    if limits.max_alt_amsl_m is not None and top.alt_amsl_m > limits.max_alt_amsl_m + _LENGTH_SLACK_M:
        what = f"{top.alt_amsl_m:.1f} m above sea level, {limits.max_alt_amsl_m:.1f} m is allowed"
        yield RouteProblem(leg.item, what, top.lat_deg, top.lon_deg)
    if limits.max_alt_above_home_m is not None:
        if home is None:
            yield RouteProblem(leg.item, "its height above home was not checked; give the home")
        elif top.alt_amsl_m - home.alt_amsl_m > limits.max_alt_above_home_m + _LENGTH_SLACK_M:
            above_m = top.alt_amsl_m - home.alt_amsl_m
            what = f"{above_m:.1f} m above home, {limits.max_alt_above_home_m:.1f} m is allowed"
            yield RouteProblem(leg.item, what, top.lat_deg, top.lon_deg)


def _slope_problems(leg: Leg, limits: RouteLimits) -> Iterator[RouteProblem]:
    if leg.kind in (LegKind.TAKEOFF, LegKind.LANDING) or leg.ground_m < _SAME_PLACE_M:
        return
    angle_deg = math.degrees(math.atan2(leg.climb_m, leg.ground_m))
    for limit, steep_deg, name in (
        (limits.max_climb_deg, angle_deg, "climbs"),
        (limits.max_descent_deg, -angle_deg, "descends"),
    ):
        if limit is not None and steep_deg > limit + _ANGLE_SLACK_DEG:
            what = f"{name} at {steep_deg:.1f} degrees, {limit:.1f} degrees are allowed"
            yield RouteProblem(leg.item, what, leg.end.lat_deg, leg.end.lon_deg)


def _distance_problems(leg: Leg, limits: RouteLimits, home: GeoPoint | None) -> Iterator[RouteProblem]:
    if limits.max_leg_m is not None and leg.length_m > limits.max_leg_m + _LENGTH_SLACK_M:
        yield RouteProblem(leg.item, f"is {leg.length_m:.0f} m long, {limits.max_leg_m:.0f} m is allowed")
    if limits.max_distance_from_home_m is not None:
        if home is None:
            yield RouteProblem(leg.item, "its distance from home was not checked; give the home")
            return
        # The farthest place of a straight leg from a point is one of its ends.
        distance_m = max(
            ground_distance_m(home.lat_deg, home.lon_deg, place.lat_deg, place.lon_deg)
            for place in (leg.start, leg.end)
        )
        if distance_m > limits.max_distance_from_home_m + _LENGTH_SLACK_M:
            what = f"{distance_m:.0f} m from home, {limits.max_distance_from_home_m:.0f} m is allowed"
            yield RouteProblem(leg.item, what, leg.end.lat_deg, leg.end.lon_deg)


def _height_problems(leg: Leg, along: HeightsAlong, limits: RouteLimits) -> Iterator[RouteProblem]:
    if limits.min_height_agl_m is None and limits.max_height_agl_m is None:
        return
    if along.unknown_at is not None:
        yield _at(leg, along.unknown_at, "the ground is not known")
    if leg.kind in (LegKind.TAKEOFF, LegKind.LANDING) or math.isnan(along.lowest_agl_m):
        return
    error_m = along.error_m or 0.0
    unsure = f", measured to {error_m:.2g} m" if along.error_m else ""
    low, high = limits.min_height_agl_m, limits.max_height_agl_m
    if low is not None and along.lowest_agl_m - error_m < low - _LENGTH_SLACK_M:
        yield _at(leg, along.lowest_at, f"{along.lowest_agl_m:.1f} m above ground{unsure}, {low:.1f} m is the least")
    if high is not None and along.highest_agl_m + error_m > high + _LENGTH_SLACK_M:
        yield _at(leg, along.highest_at, f"{along.highest_agl_m:.1f} m above ground{unsure}, {high:.1f} m is the most")


def _at(leg: Leg, fraction: float, what: str) -> RouteProblem:
    (lat_deg,), (lon_deg,) = leg.places(np.array([fraction]))
    return RouteProblem(leg.item, what, float(lat_deg), float(lon_deg))


def _duplicates(legs: tuple[Leg, ...], mission: Mission) -> Iterator[RouteProblem]:
    def is_waypoint(leg: Leg) -> bool:
        return mission.items[leg.item - 1].command == Command.NAV_WAYPOINT

    for before, leg in itertools.pairwise(legs):
        if is_waypoint(before) and is_waypoint(leg) and leg.length_m < _SAME_PLACE_M:
            what = f"the same place as item {before.item}; leave one out"
            yield RouteProblem(leg.item, what, leg.end.lat_deg, leg.end.lon_deg)


def _turn_problems(legs: tuple[Leg, ...], limits: RouteLimits) -> Iterator[RouteProblem]:
    """Legs too short for the turns at their ends, flown as arcs that touch both legs."""
    radius_m = limits.turn_radius_m
    if not radius_m:
        return
    flown = [leg for leg in legs if leg.ground_m >= _SAME_PLACE_M]
    lead_m = [0.0]
    for leg, following in itertools.pairwise(flown):
        course_deg = bearing_deg(leg, 1.0)
        change_deg = abs((bearing_deg(following, 0.0) - course_deg + 180.0) % 360.0 - 180.0)
        if change_deg > _STRAIGHT_BACK_DEG:
            what = f"turns straight back; a turn of {radius_m:.0f} m radius cannot"
            yield RouteProblem(following.item, what, leg.end.lat_deg, leg.end.lon_deg)
            lead_m.append(0.0)
        else:
            lead_m.append(radius_m * math.tan(math.radians(change_deg) / 2.0))
    lead_m.append(0.0)
    for leg, before_m, after_m in zip(flown, lead_m, lead_m[1:], strict=False):
        if before_m + after_m > leg.ground_m + _LENGTH_SLACK_M:
            what = f"{leg.ground_m:.0f} m are too short for its turns of {radius_m:.0f} m radius, which take "
            yield RouteProblem(leg.item, f"{what}{before_m + after_m:.0f} m", leg.end.lat_deg, leg.end.lon_deg)


def _whole_route_problems(mission: Mission, return_alt_above_home_m: float | None) -> Iterator[RouteProblem]:
    for number, item in enumerate(mission.items, start=1):
        if item.command == Command.NAV_RETURN_TO_LAUNCH and (mission.home is None or return_alt_above_home_m is None):
            what = "the return was not checked; give the home and the height that the autopilot returns at"
            yield RouteProblem(number, what)
        if item.command == Command.NAV_SPLINE_WAYPOINT:
            yield RouteProblem(number, "a curve, checked as the straight line between its ends only")


def _total_problems(length_m: float, time_s: float | None, limits: RouteLimits) -> Iterator[RouteProblem]:
    if limits.max_length_m is not None and length_m > limits.max_length_m + _LENGTH_SLACK_M:
        yield RouteProblem(None, f"is {length_m:.0f} m long, {limits.max_length_m:.0f} m is allowed")
    if limits.endurance_s is not None:
        if time_s is None:
            yield RouteProblem(None, "its time was not checked; give a performance")
        elif time_s > limits.endurance_s:
            yield RouteProblem(None, f"takes {time_s:.0f} s, the endurance is {limits.endurance_s:.0f} s")
