"""Leaving fence, band, known ground or route: told at once and again, and what is done about it."""

import math
from itertools import pairwise

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from tests.flight.scene import FRAME, HOME, Scene, make_scene, mission, plan_for
from uavcover.flight.orders import FlightTimeouts, OnBreach, OperatingVolume, Phase, Precautions, reaction
from uavcover.mock.dynamics import BatteryData, WindModel
from uavcover.mock.faults import parse_fault
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
HOME_M = FRAME.enu_from_geodetic(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)[0]
TIMEOUTS = FlightTimeouts(override_s=20.0, held_s=20.0, stuck_s=40.0)


def around(**changes) -> OperatingVolume:
    """Flat known ground at home's height, no fence in the way, a band that the route keeps."""
    values = {
        "ground_up_m": lambda _east, _north: float(HOME_M[2]),
        "outside_fence_m": lambda _east, _north: 0.0,
        "min_height_agl_m": 40.0,
        "max_height_agl_m": 80.0,
    }
    return OperatingVolume(**{**values, **changes})


def east_of(limit_m: float):
    return lambda east, _: max(0.0, east - HOME_M[0] - limit_m)


BREACHES = {
    Ending.FENCE_BREACHED: around(outside_fence_m=east_of(40.0)),
    Ending.BAND_LEFT: around(max_height_agl_m=63.0),
    Ending.GROUND_UNKNOWN: around(ground_up_m=lambda e, _: math.nan if e - HOME_M[0] > 40.0 else float(HOME_M[2])),
}
KINDS = pytest.mark.parametrize("kind", list(BREACHES), ids=lambda k: k.key)


def scene_of(autopilot, *faults: str, **options) -> Scene:
    scene = make_scene(autopilot, faults=[parse_fault(fault) for fault in faults], **options)
    scene.upload(mission())
    return scene


def flown(scene: Scene, volume: OperatingVolume | None, on_breach: OnBreach, **options):
    plan = plan_for(mission(), volume=volume)
    return scene.fly(plan=plan, timeouts=TIMEOUTS, precautions=Precautions(on_breach=on_breach), **options)


def failed(*args, **options):
    with pytest.raises(FlightFailedError) as caught:
        flown(*args, **options)
    return caught.value.outcome, str(caught.value)


@AUTOPILOTS
def test_a_flight_inside_of_everything_has_no_alarm(autopilot):
    scene = scene_of(autopilot)
    outcome = flown(scene, around(), OnBreach.HOLD)
    assert (outcome.ending, outcome.incidents) == (Ending.LANDED, ())
    assert not any(event.alarm for event in scene.events)


@AUTOPILOTS
@KINDS
def test_it_is_told_and_ridden_out(autopilot, kind):
    scene = scene_of(autopilot)
    outcome = flown(scene, BREACHES[kind], OnBreach.TELL)
    assert outcome.ending is Ending.LANDED
    assert {i.kind for i in outcome.incidents} == {kind}
    assert all(i.begin_s < i.end_s for i in outcome.incidents)
    assert sum(e.alarm for e in scene.events) >= len(outcome.incidents)
    [document, *_] = outcome.as_json()["incidents"]
    assert document["kind"] == kind.key
    assert document["text"] == outcome.incidents[0].text


@AUTOPILOTS
@KINDS
def test_hold_holds_and_does_not_wait_for_ever(autopilot, kind):
    scene = scene_of(autopilot)
    outcome, text = failed(scene, BREACHES[kind], OnBreach.HOLD)
    assert outcome.ending is kind
    assert "the vehicle returned along checked legs and landed" in text
    assert not scene.vehicle.armed
    stops = scene.reported(EventKind.STOP)
    assert any("holds its position in" in reported and "for up to 20 s, then returns" in reported for reported in stops)
    assert any("has held its position for 20 s without continuing the mission" in reported for reported in stops)
    [begun] = [i.begin_s for i in outcome.incidents if i.kind is kind][:1]
    held = [s for s in scene.samples if begun + 10.0 < s.time_s < begun + 20.0]
    assert math.dist((held[0].east_m, held[0].north_m), (held[-1].east_m, held[-1].north_m)) < 1.0


@AUTOPILOTS
@KINDS
def test_return_flies_home_along_checked_legs(autopilot, kind):
    scene = scene_of(autopilot)
    outcome, text = failed(scene, BREACHES[kind], OnBreach.RETURN)
    assert outcome.ending is kind
    assert "returned along checked legs and landed" in text
    assert not scene.vehicle.armed
    assert outcome.waypoints_reached < 4


