"""Vehicles that differ, each from its own home: planned, flown, judged, and what one leaves taken over from another home."""

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import corner_of_the_demo
from tests.extras.fleet.lockstep import Hangar
from tests.extras.fleet.scripted_fleet import fly_script, job
from tests.extras.fleet.test_fleet import Listener
from tests.extras.fleet.test_fly_fleet import (
    all_land_and_pass,
    copied,
    fly,
    judged,
    lines_over,
    lost_at,
    mock,
    no_recording_of_single_flights,
    plan_for,
)
from uavcover.errors import InfeasibleError, InputError, ScenarioError
from uavcover.extras.exports.export import ExportRequest, export_mission
from uavcover.extras.fleet.command import FleetFailedError, first_sorties
from uavcover.extras.fleet.jobs import OnLoss, planned_jobs
from uavcover.flight.connect import home_of
from uavcover.missions.flights import compile_flights
from uavcover.missions.mission_compiler import compile_mission
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.limits import Home, NoFly
from uavcover.planner.plan_files import fleet_document, print_fleet
from uavcover.planner.sortie_order.reorder import _done_s
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import vehicle_sites
from uavcover.verification.command import verify_run

assert no_recording_of_single_flights  # a fixture that every flight here uses
FAR = Home(lat_deg=36.4785, lon_deg=-84.2190)


