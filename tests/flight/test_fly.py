import dataclasses
import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.links.simulated import Conditions
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command, Frame, GeoPoint, Mission, land, return_to_launch, takeoff, waypoint
from mission_io.wire import messages as m
from tests.flight.scene import (
    FRAME,
    HOME,
    ROUTE_ENU_M,
    Scene,
    above_home,
    geodetic,
    make_scene,
    mission,
    plan_for,
    return_mission,
)
from uavcover.errors import VehicleError
from uavcover.flight.fly import fly
from uavcover.flight.orders import FlightTimeouts, OnBreach, Orders, Precautions, custom_mode
from uavcover.mock.behaviour import quick
from uavcover.mock.dynamics import WindModel
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.itinerary import Itinerary
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.state import MockState
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import Ending, EventKind, FlightFailedError


def ready_scene(*args, **options) -> Scene:
    scene = make_scene(*args, **options)
    scene.upload(mission())
    return scene


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_a_mission_is_flown_from_the_ground_to_the_ground(autopilot):
    scene = ready_scene(autopilot)
    outcome = scene.fly()

    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == len(ROUTE_ENU_M)
    assert outcome.simulated_by == "uavcover's mock vehicle"
    assert outcome.sample_count == len(scene.samples)
    track = scene.track()
    assert outcome.duration_s == pytest.approx(track[-1, 0] - track[0, 0])
    for point in ROUTE_ENU_M:
        position = geodetic(point)
        here = FRAME.enu_from_geodetic(position.lat_deg, position.lon_deg, position.alt_amsl_m)[0]
        assert np.linalg.norm(track[:, 1:] - here, axis=1).min() < 2.0
    assert not scene.vehicle.armed
    assert scene.samples[-1].alt_amsl_m == pytest.approx(HOME.alt_amsl_m, abs=0.01)


def test_the_track_has_every_waypoint_in_order_and_no_gaps():
    scene = ready_scene()
    scene.fly()
    numbers = [s.current_waypoint for s in scene.samples]
    changes = [a for a, b in zip(numbers, [None, *numbers], strict=False) if a != b]
    assert changes == [-1, 0, 1, 2, 3, -1]
    steps_s = np.diff(scene.track()[:, 0])
    assert steps_s.min() > 0.0
    assert steps_s.max() <= 0.2
    assert all(0.0 <= s.yaw_deg < 360.0 for s in scene.samples)
    flying_east = [s.yaw_deg for s in scene.samples if s.current_waypoint == 1][20:-20]
    assert np.mean(flying_east) == pytest.approx(90.0, abs=5.0)


def test_positions_in_the_two_frames_agree():
    scene = ready_scene()
    scene.fly()
    for sample in scene.samples[::100]:
        enu = FRAME.enu_from_geodetic(sample.lat_deg, sample.lon_deg, sample.alt_amsl_m)[0]
        assert enu == pytest.approx((sample.east_m, sample.north_m, sample.up_m))


def test_wind_changes_the_track_and_the_mission_is_still_flown():
    wind = WindModel(speed_m_s=6.0, from_deg=240.0, gust_m_s=1.5)
    calm, windy, again = ready_scene(), ready_scene(wind=wind), ready_scene(wind=wind)
    for scene in (calm, windy, again):
        assert scene.fly().ending is Ending.LANDED
    # Not as objects: where a time is unknown it is NaN, which equals nothing.
    np.testing.assert_array_equal(
        [dataclasses.astuple(sample) for sample in windy.samples],
        [dataclasses.astuple(sample) for sample in again.samples],
    )
    assert windy.track().shape != calm.track().shape or (windy.track() != calm.track()).any()
    assert np.mean([abs(s.roll_deg) for s in windy.samples]) > np.mean([abs(s.roll_deg) for s in calm.samples])


def test_another_seed_is_another_track():
    wind = WindModel(gust_m_s=1.5)
    one, two = ready_scene(wind=wind, seed=1), ready_scene(wind=wind, seed=2)
    one.fly()
    two.fly()
    assert one.track().shape != two.track().shape or (one.track() != two.track()).any()


