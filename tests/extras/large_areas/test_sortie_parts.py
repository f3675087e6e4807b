import dataclasses
import itertools

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site
from uavcover.extras.large_areas.part_search import PartTask, search_part
from uavcover.extras.large_areas.plan_by_parts import plan_by_parts
from uavcover.extras.large_areas.sortie_parts import FEWEST, may_have_sorties, sortie_parts
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import mission_cost
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.search.optimizer_search import Effort, SearchRun
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import sampling_map

RING = ((-550.0, -550.0), (950.0, -550.0), (950.0, 950.0), (-550.0, 950.0))


def around_home(ups=hills, *, endurance_s: float = 600.0, home=(150.0, 250.0), ring=RING, **options) -> Site:
    return make_site(
        ups, ring=ring, home=home, cell_m=20.0,
        vehicle={"endurance_s": endurance_s}, planner={"algorithm": "memetic", "evaluations": 60}, **options,
    )  # fmt: skip


def coarse(site: Site) -> CoverageMap:
    return CoverageMap(site, cell_size_m=40.0)


@pytest.fixture(scope="module")
def site() -> Site:
    return around_home()


@pytest.fixture(scope="module")
def parts(site):
    return sortie_parts(site, coarse(site), 0.95)


def test_every_part_is_one_flight_of_about_the_same_battery(site, parts) -> None:
    assert len(parts) >= FEWEST
    loads = np.array([part.load for part in parts])
    assert loads.max() <= 1.03
    assert loads.min() > 0.6 * loads.max()
    for part in parts:
        alone = mission_cost(site, Route(part.begin_m))
        assert alone.time_s == pytest.approx(part.cost, rel=0.03)
        assert measure_violations(site, part.begin_m, margin_m=0.0).total == 0.0


def test_parts_are_the_area_and_flights_see_what_is_asked_for(site, parts) -> None:
    assert sum(part.area.area for part in parts) == pytest.approx(site.area.area, rel=1e-6)
    for one, other in itertools.combinations(parts, 2):
        assert one.area.intersection(other.area).area < 1e-6 * site.area.area
    cells = coarse(site)
    observed = np.logical_or.reduce([cells.observed(part.begin_m) for part in parts])
    assert cells.fraction_of_coverable(observed) > 0.945


def test_flights_begin_and_end_near_home(site, parts) -> None:
    ends = np.array([part.begin_m[[0, -1], :2] - site.home_m[:2] for part in parts])
    assert np.hypot(ends[..., 0], ends[..., 1]).max() < 120.0


def test_the_same_parts_every_time(parts) -> None:
    again = sortie_parts(fresh := around_home(), coarse(fresh), 0.95)
    assert [part.begin_m.tobytes() for part in again] == [part.begin_m.tobytes() for part in parts]
    assert [part.area.wkb for part in again] == [part.area.wkb for part in parts]


def planned(site: Site, run_tasks, *, or_sorties: bool):
    run = SearchRun(
        effort=Effort(60, None, lambda: 0.0),
        started=0.0,
        executor=None,
        should_stop=lambda: False,
        on_progress=lambda _: None,
    )
    return plan_by_parts(
        site, parts=2, settings=site.scenario.planner, select_rule="coverage>=0.95", run=run, run_tasks=run_tasks,
        or_sorties=or_sorties,
    )  # fmt: skip


@pytest.mark.parametrize("worth", [2.0, 0.5])
def test_parts_are_flights_where_that_is_allowed_and_worth_it(monkeypatch: pytest.MonkeyPatch, worth) -> None:
    monkeypatch.setattr("uavcover.extras.large_areas.plan_by_parts._WORTH", worth)
    required: list[list[PartTask]] = []

    def as_begun(site: Site, tasks):
        required.append(list(tasks))
        for task in tasks:
            yield task, search_part_lines(site, task) if task.route_m is None else task.route_m

    site = around_home()
    plan = planned(site, as_begun, or_sorties=True)
    begun = [task.route_m for task in required[0]]
    if worth < 1.0:
        assert len(begun) == 2
        return
    made = sortie_parts(site, sampling_map(site, most_cells=300_000), 0.95)
    assert [begin_m.tobytes() for begin_m in begun] == [part.begin_m.tobytes() for part in made]
    # Each flight is cut out again: the ways between their ends are short.
    members = [member for member in plan.members if member.origin == "parts"]
    assert min(member.metrics.mission_time_s for member in members) < 1.03 * sum(part.cost for part in made)


def search_part_lines(site: Site, task: PartTask) -> np.ndarray:
    part = dataclasses.replace(site, area=task.area)
    return fly_layout(part, plain_boustrophedon(part)).waypoints_m


def test_a_part_begins_with_what_it_is_given(site, parts) -> None:
    task = PartTask(0, 0, shapely.to_wkb(parts[0].area), 0.95, 1, 1, route_m=parts[0].begin_m)
    found = search_part(site, task, now=lambda: 0.0, should_stop=lambda: True)
    assert np.array_equal(found.waypoints_m, parts[0].begin_m)


def test_without_limits_or_a_home_there_are_no_sorties() -> None:
    assert may_have_sorties(around_home())
    assert not may_have_sorties(make_site(home=None))
    assert not may_have_sorties(make_site(home=(0.0, 0.0)))
    assert not may_have_sorties(
        make_site(home=(0.0, 0.0), vehicle={"endurance_s": 500.0}, planner={"objective": "length"})
    )


@pytest.mark.parametrize("endurance_s", [3000.0, 60.0])
def test_where_flights_are_few_or_too_short_there_are_none(endurance_s) -> None:
    site = around_home(endurance_s=endurance_s)
    assert sortie_parts(site, coarse(site), 0.95) == []


def test_flights_that_keep_no_limits_are_none() -> None:
    # A wall that no leg climbs, right through the middle.
    def wall(east, north):
        return np.where(np.abs(east - 700.0) < 30.0, 400.0, 0.0) + 0.0 * north

    site = around_home(wall)
    assert sortie_parts(site, coarse(site), 0.95) == []


@pytest.mark.parametrize(
    ("ring", "home"),
    [
        (RING, (-590.0, 200.0)),
        (((-550.0, -550.0), (950.0, -550.0), (950.0, 200.0), (200.0, 200.0), (200.0, 950.0), (-550.0, 950.0)), (-100.0, -100.0)),
    ],
    ids=["home outside", "L"],
)  # fmt: skip
def test_other_areas_and_homes(ring, home) -> None:
    site = around_home(flat, ring=ring, home=home, endurance_s=800.0)
    made = sortie_parts(site, coarse(site), 0.95)
    assert made
    assert sum(part.area.area for part in made) == pytest.approx(site.area.area, rel=1e-6)
    assert max(part.load for part in made) <= 1.03
