"""Ctrl-C: once is home along checked legs, twice is hold."""

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import CommandResult
from mission_io.model.items import Mission
from tests.flight.scene import HOME, Scene, make_scene, mission, presses, return_mission
from uavcover.errors import InfeasibleError, VehicleError
from uavcover.flight.orders import Clearance
from uavcover.mock.behaviour import quick
from uavcover.mock.faults import parse_fault
from uavcover.mock.flight_control import FlightControl
from uavcover.model.track import Ending, EventKind, FlightFailedError


def scene_with_mission(autopilot=ARDUPILOT) -> Scene:
    scene = make_scene(autopilot)
    scene.upload(mission())
    return scene


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_once_holds_and_flies_home_along_the_checked_legs(autopilot):
    scene = scene_with_mission(autopilot)
    requested = []

    def plan_return(lat_deg, lon_deg, alt_amsl_m):
        requested.append((lat_deg, lon_deg, alt_amsl_m))
        return return_mission(lat_deg, lon_deg, alt_amsl_m)

    outcome = scene.fly(stop=presses(scene, 35.0), plan_return=plan_return)

    assert outcome.ending is Ending.RETURNED
    assert not scene.vehicle.armed
    assert scene.samples[-1].alt_amsl_m == pytest.approx(HOME.alt_amsl_m, abs=0.01)
    assert scene.samples[-1].lat_deg == pytest.approx(HOME.lat_deg, abs=1e-5)
    [(lat_deg, lon_deg, alt_amsl_m)] = requested
    # The way home begins with a climb by 10 m where the vehicle holds.
    over = [s for s in scene.samples if abs(s.alt_amsl_m - alt_amsl_m - 10.0) < 2.0 and s.time_s > 35.0]
    assert any(abs(s.lat_deg - lat_deg) < 3e-5 and abs(s.lon_deg - lon_deg) < 3e-5 for s in over)
    gaps = [b.time_s - a.time_s for a, b in zip(scene.samples, scene.samples[1:], strict=False)]
    assert max(gaps) <= 0.2, "nothing is missing from the record while commands and upload went on"
    after = [s.current_waypoint for s in scene.samples if s.time_s > 37.0]
    assert set(after) == {-1}
    assert 0 < outcome.waypoints_reached < 4


def test_a_return_that_the_wind_blows_away_is_told_from_its_first_item_on():
    scene = make_scene(faults=[parse_fault("strong-wind:25@item6")])
    scene.upload(mission())
    with pytest.raises(
        FlightFailedError, match="the vehicle is in guided mode and does not stop within 20 s; now: in the air"
    ):
        scene.fly(stop=presses(scene, 77.0, 150.0))
    reported = [event.text for event in scene.events]
    after = reported[next(k for k, text in enumerate(reported) if text.startswith("returning along checked legs")) :]
    assert [text for text in after if "m off the planned leg to item 1, because the wind is too strong" in text]
    assert max(sample.east_m for sample in scene.samples) > 300.0


def test_twice_leaves_it_holding_and_says_so():
    scene = scene_with_mission()
    outcome = scene.fly(stop=presses(scene, 35.0, 45.0))
    assert outcome.ending is Ending.LEFT_HOLDING
    assert scene.vehicle.armed
    assert scene.vehicle.mode is Mode.GUIDED
    assert (
        "the user stopped the flight a second time: the vehicle holds in guided mode"
        in scene.reported(EventKind.STOP)[-1]
    )
    before = scene.vehicle.body.point.position_m
    scene.vehicle.advance(scene.vehicle.time_s + 60.0)
    assert scene.vehicle.body.point.position_m == pytest.approx(before, abs=0.5)


def test_twice_at_once_does_not_ask_for_a_way_home():
    scene = scene_with_mission(PX4)
    outcome = scene.fly(stop=presses(scene, 35.0, 35.1), plan_return=None)
    assert outcome.ending is Ending.LEFT_HOLDING
    assert scene.vehicle.mode is Mode.HOLD