def test_a_fast_vehicle_flies_the_same_way():
    slow, fast = ready_scene(), ready_scene(speed=50.0)
    slow.fly()
    fast.fly()
    assert fast.link.clock.now() < 5.0
    steps_s = np.diff(fast.track()[:, 0])
    assert steps_s.max() <= 0.2
    assert len(fast.samples) == pytest.approx(len(slow.samples), rel=0.05)


def test_a_flight_under_loss_ends_well():
    scene = ready_scene(conditions=Conditions(loss=0.1, delay_s=0.02, jitter_s=0.05, duplication=0.05))
    assert scene.fly().ending is Ending.LANDED
    assert np.diff(scene.track()[:, 0]).min() > 0.0


def test_a_mission_that_ends_with_a_return_is_flown():
    items = (
        takeoff(HOME.lat_deg, HOME.lon_deg, 20.0, frame=Frame.ABOVE_HOME),
        waypoint(*above_home((0.0, 40.0, 20.0)), frame=Frame.ABOVE_HOME, hold_s=3.0),
        return_to_launch(),
    )
    wanted = Mission(HOME, items)
    scene = make_scene()
    scene.upload(wanted)
    plan = plan_for(mission())
    outcome = scene.fly(
        plan=type(plan)(
            mission=wanted, first_waypoint_item=1, waypoint_count=1, frame=FRAME, home=HOME, max_home_error_m=10.0
        )
    )
    assert outcome.ending is Ending.LANDED
    assert max(s.alt_amsl_m for s in scene.samples) == pytest.approx(HOME.alt_amsl_m + 30.0, abs=1.0)
    assert math.hypot(scene.samples[-1].east_m - scene.samples[0].east_m, 0.0) < 1.0


def test_what_the_vehicle_says_before_it_is_ready_is_passed_on():
    scene = ready_scene(behaviour=quick(30.0))
    scene.fly()
    stages = scene.reported(EventKind.STAGE)
    assert stages.index("waiting until the vehicle is ready") < stages.index("the vehicle is ready")
    assert scene.samples[0].time_s >= 30.0


def test_progress_is_told_waypoint_by_waypoint():
    scene = ready_scene()
    scene.fly()
    assert [e.waypoint for e in scene.events if e.kind is EventKind.WAYPOINT] == [0, 1, 2, 3]


# What is refused before arming.


def refused(scene: Scene, match: str, **options) -> None:
    with pytest.raises(VehicleError, match=match):
        scene.fly(**options)
    assert not scene.vehicle.armed
    assert scene.samples == []


def test_a_home_beside_the_planned_one_is_refused():
    plan = plan_for(mission(), home=geodetic((30.0, 0.0, 0.0)))
    refused(
        ready_scene(),
        r"home \(latitude 36\.5123457, longitude -84\.2123457\) is 30\.0 m from the planned home, but",
        plan=plan,
    )


@pytest.mark.parametrize(("lower_m", "message"), [(12.0, "12.0 m above"), (-12.0, "12.0 m below")])
def test_a_home_at_another_height_is_refused(lower_m, message):
    planned = GeoPoint(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m - lower_m)
    refused(ready_scene(), rf"{message} the planned home", plan=plan_for(mission(), home=planned))


@pytest.mark.parametrize(("higher_m", "message"), [(40.0, "352.5 m"), (-40.0, "272.5 m")])
def test_terrain_at_another_height_than_home_is_refused(higher_m, message):
    plan = plan_for(mission(), ground_alt_amsl_m=HOME.alt_amsl_m + higher_m)
    refused(ready_scene(), f"the terrain there at {message}", plan=plan)


def test_another_mission_in_the_vehicle_is_refused():
    scene = make_scene()
    scene.upload(mission(speed_m_s=5.0))
    refused(scene, r"the mission on the vehicle differs from the plan \(param2 in item 2")


