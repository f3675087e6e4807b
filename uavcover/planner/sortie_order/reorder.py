"""Reorder the stretches of a route and choose their directions, so that its sorties finish earlier."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.path_cost import FlightCosts, split
from uavcover.kernels.tours import nearest, shorten
from uavcover.missions.fleet_cuts import allocate
from uavcover.missions.flights import compile_sorties, compile_unlike_sorties
from uavcover.missions.objectives import flights_of_split, mission_cost, straight_flight_costs
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Route
from uavcover.planner.final_changes import least_coverage
from uavcover.planner.sortie_order.order_costs import OrderCosts, stretches_of
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap

_TRIES_PER_EVALUATION, _MOST_TRIES = 6, 3_000
"""Orders tried per evaluation of the search without a time budget; a tenth of its processor time."""

_MOST_LEGS = 120
"""Longer routes keep their order: tables of all links, and splits at all waypoints, would take more than they give."""

_LEAST_GAIN = 0.001
"""Fraction of the mission time: a smaller gain is not worth another order."""

_STREAM = 2
"""Stream of random numbers, apart from those of the local search."""

_TRANSIT_ITEMS = 2
"""Mission items of a way between home and the route: two waypoints, as over open ground."""


@dataclass(frozen=True, slots=True)
class OrderEffort:
    """Effort of the search for an order."""

    tries: int  # number of orders to try without a time budget
    seed: int  # of the whole search
    used: Callable[[], float] | None = None  # used fraction of the time, 0..1; None without a budget
    should_stop: Callable[[], bool] = lambda: False  # the user's stop; the best order so far is taken

    def done(self, tried: int) -> float:
        """Finished fraction of the work after ``tried`` orders; 1 at its end."""
        if self.should_stop():
            return 1.0
        return tried / max(self.tries, 1) if self.used is None else self.used()


def tries_of(evaluations: int) -> int:
    """Number of orders that are tried after a search of ``evaluations`` evaluations."""
    return min(_TRIES_PER_EVALUATION * evaluations, _MOST_TRIES)


def has_several_sorties(site: Site, route: Route) -> bool:
    """Whether a route takes several batteries or missions, according to the minimised cost."""
    return len(_sorties(_straight_costs(site, route))) > 1 if _may_be_reordered(site, route) else False


def reordered(
    site: Site, judges: Sequence[CoverageMap], route: Route, effort: OrderEffort, *, required: float | None
) -> Route | None:
    """A route of the same stretches with a shorter mission, as planned and as compiled; None without one.

    It keeps the required coverage, or that of the route. In another direction or order, a sensor that looks ahead or takes
    distance-triggered photos may observe other ground.

    Args:
        site: the scenario on its ground.
        judges: the evaluation grid, and finer cells that need the same coverage.
        route: keeps the limits.
        effort: of the search.
        required: required coverage of the visible ground, if any.
    """
    if not has_several_sorties(site, route) or effort.done(0) >= 1.0:
        return None
    least = [least_coverage(_observed(judge, route), required, finer=number > 0) for number, judge in enumerate(judges)]
    stretches = stretches_of(site, route)
    costs = OrderCosts(site, stretches, _straight_costs(site, route))
    rng = np.random.default_rng(np.random.SeedSequence([effort.seed, _STREAM]))
    _, order = better_order(costs, costs.as_it_is, done=effort.done, rng=rng)
    other = stretches.joined(order)
    if mission_cost(site, other).time_s > (1.0 - _LEAST_GAIN) * mission_cost(site, route).time_s:
        return None
    if any(_observed(judge, other) < needed for judge, needed in zip(judges, least, strict=True)):
        return None
    return other if _is_done_sooner(_done_s(site, other), _done_s(site, route)) else None


def _is_done_sooner(times_s: tuple[float, float], before_s: tuple[float, float]) -> bool:
    return times_s != before_s and all(now <= before for now, before in zip(times_s, before_s, strict=True))


def _may_be_reordered(site: Site, route: Route) -> bool:
    """Whether sorties share the waypoint between them, and their time counts."""
    along_path = site.scenario.sensor.looks_along_path
    whole = site.home_m is not None and path_cost_of(site).mission == 1
    return along_path and whole and 2 < len(route) <= _MOST_LEGS + 1


def _straight_costs(site: Site, route: Route) -> FlightCosts:
    return straight_flight_costs(site, route.waypoints_m, transit_items=_TRANSIT_ITEMS)


def _sorties(costs: FlightCosts) -> list[tuple[int, int]]:
    """The flights of the best split; empty without one."""
    total_s, begun = split(costs)
    return flights_of_split(begun, costs.shared) if math.isfinite(total_s) else []


def _observed(judge: CoverageMap, route: Route) -> float:
    return judge.fraction_of_coverable(judge.observed(route.waypoints_m))


def _done_s(site: Site, route: Route) -> tuple[float, float]:
    """Finish of all vehicles, and their total flight time, as compiled; infinite if the compiler refuses a flight."""
    scenario = site.scenario
    if site.frame is None:
        time_s = mission_cost(site, route).time_s
        return time_s, time_s
    try:
        if scenario.vehicles:
            one_at_a_time = scenario.fleet.one_at_a_time
            sorties = compile_unlike_sorties(vehicle_sites(site), route, one_at_a_time=one_at_a_time)
        else:
            autopilot, count = scenario.vehicle.autopilot, scenario.fleet.vehicles
            sorties = compile_sorties(site, route, autopilot=autopilot, vehicles=count)
    except InfeasibleError:
        return math.inf, math.inf
    times_s = [sortie.compiled.flight_time_s for sortie in sorties]
    turnaround_s = scenario.fleet.turnaround_s
    if scenario.fleet.one_at_a_time:
        return math.fsum(times_s) + turnaround_s * (len(times_s) - 1), math.fsum(times_s)
    if scenario.vehicles:
        busy_s = dict.fromkeys((sortie.vehicle for sortie in sorties), -turnaround_s)
        for sortie, time_s in zip(sorties, times_s, strict=True):
            busy_s[sortie.vehicle] += time_s + turnaround_s
        return max(busy_s.values()), math.fsum(times_s)
    return allocate(times_s, scenario.fleet.vehicles, turnaround_s).makespan_s, math.fsum(times_s)


# Search for the order and the direction of stretches in which their sorties take least.
#
# An order is judged by its best split ("route first, cluster second"; Prins 2004, doi 10.1016/S0305-0548(03)00158-8), so one
# list stands for all sorties, and what moves stretches within it moves them within a sortie or between several. Orders are
# short tours by 2-opt and Or-opt, with reversals (:func:`uavcover.kernels.tours.shorten`), under lengths that are wrong at
# random (the noising method, Charon and Hudry 1993, doi 10.1016/0167-6377(93)90023-A): from the order at hand, or from any. A
# link also costs a random fraction of the way home from its nearer end, so that some tours pass home as often as batteries are
# changed.

_NOISE = (0.1, 0.6)
"""Least and largest relative error of a length; drawn anew for every tour."""
_HOME = 0.36
"""Largest fraction of the way home and back that a link costs."""
_ANEW = 0.2
"""Fraction of the tours that begin from any order."""
_KICKS, _NEAR = 20, 8
"""Numbers of kicks and of neighbours of one tour."""
_HEAT = 0.003
"""Fraction of the sorties' total time: at first, an order worse by this is accepted with a probability of 1 / e."""

