"""What was checked before arming is watched in flight: a second station changes it, and it is told with what comes of it."""

import dataclasses
from types import SimpleNamespace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    FramedPoint,
    LatLon,
    Mission,
    RallyPoints,
    trigger_camera_every,
)
from mission_io.wire import messages as m
from tests.flight.scene import HOME, Scene, above_home, make_scene, mission
from tests.flight.test_limits import the_plan
from uavcover.flight.orders import FlightTimeouts, OnBreach, Precautions
from uavcover.mock import behaviour
from uavcover.mock.reactions import handle
from uavcover.model.track import Ending, EventKind, FlightFailedError

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


def scene_of(autopilot=ARDUPILOT, **parameters: float) -> Scene:
    scene = make_scene(autopilot)
    for name, value in parameters.items():
        scene.vehicle.parameters.put(name, value)
    scene.upload(mission())
    return scene


def second_station(scene: Scene, *messages: m.Message) -> None:
    """Another ground station says something; broadcasts and acknowledgements go to all."""
    for message in messages:
        scene.vehicle.receive(m.Received(message, 254, 190), scene.vehicle.powered_s)


def command(number: int, *params: float) -> m.CommandLong:
    return m.CommandLong(1, 1, number, (*params, *(0.0,) * (7 - len(params))))


def home_at(east: float = 0.0, north: float = 0.0, up: float = 0.0) -> m.CommandLong:
    lat_deg, lon_deg, alt_m = above_home((east, north, up))
    return command(Command.DO_SET_HOME, 0, 0, 0, 0, lat_deg, lon_deg, HOME.alt_amsl_m + alt_m)


def flown(scene: Scene, change, *, at: int = 1, on_breach: OnBreach = OnBreach.TELL, plan=None, back=None):
    """Fly; on the way to a waypoint something is changed, and on the way to the next one it may be changed back."""

    def listen(event) -> None:
        scene.events.append(event)
        if event.waypoint == at:
            change(scene)
        if back is not None and event.waypoint == at + 1:
            back(scene)

    plan = the_plan() if plan is None else plan
    try:
        precautions = Precautions(on_breach=on_breach)
        timeouts = FlightTimeouts(override_s=20.0)  # a vehicle that holds at its fence is not followed for ever
        return scene.fly(plan=plan, on_event=listen, precautions=precautions, timeouts=timeouts), ""
    except FlightFailedError as error:
        return error.outcome, str(error)


def test_an_undisturbed_flight_has_no_word_of_it():
    scene = scene_of()
    outcome, _ = flown(scene, lambda _: None)
    assert (outcome.ending, outcome.incidents) == (Ending.LANDED, ())
    assert not [text for text in scene.reported(EventKind.WARNING) if "in flight" in text]


@pytest.mark.parametrize(
    ("autopilot", "since"), [(ARDUPILOT, "from the next item onwards"), (PX4, "immediately")], ids=["ArduPilot", "PX4"]
)
def test_home_lower_is_told_with_the_clearance_that_is_left(autopilot, since):
    scene = scene_of(autopilot)
    outcome, text = flown(scene, lambda scene: second_station(scene, home_at(up=-25.0)))
    assert outcome.ending is Ending.HOME_MOVED
    assert "home was moved 25.0 m lower in flight" in text
    assert f"{since}, the vehicle flies the remaining mission 25.0 m lower than planned" in text
    assert "its clearance above the ground changes from 55.0 m to 30.0 m, where 40 m is required" in text


def test_home_higher_and_aside_is_told_by_height_and_by_the_way_home():
    scene = scene_of()
    outcome, text = flown(scene, lambda scene: second_station(scene, home_at(north=60.0, up=15.0)))
    assert outcome.ending is Ending.HOME_MOVED
    assert "15.0 m higher and 60 m aside" in text
    assert "maximum height above the ground changes from 70.0 m to 85.0 m, where 80 m is allowed" in text
    assert "ends at the new home, along an unchecked path" in text


