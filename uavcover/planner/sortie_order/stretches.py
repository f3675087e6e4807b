"""Legs of a route as stretches in any order and direction, and the legal links between their ends."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import PLAIN_TOLERANCE_M
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site

_MOST_LAID = 800
"""Where the straight leg between two points breaks a limit, a link over the terrain is laid, for this number of the shortest."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches of a route in both directions: number 2 k flies leg k as the route does, 2 k + 1 the other way."""

    places_m: FloatArray  # (n + 1, 3) ENU, where stretches begin and end: stretch k leads from place k to place k + 1
    # by two places, the (k, 3) waypoints between them of a link that keeps the limits; none where there is none
    links_m: dict[tuple[int, int], FloatArray]

    @property
    def count(self) -> int:
        """Number of stretches."""
        return len(self.places_m) - 1

    def waypoints_m(self, number: int) -> FloatArray:
        """(2, 3) ENU of a stretch in its direction."""
        return self.places_m[[first_place(number), last_place(number)]]

    def joined(self, order: Sequence[int] | IntArray) -> Route:
        """The route that flies stretches in this order, by links that exist."""
        out = [self.waypoints_m(int(order[0]))]
        for before, behind in itertools.pairwise(order):
            a, b = last_place(int(before)), first_place(int(behind))
            following = self.waypoints_m(int(behind))
            out += [following[1:]] if a == b else [self.links_m[a, b], following]
        return Route(np.vstack(out))


def first_place(number: int) -> int:
    """Begin of a stretch in its direction."""
    return number // 2 + number % 2


def last_place(number: int) -> int:
    """End of a stretch in its direction."""
    return number // 2 + 1 - number % 2


def stretches_of(site: Site, route: Route) -> Stretches:
    """Cut a route that keeps the limits at every waypoint.

    Args:
        site: the scenario on its ground.
        route: two waypoints at least.
    """
    return Stretches(route.waypoints_m, _links(site, route.waypoints_m))


def _links(site: Site, places_m: FloatArray) -> dict[tuple[int, int], FloatArray]:
    """Points of a link, by two points: a straight leg where it keeps the limits, else one over the terrain."""
    margin_m = site.scenario.limits.height_margin_m
    apart_m = np.linalg.norm(places_m[:, None] - places_m[None], axis=2)
    pairs = np.argwhere(np.triu(apart_m > 0.0))
    laid = 0
    found: dict[tuple[int, int], FloatArray] = {}
    for a, b in pairs[np.argsort(apart_m[pairs[:, 0], pairs[:, 1]], kind="stable")].tolist():
        ends, between = places_m[[a, b]], np.empty((0, 3))
        if measure_violations(site, ends, margin_m=margin_m).total > 0.0:
            if laid == _MOST_LAID:
                continue
            laid += 1
            heights_m = site.ground.heights_agl_m(ends)
            between = lay_over_terrain(site, ends[:, :2], heights_m, tolerance_m=PLAIN_TOLERANCE_M)[1:-1]
            if measure_violations(site, np.vstack([ends[:1], between, ends[1:]]), margin_m=margin_m).total > 0.0:
                continue
        found[a, b], found[b, a] = between, between[::-1]
    return found
