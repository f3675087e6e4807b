"""All vehicles of a plan fly at once: at their times, apart from each other, and what one leaves the others fly."""

import dataclasses
import itertools
import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.items import GeoPoint
from tests.cli.conftest import corner_of_the_demo
from tests.extras.fleet.lockstep import Hangar, Seat
from tests.extras.fleet.test_fleet import Listener
from uavcover.errors import InputError
from uavcover.extras.fleet.command import FleetFailedError, FleetOptions, fly_fleet
from uavcover.extras.fleet.jobs import planned_jobs
from uavcover.flight.command import FlightOptions
from uavcover.flight.connect import VehicleLink, home_of
from uavcover.missions.flights import compile_flights
from uavcover.missions.objectives import judge
from uavcover.mock.behaviour import Settings, quick
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.faults import Fault, FaultKind, FaultTrigger, Since
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.vehicle import Fleet
from uavcover.planner.plan_files import fleet_document, save_plan
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.recording.layout import describe_recording
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.command import verify_run


def plan_for(folder: Path, site: Site, route: Any) -> RunFolder:
    flights = compile_flights(site, route)
    member = RouteMember(route, judge(judging_map(site), route), 0.0, "test")
    plan = Plan(member, (member,), (), "knee", True, "test", 1, 0.0)
    run = RunFolder(folder)
    folder.mkdir(exist_ok=True)
    save_plan(
        run, site, plan, compiled=None, autopilot="ardupilot", seed=1, command=["test"], sorties=flights,
        fleet=fleet_document(site, flights),
    )  # fmt: skip
    return run


def mock(number: int, sortie: int, site: Site, position: GeoPoint | None = None, **config: Any) -> MockVehicle:
    """The vehicle of a site, at its home or elsewhere, with a battery that lasts a day."""
    vehicle = site.scenario.vehicle
    return MockVehicle(
        PX4 if vehicle.autopilot == "px4" else ARDUPILOT,
        position or home_of(site),
        MockConfig(settings=Settings.for_vehicle(vehicle), battery=BatteryData(), system_id=number, **config),
        rng=np.random.default_rng(10 * number + sortie),
    )


def lines_over(site: Site, rows: int = 6) -> Route:
    west, south, east, north = site.area.bounds
    across = np.linspace(south + 25.0, north - 25.0, rows)
    corners = [(e, n) for k, n in enumerate(across) for e in ((east, west), (west, east))[k % 2]]
    return Route(lay_over_terrain(site, np.array(corners), np.full(len(corners), 60.0), tolerance_m=8.0))