def test_a_home_that_is_put_back_is_an_incident_that_is_over():
    scene = scene_of()
    outcome, _ = flown(
        scene,
        lambda scene: second_station(scene, home_at(up=-25.0)),
        back=lambda scene: second_station(scene, home_at()),
    )
    [moved] = [incident for incident in outcome.incidents if incident.kind is Ending.HOME_MOVED]
    assert moved.end_s is not None
    assert "the vehicle's home was restored" in scene.reported(EventKind.WARNING)


def test_a_home_that_is_put_back_after_the_band_was_left_is_no_good_ending():
    scene = scene_of()
    outcome, text = flown(
        scene,
        lambda scene: second_station(scene, home_at(up=-25.0)),
        back=lambda scene: [scene.vehicle.advance(scene.vehicle.powered_s), Later(scene, 15.0, home_at())],
    )
    assert any(incident.kind is Ending.BAND_LEFT for incident in outcome.incidents)
    assert outcome.ending is Ending.HOME_MOVED
    assert "was moved in flight and later restored; meanwhile the" in text


class Later:
    """A second station says something after a while of vehicle time."""

    def __init__(self, scene: Scene, after_s: float, message: m.Message) -> None:
        at_s, go_on = scene.vehicle.powered_s + after_s, scene.vehicle.control.mission.go_on

        def listen(now: float) -> None:
            go_on(now)
            if scene.vehicle.powered_s >= at_s and not self.said:
                self.said = True
                control = scene.vehicle.control
                scene.vehicle.send_all(handle(control, scene.vehicle.failsafes, m.Received(message, 254, 190)))

        self.said = False
        scene.vehicle.control.mission.go_on = listen


