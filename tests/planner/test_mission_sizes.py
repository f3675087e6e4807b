"""Sorties, vehicles and makespan of the members of a Pareto set agree with the missions that are written for them."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uavcover
from tests.cli.conftest import corner_of_the_demo
from tests.missions.test_sorties import there_and_back
from tests.planner.sites import hills, make_site
from uavcover.errors import InputError
from uavcover.missions.flights import mission_size
from uavcover.missions.objectives import judge
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.vehicle import Fleet
from uavcover.planner import selection_rule
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.pareto_file import ParetoRow, read_pareto
from uavcover.planner.selection_rule import with_sizes
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_map


def small_battery(folder: Path, *, vehicles: int = 1) -> Site:
    """The corner of the demo, flown from one home by small batteries as parallel lines, found at once."""
    scenario = load_scenario(corner_of_the_demo(folder))
    return load_site(
        dataclasses.replace(
            scenario,
            area=dataclasses.replace(scenario.area, cell_size_m=10.0),
            vehicle=dataclasses.replace(scenario.vehicle, endurance_s=250.0),
            planner=dataclasses.replace(scenario.planner, algorithm="lines"),
            fleet=dataclasses.replace(scenario.fleet, vehicles=vehicles, turnaround_s=90.0, pad_spacing_m=0.0),
        )
    )


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("sizes")
    uavcover.plan(small_battery(folder), out=folder / "run", select="max-coverage")
    return RunFolder(folder / "run")


def test_more_vehicles_are_not_done_later(tmp_path: Path) -> None:
    """Cut for three, with landings apart, the lines were done 12 s later than cut for two."""
    site = small_battery(tmp_path)
    vehicle = dataclasses.replace(site.scenario.vehicle, endurance_s=None)
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=vehicle))
    route = fly_layout(site, plain_boustrophedon(site))
    sizes = [mission_size(site, route, vehicles=count) for count in (2, 3, 4)]
    assert sizes[0] is not None
    assert sizes == [sizes[0]] * 3
    assert sizes[0].vehicles == 2


def test_one_vehicle_alone_may_be_done_soonest(tmp_path: Path) -> None:
    """Two vehicles, whose landings are apart, took 335 s for some lines that one flies in 200 s."""
    site = small_battery(tmp_path)
    vehicle = dataclasses.replace(site.scenario.vehicle, endurance_s=None)
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=vehicle))
    route = Route(fly_layout(site, plain_boustrophedon(site)).waypoints_m[:6])
    sizes = [mission_size(site, route, vehicles=count) for count in (1, 2, 3)]
    assert sizes[0] is not None
    assert [size and size.makespan_s for size in sizes] == pytest.approx([sizes[0].makespan_s] * 3)
    assert [size and size.vehicles for size in sizes] == [1, 1, 1]


def written(run: RunFolder) -> tuple[int, int, float]:
    """Sorties, vehicles and makespan of the mission files of a run, by its plan.json."""
    plan: dict[str, Any] = json.loads(run.file("plan.json").read_text())
    sorties = plan["sorties"]
    assert all((run.path / row["folder"] / "mission.waypoints").is_file() for row in sorties)
    if plan["fleet"] is not None:
        return len(sorties), len(plan["fleet"]["by_vehicle"]), plan["fleet"]["makespan_s"]
    flown_s = math.fsum(row["flight_time_s"] for row in sorties) or plan["metrics"]["mission_time_s"]
    return max(1, len(sorties)), 1, flown_s + 90.0 * (max(1, len(sorties)) - 1)


def row_of(row: ParetoRow) -> tuple[int, int, float]:
    assert row.mission is not None
    return row.mission.sorties, row.mission.vehicles, row.mission.makespan_s


def test_every_member_is_cut_as_its_mission_files_are(planned: RunFolder) -> None:
    rows = read_pareto(planned.file("pareto.csv"))
    (chosen,) = (row for row in rows if row.chosen)
    assert row_of(chosen)[0] > 1
    assert row_of(chosen) == pytest.approx(written(planned))
    document = json.loads(planned.file("plan.json").read_text())["mission"]
    assert document == dataclasses.asdict(chosen.mission)
    for row in (rows[0], rows[len(rows) // 2], chosen):
        uavcover.select(planned.path, f"index:{row.index}")
        assert row_of(row) == pytest.approx(written(planned))
    assert [row.mission for row in read_pareto(planned.file("pareto.csv"))] == [row.mission for row in rows]


def test_a_fleet_waits_and_keeps_apart_in_every_member(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    uavcover.plan(small_battery(tmp_path, vehicles=2), out=run.path, select="max-coverage")
    (chosen,) = (row for row in read_pareto(run.file("pareto.csv")) if row.chosen)
    assert row_of(chosen) == pytest.approx(written(run))
    assert row_of(chosen)[1] == 2
    one, two = json.loads(run.file("plan.json").read_text())["mission"]["by_vehicles"]
    assert (one["vehicles"], two["vehicles"]) == (1, 2)
    assert two["makespan_s"] == chosen.mission.makespan_s < one["makespan_s"]  # type: ignore[union-attr]
    site = load_site(run.file("scenario.toml"))
    alone = mission_size(site.flown_by(1), read_route(run))
    assert alone is not None
    assert one == dataclasses.asdict(alone)


def read_route(run: RunFolder) -> Route:
    waypoints = json.loads(run.file("plan.json").read_text())["waypoints"]
    return Route(np.array([[w["east_m"], w["north_m"], w["up_m"]] for w in waypoints]))


def plan_of(site: Site, routes: list[Route]) -> Plan:
    members = tuple(RouteMember(route, judge(judging_map(site), route), 0.0, "test") for route in routes)
    return Plan(members[-1], members, (), "knee", True, "test", 1, 0.0)


def test_what_cannot_be_flown_has_no_size() -> None:
    nowhere, homeless = make_site(on_earth=False), make_site(home=None)
    for site in (nowhere, homeless):
        plan = plan_of(site, [there_and_back(site)])
        assert with_sizes(site, plan) is plan
        assert mission_size(site, there_and_back(site)) is None
    weak = make_site(hills, vehicle={"endurance_s": 60.0})
    sized = with_sizes(weak, plan_of(weak, [there_and_back(weak)]))
    assert sized.chosen.mission is None
    assert sized.by_vehicles == ()


def test_of_a_large_set_the_chosen_and_the_least_crowded_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    plan = plan_of(site, [there_and_back(site, lines=lines) for lines in (2, 3, 4, 5, 6, 8)])
    assert all(member.mission is not None for member in with_sizes(site, plan).members)
    monkeypatch.setattr(selection_rule, "_MOST_S", 0.5 * sum(selection_rule._seconds(m, 1) for m in plan.members))
    some = with_sizes(site, plan)
    cut = [member for member in some.members if member.mission is not None]
    assert some.chosen in cut
    assert 1 < len(cut) < len(plan.members)
    assert some.chosen is some.members[-1]


def test_more_vehicles_than_help_are_listed_once() -> None:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    fleet = dataclasses.replace(site.scenario, fleet=Fleet(vehicles=4, turnaround_s=60.0))
    site = dataclasses.replace(site, scenario=fleet)
    sizes = with_sizes(site, plan_of(site, [there_and_back(site, lines=2)])).by_vehicles
    assert len(set(sizes)) == len(sizes)
    assert sizes[0].vehicles == 1
    assert [size.makespan_s for size in sizes] == sorted((size.makespan_s for size in sizes), reverse=True)


def several(site: Site, rule: str, *lines: int) -> Plan:
    """A plan whose members are there-and-back lines, the first one chosen."""
    plan = plan_of(site, [there_and_back(site, lines=count) for count in lines])
    return dataclasses.replace(plan, chosen=plan.members[0], rule=rule)


def test_vehicles_fly_what_they_are_done_with_soonest() -> None:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    pair = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=Fleet(vehicles=2)))
    least = min(member.metrics.coverage_of_coverable for member in several(pair, "knee", 8, 4).members)
    for sight, soonest in ((pair, True), (site, False)):
        found = with_sizes(sight, several(sight, f"coverage>={least}", 8, 4))
        spans = [member.mission.makespan_s for member in found.members if member.mission is not None]
        assert (found.chosen is found.members[spans.index(min(spans))]) is soonest
        assert spans[0] > spans[1]
        assert found.rule_met


def test_conditions_choose_among_all_members(monkeypatch: pytest.MonkeyPatch) -> None:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    monkeypatch.setattr(selection_rule, "_MOST_S", 0.0)  # beside what the rule asks for none is cut
    assert (
        sum(member.mission is not None for member in with_sizes(site, several(site, "knee", 8, 6, 4, 2)).members) == 2
    )
    found = with_sizes(site, several(site, "max-coverage,sorties<=1", 8, 6, 4, 2))
    sizes = [member.mission.sorties for member in found.members if member.mission is not None]
    assert len(sizes) == 4
    assert sizes[0] > sizes[-1] == 1
    assert found.chosen.mission is not None
    assert (found.chosen.mission.sorties, found.rule_met) == (1, True)
    short = with_sizes(site, several(site, "done<=30s", 8, 2))
    assert (short.chosen is short.members[1], short.rule_met) == (True, False)


def test_conditions_need_a_mission() -> None:
    for site in (make_site(on_earth=False), make_site(home=None)):
        with pytest.raises(
            InputError, match=r"'sorties<=2' has conditions on missions, but .* has no position on Earth or no \[home\]"
        ):
            with_sizes(site, several(site, "sorties<=2", 2))
