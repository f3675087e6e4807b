"""Divide the area among identical vehicles: parts of equal time, and flights that do not wait.

The first borders follow the estimated work, the next ones the resulting times. Then the slowest parts are searched again.
Finally, vehicles exchange parts and routes are reversed while the schedule gets shorter.
"""

import itertools
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from uavcover.errors import InfeasibleError
from uavcover.missions.fleet_schedule import Timeline, UnsafeStarts, schedule, timeline_of
from uavcover.missions.flights import compile_sorties
from uavcover.model.area import Outline
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.planner.division import FlightWork, divide, flight_work
from uavcover.planner.fleet_parts import Soonest, part_sites, plan_of_parts
from uavcover.scenario.site import Site, area_as_drawn
from uavcover.scenario.vehicles import Piece, vehicle_sites

_log = logging.getLogger(__name__)

SearchAgain = Callable[[Site, float, str, int], Plan]
"""Searches in a part of the area, with a fraction of the effort, by a rule. Another number is another search."""

_BESIDE = 0.5
"""Homes that are nearer to vehicle 1's, in sides of a square of the area's size, count as one for the borders."""
_GRID_M = 0.01
_SHIFT = 0.7
"""Fraction of the difference to the mean time that moves the borders: part of it is luck of the search."""
_MOST_ARRANGED, _TRIES, _STARTS = 8, 400, 8
"""Vehicles whose parts are exchanged and reversed, schedules that are tried, and arrangements from which that begins."""
_NEAR = 12
"""Combinations beside the best one that are scheduled at a time."""
_LEAST_GAIN_S = 0.5


def is_one_flight_each(site: Site) -> bool:
    """Whether one battery is enough for each vehicle's part. The estimate adds half for turns."""
    vehicle, work = site.scenario.vehicle, flight_work(site)
    whole_s = work.of(site.area, site.scenario.fleet.vehicles) / vehicle.cruise_speed_m_s
    longest_s = vehicle.longest_flight_s
    return longest_s is None or 1.5 * whole_s <= site.scenario.fleet.vehicles * longest_s


def plan_by_area(
    site: Site, *, rule: str, required: float, search: SearchAgain, efforts: Sequence[float]
) -> tuple[Plan, Site] | None:
    """The plan of a fleet whose vehicles have parts of the area, and the site with the parts.

    Args:
        site: the scenario on its ground; its vehicles differ only in their homes.
        rule: of each part and of the whole.
        required: coverage by this rule.
        search: of each part.
        efforts: fractions of the search for each division; the last one is for the slowest parts of the best division.

    Returns:
        None if the area cannot be divided, or the parts have too little coverage.

    Raises:
        InfeasibleError: no route of a part keeps the limits.
        ScenarioError: a part is too small.
    """
    fractions, divisions = [1.0] * len(site.scenario.vehicles), list[_Division]()
    for effort in efforts[:-1] or efforts:
        divided = _divided(site, fractions)
        if divided is None:
            break
        divisions.append(_Division.searched(*divided, rule, required, search, effort))
        fractions = divisions[-1].balanced(fractions)
        if divisions[-1].is_interrupted:
            break
    divisions = [each for each in divisions if each.combinations]
    if not divisions:
        return None
    if len(efforts) > 1 and not any(each.is_interrupted for each in divisions):
        best = min(divisions, key=lambda each: each.longest_s)
        divisions.append(best.searched_again(required, search, efforts[-1]))
    arranged = min((_arranged(each, required) for each in divisions), key=lambda each: each.end_s)
    evaluations = sum(plan.evaluations for division in divisions for plan in division.plans)
    return plan_of_parts(
        arranged.division.site,
        arranged.division.plans,
        select_rule=rule,
        evaluations=evaluations,
        soonest=arranged.found,
    ), arranged.division.site


