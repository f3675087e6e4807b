"""The split of least time, against every split; and the costs of its flights against their parts."""

import itertools
import math

import numpy as np
import pytest

from tests.compiled_kernels import cases
from uavcover.kernels.flight_time import Pace, flight_time, landing_time, takeoff_time
from uavcover.kernels.path_cost import (
    NO_ENERGIES,
    TIME,
    FlightCosts,
    FlightEnergies,
    PathCost,
    flight_s,
    split,
    straight_ends,
)

PACE = Pace(10.0, 4.0, 3.0, acceleration_m_s2=2.5, vertical_acceleration_m_s2=1.0, jerk_m_s3=4.0)
HOME = PathCost(TIME, PACE, 0.0, 0.0, mission=1, climb_out_top=(10.0, -20.0, 45.0), climb_out_m=30.0)


def random_costs(rng, n, shared):
    legs = rng.uniform(5.0, 60.0, n - 1)
    turns = -rng.uniform(0.0, 4.0, n)
    turns[[0, -1]] = 0.0
    there, back = rng.uniform(20.0, 90.0, (2, n))
    there[rng.random(n) < 0.1] = math.inf
    back[rng.random(n) < 0.1] = math.inf
    barred = np.sort(rng.integers(0, n, (3, 2)), axis=1)
    return FlightCosts(
        so_far_s=np.concatenate([[0.0], np.cumsum(legs)]), turns_s=np.cumsum(turns), there_s=there, back_s=back,
        alone_s=there + back - 1.0, there_items=rng.integers(2, 5, n), back_items=rng.integers(1, 4, n), each_items=2,
        shared=shared, endurance_s=float(rng.uniform(150.0, 400.0)), item_limit=float(rng.integers(12, 30)),
        barred=barred, energies=random_energies(rng, n) if rng.random() < 0.5 else NO_ENERGIES,
    )  # fmt: skip


def random_energies(rng, n, winds=2):
    turns = -rng.uniform(0.0, 4.0, (winds, n))
    turns[:, [0, -1]] = 0.0
    there, back = rng.uniform(20.0, 90.0, (2, winds, n))
    return FlightEnergies(
        so_far_s=np.hstack([np.zeros((winds, 1)), np.cumsum(rng.uniform(5.0, 60.0, (winds, n - 1)), axis=1)]),
        turns_s=np.cumsum(turns, axis=1), there_s=there, back_s=back, alone_s=there + back - 1.0,
        usable_s=float(rng.uniform(150.0, 400.0)),
    )  # fmt: skip


def one_flight_s(costs, first, last):
    turns = sum(np.diff(costs.turns_s, prepend=0.0)[first + 1 : last])
    seconds = costs.there_s[first] + costs.so_far_s[last] - costs.so_far_s[first] + turns + costs.back_s[last]
    if first == last and math.isfinite(seconds):
        seconds = costs.alone_s[last]
    items = costs.there_items[first] + costs.each_items * (last - first + 1) + costs.back_items[last]
    if any(used_s > costs.energies.usable_s for used_s in one_flight_uses_s(costs.energies, first, last)):
        return math.inf
    if [first, last] in costs.barred.tolist() or seconds > costs.endurance_s or items > costs.item_limit:
        return math.inf
    return seconds


def one_flight_uses_s(energies, first, last):
    for so_far, turns, there, back, alone in zip(*energies[:5], strict=True):
        turning = sum(np.diff(turns, prepend=0.0)[first + 1 : last])
        yield alone[last] if first == last else there[first] + so_far[last] - so_far[first] + turning + back[last]


@pytest.mark.parametrize("shared", [0, 1])
def test_no_split_takes_less_time(shared):
    rng = np.random.default_rng(11 + shared)
    possible = 0
    for _ in range(cases(compiled=120, interpreted=20)):
        n = int(rng.integers(2, 8))
        costs = random_costs(rng, n, shared)
        best = math.inf
        inner = range(1, n - 1) if shared else range(1, n)
        for cuts in itertools.chain.from_iterable(itertools.combinations(inner, k) for k in range(len(inner) + 1)):
            bounds = [0, *cuts, n - shared]
            flights = [one_flight_s(costs, a, b - 1 + shared) for a, b in itertools.pairwise(bounds)]
            best = min(best, sum(flights))
        found, begun = split(costs)
        assert found == pytest.approx(best)
        if math.isfinite(best):
            possible += 1
            total, end = 0.0, n - shared
            while end > 0:
                last = end - 1 + shared
                total += flight_s(costs, int(begun[last]), last)
                end = int(begun[last])
            assert total == pytest.approx(found)
    assert possible > 5


@pytest.mark.parametrize("shared", [0, 1])
def test_the_split_of_a_long_route_against_all_its_flights(shared):
    rng = np.random.default_rng(21 + shared)
    possible = 0
    for _ in range(cases(compiled=40, interpreted=12)):
        n = 40
        costs = random_costs(rng, n, shared)
        least_s = [0.0]
        for last in range(shared, n):
            flights = [least_s[first] + one_flight_s(costs, first, last) for first in range(last - shared + 1)]
            least_s.append(min(flights))
        found, _ = split(costs)
        assert found == pytest.approx(least_s[-1])
        possible += math.isfinite(found)
    assert possible > 1


@pytest.mark.parametrize("stops", [0, 1])
def test_ends_and_route_add_up_to_the_flight(stops):
    rng = np.random.default_rng(5)
    path = HOME._replace(stop_at_first=stops)
    for _ in range(cases(compiled=50, interpreted=10)):
        route = rng.uniform([-300.0, -300.0, 40.0], [300.0, 300.0, 160.0], (int(rng.integers(1, 6)), 3))
        there, back, alone = straight_ends(path, route)
        whole = np.vstack([[path.climb_out_top], route[:1], route[:stops], route[1:], [path.climb_out_top]])
        ends = takeoff_time(PACE, path.climb_out_m) + landing_time(PACE, path.climb_out_m)
        expected = ends + flight_time(PACE, whole)
        if len(route) == 1:
            assert alone[0] == pytest.approx(expected)
        else:
            assert there[0] + flight_time(PACE, route) + back[-1] == pytest.approx(expected)
