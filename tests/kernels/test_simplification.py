"""Taking waypoints out and merging them, against the naive twin; and that what it leaves keeps what it must keep."""

import numpy as np
import pytest

from tests.compiled_kernels import cases
from tests.kernels.test_route_state import small_problem, small_state
from tests.naive import route_state as naive_state
from tests.naive import simplification as naive
from uavcover.kernels.annealing import snapshot
from uavcover.kernels.path_cost import SHORTEST
from uavcover.kernels.route_state import recount
from uavcover.kernels.route_state_cost import merge, take_out
from uavcover.kernels.search_problem import ALONG_PATH, AT_WAYPOINTS

CHANGES = {"take out": (take_out, naive.take_out), "merge": (merge, naive.merge)}


@pytest.mark.thinned
@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize(
    ("sensing", "kind"),
    [
        (AT_WAYPOINTS, "sphere"), (AT_WAYPOINTS, "cone"), (AT_WAYPOINTS, "sphere, twice"),
        (ALONG_PATH, "sphere"), (ALONG_PATH, "cone"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("price", [0.0, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_as_the_naive_twin_does(name, sensing, kind, price, seed):
    compiled, twin = CHANGES[name]
    problem = small_problem(sensing, legs=seed % 2, kind=kind)._replace(
        path_cost=SHORTEST._replace(waypoint_price=price)
    )
    count = cases(compiled=8, interpreted=4)
    state = small_state(problem, count, count, seed=seed)
    for most_lost in (1e-12, 0.02, 0.2):
        route = [tuple(point) for point in snapshot(state).tolist()]
        least = float(state.observed[0]) - 1.5 * most_lost
        gone = compiled(problem, state, 2, least, most_lost)
        expected = twin(problem, route, 2, least, most_lost)
        assert snapshot(state) == pytest.approx(np.array(expected), abs=1e-12)
        assert gone == len(route) - len(expected)
        assert state.observed[0] == pytest.approx(naive_state.counts(problem, expected)[1], abs=1e-12)
        counted = state.counts.copy()
        assert recount(problem, state)
        assert (state.counts == counted).all()


def test_no_more_than_the_fewest_go():
    problem = small_problem(AT_WAYPOINTS)
    state = small_state(problem, 6, 6)
    assert take_out(problem, state, 4, 0.0, 1.0) == 2
    assert merge(problem, state, 4, 0.0, 1.0) == 0
    assert state.size[0] == 4
