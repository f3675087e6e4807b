"""Cuts of a route for vehicles that differ, and who flies which: against everything that can be tried."""

import itertools
import math

import numpy as np
import pytest

from tests.missions.test_fleet_cuts import random_costs
from tests.naive.fleet import best_one_at_a_time, best_unlike_cuts
from uavcover.kernels.way_cost import FlightCosts, flight_s
from uavcover.missions.fleet_cuts import share_out_unlike, unlike_cuts


def landed_s(seed: int) -> tuple[float, float]:
    """When the last vehicle has landed by the cuts that are found, and by the best that there are."""
    rng = np.random.default_rng(seed)
    waypoints, shared = int(rng.integers(2, 7)), int(rng.integers(0, 2))
    costs = [random_costs(rng, waypoints, shared) for _ in range(int(rng.integers(2, 4)))]
    turnaround_s = float(rng.choice([0.0, 20.0, 100.0]))
    ready_s = [float(rng.choice([0.0, 30.0])) * k for k in range(len(costs))]
    times = [possible_s(each, waypoints) for each in costs]
    best = best_unlike_cuts(times, waypoints, shared=shared, turnaround_s=turnaround_s, ready_s=ready_s)
    flights = unlike_cuts(costs, turnaround_s=turnaround_s, ready_s=ready_s)
    if flights is None:
        return math.inf, best
    assert (flights[0][0], flights[-1][1]) == (0, waypoints - 1)
    assert all(b[0] == a[1] + 1 - shared for a, b in itertools.pairwise(flights))
    ends = []
    for vehicle, begins_s in enumerate(ready_s):
        own = [times[vehicle][first, last] for first, last, its in flights if its == vehicle]
        ends += [begins_s + sum(own) + turnaround_s * (len(own) - 1)] if own else []
    return max(ends), best


def possible_s(costs: FlightCosts, waypoints: int) -> dict[tuple[int, int], float]:
    """The flights that a vehicle can fly."""
    pairs = [(a, b) for a in range(waypoints) for b in range(a + costs.shared, waypoints)]
    return {pair: time_s for pair in pairs if math.isfinite(time_s := float(flight_s(costs, *pair)))}


def test_the_cuts_are_the_best_there_are() -> None:
    cases = [landed_s(seed) for seed in range(40)]
    finite = [(found, best) for found, best in cases if math.isfinite(best)]
    assert len(finite) > 30
    assert all(math.isfinite(found) == math.isfinite(best) for found, best in cases)
    assert all(found >= best - 1e-6 for found, best in finite)
    assert sum(found > best + 1e-6 for found, best in finite) == 0  # of 378 others one was 12 % later


def done_s(seed: int) -> tuple[float, float]:
    """When the last flight of several places has landed that follow each other: as found, and at best."""
    rng = np.random.default_rng(seed)
    waypoints, shared = int(rng.integers(2, 8)), int(rng.integers(0, 2))
    costs = [random_costs(rng, waypoints, shared) for _ in range(int(rng.integers(2, 4)))]
    turnaround_s = float(rng.choice([0.0, 20.0, 100.0]))
    times = [possible_s(each, waypoints) for each in costs]
    best = best_one_at_a_time(times, waypoints, shared=shared, turnaround_s=turnaround_s)
    flights = unlike_cuts(costs, turnaround_s=turnaround_s, ready_s=[0.0] * len(costs), one_at_a_time=True)
    if flights is None:
        return math.inf, best
    assert (flights[0][0], flights[-1][1]) == (0, waypoints - 1)
    assert all(b[0] == a[1] + 1 - shared for a, b in itertools.pairwise(flights))
    return sum(times[k][first, last] for first, last, k in flights) + turnaround_s * (len(flights) - 1), best


def test_the_cuts_of_flights_that_follow_each_other_are_the_best_there_are() -> None:
    cases = [done_s(seed) for seed in range(60)]
    finite = [(found, best) for found, best in cases if math.isfinite(best)]
    assert len(finite) > 40
    assert all(math.isfinite(found) == math.isfinite(best) for found, best in cases)
    assert [found for found, _ in finite] == pytest.approx([best for _, best in finite], abs=1e-6)


@pytest.mark.parametrize(
    ("times_s", "ready_s", "wanted"),
    [
        ([[10.0, 50.0], [50.0, 10.0]], [0.0, 0.0], (10.0, (0, 1))),  # each its own
        ([[10.0, math.inf], [10.0, math.inf]], [0.0, 0.0], (25.0, (0, 0))),  # one cannot fly any
        ([[math.inf, math.inf]], [0.0, 0.0], (math.inf, (0,))),  # nobody can
        ([[10.0, 12.0]], [9.0, 0.0], (12.0, (1,))),  # who is ready first
    ],
)
def test_flights_are_shared_out(
    times_s: list[list[float]], ready_s: list[float], wanted: tuple[float, tuple[int, ...]]
) -> None:
    shared = share_out_unlike(times_s, turnaround_s=5.0, ready_s=ready_s)
    assert (shared.makespan_s if shared.makespan_s < 1e8 else math.inf, shared.vehicle_of) == wanted


def test_two_that_reach_one_end_each() -> None:
    """Neither has a split of its own: each reaches only its half of the route."""
    rng = np.random.default_rng(1)
    base = random_costs(rng, 6, 0)._replace(endurance_s=200.0, so_far_s=np.arange(6) * 10.0, turns_s=np.zeros(6))
    near, far = np.full(6, 40.0), np.full(6, 500.0)
    west = np.concatenate([near[:3], far[3:]])
    east = west[::-1].copy()
    costs = [base._replace(there_s=ways, back_s=ways, alone_s=2.0 * ways) for ways in (west, east)]
    flights = unlike_cuts(costs, turnaround_s=10.0, ready_s=[0.0, 0.0])
    assert flights == [(0, 2, 0), (3, 5, 1)]
