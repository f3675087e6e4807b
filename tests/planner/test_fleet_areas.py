"""Equal vehicles on pads with a part of the area each: borders, routes, the schedule, and flights of the plan."""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.cli.conftest import corner_of_the_demo
from tests.extras.fleet.lockstep import Hangar
from tests.extras.fleet.test_fleet import Listener
from tests.extras.fleet.test_fly_fleet import all_land_and_pass, copied, fly, mock, no_recording_of_single_flights
from uavcover.errors import ScenarioError
from uavcover.extras.fleet.command import FleetFailedError
from uavcover.extras.fleet.jobs import planned_jobs
from uavcover.flight.connect import home_of
from uavcover.missions.fleet_schedule import pieces_of, unsafe_starts
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.limits import Home
from uavcover.planner.command import PlanOutcome, PlanRequest, plan_into
from uavcover.planner.fleet_areas import is_one_flight_each
from uavcover.planner.fleet_parts import part_sites
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import on_pads, vehicle_sites
from uavcover.sensing.site_maps import judging_map

assert no_recording_of_single_flights  # a fixture that every flight here uses


def corner(folder: Path, vehicles: int, **changes: float) -> Site:
    """The corner of the demo with a quick search, for several equal vehicles."""
    site = load_site(corner_of_the_demo(folder)).flown_by(vehicles)
    fleet = dataclasses.replace(site.scenario.fleet, **changes)
    planner = dataclasses.replace(site.scenario.planner, evaluations=60, population_size=20)
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=fleet, planner=planner))


def plan(site: Site, folder: Path, user: Listener | None = None, **request: object) -> PlanOutcome:
    required = PlanRequest(scenario=site, folder=folder, command=["test"], force=False, **request)  # type: ignore[arg-type]
    return plan_into(required, user or Listener(), check_site=lambda _: None)


@pytest.fixture(scope="module")
def said() -> Listener:
    return Listener()


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory, said: Listener) -> RunFolder:
    folder = tmp_path_factory.mktemp("shares")
    assert plan(corner(folder, 3), folder / "run", said).exit_code == 0
    return RunFolder(folder / "run")


def test_the_mission_of_fewer_vehicles_is_told(planned: RunFolder, said: Listener) -> None:
    mission = planned.read_json("plan.json", made_by="test")["mission"]
    sizes = mission.pop("by_vehicles")
    assert [size["vehicles"] for size in sizes] == [1, 2, 3]
    assert sizes[-1] == mission
    times_s = [size["makespan_s"] for size in sizes]
    assert times_s == sorted(times_s, reverse=True)
    assert any(line.startswith("mission time of this route by number of vehicles: 1 in") for line in said.lines)


def test_each_vehicle_has_a_pad_and_a_part(planned: RunFolder, said: Listener) -> None:
    document = planned.read_json("plan.json", made_by="test")
    fleet, site = document["fleet"], load_site(load_scenario(planned.file("scenario.toml")))
    assert [row["vehicle"] for row in fleet["by_vehicle"]] == [1, 2, 3]
    assert len(document["part_begins"]) == 2
    assert document["metrics"]["coverage_of_coverable"] >= 0.98
    positions = np.array([own.home_m for own in vehicle_sites(site)])
    assert min(float(np.hypot(*(a - b)[:2])) for a, b in itertools.combinations(positions, 2)) > 45.9
    for number, home in enumerate(fleet["homes"], start=1):
        where = f"latitude {home['lat_deg']:.7f}, longitude {home['lon_deg']:.7f}"
        assert any(line.startswith(f"vehicle {number}") and where in line for line in said.lines)
    for job in planned_jobs(planned, 3):
        home = fleet["homes"][job.vehicle - 1]
        kept = json.loads((job.folder.path / "mission.plan").read_text())
        assert kept["mission"]["plannedHomePosition"][:2] == pytest.approx([home["lat_deg"], home["lon_deg"]], abs=1e-7)
        row = (job.folder.path / "mission.waypoints").read_text().splitlines()[1].split("\t")
        assert [float(row[8]), float(row[9])] == pytest.approx([home["lat_deg"], home["lon_deg"]], abs=1e-7)
        assert np.allclose(job.timeline.position_m[[0, -1]], positions[job.vehicle - 1])


