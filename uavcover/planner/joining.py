"""Routes one behind the other as one route: in which order, which way round, and with what between them."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.tours import nearest, shorten
from uavcover.planner.baselines.boustrophedon import PLAIN_TOLERANCE_M
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site

_KICKS_PER_END = 40
_NEAR = 20
_STEEP = 4.0
"""A link that is too steep costs this multiple of the longest one more."""


def joined(site: Site, routes_m: Sequence[FloatArray]) -> FloatArray:
    """(n, 3) waypoints of routes in their order, with links between them that follow the terrain.

    Args:
        site: the scenario on its ground.
        routes_m: one at least, each (k, 3) ENU.
    """
    out = [routes_m[0]]
    for before, behind in itertools.pairwise(routes_m):
        ends = np.vstack([before[-1], behind[0]])
        link = lay_over_terrain(site, ends[:, :2], site.ground.heights_agl_m(ends), tolerance_m=PLAIN_TOLERANCE_M)
        out += [link[1:-1], behind]
    return np.vstack(out)


def in_good_order(
    routes_m: Sequence[FloatArray], home_m: FloatArray | None, *, max_climb_angle_deg: float = 90.0
) -> list[FloatArray]:
    """The routes in an order, and each in a direction, that makes the links between them short.

    Where there is a home a flight may end between two routes and another begin: then a link costs itself and the way home and
    back from the nearer of its ends. The open tour through all ends, with each route as a link that must stay, is shortened by
    :func:`uavcover.kernels.tours.shorten`. Flights begin and end close together around home, at different heights: a link that
    is steeper than legs may be is taken where there is no other.

    Args:
        routes_m: each (k, 3) ENU.
        home_m: (3,) take-off position; none without one.
        max_climb_angle_deg: steepest link.
    """
    count = len(routes_m)
    if count == 1:
        return list(routes_m)
    ends = np.array([route[k] for route in routes_m for k in (0, -1)])
    distance = np.linalg.norm(ends[:, None] - ends[None], axis=2)
    if home_m is not None:
        away = np.linalg.norm(ends - home_m, axis=1)
        distance = distance + 2.0 * np.minimum(away[:, None], away[None])
    level_m = np.linalg.norm(ends[:, None, :2] - ends[None, :, :2], axis=2)
    climb_m = np.abs(ends[:, None, 2] - ends[None, :, 2])
    steep = climb_m > level_m * math.tan(math.radians(max_climb_angle_deg))
    distance[steep] += _STEEP * (1.0 + float(distance.max()))
    free = 2 * count  # a place that is near to all: where the tour is open
    links = np.zeros((free + 1, free + 1))
    links[:free, :free] = distance
    if home_m is not None:
        links[:free, free] = links[free, :free] = away
    stay = -10.0 * (float(links.max()) + 1.0)
    for k in range(count):
        links[2 * k, 2 * k + 1] = links[2 * k + 1, 2 * k] = stay
    np.fill_diagonal(links, 0.0)
    near = nearest(links, min(_NEAR, free))
    tour = shorten(links, near, np.arange(free + 1), _KICKS_PER_END * free, np.random.default_rng(0))
    at = int(np.flatnonzero(tour == free)[0])
    order = np.roll(tour, -at)[1:]
    return [routes_m[first // 2] if first % 2 == 0 else routes_m[first // 2][::-1] for first in order[::2].tolist()]