@BOTH
@pytest.mark.parametrize("up", [-25.0, 12.0])
def test_the_way_home_that_we_fly_then_has_its_planned_heights(autopilot, up):
    scene = scene_of(autopilot)
    outcome, text = flown(scene, lambda scene: second_station(scene, home_at(up=up)), on_breach=OnBreach.RETURN)
    assert outcome.ending is Ending.HOME_MOVED
    assert "returned along checked legs" in text
    assert not scene.vehicle.armed
    over_home = [
        s.alt_amsl_m
        for s in scene.samples[len(scene.samples) // 2 :]
        if abs(s.lat_deg - HOME.lat_deg) < 1e-5 and abs(s.lon_deg - HOME.lon_deg) < 1e-5
    ]
    assert max(over_home) == pytest.approx(HOME.alt_amsl_m + 30.0, abs=2.0), "as return_plan plans it"


@pytest.mark.parametrize(
    ("autopilot", "parameter", "value", "ending", "said"),
    [
        (ARDUPILOT, "MIS_RESTART", 1, Ending.LANDED, "MIS_RESTART was changed in flight from 0 to 1"),
        (ARDUPILOT, "RTL_ALT", 1000, Ending.LANDED, "they are predicted again with this height"),
        (ARDUPILOT, "FENCE_ALT_MAX", 60, Ending.SETTINGS_CHANGED, "the mission leaves this fence"),
        (ARDUPILOT, "WPNAV_SPEED", 200, Ending.LANDED, "the mission sets its own speed"),
        (ARDUPILOT, "FENCE_MARGIN", 3, Ending.LANDED, "this does not affect the mission"),
        (PX4, "MPC_YAW_MODE", 5, Ending.LANDED, "this does not affect the mission"),
        (PX4, "GF_MAX_VER_DIST", 60, Ending.SETTINGS_CHANGED, "would interrupt it"),
    ],
)  # fmt: skip
def test_a_parameter_that_is_changed_in_flight_is_judged(autopilot, parameter, value, ending, said):
    fine = {"RTL_ALT": 6000, "FENCE_ENABLE": 1, "FENCE_ACTION": 0, "FENCE_ALT_MAX": 120, "FENCE_RADIUS": 400}
    scene = scene_of(autopilot, **(fine if autopilot is ARDUPILOT else {"RTL_RETURN_ALT": 60, "GF_ACTION": 2}))

    def change(scene: Scene) -> None:
        if parameter == "FENCE_ALT_MAX":
            scene.vehicle.parameters.put("FENCE_ACTION", 1)
            scene.vehicle.send(scene.vehicle.parameters.message("FENCE_ACTION"))
        scene.vehicle.parameters.put(parameter, value)
        scene.vehicle.send(scene.vehicle.parameters.message(parameter))  # as after a PARAM_SET, to all

    outcome, text = flown(scene, change)
    reported = " | ".join(scene.reported(EventKind.WARNING)) + text
    assert f"{parameter} was changed in flight from " in reported
    assert said in reported
    if ending is Ending.LANDED:
        assert outcome.ending is ending
    else:
        assert any(incident.kind is ending for incident in outcome.incidents)


def test_a_camera_that_turns_with_the_legs_makes_a_changed_heading_a_breach():
    plan = the_plan()
    plan = dataclasses.replace(plan, needs=dataclasses.replace(plan.needs, camera_turns=True))
    scene = scene_of(PX4)

    def change(scene: Scene) -> None:
        scene.vehicle.parameters.put("MPC_YAW_MODE", 5)
        scene.vehicle.send(scene.vehicle.parameters.message("MPC_YAW_MODE"))

    outcome, _ = flown(scene, change, plan=plan, on_breach=OnBreach.RETURN)
    assert outcome.ending is Ending.SETTINGS_CHANGED


def test_a_change_that_is_not_broadcast_is_found_by_reading_each_parameter_again():
    scene = scene_of()
    flown(scene, lambda scene: scene.vehicle.parameters.put("MIS_RESTART", 1.0), at=0)
    assert any("MIS_RESTART was changed in flight" in text for text in scene.reported(EventKind.WARNING))
    requested = [name for name in scene.reported(EventKind.WARNING) if "was changed" in name]
    assert len(requested) == 1


@pytest.mark.parametrize(("autopilot", "name"), [(ARDUPILOT, "CAM1_TRIGG_DIST"), (PX4, "TRIG_DISTANCE")])
@pytest.mark.parametrize(("distance_m", "warnings"), [(15.0732, 0), (30.0, 1)], ids=["the mission's", "another"])
def test_the_trigger_distance_that_the_mission_itself_sets_is_no_change(
    monkeypatch, autopilot, name, distance_m, warnings
):
    """ArduCopter and PX4 store DO_SET_CAM_TRIGG_DIST in this parameter; every survey was warned of it."""
    number, known = autopilot.mav_autopilot, behaviour.PARAMETERS
    monkeypatch.setattr(behaviour, "PARAMETERS", {number: {**known[number], name: behaviour.MockParameter()}})
    scene, plan = scene_of(autopilot, **{name: 0.0}), the_plan()
    *before, last, landing = plan.mission.items
    survey = Mission(HOME, (*before, trigger_camera_every(15.0732), trigger_camera_every(0.0), last, landing))
    scene.upload(survey)

    def change(scene: Scene) -> None:
        scene.vehicle.parameters.put(name, distance_m)
        scene.vehicle.send(scene.vehicle.parameters.message(name))

    outcome, _ = flown(scene, change, plan=dataclasses.replace(plan, mission=survey))
    assert outcome.ending is Ending.LANDED
    reported = [text for text in scene.reported(EventKind.WARNING) if f"{name} was changed in flight from 0 to" in text]
    assert len(reported) == warnings
    assert all(text.endswith("to 30: the mission sets it to 15.0732") for text in reported)


def square(half_m: float) -> Fence:
    corners = [(-half_m, -half_m), (-half_m, half_m), (half_m, half_m), (half_m, -half_m)]
    return Fence((FencePolygon(tuple(LatLon(*above_home((e, n, 0.0))[:2]) for e, n in corners)),))


@BOTH
def test_a_fence_that_another_station_makes_smaller_is_a_breach(autopilot):
    scene = scene_of(autopilot)
    assert scene.client.upload_and_verify(square(300.0)).passed

    def change(scene: Scene) -> None:
        assert scene.client.upload_and_verify(square(100.0), in_flight=True).passed

    outcome, text = flown(scene, change)
    reported = text + " | ".join(incident.text for incident in outcome.incidents)
    assert any(incident.kind is Ending.FENCE_CHANGED for incident in outcome.incidents)
    assert "another station changed the vehicle's fence in flight" in reported
    assert "the remaining mission leads 40 m outside this fence; an active" in reported


def test_rally_points_that_are_changed_are_told_and_do_not_end_the_flight():
    scene = scene_of()
    point = FramedPoint(*above_home((40.0, 40.0, 0.0))[:2], 30.0)

    def change(scene: Scene) -> None:
        assert scene.client.upload_and_verify(RallyPoints((point,)), in_flight=True).passed

    outcome, _ = flown(scene, change)
    assert outcome.ending is Ending.LANDED
    [changed] = [incident for incident in outcome.incidents if incident.kind is Ending.RALLY_CHANGED]
    assert "the autopilot's own return may lead there along an unchecked path" in changed.text


def test_lists_that_are_not_the_planned_ones_are_told_before_arming():
    scene = scene_of()
    point = FramedPoint(*above_home((40.0, 40.0, 0.0))[:2], 30.0)
    assert scene.client.upload_and_verify(RallyPoints((point,))).passed
    same = dataclasses.replace(the_plan(), lists=(Fence(), RallyPoints((point,))))
    judged = []

    def advice(_parameters, rally):
        judged.append(rally)
        return SimpleNamespace(sentences=())

    other = dataclasses.replace(
        the_plan(), lists=(square(300.0), RallyPoints()), returns=SimpleNamespace(advice=advice)
    )
    flown(scene, lambda _: None, plan=same)
    assert not [text for text in scene.reported(EventKind.WARNING) if "not as planned" in text]
    scene.events.clear()
    flown(scene, lambda _: None, plan=other)
    fence, rally = [text for text in scene.reported(EventKind.WARNING) if "not as planned" in text]
    assert (
        fence
        == "the vehicle's fence is not as planned: count is 0 instead of 4; the vehicle has no fence; repeat plan-upload"
    )
    assert (
        "rally points are not as planned: count is 1 instead of 0; the autopilot's own return may lead there" in rally
    )


def test_a_fence_put_out_of_force_by_command_is_a_breach():
    scene = scene_of(FENCE_ENABLE=1, FENCE_ALT_MAX=120, FENCE_RADIUS=400, RTL_ALT=6000)
    outcome, text = flown(scene, lambda scene: second_station(scene, command(Command.DO_FENCE_ENABLE, 0.0)))
    assert outcome.ending is Ending.FENCE_CHANGED
    assert "disabled in flight" in text


def test_a_station_with_our_system_id_is_told_once():
    scene = scene_of()

    def appear(scene: Scene) -> None:
        scene.client.peers.take(m.Received(m.Heartbeat(8, 6), 255, 191))

    flown(scene, appear)
    reported = [text for text in scene.reported(EventKind.WARNING) if "uses uavcover's system ID, 255" in text]
    assert len(reported) == 1
    assert "--own-system" in reported[0]
    assert scene.vehicle.mode is not Mode.GUIDED


def test_a_vehicle_that_does_not_listen_any_more_is_told():
    scene = scene_of()

    def turn_away(scene: Scene) -> None:
        scene.vehicle.parameters.put("MAV_GCS_SYSID", 250)
        scene.vehicle.parameters.put("MAV_OPTIONS", 1)

    flown(scene, turn_away, at=0)
    assert (
        len([text for text in scene.reported(EventKind.WARNING) if "did not answer 8 consecutive requests" in text])
        == 1
    )