@pytest.mark.parametrize("pressed_before", [0, 1, 2], ids=lambda n: f"{n} presses before")
@AUTOPILOTS
def test_one_key_ends_the_hold_and_the_same_breach_does_not_hold_again(autopilot, pressed_before):
    scene = scene_of(autopilot)
    paused = [pressed_before % 2 == 1]
    held: list[FlightEvent] = []

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if "the vehicle now holds" in event.text:
            held.append(event)
            paused[0] = not paused[0]

    if pressed_before == 1:
        paused[0] = False  # a pause of before has to be over for the vehicle to fly
    outcome = flown(scene, BREACHES[Ending.FENCE_BREACHED], OnBreach.HOLD, on_event=listen, pause=lambda: paused[0])
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == 4
    assert len(held) == len([i for i in outcome.incidents if i.kind is Ending.FENCE_BREACHED]) >= 1


@AUTOPILOTS
@pytest.mark.parametrize("action", list(OnBreach), ids=lambda a: a.value)
def test_a_mission_changed_in_flight_is_a_breach(autopilot, action):
    scene = scene_of(autopilot, "mission-lowered@20s")
    outcome, _ = failed(scene, around(min_height_agl_m=5.0), action)
    assert outcome.ending is Ending.MISSION_CHANGED
    assert not scene.vehicle.flying
    if action is OnBreach.HOLD:
        held = [s for s in scene.samples if 5.0 < s.time_s - outcome.incidents[0].begin_s < 15.0]
        assert min(s.up_m for s in held) - HOME_M[2] > 30.0


def test_a_stop_while_it_holds_brings_it_home():
    scene = scene_of(ARDUPILOT)
    stops = [0]

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if "the vehicle now holds" in event.text:
            stops[0] = 1

    outcome = flown(scene, BREACHES[Ending.BAND_LEFT], OnBreach.HOLD, on_event=listen, stop=lambda: stops[0])
    assert outcome.ending is Ending.RETURNED
    assert [i.kind for i in outcome.incidents] == [Ending.BAND_LEFT]


@pytest.mark.parametrize("seed", range(3))
def test_wind_that_carries_it_away_is_never_silent(seed):
    """It is told at once, at every doubling and every 30 s, until the battery is empty and the vehicle falls."""
    scene = scene_of(
        ARDUPILOT, "strong-wind@10s", seed=seed, wind=WindModel(gust_m_s=1.0), battery=BatteryData(endurance_s=150.0)
    )
    with pytest.raises(FlightFailedError) as caught:
        scene.fly(timeouts=TIMEOUTS)
    assert caught.value.outcome.ending is Ending.CRASHED
    assert caught.value.outcome.incidents[0].kind is Ending.WIND_ABOVE_LIMITS
    reported = [e for e in scene.events if e.alarm and "off the planned leg" in e.text]
    far_m = [float(e.text.split(" is ")[1].split(" m ")[0]) for e in reported]
    assert 30.0 < far_m[0] < 60.0
    assert len(far_m) >= 4
    assert all(b <= 2.3 * a for a, b in pairwise(far_m))
    assert all(b.time_s - a.time_s <= 31.0 for a, b in pairwise(reported))
    assert float(caught.value.outcome.incidents[0].text.split(" is ")[1].split(" m ")[0]) >= far_m[-1]


def test_a_simulated_vehicle_holds_by_itself_and_a_real_one_is_only_told():
    for breach in BREACHES:
        assert reaction(breach, Phase.ROUTE, simulated=True, chosen=None) is OnBreach.HOLD
        assert reaction(breach, Phase.ROUTE, simulated=False, chosen=None) is OnBreach.TELL
        for action in OnBreach:
            assert reaction(breach, Phase.ROUTE, simulated=True, chosen=action) is action
    assert reaction(Ending.HOLD_LOST, Phase.HOLD, simulated=False, chosen=OnBreach.TELL) is OnBreach.RETURN
    assert reaction(Ending.BAND_LEFT, Phase.INBOUND, simulated=True, chosen=OnBreach.RETURN) is OnBreach.TELL


def test_a_battery_that_is_low_is_told_and_not_acted_on():
    scene = scene_of(ARDUPILOT, battery=BatteryData(endurance_s=110.0))
    outcome = flown(scene, around(), OnBreach.HOLD)
    assert outcome.ending is Ending.LANDED
    assert [i.kind for i in outcome.incidents] == [Ending.BATTERY_LOW]
    reported = [e.text for e in scene.events if e.alarm]
    assert reported[0] == "the battery has 15 % left"
