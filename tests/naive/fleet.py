"""Slow twins of the fleet's cuts and of its separation: everything is tried, and every moment is looked at."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

Times = dict[tuple[int, int], float]


def makespan(durations_s: Sequence[float], vehicles: int, turnaround_s: float, spacing_s: float = 0.0) -> float:
    """Earliest last landing of all ways to share out the flights; each vehicle begins so long after the one before."""
    best = math.inf
    for who in itertools.product(range(vehicles), repeat=len(durations_s)):
        ends = []
        for vehicle in range(vehicles):
            own = [time for time, its in zip(durations_s, who, strict=True) if its == vehicle]
            ends.append(vehicle * spacing_s + sum(own) + turnaround_s * (len(own) - 1) if own else 0.0)
        best = min(best, max(ends))
    return best


def best_cuts(
    times_s: Times, waypoints: int, *, shared: int, vehicles: int, turnaround_s: float, spacing_s: float = 0.0
) -> tuple[float, float]:
    """Earliest last landing of all cuts of a route, and the least total time of those; infinite when there is none.

    Args:
        times_s: of a flight by its first and last waypoint; a flight that is not there may not be flown.
        waypoints: how many there are.
        shared: 1 when a flight begins where the one before it ended.
        vehicles: how many fly.
        turnaround_s: between two flights of one vehicle.
        spacing_s: between the first take-offs of two vehicles.
    """
    best = (math.inf, math.inf)
    between = range(1, waypoints - 1) if shared else range(waypoints - 1)
    for count in range(len(between) + 1):
        for ends in itertools.combinations(between, count):
            lasts = [*ends, waypoints - 1]
            firsts = [0, *(end + 1 - shared for end in ends)]
            flights = [times_s.get(pair, math.inf) for pair in zip(firsts, lasts, strict=True)]
            if math.isinf(sum(flights)) or max(flights) >= best[0] + 1e-6:
                continue
            best = min(best, (round(makespan(flights, vehicles, turnaround_s, spacing_s), 6), round(sum(flights), 6)))
    return best


def best_unlike_cuts(
    times_s: Sequence[Times], waypoints: int, *, shared: int, turnaround_s: float, ready_s: Sequence[float]
) -> float:
    """Earliest last landing of all cuts of a route and of all ways to share them out among vehicles that differ.

    Args:
        times_s: for each vehicle, as of :func:`best_cuts`.
        waypoints: how many there are.
        shared: 1 when a flight begins where the one before it ended.
        turnaround_s: between two flights of one vehicle.
        ready_s: when each vehicle may take off first.
    """
    best = math.inf
    between = range(1, waypoints - 1) if shared else range(waypoints - 1)
    for ends in itertools.chain.from_iterable(itertools.combinations(between, k) for k in range(len(between) + 1)):
        flights = list(zip([0, *(end + 1 - shared for end in ends)], [*ends, waypoints - 1], strict=True))
        for who in itertools.product(range(len(times_s)), repeat=len(flights)):
            landed = []
            for vehicle, begins_s in enumerate(ready_s):
                own = [
                    times_s[vehicle].get(pair, math.inf)
                    for pair, its in zip(flights, who, strict=True)
                    if its == vehicle
                ]
                if own:
                    landed.append(begins_s + sum(own) + turnaround_s * (len(own) - 1))
            best = min(best, max(landed))
    return best


def best_one_at_a_time(times_s: Sequence[Times], waypoints: int, *, shared: int, turnaround_s: float) -> float:
    """Earliest last landing of all cuts of a route whose flights follow each other, each by the vehicle that is quickest with it.

    Args:
        times_s: for each vehicle, as of :func:`best_cuts`.
        waypoints: how many there are.
        shared: 1 when a flight begins where the one before it ended.
        turnaround_s: between two flights.
    """
    best = math.inf
    between = range(1, waypoints - 1) if shared else range(waypoints - 1)
    for ends in itertools.chain.from_iterable(itertools.combinations(between, k) for k in range(len(between) + 1)):
        flights = list(zip([0, *(end + 1 - shared for end in ends)], [*ends, waypoints - 1], strict=True))
        quickest = [min(times.get(pair, math.inf) for times in times_s) for pair in flights]
        best = min(best, sum(quickest) + turnaround_s * (len(flights) - 1))
    return best


def least_distance(
    a_s: np.ndarray, a_m: np.ndarray, b_s: np.ndarray, b_m: np.ndarray, start_s: float, *, fraction: float, start_error_s: float,
    step_s: float,
) -> float:  # fmt: skip
    """Least distance of two vehicles at any moment at which both may be where their plans have them.

    Args:
        a_s: (n,) seconds since take-off of the first at the points of its path.
        a_m: (n, 3) its path.
        b_s: (m,) of the second, which begins ``start_s`` later.
        b_m: (m, 3) its path.
        start_s: see there.
        fraction: share of the time by which each may be early or late.
        start_error_s: likewise at the start.
        step_s: how densely both are looked at.
    """
    positions = []
    for times, path in ((a_s, a_m), (b_s, b_m)):
        moments = np.append(np.arange(times[0], times[-1], step_s), times[-1])
        positions.append((moments, np.column_stack([np.interp(moments, times, path[:, k]) for k in range(3)])))
    (ta, pa), (tb, pb) = positions
    least = math.inf
    for when, position in zip(ta, pa, strict=True):
        late = fraction * max(when, 0.0) + start_error_s
        own_late = fraction * np.maximum(tb, 0.0) + start_error_s
        meets = (start_s + tb - own_late <= when + late) & (start_s + tb + own_late >= when - late)
        if meets.any():
            least = min(least, float(np.sqrt(((pb[meets] - position) ** 2).sum(axis=1)).min()))
    return least