_LEAST_GAIN_S = 1e-6


def better_order(
    costs: OrderCosts, start: IntArray, *, done: Callable[[int], float], rng: np.random.Generator
) -> tuple[float, IntArray]:
    """The best order found, and its time; never worse than the first one.

    Args:
        costs: of orders of n stretches.
        start: (n,) numbers of stretches in their directions: the first order, which can be flown.
        done: finished fraction of the work after a number of tours; the search ends at 1.
        rng: draws them.
    """
    now = best = start
    now_s = best_s = costs.total_s(now)
    tours, count = _Tours(costs, rng), 0
    while (cooled := done(count)) < 1.0:
        count += 1
        drawn = tours.drawn(now)
        # Backwards, the other ends of the links between sorties are flown twice, and the wind is reversed.
        time_s, _, order = min(
            (costs.total_s(drive), number, drive) for number, drive in enumerate((drawn, drawn[::-1] ^ 1))
        )
        if time_s < now_s * (1.0 - _HEAT * (1.0 - cooled) * math.log(max(rng.random(), 1e-12))):
            now, now_s = order, time_s
        if time_s < best_s - _LEAST_GAIN_S:
            best, best_s = order, time_s
    return best_s, best


class _Tours:
    """Draws orders: open tours through both ends of every stretch, whose two ends stay neighbours.

    Number k of a stretch in its direction is the end at which it is begun, and k ^ 1 the one at which it is left.
    """

    def __init__(self, costs: OrderCosts, rng: np.random.Generator) -> None:
        self._rng = rng
        numbers = np.arange(len(costs.link_s))
        link_s = np.empty_like(costs.link_s)
        link_s[numbers ^ 1] = costs.link_s
        self._link_s = 0.5 * (link_s + link_s.T)
        self._home_s = np.empty(len(numbers))
        self._home_s[numbers ^ 1] = costs.back_s
        self._by_home_s = 2.0 * np.minimum(self._home_s[:, None], self._home_s[None])
        self._longest_s = float(link_s.max()) + float(self._by_home_s.max())

    def drawn(self, order: IntArray) -> IntArray:
        """Another order: near this one, or random."""
        rng, free = self._rng, len(self._link_s)
        if rng.random() < _ANEW:
            order = 2 * rng.permutation(len(order))
        metric = self._metric()
        begin = np.concatenate([[free], np.column_stack([order, order ^ 1]).ravel()])
        tour = shorten(metric, nearest(metric, min(_NEAR, free)), begin, _KICKS, rng)
        at = int(np.flatnonzero(tour == free)[0])
        return np.asarray(np.roll(tour, -at)[1::2])

    def _metric(self) -> FloatArray:
        """(m + 1, m + 1) symmetric costs between ends, with errors; at the last index the tour is open."""
        rng, free = self._rng, len(self._link_s)
        error = rng.uniform(*_NOISE)
        factor = np.triu(rng.uniform(1.0 - error, 1.0 + error, (free, free)))
        metric = np.zeros((free + 1, free + 1))
        metric[:free, :free] = (self._link_s + rng.uniform(0.0, _HOME) * self._by_home_s) * (factor + factor.T)
        metric[:free, free] = metric[free, :free] = self._home_s * rng.random()
        begins = np.arange(0, free, 2)
        metric[begins, begins + 1] = metric[begins + 1, begins] = -10.0 * (2.0 * self._longest_s + 1.0)
        np.fill_diagonal(metric, 0.0)
        return metric
