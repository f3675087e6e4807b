"""Corner checks: how the line that is flown beside waypoints compares with the hard limits.

ArduCopter passes inside of its waypoints (:mod:`uavcover.sensing.flown_line`), where no leg is: nearer to what a route leads
around, and at the edge of a cliff over other ground. Planning adds the excesses to those of the legs; the mission compiler
refuses a route that has any.
"""

import dataclasses

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.leg_checks import LegProblem, ProblemKind
from uavcover.scenario.obstacles import leg_breaches
from uavcover.scenario.site import Site
from uavcover.sensing.flown_line import corners_flown

HEIGHT_TOLERANCE_M = 0.1
"""Tolerance of corners beyond the height band: vehicles pass them within some centimetres of the computed line."""


def corner_excess_m(site: Site, route_m: FloatArray) -> FloatArray:
    """(n,) metres by which the corner at each waypoint of an (n, 3) ENU route breaks limits that its legs keep.

    Height margins, and those of no-fly zones, are for what a vehicle flies beside its line, and may be used.
    """
    excess_m = np.zeros(len(route_m))
    for kind in _figures(site, route_m):
        excess_m += kind.excess_m.max(axis=1)
    return excess_m


def corner_excess_around_m(site: Site, route_m: FloatArray, waypoint: int) -> float:
    """Metres by which the corners at a waypoint of an (n, 3) ENU route and at those beside it break limits.

    A corner is made by its two legs, so that only five waypoints are looked at, however long the route is.
    """
    first, last = max(waypoint - 1, 0), min(waypoint + 1, len(route_m) - 1)
    begin = max(first - 1, 0)
    excess_m = corner_excess_m(site, route_m[begin : last + 2])
    return float(excess_m[first - begin : last - begin + 1].sum())


def corner_heights_off_m(site: Site, route_m: FloatArray) -> FloatArray:
    """(n,) metres by which the corner at each waypoint of an (n, 3) ENU route is above the height band (below: negative)."""
    off_m = np.zeros(len(route_m))
    for kind in _figures(site, route_m):
        if kind.kind in ("too low", "too high"):
            off_m += kind.excess_m.max(axis=1) * (1.0 if kind.kind == "too high" else -1.0)
    return off_m


def find_corner_problems(site: Site, route_m: FloatArray, *, with_ends: bool = True) -> list[LegProblem]:
    """Every corner of an (n, 3) ENU route that breaks a limit, in flying order.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        with_ends: whether the corners from home onto the route and off it count. Where a route is cut into several flights, those
            at the cuts are others than those of the whole.
    """
    problems: list[LegProblem] = []
    for figures in _figures(site, route_m):
        if not with_ends:
            figures.excess_m[[0, -1]] = 0.0
        for k in np.flatnonzero(figures.excess_m.max(axis=1) > 0.0):
            at = int(np.argmax(figures.excess_m[k]))
            east_m, north_m, _ = figures.places_m[k, at].tolist()
            value = float(figures.values[k, at])
            where = int(k), figures.kind, value, figures.limit, figures.unit, east_m, north_m
            problems.append(LegProblem(*where, in_corner=True, name=figures.names[k]))
    return sorted(problems, key=lambda problem: problem.leg)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Figures:
    """Values of n corners, at k positions each, compared with one limit."""

    kind: ProblemKind  # which
    places_m: FloatArray  # (n, k, 3) ENU
    values: FloatArray  # (n, k) what is limited
    excess_m: FloatArray  # (n, k) beyond the limit; 0 where it is kept
    limit: float  # the limit
    unit: str  # of values and limit
    names: tuple[str, ...]  # (n,) of what is too near


def _figures(site: Site, route_m: FloatArray) -> list[_Figures]:
    """For each limit that a corner breaks anywhere."""
    places_m = corners_flown(site, route_m) if len(route_m) > 1 else None
    if places_m is None:
        return []
    flat, shape = places_m.reshape(-1, 3), places_m.shape[:2]
    limits, unnamed = site.scenario.limits, ("",) * shape[0]
    agl_m = site.ground.heights_agl_m(flat).reshape(shape)
    low_m, high_m = limits.min_height_agl_m, limits.max_height_agl_m
    outside_m = _outside_m(site, flat).reshape(shape)
    obstacle, lacking_m = _lacking_m(site, places_m)
    zone, depth_m = _depth_m(site, flat, shape)
    above_ground = "m above ground"
    found = [
        _Figures("too low", places_m, agl_m, low_m - agl_m - HEIGHT_TOLERANCE_M, low_m, above_ground, unnamed),
        _Figures("too high", places_m, agl_m, agl_m - high_m - HEIGHT_TOLERANCE_M, high_m, above_ground, unnamed),
        _Figures("fence", places_m, outside_m, outside_m, 0.0, "m", unnamed),
        _Figures("obstacle", places_m, lacking_m, lacking_m, 0.0, "m", obstacle),
        _Figures("no-fly zone", places_m, depth_m, depth_m, 0.0, "m", zone),
    ]
    return [
        dataclasses.replace(each, excess_m=np.fmax(each.excess_m, 0.0)) for each in found if (each.excess_m > 0.0).any()
    ]


def _outside_m(site: Site, flat_m: FloatArray) -> FloatArray:
    """(k,) metres outside of the fence of (k, 3) places; distances take long, so they are only taken there."""
    outside_m = np.zeros(len(flat_m))
    beyond = ~shapely.contains_xy(site.fence, flat_m[:, 0], flat_m[:, 1])
    outside_m[beyond] = shapely.distance(site.fence, shapely.points(flat_m[beyond, :2]))
    return outside_m


def _lacking_m(site: Site, places_m: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Nearest obstacles of (n, k, 3) corners, and (n, k) metres of clearance that are missing there."""
    count, points = places_m.shape[:2]
    if not site.prisms:
        return ("",) * count, np.zeros((count, points))
    # From place to place, and from the last one of a corner to the first one of the next, which does not count.
    breaches = leg_breaches(site.ground, places_m.reshape(-1, 3), site.scenario.obstacles)
    breaches = np.vstack([breaches, [-1.0, 0.0, 0.0]]).reshape(count, points, 3)
    breaches[:, -1, 1] = 0.0
    worst = breaches[np.arange(count), breaches[:, :, 1].argmax(axis=1), 0].astype(int)
    return tuple(site.prisms[k].footprint.name if k >= 0 else "" for k in worst), breaches[:, :, 1]


def _depth_m(site: Site, flat_m: FloatArray, shape: tuple[int, ...]) -> tuple[tuple[str, ...], FloatArray]:
    """Entered no-fly zones of corners whose places are the rows of an array, and (n, k) metres inside of them."""
    depth_m, names = np.zeros(shape), [""] * shape[0]
    for breach in site.flown_zones.place_breaches(flat_m) if site.zones else ():
        corner, place = divmod(breach.leg, shape[1])
        if breach.depth_m > depth_m[corner].max():
            names[corner] = site.zones[breach.zone].name
        depth_m[corner, place] = max(depth_m[corner, place], breach.depth_m)
    return tuple(names), depth_m
