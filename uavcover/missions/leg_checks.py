"""Leg checks: how every leg of a route, along its full length, compares with the hard limits.

Planning adds the excesses up as constraint violations; the mission compiler refuses a route that has any. Judging does not
use them: it evaluates the flown track independently.
"""

import dataclasses
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import ZoneBreach, ZoneCheck
from uavcover.scenario.obstacles import leg_breaches, waypoint_breaches
from uavcover.scenario.site import Site

CLIMB_TOLERANCE_DEG = 1e-6
HEIGHT_TOLERANCE_M = 1e-6
_ON_THE_FENCE_M = 1e-6
_FENCE_LOCK = threading.Lock()
"""A prepared polygon, such as another module may have made of the fence, builds its index on first use: not thread-safe."""


ProblemKind = Literal[
    "no elevation data",
    "too low",
    "too high",
    "below sea-level limit",
    "above sea-level limit",
    "climb",
    "fence",
    "obstacle",
    "no-fly zone",
]


@dataclass(frozen=True, slots=True)
class LegProblem:
    """A leg, or a waypoint, that breaks a limit."""

    leg: int  # number of the waypoint at its end, counted from 0; leg k goes from waypoint k - 1 to k
    kind: ProblemKind  # which limit
    # the leg's worst value; for the fence, metres outside it; for an obstacle, metres of clearance missing beside or
    # above it, whichever is less; for a no-fly zone, metres inside it or its margin
    value: float
    limit: float  # the allowed value
    unit: str  # of both
    east_m: float  # where it is worst
    north_m: float  # where it is worst
    waypoint_alone: bool = False  # whether only the waypoint was checked, not the leg to it
    name: str = ""  # of the obstacle or the no-fly zone
    in_corner: bool = False  # whether it is in the corner that is flown beside the waypoint, not on the leg to it

    def __str__(self) -> str:
        what = f"waypoint {self.leg}" if self.waypoint_alone else f"leg to waypoint {self.leg}"
        if self.in_corner:
            what = f"corner flown beside waypoint {self.leg}"
        where = f"at {self.east_m:.0f} m east, {self.north_m:.0f} m north"
        if self.kind == "no elevation data":
            return f"{what}: no elevation data {where}"
        if self.kind == "fence":
            return f"{what}: {self.value:.1f} m outside the fence {where}"
        if self.kind == "obstacle":
            return f"{what}: {self.value:.1f} m too close to obstacle {self.name!r} {where}"
        if self.kind == "no-fly zone":
            return f"{what}: {self.value:.1f} m inside no-fly zone {self.name!r} or its margin {where}"
        amounts = f"{self.value:.1f} {self.unit} against {self.limit:.1f} {self.unit}"
        return f"{what}: {self.kind}, {amounts} {where}"


@dataclass(frozen=True, slots=True, eq=False)
class Violations:
    """Excess over each hard limit; all zero for a feasible route."""

    below_m: float  # metres below the lower limit of height above ground, summed over the legs
    above_m: float  # metres above the upper limit, summed in the same way
    sea_level_m: float  # metres outside the sea-level limits, summed over the waypoints
    climb_deg: float  # degrees steeper than the limit, summed over the legs
    fence_m: float  # metres of the route outside the fence
    obstacle_m: float  # metres of missing clearance from obstacles, summed over the legs
    # metres inside no-fly zones and their margins, at the deepest place of every leg, summed over the legs
    no_fly_m: float
    no_data_legs: int  # legs without elevation data

    @property
    def total(self) -> float:
        """Sum of all excesses in metres and degrees, with 1000 for each leg without data; 0 for a feasible route."""
        metres = self.below_m + self.above_m + self.sea_level_m + self.fence_m + self.obstacle_m + self.no_fly_m
        return metres + self.climb_deg + 1000.0 * self.no_data_legs


