import dataclasses
import gc
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely

from tests.planner.sites import hills, make_site
from uavcover.errors import InputError
from uavcover.extras.large_areas.part_search import PartCells, search_part
from uavcover.extras.large_areas.plan_by_parts import (
    RunTasks,
    part_count,
    plan_by_parts,
    search_parts_with,
    tasks_of,
)
from uavcover.model.route import Plan, Route
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.plan_search import SearchRequest, plan
from uavcover.planner.search.local_search import best_starts
from uavcover.planner.search.optimizer_search import Effort, SearchRun
from uavcover.scenario.site import Site
from uavcover.sensing import site_maps
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map

RING = ((0.0, 0.0), (700.0, 0.0), (700.0, 500.0), (0.0, 500.0))
SEARCH = {"algorithm": "memetic", "evaluations": 90, "population_size": 20}


def large(**options) -> Site:
    return make_site(hills, ring=RING, home=(350.0, 240.0), planner=SEARCH, **options)


def planned(site: Site, run_tasks: RunTasks, *, seed: int = 1) -> Plan:
    settings = dataclasses.replace(site.scenario.planner, seed=seed)
    return plan_by_parts(
        site, parts=3, settings=settings, select_rule="coverage>=0.95", run=search_run(), run_tasks=run_tasks
    )


def search_run(should_stop: Callable[[], bool] = lambda: False) -> SearchRun:
    effort = Effort(90, None, lambda: 0.0)
    return SearchRun(effort=effort, started=0.0, executor=None, should_stop=should_stop, on_progress=lambda _: None)


def one_after_the_other() -> RunTasks:
    return search_parts_with(None, now=lambda: 0.0, should_stop=lambda: False)


@pytest.fixture(scope="module")
def plan_of_large() -> Plan:
    return planned(large(), one_after_the_other())


def test_the_joined_route_is_judged_as_any_plan(plan_of_large: Plan) -> None:
    plan = plan_of_large
    assert plan.rule_met
    assert plan.chosen.violation == 0.0
    assert plan.chosen.metrics.coverage_of_coverable >= 0.95
    fine = judging_map(large())
    assert plan.chosen.metrics.coverage_of_coverable == fine.fraction_of_coverable(
        fine.observed(plan.chosen.route.waypoints_m)
    )
    assert {member.origin for member in plan.baselines} == {
        "boustrophedon", "boustrophedon-tuned", "boustrophedon-return",
    }  # fmt: skip


def test_the_plan_does_not_depend_on_who_searches_and_when(plan_of_large: Plan) -> None:
    def backwards(site: Site, tasks):
        # Another worker takes the tasks from the last to the first, does one of them twice, and lost everything before.
        run = one_after_the_other()
        fresh = dataclasses.replace(site)
        found = {task.number: next(run(fresh, [task])) for task in [*reversed(tasks), tasks[0]]}
        yield from found.values()

    with ThreadPoolExecutor(3) as threads:
        side_by_side = planned(large(), search_parts_with(threads, now=lambda: 0.0, should_stop=lambda: False))
    for other in (side_by_side, planned(large(), backwards)):
        assert np.array_equal(other.chosen.route.waypoints_m, plan_of_large.chosen.route.waypoints_m)
        assert other.chosen.metrics == plan_of_large.chosen.metrics


def plain_lines(site: Site, tasks):
    """Nobody searches: plain lines are the routes of the parts."""
    for task in tasks:
        part = dataclasses.replace(site, area=task.area)
        route = fly_layout(part, plain_boustrophedon(part)).waypoints_m if task.route_m is None else task.route_m
        yield task, route


def test_a_large_area_that_is_judged_block_by_block_gives_the_same_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = planned(large(), plain_lines)
    monkeypatch.setattr(site_maps, "_MOST_AT_ONCE", 100)
    monkeypatch.setattr(site_maps, "_BLOCK_CELLS", 700)
    site = site_maps.in_blocks(large())
    assert isinstance(judging_map(site), site_maps.BlockMap)
    other = planned(site, plain_lines)
    assert [member.metrics for member in other.members] == [member.metrics for member in whole.members]
    assert np.array_equal(other.chosen.route.waypoints_m, whole.chosen.route.waypoints_m)


