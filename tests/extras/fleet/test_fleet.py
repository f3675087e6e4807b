"""A plan for several vehicles in a run folder: who flies what, the files, another choice, and exports of it."""

import dataclasses
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.missions.test_sorties import there_and_back
from tests.planner.sites import hills, make_site
from uavcover.missions.flights import compile_flights
from uavcover.missions.objectives import judge
from uavcover.model.route import Plan, RouteMember
from uavcover.model.vehicle import Fleet
from uavcover.planner.plan_files import fleet_document, print_fleet, save_plan
from uavcover.run.documents import read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map


class Listener(Unattended):
    """Keeps what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def say(self, line: str = "") -> None:
        self.lines.append(line)

    def warn(self, line: str) -> None:
        self.lines.append(line)


def fleet_site(vehicles: int, **changes: float) -> Site:
    site = make_site(hills, vehicle={"endurance_s": 300.0})
    fleet = Fleet(vehicles=vehicles, turnaround_s=60.0, **changes)
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=fleet))


def test_a_plan_of_three_vehicles(tmp_path: Path) -> None:
    site = fleet_site(3)
    route = there_and_back(site, lines=8)
    flights = compile_flights(site, route)
    document = fleet_document(site, flights)
    assert document is not None
    ends = [(f.start_s or 0.0) + f.compiled.flight_time_s for f in flights]
    assert document["makespan_s"] == max(ends)
    total_s = math.fsum(f.compiled.flight_time_s for f in flights)
    assert document["one_vehicle_s"] == pytest.approx(total_s + 60.0 * (len(flights) - 1))
    assert document["of_one_vehicle"] < 0.75
    assert sorted(n for row in document["by_vehicle"] for n in row["sorties"]) == list(range(1, len(flights) + 1))
    for row in document["by_vehicle"]:
        used = [flights[n - 1].compiled.battery_used for n in row["sorties"]]
        assert row["least_battery_left"] == pytest.approx(
            1.0 - max(fraction for fraction in used if fraction is not None)
        )
        assert row["least_battery_left"] >= 0.2
        assert row["takeoffs_s"] == sorted(row["takeoffs_s"])

    member = RouteMember(route, judge(judging_map(site), route), 0.0, "test")
    plan = Plan(member, (member,), (), "knee", True, "test", 1, 0.0)
    run = RunFolder(tmp_path / "run")
    run.path.mkdir()
    save_plan(
        run, site, plan, compiled=None, autopilot="ardupilot", seed=1, command=["test"], sorties=flights, fleet=document
    )
    written = json.loads(run.file("plan.json").read_text())
    assert written["fleet"] == document
    assert [row["vehicle"] for row in written["sorties"]] == [f.vehicle for f in flights]
    assert [row["takeoff_s"] for row in written["sorties"]] == [f.start_s for f in flights]
    assert read_plan_document(written, source="x").vehicles == 3
    for number, (folder, flight) in enumerate(zip(run.sorties(), flights, strict=True), start=1):
        # A sortie is one flight of one vehicle: whoever reads its folder does not cut it again.
        own = json.loads(folder.file("plan.json").read_text())
        assert own["fleet"] is None
        assert read_plan_document(own, source="x").vehicles == 1
        assert f"vehicle {flight.vehicle}, sortie {number}" in folder.file("mission.kml").read_text()
    assert "vehicles = 3" in run.file("scenario.toml").read_text()


def test_what_is_said_of_the_vehicles() -> None:
    site = fleet_site(2)
    flights = compile_flights(site, there_and_back(site, lines=8))
    user = Listener()
    print_fleet(user, fleet_document(site, flights))
    *rows, total = user.lines
    assert [row.split()[:2] for row in rows] == [["vehicle", "1"], ["vehicle", "2"]]
    assert total.startswith("2 vehicles: mission completed after ")
    assert "with one vehicle and the same sorties: " in total


def test_one_vehicle_has_nothing_to_say() -> None:
    site = fleet_site(1)
    user = Listener()
    print_fleet(user, fleet_document(site, compile_flights(site, there_and_back(site))))
    assert user.lines == []
    assert all(flight.start_s is None for flight in compile_flights(site, there_and_back(site)))


def test_more_vehicles_than_help_are_told() -> None:
    site = fleet_site(4, start_error_s=400.0)
    flights = compile_flights(site, there_and_back(site, lines=2))
    document = fleet_document(site, flights)
    assert document is not None
    user = Listener()
    print_fleet(user, document)
    used = len(document["by_vehicle"])
    assert (f"{used} of 4 vehicles" in " ".join(user.lines)) == (used < 4)
    assert used < 4


def test_a_fleet_without_a_mission() -> None:
    site = fleet_site(2)
    document = fleet_document(site, ())
    paths = {"one_at_a_time": False, "launch_points": False}
    assert document == {"vehicles": 2, "alike": True, "separation_m": 20.0, **paths}
    user = Listener()
    print_fleet(user, document)
    assert user.lines == []


def test_the_whole_route_is_flown_once() -> None:
    site = fleet_site(3)
    route = there_and_back(site, lines=8)
    flights = compile_flights(site, route)
    assert (flights[0].first, flights[-1].last) == (0, len(route) - 1)
    assert all(b.first == a.last for a, b in itertools.pairwise(flights))
    assert np.array_equal(flights[1].route.waypoints_m, route.waypoints_m[flights[1].first : flights[1].last + 1])
