"""A flight that ended early, and the one that goes on with it: together they see what was planned, and keep the limits.

MIS_RESTART=1: entering AUTO begins the mission anew, so the item is set after that, and verified.
"""

import dataclasses
import itertools
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.enums import CommandResult
from tests.flight.scene import Scene, make_scene, mission, plan_for, presses, return_mission
from tests.planner.sites import hills, make_site
from uavcover.errors import InputError
from uavcover.flight.command import commands_after_flight
from uavcover.flight.compiled_flight import fly, upload
from uavcover.flight.connect import Connected, home_of, is_in_the_air
from uavcover.flight.monitor import open_vehicle
from uavcover.flight.orders import Orders
from uavcover.flight.resume import (
    Continuation,
    find_unfinished,
    fly_from_the_air,
    fly_on,
    save_rest,
    take_over,
    took_off_s,
)
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.mission_compiler import AUTOPILOTS, compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import Battery, BatteryData
from uavcover.mock.faults import parse_fault
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Plan, Route
from uavcover.model.track import Ending, FlightEvent, FlightFailedError, FlightOutcome, TrackSample
from uavcover.model.vehicle import AutopilotName
from uavcover.model.verdict import VerificationReport
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.close_gaps import plan_gap_mission, save_gap_mission
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import flights_of, flown_tracks
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import inspect_inputs
from uavcover.run.track_file import TrackWriter, read_track
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_map
from uavcover.verification.command import judge_tracks
from uavcover.verification.run_logs import planned_for, read_planned_route


class Killed(BaseException):
    """The client's end in the middle of what it does."""


@pytest.fixture(scope="module")
def site() -> Site:
    return make_site(hills, limits={"height_margin_m": 5.0, "transit_clearance_m": 30.0})