def measure_violations(site: Site, route_m: FloatArray, *, margin_m: float) -> Violations:
    """Measure how much an (n, 3) ENU route exceeds the limits of the sensing route.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        margin_m: how far inside both ends of the height band the route must stay.
    """
    limits = site.scenario.limits
    figures = _leg_figures(site, route_m)
    known = np.isfinite(figures[:, 0])
    low, high = limits.min_height_agl_m + margin_m, limits.max_height_agl_m - margin_m
    tolerance_m = HEIGHT_TOLERANCE_M + site.ground.cut_error_m
    below = np.maximum(0.0, low - tolerance_m - figures[known, 0])
    above = np.maximum(0.0, figures[known, 2] - high - tolerance_m)
    sea = 0.0
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        alts = site.alts_amsl_m(route_m)
        if limits.min_alt_amsl_m is not None:
            sea += float(np.maximum(0.0, limits.min_alt_amsl_m - HEIGHT_TOLERANCE_M - alts).sum())
        if limits.max_alt_amsl_m is not None:
            sea += float(np.maximum(0.0, alts - limits.max_alt_amsl_m - HEIGHT_TOLERANCE_M).sum())
    climb = 0.0
    if limits.applies_to == "legs":
        climb = float(
            np.maximum(0.0, climb_angles_deg(route_m) - limits.max_climb_angle_deg - CLIMB_TOLERANCE_DEG).sum()
        )
    return Violations(
        below_m=float(below.sum()),
        above_m=float(above.sum()),
        sea_level_m=sea,
        climb_deg=climb,
        fence_m=_length_outside_fence_m(site, route_m),
        obstacle_m=float(_breaches(site, route_m)[:, 1].sum()),
        no_fly_m=sum((breach.depth_m for breach in _zone_breaches(site, route_m)), 0.0),
        no_data_legs=int((~known).sum()),
    )


def find_problems(
    site: Site,  # the scenario on its ground
    route_m: FloatArray,  # waypoints in flying order
    *,
    lowest_agl_m: float,  # lowest height above ground
    highest_agl_m: float | None,  # largest height above ground, or none
    zones: ZoneCheck | None = None,  # the no-fly zones to keep out of; default: with their margins
) -> list[LegProblem]:
    """Every leg of an (n, 3) ENU route that breaks a limit, in flying order.

    For a route of one waypoint the waypoint itself is checked.
    """
    if len(route_m) == 1:
        return find_waypoint_problems(site, route_m, lowest_agl_m=lowest_agl_m, highest_agl_m=highest_agl_m)
    limits = site.scenario.limits
    problems: list[LegProblem] = []
    ranges = site.ground.leg_height_ranges_m(route_m)
    alts = site.alts_amsl_m(route_m)
    angles = climb_angles_deg(route_m)
    breaches = leg_breaches(site.ground, route_m, site.scenario.obstacles)
    check = site.planned_zones if zones is None else zones
    entered = {breach.leg: breach for breach in reversed(check.leg_breaches(route_m))}
    for leg, row in enumerate(ranges, start=1):
        a, b = route_m[leg - 1], route_m[leg]
        problems += _obstacle_problems(site, leg, (a, b), breaches[leg - 1])
        problems += _height_problems(site, leg, (a, b), row, alts[leg - 1 : leg + 1], lowest_agl_m, highest_agl_m)
        if angles[leg - 1] > limits.max_climb_angle_deg + CLIMB_TOLERANCE_DEG:
            angle = float(angles[leg - 1])
            problems.append(
                LegProblem(leg, "climb", angle, limits.max_climb_angle_deg, "degrees", float(b[0]), float(b[1]))
            )
        outside, at = _furthest_outside_fence(site, a, b)
        if outside > 0.0:
            problems.append(LegProblem(leg, "fence", outside, 0.0, "m", float(at[0]), float(at[1])))
        if leg - 1 in entered:
            problems.append(_zone_problem(site, leg, (a, b), entered[leg - 1]))
    return problems


