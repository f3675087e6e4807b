"""Split a route into flights and allocate them to several vehicles, for the earliest last landing.

A cut with a limit on the time of a flight is the split of least total time under that limit (``kernels/path_cost.py``). Many
limits are tried. The flights of each cut are allocated by branch and bound, starting from the longest flight first (LPT, Graham
1969, doi 10.1137/0117039). The best few cuts, and even ones, are improved by moving, removing and adding single cuts. Among cuts
with equal makespan, the one with the least total time wins. ``tests/naive/fleet.py`` tries everything, on small cases: all of 622
random ones were found.

Cuts for different vehicles start from the splits of each vehicle, and from those of an ideal vehicle with the best values of all.
Their flights are allocated longest first, each to the vehicle that finishes it earliest, and then moved and exchanged while that
helps.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from uavcover.kernels.path_cost import NO_ENERGIES, FlightCosts, flight_s, split
from uavcover.missions.objectives import flights_of_split

_LIMITS = 48
"""Limits on the time of a flight that are tried, evenly spaced in their logarithm."""
_IMPROVED = 3
"""Number of these cuts that are improved, and number of the even ones."""
_NODES = 60
"""Branches of one assignment, which is never worse than LPT."""
_MOST_BRANCHED = 200
"""Above this number of flights, LPT is the answer: they are many small ones."""
_SHIFTS = (1, 2, 4, 8, 16, 32)
_PARTS = 6
"""A flight is split again at this number of waypoints, into two or three."""
FLIGHTS_EACH = 3
"""Even splits into up to this number of flights for each vehicle are improved, too."""
_ROUNDS = 100
_EQUAL_S = 1e-6
_IMPOSSIBLE_S = 1e9
"""Time that counts for a flight that no vehicle can fly, so that fewer of them are better."""
_BISECTIONS = 20

Cuts = tuple[tuple[int, int], ...]
FlightsOfVehicles = Sequence[tuple[int, int, int]]
"""First and last waypoint of each flight, and the number of its vehicle, from 0."""


@dataclass(frozen=True, slots=True)
class Shared:
    """Flights allocated to vehicles."""

    makespan_s: float  # from the first take-off to the last landing
    vehicle_of: tuple[int, ...]  # number of its vehicle, from 0, for each flight
    total_s: float  # time of all flights


def allocate(
    durations_s: Sequence[float], vehicles: int, turnaround_s: float, *, spacing_s: float = 0.0, nodes: int = _NODES
) -> Shared:
    """Allocate flights to equal vehicles, for the earliest last landing that can be found.

    Args:
        durations_s: of the flights.
        vehicles: number of vehicles.
        turnaround_s: between two flights of one vehicle.
        spacing_s: between the first take-offs of two vehicles.
        nodes: number of branches after which the incumbent is the answer.
    """
    order = sorted(range(len(durations_s)), key=lambda k: (-durations_s[k], k))
    jobs_s = [durations_s[k] + turnaround_s for k in order]
    ready_s = [spacing_s * k for k in range(vehicles)]
    search = _Assignment(jobs_s, ready_s, nodes if len(jobs_s) <= _MOST_BRANCHED else 0)
    search.longest_first()
    if search.nodes > 0:
        search.visit(0)
    vehicle_of = [0] * len(order)
    for position, k in enumerate(order):
        vehicle_of[k] = search.best_of[position]
    return Shared(search.best_s - turnaround_s, tuple(vehicle_of), math.fsum(durations_s))


@dataclass(slots=True)
class _Assignment:
    """Depth first, longest flight first, least loaded vehicle first."""

    jobs_s: list[float]
    ready_s: list[float]
    nodes: int
    loads_s: list[float] = field(init=False)
    now_of: list[int] = field(init=False)
    best_of: list[int] = field(init=False)
    best_s: float = math.inf
    least_s: float = field(init=False)

    def __post_init__(self) -> None:
        self.loads_s = list(self.ready_s)
        self.now_of = [0] * len(self.jobs_s)
        self.best_of = list(self.now_of)
        self.least_s = max(max(self.jobs_s), evenly_s(math.fsum(self.jobs_s), self.ready_s))

    def longest_first(self) -> None:
        """Allocate each flight to the vehicle that is free first."""
        for job, time_s in enumerate(self.jobs_s):
            vehicle = min(range(len(self.loads_s)), key=self.loads_s.__getitem__)
            self.loads_s[vehicle] += time_s
            self.best_of[job] = vehicle
        self.best_s = self.end_s(self.best_of)
        self.loads_s = list(self.ready_s)

    def end_s(self, vehicle_of: list[int]) -> float:
        """Time at which the last vehicle that flies finishes."""
        ends_s = {vehicle: self.ready_s[vehicle] for vehicle in vehicle_of}
        for time_s, vehicle in zip(self.jobs_s, vehicle_of, strict=True):
            ends_s[vehicle] += time_s
        return max(ends_s.values())

    def visit(self, job: int) -> None:
        """Try all allocations of the flights from this one on, except those that cannot beat the incumbent."""
        if job == len(self.jobs_s):
            longest_s = self.end_s(self.now_of)
            if longest_s < self.best_s:
                self.best_s, self.best_of = longest_s, list(self.now_of)
            return
        tried: set[float] = set()
        for vehicle in sorted(range(len(self.loads_s)), key=self.loads_s.__getitem__):
            before_s = self.loads_s[vehicle]
            after_s = before_s + self.jobs_s[job]
            if after_s >= self.best_s - _EQUAL_S or self.best_s <= self.least_s + _EQUAL_S:
                return
            if before_s in tried:  # an equally loaded vehicle gives the same
                continue
            if self.nodes <= 0:
                return
            tried.add(before_s)
            self.nodes -= 1
            self.loads_s[vehicle], self.now_of[job] = after_s, vehicle
            self.visit(job + 1)
            self.loads_s[vehicle] = before_s


def evenly_s(work_s: float, ready_s: Sequence[float]) -> float:
    """Time at which vehicles that are ready one after the other finish this work if it could be divided at will."""
    filled_s = 0.0
    for count, begin_s in enumerate(ready_s):
        if count * begin_s - filled_s >= work_s:
            return (work_s + filled_s) / count
        filled_s += begin_s
    return (work_s + filled_s) / len(ready_s)


def fleet_cuts(costs: FlightCosts, *, vehicles: int, turnaround_s: float, spacing_s: float = 0.0) -> Cuts | None:
    """First and last waypoint of each flight, in the order of the route; None when no split exists.

    Args:
        costs: of the flights that are possible.
        vehicles: how many equal vehicles fly them.
        turnaround_s: between two flights of one vehicle.
        spacing_s: between the first take-offs of two vehicles; vehicles that take off early therefore fly longer.
    """
    search = CutSearch(costs, vehicles, turnaround_s, spacing_s)
    found = search.by_limits()
    if not found:
        return None
    even = (search.even(flights) for flights in range(1, FLIGHTS_EACH * vehicles + 1))
    starts = [*search.best(found), *search.best(cuts for cuts in even if search.is_possible(cuts))]
    improved = [search.improved(cuts) for cuts in dict.fromkeys(starts)]
    return min(improved, key=lambda cuts: (search.value(cuts), cuts))


class CutSearch:
    """Cuts with their values; every flight is timed once."""

    def __init__(self, costs: FlightCosts, vehicles: int, turnaround_s: float, spacing_s: float) -> None:
        self._costs, self._vehicles, self._turnaround_s, self._spacing_s = costs, vehicles, turnaround_s, spacing_s
        self._times_s: dict[tuple[int, int], float] = {}
        self._shared: dict[Cuts, Shared] = {}

    def time_s(self, first: int, last: int) -> float:
        """Time of the flight from one waypoint to another, with its transits."""
        key = (first, last)
        if key not in self._times_s:
            self._times_s[key] = float(flight_s(self._costs, first, last))
        return self._times_s[key]

    def shared(self, cuts: Cuts) -> Shared:
        """The allocated flights of a cut, computed once; infinite if a flight is not permitted."""
        if cuts not in self._shared:
            self._shared[cuts] = self._allocate(cuts)
        return self._shared[cuts]

    def _allocate(self, cuts: Cuts) -> Shared:
        times_s = [self.time_s(*flight) for flight in cuts]
        if not all(map(math.isfinite, times_s)):
            return Shared(math.inf, (), math.inf)
        return allocate(times_s, self._vehicles, self._turnaround_s, spacing_s=self._spacing_s)

    def value(self, cuts: Cuts) -> tuple[float, float]:
        """Last landing, and the total time of the flights."""
        shared = self.shared(cuts)
        return _rounded(shared.makespan_s), _rounded(shared.total_s)

    def bound_s(self, cuts: Cuts) -> float:
        """Lower bound on the makespan of any allocation."""
        times = [self.time_s(*flight) for flight in cuts]
        ready_s = [self._spacing_s * k for k in range(self._vehicles)]
        each_s = evenly_s(math.fsum(times) + self._turnaround_s * len(times), ready_s) - self._turnaround_s
        return _rounded(max(each_s, *times))

    def by_limits(self) -> set[Cuts]:
        """The splits of least total time under many limits on the time of a flight."""
        costs = self._costs
        n = len(costs.so_far_s)
        whole_s = float(flight_s(costs._replace(endurance_s=math.inf, item_limit=math.inf), 0, n - 1))
        high_s = min(costs.endurance_s, whole_s if math.isfinite(whole_s) else math.inf)
        found: set[Cuts] = set()
        loosest = self._split(high_s)
        if loosest is None:
            return found
        found.add(loosest)
        if not math.isfinite(high_s):
            return found
        low_s, able_s = 0.0, high_s
        for _ in range(_BISECTIONS):
            middle_s = 0.5 * (low_s + able_s)
            cuts = self._split(middle_s)
            low_s, able_s = (middle_s, able_s) if cuts is None else (low_s, middle_s)
            if cuts is not None:
                found.add(cuts)
        for k in range(_LIMITS):
            cuts = self._split(able_s * (high_s / able_s) ** (k / _LIMITS))
            if cuts is not None:
                found.add(cuts)
        return found

    def even(self, flights: int) -> Cuts:
        """``flights`` flights, or as many as possible, with similar times on the route."""
        so_far_s, shared = self._costs.so_far_s, self._costs.shared
        n = len(so_far_s)
        targets = so_far_s[-1] * np.arange(1, flights) / flights
        lasts = np.unique(np.clip(np.searchsorted(so_far_s, targets), shared, max(n - 2, shared)))
        ends = [*(int(k) for k in lasts if k < n - 1), n - 1]
        return tuple(zip([0, *(end + 1 - shared for end in ends[:-1])], ends, strict=True))

    def best(self, cuts: Iterable[Cuts]) -> list[Cuts]:
        """The few cuts that are worth improving."""
        return sorted(set(cuts), key=lambda c: (self.value(c), c))[:_IMPROVED]

    def is_possible(self, cuts: Cuts) -> bool:
        """Whether each of the flights is permitted."""
        return self.value(cuts)[0] < 0.5 * _IMPOSSIBLE_S

    def _split(self, longest_s: float) -> Cuts | None:
        total_s, begun = split(self._costs._replace(endurance_s=longest_s))
        if not math.isfinite(total_s):
            return None
        return tuple(flights_of_split(begun, self._costs.shared))

    def improved(self, cuts: Cuts) -> Cuts:
        """Better cuts by single changes, until none is better."""
        for _ in range(_ROUNDS):
            now_s = self.value(cuts)[0]
            near_by = [near for near in self._neighbours(cuts) if self.bound_s(near) <= now_s]
            better = min(near_by, key=lambda near: (self.value(near), near), default=cuts)
            if not self.value(better) < self.value(cuts):
                break
            cuts = better
        return cuts

    def _neighbours(self, cuts: Cuts) -> list[Cuts]:
        shared = self._costs.shared
        lasts = [last for _, last in cuts]
        final = lasts[-1]
        changed: list[list[int]] = []
        for k, last in enumerate(lasts[:-1]):
            changed.append(lasts[:k] + lasts[k + 1 :])
            for shift in _SHIFTS:
                changed += [[*lasts[:k], last + by, *lasts[k + 1 :]] for by in (-shift, shift)]
        for k, (first, last) in enumerate(cuts):
            within = sorted({first + round(part * (last - first) / _PARTS) for part in range(_PARTS + 1)})
            changed += [[*lasts[:k], at, *lasts[k:]] for at in within]
            changed += [[*lasts[:k], *pair, *lasts[k:]] for pair in itertools.combinations(within, 2)]
        out: list[Cuts] = []
        for ends in changed:
            starts = [0, *(end + 1 - shared for end in ends[:-1])]
            if ends[-1] == final and all(b - a >= shared for a, b in zip(starts, ends, strict=True)):
                out.append(tuple(zip(starts, ends, strict=True)))
        return out


def _rounded(seconds: float) -> float:
    """Rounded, so that rounding errors of sums do not choose between equal cuts."""
    return round(seconds, 6)


def allocate_unlike(times_s: Sequence[Sequence[float]], *, turnaround_s: float, ready_s: Sequence[float]) -> Shared:
    """Allocate flights to different vehicles.

    Args:
        times_s: for each flight, the time of each vehicle; infinite if it cannot fly it, which counts as ``_IMPOSSIBLE_S``.
        turnaround_s: between two flights of one vehicle.
        ready_s: earliest first take-off of each vehicle.
    """
    jobs_s = [[time_s + turnaround_s if math.isfinite(time_s) else _IMPOSSIBLE_S for time_s in row] for row in times_s]
    vehicles = range(len(ready_s))
    loads_s = list(ready_s)
    vehicle_of = [0] * len(jobs_s)
    for job in sorted(range(len(jobs_s)), key=lambda j: (-min(jobs_s[j]), j)):
        own = min(vehicles, key=lambda k: (loads_s[k] + jobs_s[job][k], k))
        vehicle_of[job] = own
        loads_s[own] += jobs_s[job][own]

    def value() -> tuple[float, float]:
        ends_s = [loads_s[k] for k in set(vehicle_of)]
        return max(ends_s), math.fsum(jobs_s[job][k] for job, k in enumerate(vehicle_of))

    def move(job: int, to: int) -> None:
        loads_s[vehicle_of[job]] -= jobs_s[job][vehicle_of[job]]
        loads_s[to] += jobs_s[job][to]
        vehicle_of[job] = to

    best = value()
    better = True
    while better:
        better = False
        for one in range(len(jobs_s)):
            trials: list[tuple[int, int, int | None]] = [(one, k, None) for k in vehicles if k != vehicle_of[one]]
            trials += [(one, vehicle_of[j], j) for j in range(one + 1, len(jobs_s)) if vehicle_of[j] != vehicle_of[one]]
            for job, to, other in trials:
                before = vehicle_of[job]
                if before == to or (other is not None and vehicle_of[other] != to):
                    continue
                move(job, to)
                if other is not None:
                    move(other, before)
                now = value()
                if now[0] < best[0] - _EQUAL_S or (now[0] < best[0] + _EQUAL_S and now[1] < best[1] - _EQUAL_S):
                    best, better = now, True
                    continue
                move(job, before)
                if other is not None:
                    move(other, to)
    return Shared(best[0] - turnaround_s, tuple(vehicle_of), best[1] - turnaround_s * len(jobs_s))


def unlike_cuts(
    costs: Sequence[FlightCosts], *, turnaround_s: float, ready_s: Sequence[float], one_at_a_time: bool = False
) -> FlightsOfVehicles | None:
    """The flights, in the order of the route, with their vehicles; None when no split is found.

    Args:
        costs: of the flights that are possible to each vehicle.
        turnaround_s: between two flights of one vehicle.
        ready_s: when each vehicle may take off first.
        one_at_a_time: no vehicle flies before the one before it has landed, and ``turnaround_s`` is between any two flights.
    """
    search = (
        _OneAtATime(costs, turnaround_s, ready_s) if one_at_a_time else _UnlikeCutSearch(costs, turnaround_s, ready_s)
    )
    found: set[Cuts] = set()
    for each in (*costs, _best_of(costs)):
        found |= CutSearch(each, len(costs), turnaround_s, 0.0).by_limits()
    even = {search.even(flights) for flights in range(1, FLIGHTS_EACH * len(costs) + 1)}
    starts = dict.fromkeys([*search.best(found), *search.best(even)])
    improved = [search.improved(cuts) for cuts in starts]
    best = min(improved, key=lambda cuts: (search.value(cuts), cuts))
    if not search.is_possible(best):
        return None
    return [(first, last, k) for (first, last), k in zip(best, search.shared(best).vehicle_of, strict=True)]


def _best_of(costs: Sequence[FlightCosts]) -> FlightCosts:
    """Costs of an ideal vehicle: the shortest transits and longest endurance of all, and the fastest one on the route."""
    fastest = min(costs, key=lambda each: float(each.so_far_s[-1]))
    return fastest._replace(
        there_s=np.min([each.there_s for each in costs], axis=0),
        back_s=np.min([each.back_s for each in costs], axis=0),
        alone_s=np.min([each.alone_s for each in costs], axis=0),
        there_items=np.min([each.there_items for each in costs], axis=0),
        back_items=np.min([each.back_items for each in costs], axis=0),
        endurance_s=max(each.endurance_s for each in costs),
        item_limit=max(each.item_limit for each in costs),
        barred=np.empty((0, 2), dtype=np.int64),
        energies=NO_ENERGIES,
    )


class _UnlikeCutSearch(CutSearch):
    """Cuts with their values for different vehicles."""

    def __init__(self, costs: Sequence[FlightCosts], turnaround_s: float, ready_s: Sequence[float]) -> None:
        super().__init__(costs[0], len(costs), turnaround_s, 0.0)
        self._all, self._ready_s = costs, ready_s
        self._rows: dict[tuple[int, int], list[float]] = {}

    def _allocate(self, cuts: Cuts) -> Shared:
        times_s = [self._row(*flight) for flight in cuts]
        return allocate_unlike(times_s, turnaround_s=self._turnaround_s, ready_s=self._ready_s)

    def bound_s(self, cuts: Cuts) -> float:
        """Lower bound on the makespan of any allocation."""
        least_s = [min(self._row(*flight)) for flight in cuts]
        least_s = [time_s if math.isfinite(time_s) else _IMPOSSIBLE_S for time_s in least_s]
        work_s = math.fsum(least_s) + self._turnaround_s * len(cuts)
        return _rounded(max(work_s / self._vehicles - self._turnaround_s, *least_s))

    def _row(self, first: int, last: int) -> list[float]:
        key = (first, last)
        if key not in self._rows:
            self._rows[key] = [float(flight_s(each, first, last)) for each in self._all]
        return self._rows[key]


class _OneAtATime(_UnlikeCutSearch):
    """Cuts with consecutive flights: each is allocated to the vehicle that flies it fastest."""

    def _allocate(self, cuts: Cuts) -> Shared:
        rows = [self._row(*flight) for flight in cuts]
        times_s = [min(_IMPOSSIBLE_S, *row) for row in rows]
        vehicle_of = tuple(int(np.argmin(row)) for row in rows)
        total_s = math.fsum(times_s)
        return Shared(total_s + self._turnaround_s * (len(cuts) - 1), vehicle_of, total_s)

    def bound_s(self, cuts: Cuts) -> float:
        """The makespan: only one allocation exists."""
        return self.value(cuts)[0]
