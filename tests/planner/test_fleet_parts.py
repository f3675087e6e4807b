"""Vehicles that see a part of the area each: planned part by part, flown, judged together."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.extras.fleet.lockstep import Hangar
from tests.extras.fleet.test_fleet import Listener
from tests.extras.fleet.test_fly_fleet import (
    all_land_and_pass,
    copied,
    fly,
    judged,
    lost_at,
    no_recording_of_single_flights,
)
from tests.extras.fleet.test_unlike_fleet import FAR, unlike_site
from uavcover.errors import InputError, ScenarioError
from uavcover.extras.fleet.command import FleetFailedError
from uavcover.extras.fleet.jobs import planned_jobs
from uavcover.missions.flights import compile_flights
from uavcover.missions.objectives import mission_cost
from uavcover.model.area import Outline
from uavcover.model.route import Route
from uavcover.planner.command import PlanRequest, choose, plan_into, read_members
from uavcover.planner.fleet_parts import part_sites
from uavcover.planner.pareto_file import pareto_routes_csv, read_pareto_routes
from uavcover.report.content import read_run
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import vehicle_sites
from uavcover.sensing.site_maps import judging_map, map_for

assert no_recording_of_single_flights  # a fixture that every flight here uses
_SEARCH = {"evaluations": 20, "population_size": 20}


def site_of_parts(folder: Path, *, every: bool = False) -> Site:
    """The corner of the demo: vehicle 2 sees its western part, from another home; vehicle 1 the rest, or the east by name."""
    site = unlike_site(folder, [None, FAR])
    (ring,) = (rings[0] for rings in site.scenario.area.parts)
    west, south, east, north = shapely.Polygon(ring).bounds
    middle = 0.4 * east + 0.6 * west

    def part(begin: float, end: float) -> Outline:
        return Outline(polygon_lon_lat_deg=((begin, south), (end, south), (end, north), (begin, north)))

    first, second = site.scenario.vehicles
    vehicles = (
        dataclasses.replace(first, area=part(middle, east) if every else None),
        dataclasses.replace(second, area=part(west, middle), autopilot="px4"),
    )
    planner = dataclasses.replace(site.scenario.planner, **_SEARCH)
    return load_site(dataclasses.replace(site.scenario, vehicles=vehicles, planner=planner))


def request(folder: Path, site: Site) -> PlanRequest:
    return PlanRequest(scenario=site, folder=folder, command=["test"], force=False)


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("parts")
    outcome = plan_into(request(folder / "run", site_of_parts(folder)), Listener(), check_site=lambda _: None)
    assert outcome.exit_code == 0
    return RunFolder(folder / "run")


def test_each_part_is_flown_by_its_vehicle(planned: RunFolder) -> None:
    site = load_site(load_scenario(planned.file("scenario.toml")))
    rest, west = part_sites(site)
    assert rest.area.area + west.area.area == pytest.approx(site.area.area)
    document = planned.read_json("plan.json", made_by="test")
    (begin,) = document["part_begins"]
    rows = {row["vehicle"]: row for row in document["sorties"]}
    assert (rows[1]["first_waypoint"], rows[1]["last_waypoint"]) == (0, begin - 1)
    assert (rows[2]["first_waypoint"], rows[2]["last_waypoint"]) == (begin, len(document["waypoints"]) - 1)
    assert all(row["takeoff_s"] == 0.0 for row in rows.values())  # nobody waits: homes and parts lie apart
    for job, part in zip(sorted(planned_jobs(planned, 2), key=lambda job: job.vehicle), (rest, west), strict=True):
        reach_m = 100.0
        inside = part.area.buffer(reach_m)
        assert all(inside.covers(shapely.Point(position)) for position in job.route.waypoints_m)
        # It alone sees nearly all of its own part.
        own = judging_map(part)
        assert own.fraction_of_coverable(own.observed(job.route.waypoints_m)) > 0.9


def test_figures_are_those_of_all_parts_together(planned: RunFolder) -> None:
    site = load_site(load_scenario(planned.file("scenario.toml")))
    document = planned.read_json("plan.json", made_by="test")
    points = np.array([[w["east_m"], w["north_m"], w["up_m"]] for w in document["waypoints"]])
    (begin,) = document["part_begins"]
    whole = judging_map(site)
    maps = [
        map_for(site, own) for own in vehicle_sites(site)
    ]  # each flies its part at its own speed, round its own corners
    observed = maps[0].observed(points[:begin]) | maps[1].observed(points[begin:])
    metrics = document["metrics"]
    assert metrics["coverage_fraction"] == whole.fraction(observed)
    legs_m = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert metrics["path_length_m"] == pytest.approx(legs_m.sum() - legs_m[begin - 1])
    flown_s = sum(row["flight_time_s"] for row in document["sorties"])
    assert metrics["mission_time_s"] == pytest.approx(flown_s, rel=0.02)
    parts = zip(vehicle_sites(site), np.split(points, [begin]), strict=True)
    used_s = [mission_cost(own, Route(part)).energy_hover_s for own, part in parts]
    assert metrics["mission_energy_hover_s"] == pytest.approx(sum(used_s), rel=1e-9)
    assert document["metrics"]["coverage_of_coverable"] >= 0.98  # what the scenario's rule asks for
    members = read_members(planned, site)
    rows = planned.file("pareto.csv").read_text().splitlines()[1:]
    assert [repr(m.metrics.coverage_of_coverable) for m in members] == [row.split(",")[2] for row in rows]


def test_another_member_is_chosen_and_compiled_part_by_part(planned: RunFolder, tmp_path: Path) -> None:
    run = copied(planned, tmp_path)
    site = load_site(load_scenario(run.file("scenario.toml")))
    plan, flights, _ = choose(run, site, "max-coverage", autopilot="ardupilot", command=["test"])
    (begin,) = plan.chosen.route.begins
    assert {flight.vehicle for flight in flights if flight.first >= begin} == {2}
    assert {flight.vehicle for flight in flights if flight.last < begin} == {1}
    kept = read_pareto_routes(pareto_routes_csv(plan), source="test")
    assert [route.begins for route in kept] == [member.route.begins for member in plan.members]


def test_it_is_flown_and_judged_together(planned: RunFolder, tmp_path: Path) -> None:
    run, _, document = all_land_and_pass(planned, tmp_path, 2)
    assert document["coverage_fraction"] >= document["planned_coverage_fraction"] - 0.005
    content = read_run(run, logs=[])
    assert content.coverage.fraction(content.planned_view.observed) == document["planned_coverage_fraction"]


def test_what_a_lost_vehicle_leaves_of_its_part_is_taken_over(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    with pytest.raises(FleetFailedError):
        fly(run, Hangar(2, lost_at(5, number=2)), user)
    assert any("vehicle 1 flies the remaining part of sortie" in line for line in user.lines)
    document = judged(run)
    assert document["coverage_fraction"] >= 0.98 * document["planned_coverage_fraction"]


def test_equal_seed_equal_plan_with_parts_that_touch(tmp_path: Path) -> None:
    site = site_of_parts(tmp_path, every=True)
    documents = []
    for name in ("one", "other"):
        plan_into(request(tmp_path / name, site), Listener(), check_site=lambda _: None)
        documents.append(json.loads((tmp_path / name / "plan.json").read_text()) | {"wall_s": 0.0})
    assert documents[0] == documents[1]
    assert documents[0]["fleet"]["parts"] == [
        {"vehicles": [1], "first_waypoint": 0, "last_waypoint": documents[0]["part_begins"][0] - 1},
        {
            "vehicles": [2],
            "first_waypoint": documents[0]["part_begins"][0],
            "last_waypoint": len(documents[0]["waypoints"]) - 1,
        },
    ]


def test_a_route_of_another_number_of_parts_is_refused(planned: RunFolder, tmp_path: Path) -> None:
    run = copied(planned, tmp_path)
    site = load_site(load_scenario(run.file("scenario.toml")))
    whole = read_members(run, site)[-1].route
    with pytest.raises(InputError, match=r"the route has 1 parts, but the vehicles of jacksboro cover 2 parts of"):
        compile_flights(site, Route(whole.waypoints_m))
    path = run.file("pareto_routes.csv")
    path.write_text("\n".join(line.rpartition(",")[0] for line in path.read_text().splitlines()) + "\n")
    with pytest.raises(InputError, match=r"each route must have 2 parts; create the file again"):
        read_members(run, site)


def test_parts_that_do_not_fit_are_refused_before_the_search(tmp_path: Path) -> None:
    site = site_of_parts(tmp_path, every=True)
    first, second = site.scenario.vehicles
    same = dataclasses.replace(first, area=second.area)
    overlapping = load_site(dataclasses.replace(site.scenario, vehicles=(same, second)))
    with pytest.raises(ScenarioError, match=r"vehicle\.0\.area and vehicle\.1\.area: these areas overlap by"):
        plan_into(request(tmp_path / "run", overlapping), Listener(), check_site=lambda _: None)
    assert not (tmp_path / "run" / "plan.json").exists()
