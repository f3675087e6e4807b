"""Compare every leg of a route, along its full length, and every corner flown beside a waypoint, with the hard limits.

The planner adds the excesses up as constraint violations; the mission compiler refuses a route that has any. Verification does
not use them: it evaluates the flown track independently.
"""

import dataclasses
import itertools
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
from uavcover.sensing.flown_line import corners_flown

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
    """A leg or waypoint that exceeds a limit."""

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
    """Every leg of an (n, 3) ENU route that exceeds a limit, in flying order.

    For a route with one waypoint, the waypoint itself is checked.
    """
    if len(route_m) == 1:
        return find_waypoint_problems(site, route_m, lowest_agl_m=lowest_agl_m, highest_agl_m=highest_agl_m)
    ranges = site.ground.leg_height_ranges_m(route_m)
    alts = site.alts_amsl_m(route_m)
    breaches = leg_breaches(site.ground, route_m, site.scenario.obstacles)
    check = site.planned_zones if zones is None else zones
    entered = {breach.leg: breach for breach in reversed(check.leg_breaches(route_m))}
    problems: list[LegProblem] = []
    for k, ends in enumerate(itertools.pairwise(route_m)):
        figures = _Figures(k + 1, ends, ranges[k], alts[k : k + 2], breaches[k], entered.get(k))
        problems += figures.problems(site, lowest_agl_m, highest_agl_m)
    return problems


def find_waypoint_problems(
    site: Site, route_m: FloatArray, *, lowest_agl_m: float, highest_agl_m: float | None
) -> list[LegProblem]:
    """Find every waypoint of an (n, 3) ENU route that exceeds a limit; legs are not checked.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        lowest_agl_m: lowest height above ground.
        highest_agl_m: largest height above ground, or none.
    """
    rows = _waypoint_figures(site, route_m)
    alts = site.alts_amsl_m(route_m)
    breaches = waypoint_breaches(site.ground, route_m, site.scenario.obstacles)
    entered = {breach.leg: breach for breach in reversed(site.planned_zones.position_breaches(route_m))}
    problems: list[LegProblem] = []
    for k, point in enumerate(route_m):
        figures = _Figures(k, (point, point), rows[k], alts[[k, k]], breaches[k], entered.get(k))
        problems += figures.problems(site, lowest_agl_m, highest_agl_m)
    return [dataclasses.replace(problem, waypoint_alone=True) for problem in problems]


@dataclass(frozen=True, slots=True, eq=False)
class _Figures:
    """Figures of one leg, or of a waypoint, both ends of which are itself."""

    number: int  # of the waypoint at its end
    ends_m: tuple[FloatArray, FloatArray]  # (3,) ENU each
    heights: FloatArray  # its row of :meth:`Ground.leg_height_ranges_m`
    alts_amsl_m: FloatArray  # (2,) of the ends
    obstacle: FloatArray  # its row of :func:`leg_breaches`
    zone: ZoneBreach | None  # the first no-fly zone that it enters

    def problems(self, site: Site, lowest_agl_m: float, highest_agl_m: float | None) -> Iterator[LegProblem]:
        """The limits that it exceeds."""
        limits, end = site.scenario.limits, self.ends_m[1]
        obstacle, lacking, at = self.obstacle
        if lacking > 0.0:
            name = site.prisms[int(obstacle)].footprint.name
            yield self._problem("obstacle", lacking, 0.0, "m", self._position_m(at), name)
        yield from self._height_problems(site, lowest_agl_m, highest_agl_m)
        (angle,) = climb_angles_deg(np.stack(self.ends_m))
        if angle > limits.max_climb_angle_deg + CLIMB_TOLERANCE_DEG:
            yield self._problem("climb", angle, limits.max_climb_angle_deg, "degrees", end)
        outside, position = _furthest_outside_fence(site, *self.ends_m)
        if outside > 0.0:
            yield self._problem("fence", outside, 0.0, "m", position)
        if self.zone is not None:
            name, position = site.zones[self.zone.zone].name, self._position_m(self.zone.at)
            yield self._problem("no-fly zone", self.zone.depth_m, 0.0, "m", position, name)

    def _height_problems(self, site: Site, lowest_agl_m: float, highest_agl_m: float | None) -> Iterator[LegProblem]:
        limits, alts = site.scenario.limits, self.alts_amsl_m
        low, low_at, high, high_at = self.heights
        if not np.isfinite(low):
            yield self._problem("no elevation data", 0.0, 0.0, "", self._position_m(0.5))
            return
        tolerance_m = HEIGHT_TOLERANCE_M + site.ground.cut_error_m
        above_ground, above_sea = "m above ground", "m AMSL"
        if low < lowest_agl_m - tolerance_m:
            yield self._problem("too low", low, lowest_agl_m, above_ground, self._position_m(low_at))
        if highest_agl_m is not None and high > highest_agl_m + tolerance_m:
            yield self._problem("too high", high, highest_agl_m, above_ground, self._position_m(high_at))
        # Height above sea level is linear along a leg, so it is worst at an end.
        lowest, highest = self._position_m(float(np.argmin(alts))), self._position_m(float(np.argmax(alts)))
        if limits.min_alt_amsl_m is not None and alts.min() < limits.min_alt_amsl_m - HEIGHT_TOLERANCE_M:
            yield self._problem("below sea-level limit", alts.min(), limits.min_alt_amsl_m, above_sea, lowest)
        if limits.max_alt_amsl_m is not None and alts.max() > limits.max_alt_amsl_m + HEIGHT_TOLERANCE_M:
            yield self._problem("above sea-level limit", alts.max(), limits.max_alt_amsl_m, above_sea, highest)

    def _position_m(self, t: float) -> FloatArray:
        begin, end = self.ends_m
        return begin + t * (end - begin)

    def _problem(
        self, kind: ProblemKind, value: float, limit: float, unit: str, position_m: FloatArray, name: str = ""
    ) -> LegProblem:
        east_m, north_m = float(position_m[0]), float(position_m[1])
        return LegProblem(self.number, kind, float(value), limit, unit, east_m, north_m, name=name)


