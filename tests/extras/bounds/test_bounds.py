"""Bounds: closed forms on flat ground, random places that must not see further, plans that must not be better."""

import math

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from uavcover.errors import InputError
from uavcover.extras.bounds.bounds import are_quick, farthest_looks_m, least_path_length_m, path_bounds, waypoint_bounds
from uavcover.extras.bounds.programs import SolverEffort
from uavcover.model.route import Bound
from uavcover.model.sensor import SphereSensor
from uavcover.planner.plan_files import bounds as bounds_of
from uavcover.planner.planner import Effort, plan_routes
from uavcover.run.documents import bound_document, bounds_text
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations, observes_each
from uavcover.sensing.site_maps import judging_map


def planned(site, rule):
    return plan_routes(site, settings=site.scenario.planner, select_rule=rule, effort=Effort(40, None, lambda: 0.0))


def test_on_flat_ground_the_path_bound_is_the_closed_form():
    coverage = CoverageMap(make_site(), cell_size_m=10.0)
    radius = 120.0 * math.tan(math.radians(35.0)) + 10.0 * math.sqrt(0.5)
    for fraction in (1.0, 0.9):
        expected = (fraction * 300.0 * 200.0 - math.pi * radius**2) / (2.0 * radius)
        assert least_path_length_m(coverage, fraction) == pytest.approx(expected)
    assert least_path_length_m(coverage, 0.0) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_no_allowed_place_sees_a_cell_from_further_away(seed):
    coverage = CoverageMap(make_site(hills), cell_size_m=20.0)
    farthest = farthest_looks_m(coverage)
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, coverage.grid.count, 4000)
    positions = coverage.grid.cells.centre_m[cells, :2] + rng.uniform(-130.0, 130.0, (4000, 2))
    up = coverage.site.ground.heights_m(positions) + rng.uniform(40.0, 120.0, 4000)
    observations = LevelObservations.towards_north(np.column_stack([positions, up]))
    observed = observes_each(coverage, observations, cells, coverage.sight)
    distance = np.hypot(*(positions - coverage.grid.cells.centre_m[cells, :2]).T)
    assert observed.sum() > 100
    assert (distance[observed] <= farthest[cells[observed]]).all()


def test_a_planned_path_is_not_shorter_than_its_bound():
    site = make_site(hills)
    bounds = bounds_of(site, planned(site, "coverage>=0.9"))
    entry = bounds["shortest_path_m"]
    assert 0.0 < entry["at_least"] <= entry["found"]
    assert entry["gap"] == pytest.approx(entry["found"] / entry["at_least"] - 1.0)
    assert entry["for_coverage_of_coverable"] == 0.9
    assert "fewest_waypoints" not in bounds


def test_the_larger_of_both_path_bounds_is_reported():
    site = make_site(hills, cell_m=20.0)
    coverage, plan = judging_map(site), planned(site, "coverage>=0.9")
    (quick,) = path_bounds(coverage, plan)
    (slow,) = path_bounds(coverage, plan, time_s=0.5)
    assert quick.method == "area within reach of a curve"
    assert quick.limit <= slow.limit <= slow.found
    assert (slow.method == "prices on the ground") == (slow.limit > quick.limit)


def test_prices_are_said_to_hold_for_the_ground_and_the_quick_bound_for_what_is_counted(monkeypatch):
    """A path may see the counted places of enough cells, and less of the ground: then it may be shorter than prices say."""

    class Dear:
        def least_length_m(self, fraction):
            return 1e4 * fraction

    site = make_site(hills, cell_m=20.0)
    coverage, plan = judging_map(site), planned(site, "coverage>=0.9")
    monkeypatch.setattr("uavcover.extras.bounds.bounds.lattice_parts", lambda _, time_s: 1 if time_s else None)
    monkeypatch.setattr("uavcover.extras.bounds.bounds.price_ground", lambda *_, **__: Dear())
    (quick,) = path_bounds(coverage, plan)
    (priced,) = path_bounds(coverage, plan, time_s=1.0)
    assert (quick.counted, quick.proved_on) == ("cells", "any path inside the height band")
    assert (priced.counted, priced.limit) == ("ground", pytest.approx(9e3))
    document = bound_document(priced)
    assert document["counted"] == "ground"
    (line,) = bounds_text({"shortest_path_m": document})
    assert (
        "that observes this fraction of the ground itself (found: of the cells, one point in each), by prices" in line
    )


