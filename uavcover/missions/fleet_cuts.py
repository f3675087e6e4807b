"""Split a route into flights and allocate them to several vehicles, for the earliest last landing.

A cut with a limit on the time of a flight is the split of least total time under that limit (``kernels/way_cost.py``). Many
limits are tried; each cut's flights are shared out by branch and bound, which begins with the longest flight first (LPT, Graham
1969, doi 10.1137/0117039); the best few, and even cuts, are improved by moving, removing and adding single cuts. Among cuts that
are done equally soon the one of least total time is taken. ``tests/naive/fleet.py`` tries everything, on small cases: all of 622
random ones were found.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from uavcover.kernels.way_cost import FlightCosts, flight_s, split
from uavcover.missions.flight_costs import flights_of_split

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
_BISECTIONS = 20

Cuts = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Shared:
    """Flights shared out among vehicles."""

    makespan_s: float  # from the first take-off to the last landing
    vehicle_of: tuple[int, ...]  # number of its vehicle, from 0, for each flight


def share_out(
    durations_s: Sequence[float], vehicles: int, turnaround_s: float, *, spacing_s: float = 0.0, nodes: int = _NODES
) -> Shared:
    """Share out flights among equal vehicles, so that the last landing is as early as can be found.

    Args:
        durations_s: of the flights.
        vehicles: how many there are.
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
    for place, k in enumerate(order):
        vehicle_of[k] = search.best_of[place]
    return Shared(search.best_s - turnaround_s, tuple(vehicle_of))


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
        """Each flight to the vehicle that is free first."""
        for job, time_s in enumerate(self.jobs_s):
            vehicle = min(range(len(self.loads_s)), key=self.loads_s.__getitem__)
            self.loads_s[vehicle] += time_s
            self.best_of[job] = vehicle
        self.best_s = self.end_s(self.best_of)
        self.loads_s = list(self.ready_s)

    def end_s(self, vehicle_of: list[int]) -> float:
        """Time at which the last vehicle that flies at all is done."""
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
    """First and last waypoint of each flight, in the order of the route; none when no split exists.

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
    """Cuts with what they are worth; every flight is timed once."""

    def __init__(self, costs: FlightCosts, vehicles: int, turnaround_s: float, spacing_s: float) -> None:
        self._costs, self._vehicles, self._turnaround_s, self._spacing_s = costs, vehicles, turnaround_s, spacing_s
        self._times_s: dict[tuple[int, int], float] = {}
        self._values: dict[Cuts, tuple[float, float]] = {}

    def time_s(self, first: int, last: int) -> float:
        """Time of the flight from one waypoint to another, with its transits."""
        key = (first, last)
        if key not in self._times_s:
            self._times_s[key] = float(flight_s(self._costs, first, last))
        return self._times_s[key]

    def value(self, cuts: Cuts) -> tuple[float, float]:
        """Last landing, and the total time of the flights; infinite where a flight is not permitted."""
        if cuts not in self._values:
            times = [self.time_s(*flight) for flight in cuts]
            if all(map(math.isfinite, times)):
                shared = share_out(times, self._vehicles, self._turnaround_s, spacing_s=self._spacing_s)
                makespan_s = shared.makespan_s
                self._values[cuts] = (_rounded(makespan_s), _rounded(math.fsum(times)))
            else:
                self._values[cuts] = (math.inf, math.inf)
        return self._values[cuts]

    def bound_s(self, cuts: Cuts) -> float:
        """No sharing out is done sooner."""
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
        """``flights`` flights, or as many as possible, of about the same time on the route."""
        so_far_s, shared = self._costs.so_far_s, self._costs.shared
        n = len(so_far_s)
        targets = so_far_s[-1] * np.arange(1, flights) / flights
        lasts = np.unique(np.clip(np.searchsorted(so_far_s, targets), shared, max(n - 2, shared)))
        ends = [*(int(k) for k in lasts if k < n - 1), n - 1]
        return tuple(zip([0, *(end + 1 - shared for end in ends[:-1])], ends, strict=True))

    def best(self, cuts: Iterable[Cuts]) -> list[Cuts]:
        """The few that are worth improving."""
        return sorted(set(cuts), key=lambda c: (self.value(c), c))[:_IMPROVED]

    def is_possible(self, cuts: Cuts) -> bool:
        """Whether each of the flights may be flown."""
        return math.isfinite(self.value(cuts)[0])

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
    """So that rounding errors of sums do not choose between equal cuts."""
    return round(seconds, 6)
