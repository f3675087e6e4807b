"""Rebuilding a tour around a waypoint: the place between two neighbours against its naive twin, and the state that is left."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.naive import rebuild as naive
from tests.planner.test_tour_with_neighbourhoods import RADIUS_M, row_of_cells
from uavcover.kernels.annealing import snapshot
from uavcover.kernels.rebuild import best_between, radius_at, rebuild
from uavcover.kernels.route_state import recount
from uavcover.kernels.sight import CONE, DISC, NO_LINE_OF_SIGHT, SPHERE, Sight
from uavcover.model.route import Route
from uavcover.planner.search.route_problem import RouteProblem, route_problem, state_of
from uavcover.sensing.coverage_map import CoverageMap

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=80, interpreted=10))


@deterministic
@given(seed=st.integers(0, 10**6), count=st.integers(1, 6))
def test_no_place_in_all_discs_is_on_a_shorter_way(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    ends, inside = rng.uniform(-3.0, 3.0, (2, 2)), rng.uniform(-1.0, 1.0, 2)
    centres = inside + rng.uniform(-0.65, 0.65, (count, 2))
    discs = np.column_stack([centres, np.ones(count)])
    a, b = (tuple(end.tolist()) for end in ends)
    position = np.array(best_between(a, b, tuple(inside.tolist()), discs, count))
    assert (np.hypot(*(position - centres).T) <= 1.0 + 1e-9).all()
    long = math.dist(a, position) + math.dist(position, b)
    best = naive.best_between(a, b, discs.tolist())
    assert best - 1e-3 <= long <= best + 1e-6


def test_the_straight_line_is_kept_where_all_discs_hold_it() -> None:
    discs = np.array([[0.0, 0.2, 1.0]])
    assert best_between((-2.0, 0.0), (2.0, 0.0), (0.3, 0.9), discs, 1) == pytest.approx((0.3, 0.0))
    assert best_between((-2.0, 2.0), (2.0, 2.0), (0.0, 0.0), discs, 1) == pytest.approx((0.0, 1.2))


def test_a_sensor_sees_level_ground_within_its_radius() -> None:
    assert radius_at(Sight(SPHERE, 5.0, 0.0, -1.0, NO_LINE_OF_SIGHT), 3.0) == pytest.approx(4.0)
    assert radius_at(Sight(SPHERE, 5.0, 0.0, -1.0, NO_LINE_OF_SIGHT), 6.0) == 0.0
    assert radius_at(Sight(DISC, 5.0, 0.0, -1.0, NO_LINE_OF_SIGHT), 3.0) == 5.0
    assert radius_at(Sight(CONE, 5.0, 0.5, -1.0, NO_LINE_OF_SIGHT), 3.0) == pytest.approx(1.5)


def energy(problem: RouteProblem, state) -> float:
    return problem.cost(Route(snapshot(state))) + 1e4 * max(0.0, 1.0 - float(state.observed[0]))


def test_what_is_kept_costs_no_more_than_allowed_and_the_rest_is_undone() -> None:
    problem = route_problem(CoverageMap(row_of_cells(), cell_size_m=20.0), margin_m=0.0, reach_m=RADIUS_M)
    rng = np.random.default_rng(4)
    positions = np.column_stack([np.arange(20.0, 400.0, 40.0), rng.uniform(0.0, 40.0, 10), np.full(10, 50.0)])
    state = state_of(problem, Route(rng.permutation(positions)), capacity=20)
    kept = 0
    for allowance in rng.exponential(20.0, cases(compiled=300, interpreted=6)) - 10.0:
        before, route = energy(problem, state), snapshot(state)
        done = rebuild(problem.numbers, (1.0, 0.0, 1e4, 1.0), state, float(allowance), 2, 20, rng)
        after, counts, observed = energy(problem, state), state.counts.copy(), float(state.observed[0])
        assert recount(problem.numbers, state)
        assert (state.counts == counts).all()
        assert float(state.observed[0]) == pytest.approx(observed, abs=1e-9)
        if done:
            assert after <= before + allowance + 1e-6
        else:
            assert (snapshot(state) == route).all()
        kept += done
    assert kept > 0
    assert float(state.observed[0]) == pytest.approx(1.0)
