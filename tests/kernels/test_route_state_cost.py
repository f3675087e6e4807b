"""What a change costs is the cost of the whole route after it less that before."""

import numpy as np
import pytest

from tests.compiled_kernels import cases
from tests.kernels.test_path_cost import POWER
from tests.kernels.test_route_state import small_problem, small_state
from uavcover.kernels.annealing import Schedule, Weights, anneal, energy_of_coverage, snapshot
from uavcover.kernels.arrays import read_only
from uavcover.kernels.flight_time import Pace
from uavcover.kernels.path_cost import ENERGY, LENGTH, SHORTEST, TIME, Detours, PathCost, route_cost
from uavcover.kernels.route_state_cost import exchange_cost, reversal_cost, transfer_cost
from uavcover.kernels.search_problem import ALONG_PATH, AT_WAYPOINTS
from uavcover.planner.search.tuning import TUNED

PACE = Pace(2.0, 0.7, 0.5, airspeed_m_s=2.5, wind_east_m_s=1.0, wind_north_m_s=-1.5, acceleration_m_s2=0.8)
PATHS = {
    "length": SHORTEST,
    "time": PathCost(TIME, PACE, 0.0, 0.0),
    "length and deviation": PathCost(LENGTH, PACE, 0.7, 1.3),
    "time and deviation": PathCost(TIME, PACE, 0.7, 1.3),
    "mission": PathCost(TIME, PACE, 0.0, 0.0, mission=1, climb_out_top=(0.5, 1.0, 2.0), climb_out_m=0.5),
    "length and waypoints": SHORTEST._replace(waypoint_price=0.3),
    "mission and waypoints": PathCost(TIME, PACE, 0.7, 1.3, 1, (0.5, 1.0, 2.0), 0.5, 0, waypoint_price=0.3),
    "mission with a stop": PathCost(TIME, PACE, 0.7, 1.3, 1, (0.5, 1.0, 2.0), 0.5, 1),
    "energy of a mission": PathCost(ENERGY, PACE, 0.7, 1.3, 1, (0.5, 1.0, 2.0), 0.5, power=POWER),
}
PATHS["mission with detours"] = PATHS["mission and waypoints"]._replace(
    detours=Detours(read_only(np.arange(24.0).reshape(2, 3, 4) ** 1.5), high_agl_m=2.0)
)
paths = pytest.mark.parametrize("path_cost", PATHS.values(), ids=PATHS.keys())


@paths
def test_each_kind_of_change(path_cost):
    problem = small_problem(AT_WAYPOINTS)._replace(path_cost=path_cost)
    state = small_state(problem, 7, 12)
    rng = np.random.default_rng(3)
    route = state.route[:7].copy()
    before = route_cost(problem.surface, path_cost, route)
    for _ in range(cases(compiled=300, interpreted=20)):
        first = int(rng.integers(0, 7))
        last = int(rng.integers(first, min(7, first + 4) + 1))
        fresh = int(rng.integers(0, 4))
        state.fresh[:fresh] = rng.uniform([-0.5, 2.3, 1.2], [3.0, 5.0, 1.6], (fresh, 3))
        after = np.vstack([route[:first], state.fresh[:fresh], route[last:]])
        if len(after) > 0:
            expected = route_cost(problem.surface, path_cost, after) - before
            assert exchange_cost(problem, state, first, last, fresh) == pytest.approx(expected, abs=1e-9)
        i, j = sorted(rng.integers(0, 7, 2).tolist())
        turned = np.vstack([route[:i], route[i : j + 1][::-1], route[j + 1 :]])
        expected = route_cost(problem.surface, path_cost, turned) - before
        assert reversal_cost(problem, state, i, j) == pytest.approx(expected, abs=1e-9)
        at = int(rng.integers(0, 7))
        to = int(rng.choice([k for k in range(8) if k not in (at, at + 1)]))
        state.fresh[0] = rng.uniform([-0.5, 2.3, 1.2], [3.0, 5.0, 1.6])
        moved = np.insert(route, to, state.fresh[0], axis=0)
        moved = np.delete(moved, at if to > at else at + 1, axis=0)
        expected = route_cost(problem.surface, path_cost, moved) - before
        assert transfer_cost(problem, state, at, to) == pytest.approx(expected, abs=1e-9)


@paths
@pytest.mark.parametrize("sensing", [AT_WAYPOINTS, ALONG_PATH])
def test_cold_annealing_never_makes_the_energy_larger(sensing, path_cost):
    problem = small_problem(sensing)._replace(path_cost=path_cost)
    state = small_state(problem, 6, 14)
    weights, rng = Weights(0.01, 0.05, 3.0, 0.9), np.random.default_rng(2)
    energies = []
    for _ in range(cases(compiled=30, interpreted=2)):
        anneal(problem, weights, Schedule(100, 1e-12, 1e-12, 1.0, 2, 14, TUNED.moves), state, rng)
        points = snapshot(state)
        energies.append(
            0.01 * route_cost(problem.surface, path_cost, points)
            + 0.05 * len(points)
            + energy_of_coverage(weights, float(state.observed[0]))
        )
    assert (np.diff(energies) <= 1e-9).all()
    assert energies[-1] < 0.95 * energies[0]
