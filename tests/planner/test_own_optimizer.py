"""Routes planned by an optimizer that is not ours."""

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.errors import InputError, OptimizerError
from uavcover.model.route import Plan
from uavcover.optimizers import IMODBO, RandomSearch
from uavcover.planner.plan_search import SearchRequest, plan


def planned(algorithm: str | type, *, seed: int = 2) -> Plan:
    request = SearchRequest(algorithm=algorithm, evaluations=60, seed=seed, select="coverage>=0.9", workers=1)
    return plan(make_site(hills, cell_m=20.0), request)


class OwnRandomSearch(RandomSearch):
    """The same in our eyes as a class from anywhere."""


class TestPython:
    def test_a_class_plans_as_the_same_algorithm_of_ours(self) -> None:
        ours, own = planned("random"), planned(OwnRandomSearch)
        assert ours.algorithm == "random"
        assert own.algorithm == f"{__name__}:OwnRandomSearch"
        assert ours.evaluations == own.evaluations == 60
        for one, other in zip(ours.members, own.members, strict=True):
            assert np.array_equal(one.route.waypoints_m, other.route.waypoints_m)

    def test_a_name_of_the_planner_and_its_class_are_the_same(self) -> None:
        by_name, by_class = planned("imodbo"), planned(IMODBO)
        assert by_class.algorithm == "uavcover.optimizers.imodbo:IMODBO"
        assert np.array_equal(by_name.chosen.route.waypoints_m, by_class.chosen.route.waypoints_m)

    @pytest.mark.parametrize("name", ["pymoo:NSGA3", "pymoo:ParallelMOEAD", "mogwo"])
    def test_pymoo_and_rivals_plan_too(self, name: str) -> None:
        first = planned(name)
        assert first.algorithm == name
        assert np.array_equal(first.chosen.route.waypoints_m, planned(name).chosen.route.waypoints_m)

    @pytest.mark.parametrize(
        ("algorithm", "message"),
        [
            ("nsga9", "unknown algorithm 'nsga9'; use memetic, .*, one of the optimizers .*dbo"),
            ("dbo", "minimises at most 1"),
            (dict, r"has no ask\(\)"),
        ],
    )
    def test_what_cannot_plan_is_refused(self, algorithm: str | type, message: str) -> None:
        with pytest.raises((InputError, OptimizerError), match=message):
            planned(algorithm)