def _zone_breaches(site: Site, route_m: FloatArray) -> list[ZoneBreach]:
    """Entries of the legs into zones and their margins, or of the waypoints alone, as the limits apply."""
    if site.scenario.limits.applies_to == "legs":
        return site.planned_zones.leg_breaches(route_m)
    return site.planned_zones.position_breaches(route_m)


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
    positions = route_m[:, :2]
    if site.scenario.limits.applies_to == "waypoints" or len(positions) < 2:
        return float(shapely.distance(site.fence, shapely.points(positions)).sum())
    outside = _outside_fence(site, shapely.LineString(positions))
    return 0.0 if outside is None else float(shapely.length(outside))


def _furthest_outside_fence(site: Site, a: FloatArray, b: FloatArray) -> tuple[float, FloatArray]:
    """Largest distance outside the fence on the line between two (3,) points, in metres, and its (2,) position."""
    if np.array_equal(a[:2], b[:2]):
        return float(site.fence.distance(shapely.Point(a[:2]))), a[:2]
    outside = _outside_fence(site, shapely.LineString([a[:2], b[:2]]))
    if outside is None:
        return 0.0, b[:2]
    # Corners of the outside parts and points between them: exact along a straight fence, close enough in its bays.
    positions = shapely.get_coordinates(shapely.segmentize(outside, max(float(shapely.length(outside)) / 64.0, 1e-3)))
    distances = np.atleast_1d(shapely.distance(site.fence, shapely.points(positions)))
    worst = int(np.argmax(distances))
    return float(distances[worst]), positions[worst]


def _outside_fence(site: Site, line: shapely.LineString) -> shapely.Geometry | None:
    """The parts of a line outside the fence, or none. Rounding errors of a leg along the fence do not count."""
    with _FENCE_LOCK:
        inside = site.fence.covers(line)
    if inside:
        return None
    outside = line.difference(site.fence.buffer(_ON_THE_FENCE_M))
    return None if outside.is_empty else outside


# Corners: ArduCopter passes inside its waypoints (:mod:`uavcover.sensing.flown_line`), away from the legs: nearer to obstacles
# that a route avoids, and at a cliff over other ground.

_CORNER_TOLERANCE_M = 0.1
"""Tolerance of corners beyond the height band: vehicles pass them within some centimetres of the computed line."""


def corner_excess_m(site: Site, route_m: FloatArray) -> FloatArray:
    """(n,) metres by which the corner at each waypoint of an (n, 3) ENU route breaks limits that its legs keep.

    Height margins, and those of no-fly zones, are for what a vehicle flies beside its line, and may be used.
    """
    excess_m = np.zeros(len(route_m))
    for kind in _corner_figures(site, route_m):
        excess_m += kind.excess_m.max(axis=1)
    return excess_m


def corner_excess_around_m(site: Site, route_m: FloatArray, waypoint: int) -> float:
    """Metres by which the corners at a waypoint of an (n, 3) ENU route and at its neighbours exceed limits.

    A corner depends on its two legs, so only five waypoints matter on a route of any length.
    """
    first, last = max(waypoint - 1, 0), min(waypoint + 1, len(route_m) - 1)
    begin = max(first - 1, 0)
    excess_m = corner_excess_m(site, route_m[begin : last + 2])
    return float(excess_m[first - begin : last - begin + 1].sum())


def corner_heights_off_m(site: Site, route_m: FloatArray) -> FloatArray:
    """(n,) metres by which the corner at each waypoint of an (n, 3) ENU route is above the height band (below: negative)."""
    off_m = np.zeros(len(route_m))
    for kind in _corner_figures(site, route_m):
        if kind.kind in ("too low", "too high"):
            off_m += kind.excess_m.max(axis=1) * (1.0 if kind.kind == "too high" else -1.0)
    return off_m


