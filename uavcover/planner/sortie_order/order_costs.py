"""Cost of an order of stretches: the least time of all sorties into which it can be split.

Stretches are legs of a route in any order and direction, with permitted links between their ends. Costs of stretches and links
are tabulated once, with the cost model of missions. An order then costs one look-up and one split (``kernels/path_cost.py``).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.flight_time import leg_times, turn_times
from uavcover.kernels.path_cost import NO_ENERGIES, FlightCosts, FlightEnergies, split, straight_ends
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.path_cost import FlightEnergy, mission_cost_of
from uavcover.model.route import Route
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of

_MOST_LAID = 800
"""Number of links laid over the terrain, the shortest first, for straight legs that exceed a limit."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """Stretches of a route in both directions: number 2 k flies leg k as the route does, 2 k + 1 the other way."""

    positions_m: FloatArray  # (n + 1, 3) ENU, where stretches begin and end: stretch k leads from k to k + 1
    # by two positions, the (k, 3) waypoints of a link that keeps the limits; missing without one
    links_m: dict[tuple[int, int], FloatArray]

    @property
    def count(self) -> int:
        """Number of stretches."""
        return len(self.positions_m) - 1

    def waypoints_m(self, number: int) -> FloatArray:
        """(2, 3) ENU of a stretch in its direction."""
        return self.positions_m[[first_position(number), last_position(number)]]

    def joined(self, order: Sequence[int] | IntArray) -> Route:
        """The route that flies stretches in this order, by existing links."""
        out = [self.waypoints_m(int(order[0]))]
        for before, behind in itertools.pairwise(order):
            a, b = last_position(int(before)), first_position(int(behind))
            following = self.waypoints_m(int(behind))
            out += [following[1:]] if a == b else [self.links_m[a, b], following]
        return Route(np.vstack(out))


def first_position(number: int) -> int:
    """Begin of a stretch in its direction."""
    return number // 2 + number % 2


def last_position(number: int) -> int:
    """End of a stretch in its direction."""
    return number // 2 + 1 - number % 2


def stretches_of(site: Site, route: Route) -> Stretches:
    """Cut a route that keeps the limits at every waypoint.

    Args:
        site: the scenario on its ground.
        route: two waypoints at least.
    """
    return Stretches(route.waypoints_m, _links(site, route.waypoints_m))


def _links(site: Site, positions_m: FloatArray) -> dict[tuple[int, int], FloatArray]:
    """Points of a link, by two points: a straight leg if it keeps the limits, otherwise one over the terrain."""
    margin_m = site.scenario.limits.height_margin_m
    apart_m = np.linalg.norm(positions_m[:, None] - positions_m[None], axis=2)
    pairs = np.argwhere(np.triu(apart_m > 0.0))
    laid = 0
    found: dict[tuple[int, int], FloatArray] = {}
    for a, b in pairs[np.argsort(apart_m[pairs[:, 0], pairs[:, 1]], kind="stable")].tolist():
        ends, between = positions_m[[a, b]], np.empty((0, 3))
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


NO_LINK_S = 1e7
"""Time of a link that does not exist."""


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """Time, or energy in w winds, by stretches in their directions: m of them, 2 for each leg of the route."""

    alone: FloatArray  # (w, m) along each stretch, from rest to rest
    # (w, m, m) from the end of one to the end of the next, without the turn at the end of the first
    arc: FloatArray
    turn: FloatArray  # (w, m, m) at the end of the first
    there: FloatArray  # (w, m, m) from home to the end of one, with the turn towards another
    first: FloatArray  # (w, m) from home to the begin of a stretch, with the turn onto it
    back: FloatArray  # (w, m) from its end to home


class OrderCosts:
    """The costs of orders of stretches.

    A flight begins at the end of the previous stretch, so that no flight omits the link between two sorties. Nodes of the split
    are the begin of the first stretch and the end of every stretch.

    Attributes:
        as_it_is: (n,) the order of the route.
        link_s: (m, m) from the end of one to the begin of another, with both turns; NO_LINK_S if that cannot be flown.
        back_s: (m,) from the end of each to home.

    Args:
        site: the scenario on its ground, with a home.
        stretches: of a route.
        like: the costs of the flights of that route, for its limits.
    """

    def __init__(self, site: Site, stretches: Stretches, like: FlightCosts) -> None:
        self._like = like
        self.as_it_is: IntArray = 2 * np.arange(stretches.count)
        paths = _Paths.of(stretches)
        pace, path_cost, energy = pace_of(site), mission_cost_of(site), FlightEnergy(site)
        there_s, back_s, _ = straight_ends(path_cost, paths.pairs_m)
        self._time = _tables(
            paths, leg_times(pace, paths.points_m)[None], turn_times(pace, paths.points_m)[None],
            there_s[None], back_s[None],
        )  # fmt: skip
        self._energy = None
        if like.energies.so_far_s.size:
            of_pairs = energy.straight_flights(path_cost, paths.pairs_m)
            legs, turns = energy.legs_and_turns_s(paths.points_m)
            self._energy = _tables(paths, legs, turns, of_pairs.there_s, of_pairs.back_s)
        self._between = paths.between
        # The two numbers of one stretch are never neighbours.
        self.back_s: FloatArray = self._time.back[0]
        self.link_s: FloatArray = np.where(
            paths.exists, self._time.arc[0] - self._time.alone[0] + self._time.turn[0], NO_LINK_S
        )
        stretch = np.arange(len(self.link_s)) // 2
        self.link_s[stretch[:, None] == stretch[None]] = NO_LINK_S

    def flights(self, order: IntArray) -> FlightCosts:
        """The costs of the flights of an order."""
        before, behind = order[:-1], order[1:]
        like, times = self._like, self._time
        so_far, turns, there, back = (each[0] for each in _rows(times, order, before, behind))
        there[-1] = back[0] = math.inf
        waypoints = np.arange(len(order) + 1)
        waypoints[2:] += np.cumsum(self._between[before, behind])
        each = like.each_items
        energies = NO_ENERGIES
        if self._energy is not None:
            used = _rows(self._energy, order, before, behind)
            energies = FlightEnergies(used[0], used[1], used[2], used[3], used[3], like.energies.usable_s)
        return FlightCosts(
            so_far_s=so_far,
            turns_s=turns,
            there_s=there,
            back_s=back,
            alone_s=back,
            # Counted up to a waypoint and from it, so that their sum is that of the flight.
            there_items=like.there_items[0] + each * (1 - waypoints),
            back_items=like.back_items[0] + each * waypoints,
            each_items=0,
            shared=1,
            endurance_s=like.endurance_s,
            item_limit=like.item_limit,
            barred=like.barred,
            energies=energies,
        )

    def total_s(self, order: IntArray) -> float:
        """The least time of all sorties; infinite without a split."""
        return float(split(self.flights(order))[0])


def _rows(tables: Tables, order: IntArray, before: IntArray, behind: IntArray) -> tuple[FloatArray, ...]:
    """(w, n + 1) up to each node, all turns up to it, from home to it, and from it to home."""
    w, n = tables.alone.shape[0], len(order) + 1
    so_far, turns, there, back = np.zeros((4, w, n))
    so_far[:, 1] = tables.alone[:, order[0]]
    so_far[:, 2:] = tables.arc[:, before, behind]
    turns[:, 1:-1] = tables.turn[:, before, behind]
    there[:, 0] = tables.first[:, order[0]]
    there[:, 1:-1] = tables.there[:, before, behind]
    back[:, 1:] = tables.back[:, order]
    return np.cumsum(so_far, axis=1), np.cumsum(turns, axis=1), there, back


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """All stretches, and all pairs of them, as one path after the other."""

    # (p, 3) of all of them: first the m stretches, then for each pair the last leg of one, the link, and the first leg
    # of the other
    points_m: FloatArray
    begins: IntArray  # (m + m m + 1,) where each begins in it
    # (2 (2 m + m m), 3) two waypoints each: the first leg of each stretch, its last leg, and the first leg that is
    # flown from the end of one stretch to another
    pairs_m: FloatArray
    exists: np.ndarray  # (m, m) whether the link exists
    same: np.ndarray  # (m, m) whether one ends where the other begins
    between: IntArray  # (m, m) waypoints that the link and the beginning of the other add

    @classmethod
    def of(cls, stretches: Stretches) -> "_Paths":
        count = 2 * stretches.count
        lines = [stretches.waypoints_m(k) for k in range(count)]
        exists, same = np.zeros((2, count, count), dtype=bool)
        between = np.zeros((count, count), dtype=np.int64)
        paths, onto = list(lines), []
        nothing = np.empty((0, 3))
        for a, line in enumerate(lines):
            for b, other in enumerate(lines):
                ends = last_position(a), first_position(b)
                same[a, b] = ends[0] == ends[1]
                exists[a, b] = same[a, b] or ends in stretches.links_m
                link = stretches.links_m.get(ends, nothing)
                between[a, b] = 0 if same[a, b] else len(link) + 1
                path = np.vstack([line[-2:], link, other[1:2] if same[a, b] else other[:2]])
                paths.append(path)
                onto.append(path[1:3])
        pairs = [*(line[:2] for line in lines), *(line[-2:] for line in lines), *onto]
        begins = np.cumsum([0, *map(len, paths)])
        return cls(np.vstack(paths), begins, np.vstack(pairs), exists, same, between)


def _tables(paths: _Paths, legs: FloatArray, turns: FloatArray, there: FloatArray, back: FloatArray) -> Tables:
    """Tables of (w, p - 1) legs and (w, p) turns of all paths, and of (w, q) transits of the pairs."""
    w, m = len(legs), len(paths.exists)
    begins = paths.begins
    # Sums up to a waypoint, of legs behind it and of turns at it.
    legs_to = np.concatenate([np.zeros((w, 1)), np.cumsum(legs, axis=1)], axis=1)
    turns_to = np.concatenate([np.zeros((w, 1)), np.cumsum(turns, axis=1)], axis=1)
    first, last = begins[:-1], begins[1:] - 1
    alone = (legs_to[:, last[:m]] - legs_to[:, first[:m]]) + (turns_to[:, last[:m]] - turns_to[:, first[:m] + 1])
    first, last = first[m:], last[m:]
    # Of a pair: without its first and last leg; turns behind that at the end of the first stretch.
    turn = turns[:, first + 1].reshape(w, m, m)
    link = (legs_to[:, last - 1] - legs_to[:, first + 1]) + (turns_to[:, last] - turns_to[:, first + 2])
    link = np.where(paths.same, 0.0, link.reshape(w, m, m))
    arc = np.where(paths.exists, link + alone[:, None, :], NO_LINK_S)
    return Tables(
        alone=alone,
        arc=arc,
        turn=np.where(paths.exists, turn, 0.0),
        there=there[:, 4 * m :: 2].reshape(w, m, m),
        first=there[:, : 2 * m : 2],
        back=back[:, 2 * m + 1 : 4 * m : 2],
    )