def unlike_site(folder: Path, homes: list[Home | None], **changes: Any) -> Site:
    """The corner of the demo for vehicles at these homes, the second one with changes."""
    scenario = load_scenario(corner_of_the_demo(folder))
    vehicles = [
        dataclasses.replace(
            scenario.vehicle,
            **{"endurance_s": 400.0, "home": home or scenario.home, **(changes if number == 1 else {})},
        )
        for number, home in enumerate(homes)
    ]
    fleet = dataclasses.replace(
        scenario.fleet, vehicles=len(homes), turnaround_s=60.0, start_error_s=2.0, timing_error_fraction=0.04
    )
    return load_site(
        dataclasses.replace(
            scenario, vehicle=dataclasses.replace(vehicles[0], home=None), vehicles=tuple(vehicles), fleet=fleet,
            area=dataclasses.replace(scenario.area, cell_size_m=10.0),
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Vehicle 1 is an ArduPilot at the demo's home, vehicle 2 a PX4 at the other corner."""
    folder = tmp_path_factory.mktemp("unlike")
    site = unlike_site(folder, [None, FAR], autopilot="px4")
    return plan_for(folder / "run", site, lines_over(site))


def test_each_takes_off_and_lands_at_its_own_home(planned: RunFolder) -> None:
    document = json.loads(planned.file("plan.json").read_text())
    assert document["fleet"]["alike"] is False
    assert [row["vehicle"] for row in document["fleet"]["by_vehicle"]] == [1, 2]
    homes = document["fleet"]["homes"]
    assert homes[1]["lat_deg"] == pytest.approx(FAR.lat_deg)
    frames = set()
    for each in planned_jobs(planned, 2):
        home = homes[each.vehicle - 1]
        kept = json.loads((each.folder.path / "mission.plan").read_text())
        assert kept["mission"]["firmwareType"] == {1: 3, 2: 12}[each.vehicle]
        assert kept["mission"]["plannedHomePosition"][:2] == pytest.approx([home["lat_deg"], home["lon_deg"]], abs=1e-7)
        rally = kept["rallyPoints"]["points"]
        assert all(point[:2] == pytest.approx([home["lat_deg"], home["lon_deg"]], abs=1e-3) for point in rally)
        assert each.site.frame is not None
        begins = each.site.frame.geodetic_from_enu(each.timeline.position_m[[0, -1]])
        assert np.allclose(begins[0], home["lat_deg"], atol=1e-7)
        assert np.allclose(begins[1], home["lon_deg"], atol=1e-7)
        frames.add(each.site.frame)
    assert len(frames) == 1  # the waypoints of all are in one frame


def test_one_vehicle_flies_one_flight_at_a_time_from_its_launch_points(tmp_path: Path) -> None:
    scenario = unlike_site(tmp_path, [None, FAR]).scenario
    fleet = dataclasses.replace(scenario.fleet, one_at_a_time=True)
    vehicles = [dataclasses.replace(vehicle, endurance_s=250.0) for vehicle in scenario.vehicles]
    one = dataclasses.replace(vehicles[0], home=None)
    site = load_site(dataclasses.replace(scenario, fleet=fleet, vehicles=tuple(vehicles), vehicle=one))
    assert site.scenario.has_launch_points
    route = lines_over(site)
    flights = compile_flights(site, route)
    alone = [compile_flights(own, route, vehicles=1) for own in vehicle_sites(site)]
    assert [len(each) for each in (flights, *alone)] == [3, 4, 4]
    flown_s = sum(flight.compiled.flight_time_s for flight in flights)
    assert flown_s < 0.9 * min(sum(flight.compiled.flight_time_s for flight in each) for each in alone)
    # Each takes off after the landing before and the change of battery, those from one place one after the other.
    ordered = sorted(flights, key=lambda flight: flight.start_s or 0.0)
    assert [flight.vehicle for flight in ordered] == sorted(flight.vehicle for flight in flights)
    assert {flight.vehicle for flight in flights} == {1, 2}
    for before, after in itertools.pairwise(ordered):
        assert before.start_s is not None
        assert after.start_s == pytest.approx(before.start_s + before.compiled.flight_time_s + 60.0)
    for flight in flights:
        home = vehicle_sites(site)[flight.vehicle - 1].home_m
        assert flight.compiled.path_m[[0, -1], :2] == pytest.approx(np.tile(home[:2], (2, 1)), abs=0.01)
    # Another order of the legs is held against all flights one after the other, too.
    done_s = max(flight.start_s + flight.compiled.flight_time_s for flight in ordered if flight.start_s is not None)
    assert _done_s(site, route) == pytest.approx((done_s, flown_s))
    # It is one vehicle: it has one link, and the words are those of places.
    run, user = plan_for(tmp_path / "run", site, route), Listener()
    for refuse in (lambda: first_sorties(run, 2), lambda: planned_jobs(run, 2)):
        with pytest.raises(InputError, match=r"one sortie at a time; use one --to, and --sortie N"):
            refuse()
    print_fleet(user, fleet_document(site, flights))
    assert [line.split("sorties")[0].strip() for line in user.lines[:2]] == ["from home", "from launch point 1"]
    assert user.lines[2].startswith("one sortie at a time: mission completed after ")


def test_it_is_flown_and_judged_by_each_ones_home(planned: RunFolder, tmp_path: Path) -> None:
    run, _, document = all_land_and_pass(planned, tmp_path, 2)
    assert not document["findings"]  # such as a take-off far from the scenario's home
    assert document["separation"]
    (tmp_path / "log.csv").write_bytes((run.path / "sortie-1" / "track.csv").read_bytes())
    with pytest.raises(InputError, match="the log does not show which one flew it"):
        verify_run(run, Listener(), command=["test"], logs=[tmp_path / "log.csv"])


def test_what_one_leaves_is_taken_over_from_another_home(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    with pytest.raises(FleetFailedError) as failed:
        fly(run, Hangar(2, lost_at(6, number=2)), user)
    rows = failed.value.details()["sorties"]
    assert {row["vehicle"]: row["ending"] for row in rows if row["ending"] != "landed"} == {2: "crashed"}
    assert any("vehicle 1 flies the remaining part of sortie" in line for line in user.lines)
    rest = next(row for row in rows if "resumed-1" in row["run"])
    taken = load_scenario(Path(rest["run"]) / "scenario.toml")
    assert (taken.home, taken.vehicle.autopilot) == (load_scenario(run.file("scenario.toml")).home, "ardupilot")
    document = judged(run)
    assert document["coverage_fraction"] >= 0.98 * document["planned_coverage_fraction"]
    assert all(pair["least_m"] >= 20.0 for pair in document["separation"])


def test_what_one_leaves_is_a_checked_gap_mission(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    with pytest.raises(FleetFailedError) as failed:
        fly(run, Hangar(2, lost_at(6, number=2)), user, on_loss=OnLoss.GAPS)
    reported = failed.value.details()
    assert len(reported["left"]) == 1
    assert any("planning a gap mission for the remaining route of the lost vehicle" in line for line in user.lines)
    gaps = RunFolder(run.path / "gaps")
    assert reported["gaps"]["gaps"] > 0
    site, mission = read_planned(gaps)
    compile_mission(site, mission.route)  # every leg is checked
    assert (gaps.path / "mission.waypoints").read_text().startswith("QGC WPL")
    assert home_of(site) == home_of(vehicle_sites(site)[0])  # it is vehicle 1's


def test_links_in_another_order_are_refused(planned: RunFolder, tmp_path: Path) -> None:
    sites = {each.vehicle: each.site for each in planned_jobs(planned, 2)}

    def swapped(number: int, sortie: int, _: Site) -> MockVehicle:
        return mock(number, sortie, sites[3 - number])

    run = copied(planned, tmp_path)
    with pytest.raises(
        FleetFailedError,
        match=r"leads to px4, but vehicle 1 is planned for ardupilot; give the --to options in the order",
    ):
        fly(run, Hangar(2, swapped), Listener())

    def elsewhere(number: int, sortie: int, site: Site) -> MockVehicle:
        return mock(number, sortie, site, position=home_of(sites[3 - number]))

    hangar = Hangar(2, elsewhere)
    with pytest.raises(
        FleetFailedError,
        match=r"it stands at the home of vehicle 2; give the --to options in the order of the vehicles",
    ):
        fly(run, hangar, Listener())
    assert all(vehicle.took_off_at_s is None for flown in hangar.flown.values() for vehicle in flown)


def test_homes_a_metre_apart_share_their_column(tmp_path: Path) -> None:
    near = Home(lat_deg=36.4762 + 9e-6, lon_deg=-84.2160)
    site = unlike_site(tmp_path, [None, near])
    flights = compile_flights(site, lines_over(site))
    assert {flight.vehicle for flight in flights} == {1, 2}
    first, second = sorted(flights, key=lambda flight: flight.start_s or 0.0)
    # The second one waits until the first one has surely left the column, and lands when nobody stands there.
    assert (second.start_s or 0.0) - (first.start_s or 0.0) > 30.0
    ends = sorted((f.start_s or 0.0) + f.compiled.flight_time_s for f in flights)
    assert ends[1] - ends[0] > 30.0


def test_a_vehicle_that_reaches_nothing_stays_on_the_ground(tmp_path: Path) -> None:
    site = unlike_site(tmp_path, [None, FAR, None], endurance_s=60.0)
    route = lines_over(site, rows=4)
    flights = compile_flights(site, route)
    assert {flight.vehicle for flight in flights} == {1, 3}
    document, listener = fleet_document(site, flights), Listener()
    print_fleet(listener, document)
    assert any(line.startswith("vehicle 2  stays on the ground") for line in listener.lines)
    run = plan_for(tmp_path / "run", site, route)
    assert {each.vehicle for each in planned_jobs(run, 3)} == {1, 3}
    assert [row.vehicle for row in first_sorties(run, 3)] == [1, 3]
    with pytest.raises(InputError, match=r"the plan is for 3 vehicles, but --to is given 2 times"):
        planned_jobs(run, 2)
    with pytest.raises(InputError, match=r"the 3 vehicles differ, but --to is given 2 times; specify a link for each"):
        first_sorties(run, 2)


def test_nobody_looks_for_a_vehicle_that_stays_on_the_ground(tmp_path: Path) -> None:
    reported = fly_script([job(tmp_path, 1, 1, 0.0), job(tmp_path, 2, 3, 0.0)], {})
    assert reported.landed() == {"001", "002"}
    assert reported.flight.board.rows[2].does == "stays on the ground"


def test_a_part_that_nobody_reaches_is_named(tmp_path: Path) -> None:
    site = unlike_site(tmp_path, [Home(lat_deg=36.4785, lon_deg=-84.2159), FAR], endurance_s=40.0)
    poor = dataclasses.replace(site.scenario.vehicles[0], endurance_s=45.0)
    scenario = dataclasses.replace(site.scenario, vehicles=(poor, site.scenario.vehicles[1]))
    site = dataclasses.replace(site, scenario=scenario)
    with pytest.raises(InfeasibleError, match=r"vehicle\.endurance_s is 45 s.*; or .*vehicle\.endurance_s is 40 s"):
        compile_flights(site, lines_over(site))


def test_a_home_that_cannot_be_names_its_vehicle(tmp_path: Path) -> None:
    site = unlike_site(tmp_path, [None, FAR])
    ring = ((-84.2195, 36.478), (-84.2185, 36.478), (-84.2185, 36.479), (-84.2195, 36.479))
    closed = dataclasses.replace(site.scenario, no_fly=(NoFly(name="school", polygon_lon_lat_deg=ring),))
    with pytest.raises(ScenarioError, match=r"^\[\[vehicle\]\] number 2: home: lies in no-fly zone 'school'"):
        vehicle_sites(load_site(closed))


def test_one_file_for_flights_from_several_homes_is_refused(planned: RunFolder, tmp_path: Path) -> None:
    request = ExportRequest(file_format="csv", out=tmp_path / "x.csv", most_points=20)
    with pytest.raises(InputError, match="export one flight at a time, with --sortie N"):
        export_mission(planned, request)


def test_equal_vehicles_have_no_site_of_their_own(tmp_path: Path) -> None:
    site = load_site(load_scenario(corner_of_the_demo(tmp_path)))
    assert vehicle_sites(site) == ()
    with pytest.raises(ScenarioError, match=r"there are 2 different \[\[vehicle\]\] tables"):
        unlike_site(tmp_path, [None, FAR]).flown_by(3)