def find_corner_problems(site: Site, route_m: FloatArray, *, with_ends: bool = True) -> list[LegProblem]:
    """Every corner of an (n, 3) ENU route that exceeds a limit, in flying order.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        with_ends: whether the corners from home onto the route and off it count. Where a route is cut into several flights, those
            at the cuts are others than those of the whole.
    """
    problems: list[LegProblem] = []
    for figures in _corner_figures(site, route_m):
        if not with_ends:
            figures.excess_m[[0, -1]] = 0.0
        for k in np.flatnonzero(figures.excess_m.max(axis=1) > 0.0):
            at = int(np.argmax(figures.excess_m[k]))
            east_m, north_m, _ = figures.positions_m[k, at].tolist()
            value = float(figures.values[k, at])
            where = int(k), figures.kind, value, figures.limit, figures.unit, east_m, north_m
            problems.append(LegProblem(*where, in_corner=True, name=figures.names[k]))
    return sorted(problems, key=lambda problem: problem.leg)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _CornerFigures:
    """Values of n corners, at k positions each, compared with one limit."""

    kind: ProblemKind  # which
    positions_m: FloatArray  # (n, k, 3) ENU
    values: FloatArray  # (n, k) what is limited
    excess_m: FloatArray  # (n, k) beyond the limit; 0 where it is kept
    limit: float  # the limit
    unit: str  # of values and limit
    names: tuple[str, ...]  # (n,) of what is too near


def _corner_figures(site: Site, route_m: FloatArray) -> list[_CornerFigures]:
    """For each limit that a corner breaks anywhere."""
    positions_m = corners_flown(site, route_m) if len(route_m) > 1 else None
    if positions_m is None:
        return []
    flat, shape = positions_m.reshape(-1, 3), positions_m.shape[:2]
    limits, unnamed = site.scenario.limits, ("",) * shape[0]
    agl_m = site.ground.heights_agl_m(flat).reshape(shape)
    low_m, high_m = limits.min_height_agl_m, limits.max_height_agl_m
    outside_m = _outside_m(site, flat).reshape(shape)
    obstacle, lacking_m = _lacking_m(site, positions_m)
    zone, depth_m = _depth_m(site, flat, shape)
    above_ground = "m above ground"
    found = [
        _CornerFigures(
            "too low", positions_m, agl_m, low_m - agl_m - _CORNER_TOLERANCE_M, low_m, above_ground, unnamed
        ),
        _CornerFigures(
            "too high", positions_m, agl_m, agl_m - high_m - _CORNER_TOLERANCE_M, high_m, above_ground, unnamed
        ),
        _CornerFigures("fence", positions_m, outside_m, outside_m, 0.0, "m", unnamed),
        _CornerFigures("obstacle", positions_m, lacking_m, lacking_m, 0.0, "m", obstacle),
        _CornerFigures("no-fly zone", positions_m, depth_m, depth_m, 0.0, "m", zone),
    ]
    return [
        dataclasses.replace(each, excess_m=np.fmax(each.excess_m, 0.0)) for each in found if (each.excess_m > 0.0).any()
    ]


def _outside_m(site: Site, flat_m: FloatArray) -> FloatArray:
    """(k,) metres outside the fence of (k, 3) positions; distances are slow, so they are computed only outside."""
    outside_m = np.zeros(len(flat_m))
    beyond = ~shapely.contains_xy(site.fence, flat_m[:, 0], flat_m[:, 1])
    outside_m[beyond] = shapely.distance(site.fence, shapely.points(flat_m[beyond, :2]))
    return outside_m


def _lacking_m(site: Site, positions_m: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Nearest obstacles of (n, k, 3) corners, and (n, k) metres of clearance that are missing there."""
    count, points = positions_m.shape[:2]
    if not site.prisms:
        return ("",) * count, np.zeros((count, points))
    # From place to place, and from the last one of a corner to the first one of the next, which does not count.
    breaches = leg_breaches(site.ground, positions_m.reshape(-1, 3), site.scenario.obstacles)
    breaches = np.vstack([breaches, [-1.0, 0.0, 0.0]]).reshape(count, points, 3)
    breaches[:, -1, 1] = 0.0
    worst = breaches[np.arange(count), breaches[:, :, 1].argmax(axis=1), 0].astype(int)
    return tuple(site.prisms[k].footprint.name if k >= 0 else "" for k in worst), breaches[:, :, 1]


def _depth_m(site: Site, flat_m: FloatArray, shape: tuple[int, ...]) -> tuple[tuple[str, ...], FloatArray]:
    """Entered no-fly zones of corners whose places are the rows of an array, and (n, k) metres inside of them."""
    depth_m, names = np.zeros(shape), [""] * shape[0]
    for breach in site.flown_zones.position_breaches(flat_m) if site.zones else ():
        corner, position = divmod(breach.leg, shape[1])
        if breach.depth_m > depth_m[corner].max():
            names[corner] = site.zones[breach.zone].name
        depth_m[corner, position] = max(depth_m[corner, position], breach.depth_m)
    return tuple(names), depth_m