def test_an_empty_vehicle_is_refused():
    scene = make_scene()
    refused(scene, r"the mission on the vehicle differs from the plan \(count is 0")


def test_a_vehicle_that_is_not_ready_says_what_it_lacks():
    refused(ready_scene(behaviour=quick(1e6)), "has no satellite fix and no position estimate .* within 120 s")


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_refused_arming_has_its_result_and_the_vehicles_reason(autopilot, monkeypatch):
    scene = ready_scene(autopilot)
    monkeypatch.setattr(type(scene.vehicle), "ready", False)
    monkeypatch.setattr("uavcover.flight.arming.missing", lambda session: session.monitor.time_s is None and ["time"])
    name = {
        "ArduPilot": r"FAILED; the vehicle reports: .*PreArm: Need Position",
        "PX4": r"TEMPORARILY_REJECTED; the vehicle reports: .*Preflight",
    }
    with pytest.raises(VehicleError, match=rf"COMPONENT_ARM_DISARM \(400\) with {name[autopilot.name]}"):
        scene.fly()
    assert not scene.vehicle.armed


def test_a_vehicle_that_may_be_real_needs_the_users_word(monkeypatch):
    monkeypatch.setattr("uavcover.flight.orders.MOCK_UID", 42)
    scene = ready_scene()
    refused(scene, "vehicle 1 may be a real vehicle, so no command")
    assert scene.fly(confirmed=True).simulated_by is None


def test_an_armed_vehicle_is_not_touched():
    scene = ready_scene()
    scene.client.set_mode(custom_mode(ARDUPILOT, Mode.GUIDED))
    scene.client.command(Command.COMPONENT_ARM_DISARM, 1.0)
    scene.client.poll(2.0)
    with pytest.raises(VehicleError, match="is already armed, in guided mode"):
        scene.fly()


def test_silence_instead_of_a_vehicle_is_an_error():
    class Silent(InMemoryPeer):
        def datagrams_to_send(self, *_: object) -> list[bytes]:
            return []

        def next_timer(self) -> float:
            return math.inf

    scene = make_scene(make_peer=lambda vehicle, speed: Silent(vehicle, speed=speed))
    with pytest.raises(VehicleError, match="no vehicle sent a heartbeat within 10 s"):
        scene.fly()


def test_too_few_positions_are_refused(monkeypatch):
    scene = ready_scene()
    original = MockState.set_interval

    def slow(vehicle, kind, interval_s):
        original(vehicle, kind, 0.5 if kind is m.GlobalPositionInt else interval_s)

    monkeypatch.setattr(MockState, "set_interval", slow)
    refused(
        scene,
        r"after 3 requests, the vehicle sends GlobalPositionInt 1\.9 times a second of vehicle time, but following the flight",
    )


# What goes wrong in flight.


class Falling(InMemoryPeer):
    """A vehicle that falls silent at a vehicle time."""

    silent_from_s = 40.0

    def datagrams_to_send(self, now: float) -> list[bytes]:
        sent = super().datagrams_to_send(now)
        return [] if self.vehicle.time_s >= self.silent_from_s else sent


def test_a_lost_link_is_an_error_and_the_record_is_kept():
    scene = make_scene(make_peer=lambda vehicle, speed: Falling(vehicle, speed=speed))
    scene.upload(mission())
    with pytest.raises(
        FlightFailedError, match=r"link lost: no messages from vehicle 1 for 8.*in mission mode"
    ) as caught:
        scene.fly(timeouts=FlightTimeouts(link_lost_s=8.0))
    assert caught.value.outcome.ending is Ending.LINK_LOST
    assert caught.value.outcome.sample_count == len(scene.samples)
    assert "no messages from vehicle 1 for 3.0 s; waiting up to 8 s" in scene.reported(EventKind.WARNING)
    assert scene.samples[-1].time_s == pytest.approx(40.0, abs=0.3)
    assert len(scene.samples) > 200
    assert scene.link.clock.now() < 49.0