@pytest.fixture(autouse=True)
def no_recording_of_single_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    """tests/cli/test_fly.py looks at these; here they would take most of the time."""
    monkeypatch.setattr("uavcover.flight.command.live_recording", lambda *_, **__: None)
    monkeypatch.setattr("uavcover.flight.command._keep_recording", lambda *_: None)


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A corner of the demo, in lines over its ground, for two vehicles with three sorties."""
    folder = tmp_path_factory.mktemp("fleet")
    scenario = load_scenario(corner_of_the_demo(folder))
    vehicle = dataclasses.replace(scenario.vehicle, endurance_s=250.0)
    fleet = Fleet(vehicles=2, turnaround_s=60.0, start_error_s=2.0, timing_error_fraction=0.04)
    area = dataclasses.replace(scenario.area, cell_size_m=10.0)
    site = load_site(dataclasses.replace(scenario, vehicle=vehicle, fleet=fleet, area=area))
    return plan_for(folder / "run", site, lines_over(site))


def copied(run: RunFolder, tmp_path: Path) -> RunFolder:
    return RunFolder(shutil.copytree(run.path, tmp_path / "run"))


def fly(run: RunFolder, hangar: Hangar, user: Listener, **options: Any) -> tuple[bool, dict[str, Any]]:
    flight = FlightOptions(utc_offset_s=0.0)
    requested = FleetOptions(flight=flight, opening=hangar.open, clocks=hangar.clocks, **options)
    return fly_fleet(run, hangar.links(), user, requested, command=["test"])


class Presses(Listener):
    """Asks to stop at these times of a clock."""

    def __init__(self, seat: Seat, *times_s: float) -> None:
        super().__init__()
        self._seat, self._times_s = seat, times_s

    @property
    def count(self) -> int:
        return sum(self._seat.now() >= time_s for time_s in self._times_s)

    @contextmanager
    def stop_requests(self, first: str) -> Iterator[Any]:
        del first
        yield self


def judged(run: RunFolder) -> dict[str, Any]:
    return verify_run(run, Listener(), command=["test"])[1]


def all_land_and_pass(planned: RunFolder, tmp_path: Path, vehicles: int) -> tuple[RunFolder, Listener, dict[str, Any]]:
    """A copy of a planned run that its vehicles fly, what the user was told, and the verdict, which is "passed"."""
    run, user = copied(planned, tmp_path), Listener()
    ended, reported = fly(run, Hangar(vehicles, mock), user)
    assert not ended
    assert {row["ending"] for row in reported["sorties"]} == {"landed"}
    document = judged(run)
    assert document["verdict"] == "passed", document["reasons"] + document["doubts"]
    return run, user, document


def lost_at(wire_item: int, *, number: int) -> Callable[[int, int, Site], MockVehicle]:
    """The vehicle with this number falls out of the sky, without power, when it flies to an item of its first sortie."""

    def make(vehicle: int, sortie: int, site: Site) -> MockVehicle:
        fault = Fault(FaultKind.FORCE_DISARM, FaultTrigger(Since.ITEM, wire_item))
        faults = [fault] if (vehicle, sortie) == (number, 0) else []
        # With a new battery it takes a while until it knows where it is.
        return mock(vehicle, sortie, site, faults=faults, behaviour=quick(30.0 if sortie else 2.0))

    return make


def test_what_a_lost_vehicle_leaves_is_flown_by_the_other(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    hangar = Hangar(2, lost_at(7, number=2))
    with pytest.raises(FleetFailedError) as failed:
        fly(run, hangar, user)
    rows = failed.value.details()["sorties"]
    assert [row["ending"] for row in rows if row["vehicle"] == 2] == ["crashed"]
    by_first = [row for row in rows if row["vehicle"] == 1]
    assert {row["sortie"] for row in rows} == {row["sortie"] for row in by_first if row["ending"] == "landed"}
    assert any("flies the remaining part of sortie" in line for line in user.lines)
    assert [row["error"] for row in by_first] == [None] * len(by_first)
    # A vehicle is ready again after its battery was changed.
    begins = sorted((row["began_s"], row["duration_s"]) for row in by_first)
    assert all(b[0] >= a[0] + a[1] + 60.0 - 10.0 for a, b in itertools.pairwise(begins))
    document = judged(run)
    assert document["coverage_fraction"] >= 0.98 * document["planned_coverage_fraction"]
    assert all(pair["least_m"] >= 20.0 for pair in document["separation"])
    assert document["separation"]
    assert not [v for v in document["violations"] if v["kind"] == "separation"]
    assert run.file("fleet.rrd").stat().st_size > 10_000
    entities = {row.entity for row in describe_recording(run.file("fleet.rrd"))}
    assert sum(entity.startswith("/world/flown/") for entity in entities) == len(rows)


@pytest.mark.long
def test_equal_seeds_equal_flights(planned: RunFolder, tmp_path: Path) -> None:
    tracks = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        run = copied(planned, tmp_path / name)
        fly(run, Hangar(2, mock), Listener())
        tracks.append([sortie.file("track.csv").read_bytes() for sortie in run.sorties()])
    assert tracks[0] == tracks[1]


def test_ctrl_c_brings_all_home_one_after_the_other(planned: RunFolder, tmp_path: Path) -> None:
    run = copied(planned, tmp_path)
    hangar = Hangar(2, mock)
    rows = json.loads(run.file("plan.json").read_text())["fleet"]["by_vehicle"]
    second_s = sorted(row["takeoffs_s"][0] for row in rows)[1]
    user = Presses(hangar.clocks[0], 14.0 + second_s + 40.0)
    ended, document = fly(run, hangar, user)
    assert ended
    assert {row["ending"] for row in document["sorties"]} == {"returned"}
    assert not any(vehicle.armed for flown in hangar.flown.values() for vehicle in flown)
    verdict = judged(run)
    assert [pair["least_m"] >= 20.0 for pair in verdict["separation"]] == [True]
    # They come home one after the other: the second one sets out when the first one has landed.
    tracks = [read_track(Path(row["run"]) / "track.csv") for row in document["sorties"]]
    first, second = sorted(tracks, key=lambda track: track.received_utc_s[-1])
    at_last = second.received_utc_s > first.received_utc_s[-1]
    moved = np.linalg.norm(second.enu_m[at_last] - second.enu_m[at_last][0], axis=1)
    assert moved.max() > 30.0
    holds = (second.received_utc_s > first.received_utc_s[-1] - 15.0) & ~at_last
    assert np.ptp(second.enu_m[holds], axis=0).max() < 3.0


@pytest.mark.long
def test_ctrl_c_twice_leaves_all_holding(planned: RunFolder, tmp_path: Path) -> None:
    run, hangar = copied(planned, tmp_path), Hangar(2, mock)
    ended, document = fly(run, hangar, Presses(hangar.clocks[0], 60.0, 70.0))
    assert ended
    assert {row["ending"] for row in document["sorties"]} <= {"left_holding", "not_flown"}
    assert any(vehicle.armed for flown in hangar.flown.values() for vehicle in flown)


def test_two_links_to_one_vehicle_are_noticed(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()
    one: list[MockVehicle] = []

    def same(_: int, __: int, site: Site) -> MockVehicle:
        one.append(one[0] if one else mock(1, 0, site))
        return one[0]

    with pytest.raises(FleetFailedError, match="may lead to one vehicle; no vehicle was armed"):
        fly(run, Hangar(2, same), user)
    assert not one[0].armed
    assert not any(sortie.file("track.csv").exists() for sortie in run.sorties())


def test_one_that_is_not_ready_keeps_all_on_the_ground(planned: RunFolder, tmp_path: Path) -> None:
    run, user = copied(planned, tmp_path), Listener()

    def make(number: int, sortie: int, site: Site) -> MockVehicle:
        vehicle = mock(number, sortie, site)
        if number == 2:
            vehicle.body.home = dataclasses.replace(vehicle.body.home, lat_deg=vehicle.body.home.lat_deg + 0.01)
        return vehicle

    hangar = Hangar(2, make)
    with pytest.raises(FleetFailedError, match="vehicle 2, sortie"):
        fly(run, hangar, user)
    assert "one vehicle is not ready, so no vehicle was started" in user.lines
    assert not any(vehicle.armed for flown in hangar.flown.values() for vehicle in flown)
    assert not any(sortie.file("track.csv").exists() for sortie in run.sorties())


def test_the_plan_is_for_another_number_of_vehicles(planned: RunFolder, tmp_path: Path) -> None:
    run = copied(planned, tmp_path)
    with pytest.raises(
        InputError, match=r"the plan is for 2 vehicles, but --to is given 3 times; use --to 2 times, or plan again"
    ):
        planned_jobs(run, 3)
    document = json.loads(run.file("plan.json").read_text())
    document["fleet"]["vehicles"] = 3
    run.file("plan.json").write_text(json.dumps(document))
    # It said to plan for three, for whom it was planned.
    with pytest.raises(InputError, match=r"use --to 2 times; more vehicles would not finish sooner$"):
        planned_jobs(run, 3)
    document["sorties"][0]["vehicle"] = 7
    run.file("plan.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"the sorties' vehicles must be 1 to 2"):
        planned_jobs(run, 2)
    document["sorties"][0]["takeoff_s"] = None
    run.file("plan.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"plan.json: cannot read the key sorties \(TypeError"):
        planned_jobs(run, 2)


def test_fast_mocks_among_other_vehicles(planned: RunFolder) -> None:
    links = [VehicleLink(url="mock:", mock_speed=20.0), VehicleLink(url="udp:127.0.0.1:1")]
    with pytest.raises(InputError, match="only at --mock-speed 1"):
        fly_fleet(planned, links, Listener(), FleetOptions(flight=FlightOptions()), command=["test"])
