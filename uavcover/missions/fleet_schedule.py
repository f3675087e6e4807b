"""Schedule the sorties of a fleet so that all stay apart and the last landing is early."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.separation import UnsafeStarts, late_s, safe_start_s
from uavcover.missions.timeline import Timeline
from uavcover.model.vehicle import Fleet

_TRIES = 1500
"""Number of orders of the sorties that are tried."""
_LEAST_GAIN_S = 0.1


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a sortie."""

    vehicle: int  # who flies it, from 0
    start_s: float  # take-off, since the first take-off of all


def schedule(
    timelines: Sequence[Timeline],  # of the sorties
    fleet: Fleet,  # what keeps the vehicles apart
    *,
    # who flies each, from 0; none: any vehicle, as all are alike, numbered by their first take-offs
    vehicle_of: Sequence[int] | None = None,
    unsafe: UnsafeStarts | None = None,  # starts of pairs of these flights, where some are known from before
) -> tuple[Start, ...]:
    """Find starts for sorties that keep the vehicles apart.

    A sortie begins when its vehicle is ready, even if it landed late, and when the start is safe beside all sorties that have a
    start already. Orders of the sorties are tried by exchanging two.
    """
    search = _OrderSearch(timelines, fleet, vehicle_of, unsafe or UnsafeStarts(fleet))
    by_length = sorted(range(len(timelines)), key=lambda k: (-timelines[k].duration_s, k))
    best = min((list(range(len(timelines))), by_length), key=lambda order: search.value(order))
    best = search.improved(best)
    starts, _ = search.starts(best)
    if vehicle_of is not None:
        return tuple(starts)
    by_start = sorted(starts, key=lambda start: start.start_s)
    numbered = {old: new for new, old in enumerate(dict.fromkeys(start.vehicle for start in by_start))}
    return tuple(Start(numbered[s.vehicle], s.start_s) for s in starts)


class _OrderSearch:
    """Lists of sorties, each of which gives a schedule: one after the other gets the earliest start that is left."""

    def __init__(
        self, timelines: Sequence[Timeline], fleet: Fleet, vehicle_of: Sequence[int] | None, unsafe: UnsafeStarts
    ) -> None:
        self._fleet, self._vehicle_of = fleet, vehicle_of
        self.durations_s = [t.duration_s for t in timelines]
        late = late_s(np.array(self.durations_s), fleet)
        self._busy_s = (np.array(self.durations_s) + late + fleet.turnaround_s).tolist()
        self._unsafe: dict[tuple[int, int], FloatArray] = {
            (a, b): unsafe.between(timelines[a], timelines[b])
            for a, b in itertools.permutations(range(len(timelines)), 2)
        }

    def starts(self, order: Sequence[int]) -> tuple[list[Start], float]:
        """The starts in the order of the route, and when the last sortie lands."""
        ready_s = [0.0] * self._fleet.vehicles
        placed: dict[int, Start] = {}
        for sortie in order:
            may_s = ready_s if self._vehicle_of is None else [ready_s[self._vehicle_of[sortie]]]
            begins = {free_s: self._safe_s(sortie, free_s, placed) for free_s in sorted(set(may_s))}
            free_s = min(begins, key=lambda s: (begins[s], -s))
            vehicle = ready_s.index(free_s) if self._vehicle_of is None else self._vehicle_of[sortie]
            placed[sortie] = Start(vehicle, begins[free_s])
            ready_s[vehicle] = begins[free_s] + self._busy_s[sortie]
        first_s = min(start.start_s for start in placed.values())
        starts = [Start(placed[k].vehicle, placed[k].start_s - first_s) for k in range(len(order))]
        return starts, max(s.start_s + d for s, d in zip(starts, self.durations_s, strict=True))

    def _safe_s(self, sortie: int, wanted_s: float, placed: dict[int, Start]) -> float:
        at_s = wanted_s
        while True:
            before_s = at_s
            for other, start in placed.items():
                at_s = start.start_s + safe_start_s(self._unsafe[other, sortie], at_s - start.start_s)
            if at_s == before_s:
                return at_s

    def value(self, order: Sequence[int]) -> tuple[float, float]:
        """Landing time of the last sortie; then the sum of all starts."""
        starts, makespan_s = self.starts(order)
        return makespan_s, math.fsum(s.start_s for s in starts)

    def improved(self, order: list[int]) -> list[int]:
        """A better order, by exchanging two sorties until no exchange helps or enough was tried."""
        best, tries = self.value(order), 0
        better = True
        while better:
            better = False
            for i in range(len(order)):
                for j in range(i + 1, len(order)):
                    if tries >= _TRIES:
                        return order
                    tries += 1
                    other = list(order)
                    other[i], other[j] = other[j], other[i]
                    value = self.value(other)
                    if value[0] < best[0] - _LEAST_GAIN_S:
                        order, best, better = other, value, True
        return order
