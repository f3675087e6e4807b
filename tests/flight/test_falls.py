"""Disarmed in the air is a crash, whatever the landed state says; landing on a hill is none."""

import math
import random
import re
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.links.simulated import Conditions
from mission_io.model.enums import LandedState
from mission_io.model.items import Frame, Mission, change_speed, land, takeoff, waypoint
from mission_io.wire import messages as m
from tests.flight.scene import HOME, Scene, above_home, geodetic, make_scene, plan_for, presses
from tests.flight.test_faults import ended, faulty_scene
from uavcover.flight.monitor import Monitor
from uavcover.mock.faults import parse_fault
from uavcover.mock.flight_control import FlightControl
from uavcover.model.track import Ending


def true_height_m(scene: Scene) -> list[float]:
    """Where the vehicle was when the fault began, above home."""
    heights: list[float] = []
    original = scene.vehicle.control.disarm

    def disarm(*, force: bool = False):
        if force:
            heights.append(scene.vehicle.body.point.position_m[2])
        return original(force=force)

    scene.vehicle.control.disarm = disarm  # type: ignore[method-assign]
    return heights


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.parametrize("seed", range(6))
def test_a_forced_disarm_in_the_air_is_a_crash_with_its_height(autopilot, seed):
    rng = random.Random(seed)
    moment = rng.choice([f"{rng.uniform(6.0, 40.0):.1f}s", f"item{rng.randint(3, 8)}"])
    conditions = Conditions(delay_s=0.01, loss=rng.choice([0.0, 0.1]))
    scene = faulty_scene(autopilot, f"force-disarm@{moment}", conditions=conditions, seed=seed + 1)
    heights_m = true_height_m(scene)
    outcome, text = ended(scene)
    assert outcome.ending is Ending.CRASHED
    reported = re.search(r"disarmed (\d+) m above (home|the ground), descending at", text)
    assert reported is not None, text
    assert float(reported[1]) == pytest.approx(heights_m[0], abs=2.0)
    assert "landed and disarmed" not in text
    assert scene.vehicle.body.on_ground, "the record goes on until it lies still"
    assert scene.samples[-1].alt_amsl_m == pytest.approx(HOME.alt_amsl_m, abs=0.5)


def test_the_mock_says_on_ground_at_once_while_it_falls():
    scene = faulty_scene(ARDUPILOT, "force-disarm@20s")
    said: list[tuple[int, float]] = []
    original = scene.monitor.ground.take_word

    def hear(state, time_s):
        said.append((state, scene.vehicle.body.point.position_m[2]))
        original(state, time_s)

    scene.monitor.ground.take_word = hear  # type: ignore[method-assign]
    ended(scene)
    high = [height_m for state, height_m in said if state == LandedState.ON_GROUND and height_m > 20.0]
    assert high, "as ArduCopter does"


def test_a_fall_on_the_way_home_is_a_crash_too():
    scene = faulty_scene(ARDUPILOT)

    def stop() -> int:
        now_s = scene.monitor.time_s or 0.0
        if now_s >= 45.0 and not scene.vehicle.faults.begun:
            scene.vehicle.faults.add(parse_fault("force-disarm@boot+1s"))
        return int(now_s >= 30.0)

    outcome, text = ended(scene, stop=stop)
    assert outcome.ending is Ending.CRASHED
    assert "on its return" in text


def test_a_fall_after_a_pilot_took_over_is_a_crash_and_both_are_told():
    scene = faulty_scene(PX4, "pilot-mode@20s", "force-disarm@35s")
    outcome, text = ended(scene)
    assert outcome.ending is Ending.CRASHED
    assert "no failsafe was reported, so a pilot or another ground station changed the mode" in text


def test_a_vehicle_that_falls_is_not_told_to_disarm(monkeypatch):
    reported: list[tuple[float, ...]] = []
    scene = faulty_scene(ARDUPILOT, "force-disarm@20s")
    original = type(scene.client).command

    def command(client, number, *params, **options):
        if number == 400:
            reported.append(params)
        return original(client, number, *params, **options)

    monkeypatch.setattr(type(scene.client), "command", command)
    ended(scene)
    assert reported == [(1.0,)]


def hill(height_m: float):
    """Level ground, and other ground from 60 m north of home on."""
    edge_deg = geodetic((0.0, 60.0, 0.0)).lat_deg

    def ground(lat_deg: float, lon_deg: float) -> float:
        del lon_deg
        return HOME.alt_amsl_m + (height_m if lat_deg > edge_deg else 0.0)

    return ground


def landing_on_the_hill(height_m: float) -> Mission:
    relative = Frame.ABOVE_HOME
    north = geodetic((0.0, 140.0, 0.0))
    return Mission(
        HOME,
        (
            takeoff(HOME.lat_deg, HOME.lon_deg, 20.0, frame=relative),
            change_speed(8.0),
            waypoint(*above_home((0.0, 10.0, 60.0)), frame=relative),
            waypoint(*above_home((0.0, 100.0, 60.0)), frame=relative),
            waypoint(*above_home((40.0, 140.0, 60.0)), frame=relative),
            waypoint(*above_home((0.0, 140.0, 60.0)), frame=relative),
            land(north.lat_deg, north.lon_deg, height_m, frame=relative),
        ),
    )