@dataclass(frozen=True, slots=True, eq=False)
class _Division:
    """An area that is divided, with plans of its parts."""

    site: Site  # the fleet's, whose vehicles have parts
    piece_of: tuple[int, ...]  # the number of each vehicle's part in the order of the cuts
    parts: tuple[Site, ...]  # the site of each part
    plans: tuple[Plan, ...]  # of the parts
    combinations: list[list[RouteMember]]  # of their routes that together have the required coverage, the soonest first

    @classmethod
    def searched(
        cls, site: Site, piece_of: tuple[int, ...], rule: str, required: float, search: SearchAgain, effort: float
    ) -> "_Division":
        # Rounding leaves slivers between borders that touch, and later polygon operations fail on them.
        parts = tuple(replace(own, area=shapely.set_precision(own.area, _GRID_M)) for own in part_sites(site))
        whole_m2 = sum(own.area.area for own in parts)
        plans = tuple(search(own, effort * own.area.area / whole_m2, rule, 0) for own in parts)
        found = cls(site, piece_of, parts, plans, Soonest(site, plans, required).combinations())
        found.log()
        return found

    def log(self) -> None:
        """Log the times of the parts."""
        _log.info(
            "parts of %s ha take %s s, in total %s",
            [round(own.area.area / 1e4, 1) for own in self.parts],
            [round(plan.chosen.metrics.time_s) for plan in self.plans],
            [round(member.metrics.time_s) for member in self.combinations[0]] if self.combinations else None,
        )

    @property
    def longest_s(self) -> float:
        return max((m.metrics.time_s for m in self.combinations[0]), default=np.inf) if self.combinations else np.inf

    @property
    def is_interrupted(self) -> bool:
        return any(plan.interrupted for plan in self.plans)

    def balanced(self, fractions: Sequence[float]) -> list[float]:
        """Fractions of the work that give the parts equal times."""
        members = self.combinations[0] if self.combinations else [plan.chosen for plan in self.plans]
        times_s = [max(member.metrics.time_s, 1.0) for member in members]
        changed = list(fractions)
        for piece, time_s in zip(self.piece_of, times_s, strict=True):
            changed[piece] *= (sum(times_s) / len(times_s) / time_s) ** _SHIFT
        return changed

    def searched_again(self, required: float, search: SearchAgain, effort: float) -> "_Division":
        """The same after another search of the slowest parts, for the coverage that the others leave to them."""
        times_s = [member.metrics.time_s for member in self.combinations[0]]
        slow = [k for k, time_s in enumerate(times_s) if time_s >= sum(times_s) / len(times_s)]
        plans = list(self.plans)
        spare = Soonest(self.site, plans, required).spare(max(times_s)) / len(slow) * self.site.area.area
        for k in slow:
            less = self.combinations[0][k].metrics.coverage_of_coverable - spare / self.parts[k].area.area
            again = search(self.parts[k], effort / len(slow), f"coverage>={min(less, required):.4f}", 1)
            first, second = sorted((again, plans[k]), key=lambda plan: (not plan.rule_met, plan.chosen.metrics.time_s))
            members = sorted((*first.members, *second.members), key=lambda m: m.metrics.coverage_of_coverable)
            plans[k] = replace(first, members=tuple(members))
        found = replace(self, plans=tuple(plans), combinations=Soonest(self.site, plans, required).combinations())
        found.log()
        return found

    def reordered(self, order: Sequence[int]) -> "_Division":
        """The same with part ``order[k]`` for vehicle k."""
        vehicles = self.site.scenario.vehicles
        areas = [vehicles[part].area for part in order]
        moved = tuple(replace(each, area=area) for each, area in zip(vehicles, areas, strict=True))
        return replace(
            self,
            site=replace(self.site, scenario=replace(self.site.scenario, vehicles=moved)),
            piece_of=tuple(self.piece_of[part] for part in order),
            parts=tuple(self.parts[part] for part in order),
            plans=tuple(self.plans[part] for part in order),
            combinations=[[members[part] for part in order] for members in self.combinations],
        )


def _divided(site: Site, fractions: Sequence[float]) -> tuple[Site, tuple[int, ...]] | None:
    """The site with a part for each vehicle, and the numbers of the parts. None if the area is too small.

    Work includes the transit from vehicle 1's home if all homes are near it. The assignment minimises the sum of the distances
    between homes and parts, so that the straight lines between them do not cross.
    """
    sites, work = vehicle_sites(site), flight_work(site)
    homes = np.array([own.home_m[:2] for own in sites if own.home_m is not None])
    beside = float(np.hypot(*(homes - homes[0]).T).max()) <= _BESIDE * site.area.area**0.5
    pieces = divide(area_as_drawn(site), len(sites), work if beside else FlightWork(work.swath_m), fractions)
    if len(pieces) < len(sites):
        return None
    middles = np.array([[piece.centroid.x, piece.centroid.y] for piece in pieces])
    from scipy.optimize import linear_sum_assignment  # a tenth of a second to load

    _, piece_of = linear_sum_assignment(np.hypot(*(homes[:, None] - middles[None]).transpose(2, 0, 1)))
    vehicles = tuple(
        replace(vehicle, area=_outline(pieces[k])) for vehicle, k in zip(site.scenario.vehicles, piece_of, strict=True)
    )
    return replace(site, scenario=replace(site.scenario, vehicles=vehicles)), tuple(map(int, piece_of))