def test_legs_without_limits_may_see_from_any_height():
    waypoints_alone = {"applies_to": "waypoints"}
    coverage = CoverageMap(make_site(hills, limits=waypoints_alone), cell_size_m=20.0)
    reach_m = np.full(coverage.grid.count, 200.0 * math.sin(math.radians(35.0)))
    assert farthest_looks_m(coverage) == pytest.approx(reach_m)


@pytest.fixture(scope="module")
def dome():
    return make_site(
        sensor=SphereSensor(kind="sphere", range_m=90.0),
        limits={"min_height_agl_m": 40.0, "max_height_agl_m": 80.0, "applies_to": "waypoints"},
        planner={"encoding": "waypoints", "cell_size_m": 20.0, "initial": ("set-cover",)},
        cell_m=20.0,
    )


def test_branch_and_bound_is_at_least_as_tight_as_the_relaxation(dome):
    plan = planned(dome, "coverage>=1.0")
    coverage = judging_map(dome)
    assert are_quick(coverage)
    relaxed = waypoint_bounds(coverage, plan, SolverEffort(nodes=0))
    proved = waypoint_bounds(coverage, plan, SolverEffort(time_s=20.0))
    assert [bound.question for bound in proved] == ["fewest_waypoints", "most_coverage"]
    assert {bound.method for bound in relaxed} == {"linear relaxation"}
    assert proved[0].limit >= relaxed[0].limit
    assert proved[1].limit <= relaxed[1].limit
    assert proved[0].found == min(
        m.metrics.waypoint_count for m in plan.members if m.metrics.coverage_of_coverable >= 1.0 - 1e-9
    )
    assert proved[1].required == plan.chosen.metrics.waypoint_count


def test_sensing_along_a_path_has_no_waypoint_bounds():
    site = make_site()
    assert (
        waypoint_bounds(CoverageMap(site, cell_size_m=20.0), planned(site, "max-coverage"), SolverEffort(nodes=0)) == []
    )


def test_gaps():
    def gap(question, limit, found):
        return Bound(question, 1.0, limit, found, "a lattice", "a method").gap

    assert gap("fewest_waypoints", 40.0, 42.0) == pytest.approx(0.05)
    assert gap("fewest_waypoints", 16.0, 15.0) == pytest.approx(-0.0625)
    assert gap("most_coverage", 0.98, 0.95) == pytest.approx(0.03)
    assert gap("shortest_path_m", 0.0, 10.0) is None
    assert gap("shortest_path_m", 10.0, None) is None


def test_bounds_in_words():
    common = {"proved_on": "a lattice", "method": "branch and bound"}
    bounds = {
        "coverable_fraction": 1.0,
        "fewest_waypoints": {"for_coverage_of_coverable": 1.0, "at_least": 44.0, "found": 45, "gap": 1 / 44, **common},
        "most_coverage": {"with_waypoints": 40, "at_most": 0.98, "found": None, "gap": None, **common},
        "shortest_path_m": {
            "for_coverage_of_coverable": 0.9,
            "at_least": 100.0,
            "found": 624.6,
            "gap": 5.246,
            **common,
        },
    }
    assert bounds_text(bounds) == [
        "fewest waypoints for 100.00 %: at least 44, found 45, gap 2.27 %; proved for a lattice, by branch and bound",
        "most coverage with 40 waypoints: at most 98.00 %, found none; proved for a lattice, by branch and bound",
        "shortest path for 90.00 %: at least 100 m, found 625 m (by the shortest of all routes), 6.2 times that; "
        "proved for a lattice, by branch and bound",
    ]
    with pytest.raises(InputError, match=r"bounds.most_coverage is not a bound"):
        bounds_text({"most_coverage": {"found": 1.0}})