@pytest.mark.thinned(2)
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.parametrize("height_m", [40.0, 8.0, -30.0])
@pytest.mark.parametrize("known", [True, False])
def test_landing_higher_or_lower_than_home_is_no_crash(autopilot, height_m, known):
    wanted = landing_on_the_hill(height_m)
    scene = make_scene(autopilot, ground=hill(height_m))
    scene.upload(wanted)
    terrain = {"ground_at": hill(height_m), "ground_alt_amsl_m": HOME.alt_amsl_m} if known else {}
    outcome = scene.fly(wanted, plan=plan_for(wanted, **terrain))
    assert outcome.ending is Ending.LANDED
    assert scene.samples[-1].alt_amsl_m == pytest.approx(HOME.alt_amsl_m + height_m, abs=0.5)
    if known:
        assert "on the ground, disarmed" in outcome.vehicle_now


@pytest.mark.parametrize("height_m", [40.0, -30.0])
@pytest.mark.parametrize("known", [True, False])
def test_a_fall_onto_a_hill_is_a_crash_with_the_height_above_what_is_known(height_m, known):
    wanted = landing_on_the_hill(height_m)
    scene = make_scene(ARDUPILOT, ground=hill(height_m), faults=[parse_fault("force-disarm@item5")])
    scene.upload(wanted)
    terrain = {"ground_at": hill(height_m), "ground_alt_amsl_m": HOME.alt_amsl_m} if known else {}
    outcome, text = ended(scene, wanted=wanted, plan=plan_for(wanted, **terrain))
    assert outcome.ending is Ending.CRASHED
    above, of = (60.0 - height_m, "the ground") if known else (60.0, "home")
    reported = re.search(r"disarmed (\d+) m above (home|the ground)", text)
    assert reported is not None
    assert reported[2] == of
    assert float(reported[1]) == pytest.approx(above, abs=2.0)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_no_disarm_is_sent_to_a_vehicle_that_only_says_that_it_has_landed(autopilot, monkeypatch):
    """It hovers 60 m up, waiting, and its landed state is wrong all the time."""
    sent: list[bool] = []
    original = FlightControl.disarm

    def disarm(control, **how):
        sent.append(control.state.body.on_ground)
        return original(control, **how)

    monkeypatch.setattr(FlightControl, "disarm", disarm)
    scene = faulty_scene(autopilot, "stuck@20s")
    lying = type(scene.vehicle.body)
    true_state = lying.landed_state.fget
    monkeypatch.setattr(
        lying, "landed_state",
        property(lambda body: LandedState.ON_GROUND if body.point.position_m[2] > 30.0 else true_state(body)),
    )  # fmt: skip
    outcome, _ = ended(scene)
    assert outcome.ending is Ending.STUCK
    assert sent == []
    assert scene.vehicle.flying


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_ctrl_c_then_does_not_disarm_it_either(autopilot, monkeypatch):
    scene = faulty_scene(autopilot)
    lying = type(scene.vehicle.body)
    monkeypatch.setattr(lying, "landed_state", property(lambda _: LandedState.ON_GROUND))
    heights_m = true_height_m(scene)
    outcome = scene.fly(stop=presses(scene, 35.0))
    assert outcome.ending in (Ending.RETURNED, Ending.LEFT_HOLDING)
    assert heights_m == []
    assert not scene.vehicle.body.crashed


def test_silence_after_the_disarm_is_a_crash_where_it_was_high():
    scene = faulty_scene(ARDUPILOT)
    original = scene.vehicle.send

    def send(message):
        telling = scene.vehicle.armed or scene.vehicle.took_off_at_s is None
        if telling or not isinstance(message, m.GlobalPositionInt):
            original(message)

    scene.vehicle.send = send  # type: ignore[method-assign]
    scene.vehicle.faults.add(parse_fault("force-disarm@25s"))
    outcome, text = ended(scene)
    assert outcome.ending is Ending.CRASHED
    assert "m above home" in text


def heard_as(monkeypatch, change):
    """What the vehicle says 40 s after it was switched on and later is changed; None is lost."""
    take = Monitor._take

    def changed(monitor, message, now):
        message = change(message) if (monitor.time_s or 0.0) > 40.0 else message
        if message is not None:
            take(monitor, message, now)

    monkeypatch.setattr(Monitor, "_take", changed)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_a_vehicle_that_lands_and_goes_on_saying_that_it_flies_has_landed(autopilot, monkeypatch):
    heard_as(
        monkeypatch, lambda x: m.ExtendedSysState(0, LandedState.IN_AIR) if isinstance(x, m.ExtendedSysState) else x
    )
    scene = faulty_scene(autopilot)
    outcome = scene.fly()
    assert outcome.ending is Ending.LANDED
    assert outcome.vehicle_now.startswith("on the ground, according to its motion, disarmed")


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_a_vehicle_whose_positions_are_lost_is_neither_stuck_nor_landed(autopilot, monkeypatch):
    heard_as(monkeypatch, lambda x: None if isinstance(x, m.GlobalPositionInt) else x)
    scene = faulty_scene(autopilot)
    outcome, text = ended(scene)
    assert outcome.ending is Ending.POSITION_LOST
    assert "although other messages are arriving; the vehicle disarmed, but whether it landed is not known" in text
    assert not scene.vehicle.armed


def test_an_attitude_that_is_no_number_is_none(monkeypatch):
    """The cosine of an infinite pitch ended the program in flight."""
    heard_as(
        monkeypatch, lambda x: replace(x, roll_rad=math.nan, pitch_rad=math.inf) if isinstance(x, m.Attitude) else x
    )
    scene = faulty_scene(ARDUPILOT)
    assert scene.fly().ending is Ending.LANDED
    assert math.isnan(scene.samples[-1].pitch_deg)