@pytest.fixture(scope="module")
def planned(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with a plan of three lines."""
    run = RunFolder(tmp_path_factory.mktemp("planned") / "run")
    run.path.mkdir()
    layout = regular_layout(angle_rad=0.0, lines=3, height_agl_m=80.0, inset=0.0, tolerance_m=10.0)
    route = fly_layout(site, layout)
    member = judge_member(judging_map(site), route, "lines", margin_m=0.0)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="none", rule_met=True, algorithm="lines", evaluations=0,
        wall_s=0.0,
    )  # fmt: skip
    save_plan(run, site, plan, compiled=compile_mission(site, route), autopilot="ardupilot", seed=0, command=["test"])
    return run.path


class Field:
    """A vehicle at home, and ground stations that come and go."""

    def __init__(self, site: Site, run: Path, *faults: str, autopilot: AutopilotName = "ardupilot") -> None:
        self.site, self.run, self.autopilot = site, RunFolder(run), autopilot
        home = home_of(site)
        assert home is not None
        self.vehicle = MockVehicle(
            AUTOPILOTS[autopilot],
            home,
            MockConfig(
                settings=Settings.for_vehicle(site.scenario.vehicle), faults=[parse_fault(fault) for fault in faults]
            ),
        )
        self.link = SimulatedLink(InMemoryPeer(self.vehicle), rng=Random(1), conditions=Conditions(delay_s=0.002))
        self.said: list[str] = []

    def connected(self) -> Connected:
        client, monitor = open_vehicle(self.link)
        vehicle = client.wait_for_vehicle()
        monitor.listen_to(vehicle.address)
        return Connected(client, monitor, self.autopilot)

    def nobody_listens_for(self, seconds: float) -> None:
        until_s = self.link.clock.now() + seconds
        while self.link.clock.now() < until_s:
            self.link.receive(0.1)

    def fly(self, *, stop: Callable[[], int] = lambda: 0, killed_after: int = 10**9) -> FlightOutcome | None:
        """The planned flight; None when its client was killed."""
        station = self.connected()
        planned = read_planned_route(self.run)
        assert planned is not None
        compiled = compile_mission(self.site, Route(planned.waypoints_m), autopilot=self.autopilot)
        upload(station.client, compiled)
        return self.recorded(
            self.run, lambda orders: fly(station, self.site, compiled, orders), stop=stop, killed_after=killed_after
        )

    def resume(self, *, killed_after: int = 10**9) -> FlightOutcome | None:
        """What is left, from wherever the vehicle is."""
        station = self.connected()
        unfinished = find_unfinished(self.run, self.site)
        unfinished.folder.path.mkdir(exist_ok=True)
        save_rest(unfinished, self.site, command=["test"])
        if is_in_the_air(station):
            return self.recorded(
                unfinished.folder,
                lambda orders: fly_on(station, self.site, unfinished, orders),
                killed_after=killed_after,
            )
        compiled = compile_mission(self.site, unfinished.route, autopilot=self.autopilot)
        upload(station.client, compiled)
        return self.recorded(
            unfinished.folder, lambda orders: fly(station, self.site, compiled, orders), killed_after=killed_after
        )

    def recorded(
        self,
        folder: RunFolder,
        begin: Callable[[Orders], FlightOutcome],
        *,
        stop: Callable[[], int] = lambda: 0,
        killed_after: int,
    ) -> FlightOutcome | None:
        with TrackWriter(folder.file("track.csv"), overwrite=True) as track:

            def take(sample: TrackSample) -> None:
                track.write(sample)
                if track.count == killed_after:
                    raise Killed

            def note(event: FlightEvent) -> None:
                self.said.append(event.text)

            try:
                return begin(Orders(on_sample=take, on_event=note, stop=stop))
            except FlightFailedError as error:
                return error.outcome
            except Killed:
                return None

    def report(self) -> VerificationReport:
        tracks = [(read_track(path), planned_for(path, self.run)) for path in flown_tracks(self.run)]
        return judge_tracks(self.site, tracks).report


@pytest.fixture
def run(planned: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(planned, tmp_path / "run"))


@pytest.fixture(scope="module")
def undisturbed(site: Site, planned: Path, tmp_path_factory: pytest.TempPathFactory) -> VerificationReport:
    field = Field(site, Path(shutil.copytree(planned, tmp_path_factory.mktemp("whole") / "run")))
    outcome = field.fly()
    assert outcome is not None
    assert outcome.ending is Ending.LANDED
    assert field.report().violations == ()
    return field.report()


def check_together(field: Field, undisturbed: VerificationReport, flights: int) -> None:
    report = field.report()
    assert len(flown_tracks(field.run)) == flights
    assert report.coverage_fraction >= undisturbed.coverage_fraction - 0.002
    assert report.violations == ()
    assert find_unfinished(field.run, field.site).complete


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_after_a_failsafe_that_brought_it_back(site, run, undisturbed, autopilot):
    field = Field(site, run, "battery-failsafe@60s", autopilot=autopilot)
    first = field.fly()
    assert first is not None
    # ArduCopter waits BATT_LOW_TIMER before it acts; meanwhile fly sees that the reserve will not last, and flies it home.
    assert first.ending is (Ending.RESERVE_KEPT if autopilot == "ardupilot" else Ending.BATTERY_FAILSAFE)
    assert field.report().coverage_fraction < undisturbed.coverage_fraction - 0.1
    unfinished = find_unfinished(field.run, site)
    assert unfinished.broken.waypoint == first.waypoints_reached
    field.vehicle.body.battery = Battery(BatteryData())  # a fresh one
    second = field.resume()
    assert second is not None
    assert second.ending is Ending.LANDED
    check_together(field, undisturbed, 2)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_after_the_client_was_killed_in_the_air(site, run, undisturbed, autopilot):
    field = Field(site, run, autopilot=autopilot)
    assert field.fly(killed_after=700) is None
    field.nobody_listens_for(12.0)
    assert field.vehicle.mode is Mode.MISSION, "the vehicle flies on by itself"
    second = field.resume()
    assert second is not None
    assert second.ending is Ending.LANDED
    assert "uploading the remaining mission" in field.said
    check_together(field, undisturbed, 2)


def test_killed_twice(site, run, undisturbed):
    field = Field(site, run)
    assert field.fly(killed_after=600) is None
    assert field.resume(killed_after=300) is None
    third = field.resume()
    assert third is not None
    assert third.ending is Ending.LANDED
    check_together(field, undisturbed, 3)


def test_after_a_stop_that_brought_it_home(site, run, undisturbed):
    field = Field(site, run)
    first = field.fly(stop=lambda: int(field.vehicle.time_s > 80.0))
    assert first is not None
    assert first.ending is Ending.RETURNED
    assert commands_after_flight(field.run, first.ending, ["--to", "URL"]) == [
        f"uavcover fly {run} --resume --to URL",
        f"uavcover verify {run}",
    ]
    second = field.resume()
    assert second is not None
    assert second.ending is Ending.LANDED
    check_together(field, undisturbed, 2)
    check_logs_from_elsewhere(field)


def check_logs_from_elsewhere(field: Field) -> None:
    """A log of the flight that resumed, given from elsewhere, was judged by the whole route."""
    elsewhere = field.run.path.parent / "elsewhere"
    elsewhere.mkdir()
    for number, path in enumerate(flown_tracks(field.run)):
        log = Path(shutil.copy(path, elsewhere / f"log{number}.csv"))
        followed, own = planned_for(log, field.run, read_track(log)), planned_for(path, field.run)
        assert followed is not None
        assert own is not None
        assert followed.waypoints_m.tolist() == own.waypoints_m.tolist()
    hashes = inspect_inputs(field.run, [elsewhere / "log1.csv"]).hashes
    assert set(hashes["plans_followed"]) >= {"resumed-1/plan.json"}


def test_held_where_it_left_the_route_it_goes_on_with_the_mission_that_it_has(site, run, undisturbed):
    field = Field(site, run)
    assert field.fly(killed_after=700) is None
    held = field.vehicle.body.itinerary
    field.vehicle.body.point.rest(up_m=field.vehicle.body.point.position_m[2])
    field.vehicle.control.set_mode(Mode.GUIDED)
    assert held is not field.vehicle.body.itinerary
    second = field.resume()
    assert second is not None
    assert second.ending is Ending.LANDED
    assert "uploading the remaining mission" not in field.said
    check_together(field, undisturbed, 2)


def test_a_vehicle_that_a_failsafe_has_is_left_to_it(site, run):
    field = Field(site, run)
    assert field.fly(killed_after=700) is None
    field.vehicle.control.set_mode(Mode.RETURN)
    second = field.resume()
    assert second is not None
    assert second.ending is Ending.NOT_ARMED
    assert field.vehicle.mode is Mode.RETURN


def test_what_resumed_an_older_flight_does_not_count(site, run):
    field = Field(site, run)
    assert field.fly(killed_after=600) is None
    field.resume(killed_after=100)
    assert len(flights_of(field.run)) == 2
    track = field.run.file("track.csv")
    track.write_text("".join(track.read_text().splitlines(keepends=True)[:-5]))
    assert len(flights_of(field.run)) == 1


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_left_holding_it_closes_the_gaps_from_where_it_is_and_lands(site, run, undisturbed, autopilot):
    field = Field(site, run, autopilot=autopilot)
    first = field.fly(stop=lambda: 2 * int(field.vehicle.time_s > 110.0))
    assert first is not None
    assert first.ending is Ending.LEFT_HOLDING
    track = read_track(field.run.file("track.csv"))
    torn = (track, planned_for(field.run.file("track.csv"), field.run))
    before = judge_tracks(site, [torn])
    assert before.report.coverage_fraction < undisturbed.coverage_fraction - 0.1
    mission = plan_gap_mission(site, before, in_the_air=track)
    gaps = save_gap_mission(field.run, site, mission, command=["test"], force=False)
    station = field.connected()
    assert is_in_the_air(station)
    up_since_s = took_off_s(gaps)
    assert up_since_s == track.time_s[0]
    closed = field.recorded(
        gaps,
        lambda orders: fly_from_the_air(station, site, mission.repair.route, orders, up_since_s=up_since_s),
        killed_after=10**9,
    )
    assert closed is not None
    assert closed.ending is Ending.LANDED
    closing = gaps.file("track.csv")
    together = [torn, (read_track(closing), planned_for(closing, field.run))]
    report = judge_tracks(site, together).report
    assert report.coverage_fraction >= undisturbed.coverage_fraction
    assert report.violations == ()


def test_nothing_flown_is_nothing_to_resume(site, run):
    with pytest.raises(InputError, match=r"has no track.csv; create it with: uavcover fly \(without --resume\)"):
        find_unfinished(RunFolder(run), site)


def test_the_rest_of_a_route_breaks_no_limit(site, run):
    field = Field(site, run)
    field.fly(killed_after=700)
    unfinished = find_unfinished(field.run, site)
    assert measure_violations(site, unfinished.route.waypoints_m, margin_m=0.0).total == 0.0
    assert not np.shares_memory(unfinished.route.waypoints_m, unfinished.planned.route.waypoints_m)


BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


def held_in_the_air(autopilot) -> Scene:
    """On its way to the second waypoint, holding."""
    scene = restarting(autopilot)
    assert scene.fly(stop=presses(scene, 35.0, 35.1)).ending is Ending.LEFT_HOLDING
    return scene


def restarting(autopilot=ARDUPILOT) -> Scene:
    scene = make_scene(autopilot)
    scene.upload(mission())
    if autopilot is ARDUPILOT:
        scene.vehicle.parameters.put("MIS_RESTART", 1.0)
    return scene


def items_flown(scene: Scene, monkeypatch) -> list[tuple[float, int]]:
    """Each item that the vehicle begins to fly to, with the vehicle's time."""
    begun: list[tuple[float, int]] = []
    go_on = scene.vehicle.control.mission.go_on

    def listen(now: float) -> None:
        go_on(now)
        if not begun or begun[-1][1] != scene.vehicle.current_seq:
            begun.append((now, scene.vehicle.current_seq))

    monkeypatch.setattr(scene.vehicle.control.mission, "go_on", listen)
    return begun


def longest_stay_s(begun: list[tuple[float, int]], seqs: set[int], after_s: float) -> float:
    return max(
        (end - start for (start, seq), (end, _) in itertools.pairwise(begun) if seq in seqs and start > after_s),
        default=0.0,
    )


@BOTH
def test_after_a_pause_it_goes_on_with_the_item_it_was_flying_to(autopilot, monkeypatch):
    scene = restarting(autopilot)
    begun = items_flown(scene, monkeypatch)
    outcome = scene.fly(pause=lambda: 30.0 < (scene.monitor.time_s or 0.0) < 50.0)
    assert outcome.ending is Ending.LANDED, outcome.incidents
    first = begun[0][1]
    assert longest_stay_s(begun, {first, first + 1, first + 2}, 40.0) < 1.0


@BOTH
def test_the_way_home_is_flown_from_its_first_item(autopilot):
    scene = restarting(autopilot)
    assert scene.fly(stop=presses(scene, 35.0)).ending is Ending.RETURNED


@BOTH
def test_a_vehicle_in_the_air_goes_on_with_the_item_that_it_is_told(autopilot, monkeypatch):
    scene = held_in_the_air(autopilot)
    begun = items_flown(scene, monkeypatch)
    plan = dataclasses.replace(plan_for(mission()), first_waypoint_item=5, waypoint_count=2)
    outcome = take_over(
        scene.client, scene.monitor, lambda *_: Continuation(plan, upload=False, first_item=5),
        scene.orders(), plan_return=return_mission,
    )  # fmt: skip
    assert outcome.ending is Ending.LANDED
    begun_s = begun[0][0]
    assert longest_stay_s(begun, {1, 2, 3}, begun_s) < 1.0


def test_a_vehicle_that_flies_another_item_whatever_it_is_told_is_held(monkeypatch):
    scene = restarting()
    monkeypatch.setattr(FlightControl, "set_current", lambda *_: CommandResult.ACCEPTED)
    with pytest.raises(
        FlightFailedError, match="flies to item 3 instead of flying to item 5; it was commanded to hold; set"
    ) as failed:
        scene.fly(pause=lambda: 35.0 < (scene.monitor.time_s or 0.0) < 50.0)
    assert failed.value.outcome.ending is Ending.FAILED
    assert not scene.vehicle.armed
