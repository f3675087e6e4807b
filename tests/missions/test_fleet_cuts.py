"""Cuts of a route for several vehicles, alike or not, and who flies which: against everything that can be tried."""

import itertools
import math

import numpy as np
import pytest

from tests.naive.fleet import best_cuts, best_one_at_a_time, best_unlike_cuts, makespan
from uavcover.kernels.path_cost import FlightCosts, flight_s
from uavcover.missions.fleet_cuts import allocate, allocate_unlike, fleet_cuts, unlike_cuts


def random_costs(rng: np.random.Generator, waypoints: int, shared: int) -> FlightCosts:
    legs_s, turns_s = rng.uniform(5.0, 60.0, waypoints - 1), rng.uniform(-3.0, 0.0, waypoints)
    paths_s = rng.uniform(10.0, 80.0, waypoints)
    there_s, back_s = paths_s + rng.uniform(0.0, 3.0, waypoints), paths_s + rng.uniform(0.0, 3.0, waypoints)
    whole_s = there_s[0] + legs_s.sum() + back_s[-1]
    return FlightCosts(
        so_far_s=np.concatenate([[0.0], np.cumsum(legs_s)]),
        turns_s=np.cumsum(turns_s),
        there_s=there_s,
        back_s=back_s,
        alone_s=there_s + back_s,
        there_items=np.full(waypoints, 3),
        back_items=np.full(waypoints, 3),
        each_items=1,
        shared=shared,
        endurance_s=whole_s * rng.uniform(0.4, 1.3) if rng.random() < 0.7 else math.inf,
        item_limit=math.inf,
        barred=np.empty((0, 2), dtype=np.int64),
    )


def case(seed: int) -> tuple[FlightCosts, int, int, float, float]:
    rng = np.random.default_rng(seed)
    waypoints, shared = int(rng.integers(2, 8)), int(rng.integers(0, 2))
    vehicles, turnaround_s = int(rng.integers(2, 4)), float(rng.choice([0.0, 20.0, 100.0]))
    spacing_s = float(rng.choice([0.0, 15.0, 60.0]))
    return random_costs(rng, waypoints, shared), waypoints, vehicles, turnaround_s, spacing_s


def found_and_best(seed: int) -> tuple[tuple[float, float], tuple[float, float]]:
    costs, waypoints, vehicles, turnaround_s, spacing_s = case(seed)
    shared = costs.shared
    pairs = [(a, b) for a in range(waypoints) for b in range(a + shared, waypoints)]
    times = {pair: time_s for pair in pairs if math.isfinite(time_s := float(flight_s(costs, *pair)))}
    best = best_cuts(times, waypoints, shared=shared, vehicles=vehicles, turnaround_s=turnaround_s, spacing_s=spacing_s)
    cuts = fleet_cuts(costs, vehicles=vehicles, turnaround_s=turnaround_s, spacing_s=spacing_s)
    if cuts is None:
        return (math.inf, math.inf), best
    assert (cuts[0][0], cuts[-1][1]) == (0, waypoints - 1)
    assert all(b[0] == a[1] + 1 - shared for a, b in itertools.pairwise(cuts))
    flights = [times[cut] for cut in cuts]
    return (makespan(flights, vehicles, turnaround_s, spacing_s), sum(flights)), best


def test_of_all_cuts_the_one_that_is_done_soonest_is_found() -> None:
    cases = [found_and_best(seed) for seed in range(120)]
    assert sum(math.isfinite(best[0]) for _, best in cases) > 80
    for found, best in cases:
        assert found == pytest.approx(best, abs=1e-5)


@pytest.mark.parametrize("vehicles", [2, 3])
def test_flights_are_shared_out_as_well_as_can_be(vehicles: int) -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        durations = rng.uniform(10.0, 100.0, int(rng.integers(1, 8))).tolist()
        turnaround_s, spacing_s = float(rng.choice([0.0, 30.0])), float(rng.choice([0.0, 25.0]))
        shared = allocate(durations, vehicles, turnaround_s, spacing_s=spacing_s, nodes=20_000)
        ends = []
        for vehicle in set(shared.vehicle_of):
            own = [d + turnaround_s for d, its in zip(durations, shared.vehicle_of, strict=True) if its == vehicle]
            ends.append(vehicle * spacing_s + sum(own) - turnaround_s)
        assert max(ends) == pytest.approx(shared.makespan_s)
        best_s = makespan(durations, vehicles, turnaround_s, spacing_s)
        assert shared.makespan_s == pytest.approx(best_s)


def test_hundreds_of_flights_are_shared_out_evenly() -> None:
    durations = np.random.default_rng(1).uniform(10.0, 20.0, 1500).tolist()
    assert allocate(durations, 4, 0.0).makespan_s == pytest.approx(sum(durations) / 4.0, rel=0.01)


def test_no_cut_is_no_answer() -> None:
    costs = random_costs(np.random.default_rng(0), 5, 1)._replace(endurance_s=1.0)
    assert fleet_cuts(costs, vehicles=3, turnaround_s=10.0) is None


def test_vehicles_that_would_make_it_longer_stay_at_home() -> None:
    far = random_costs(np.random.default_rng(0), 3, 1)
    far = far._replace(there_s=far.there_s + 1e4, back_s=far.back_s + 1e4, endurance_s=math.inf)
    cuts = fleet_cuts(far, vehicles=2, turnaround_s=0.0)
    # A second vehicle flies the ways at the same time, so two flights are done a little sooner; never three.
    assert cuts is not None
    assert len(cuts) <= 2


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
        ([[math.inf, math.inf]], [0.0, 0.0], (math.inf, (0,))),  # no vehicle can
        ([[10.0, 12.0]], [9.0, 0.0], (12.0, (1,))),  # who is ready first
    ],
)
def test_flights_are_shared_out(
    times_s: list[list[float]], ready_s: list[float], wanted: tuple[float, tuple[int, ...]]
) -> None:
    shared = allocate_unlike(times_s, turnaround_s=5.0, ready_s=ready_s)
    assert (shared.makespan_s if shared.makespan_s < 1e8 else math.inf, shared.vehicle_of) == wanted


def test_two_that_reach_one_end_each() -> None:
    """Neither has a split of its own: each reaches only its half of the route."""
    rng = np.random.default_rng(1)
    base = random_costs(rng, 6, 0)._replace(endurance_s=200.0, so_far_s=np.arange(6) * 10.0, turns_s=np.zeros(6))
    near, far = np.full(6, 40.0), np.full(6, 500.0)
    west = np.concatenate([near[:3], far[3:]])
    east = west[::-1].copy()
    costs = [base._replace(there_s=paths, back_s=paths, alone_s=2.0 * paths) for paths in (west, east)]
    flights = unlike_cuts(costs, turnaround_s=10.0, ready_s=[0.0, 0.0])
    assert flights == [(0, 2, 0), (3, 5, 1)]