def _outline(piece: Piece) -> Outline:
    """A piece as in a scenario."""
    return Outline(
        polygons_east_north_m=tuple(
            tuple(
                tuple((east, north) for east, north in ring.coords[:-1])
                for ring in (polygon.exterior, *polygon.interiors)
            )
            for polygon in shapely.get_parts(piece)
        )
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Arranged:
    """A division whose parts are exchanged between the vehicles."""

    division: _Division  # the same
    # combinations of routes: the one that ends soonest in the best directions, and some as they were found
    found: list[list[RouteMember]]
    end_s: float  # its last landing


def _arranged(division: _Division, required: float) -> _Arranged:
    """Exchange parts, use other routes of the parts, and reverse routes, so that the last vehicle lands earlier."""
    if len(division.plans) > _MOST_ARRANGED:
        return _Arranged(division, division.combinations, division.longest_s)
    search = _Arrangements(division.site)
    moved = division.reordered(search.best(division.combinations[0]).order)
    search, soonest = _Arrangements(moved.site), Soonest(moved.site, moved.plans, required)
    now = min((search.turned(members) for members in moved.combinations), key=lambda each: each.end_s)
    better = True
    while better and search.tried < _TRIES:
        near = soonest.beside(now.found, now.end_s)
        near.sort(key=lambda members: max(member.metrics.time_s for member in members))
        found = min((search.turned(members) for members in near[:_NEAR]), key=lambda each: each.end_s, default=now)
        better = found.end_s < now.end_s - _LEAST_GAIN_S
        now = found if better else now
    _log.info("flights of %s s, last landing after %.0f s", [round(m.metrics.time_s) for m in now.members], now.end_s)
    return _Arranged(moved, [now.members, now.found, *moved.combinations], now.end_s)


def _reversed(member: RouteMember) -> RouteMember:
    return replace(member, route=Route(member.route.waypoints_m[::-1]))


@dataclass(frozen=True, slots=True, eq=False)
class _Arrangement:
    """Routes, their vehicles and directions, and the resulting schedule."""

    order: tuple[int, ...]  # for each vehicle the number of its route
    members: list[RouteMember]  # each vehicle's route in the direction in which it is flown
    found: list[RouteMember]  # the same as they were found
    end_s: float  # the last landing; infinite where a flight is not possible


class _Arrangements:
    """Tries arrangements of routes.

    Args:
        site: the scenario on its ground.
    """

    def __init__(self, site: Site) -> None:
        self._site, self._unsafe = site, UnsafeStarts(site.scenario.fleet)
        self._flights: dict[tuple[bytes, int], list[Timeline]] = {}
        self.tried = 0

    def best(self, members: Sequence[RouteMember]) -> _Arrangement:
        """The arrangement that ends first, by exchanging two routes or reversing one, from several initial arrangements."""
        count, rng, tried = len(members), np.random.default_rng(0), {}
        both = [(member, _reversed(member)) for member in members]

        def value(order: tuple[int, ...], backwards: tuple[int, ...]) -> _Arrangement:
            if (order, backwards) not in tried:
                turned = [both[k][backwards[k]] for k in order]
                tried[order, backwards] = self._scheduled(order, turned, [members[k] for k in order])
            return tried[order, backwards]

        now = tuple(range(count)), (0,) * count
        for _ in range(_STARTS):
            better = True
            while better and len(tried) < _TRIES:
                order, backwards = now
                near = [(order, turned) for turned in _one_turned(backwards)]
                near += [(swapped, backwards) for swapped in _one_exchanged(order)]
                best = min(near, key=lambda each: value(*each).end_s)
                better = value(*best).end_s < value(*now).end_s - _LEAST_GAIN_S
                now = best if better else now
            if len(tried) >= _TRIES:
                break
            now = tuple(map(int, rng.permutation(count))), tuple(map(int, rng.integers(0, 2, count)))
        return min(tried.values(), key=lambda each: each.end_s)

    def turned(self, members: list[RouteMember]) -> _Arrangement:
        """The best directions of routes with given vehicles."""
        order = tuple(range(len(members)))
        best, better = self._scheduled(order, members, members), True
        while better:
            now = best.members
            near = [self._scheduled(order, [*now[:k], _reversed(now[k]), *now[k + 1 :]], members) for k in order]
            found = min(near, key=lambda each: each.end_s)
            better = found.end_s < best.end_s - _LEAST_GAIN_S
            best = found if better else best
        return best

    def _scheduled(self, order: tuple[int, ...], members: list[RouteMember], found: list[RouteMember]) -> _Arrangement:
        self.tried += 1
        flights = [self._timelines(member.route, k) for k, member in enumerate(members)]
        if [] in flights:
            return _Arrangement(order, members, found, np.inf)
        each = [(timeline, k) for k, own in enumerate(flights) for timeline in own]
        fleet, timelines = self._site.scenario.fleet, [timeline for timeline, _ in each]
        starts = schedule(timelines, fleet, vehicle_of=[k for _, k in each], unsafe=self._unsafe)
        end_s = max(start.start_s + timeline.duration_s for start, timeline in zip(starts, timelines, strict=True))
        return _Arrangement(order, members, found, end_s)

    def _timelines(self, route: Route, vehicle: int) -> list[Timeline]:
        key = (route.waypoints_m.tobytes(), vehicle)
        if key not in self._flights:
            own = vehicle_sites(self._site)[vehicle]
            name = own.scenario.vehicle.autopilot
            try:
                sorties = compile_sorties(own, route, autopilot=name)
                self._flights[key] = [timeline_of(own, sortie, autopilot=name) for sortie in sorties]
            except InfeasibleError:
                self._flights[key] = []
        return self._flights[key]


def _one_turned(backwards: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [(*backwards[:k], 1 - backwards[k], *backwards[k + 1 :]) for k in range(len(backwards))]


def _one_exchanged(order: tuple[int, ...]) -> list[tuple[int, ...]]:
    found = []
    for a, b in itertools.combinations(range(len(order)), 2):
        exchanged = list(order)
        exchanged[a], exchanged[b] = order[b], order[a]
        found.append(tuple(exchanged))
    return found