def test_a_mission_that_is_refused_has_the_results_name(monkeypatch):
    scene = ready_scene()
    monkeypatch.setattr(FlightControl, "start_mission", lambda _: CommandResult.DENIED)
    with pytest.raises(VehicleError, match=r"MISSION_START \(300\) with DENIED"):
        scene.fly()


def test_a_vehicle_that_does_not_take_off_is_an_error(monkeypatch):
    scene = ready_scene()
    monkeypatch.setattr(FlightControl, "start_mission", lambda _: CommandResult.ACCEPTED)
    with pytest.raises(VehicleError, match="armed and in mission mode, but did not take off within 5 s"):
        scene.fly(timeouts=FlightTimeouts(start_s=5.0))


def test_a_stuck_vehicle_is_an_error(monkeypatch):
    scene = ready_scene()
    original = Itinerary.wanted_velocity

    def stuck(self, now, ground_up_m):
        return original(self, now, ground_up_m) if now < 30.0 else (0.0, 0.0, 0.0)

    monkeypatch.setattr(Itinerary, "wanted_velocity", stuck)
    with pytest.raises(
        VehicleError, match=r"the vehicle is stuck: no progress at item \d for 60 s; now: in the air, armed"
    ):
        scene.fly()
    assert scene.samples[-1].time_s > 80.0


def test_a_pilot_who_lands_it_early_is_an_error_that_says_how_far_it_came():
    scene = ready_scene()

    def land_at_waypoint_2(event) -> None:
        if event.waypoint == 2:
            scene.vehicle.control.set_mode(Mode.LAND)

    with pytest.raises(VehicleError, match=r"landed and disarmed after 2 of 4 planned waypoints; now: .*in land mode"):
        fly(
            scene.client,
            scene.monitor,
            plan_for(mission()),
            Orders(
                on_sample=scene.samples.append,
                on_event=lambda event: (scene.events.append(event), land_at_waypoint_2(event)),
                precautions=Precautions(on_breach=OnBreach.TELL),
            ),
            plan_return=return_mission,
        )
    assert (
        "the vehicle changed to land mode: no failsafe was reported, so a pilot or another ground station changed the mode"
        in scene.reported(EventKind.WARNING)
    )


def test_a_vehicle_that_restarts_in_flight_is_an_error():
    scene = make_scene(make_peer=Restarting)
    scene.upload(mission())
    with pytest.raises(VehicleError, match="vehicle 1 restarted"):
        scene.fly()


class Restarting(InMemoryPeer):
    def __init__(self, vehicle: MockVehicle, speed: float) -> None:
        super().__init__(vehicle, speed=speed)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        if self.vehicle.time_s > 40.0 and self.vehicle.armed:
            self.vehicle = MockVehicle(ARDUPILOT, HOME)
            self._vehicle_s = 0.0
        return super().datagrams_to_send(now)


def test_a_landing_beside_home_ends_there():
    wanted = Mission(
        HOME,
        (
            takeoff(HOME.lat_deg, HOME.lon_deg, 20.0, frame=Frame.ABOVE_HOME),
            waypoint(*above_home((0.0, 40.0, 20.0)), frame=Frame.ABOVE_HOME),
            land(*above_home((10.0, 40.0, 0.0)), frame=Frame.ABOVE_HOME),
        ),
    )
    scene = make_scene()
    scene.upload(wanted)
    plan = plan_for(mission())
    scene.fly(plan=type(plan)(mission=wanted, first_waypoint_item=1, waypoint_count=1, frame=FRAME, home=HOME))
    end, target = scene.samples[-1], geodetic((10.0, 40.0, 0.0))
    assert end.lat_deg == pytest.approx(target.lat_deg, abs=5e-6)
    assert end.lon_deg == pytest.approx(target.lon_deg, abs=5e-6)
    assert Command.NAV_LAND in [item.command for item in scene.vehicle.mission_items]
