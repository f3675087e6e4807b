"""Each fault by name: a named ending, all that was recorded is kept, and it says what happened and what the vehicle does now."""

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, Mode
from tests.flight.scene import Scene, make_scene, mission
from uavcover.flight.orders import FlightTimeouts
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.faults import parse_fault
from uavcover.model.track import Ending, EventKind, FlightFailedError, FlightOutcome

TIMEOUTS = FlightTimeouts(override_s=20.0, ready_s=20.0, stuck_s=20.0)


def faulty_scene(autopilot: Autopilot, *faults: str, **options) -> Scene:
    scene = make_scene(autopilot, faults=[parse_fault(fault) for fault in faults], **options)
    scene.upload(mission())
    return scene


def ended(scene: Scene, **options) -> tuple[FlightOutcome, str]:
    """How a flight that cannot end well ended, and what it says."""
    with pytest.raises(FlightFailedError) as caught:
        scene.fly(**{"timeouts": TIMEOUTS, **options})
    outcome = caught.value.outcome
    assert outcome.sample_count == len(scene.samples)
    assert caught.value.exit_code == 3
    return outcome, str(caught.value)


@pytest.mark.parametrize(
    ("autopilot", "fault", "ending", "says", "now"),
    [
        (
            ARDUPILOT,
            "heartbeat-loss@30s",
            "HEARTBEAT_LOST",
            "the vehicle is on the ground and may be armed",
            "on the ground, armed, in mission mode at its last heartbeat ",
        ),
        (
            ARDUPILOT,
            "motor-failure@30s",
            "CRASHED",
            "is now on the ground at ",
            "on the ground, according to its motion, armed, in mission mode",
        ),
        (
            ARDUPILOT,
            "gps-loss@30s",
            "GPS_LOST",
            'mode: the vehicle reported (critical): "GPS 1: lost fix"',
            "on the ground, disarmed, in land mode",
        ),
        (
            PX4,
            "gps-loss:5@30s",
            "GPS_LOST",
            'mode: the vehicle reported (critical): "GNSS data fusion',
            "on the ground, disarmed, in land mode",
        ),
        (ARDUPILOT, "battery-failsafe@30s", "BATTERY_FAILSAFE", "changed to return mode", "disarmed, in return mode"),
        (PX4, "battery-failsafe:land@30s", "BATTERY_FAILSAFE", "changed to land mode", "disarmed, in land mode"),
        (
            PX4,
            "pilot-mode@30s",
            "PILOT_TOOK_OVER",
            "hold mode: no failsafe was reported, so a pilot or another ground station changed the mode",
            "in the air, armed, in hold mode",
        ),
        (
            ARDUPILOT,
            "pilot-mode:land@30s",
            "PILOT_TOOK_OVER",
            "no failsafe was reported, so a pilot or another ground station changed the mode",
            "disarmed, in land mode",
        ),
        (
            PX4,
            "reboot@30s",
            "RESTARTED",
            "restarted: its clock was reset",
            "on the ground, disarmed, in manual mode",
        ),
        (
            ARDUPILOT,
            "link-outage:40@20s",
            "LINK_LOST",
            "link lost: no messages from vehicle 1 for 30",
            "last heard 30 s ago: ",
        ),
        (
            PX4,
            "stuck@20s",
            "STUCK",
            "stuck: no progress at item 4 for 20 s",
            "in the air, armed, in mission mode",
        ),
        (ARDUPILOT, "mission-changed@20s", "MISSION_CHANGED", "8 items instead of 9", "disarmed, in mission mode"),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_fault_has_its_ending(autopilot, fault, ending, says, now):
    outcome, text = ended(faulty_scene(autopilot, fault))
    assert outcome.ending is Ending[ending]
    assert says in text
    silent = outcome.vehicle_now.startswith("last heard ")
    assert (f"; {outcome.vehicle_now}" if silent else f"; now: {outcome.vehicle_now}") in text
    assert now in outcome.vehicle_now
    assert 0 < outcome.waypoints_reached <= 4
    assert outcome.sample_count > 200


@pytest.mark.parametrize(
    ("autopilot", "fault", "incidents"),
    [
        (PX4, "link-outage:10@20s", ["LINK_LOST"]),
        (ARDUPILOT, "link-outage:2@20s", []),
        (PX4, "stuck:10@20s", []),
        (ARDUPILOT, "heartbeat-loss:8@20s", ["HEARTBEAT_LOST"]),
        (ARDUPILOT, "arming-refused:15", []),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_what_is_over_soon_is_ridden_out_and_stated(autopilot, fault, incidents):
    scene = faulty_scene(autopilot, fault)
    outcome = scene.fly(timeouts=TIMEOUTS)
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == 4
    assert [incident.kind.name for incident in outcome.incidents] == incidents
    assert all(incident.end_s is not None for incident in outcome.incidents)
    warnings = [event for event in scene.events if event.kind is EventKind.WARNING]
    assert len([event for event in warnings if not event.alarm]) == len(incidents)
    assert all(event.alarm for event in warnings[: len(incidents)])


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_arming_that_stays_refused_is_no_flight(autopilot):
    scene = faulty_scene(autopilot, "arming-refused")
    outcome, text = ended(scene)
    assert outcome.ending is Ending.NOT_READY
    assert "no passed pre-arm check within 20 s" in text
    assert scene.samples == []


def test_wind_above_its_limits_blows_it_away_and_the_track_goes_to_the_end():
    scene = faulty_scene(ARDUPILOT, "strong-wind@10s", battery=BatteryData(endurance_s=100.0))
    outcome, text = ended(scene)
    assert outcome.ending is Ending.CRASHED, "its battery was empty"
    assert outcome.incidents[0].kind is Ending.WIND_ABOVE_LIMITS
    assert "off the planned leg to item 4" in text
    assert any("tilted by" in sign for sign in outcome.incidents[0].evidence)
    assert "disarmed " in text
    assert "m above home, descending at" in text
    assert scene.samples[-1].time_s >= scene.vehicle.time_s - 5.0


def test_the_record_of_a_changed_mission_names_no_planned_waypoints():
    scene = faulty_scene(PX4, "mission-changed@20s")
    outcome, _ = ended(scene)
    [changed] = [incident for incident in outcome.incidents if incident.kind is Ending.MISSION_CHANGED]
    assert changed.begin_s is not None
    assert {s.current_waypoint for s in scene.samples if s.time_s > changed.begin_s + 0.2} == {-1}
    assert any(
        "further change to the vehicle's mission: count is 8 instead of 9" in text
        for text in scene.reported(EventKind.WARNING)
    )


def test_a_jump_by_another_ground_station_passes_no_waypoints():
    scene = faulty_scene(ARDUPILOT)

    def jump(event) -> None:
        scene.events.append(event)
        if event.waypoint == 1:
            scene.vehicle.control.set_current(7)

    with pytest.raises(FlightFailedError, match="skips waypoint 1: another station set the current item") as caught:
        scene.fly(on_event=jump)
    assert caught.value.outcome.ending is Ending.MISSION_CHANGED
    assert caught.value.outcome.waypoints_reached == 1


def test_going_back_to_the_mission_goes_on_with_the_flight():
    scene = faulty_scene(PX4, "pilot-mode@20s")
    mission_again = iter([True])

    def give_back(event) -> None:
        scene.events.append(event)
        if "no failsafe was reported, so a pilot or another ground station changed the mode" in event.text and next(
            mission_again, False
        ):
            scene.vehicle.control.start_mission()

    outcome = scene.fly(on_event=give_back)
    assert outcome.ending is Ending.LANDED
    [incident] = outcome.incidents
    assert incident.kind is Ending.PILOT_TOOK_OVER
    assert incident.end_s is not None


def test_a_stop_does_not_fight_the_pilot():
    scene = faulty_scene(PX4, "pilot-mode:guided@20s")
    outcome, text = ended(scene, stop=lambda: sum((scene.monitor.time_s or 0.0) > at_s for at_s in (32.0, 40.0)))
    assert outcome.ending is Ending.PILOT_TOOK_OVER
    assert 40.0 <= scene.samples[-1].time_s < 42.0, "the first stop does not end the record"
    assert any(
        "recording continues until the vehicle is on the ground" in said for said in scene.reported(EventKind.STOP)
    )
    assert (
        "uavcover no longer follows the flight: the pilot or station that controls the vehicle remains in control"
        in text
    )
    assert scene.vehicle.armed
    assert outcome.vehicle_now.startswith("in the air, armed, in guided mode")


@pytest.mark.thinned
@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
@pytest.mark.parametrize("stops", [0, 1])
def test_while_a_pilot_holds_the_vehicle_the_record_goes_on_to_the_ground(autopilot, stops):
    """He hovers for five minutes, where nothing moves, and lands then; one Ctrl-C meanwhile changes nothing."""
    scene = make_scene(autopilot, faults=[parse_fault("pilot-mode@20s")], battery=BatteryData(endurance_s=2000.0))
    scene.upload(mission())

    def stop() -> int:
        if scene.vehicle.armed and scene.vehicle.time_s > 320.0 and scene.vehicle.mode is not Mode.LAND:
            scene.vehicle.control.set_mode(Mode.LAND)
        return int(stops and scene.vehicle.time_s > 100.0)

    with pytest.raises(FlightFailedError) as caught:
        scene.fly(stop=stop)
    outcome = caught.value.outcome
    assert outcome.ending is Ending.PILOT_TOOK_OVER
    assert scene.samples[-1].time_s > 320.0
    assert scene.samples[-1].up_m == pytest.approx(scene.samples[0].up_m, abs=0.3)
    gaps_s = np.diff([sample.time_s for sample in scene.samples])
    assert gaps_s.max() < 0.5


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_a_pause_holds_the_vehicle_and_then_it_goes_on(autopilot):
    scene = faulty_scene(autopilot)
    outcome = scene.fly(pause=lambda: 30.0 < (scene.monitor.time_s or 0.0) < 120.0)
    assert outcome.ending is Ending.LANDED
    assert outcome.waypoints_reached == 4
    assert outcome.incidents == ()
    held = [s for s in scene.samples if 45.0 < s.time_s < 119.0]
    assert max(s.east_m for s in held) - min(s.east_m for s in held) < 1.0
    assert [text.split(":")[0] for text in scene.reported(EventKind.STOP)] == [
        "paused",
        "the vehicle continues its mission",
    ]


def test_an_empty_battery_on_the_way_home_is_no_return():
    scene = faulty_scene(ARDUPILOT)

    def drain(event) -> None:
        scene.events.append(event)
        if "returning along" in event.text:
            scene.vehicle.body.battery.drop_to(0.00001)

    outcome, text = ended(scene, stop=lambda: int((scene.monitor.time_s or 0.0) > 35.0), on_event=drain)
    assert outcome.ending is Ending.CRASHED
    assert "m above home, descending at" in text
    assert "on its return; the vehicle reports:" in text


def test_a_stop_in_a_pause_brings_it_home():
    scene = faulty_scene(ARDUPILOT)
    now = lambda: scene.monitor.time_s or 0.0  # noqa: E731
    outcome = scene.fly(pause=lambda: now() > 30.0, stop=lambda: int(now() > 60.0))
    assert outcome.ending is Ending.RETURNED
    assert not scene.vehicle.armed
