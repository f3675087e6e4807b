"""Split a route into flights of vehicles that differ, and allocate them, for the earliest last landing.

Cuts begin with the splits that each vehicle would have by itself, and with those of a vehicle that has the best of all of them;
they are improved as those of equal vehicles are (``routes/fleet_cuts.py``). Each cut's flights are shared out longest first, to
whom they end earliest, and then moved and exchanged while that helps. ``tests/naive/fleet.py`` tries everything, on small cases.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.way_cost import NO_ENERGIES, FlightCosts, flight_s
from uavcover.missions.fleet_cuts import FLIGHTS_EACH, Cuts, CutSearch

FlightsOfVehicles = Sequence[tuple[int, int, int]]
"""First and last waypoint of each flight, and the number of its vehicle, from 0."""

_IMPOSSIBLE_S = 1e9
"""Time that counts for a flight that no vehicle can fly, so that fewer of them are better."""
_LEAST_GAIN_S = 1e-6


@dataclass(frozen=True, slots=True)
class _Shared:
    """Flights shared out: when the last lands, the time of all flights, and whose each is."""

    makespan_s: float
    total_s: float
    vehicle_of: tuple[int, ...]


def share_out_unlike(
    times_s: Sequence[Sequence[float]], *, turnaround_s: float, ready_s: Sequence[float]
) -> tuple[float, tuple[int, ...]]:
    """Share out flights among vehicles that differ.

    Args:
        times_s: for each flight, how long each vehicle takes; infinite where it cannot fly it.
        turnaround_s: between two flights of one vehicle.
        ready_s: when each vehicle may take off first.

    Returns:
        When the last one has landed, and the number of each flight's vehicle, from 0.
    """
    shared = _shared_out(times_s, turnaround_s, ready_s)
    return (shared.makespan_s if shared.makespan_s < 0.5 * _IMPOSSIBLE_S else math.inf), shared.vehicle_of


def _shared_out(times_s: Sequence[Sequence[float]], turnaround_s: float, ready_s: Sequence[float]) -> _Shared:
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
                if now[0] < best[0] - _LEAST_GAIN_S or (
                    now[0] < best[0] + _LEAST_GAIN_S and now[1] < best[1] - _LEAST_GAIN_S
                ):
                    best, better = now, True
                    continue
                move(job, before)
                if other is not None:
                    move(other, to)
    flown_s = best[1] - turnaround_s * len(jobs_s)
    return _Shared(best[0] - turnaround_s, flown_s, tuple(vehicle_of))


def unlike_cuts(
    costs: Sequence[FlightCosts], *, turnaround_s: float, ready_s: Sequence[float], one_at_a_time: bool = False
) -> FlightsOfVehicles | None:
    """The flights, in the order of the route, with their vehicles; none when no split is found.

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
    """Cuts with what they are worth to vehicles that differ."""

    def __init__(self, costs: Sequence[FlightCosts], turnaround_s: float, ready_s: Sequence[float]) -> None:
        super().__init__(costs[0], len(costs), turnaround_s, 0.0)
        self._all, self._ready_s = costs, ready_s
        self._rows: dict[tuple[int, int], list[float]] = {}
        self._shared: dict[Cuts, _Shared] = {}

    def shared(self, cuts: Cuts) -> _Shared:
        """The flights of a cut, shared out."""
        if cuts not in self._shared:
            times_s = [self._row(*flight) for flight in cuts]
            self._shared[cuts] = _shared_out(times_s, self._turnaround_s, self._ready_s)
        return self._shared[cuts]

    def value(self, cuts: Cuts) -> tuple[float, float]:
        """Last landing, and the total time of the flights; very late where one cannot be flown."""
        shared = self.shared(cuts)
        return round(shared.makespan_s, 6), round(shared.total_s, 6)

    def bound_s(self, cuts: Cuts) -> float:
        """No sharing out is done sooner."""
        least_s = [min(self._row(*flight)) for flight in cuts]
        least_s = [time_s if math.isfinite(time_s) else _IMPOSSIBLE_S for time_s in least_s]
        work_s = math.fsum(least_s) + self._turnaround_s * len(cuts)
        return round(max(work_s / self._vehicles - self._turnaround_s, *least_s), 6)

    def is_possible(self, cuts: Cuts) -> bool:
        """Whether a vehicle can fly each of the flights."""
        return self.value(cuts)[0] < 0.5 * _IMPOSSIBLE_S

    def _row(self, first: int, last: int) -> list[float]:
        key = (first, last)
        if key not in self._rows:
            self._rows[key] = [float(flight_s(each, first, last)) for each in self._all]
        return self._rows[key]


class _OneAtATime(_UnlikeCutSearch):
    """Cuts whose flights follow each other: each is that of the vehicle that takes least for it."""

    def shared(self, cuts: Cuts) -> _Shared:
        """The flights of a cut, each with its quickest vehicle."""
        rows = [self._row(*flight) for flight in cuts]
        times_s = [min(_IMPOSSIBLE_S, *row) for row in rows]
        vehicle_of = tuple(int(np.argmin(row)) for row in rows)
        total_s = math.fsum(times_s)
        return _Shared(total_s + self._turnaround_s * (len(cuts) - 1), total_s, vehicle_of)

    def bound_s(self, cuts: Cuts) -> float:
        """There is one way to share them out."""
        return self.value(cuts)[0]
