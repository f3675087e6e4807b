"""What a run had at earlier moments, and the optimizers that a planner can be made of."""

import dataclasses

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.model.route import Plan, Route
from uavcover.optimizers import ALGORITHMS
from uavcover.planner.front import Snapshots
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.search.optimizer_search import _spread
from uavcover.scenario.site import Site, load_site


class Ticks:
    """A clock that goes on by a hundredth of a second whenever it is read."""

    def __init__(self) -> None:
        self.reads = 0

    def __call__(self) -> float:
        self.reads += 1
        return 0.01 * self.reads


def planned(site: Site, algorithm: str, snapshots: Snapshots | None, *, evaluations: int = 400) -> Plan:
    settings = dataclasses.replace(site.scenario.planner, algorithm=algorithm)
    effort = Effort(evaluations, None, Ticks())
    return plan_routes(site, settings=settings, select_rule="coverage>=0.9", effort=effort, snapshots=snapshots)


def test_a_moment_keeps_what_there_is_and_only_once() -> None:
    snapshots = Snapshots([2.0, 1.0])
    one, two, three = ((Route(np.full((1, 3), k)), "x") for k in (1.0, 2.0, 3.0))
    required: list[int] = []

    def found(*routes: tuple[Route, str]) -> list[tuple[Route, str]]:
        required.append(len(routes))
        return list(routes)

    snapshots.look(0.9, lambda: found(one))
    snapshots.look(1.0, lambda: found(one, two))
    snapshots.look(1.5, lambda: found(one, two, three))
    assert required == [2]
    assert snapshots.moments_s == (1.0, 2.0)
    snapshots.close([three])
    assert snapshots.taken == {1.0: (one, two), 2.0: (three,)}
    assert snapshots.last == (three,)


@pytest.mark.parametrize("algorithm", ["imodbo", "memetic"])
def test_looking_changes_nothing_and_earlier_moments_have_less(algorithm: str) -> None:
    site = make_site(hills)
    snapshots = Snapshots([0.03, 0.08, 1e6])
    observed, unobserved = planned(site, algorithm, snapshots), planned(site, algorithm, None)
    assert [m.metrics for m in observed.members] == [m.metrics for m in unobserved.members]
    early, late, end = (snapshots.taken[moment] for moment in snapshots.moments_s)
    assert end == snapshots.last
    assert early[0][1] == "boustrophedon"
    assert {name for _, name in end} >= {algorithm, "boustrophedon"}
    assert len(late) > 1
    keys = [{route.waypoints_m.tobytes() for route, _ in routes} for routes in (early, end)]
    assert keys[0] != keys[1]


@pytest.mark.parametrize("algorithm", ["nsga2", "moead"])
@pytest.mark.parametrize("scenario", ["hills", "paper-planar"])
@pytest.mark.no_cover
def test_optimizers_of_pymoo_plan_too(algorithm: str, scenario: str) -> None:
    site = make_site(hills) if scenario == "hills" else load_site(scenario)
    plan = planned(site, algorithm, None, evaluations=1500 if scenario != "hills" else 200)
    assert plan.algorithm == algorithm
    assert any(member.origin == algorithm for member in plan.members)
    assert all(member.violation == 0.0 for member in plan.members)
    coverage = [member.metrics.coverage_of_coverable for member in plan.members if member.origin == algorithm]
    assert max(coverage) > 0.5


def test_a_spread_of_powers_of_two_changes_no_proposal() -> None:
    rng = np.random.default_rng(3)
    objectives = rng.random((30, 3)) * [1.0, 60.0, 1e5]
    scale = _spread(objectives)
    assert scale.tolist() == [1.0, 64.0, 131072.0]
    assert _spread(np.ones((4, 3))).tolist() == [1.0, 1.0, 1.0]
    required = []
    for divisor in (np.ones(3), scale):
        optimizer = ALGORITHMS["imodbo"](
            np.zeros(5), np.ones(5), n_objectives=3, population_size=30, max_iterations=5, seed=1
        )
        while not optimizer.should_stop:
            x = optimizer.ask()
            values = np.column_stack([-x[:, 0], 60.0 * (x[:, 1] + x[:, 2] ** 2), 1e5 * np.abs(x[:, 3] - x[:, 0])])
            optimizer.tell(values / divisor)
        required.append(optimizer.pareto_set().x)
    assert np.array_equal(*required)