def test_the_tuned_boustrophedon_of_a_larger_area_is_found_on_a_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uavcover.extras.large_areas.plan_by_parts._MOST_COMPARED_CELLS", 400)
    site = large()
    plain, tuned, *_ = planned(site, plain_lines).baselines
    assert (plain.origin, tuned.origin) == ("boustrophedon", "boustrophedon-tuned")
    assert site.scenario.planning_cell_size_m not in site_maps._maps(site)
    # Judged on the area's own cells, it keeps about what the sample promised.
    assert tuned.metrics.coverage_of_coverable > 0.93
    assert tuned.metrics.path_length_m < plain.metrics.path_length_m


def test_lines_to_compare_with_are_laid_out_beside_the_search(plan_of_large: Plan) -> None:
    site = large()
    with ThreadPoolExecutor(2) as threads:
        run = dataclasses.replace(search_run(), executor=threads)
        search = search_parts_with(threads, now=lambda: 0.0, should_stop=lambda: False)
        settings = dataclasses.replace(site.scenario.planner, seed=1)
        plan = plan_by_parts(
            site, parts=3, settings=settings, select_rule="coverage>=0.95", run=run, run_tasks=search
        )  # fmt: skip
    assert np.array_equal(plan.chosen.route.waypoints_m, plan_of_large.chosen.route.waypoints_m)
    assert [each.metrics for each in plan.baselines] == [each.metrics for each in plan_of_large.baselines]


def test_a_short_search_in_a_part_is_never_worse_than_its_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[Route] = []

    def makes_it_longer(work, starts, goal, *others):
        start = best_starts(work.problem, starts, goal)[0].route
        there_and_back = Route(np.vstack([start.waypoints_m, start.waypoints_m[-2::-1]]))
        begun.append(start)
        others[-1].found(there_and_back)

    monkeypatch.setattr("uavcover.extras.large_areas.part_search.search_goal", makes_it_longer)
    site = large()
    task = tasks_of(site, [site.area], None, 0.5, round_number=0, seed=1, evaluations=1, budget_s=None)[0]
    found = search_part(site, task, now=lambda: 0.0, should_stop=lambda: False)
    assert np.array_equal(found.waypoints_m, begun[0].waypoints_m)


def test_another_seed_gives_another_plan(plan_of_large: Plan) -> None:
    other = planned(large(), one_after_the_other(), seed=2)
    assert not np.array_equal(other.chosen.route.waypoints_m, plan_of_large.chosen.route.waypoints_m)


@pytest.mark.parametrize("number", [1, 2])
def test_along_the_seams_every_cell_is_asked_of_one_part(number) -> None:
    site = large()
    # Crossing lines, far over the seams: some cells are seen by none, by one, by two and by all three.
    areas = [shapely.box(0, 0, 250, 500), shapely.box(250, 0, 480, 500), shapely.box(480, 0, 700, 500)]
    lines = [[(100, 80), (400, 120)], [(150, 200), (600, 100)], [(420, 60), (650, 400)]]
    routes = [np.column_stack([line, site.ground.ups_m(np.array(line, float), 100.0)]) for line in lines]
    tasks = tasks_of(site, areas, routes, 0.9, round_number=number, seed=1, evaluations=1, budget_s=None)
    whole = CoverageMap(site, cell_size_m=10.0)
    required = [PartCells(task).required(whole).coverable for task in tasks]
    assert np.array_equal(np.sum(required, axis=0), whole.coverable.astype(int))
    observed = [whole.observed(route) for route in routes]
    inside = [shapely.contains_xy(area, *whole.grid.middles_m.T) for area in areas]
    for k, cells in enumerate(required):
        # Whoever is asked for a cell sees it; only of those that none sees it is the part in which they lie.
        assert not (cells & ~observed[k] & np.logical_or.reduce(observed)).any()
        assert not (cells & ~observed[k] & ~inside[k]).any()
    both = whole.coverable & observed[0] & observed[1] & ~observed[2]
    assert both.any()
    assert required[0][both].all() if number == 1 else required[1][both].all()