def find_waypoint_problems(
    site: Site, route_m: FloatArray, *, lowest_agl_m: float, highest_agl_m: float | None
) -> list[LegProblem]:
    """Find every waypoint of an (n, 3) ENU route that breaks a limit; legs are not checked.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        lowest_agl_m: lowest height above ground.
        highest_agl_m: largest height above ground, or none.
    """
    problems: list[LegProblem] = []
    rows = _waypoint_figures(site, route_m)
    alts = site.alts_amsl_m(route_m)
    breaches = waypoint_breaches(site.ground, route_m, site.scenario.obstacles)
    entered = {breach.leg: breach for breach in reversed(site.planned_zones.place_breaches(route_m))}
    for k, (point, row) in enumerate(zip(route_m, rows, strict=True)):
        problems += _obstacle_problems(site, k, (point, point), breaches[k])
        problems += _height_problems(site, k, (point, point), row, alts[[k, k]], lowest_agl_m, highest_agl_m)
        outside, _ = _furthest_outside_fence(site, point, point)
        if outside > 0.0:
            problems.append(LegProblem(k, "fence", outside, 0.0, "m", float(point[0]), float(point[1])))
        if k in entered:
            problems.append(_zone_problem(site, k, (point, point), entered[k]))
    return [dataclasses.replace(problem, waypoint_alone=True) for problem in problems]


def _height_problems(
    site: Site,
    leg: int,
    ends_m: tuple[FloatArray, FloatArray],
    heights: FloatArray,
    alts_amsl_m: FloatArray,
    lowest_agl_m: float,
    highest_agl_m: float | None,
) -> Iterator[LegProblem]:
    """Height problems of a leg between two (3,) ends; ``heights`` is its row of figures."""
    limits = site.scenario.limits
    a, b = ends_m

    def problem(kind: ProblemKind, value: float, limit: float, unit: str, t: float) -> LegProblem:
        place = a + t * (b - a)
        return LegProblem(leg, kind, float(value), limit, unit, float(place[0]), float(place[1]))

    low, low_at, high, high_at = heights
    if not np.isfinite(low):
        yield problem("no elevation data", 0.0, 0.0, "", 0.5)
        return
    tolerance_m = HEIGHT_TOLERANCE_M + site.ground.cut_error_m
    if low < lowest_agl_m - tolerance_m:
        yield problem("too low", low, lowest_agl_m, "m above ground", low_at)
    if highest_agl_m is not None and high > highest_agl_m + tolerance_m:
        yield problem("too high", high, highest_agl_m, "m above ground", high_at)
    # Height above sea level is linear along a leg, so it is worst at an end.
    lowest, highest = float(np.min(alts_amsl_m)), float(np.max(alts_amsl_m))
    if limits.min_alt_amsl_m is not None and lowest < limits.min_alt_amsl_m - HEIGHT_TOLERANCE_M:
        at = float(np.argmin(alts_amsl_m))
        yield problem("below sea-level limit", lowest, limits.min_alt_amsl_m, "m AMSL", at)
    if limits.max_alt_amsl_m is not None and highest > limits.max_alt_amsl_m + HEIGHT_TOLERANCE_M:
        at = float(np.argmax(alts_amsl_m))
        yield problem("above sea-level limit", highest, limits.max_alt_amsl_m, "m AMSL", at)


def _obstacle_problems(
    site: Site, leg: int, ends_m: tuple[FloatArray, FloatArray], breach: FloatArray
) -> Iterator[LegProblem]:
    """Obstacle problems of a leg between two (3,) ends; ``breach`` is its row of figures."""
    number, lacking, t = breach
    if lacking > 0.0:
        place = ends_m[0] + t * (ends_m[1] - ends_m[0])
        name = site.prisms[int(number)].footprint.name
        yield LegProblem(leg, "obstacle", float(lacking), 0.0, "m", float(place[0]), float(place[1]), name=name)


def _zone_problem(site: Site, leg: int, ends_m: tuple[FloatArray, FloatArray], breach: ZoneBreach) -> LegProblem:
    """The problem of a leg between two (3,) ends that is in a no-fly zone."""
    place = ends_m[0] + breach.at * (ends_m[1] - ends_m[0])
    name = site.zones[breach.zone].name
    return LegProblem(leg, "no-fly zone", breach.depth_m, 0.0, "m", float(place[0]), float(place[1]), name=name)


