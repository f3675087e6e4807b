"""Cells that count only when several waypoints see them: judged, searched for, flown, and what a scenario may say of it."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.planner.sites import EXACT, hills, make_site
from tests.verification.flights import fly_along
from uavcover.errors import ScenarioError
from uavcover.model.route import Route
from uavcover.model.sensor import DiscSensor, SphereSensor
from uavcover.planner.search.route_problem import route_problem, state_of
from uavcover.scenario.scenario_file import dump_scenario, parse_scenario
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import FlownTrack, flown_coverage, verify_flight

DISC = DiscSensor(kind="disc", radius_m=60.0)
TWICE = {"looks": 2, "look_distance_m": 30.0}


def coverage_of(sensor=DISC, requirements=TWICE, **changes):
    return CoverageMap(make_site(sensor=sensor, requirements=requirements, **changes), cell_size_m=10.0)


@pytest.mark.no_cover
def test_two_waypoints_too_near_to_each_other_are_one_look():
    coverage = coverage_of(vehicle=EXACT)
    once = coverage_of(requirements={}, vehicle=EXACT)
    near = np.array([[150.0, 100.0, 80.0], [170.0, 100.0, 80.0]])
    apart = np.array([[150.0, 100.0, 80.0], [180.0, 100.0, 80.0]])
    assert once.observed(near).sum() > 0
    assert not coverage.observed(near).any()
    both = once.observed(apart[:1]) & once.observed(apart[1:])
    assert coverage.observed(apart).tolist() == both.tolist()
    assert 0 < both.sum() < once.observed(apart).sum()
    # The second of three is too near to the first: the first and the third count.
    three = np.vstack([near, [[190.0, 100.0, 80.0]]])
    assert coverage.observed(three).tolist() == (once.observed(three[:1]) & once.observed(three[2:])).tolist()


def test_the_local_search_counts_as_the_judge_does():
    sensor = SphereSensor(kind="sphere", range_m=110.0)
    coverage = coverage_of(sensor, ups=hills, limits={"applies_to": "waypoints"})
    problem = route_problem(coverage, margin_m=0.0, reach_m=70.0)
    points = np.random.default_rng(3).uniform([0.0, 0.0, 60.0], [300.0, 200.0, 110.0], (14, 3))
    state = state_of(problem, Route(points), capacity=20)
    kept = state.route[: state.size[0]]
    assert 4 < len(kept) < 14
    assert all(math.dist(p, q) >= 30.0 for p, q in itertools.combinations(kept.tolist(), 2))
    observed = coverage.observed(kept)
    assert ((state.counts[problem.numbers.square] >= 2) == observed).all()
    assert state.observed[0] == pytest.approx(coverage.fraction_of_coverable(observed), abs=1e-9)


def test_what_can_be_covered_twice():
    # Inside a fence of 40 m there are no two places that are 60 m from each other.
    small = ((100.0, 80.0), (140.0, 80.0), (140.0, 120.0), (100.0, 120.0))
    far = {"looks": 2, "look_distance_m": 60.0}
    assert coverage_of(requirements={}, fence=small).coverable.any()
    assert not coverage_of(requirements=far, fence=small).coverable.any()
    assert coverage_of().coverable.all()


def test_a_flight_counts_as_planned_and_says_what_was_seen_too_seldom():
    path = np.array([[60.0, 100.0, 80.0], [110.0, 100.0, 80.0], [160.0, 100.0, 80.0]])
    coverage = coverage_of()
    planned = PlannedRoute(path, 1.0)
    track = fly_along(coverage.site, path)
    flown = flown_coverage(coverage, track, planned)
    assert flown.observed.tolist() == coverage.observed(path).tolist()
    assert flown.passes.max() == 3
    gaps = verify_flight(coverage.site, coverage, [FlownTrack(track, planned)]).report.gaps
    assert {gap.reason for gap in gaps} == {"too-few-looks", "never-in-range"}
    # Too near to each other by more than the position may be wrong, or by less: surely, or possibly.
    unsure = dataclasses.replace(coverage.site.scenario.uncertainty, position_m=12.0)
    scenario = dataclasses.replace(coverage.site.scenario, uncertainty=unsure)
    blurred = CoverageMap(dataclasses.replace(coverage.site, scenario=scenario), cell_size_m=10.0)
    answer = flown_coverage(blurred, track, planned)
    assert not (answer.certain_cells & ~answer.observed).any()
    assert answer.certain_cells.sum() < answer.observed.sum() < answer.possible_cells.sum()


def test_waypoints_that_may_have_been_anywhere_may_all_be_looks_of_their_own():
    # Two places 20 m apart are one look of 30 m, unless they are wrong by 8 m each or more; by far more, whatever the way.
    path = np.array([[100.0, 100.0, 80.0], [120.0, 100.0, 80.0]])
    coverage = coverage_of()
    track, planned = fly_along(coverage.site, path), PlannedRoute(path, 1.0)
    for position_m in (8.0, 50.0):
        unsure = dataclasses.replace(coverage.site.scenario.uncertainty, position_m=position_m)
        site = dataclasses.replace(
            coverage.site, scenario=dataclasses.replace(coverage.site.scenario, uncertainty=unsure)
        )
        answer = flown_coverage(CoverageMap(site, cell_size_m=10.0), track, planned)
        east_north = coverage.grid.cells.centre_m[:, :2]
        both = (np.linalg.norm(east_north[:, None] - path[:, :2], axis=2) <= 60.0 + position_m).all(axis=1)
        assert not answer.observed.any()
        assert not answer.certain_cells.any()
        assert answer.possible_cells.tolist() == both.tolist()
        assert both.any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"looks": 0}, "requirements.looks: must be between 1 and 20, not 0"),
        ({"looks": 2}, "requirements.look_distance_m: this key is required with more than one look"),
        (
            {"look_distance_m": 5.0},
            "requirements.look_distance_m: must be greater than 0, and requires more than one look",
        ),
    ],
)
def test_values_that_make_no_sense(changes, message, tmp_path):
    text = dump_scenario(coverage_of(requirements={}).site.scenario)
    for key, value in changes.items():
        text = "\n".join(line for line in text.splitlines() if not line.startswith(f"{key} = "))
        text = text.replace("[requirements]", f"[requirements]\n{key} = {value!r}")
    with pytest.raises(ScenarioError) as error:
        parse_scenario(text, source="t", folder=tmp_path)
    assert str(error.value).startswith(f"t: {message}")


def test_several_looks_go_with_waypoints():
    with pytest.raises(ValueError, match=r"^requirements.looks: more than one look requires sensor.sensing = "):
        coverage_of(dataclasses.replace(DISC, sensing="along-path"))