def test_the_maps_of_a_part_end_with_its_search() -> None:
    site = large()
    areas = [shapely.box(0, 0, 333, 500), shapely.box(333, 0, 700, 500)]
    task = tasks_of(site, areas, None, 0.9, round_number=0, seed=1, evaluations=1, budget_s=None)[0]
    gc.collect()
    gc.disable()  # what is left is what would wait for it
    try:
        before = maps_alive()
        search_part(site, task, now=lambda: 0.0, should_stop=lambda: True)
        assert maps_alive() == before
    finally:
        gc.enable()


def maps_alive() -> int:
    return sum(isinstance(each, CoverageMap) for each in gc.get_objects())


def test_the_first_round_asks_each_part_for_its_own_cells() -> None:
    site = large()
    areas = [shapely.box(0, 0, 333, 500), shapely.box(333, 0, 700, 500)]
    tasks = tasks_of(site, areas, None, 0.9, round_number=0, seed=1, evaluations=1, budget_s=None)
    whole = CoverageMap(site, cell_size_m=10.0)
    required = [PartCells(task).required(whole).coverable for task in tasks]
    assert not (required[0] & required[1]).any()
    assert np.array_equal(required[0] | required[1], whole.coverable)


def test_a_stopped_search_has_a_route_through_every_part() -> None:
    stop = threading.Event()
    stop.set()
    site = large()
    run = search_parts_with(None, now=lambda: 0.0, should_stop=stop.is_set)
    plan = plan_by_parts(
        site, parts=2, settings=site.scenario.planner, select_rule="coverage>=0.9",
        run=search_run(stop.is_set), run_tasks=run,
    )  # fmt: skip
    assert plan.interrupted
    assert plan.chosen.metrics.coverage_of_coverable > 0.8


def test_auto_is_one_part_for_a_small_area_and_more_for_many_cells() -> None:
    assert part_count(large()) == 1
    # 0.35 square kilometres in cells of 1.5 m are 156,000, of 1 m 350,000, of 0.5 m 1,400,000.
    assert [part_count(large(cell_m=cell_m)) for cell_m in (2.0, 1.5, 1.0, 0.5)] == [1, 2, 2, 6]


@pytest.mark.parametrize(
    ("planner", "parts", "words"),
    [
        ({"algorithm": "imodbo"}, 2, 'requires algorithm = "memetic" or "local-search"'),
        ({"algorithm": "memetic", "max_waypoints": 30}, 2, "requires no max_waypoints"),
        ({"algorithm": "memetic", "encoding": "waypoints"}, "auto", 'encoding = "swaths"'),
    ],
)
def test_what_parts_cannot_be_planned_for_is_refused(planner, parts, words) -> None:
    site = make_site(planner={**SEARCH, **planner})
    with pytest.raises(InputError, match=f"planner.parts: .*{words}"):
        plan(site, SearchRequest(parts=parts))


@pytest.mark.parametrize("parts", [0, -3])
def test_no_part_is_no_division(parts) -> None:
    with pytest.raises(InputError, match=f'parts: must be "auto" or at least 1, not {parts}'):
        plan(make_site(), SearchRequest(parts=parts))


def test_parts_smaller_than_what_the_sensor_sees_are_refused() -> None:
    with pytest.raises(InputError, match=r"planner.parts: 1000 parts of 0.35 km² .* at most \d+, or auto"):
        plan(large(), SearchRequest(parts=1000))


def test_the_python_interface_plans_by_parts() -> None:
    found = plan(large(), SearchRequest(parts=2, select="coverage>=0.95", workers=2))
    assert found.rule_met
    assert {member.origin for member in found.members} >= {"parts"}
