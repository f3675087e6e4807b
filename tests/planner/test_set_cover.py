"""Candidates on a lattice, programs against exhaustive optima, and the routes that are made of covers."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.naive import set_cover as naive
from tests.planner.sites import make_site, tower
from uavcover.extras.bounds.programs import CoverProgram, SolverEffort
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.limits import Obstacles
from uavcover.model.scenario import PlannerSettings
from uavcover.model.sensor import SphereSensor
from uavcover.planner.baselines import initial_routes
from uavcover.planner.baselines.initial_routes import constructed_routes, initial_names
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.set_cover import (
    Candidates,
    cut_down,
    finest_lattice_candidates,
    greedy_cover,
    level_candidates,
    observed_from_each,
    reduce,
    searched_cover,
)
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations

ALL = SolverEffort(time_s=30.0)
RELAXED = SolverEffort(nodes=0)


def candidates_of(sets, weight):
    start = np.concatenate([[0], np.cumsum([len(s) for s in sets])]).astype(np.int64)
    cells = np.array([cell for s in sets for cell in sorted(s)], dtype=np.int32)
    return Candidates(np.zeros((len(sets), 3)), 1.0, start, cells, np.asarray(weight, float))


def random_case(seed):
    rng = np.random.default_rng(seed)
    cells = int(rng.integers(4, 12))
    sets = [
        frozenset(rng.choice(cells, size=rng.integers(0, 5), replace=True).tolist()) for _ in range(rng.integers(3, 11))
    ]
    weight = rng.integers(0, 6, cells) / 1.0
    weight[0] += 1.0
    return sets, weight / weight.sum()


@pytest.mark.parametrize("seed", range(30))
def test_the_programs_agree_with_trying_everything(seed):
    sets, weight = random_case(seed)
    candidates = candidates_of(sets, weight)
    reduced = reduce(candidates)
    everything = naive.worth(sets, weight, range(len(sets)))
    assert reduced.reachable == pytest.approx(everything)
    program = CoverProgram(reduced)
    for fraction in (0.4, 0.8, 1.0):
        goal = fraction * everything
        best = naive.fewest(sets, weight, goal - 1e-9)
        answer = program.fewest_positions(goal, ALL)
        assert answer.bound == best == len(answer.chosen)
        assert candidates.coverage_of(answer.chosen) >= goal - 1e-6
        assert program.fewest_positions(goal, RELAXED).bound <= best
        greedy = greedy_cover(reduced, goal)
        assert candidates.coverage_of(greedy) >= goal - 1e-6
        assert len(greedy) >= best
    for count in (1, 2, 4):
        best = naive.most(sets, weight, count)
        answer = program.most_coverage(count, ALL)
        assert answer.bound == pytest.approx(best, abs=1e-6)
        assert candidates.coverage_of(answer.chosen) == pytest.approx(best, abs=1e-6)
        assert program.most_coverage(count, RELAXED).bound >= best - 1e-6
    searched = searched_cover(reduced, steps=500, rng=np.random.default_rng(0))
    assert candidates.coverage_of(searched) == pytest.approx(everything)
    assert len(searched) == naive.fewest(sets, weight, everything - 1e-9)


def test_nothing_needs_no_place():
    answer = CoverProgram(reduce(candidates_of([{0}, {1}], [0.5, 0.5]))).fewest_positions(0.0, ALL)
    assert (answer.bound, len(answer.chosen)) == (0.0, 0)


def test_cutting_down_leaves_out_what_alone_sees_least():
    candidates = candidates_of([{0, 1}, {1, 2}, {3}], [0.3, 0.3, 0.3, 0.1])
    assert cut_down(candidates, np.array([0, 1, 2]), 2).tolist() == [0, 1]


@pytest.fixture(scope="module")
def dome():
    """A ball of 90 m on flat ground, looking from its waypoints, in a band of 40 to 80 m."""
    return CoverageMap(
        make_site(
            sensor=SphereSensor(kind="sphere", range_m=90.0),
            limits={"min_height_agl_m": 40.0, "max_height_agl_m": 80.0, "applies_to": "waypoints"},
            planner={"encoding": "waypoints", "algorithm": "memetic", "cell_size_m": 20.0},
            cell_m=20.0,
        ),
        cell_size_m=20.0,
    )


def test_the_lattice_lies_inside_the_limits_and_sees_what_the_map_says(dome):
    candidates = finest_lattice_candidates(dome, spacing_m=20.0, most=100_000)
    positions = candidates.positions_m
    assert np.array_equal(positions, 20.0 * np.rint(positions / 20.0))
    assert set(positions[:, 2]) == {40.0, 60.0, 80.0}
    assert measure_violations(dome.site, positions, margin_m=0.0).total == 0.0
    for k in (0, len(positions) // 2, len(positions) - 1):
        observed = candidates.cells[candidates.start[k] : candidates.start[k + 1]]
        assert (
            observed.tolist()
            == np.flatnonzero(dome.observed_by(LevelObservations.towards_north(positions[k : k + 1]))).tolist()
        )
    assert candidates.weight.sum() == pytest.approx(1.0)
    assert candidates.text == f"lattice of 20 m, {len(positions):,} places"


def test_a_lattice_gets_coarser_until_it_has_few_enough_places(dome):
    coarse = finest_lattice_candidates(dome, spacing_m=0.01, most=300)
    assert len(coarse.positions_m) <= 300
    assert coarse.spacing_m == 0.01 * 2.0 ** round(np.log2(coarse.spacing_m / 0.01))


def test_a_band_without_a_level_of_the_lattice_has_places_in_its_middle():
    site = make_site(
        sensor=SphereSensor(kind="sphere", range_m=90.0),
        limits={"min_height_agl_m": 42.0, "max_height_agl_m": 44.0, "height_margin_m": 0.0, "applies_to": "waypoints"},
        cell_m=20.0,
    )
    positions = finest_lattice_candidates(CoverageMap(site, cell_size_m=20.0), spacing_m=20.0, most=10_000).positions_m
    assert len(positions) > 100
    assert set(positions[:, 2]) == {43.0}


def test_one_level_lies_at_one_height(dome):
    positions = level_candidates(dome, spacing_m=30.0, height_agl_m=55.0).positions_m
    assert set(positions[:, 2]) == {55.0}


@pytest.mark.parametrize("name", ["greedy-set-cover", "set-cover"])
def test_covers_are_feasible_routes_that_see_all(dome, name):
    settings = PlannerSettings(encoding="waypoints", initial=(name,))
    (baseline,) = constructed_routes(dome, settings, required=None, executor=None, left_s=lambda: math.inf)
    assert baseline.name == name
    assert baseline.violation == 0.0
    assert dome.fraction_of_coverable(dome.observed(baseline.route.waypoints_m)) == pytest.approx(1.0)
    assert -baseline.objectives[0] == pytest.approx(dome.fraction(dome.coverable))


def test_a_cover_never_has_more_waypoints_than_are_allowed(dome):
    settings = PlannerSettings(encoding="waypoints", initial=("greedy-set-cover",), max_waypoints=2)
    (baseline,) = constructed_routes(dome, settings, required=None, executor=None, left_s=lambda: math.inf)
    assert len(baseline.route) == 2


def test_a_cover_takes_a_finer_lattice_only_while_there_is_time_for_it(dome, monkeypatch):
    settings = PlannerSettings(encoding="waypoints", initial=("greedy-set-cover",))
    spacings = []

    def reduced(candidates):
        spacings.append(candidates.spacing_m)
        return reduce(candidates)

    monkeypatch.setattr(initial_routes, "reduce", reduced)

    def made_with(left_s):
        spacings.clear()
        (baseline,) = constructed_routes(dome, settings, required=None, executor=None, left_s=left_s)
        assert dome.fraction_of_coverable(dome.observed(baseline.route.waypoints_m)) == pytest.approx(1.0)
        return list(spacings)

    (finest,) = made_with(lambda: math.inf)
    assert made_with(lambda: 1.0)[-1] == finest
    first = made_with(lambda: 1.0)[0]
    assert made_with(lambda: -1.0) == [first]
    seconds = itertools.count()
    assert made_with(lambda: 6.0 - next(seconds)) == [first]
    assert first > finest


def test_along_a_path_a_cover_is_laid_over_the_terrain():
    site = make_site(planner={"initial": ("greedy-set-cover",)})
    coverage = CoverageMap(site, cell_size_m=20.0)
    found = constructed_routes(coverage, site.scenario.planner, required=0.9, executor=None, left_s=lambda: math.inf)
    cover = found[-1]
    assert [found[0].name, cover.name] == ["boustrophedon", "greedy-set-cover"]
    assert cover.layout is None
    assert cover.violation == 0.0
    assert coverage.fraction_of_coverable(coverage.observed(cover.route.waypoints_m)) >= 0.9


@pytest.mark.thinned(2)
@pytest.mark.parametrize("sensing", ["along-path", "at-waypoints"])
@pytest.mark.parametrize("applies_to", ["legs", "waypoints"])
@pytest.mark.parametrize("encoding", ["swaths", "waypoints"])
@pytest.mark.parametrize("algorithm", ["memetic", "local-search"])
def test_a_local_search_always_has_a_baseline_and_a_cover_at_waypoints(sensing, applies_to, encoding, algorithm):
    site = make_site(
        sensor=SphereSensor(kind="sphere", range_m=120.0, sensing=sensing),
        limits={"applies_to": applies_to},
        planner={"algorithm": algorithm, "encoding": encoding},
        obstacles=Obstacles(prisms=(tower(120.0, 80.0, 160.0, 120.0, 30.0),), clearance_beside_m=8.0),
    )
    coverage = CoverageMap(site, cell_size_m=20.0)
    found = constructed_routes(coverage, site.scenario.planner, required=0.9, executor=None, left_s=lambda: math.inf)
    assert {baseline.name for baseline in found} >= {"set-cover" if sensing == "at-waypoints" else "boustrophedon"}
    assert any(baseline.violation == 0.0 and -baseline.objectives[0] > 0.5 for baseline in found)


def test_an_optimizer_of_waypoints_samples_its_first_population():
    site = make_site(planner={"algorithm": "imodbo", "encoding": "waypoints"})
    assert initial_names(CoverageMap(site, cell_size_m=20.0), site.scenario.planner) == ()


@pytest.mark.parametrize("algorithm", ["memetic", "imodbo"])
def test_the_plan_is_not_worse_than_the_covers_it_began_with(dome, algorithm):
    settings = PlannerSettings(
        algorithm=algorithm, encoding="waypoints", population_size=20, evaluations=40, max_waypoints=20,
        initial=("greedy-set-cover", "set-cover"),
    )  # fmt: skip
    plan = plan_routes(dome.site, settings=settings, select_rule="coverage>=1.0", effort=Effort(40, None, lambda: 0.0))
    assert {member.origin for member in plan.baselines} == {"greedy-set-cover", "set-cover"}
    assert plan.rule_met
    enough = [member.metrics for member in plan.baselines if member.metrics.coverage_of_coverable >= 1.0 - 1e-9]
    assert plan.chosen.metrics.cost <= min(metrics.cost for metrics in enough) + 1e-9
    again = plan_routes(
        dome.site,
        settings=dataclasses.replace(settings),
        select_rule="coverage>=1.0",
        effort=Effort(40, None, lambda: 0.0),
    )
    assert np.array_equal(again.chosen.route.waypoints_m, plan.chosen.route.waypoints_m)


def test_when_the_time_is_over_the_remaining_positions_observe_nothing(monkeypatch):
    coverage = CoverageMap(make_site(), cell_size_m=10.0)
    positions, every = np.tile([150.0, 100.0, 80.0], (20, 1)), np.arange(coverage.grid.count)
    start, _ = observed_from_each(coverage, positions, every, coverage.sight)
    assert (np.diff(start) == np.diff(start)[0]).all()
    assert start[1] > 0
    monkeypatch.setattr("uavcover.planner.set_cover._POSITIONS_AT_ONCE", 5)
    stops = iter([False, True])
    ended, cells = observed_from_each(coverage, positions, every, coverage.sight, stops.__next__)
    np.testing.assert_array_equal(ended[:11], start[:11])
    assert (ended[11:] == start[10]).all()
    assert len(cells) == start[10]