def _zone_breaches(site: Site, route_m: FloatArray) -> list[ZoneBreach]:
    """Entries of the legs into zones and their margins, or of the waypoints alone, as the limits apply."""
    if site.scenario.limits.applies_to == "legs":
        return site.planned_zones.leg_breaches(route_m)
    return site.planned_zones.place_breaches(route_m)


def _breaches(site: Site, route_m: FloatArray) -> FloatArray:
    """Rows as of :func:`leg_breaches`, for the legs or for the waypoints alone, as the limits apply."""
    if site.scenario.limits.applies_to == "legs" and len(route_m) > 1:
        return leg_breaches(site.ground, route_m, site.scenario.obstacles)
    return waypoint_breaches(site.ground, route_m, site.scenario.obstacles)


def climb_angles_deg(route_m: FloatArray) -> FloatArray:
    """(n - 1,) angle of each leg of an (n, 3) route to the horizontal, 0..90 degrees, up or down."""
    steps = np.diff(route_m, axis=0)
    return np.degrees(np.arctan2(np.abs(steps[:, 2]), np.hypot(steps[:, 0], steps[:, 1])))


def _leg_figures(site: Site, route_m: FloatArray) -> FloatArray:
    """Rows as of :meth:`Ground.leg_height_ranges_m`, for the legs or for the waypoints alone, as the limits apply."""
    if site.scenario.limits.applies_to == "legs" and len(route_m) > 1:
        return site.ground.leg_height_ranges_m(route_m)
    return _waypoint_figures(site, route_m)


def _waypoint_figures(site: Site, route_m: FloatArray) -> FloatArray:
    heights = site.ground.heights_agl_m(route_m)
    return np.column_stack([heights, np.zeros_like(heights), heights, np.zeros_like(heights)])


def route_height_range_m(site: Site, route_m: FloatArray) -> tuple[float, float]:
    """Lowest and largest height above ground of an (n, 3) ENU route, on legs or waypoints as the limits apply."""
    figures = _leg_figures(site, route_m)
    return float(np.min(figures[:, 0])), float(np.max(figures[:, 2]))


def _length_outside_fence_m(site: Site, route_m: FloatArray) -> float:
    places = route_m[:, :2]
    if site.scenario.limits.applies_to == "waypoints" or len(places) < 2:
        return float(shapely.distance(site.fence, shapely.points(places)).sum())
    outside = _outside_fence(site, shapely.LineString(places))
    return 0.0 if outside is None else float(shapely.length(outside))


def _furthest_outside_fence(site: Site, a: FloatArray, b: FloatArray) -> tuple[float, FloatArray]:
    """Largest distance outside the fence on the line between two (3,) points, in metres, and its (2,) position."""
    if np.array_equal(a[:2], b[:2]):
        return float(site.fence.distance(shapely.Point(a[:2]))), a[:2]
    outside = _outside_fence(site, shapely.LineString([a[:2], b[:2]]))
    if outside is None:
        return 0.0, b[:2]
    # Corners of the outside parts and points between them: exact along a straight fence, close enough in its bays.
    places = shapely.get_coordinates(shapely.segmentize(outside, max(float(shapely.length(outside)) / 64.0, 1e-3)))
    distances = np.atleast_1d(shapely.distance(site.fence, shapely.points(places)))
    worst = int(np.argmax(distances))
    return float(distances[worst]), places[worst]


def _outside_fence(site: Site, line: shapely.LineString) -> shapely.Geometry | None:
    """The parts of a line outside the fence, or none. Rounding errors of a leg along the fence do not count."""
    with _FENCE_LOCK:
        inside = site.fence.covers(line)
    if inside:
        return None
    outside = line.difference(site.fence.buffer(_ON_THE_FENCE_M))
    return None if outside.is_empty else outside
