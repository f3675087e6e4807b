"""A plan by parts whose process, or whose workers, were killed."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from tests.extras.large_areas.test_plan_by_parts import large, planned
from uavcover.errors import UavcoverError
from uavcover.extras.large_areas.divided_plan import KeptParts, search_parts_on
from uavcover.extras.large_areas.part_search import PartTask
from uavcover.extras.large_areas.plan_by_parts import RunTasks
from uavcover.scenario.site import Site


def route_of(task: PartTask) -> np.ndarray:
    """Not a route that flies, but one that tells tasks apart."""
    return np.full((4, 3), task.number + 10.0 * task.round + 100.0 * task.seed)


class Searchers:
    """Who searches, and dies after so many parts."""

    def __init__(self, *, dies_after: int = 1000) -> None:
        self.required: list[int] = []
        self.left = dies_after

    def __call__(self, site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, np.ndarray]]:
        del site
        for task in tasks:
            if self.left == 0:
                raise UavcoverError("the scheduler stopped")
            self.left -= 1
            self.required.append(task.number)
            yield task, route_of(task)


def tasks(count: int = 4, **changes) -> list[PartTask]:
    first = PartTask(0, 0, b"area", 0.98, 7, 100)
    return [dataclasses.replace(first, number=number, **changes) for number in range(count)]


def found(run_tasks: RunTasks, wanted: Sequence[PartTask], site: Site) -> dict[int, np.ndarray]:
    return {task.number: route_m for task, route_m in run_tasks(site, wanted)}


@pytest.fixture(scope="module")
def site() -> Site:
    return large()


def kept_in(folder, searchers: Searchers, *, is_whole: bool = True) -> RunTasks:
    return KeptParts(folder / "parts").before(searchers, is_whole=lambda: is_whole)


def test_what_was_done_when_it_was_killed_is_not_done_again(tmp_path, site) -> None:
    with pytest.raises(UavcoverError, match="scheduler stopped"):
        found(kept_in(tmp_path, Searchers(dies_after=3)), tasks(), site)
    again = Searchers()
    routes = found(kept_in(tmp_path, again), tasks(), large())
    assert again.required == [3]
    assert all(np.array_equal(routes[task.number], route_of(task)) for task in tasks())


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 8},
        {"round": 1},
        {"goal": 0.97},
        {"evaluations": 99},
        {"area_wkb": b"other"},
        {"route_m": np.ones((2, 3))},
    ],
)
def test_nothing_is_taken_for_the_answer_to_another_task(tmp_path, site, changes) -> None:
    found(kept_in(tmp_path, Searchers()), tasks(), site)
    again = Searchers()
    found(kept_in(tmp_path, again), tasks(**changes), site)
    assert again.required == [0, 1, 2, 3]


def test_another_ground_or_scenario_is_another_task(tmp_path, site) -> None:
    found(kept_in(tmp_path, Searchers()), tasks(), site)
    for other in (large(requirements={"max_gap_s": 3.0}), large(cell_m=11.0)):
        again = Searchers()
        found(kept_in(tmp_path, again), tasks(), other)
        assert again.required == [0, 1, 2, 3]
    up_m = site.ground.surface.up_m.copy()
    up_m[3, 5] += 0.001
    raised = dataclasses.replace(
        site, ground=dataclasses.replace(site.ground, surface=site.ground.surface._replace(up_m=up_m))
    )
    again = Searchers()
    found(kept_in(tmp_path, again), tasks(), raised)
    assert again.required == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "damage", [lambda raw: raw[:-3], lambda raw: raw[:9], lambda raw: raw[:-1] + bytes([raw[-1] ^ 1])]
)
def test_a_damaged_file_is_made_again(tmp_path, site, damage) -> None:
    found(kept_in(tmp_path, Searchers()), tasks(), site)
    (broken,) = (tmp_path / "parts").glob("0-2-*")
    broken.write_bytes(damage(broken.read_bytes()))
    again = Searchers()
    routes = found(kept_in(tmp_path, again), tasks(), site)
    assert again.required == [2]
    assert np.array_equal(routes[2], route_of(tasks()[2]))
    assert found(kept_in(tmp_path, Searchers(dies_after=0)), tasks(), site).keys() == {0, 1, 2, 3}


def test_what_was_cut_short_is_not_kept_nor_what_a_clock_decided(tmp_path, site) -> None:
    found(kept_in(tmp_path, Searchers(), is_whole=False), tasks(), site)
    found(kept_in(tmp_path, Searchers()), tasks(budget_s=1.0), site)
    assert not list(tmp_path.glob("parts/*"))


class Lossy:
    """Workers that do tasks last to first, and lose the results of some, which are done again."""

    count = 2

    def __init__(self, *, stops_after: int = 1000) -> None:
        self.stops_after = stops_after

    def completed(self, function, shared, tasks, *, should_stop=lambda: False):
        del should_stop
        for number, task in enumerate(reversed(tasks)):
            if number == self.stops_after:
                return
            for _ in range(1 + number % 2):
                # Every worker has a site of its own.
                result = function(dataclasses.replace(shared), task)
            yield task, result


def test_the_plan_of_workers_that_lose_tasks_is_that_of_one_process(tmp_path) -> None:
    alone = planned(large(), search_parts_on(Lossy(), should_stop=lambda: False))
    kept = KeptParts(tmp_path / "parts")
    calls = 0

    def dies(run_tasks: RunTasks, after: int) -> RunTasks:
        def run(site, wanted):
            nonlocal calls
            for task, route_m in run_tasks(site, wanted):
                calls += 1
                if calls == after:
                    raise UavcoverError("killed")
                yield task, route_m

        return run

    searchers = search_parts_on(Lossy(), should_stop=lambda: False)
    with pytest.raises(UavcoverError):
        planned(large(), dies(kept.before(searchers, is_whole=lambda: True), 5))
    resumed = planned(large(), kept.before(searchers, is_whole=lambda: True))
    assert np.array_equal(resumed.chosen.route.waypoints_m, alone.chosen.route.waypoints_m)
    assert resumed.chosen.metrics == alone.chosen.metrics
    assert [member.metrics for member in resumed.members] == [member.metrics for member in alone.members]


def test_parts_that_the_user_did_not_wait_for_have_a_route(site) -> None:
    wanted = [dataclasses.replace(task, area_wkb=site.area.wkb) for task in tasks(2)]
    run = search_parts_on(Lossy(stops_after=0), should_stop=lambda: True)
    routes = found(run, wanted, site)
    assert routes.keys() == {0, 1}
    assert all(len(route_m) >= 2 for route_m in routes.values())