def test_without_a_checked_way_home_it_is_left_holding():
    def none(*_: float) -> Mission:
        raise InfeasibleError("a ridge is in the way")

    scene = scene_with_mission()
    outcome = scene.fly(stop=presses(scene, 35.0), plan_return=none)
    assert outcome.ending is Ending.LEFT_HOLDING
    assert (
        "no checked return starts at the current position: a ridge is in the way" in scene.reported(EventKind.STOP)[-1]
    )


def test_a_way_home_that_the_vehicle_does_not_take_leaves_it_holding():
    scene = scene_with_mission()

    def too_long(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
        return Mission(HOME, return_mission(lat_deg, lon_deg, alt_amsl_m).items * 300)

    outcome = scene.fly(stop=presses(scene, 35.0), plan_return=too_long)
    assert outcome.ending is Ending.LEFT_HOLDING
    assert "cannot upload the return" in scene.reported(EventKind.STOP)[-1]


def test_before_it_is_ready_nothing_is_armed():
    scene = make_scene(behaviour=quick(30.0))
    scene.upload(mission())
    outcome = scene.fly(stop=presses(scene, 10.0))
    assert outcome.ending is Ending.NOT_FLOWN
    assert not scene.vehicle.armed
    assert scene.samples == []


def test_on_the_ground_after_arming_it_is_disarmed(monkeypatch):
    scene = scene_with_mission()
    monkeypatch.setattr(FlightControl, "start_mission", lambda _: CommandResult.ACCEPTED)
    outcome = scene.fly(stop=presses(scene, 9.0))
    assert outcome.ending is Ending.NOT_FLOWN
    assert not scene.vehicle.armed


def test_a_vehicle_that_does_not_hold_is_an_error(monkeypatch):
    scene = scene_with_mission()
    original = FlightControl.set_mode

    def refuses_guided_in_the_air(control, mode, **options):
        in_air = mode is Mode.GUIDED and not control.state.body.on_ground
        return CommandResult.DENIED if in_air else original(control, mode, **options)

    monkeypatch.setattr(FlightControl, "set_mode", refuses_guided_in_the_air)
    with pytest.raises(VehicleError, match=r"DO_SET_MODE \(176\) with DENIED"):
        scene.fly(stop=presses(scene, 35.0))


def test_a_vehicle_that_has_just_left_the_ground_is_flown_home(monkeypatch):
    scene = scene_with_mission()
    monkeypatch.setattr("uavcover.flight.fly.is_flying", lambda _: False)
    outcome = scene.fly(stop=presses(scene, 20.0))
    assert outcome.ending is Ending.RETURNED
    assert not scene.vehicle.armed


@pytest.mark.parametrize("held", [False, True], ids=["in its mission", "while it holds"])
def test_one_that_must_go_home_flies_the_checked_legs(held):
    scene = scene_with_mission()
    late = lambda: "the battery" if (scene.monitor.time_s or 0.0) > 40.0 else None  # noqa: E731
    outcome = scene.fly(
        clearance=Clearance(must_go_home=late), pause=lambda: held and (scene.monitor.time_s or 0.0) > 35.0
    )
    assert outcome.ending is Ending.RESERVE_KEPT
    assert outcome.ending.good
    assert not scene.vehicle.armed
    assert scene.reported(EventKind.STOP)[int(held)] == "the battery"
    assert 0 < outcome.waypoints_reached < 4
    assert scene.samples[-1].lat_deg == pytest.approx(HOME.lat_deg, abs=1e-5)


def test_one_that_must_go_home_and_cannot_is_left_holding():
    scene = scene_with_mission()

    def no_return(*_):
        raise InfeasibleError("a hill is in the way")

    with pytest.raises(
        VehicleError, match="the vehicle holds its position and is using its battery reserve; take manual control now"
    ):
        scene.fly(
            clearance=Clearance(must_go_home=lambda: "x" if (scene.monitor.time_s or 0.0) > 35.0 else None),
            plan_return=no_return,
        )
    assert scene.vehicle.armed