def test_the_parts_are_the_area(planned: RunFolder) -> None:
    site = load_site(load_scenario(planned.file("scenario.toml")))
    parts = [own.area for own in part_sites(site)]
    assert shapely.union_all(parts).symmetric_difference(site.area).area < 1.0
    assert sum(part.area for part in parts) == pytest.approx(site.area.area, abs=1.0)


def test_no_pair_comes_near_however_early_or_late(planned: RunFolder) -> None:
    jobs = planned_jobs(planned, 3)
    fleet = jobs[0].site.scenario.fleet
    for a, b in itertools.combinations(jobs, 2):
        unsafe = unsafe_starts(pieces_of(a.timeline, fleet), pieces_of(b.timeline, fleet), fleet)
        difference_s = b.planned_s - a.planned_s
        assert not ((unsafe[:, 0] < difference_s) & (difference_s < unsafe[:, 1])).any()


def test_it_is_done_sooner_than_from_one_home(planned: RunFolder, tmp_path: Path) -> None:
    alone = plan(corner(tmp_path, 1), tmp_path / "alone").plan.chosen.mission
    together = planned.read_json("plan.json", made_by="test")["mission"]["makespan_s"]
    assert alone is not None
    assert together < 0.75 * alone.makespan_s


def test_equal_seed_equal_plan(planned: RunFolder, tmp_path: Path) -> None:
    plan(corner(tmp_path, 3), tmp_path / "again")
    documents = [
        run.read_json("plan.json", made_by="test") | {"wall_s": 0.0} for run in (planned, RunFolder(tmp_path / "again"))
    ]
    assert documents[0] == documents[1]


def test_it_is_flown_and_judged_together(planned: RunFolder, tmp_path: Path) -> None:
    _, _, document = all_land_and_pass(planned, tmp_path, 3)
    assert document["coverage_fraction"] >= document["planned_coverage_fraction"] - 0.005


def test_a_vehicle_on_another_pad_is_refused(planned: RunFolder, tmp_path: Path) -> None:
    run = copied(planned, tmp_path)
    sites = vehicle_sites(load_site(load_scenario(run.file("scenario.toml"))))

    def make(number: int, sortie: int, site: Site) -> MockVehicle:
        return mock(number, sortie, site, position=home_of(sites[{1: 0, 2: 2, 3: 1}[number]]))

    with pytest.raises(FleetFailedError, match=r"from the planned home.*it stands at the home of vehicle 3"):
        fly(run, Hangar(3, make), Listener())


def test_one_home_as_before(tmp_path: Path) -> None:
    outcome = plan(corner(tmp_path, 2, pad_spacing_m=0.0), tmp_path / "run")
    fleet = outcome.document["fleet"]
    assert (fleet["alike"], fleet["homes"]) == (True, None)
    assert outcome.plan.chosen.route.begins == ()


def test_given_homes_stay_and_get_parts(tmp_path: Path) -> None:
    site = on_pads(corner(tmp_path, 2))
    first, second = site.scenario.vehicles
    own = Home(lat_deg=36.4785, lon_deg=-84.2190)
    vehicles = (first, dataclasses.replace(second, home=own))
    given = load_site(dataclasses.replace(site.scenario, vehicles=vehicles))
    outcome = plan(given, tmp_path / "run")
    assert [vehicle.home for vehicle in outcome.site.scenario.vehicles] == [first.home, own]
    assert len(outcome.plan.chosen.route.parts) == 2


def test_no_room_is_said_before_the_search(tmp_path: Path) -> None:
    site = corner(tmp_path, 3, max_pad_slope_deg=0.5)
    with pytest.raises(ScenarioError, match=r"beside \[home\] there is room for only 1 of 3 pads"):
        plan(site, tmp_path / "run")
    assert not (tmp_path / "run" / "plan.json").exists()


def test_a_small_battery_or_another_rule_is_split_along_one_route(tmp_path: Path) -> None:
    site = corner(tmp_path, 2)
    vehicle = dataclasses.replace(site.scenario.vehicle, endurance_s=60.0)
    small = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=vehicle))
    assert is_one_flight_each(site)
    assert not is_one_flight_each(small)
    outcome = plan(site, tmp_path / "run", select="max-coverage")
    assert outcome.plan.chosen.route.begins == ()
    assert len(outcome.site.scenario.vehicles) == 2
    assert judging_map(outcome.site).grid.count > 0
